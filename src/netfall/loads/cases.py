"""Inputs of static cases in addition to [load], read before any computation: winds, tables, settlements."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from netfall.core.errors import InputError, refuse
from netfall.geometry.net import Net, with_inner
from netfall.geometry.turned import is_turned, settles_along
from netfall.geometry.zones import Zones
from netfall.job.cases import blows, factor_of, split, static_wind
from netfall.job.csv_table import Table
from netfall.job.job import Job
from netfall.job.schema import defaults
from netfall.job.values import listed, shown
from netfall.loads.loads import shape_coefficients
from netfall.loads.wind.sectors import Sectors, origin

LIVE = ("snow", "pressure")  # keys of [load] that belong to the action "load"
ACTION = {"dead": "permanent", "temperature": "temperature"} | dict.fromkeys(LIVE, "load")


@dataclass(frozen=True)
class Inputs:
    """Inputs of a case in addition to [load], in the numbers of the given net.

    wind : [wind] as it acts in the case, with the net pressure coefficient (n,) of each node, None: none
    points : (c, 2 or 3) [m], and pressure : (c,) [N/m2] there, of its table, None: no table
    settlement : (n, 3) [m], None: no support settles; sectors : of its wind, None: none
    """

    wind: SimpleNamespace | None = None
    sectors: Sectors | None = None
    points: np.ndarray | None = None
    pressure: np.ndarray | None = None
    settlement: np.ndarray | None = None


def read_cases(job: Job, net: Net, zones: Zones) -> tuple[dict[str, Inputs], list[str]]:
    """Read the inputs of each case, by name, and notes. Raises InputError with all errors."""
    inputs_of, notes, errors = {}, [], []
    for case in job.cases:
        inputs = {}
        for read, context in ((_wind_of, zones), (_table_of, None), (_settlement_of, net)):
            try:
                part, new_notes = read(job, case, context)
                inputs, notes = inputs | part, notes + new_notes
            except InputError as error:
                errors += error.lines
        inputs_of[case.name] = Inputs(**inputs)
    refuse(dict.fromkeys(errors))
    return inputs_of, list(dict.fromkeys(notes + _differences(job) + _left_out(job, net)))


def _differences(job: Job) -> list[str]:
    """Return a note for each load of a case with another factor in a combination than the load of [load].

    Such a combination has factor x (value of the case - value of [load]) + factor of [load] x its value.
    """
    notes = []
    for case in job.cases if job.load else []:
        for name, value in case.set.items():
            section, zone, key = split(name)
            own = job.load.zone.get(zone, {}).get(key, getattr(job.load, key)) if section == "load" else None
            if own is None or not np.any(own):
                continue
            pairs = [
                (combination, factor_of(combination, case.name), factor_of(combination, ACTION[key]))
                for combination in job.combinations
            ]
            sums = [
                f"{shown(combination.name)}: {_sum(f, value, g, own)}"
                for combination, f, g in pairs
                if f and f != g
            ]
            if sums:
                notes.append(
                    f"[[case]] {case.name}: {name} = {_number(value)}, where [load] has {_number(own)}: in a "
                    f"combination the case's factor is that of the difference, on top of {ACTION[key]} "
                    f"({listed(sums)}); with one factor for both, or nothing in [load], the case counts whole"
                )
    return notes


def _sum(f: float, value, g: float, base) -> str:
    """Write the sum of a load of a case and of [load] in a combination, for a note."""
    text = f"{f:g} x ({_number(value)} - {_number(base)}) + {g:g} x {_number(base)}"
    same_shape = np.shape(value) == np.shape(
        base
    )  # a pressure along the normal is a scalar, one along axes is not
    return text + (f" = {_number(f * np.subtract(value, base) + g * np.array(base))}" if same_shape else "")


def _number(value) -> str:
    """Write a load, or its components, for a note."""
    return "[" + ", ".join(f"{component:g}" for component in value) + "]" if np.ndim(value) else f"{value:g}"


def _left_out(job: Job, net: Net) -> list[str]:
    """Return a note for each action of [load] that combinations do not name and that does not act in them."""
    load = job.load
    if load is None:
        return []
    on_roof = [load.snow, load.pressure, *(zone.get(key) for zone in load.zone.values() for key in LIVE)]
    live = any(value is not None and np.any(value) for value in on_roof) or net.load.any()
    return [
        f"[[combination]] {listed([shown(one) for one in silent])}: {name} is not among the factors, so "
        f"{what} are left out; {name} = 0.0 says that this is meant"
        for name, acts, what in (
            ("load", live, "snow and pressure of [load], and loads of nodes,"),
            ("temperature", load.temperature != 0.0, "changes of temperature of [load]"),
        )
        if acts and (silent := [one.name for one in job.combinations if name not in one.factors])
    ]


def _wind_of(job: Job, case: SimpleNamespace, zones: Zones) -> tuple[dict, list[str]]:
    """Return the static wind of a case with its sectors, and notes."""
    if not blows(case):
        return {}, []
    wind = static_wind(job.wind or defaults("wind"), case)
    coefficient, sectors = shape_coefficients(replace(job, wind=wind), zones)
    notes = list(sectors.notes) if sectors else []
    if "wind.direction" in case.set and wind.sectors is None:
        notes.append(
            f"[[case]] {case.name}: set: wind.direction = {wind.direction:g} ({origin(wind.direction)}): the "
            "shape coefficients do not follow it; wind.sectors = a table gives them by direction"
        )
    wind = SimpleNamespace(**(vars(wind) | {"shape_coefficient": coefficient}))
    return {"wind": wind, "sectors": sectors}, notes


def _table_of(job: Job, case: SimpleNamespace, _) -> tuple[dict, list[str]]:
    """Read the points and pressures of the table of a case; return them and notes. Raises InputError."""
    if case.pressure_table is None:
        return {}, []
    path = job.path.parent / case.pressure_table
    table = Table(path, ("x", "y", "z", "pressure", "coefficient"), ("x", "y"))
    columns = [name for name in ("pressure", "coefficient") if name in table]
    if len(columns) != 1:
        table.wrong("expected a column pressure [N/m2], or a column coefficient, and not both")
        table.finish()
    values = table.numbers(columns[0], unit="N/m2" if columns[0] == "pressure" else "")
    points = table.stacked([axis for axis in "xyz" if axis in table], unit="m")
    if columns[0] == "coefficient" and case.factor is None:
        problem = "factor: missing; expected the pressure in N/m2 by which coefficients are multiplied"
        table.errors.append(f"{job.path}: [[case]] {case.name}: {problem}")
    table.no_gaps(values, points)
    pressure = values * (1.0 if case.factor is None else case.factor)
    return {"points": points, "pressure": pressure}, table.notes


def _settlement_of(job: Job, case: SimpleNamespace, net: Net) -> tuple[dict, list[str]]:
    """Return the settlements of a case. Raises InputError for nodes or axes that are free."""
    if not case.settlement:
        return {}, []
    label = f"{job.path}: [[case]] {case.name}: settlement"
    row_of = {number: p for p, number in enumerate(net.node_id.tolist())}
    settlement, errors, can_settle = np.zeros((net.n, 3)), [], settles_along(net, net.fixed)
    for name, shift in case.settlement.items():
        p = row_of.get(int(name))
        if p is None:
            errors.append(f"{label}: there is no node {int(name)}; expected ids of nodes.csv")
            continue
        settlement[p] = shift
        axes = [axis for axis, held in zip("xyz", can_settle[p] | (settlement[p] == 0.0)) if not held]
        reason = "neither held nor on a spring; expected 0.0 there, or a support"
        if is_turned(net)[p]:
            reason = "a support with an angle that can move in plan settles along z alone; expected 0.0 there"
        if axes:
            errors.append(f"{label}: node {int(name)}: {', '.join(axes)}: {reason}")
    refuse(errors)
    return {"settlement": with_inner(net, settlement, net.fixed)}, []
