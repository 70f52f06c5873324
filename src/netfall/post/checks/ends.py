"""Axial forces at the ends of the elements of a result, for checks."""

from collections.abc import Callable
from types import SimpleNamespace

import h5py
import numpy as np

from netfall.geometry.net import GRAVITY
from netfall.job.validate import Validator
from netfall.loads import start_weights
from netfall.results.file import read_job_tables


def end_weights(f: h5py.File) -> Callable[[str, np.ndarray, float], np.ndarray]:
    """Return a function for what the larger force of an element's ends exceeds N by, (m,) [N]."""
    at_start = start_weights_of(f)
    return lambda place, x, live: np.abs(at_start(place, x, live))


def start_weights_of(f: h5py.File) -> Callable[[str, np.ndarray, float], np.ndarray]:
    """Return the function of `loads.start_weights` for a result."""
    record, line_loads = f["provenance/net"], {}
    if "line_load" in record:
        line_loads = dict(zip(record["line_load_table"].asstr()[:].tolist(), record["line_load"][:]))
    L0 = f["net/unstressed_length"][:]
    _, element, parts = np.unique(f["net/element_id"][:], return_inverse=True, return_counts=True)
    return start_weights.start_weights(
        SimpleNamespace(**Validator("", []).sections(read_job_tables(f))),
        f["net/elements"][:],
        L0,
        L0 * np.where(f["net/bar"][:] == 1, parts[element], 1),
        GRAVITY * f["net/mass_per_length"][:],
        f["net/diameter"][:] if "diameter" in f["net"] else None,
        line_loads,
    )
