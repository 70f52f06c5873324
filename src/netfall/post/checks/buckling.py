"""Buckling of compressed bars by EN 1993-1-1, 6.3.1: slenderness, reduction by buckling curves, resistance.

lambda = sqrt(N_y / N_cr)                         N_cr = pi^2 E I / L_k^2
phi = (1 + alpha (lambda - 0.2) + lambda^2) / 2
chi = 1 / (phi + sqrt(phi^2 - lambda^2)), at most 1
"""

import h5py
import numpy as np

from netfall.job.keys.groups import group_values
from netfall.results.file import read_job_tables

IMPERFECTION = {"a0": 0.13, "a": 0.21, "b": 0.34, "c": 0.49, "d": 0.76}  # alpha [-]; EN 1993-1-1, table 6.1


def slenderness(yield_force: np.ndarray, euler_load: np.ndarray) -> np.ndarray:
    """Compute the relative slenderness (m,) of bars from their yield force and Euler load (m,) [N]."""
    return np.sqrt(yield_force / euler_load)


def buckling_reduction(slender: np.ndarray, imperfection: np.ndarray) -> np.ndarray:
    """Compute the reduction factor chi (m,) of bars from their relative slenderness (m,).

    imperfection : (m,) imperfection factors alpha of the buckling curves
    """
    phi = 0.5 * (1.0 + imperfection * (slender - 0.2) + slender**2)
    return np.minimum(1.0, 1.0 / (phi + np.sqrt(np.maximum(phi**2 - slender**2, 0.0))))


def bar_columns(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the buckling length, Euler load, slenderness and chi (m,) of the elements.

    nan : the element is no bar with a second moment of area; {} : no element has one.
    Without a yield force only the Euler load is known.
    """
    if "second_moment" not in f["net"]:
        return {}
    N_cr = f["net/euler_load"][:]
    N_y = f["net/yield_force"][:] if "yield_force" in f["net"] else np.full(len(N_cr), np.inf)
    slender = np.where(np.isfinite(N_y), slenderness(N_y, N_cr), np.nan)
    return {
        "buckling_length": np.where(np.isnan(N_cr), np.nan, f["net/buckling_length"][:]),
        "euler_load": N_cr,
        "slenderness": slender,
        "chi": buckling_reduction(slender, imperfections(f)),
    }


def imperfections(f: h5py.File) -> np.ndarray:
    """Return the imperfection factor alpha (m,) of the buckling curve of each element."""
    curves = f["net/buckling_curve_names"].asstr()[:]
    return np.array([IMPERFECTION[name] for name in curves])[f["net/buckling_curve"][:]]


def bar_strengths(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the compressive strengths (m,) [N] of bars, inf: none, as `Check.resistance` takes them.

    Elements of a bending chain have none unless the job gives a buckling_length. The chain buckles as a
    whole, not between its nodes, and statics computes that.
    """
    bars, none = bar_columns(f), np.full(len(f["net/elements"]), np.inf)
    if not bars:
        return {"buckling": none, "euler_load": none}
    yields = f["net/yield_force"][:] if "yield_force" in f["net"] else none
    strengths = {"buckling": bars["chi"] * yields, "euler_load": bars["euler_load"]}
    is_unknown = np.zeros(len(none), bool)
    if "bending" in f["net"]:
        job, names = read_job_tables(f), f["net/group_names"].asstr()[:]
        groups, cable = job.get("group", {}), job.get("cable", {})
        given = [(cable | group_values(groups, name)).get("buckling_length") for name in names]
        has_length = np.array([length is not None for length in given])
        is_unknown = (f["net/bending"][:] == 1) & ~has_length[f["net/group"][:]]
    return {name: np.where(np.isnan(N) | is_unknown, np.inf, N) for name, N in strengths.items()}
