"""Command `netfall info`: summary of a result file, as text or as JSON for other programs."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.core.messages import count_of, kN, kN_m2, mm, say_counted
from netfall.core.text import json_text
from netfall.geometry.areas import outer_side_line
from netfall.post import messages
from netfall.results import file, states, text, warning_text
from netfall.results.datasets import find_group
from netfall.results.removals import fracture_times, removal_times


def print_info_json(path: Path, say: Callable[[str], None]) -> None:
    """Print the summary of a result file as JSON, in SI units. Raises InputError for a wrong file."""
    with file.open_checked(path) as f:
        say(json_text(info_of_result(f)))


def info_of_result(f: h5py.File) -> dict[str, Any]:
    """Return the summary of a result file: run, net, form, equilibria, dynamics, fractures, messages."""
    provenance = f["provenance"].attrs
    info: dict[str, Any] = {
        "file": Path(f.filename).name,
        "title": file.result_title(f),
        "netfall": provenance["netfall"],
        "exit_state": provenance["exit_state"],
        "ranks": provenance["ranks"],
        "overrides": file.provenance_text(f, "overrides").splitlines(),
        "particles": len(f["net/particles"]),
        "elements": len(f["net/elements"]),
        "roof_area": f["net/tributary_area"][:].sum(),
        "warnings": file.warnings_of_run(f),
        "notes": file.notes_of_run(f),
        "equilibria": {path: equilibrium_summary(f, path) for path in states.equilibrium_groups(f)},
        "seconds": {name: np.max(value) for name, value in f["provenance/timings"].attrs.items()},
    }
    if "form_finding" in f:
        g = f["form_finding"]
        info["form_finding"] = {
            "iterations": g["iterations"][()],
            "residual": g["residual"][()],
            "equilibrium": not states.no_equilibrium(g),
            **_range(g["tension"][:]),
        }
    if "history" in f:
        h, events = f["history"], f["events"]
        columns_over_time = [each.name for each in find_group("history").datasets if each.shape == "t"]
        at_end = {name: h[name][-1] for name in columns_over_time if name in h}
        errors = {f"{name}_max": np.abs(h[name][:]).max() for name in h if name.endswith("_error")}
        steps = {"steps": provenance["steps"], "time_step": provenance["time_step"]}
        columns = {name: events[name][:] for name in ("time", "step", "strain", "node_id")}
        columns["element"] = f["net/element_id"][:][events["element"][:]]
        info["dynamics"] = steps | {"at_end": at_end} | errors
        info["fractures"] = [dict(zip(columns, row)) for row in zip(*columns.values())]
    return info


def equilibrium_summary(f: h5py.File, path: str) -> dict[str, Any]:
    """Return the last equilibrium of a group."""
    x = states.form_position(f) if path.startswith("stages/") else states.start_position(f)
    g, last = f[path], list(states.group_equilibria(f, path))[-1]
    displacement, N, is_absent = lengths(last.position() - x), last.tension(), states.absent(f, path)
    return {
        "title": states.group_title(f, path),
        "state": g.attrs["state"],
        "load_factor": g.attrs["load_factor"],
        "reason": g.attrs["reason"],
        "elements": g.attrs["elements"],
        "displacement_max": displacement.max(),
        "displacement_max_node": f["net/node_id"][displacement.argmax()],
        "slack": states.count_slack(f, N, ~is_absent),
        "stable": np.all(g["stable"][()]),
        "passes_limit_point": states.passes_limit_point(f, path),
        **_range(N[~is_absent]),
    }


def _range(tension: np.ndarray) -> dict[str, float]:
    """Return the smallest and the largest tension [N]."""
    return {"tension_min": tension.min(), "tension_max": tension.max()}


FIRST_EVENTS = 8  # number of listed fractures, and elements of a failed state
ENERGIES = ("external_work", "kinetic_energy", "strain_energy", "plastic_dissipation", "damping_work")
OPTIONAL_ENERGIES = ("air_work", "band_damping_work", "slip_dissipation", "support_work")


def print_info(path: Path, say: Callable[[str], None]) -> None:
    """Print a summary of a result file; elements and nodes have the ids of the tables.

    Raises InputError for a wrong file.
    """
    with file.open_checked(path) as f:
        say(f"{path}: {file.result_title(f)}")
        has_dynamics = "history" in f
        parts = (
            (_run, True),
            (file.notes_of_run, True),
            (_form, "form_finding" in f),
            (_equilibria, True),
            (_modes, "modes" in f),
            (_dynamics, has_dynamics),
            (_wind, "wind" in f),
            (states.described_removals, "removal" in f),
            (_energies, has_dynamics),
            (_fractures, has_dynamics),
            (_times, True),
            (file.warnings_of_run, True),
        )

        def report(say: Callable[[str], None]) -> None:
            for lines_of in [lines_of for lines_of, present in parts if present]:
                for line in lines_of(f):
                    say(line)

        say_counted(report, say)


def _times(f: h5py.File) -> Iterator[str]:
    """Yield the line on computing times."""
    seconds = f["provenance/timings"].attrs
    yield "time: " + ", ".join(f"{name} {np.max(seconds[name]):.2f} s" for name in seconds)


def _run(f: h5py.File) -> Iterator[str]:
    """Yield the lines on the run and its net."""
    p = f["provenance"].attrs
    ranks = count_of(p["ranks"], "rank")
    yield f"ran: netfall {p['netfall']} on {ranks} ({p['writing']}); {p['exit_state']}"
    overrides = file.provenance_text(f, "overrides")
    if overrides:
        yield "with: " + ", ".join(overrides.split("\n"))
    n, m, fixed = len(f["net/particles"]), len(f["net/elements"]), f["net/fixed"][:].all(1).sum()
    yield (
        f"net: {n} particles ({fixed} fixed), {count_of(m, 'element')}, "
        f"roof {f['net/tributary_area'][:].sum():.1f} m2; "
        f"partition {p['partition']}, {count_of(p['edge_cut'], 'element')} cut"
    )
    if file.roof_axes(f) is not None:
        yield outer_side_line(f["net/vector_area"][:])


def _form(f: h5py.File) -> Iterator[str]:
    """Yield the lines on form finding."""
    g = f["form_finding"]
    yield (
        f"form finding: {count_of(g['iterations'][()], 'iteration')}, "
        f"residual {g['residual'][()]:.2g} of the prestress, "
        f"with the real material {g['residual_real_material'][()]:.2g}; "
        f"{text.form_tensions(g['tension'][:], f['net/bar'][:])}"
    )
    yield from file.form_finding_lines(f)
    if states.no_equilibrium(g):
        yield messages.FORM_NOT_REACHED(reason=g.attrs["reason"])
    if "deviation" in f and states.no_equilibrium(f["deviation"]):
        yield messages.NO_EQUILIBRIUM(reason=f["deviation"].attrs["reason"])


def _equilibria(f: h5py.File) -> Iterator[str]:
    """Yield lines on the last equilibrium of each group, with notes on unstable ones."""
    for path in states.equilibrium_groups(f):
        g, last = f[path], equilibrium_summary(f, path)
        residual = np.fmax.reduce(np.ravel(g["residual"][()]))  # nan for states that were not found
        steps = f"{int((g['load_factor'][:] > 0).sum())} load steps; " if "load_factor" in g else ""
        tensions = kN(last["tension_min"], last["tension_max"])
        yield (
            f"{last['title']}: {steps}largest displacement {mm(last['displacement_max'])} "
            f"(node {last['displacement_max_node']}), tensions {tensions}, "
            f"slack {last['slack']}, largest residual {kN(residual)}"
            + ", LIMIT POINT ON THE PATH"
            * last["passes_limit_point"]
        )
        if states.no_equilibrium(g):
            names, factor = ", ".join(map(str, last["elements"][:FIRST_EVENTS])), last["load_factor"]
            where = f" (elements {names})" if names else ""
            shown = f"load factor reached {factor:.4g}; values are for that state"
            shown = shown if factor == factor else "values are for the last state of the search"
            state = last["state"].replace("_", " ").upper()
            yield f"{last['title']}: {state}: {last['reason']}{where}; {shown}"


def _modes(f: h5py.File) -> Iterator[str]:
    """Yield the line on the longest natural periods."""
    periods = ", ".join(f"{period:.4g}" for period in f["modes/period"][:FIRST_EVENTS])
    yield f"modes {states.modes_equilibrium(f)[1]}: periods {periods} s"


def _dynamics(f: h5py.File) -> Iterator[str]:
    """Yield the lines on time steps, history and step limits of the dynamic stage."""
    h, p = f["history"], f["provenance"].attrs
    has_shorter_steps = p["steps"] > round(h["time"][-1] / p["time_step"])  # shorter steps follow fractures
    shorter = f", or of {p['shortest_time_step']:.4g} s after fractures" if has_shorter_steps else ""
    yield (
        f"dynamics: {h['time'][-1]:g} s in {count_of(p['steps'], 'step')} of "
        f"{p['time_step']:.4g} s{shorter}; {len(f['VTKHDF/Steps/Values'])} frames, "
        f"{len(h['time'])} history rows"
    )
    if "added_mass" in p:
        yield f"  mass scaling: {p['added_mass']:.4g} kg of inertia added"
    for name in [k[6:] for k in p if k.startswith("limit_") and not k.endswith("_element")]:
        e = p[f"limit_{name}_element"]
        element = f" (element {file.element_name(f['net'], e)})" if e >= 0 else ""
        yield f"  step limit {name.replace('_', ' ')}: {p['limit_' + name]:.4g} s{element}"


def _wind(f: h5py.File) -> Iterator[str]:
    """Yield the line on the wind."""
    if "wind/pressure" in f:
        p = f["wind/pressure"][:]
        yield f"wind: pressures of {kN_m2(p.min(), p.max())} at {p.shape[1]} taps"
        return
    u, mean = f["wind/speed"][:], f["wind/mean_speed"][:].mean()
    source, points = ("generated ", "control points") if "wind/turbulence" in f else ("", "points")
    speeds = f"{u.min():.1f} to {u.max():.1f} m/s at {u.shape[1]} {points}"
    yield f"wind: mean {mean:.1f} m/s, {source}{speeds}"


def _energies(f: h5py.File) -> Iterator[str]:
    """Yield the lines on the final energies and their errors."""
    h = f["history"]
    names = [*ENERGIES, *(name for name in OPTIONAL_ENERGIES if name in h)]
    finite = [name for name in names if np.isfinite(h[name][-1])]
    at_end = [f"{name.replace('_', ' ')} {h[name][-1]:.4g}" for name in finite]
    yield "change of energy over the stage [J]: " + ", ".join(at_end)
    if len(finite) < len(names):
        yield "energy check: none, the job has [output] energy = false"
        return
    work_error = np.abs(h["work_identity_error"][:]).max()
    yield f"energy check: work identity to {work_error:.1e}, balance to {warning_text.balance_text(h)}"


def _fractures(f: h5py.File) -> Iterator[str]:
    """Yield the lines on slack cables, broken elements and the first fractures."""
    e, broken = f["events"], len(np.unique(f["events/element_id"][:]))
    failed = ~np.isnan(fracture_times(f)) | ~np.isnan(removal_times(f)) | states.absent(f)
    slack = states.count_slack(f, f["final/tension"][:], ~failed)
    yield f"slack at the end: {count_of(slack, 'cable element')}; broken: {count_of(broken, 'element')}"
    for k in range(min(FIRST_EVENTS, len(e["time"]))):
        split = "" if e["new_particle"][k] >= 0 else ", nothing split"
        yield (
            f"  t = {e['time'][k]:.5f} s, step {e['step'][k]}: element "
            f"{file.element_name(f['net'], e['element'][k])} at node {e['node_id'][k]}{split}, "
            f"strain {e['strain'][k]:.4f}"
        )
    if len(e["time"]) > FIRST_EVENTS:
        yield f"  and {len(e['time']) - FIRST_EVENTS} more fracture events in /events"
