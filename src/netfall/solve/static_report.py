"""What is told of equilibria."""

import numpy as np

from netfall.solve.equilibrium import STABLE, UNKNOWN
from netfall.solve.statics import StaticPath


def static_lines(path: StaticPath, elements: int, words: str, node_id: np.ndarray | None) -> list[str]:
    """What the static stage found.

    words : for the rest that dynamics begins in; node_id : (n,) on rank 0, which alone prints
    """
    found = [(f"case {name}", numbers) for name, numbers in path.cases.items()]
    if path.steps:
        found.append(("statics", path.steps[-1]))
    if path.rest:
        found.append((words, path.rest))
    lines = [f"{what}: {_settled(numbers, elements)}" for what, numbers in found]
    if node_id is None:
        return lines
    falls = [(f"statics, load factor {step['load_factor']:.4g}", step["falls"]) for step in path.steps[:-1]]
    falls += [(what, numbers["falls"]) for what, numbers in found]
    return lines + [_unstable(what, p, node_id) for what, p in falls if p != STABLE]


def _unstable(what: str, p: int, node_id: np.ndarray) -> str:
    if p == UNKNOWN:
        return f"note: {what}: whether compressed bars stay there could not be told"
    node = node_id[p]
    return (
        f"note: {what}: NOT STABLE: compressed bars have no hold, the slightest push moves node {node} most; "
        "the net does not stay where this was found: hold the bars, or tension the net more"
    )


def _settled(numbers: dict, elements: int) -> str:
    return (
        f"in equilibrium {error_words(numbers['displacement_error'], numbers['tension_error'])}"
        f"{', by relaxation' if numbers['relaxed'] else ''}, residual {numbers['residual']:.3g} N, "
        f"slack {numbers['slack']} of {elements}"
    )


def error_words(moved: float, tension: float) -> str:
    """Estimated errors in words, nan: not known."""
    return (
        f"to {moved:.0e} of displacements, {tension:.0e} of tensions"
        if moved == moved
        else "(error not known)"
    )
