"""Compressed bars by EN 1993-1-1, 6.3.1: slenderness, reduction by the buckling curves, resistance.

lambda = sqrt(N_y / N_cr)                         N_cr = pi^2 E I / L_k^2
phi = (1 + alpha (lambda - 0.2) + lambda^2) / 2
chi = 1 / (phi + sqrt(phi^2 - lambda^2)), at most 1
"""

import numpy as np

from netfall.results.file import job_of
from netfall.results.states import MOTION, equilibria

IMPERFECTION = {"a0": 0.13, "a": 0.21, "b": 0.34, "c": 0.49, "d": 0.76}  # alpha, table 6.1


def slenderness(yield_force: np.ndarray, euler_load: np.ndarray) -> np.ndarray:
    """Relative slenderness (m,) of bars of yield force and Euler's load (m,) [N]."""
    return np.sqrt(yield_force / euler_load)


def reduction(slender: np.ndarray, imperfection: np.ndarray) -> np.ndarray:
    """chi (m,) at a relative slenderness (m,), for the imperfection factors (m,) of the curves."""
    phi = 0.5 * (1.0 + imperfection * (slender - 0.2) + slender**2)
    return np.minimum(1.0, 1.0 / (phi + np.sqrt(np.maximum(phi**2 - slender**2, 0.0))))


def bar_columns(f) -> dict[str, np.ndarray]:
    """What buckling of each element goes by, (m,) nan: no bar with a second moment; {} where there is none.

    Without a yield force there is Euler's load alone.
    """
    if "second_moment" not in f["net"]:
        return {}
    N_cr, curves = f["net/euler_load"][:], f["net/buckling_curve_names"].asstr()[:]
    N_y = f["net/yield_force"][:] if "yield_force" in f["net"] else np.full(len(N_cr), np.inf)
    alpha = np.array([IMPERFECTION[name] for name in curves])[f["net/buckling_curve"][:]]
    slender = np.where(np.isfinite(N_y), slenderness(N_y, N_cr), np.nan)
    return {
        "buckling_length": np.where(np.isnan(N_cr), np.nan, f["net/buckling_length"][:]),
        "euler_load": N_cr,
        "slenderness": slender,
        "chi": reduction(slender, alpha),
    }


def moment_columns(f) -> dict[str, np.ndarray]:
    """The largest bending moment [N m] of each element (m,), nan: none, and its state; {}: nothing bends."""
    found = [(state.name, state.moment().max(axis=1)) for state in equilibria(f) if state.moment]
    if "envelope/bending_moment_max" in f:
        found.append((MOTION, f["envelope/bending_moment_max"][:]))
    if not found:
        return {}
    names, each = np.array([name for name, _ in found], object), np.array([moment for _, moment in found])
    most = np.fmax.reduce(each)
    at = np.argmax(np.nan_to_num(each, nan=-1.0), axis=0)
    return {"bending_moment_max": most, "case_moment": np.where(np.isnan(most), "", names[at])}


def strengths_of_bars(f) -> dict[str, np.ndarray]:
    """Strengths (m,) [N] against compression, inf: none, as `Check.resistance` takes them.

    The parts of a chain that bends have none without a buckling_length in the job: the chain does not buckle
    between its nodes but as a whole, which statics computes.
    """
    bars, none = bar_columns(f), np.full(len(f["net/elements"]), np.inf)
    if not bars:
        return {"buckling": none, "euler_load": none}
    parts = parts_of_chains(f)
    known = lambda strength: np.where(np.isnan(strength) | parts, np.inf, strength)
    yields = f["net/yield_force"][:] if "yield_force" in f["net"] else none
    return {"buckling": known(bars["chi"] * yields), "euler_load": known(bars["euler_load"])}


def parts_of_chains(f) -> np.ndarray:
    """Bars (m,) of chains that bend whose job gives them no buckling_length."""
    if "bending" not in f["net"]:
        return np.zeros(len(f["net/elements"]), bool)
    cable, names = job_of(f).get("cable", {}), f["net/group_names"].asstr()[:]
    length = [{**cable, **cable.get(name, {})}.get("buckling_length") for name in names]
    given = np.array([each is not None for each in length])
    return (f["net/bending"][:] == 1) & ~given[f["net/group"][:]]
