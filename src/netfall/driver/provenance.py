"""Origin of a result: job, versions, ranks, partition, limits."""

import platform
from typing import Any

import h5py
import mpi4py
import numba
import numpy as np

import netfall
from netfall.driver.problem import Problem
from netfall.driver.reporting.run import form_change_lines, run_notes
from netfall.geometry.areas import has_half_area
from netfall.model.model import Model
from netfall.parallel import partition
from netfall.parallel.mpi import MPI
from netfall.results.h5 import HAS_PARALLEL_HDF5
from netfall.results.writer import text_dataset


def library_text() -> str:
    """Return the MPI library and the kind of HDF5 in use, as text."""
    library = MPI.Get_library_version().split(",")[0].split("\n")[0].strip()
    way = "parallel HDF5 (MPI-IO)" if HAS_PARALLEL_HDF5 else "serial HDF5 (rank 0 gathers and writes)"
    return f"{library}, {way}"


TABLE_COLUMNS = (  # columns of the net that /net lacks or contains in another form
    *("load", "mass", "area", "normal", "section", "modulus", "density", "yield_stress"),
    *("breaking_load", "fracture_strain"),
)


def net_record(model: Model) -> dict[str, np.ndarray]:
    """Return the data that the tables of the net need in addition to /net. Constant columns have one row."""
    net = model.net
    columns = {name: getattr(net, name) for name in TABLE_COLUMNS} | {"spring_rest": model.spring_rest}
    columns["area"] = np.where(has_half_area(net), model.roof.area, net.area)  # in tables none is half
    for name, values in columns.items():
        if ((values == values[:1]) | (np.isnan(values) & np.isnan(values[:1]))).all():
            columns[name] = values[:1]
    rings = model.layout.roofing.faces.rings
    face = np.arange(len(rings)) if rings.face is None else rings.face
    bounds = {"ring_start": rings.start, "ring_corner": rings.corner, "ring_face": face}
    tables = {name: loads.elements for name, loads in model.layout.load_tables.items()}
    lines = {name: values for name, values in tables.items() if values is not None}
    if lines:
        columns |= {"line_load": np.array([*lines.values()]), "line_load_table": text_dataset([*lines])}
    return columns | bounds | {"corners": net.corners}


def provenance_values(problem: Problem) -> dict[str, Any]:
    """Return the attributes and texts of /provenance; complete on rank 0."""
    job, model = problem.job, problem.model
    values = {
        "job": job.text,
        "job_name": job.name,
        "job_folder": str(job.path.parent.resolve()),
        "overrides": "\n".join(job.overrides),
        "job_digest": problem.digest,
        "title": job.title,
        "strain": job.cable.strain_measure,
        **{module.__name__: module.__version__ for module in (netfall, np, numba, mpi4py, h5py)},
        "python": platform.python_version(),
        "hdf5": h5py.version.hdf5_version,
        "mpi": MPI.Get_library_version().split("\n")[0].strip("\x00 "),
        "writing": library_text(),
        "ranks": problem.comm.size,
        "exit_state": "finished",
    }
    if model is None:
        return values
    values |= {
        "partition": model.layout.partition_source,
        "metis_seed": partition.SEED,
        "edge_cut": partition.edge_cut(model.net.elements, model.layout.part),
        "file_digests": "\n".join(content.hex() for content in job.contents),
        "net": net_record(model),
        "notes": "\n".join(run_notes(problem)),
    }
    if problem.form:
        values["form"] = "\n".join(form_change_lines(problem, problem.form))
    if model.added is not None:
        values["added_mass"] = float(model.added.sum())
    if problem.schedule:
        for name, limit in problem.limits.items():
            values |= {f"limit_{name}": limit.dt, f"limit_{name}_element": limit.element}
    return values
