"""numba's compiler, quicker: what it finds out again and again is kept, what nobody listens to is left out.

Nothing here changes what a kernel is compiled to. Each function puts its own in the place of one of numba's.
"""

import sys
from contextlib import nullcontext
from functools import cache

import llvmlite.binding as llvm
from numba.core import base, config, errors, event, ir, lowering, typeinfer, types, typing
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.targetconfig import TargetConfig
from numba.core.transforms import canonicalize_cfg

NO_VARIABLES = (str, int, float, bool, type(None), ir.Loc, ir.Scope)  # may stand in a statement


def quicken() -> None:
    """All of it."""
    leave_out_events()
    remember_sizes()
    remember_signatures()
    compare_flags_first()
    find_lifetimes_if_asked()
    find_variables_by_type()
    refresh_if_new()
    base._has_loc = cache(base._has_loc)
    llvm.get_process_triple = cache(llvm.get_process_triple)
    ir.Loc._get_path = lambda place: place.filename  # else relative, for words that few errors have
    config.reload_config = lambda: None  # a look at files and variables, for each function
    # Else Python's class of abstract ones, of which no type here has any.
    type(types.Type).__instancecheck__ = type.__instancecheck__


def leave_out_events() -> None:
    """Of each lock, pass and function, for clocks that nobody reads."""
    event.start_event = event.end_event = lambda *of, **what: None
    event.trigger_event = lambda *of, **what: nullcontext()
    llvm.ffi.lib._lock._cblist.clear()
    errors.new_error_context = lowering.new_error_context = typeinfer.new_error_context = Context


class Context:
    """Where an error came from, made into words if there is one."""

    __slots__ = "named", "parts", "words"

    def __init__(self, words, *parts, **named):
        self.words, self.parts, self.named = words, parts, named

    def __enter__(self):
        pass

    def __exit__(self, kind, error, trace):
        if isinstance(error, errors.NumbaError):
            error.add_context(errors._format_msg(self.words, self.parts, self.named))


def remember_sizes() -> None:
    """Of types, each of which numba asks LLVM for in a module of text."""
    sizes: dict = {}
    size_of = base.BaseContext.get_abi_sizeof

    def remembered(context, kind):
        key = str(kind)
        if key not in sizes:
            sizes[key] = size_of(context, kind)
        return sizes[key]

    base.BaseContext.get_abi_sizeof = remembered


def remember_signatures() -> None:
    """What an operation gives, for which numba tries a dozen rules on strings, lists and sets first."""
    signatures: dict = {}
    resolve = types.BaseFunction.get_call_type

    def remembered(function, context, arguments, named):
        if named or not all(isinstance(kind, types.Number | types.Boolean) for kind in arguments):
            return resolve(function, context, arguments, named)
        key = function, tuple(arguments)
        if key not in signatures:
            signatures[key] = resolve(function, context, arguments, named)
        return signatures[key]

    types.BaseFunction.get_call_type = remembered


def compare_flags_first() -> None:
    """Flags are equal where those that were set are: numba makes a dictionary of all of them each time."""

    def all_values(flags):
        return {name: option.default for name, option in flags.options.items()} | flags._values

    def equal(flags, others):
        return flags is others or (
            type(flags) is type(others)
            and (flags._values == others._values or all_values(flags) == all_values(others))
        )

    TargetConfig.__hash__ = lambda flags: hash((flags.no_cpython_wrapper, flags.noalias, flags.forceinline))
    TargetConfig.__eq__ = equal


def find_lifetimes_if_asked() -> None:
    """Where variables die, in statements that numba makes and takes out again behind most passes."""
    run = PostProcessor.run

    def if_asked(processor, emit_dels=False, extend_lifetimes=False):
        if emit_dels or processor.func_ir.is_generator:
            run(processor, emit_dels, extend_lifetimes)
        else:
            processor.func_ir.blocks = canonicalize_cfg(processor.func_ir.blocks)
            processor.func_ir.variable_lifetime = VariableLifetime(processor.func_ir.blocks)
            processor.func_ir.generator_info = None

    PostProcessor.run = if_asked


def find_variables_by_type() -> None:
    """The variables of a statement: most of what stands in one is none, and told so by its type."""
    variables_in = ir.Inst._rec_list_vars
    none = set(NO_VARIABLES)

    def found(statement, value):
        kind = type(value)
        if kind is ir.Var:
            return [value]
        return [] if kind in none else variables_in(statement, value)

    ir.Inst._rec_list_vars = found


def refresh_if_new() -> None:
    """numba's registries are taken in again only where one has grown, or a module has been imported."""
    for kind in (base.BaseContext, typing.BaseContext):
        kind.refresh = _refreshed(kind.refresh)


def _refreshed(refresh):
    def if_new(context):
        if vars(context).get("_seen") != _registered(context):
            refresh(context)
            context._seen = _registered(context)

    return if_new


def _registered(context) -> list:
    registered = [
        len(getattr(registry, name))
        for registry, loader in context._registries.items()
        for name in loader.registry_items
    ]
    return [len(sys.modules), *registered]
