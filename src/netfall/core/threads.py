"""Threads that share the loops of kernels on a GPU, where `gpu.kernels` replaces these names; a CPU has one.

The turns of a loop over `each` do not depend on each other.
"""

from typing import Any

from netfall.core.kernels import part_of_kernel

each: Any = range


@part_of_kernel
def meet() -> None:
    """Wait for the other threads."""


@part_of_kernel
def leads() -> bool:
    """Return whether this is the first thread."""
    return True


@part_of_kernel
def total(count: Any, cells: Any) -> Any:
    """Return the sum of the numbers of all threads. cells : (1,) work array"""
    return count


@part_of_kernel
def agree(size: Any, number: Any, cells: Any) -> tuple[Any, Any]:
    """Return the largest size of all threads, and the smallest number that has it. cells : (2,) work array"""
    return size, number
