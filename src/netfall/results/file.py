"""A result file, open for reading: what it is, its title, the names in it."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError
from netfall.job.job import tables_of
from netfall.mechanics.law.limits import strength_of
from netfall.numerics.functions import lengths
from netfall.results.losses import broken_at
from netfall.results.overload_lines import Carried, overload_lines
from netfall.results.states import start_position

OF_MOTION = ("events", "envelope", "final")  # groups beside /history


def open_result(path: Path) -> h5py.File:
    """A result file of netfall, open for reading. Raises InputError for anything else."""
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        reason = f"not an HDF5 file ({str(error).split('(')[-1].rstrip(')')})"
        if path.is_dir() or not path.exists():
            reason = "is a folder" if path.is_dir() else "no such file"
        raise InputError(f"{path}: {reason}; expected a result file of netfall") from None
    if "provenance" not in file or "net" not in file:
        file.close()
        raise InputError(f"{path}: an HDF5 file, but not a result of netfall (no /provenance, /net)")
    if "netfall_study" in file.attrs:
        file.close()
        raise InputError(f"{path}: a study file, for netfall info and plot; expected the result of one run")
    for name in ("VTKHDF", *OF_MOTION * ("history" in file)):
        if name not in file:
            file.close()
            raise _lacks(path, name)
    return file


def provenance_text(file: h5py.File, name: str) -> str:
    """A text of /provenance: an attribute, or a dataset if it is long."""
    group = file["provenance"]
    return group[name].asstr()[()] if name in group else str(group.attrs[name])


def job_of(file: h5py.File) -> dict:
    """The tables of the job that was run, with the overrides of its run."""
    return tables_of(provenance_text(file, "job"), provenance_text(file, "overrides").splitlines())


def notes_of_run(file: h5py.File) -> list[str]:
    """What the run told to be odd in its job before it began."""
    return provenance_text(file, "notes").splitlines()


def title_of(file: h5py.File) -> str:
    """The job's title, else its name."""
    return provenance_text(file, "title") or provenance_text(file, "job_name")


@contextmanager
def telling_what_lacks(path: Path) -> Iterator[None]:
    """Raises InputError where h5py does not find in a result file what is read of it."""
    try:
        yield
    except KeyError as error:
        quoted = re.search(r"(?:object|attribute:) '([^']+)'", str(error.args[0]))
        raise _lacks(path, quoted[1] if quoted else "a group") from None


def _lacks(path: Path, name: str) -> InputError:
    return InputError(
        f"{path}: {name} is not in this file, which another version of netfall wrote; run the job again"
    )


@contextmanager
def reading(path: Path) -> Iterator[h5py.File]:
    """`open_result`, and what the file lacks told in its one way."""
    with open_result(path) as file, telling_what_lacks(path):
        yield file


def element_name(f: h5py.File, e: int) -> str:
    """An element by its id, with the ids of its nodes: those that share a cable's id differ in these."""
    a, b = (f["net/node_id"][p] for p in f["net/elements"][e])
    return f"{f['net/element_id'][e]} ({a}-{b})"


def lines_of_form(f: h5py.File) -> list[str]:
    """What form finding did to the geometry that was given, or its states of self-stress, as the run told."""
    return provenance_text(f, "form").splitlines()


def carried_in(f: h5py.File) -> Carried:
    """What the elements of a result carried in its dynamic stage."""
    net, envelope, drawn = f["net"], f["envelope"], f["net"].get("strength")
    EA, ends = net["axial_stiffness"][:], net["elements"][:]
    none, factor = np.full(len(EA), np.inf), 1.0 if drawn is None else drawn[:]
    given = [factor * net[name][:] if name in net else none for name in ("fracture_strain", "yield_force")]
    x = start_position(f)
    along = x[ends[:, 1]] - x[ends[:, 0]]
    return Carried(
        ends,
        along / lengths(along)[:, None],
        strength_of(EA, *given),
        envelope["tension_max"][:],
        envelope["tension_max_time"][:],
        broken_at(f),
    )


def overloads_of(f: h5py.File) -> list[str]:
    """`overload_lines` of a result file."""
    return overload_lines(carried_in(f), lambda e: element_name(f, e))
