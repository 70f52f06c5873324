"""Translation of CPU kernels for CUDA, so that both compute the same bits from one source.

On the CPU a kernel handles LANES particles in vectors, and records hold its arrays. On a GPU a thread handles
one particle. `translate` compiles a kernel, and all functions that it calls, with numbers instead of vectors.

A CUDA compiler may contract a product and a sum into one operation, which rounds once instead of twice. It
never contracts a product with explicit rounding. A translated kernel therefore calls `product` for each `*`.
"""

from __future__ import annotations  # also in functions that `Translator` compiles: they are not evaluated

import ast
import inspect
import textwrap
import types
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from netfall.core.errors import InputError
from netfall.core.kernels import Routine
from netfall.core.messages import MISSING_PACKAGE
from netfall.core.records import RecordType, register_records
from netfall.gpu import messages


def cuda_module() -> Any:
    """Return `numba.cuda`. Raises InputError if it is not installed, or if there is no device."""
    if find_spec("numba_cuda") is None:
        raise InputError(MISSING_PACKAGE(package="numba-cuda", extra="gpu"))
    cuda: Any = import_module("numba.cuda")
    if not cuda.is_available():
        raise InputError(messages.NO_DEVICE())
    return cuda


@cache
def record_reader(kind: RecordType) -> Any:
    """Return the function of kernels that returns the record of a type at an address.

    Kernels read its fields as on the CPU.
    """
    names = "extending", "datamodel.models", "typing.templates"
    extending, models, templates = (import_module(f"numba.cuda.{name}") for name in names)
    register_records(extending, models.PrimitiveModel, templates.AttributeTemplate)

    def record_at(typing: Any, address: Any) -> Any:
        return kind(address), lambda context, builder, signature, values: values[0]

    return extending.intrinsic(record_at)


SCRATCH = """ScratchOfThread(
    cuda.local.array((3, 1), float64),
    cuda.local.array((1, 1), float64)[:, :0],
    cuda.local.array((2,), float64),
    cuda.local.array((3, 1), float64),
    cuda.local.array((3, 1), float64),
    cuda.local.array((1,), float64),
)"""


class Products(ast.NodeTransformer):
    """Replaces a * b by product(a, b), call(record.routine, (a,)) by routine(a), x.scratch by SCRATCH."""

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Replace the force arrays of a chunk by those of a thread, for one particle."""
        self.generic_visit(node)
        return ast.parse(SCRATCH, mode="eval").body if node.attr == "scratch" else node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Replace a call by address."""
        self.generic_visit(node)
        if not (isinstance(node.func, ast.Name) and node.func.id == "call"):
            return node
        routine, arguments = node.args
        assert isinstance(routine, ast.Attribute) and isinstance(arguments, ast.Tuple)
        return ast.Call(ast.Name(routine.attr, ast.Load()), arguments.elts, [])

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Replace a product."""
        self.generic_visit(node)
        assert not isinstance(node.op, ast.Pow), f"write products: {ast.unparse(node)}"
        if not isinstance(node.op, ast.Mult):
            return node
        return ast.Call(ast.Name("product", ast.Load()), [node.left, node.right], [])

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        """Refuse a kind of product that no translated kernel has."""
        assert not isinstance(node.op, ast.Mult | ast.Pow), f"write a = a * b: {ast.unparse(node)}"
        return self.generic_visit(node)


def source_without_products(function: Any) -> ast.Module:
    """Return the definition of a function without decorators, and with `product` for `*`."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    definition = tree.body[0]
    assert isinstance(definition, ast.FunctionDef)
    definition.decorator_list = []
    renamed: ast.Module = Products().visit(tree)
    ast.increment_lineno(renamed, function.__code__.co_firstlineno - 1)
    return ast.fix_missing_locations(renamed)


class Translator:
    """Compiles CPU kernels for CUDA.

    compiled : decorator of the functions that kernels call
    replacements : functions for CUDA, by the intrinsic or kernel that they replace
    """

    def __init__(self, compiled: Callable[..., Any], replacements: dict[Any, Any], names: dict[str, Any]):
        """names : values of other names in every translated function, such as LANES"""
        self.compiled, self.names = compiled, names
        self._done: dict[Any, Any] = {id(key): value for key, value in replacements.items()}
        self._kept = list(replacements)  # an `id` is unique only while its object exists

    def translate(self, kernel: Any) -> Any:
        """Return a kernel, routine or plain function of the CPU, compiled for calls by kernels."""
        if id(kernel) not in self._done:
            self._kept.append(kernel)
            self._done[id(kernel)] = self.compiled(self.plain(kernel))
        return self._done[id(kernel)]

    def plain(self, kernel: Any) -> Any:
        """Return the Python function of a kernel with calls of `product` and of translated functions."""
        function = kernel.function if isinstance(kernel, Routine) else getattr(kernel, "py_func", kernel)
        visible = dict(function.__globals__)
        for name, cell in zip(function.__code__.co_freevars, function.__closure__ or ()):
            visible[name] = cell.cell_contents
        tree = source_without_products(function)
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        namespace = dict(self.names)
        for name in (used & visible.keys()) - namespace.keys():
            value = visible[name]
            is_function = isinstance(value, types.FunctionType) and value.__module__.startswith("netfall.")
            is_kernel = isinstance(value, Routine) or hasattr(value, "py_func") or is_function
            namespace[name] = self.translate(value) if is_kernel or id(value) in self._done else value
        exec(compile(tree, inspect.getfile(function), "exec"), namespace)
        return namespace[function.__name__]
