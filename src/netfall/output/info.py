"""What `netfall info` tells of a result file."""

import re
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from netfall.errors import InputError
from netfall.functions import lengths
from netfall.output.form_lines import form_lines
from netfall.output.loss_lines import loss_lines
from netfall.output.overload_lines import Carried, overload_lines, strength_of

FIRST_EVENTS = 8
ENERGIES = ("external_work", "kinetic_energy", "strain_energy", "plastic_dissipation", "damping_work")
LARGEST_BALANCE = 0.01  # error of the physical balance above which a result is doubtful


def open_result(path: Path) -> h5py.File:
    """A result file of netfall, open for reading. Raises InputError for anything else."""
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        reason = (
            "no such file"
            if not path.exists()
            else "is a folder"
            if path.is_dir()
            else f"not an HDF5 file ({str(error).split('(')[-1].rstrip(')')})"
        )
        raise InputError(f"{path}: {reason}; expected a result file of netfall") from None
    if "provenance" not in file or "net" not in file:
        file.close()
        raise InputError(f"{path}: an HDF5 file, but not a result of netfall (no /provenance, /net)")
    if "netfall_study" in file.attrs:
        file.close()
        raise InputError(f"{path}: a study file, for netfall info and plot; expected the result of one run")
    return file


def provenance_text(file: h5py.File, name: str) -> str:
    """A text of /provenance: an attribute, or a dataset if it is long."""
    group = file["provenance"]
    return group[name].asstr()[()] if name in group else str(group.attrs[name])


def title_of(file: h5py.File) -> str:
    """The job's title, else its name."""
    return provenance_text(file, "title") or provenance_text(file, "job_name")


def balance_notes(time: np.ndarray, balance: np.ndarray, broken: np.ndarray) -> list[str]:
    """A note if the physical balance of any row (t,) of the history is off by more than LARGEST_BALANCE."""
    off = np.flatnonzero(np.abs(balance) > LARGEST_BALANCE)
    if not len(off):
        return []
    smaller = "[dynamics] safety or time_step" + (", or fragment_mass" if broken[-1] else "")
    return [
        f"note: the physical balance is off by up to {np.abs(balance).max():.1%} of the energy that took "
        f"part, by more than {LARGEST_BALANCE:.0%} from t = {time[off[0]]:.4g} s on: the step is too long "
        f"for some of what happened; compare with a run of half the step (a smaller {smaller})"
    ]


def print_info(path: Path, say: Callable[[str], None]) -> None:
    """Print a summary of a result file. Elements and nodes are named by the ids of the tables."""
    with open_result(path) as f:
        say(f"{path}: {_or_missing(title_of, f)}")
        parts = {
            "run": (_run, True),
            "form finding": (_form, "form_finding" in f),
            "statics": (_statics, "statics" in f),
            "stability": (_stability, True),
            "dynamics": (_dynamics, "history" in f),
            "wind": (_wind, "wind" in f),
            "losses": (_losses, "removal" in f),
            "energies": (_energies, "history" in f),
            "fractures": (_fractures, "history" in f),
            "tensions": (_overloads, "events" in f and "envelope" in f),
            "time": (_seconds, True),
        }
        for name, (tell, there) in parts.items():
            if there:
                missing = _or_missing(tell, f, say)
                if missing:
                    say(f"{name}: {missing}")


def _or_missing(tell: Callable, *arguments):
    """What `tell` gives; where the file lacks what it reads, as one of another version may, that in words."""
    try:
        return tell(*arguments)
    except KeyError as error:
        return f"{missing_name(error)} is not in this file, which another version of netfall wrote"


def missing_name(error: KeyError) -> str:
    """What a file was found to lack."""
    quoted = re.search(r"'([^']+)'", str(error.args[0]))
    return quoted[1] if quoted else "a group"


def _seconds(f, say):
    seconds = f["provenance/timings"].attrs
    say("time: " + ", ".join(f"{name} {np.max(seconds[name]):.2f} s" for name in seconds))


def element_name(f: h5py.File, e: int) -> str:
    """An element by its id, with the ids of its nodes: those that share a cable's id differ in these."""
    a, b = (f["net/node_id"][p] for p in f["net/elements"][e])
    return f"{f['net/element_id'][e]} ({a}-{b})"


def _run(f, say):
    p = f["provenance"].attrs
    ranks = f"{p['ranks']} rank{'s' if p['ranks'] > 1 else ''}"
    say(f"ran: netfall {p['netfall']} on {ranks} ({p['writing']}); {p['exit_state']}")
    overrides = provenance_text(f, "overrides")
    if overrides:
        say("with: " + ", ".join(overrides.split("\n")))
    n, m, fixed = len(f["net/particles"]), len(f["net/elements"]), f["net/fixed"][:].all(1).sum()
    say(
        f"net: {n} particles ({fixed} fixed), {m} elements, roof {f['net/tributary_area'][:].sum():.1f} m2; "
        f"partition {p['partition']}, {p['edge_cut']} elements cut"
    )


def _form(f, say):
    g = f["form_finding"]
    N = g["tension"][:]
    say(
        f"form finding: {g['iterations'][()]} iterations, residual {g['residual'][()]:.2g} of the prestress, "
        f"with the real material {g['residual_real_material'][()]:.2g}; "
        f"tensions {N.min():.4g} to {N.max():.4g} N"
    )
    for line in lines_of_form(f):
        say(line)


def lines_of_form(f: h5py.File) -> list[str]:
    """`form_lines` of a result file."""
    net = f["net"]
    given = f["provenance"].attrs.get("roof_area_given", 0.0)  # older versions do not tell
    return form_lines(
        net["particles"][:],
        f["form_finding/position"][:],
        ~net["fixed"][:].astype(bool).all(1),
        net["node_id"][:],
        float(given),
        float(net["tributary_area"][:].sum()),
    )


def _statics(f, say):
    g = f["statics"]
    N, moved = g["tension"][-1], np.linalg.norm(g["displacement"][-1], axis=1)
    steps = int((g["load_factor"][:] > 0).sum())
    say(
        f"statics: {steps} load steps; largest displacement {moved.max():.4g} m "
        f"(node {f['net/node_id'][moved.argmax()]}), tensions {N.min():.4g} to {N.max():.4g} N, "
        f"slack {g['slack'][-1]}, largest residual {g['residual'][:].max():.2g} N"
    )


def _stability(f, say):
    """Name the equilibria that are not stable; results of older versions do not tell."""
    places = ["statics", "rest", *(f"cases/{name}" for name in f.get("cases", ()))]
    for place in places:
        if place in f and "stable" in f[place] and not np.all(f[place]["stable"][()]):
            say(f"note: an equilibrium of /{place} is NOT STABLE: compressed bars have no hold")


def _dynamics(f, say):
    h, p = f["history"], f["provenance"].attrs
    say(
        f"dynamics: {h['time'][-1]:g} s in {p['steps']} steps of {p['time_step']:.4g} s; "
        f"{len(f['VTKHDF/Steps/Values'])} frames, {len(h['time'])} history rows"
    )
    if "added_mass" in p:
        say(f"  mass scaling: {p['added_mass']:.4g} kg of inertia added")
    for name in [k[6:] for k in p if k.startswith("limit_") and not k.endswith("_element")]:
        e = p[f"limit_{name}_element"]
        element = f" (element {element_name(f, e)})" if e >= 0 else ""
        say(f"  step limit {name.replace('_', ' ')}: {p['limit_' + name]:.4g} s{element}")


def _wind(f, say):
    if "wind/pressure" in f:
        p = f["wind/pressure"][:]
        say(f"wind: pressures of {p.min():.4g} to {p.max():.4g} N/m2 at {p.shape[1]} taps")
        return
    u, mean = f["wind/speed"][:], f["wind/mean_speed"][:].mean()
    of = f"{u.min():.1f} to {u.max():.1f} m/s at {u.shape[1]} control points"
    say(f"wind: mean {mean:.1f} m/s, generated {of}")


def _losses(f, say):
    for line in loss_lines(f["removal"], f["events"], f["net/element_id"][:]):
        say(line)


def _energies(f, say):
    h = f["history"]
    known = [name for name in ENERGIES if np.isfinite(h[name][-1])]
    at_end = [f"{name.replace('_', ' ')} {h[name][-1]:.4g}" for name in known]
    say("energy at the end [J]: " + ", ".join(at_end))
    if len(known) < len(ENERGIES):
        say("audits: none, the job has [output] energy = false")
        return
    identity, balance = (np.abs(h[name][:]).max() for name in ("identity_error", "balance_error"))
    say(
        f"audits: work identity to {identity:.1e}, physical balance to {balance:.1e} "
        "of the energy that took part"
    )
    for note in balance_notes(h["time"][:], h["balance_error"][:], h["broken"][:]):
        say(note)


def carried_in(f: h5py.File) -> Carried:
    """What the elements of a result carried in its dynamic stage."""
    net, envelope, drawn = f["net"], f["envelope"], f["net"].get("strength")
    EA, ends = net["axial_stiffness"][:], net["elements"][:]
    none, factor = np.full(len(EA), np.inf), 1.0 if drawn is None else drawn[:]
    given = [factor * net[name][:] if name in net else none for name in ("fracture_strain", "yield_force")]
    x = f["form_finding/position"][:] if "form_finding" in f else net["particles"][:]
    along = x[ends[:, 1]] - x[ends[:, 0]]
    broke = np.full(len(EA), np.nan)
    broke[f["events/element"][:][::-1]] = f["events/time"][:][::-1]  # of two ends the first
    return Carried(
        ends,
        along / lengths(along)[:, None],
        strength_of(EA, *given),
        envelope["tension_max"][:],
        envelope["tension_max_time"][:],
        broke,
    )


def overloads_of(f: h5py.File) -> list[str]:
    """`overload_lines` of a result file."""
    return overload_lines(carried_in(f), lambda e: element_name(f, e))


def _overloads(f, say):
    for line in overloads_of(f):
        say(line)


def _fractures(f, say):
    h = f["history"]
    say(f"slack at the end: {h['slack'][-1]} cables; broken: {h['broken'][-1]} elements")
    e, ids = f["events"], f["net/node_id"][:]
    nodes = (
        e["node_id"][:] if "node_id" in e else ids[np.minimum(e["particle"][:], len(ids) - 1)]
    )  # older files
    for k in range(min(FIRST_EVENTS, len(e["time"]))):
        split = "" if e["new_particle"][k] >= 0 else ", nothing split"
        say(
            f"  t = {e['time'][k]:.5f} s, step {e['step'][k]}: element {element_name(f, e['element'][k])} "
            f"at node {nodes[k]}{split}, strain {e['strain'][k]:.4f}"
        )
    if len(e["time"]) > FIRST_EVENTS:
        say(f"  and {len(e['time']) - FIRST_EVENTS} more fracture events in /events")
