"""What `netfall info` tells of a result file."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from netfall.errors import InputError

FIRST_EVENTS = 8
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
        f"note: the physical balance is off by up to {np.abs(balance).max():.1%} of the energy that took part, "
        f"by more than {LARGEST_BALANCE:.0%} from t = {time[off[0]]:.4g} s on: the step is too long for some of "
        f"what happened; compare with a run of half the step (a smaller {smaller})"
    ]


def print_info(path: Path, say: Callable[[str], None]) -> None:
    """Print a summary of a result file."""
    with open_result(path) as f:
        p = f["provenance"].attrs
        n, m = len(f["net/particles"]), len(f["net/elements"])
        say(f"{path}: {title_of(f)}")
        say(
            f"ran: netfall {p['netfall']} on {p['ranks']} rank{'s' if p['ranks'] > 1 else ''} ({p['writing']}); {p['exit_state']}"
        )
        overrides = provenance_text(f, "overrides")
        if overrides:
            say("with: " + ", ".join(overrides.split("\n")))
        fixed = f["net/fixed"][:].all(1).sum()
        say(
            f"net: {n} particles ({fixed} fixed), {m} elements, roof {f['net/tributary_area'][:].sum():.1f} m2; partition {p['partition']}, {p['edge_cut']} elements cut"
        )
        if "form_finding" in f:
            g = f["form_finding"]
            say(
                f"form finding: {g['iterations'][()]} iterations, residual {g['residual'][()]:.2g} of the prestress, with the real material "
                f"{g['residual_real_material'][()]:.2g}; tensions {g['tension'][:].min():.4g} to {g['tension'][:].max():.4g} N"
            )
        if "statics" in f:
            g = f["statics"]
            largest = np.linalg.norm(g["displacement"][-1], axis=1)
            say(
                f"statics: {len(g['load_factor'])} load steps; largest displacement {largest.max():.4g} m (particle {largest.argmax()}), "
                f"tensions {g['tension'][-1].min():.4g} to {g['tension'][-1].max():.4g} N, slack {g['slack'][-1]}, largest residual {g['residual'][:].max():.2g} N"
            )
        if "history" in f:
            _dynamics(f, say)
        seconds = f["provenance/timings"].attrs
        say("time: " + ", ".join(f"{name} {np.max(seconds[name]):.2f} s" for name in seconds))


def _dynamics(f, say):
    h, p = f["history"], f["provenance"].attrs
    say(
        f"dynamics: {h['time'][-1]:g} s in {p['steps']} steps of {p['time_step']:.4g} s; {len(f['VTKHDF/Steps/Values'])} frames, {len(h['time'])} history rows"
    )
    if "added_mass" in p:
        say(f"  mass scaling: {p['added_mass']:.4g} kg of inertia added")
    for name in [k[6:] for k in p if k.startswith("limit_") and not k.endswith("_element")]:
        say(
            f"  step limit {name.replace('_', ' ')}: {p['limit_' + name]:.4g} s (element {p[f'limit_{name}_element']})"
        )
    if "wind" in f:
        u = f["wind/speed"][:]
        say(
            f"wind: mean {f['wind/mean_speed'][:].mean():.1f} m/s, generated {u.min():.1f} to {u.max():.1f} m/s at {u.shape[1]} control points"
        )
    say(
        "energy at the end [J]: "
        + ", ".join(
            f"{name.replace('_', ' ')} {h[name][-1]:.4g}"
            for name in (
                "external_work",
                "kinetic_energy",
                "strain_energy",
                "plastic_dissipation",
                "damping_work",
            )
        )
    )
    say(
        f"audits: work identity to {np.abs(h['identity_error'][:]).max():.1e}, physical balance to {np.abs(h['balance_error'][:]).max():.1e} of the energy that took part"
    )
    for note in balance_notes(h["time"][:], h["balance_error"][:], h["broken"][:]):
        say(note)
    e = f["events"]
    say(f"slack at the end: {h['slack'][-1]} cables; broken: {h['broken'][-1]} elements")
    ids = f["net/element_id"][:]
    for k in range(min(FIRST_EVENTS, len(e["time"]))):
        new = e["new_particle"][k]
        what = (
            f"from particle {e['particle'][k]} (new particle {new})"
            if new >= 0
            else f"at particle {e['particle'][k]}, nothing split"
        )
        number = e["element"][k]
        name = f"{number}" if ids[number] == number else f"{number} (id {ids[number]})"
        say(
            f"  t = {e['time'][k]:.5f} s, step {e['step'][k]}: element {name} {what}, strain {e['strain'][k]:.4f}"
        )
    if len(e["time"]) > FIRST_EVENTS:
        say(f"  and {len(e['time']) - FIRST_EVENTS} more fracture events in /events")
