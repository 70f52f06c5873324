"""What numba does with a kernel on the way to machine code, where it differs from numba's own.

A kernel is typed, lowered to LLVM's language, joined there with the functions that it calls, optimised, and
made machine code. numba does all of that for each of those functions as well, and has no use for it: a third
of the time. Here they are lowered alone, and optimised within the kernels that they are joined with.
"""

import operator
from functools import cache

from llvmlite.binding import Linkage, parse_assembly
from numba import _dynfunc
from numba.core import ir, types
from numba.core.cgutils import normalize_ir_text
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import (
    FunctionPass,
    LoweringPass,
    PassManager,
    _pass_registry,
    register_pass,
)
from numba.core.environment import lookup_environment
from numba.core.ir_utils import build_definitions, get_definition, guard
from numba.core.postproc import PostProcessor
from numba.core.transforms import canonicalize_cfg
from numba.core.typed_passes import (
    InlineOverloads,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonRewrites,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

from netfall.ground.handed import hand, whole


@register_pass(mutates_CFG=False, analysis_only=False)
class AbsentFields(FunctionPass):
    """Decides `is None` for arguments and for fields of named tuples that are arguments, by their types.

    What a scene does not have is None: `if slots.eps_p is not None`. numba drops a branch on an argument that
    is None, and with it what the scene lacks. With this pass it does so for fields too, and it drops the
    other branch as well where the field is there.
    """

    _name = "absent_fields"

    def __init__(self):
        FunctionPass.__init__(self)

    def run_pass(self, state):
        """Rewrite the function in hand; whether anything was."""
        changed = False
        for block in state.func_ir.blocks.values():
            for assign in block.find_insts(ir.Assign):
                constant = self._constant(state, assign.value)
                if constant is not None:
                    definitions = state.func_ir._definitions[assign.target.name]
                    definitions[definitions.index(assign.value)] = constant
                    assign.value = constant
                    changed = True
        return changed

    def _constant(self, state, value):
        """The constant that an expression is known to be, None if it is none."""
        if not isinstance(value, ir.Expr):
            return None
        if value.op == "getattr" and isinstance(self._type_of_field(state, value), types.NoneType):
            return ir.Const(None, value.loc)
        if value.op == "binop" and value.fn in (operator.is_, operator.is_not):
            other = guard(get_definition, state.func_ir, value.rhs)
            kind = self._type_of(state, value.lhs)
            if isinstance(other, ir.Const) and other.value is None and self._decided(kind):
                return ir.Const(isinstance(kind, types.NoneType) == (value.fn is operator.is_), value.loc)
        return None

    def _decided(self, kind):
        """Whether a type says if a value is None."""
        return kind is not None and not isinstance(kind, types.Omitted | types.Optional)

    def _type_of(self, state, variable):
        """Type of a variable that is an argument or a field of one; None if it is neither."""
        value = guard(get_definition, state.func_ir, variable)
        if isinstance(value, ir.Const) and value.value is None:
            return types.none
        return state.args[value.index] if isinstance(value, ir.Arg) else self._type_of_field(state, value)

    def _type_of_field(self, state, value):
        """Type of a field of an argument; None if the expression is something else."""
        if not (isinstance(value, ir.Expr) and value.op == "getattr"):
            return None
        owner = whole(self._type_of(state, value.value))
        if not isinstance(owner, types.BaseNamedTuple) or value.attr not in owner.fields:
            return None
        return owner.types[owner.fields.index(value.attr)]


@register_pass(mutates_CFG=False, analysis_only=False)
class HandedArguments(FunctionPass):
    """Named tuples that a function is given whole are handed on by their address from its begin."""

    _name = "handed_arguments"

    def __init__(self):
        FunctionPass.__init__(self)

    def run_pass(self, state):
        """Rewrite the function in hand; whether anything was."""
        if not any(isinstance(kind, types.BaseNamedTuple) for kind in state.args):
            return False
        first = state.func_ir.blocks[min(state.func_ir.blocks)]
        body = []
        for assign in first.body:
            given = isinstance(assign, ir.Assign) and isinstance(assign.value, ir.Arg)
            if given and isinstance(state.args[assign.value.index], types.BaseNamedTuple):
                loc, scope = assign.loc, first.scope
                tuple_, function = scope.redefine("whole", loc), scope.redefine("hand", loc)
                body += [
                    ir.Assign(assign.value, tuple_, loc),
                    ir.Assign(ir.Global("hand", hand, loc), function, loc),
                    ir.Assign(ir.Expr.call(function, [tuple_], (), loc), assign.target, loc),
                ]
            else:
                body.append(assign)
        first.body = body
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        PostProcessor(state.func_ir).run()
        return True


WAY_IN = "_ZN7cpython"  # how the name of what takes Python's objects begins


class KernelLibrary(JITCodeLibrary):
    """The code of a kernel, optimised once: numba does so for each function alone, and twice for all."""

    def __init__(self, codegen, name):
        CodeLibrary.__init__(self, codegen, name)
        self._linking_libraries, self._final_module = [], None

    def add_ir_module(self, ir_module):
        """Take in what a function was lowered to, or the way into it from Python."""
        module = parse_assembly(normalize_ir_text(str(ir_module)))
        if self._final_module is None:
            self._final_module = module
        else:
            self._final_module.link_in(module)

    def finalize(self):
        """Join all parts, and what they are joined with, each once; optimise; make machine code."""
        for library in self._linking_libraries:  # it grows meanwhile
            for other in library._linking_libraries if isinstance(library, PartLibrary) else ():
                if other not in self._linking_libraries:
                    self._linking_libraries.append(other)
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        for function in self._final_module.functions:
            if function.name.startswith(WAY_IN) and not function.is_declaration:
                function.add_function_attribute("noinline")
                function.add_function_attribute("optnone")  # it is long, and run once a call
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)
        self._finalize_final_module()

    def serialize_using_object_code(self):
        """What is kept: machine code and the names in it, without the text that it was made from."""
        names = [function.name for function in self.get_defined_functions()]
        stubs = "".join(f'define void @"{name}"() {{ ret void }}\n' for name in names)
        return self.name, "object", (self._get_compiled_object(), parse_assembly(stubs).as_bitcode())


class PartLibrary(KernelLibrary):
    """The code of a function that only kernels call: joined with them as it is, and never run by itself."""

    def finalize(self):
        """No more is to come."""
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"  # it may be left out of a kernel where it has been inlined
        self._finalized = True

    def _get_module_for_linking(self):
        return self._final_module


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):
    """Lowering of a function that only kernels call, into a library that makes no machine code."""

    _name = "part_lowering"

    def run_pass(self, state):
        """Lower the function in hand, and tell numba where calls of it lead: true, it has changed."""
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        lowered, name = state["cr"], state.func_id.func_name
        entry = _dynfunc.make_function(state.func_id.module, name, "", 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(entry, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=entry)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    """Lowering of a kernel; what is joined with it finds its environment, from which numba raises."""

    _name = "kernel_lowering"

    def run_pass(self, state):
        """Lower the function in hand: true, it has changed."""
        state.library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        super().run_pass(state)
        for variable in state.library._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                state.library.codegen.set_env(variable.name, environment)
        return True


class Passes(PassManager):
    """Passes in their order, without numba's clocks, events and looks whether each kept its rules."""

    def run(self, state):
        """Run all on the function in hand."""
        for kind, _ in self.passes:
            one, changes_blocks, _ = _pass_registry.get(kind)
            one.analysis = self._analysis
            changed = one.run_pass(state)
            if changes_blocks and not isinstance(one, LoweringPass):
                if changed:
                    PostProcessor(state.func_ir).run()
                else:
                    state.func_ir.blocks = canonicalize_cfg(state.func_ir.blocks)


@cache
def passes_of(lowering, owned: bool) -> Passes:
    """The passes of a kernel: of numba's own those that a kernel needs, and those above.

    owned : whether it makes arrays, whose owners are counted; else nothing has to be let go of
    """
    found = Passes("kernel")
    for one in (
        *(TranslateByteCode, FixupArgs, IRProcessing, AbsentFields, HandedArguments),
        *(RewriteSemanticConstants, DeadBranchPrune, GenericRewrites, ReconstructSSA, DeadBranchPrune),
        *(NopythonTypeInference, PreLowerStripPhis),
        *((InlineOverloads, NopythonRewrites, IRLegalization) if owned else ()),
        *(lowering, NoPythonBackend),
    ):
        found.add_pass(one, one.__name__)
    found.finalize()
    return found


class Pipeline(CompilerBase):
    """How a kernel is compiled."""

    def is_part(self):
        """Whether it is a function that only kernels call, joined with them."""
        return self.state.flags.no_cpython_wrapper

    def define_pipelines(self):
        """The passes, in the one way that there is."""
        return [passes_of(PartLowering if self.is_part() else KernelLowering, self.state.flags.nrt)]


class ApartPipeline(Pipeline):
    """For a kernel that others call by its address."""

    def is_part(self):
        """It has code of its own."""
        return False
