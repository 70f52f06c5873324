"""Study files with known properties: a small net, random capacities, and their results."""

import h5py
import numpy as np

from netfall.results.file import STUDY_ATTRIBUTE
from netfall.study.answers.info import print_study
from netfall.study.table import FORMAT

TEXT = h5py.string_dtype("utf-8")


def net():
    """Return /net of a square lattice of nodes, 10 m apart, held at its edge; ids start at 101 and 1001."""
    n = 7
    x, y = np.meshgrid(10.0 * np.arange(n), 10.0 * np.arange(n), indexing="ij")
    number = np.arange(n * n).reshape(n, n)
    pairs = [(number[:-1], number[1:]), (number[:, :-1], number[:, 1:])]
    elements = np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs])
    edge = (np.minimum(x, y) == 0) | (np.maximum(x, y) == x.max())
    elements = elements[~edge.ravel()[elements].all(1)]
    return {
        "particles": np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], 1),
        "elements": elements,
        "element_id": 1001 + np.arange(len(elements)),
        "node_id": 101 + np.arange(n * n),
        "fixed": np.repeat(edge.ravel()[:, None], 3, axis=1),
        "group": (elements[:, 1] - elements[:, 0] == 1).astype(int),
        "tributary_area": np.where(edge.ravel(), 25.0, 100.0),
    }


def columns(inputs: dict, failed: np.ndarray, severity: np.ndarray, **changed) -> dict:
    """Return columns of /samples: inputs, and results of failed runs (N,) by `severity` (N,), 0 to 1."""
    n = len(failed)
    value = lambda x: np.where(failed, x, np.nan)
    result = {
        "first_fracture": value(5.0 - 4.0 * severity),
        "first_element": np.where(failed, 7, -1),
        "first_element_id": np.where(failed, 1008, -1),
        "broken": np.where(failed, 1 + (30 * severity).astype(int), 0),
        "detached_area": np.where(failed, np.clip(1.2 * severity - 0.1, 0.0, 1.0), 0.0),
        "displacement_max": 0.2 + severity,
        "tension_max": 1e5 * (1.0 + severity),
        "utilisation_max": 0.5 + severity,
        "utilisation_before_break": np.where(failed, 1.01, 0.9),
        "energy_balance_error": np.full(n, 1e-4),
        "balance_error_attached": np.full(n, 1e-4),
        "duration": np.full(n, 6.0),
        "seconds": np.full(n, 0.5),
        "state": np.full(n, "finished", object),
        "reason": np.full(n, "", object),
    }
    return inputs | result | changed


def events_of(samples: dict, elements: int) -> dict:
    """Return /events of the samples: a first fracture and others at random times."""
    generator, rows = np.random.default_rng(1), []
    for k in np.flatnonzero(samples["broken"] > 0):
        others = np.setdiff1d(np.arange(elements), samples["first_element"][k])
        more = generator.choice(others, samples["broken"][k] - 1, replace=False)
        later = samples["first_fracture"][k] + np.sort(generator.exponential(0.4, len(more)))
        rows += [(k, samples["first_fracture"][k], samples["first_element"][k])]
        rows += [(k, t, e) for t, e in zip(later, more)]
    sample, time, element = zip(*rows) if rows else ((), (), ())
    return {"sample": np.array(sample, int), "time": np.array(time, float), "element": np.array(element, int)}


def write_study(
    path, samples: dict, section: dict, roof: dict | None = None, title="a roof", hazard: dict | None = None
) -> None:
    """Write a study file with these columns and the data of /fragility and /hazard."""
    roof = roof or net()
    m = len(roof["elements"])
    events = events_of(samples, m)
    ran = samples["state"] == "finished"
    broke = np.unique(np.stack([events["sample"], events["element"]], 1), axis=0)
    first = samples["first_element"][ran & (samples["broken"] > 0)]
    with h5py.File(path, "w") as file:
        file.attrs[STUDY_ATTRIBUTE], file.attrs["title"] = FORMAT, title
        groups = {"samples": samples, "events": events, "net": roof, "fragility": section, "hazard": hazard}
        for group, data in groups.items():
            for name, values in (data or {}).items():
                text = isinstance(values, np.ndarray) and values.dtype.kind in "OU"
                file[f"{group}/{name}"] = values.astype(TEXT) if text else values
        file["first_breaks"] = np.bincount(first, minlength=m)
        file["breaks"] = np.bincount(broke[ran[broke[:, 0]], 1], minlength=m)
        file.create_group("provenance").attrs["study"] = 'job = "roof.toml"\n'


def drawn_samples(generator, seeds: int, speeds, median: float, dispersion: float, shared=True) -> dict:
    """Return seeds at each speed with lognormal capacities, for each seed or each run."""
    speed = np.repeat(np.array(speeds, float), seeds)
    seed = np.tile(np.arange(1, seeds + 1), len(speeds)) if shared else np.arange(1, len(speed) + 1)
    capacity = median * np.exp(dispersion * generator.standard_normal(seed.max()))[seed - 1]
    severity = np.clip(2.5 * (speed / capacity - 1.0), 0.0, 1.0)
    return columns({"wind.speed": speed, "wind.seed": seed}, speed > capacity, severity)


def study_lines(path) -> str:
    """Return the output of `netfall info` on a study file."""
    lines = []
    print_study(path, lines.append)
    return "\n".join(lines)
