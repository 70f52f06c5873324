"""Inputs of static cases in addition to [load], read before any computation: winds, tables, settlements."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from netfall.core.errors import InputError, raise_errors
from netfall.geometry.net import Net, extend_to_inner_particles
from netfall.geometry.turned import is_rotated, settlement_axes
from netfall.geometry.zones import Zones
from netfall.job.csv_table import Table
from netfall.job.derived import tap_axes
from netfall.job.job import Job
from netfall.job.keys.entries import Case, action_factor, has_static_wind, split, static_wind
from netfall.job.keys.models import CaseWind, Wind
from netfall.job.values import format_list, format_value
from netfall.loads import messages
from netfall.loads.loads import with_coefficients
from netfall.loads.wind.sectors import Sectors, describe_origin, read_sectors

LIVE_LOAD_KEYS = ("snow", "ice", "pressure")  # keys of [load] that belong to the action "load"
ACTION_OF_KEY = {"dead": "permanent", "temperature": "temperature"} | dict.fromkeys(LIVE_LOAD_KEYS, "load")


@dataclass(frozen=True)
class CaseInputs:
    """Inputs of a case in addition to [load], with the node numbers of the given net.

    wind : [wind] in the case, with the net pressure coefficient of each part, None: no wind
    points : (c, 2 or 3) [m], and pressure : (c,) [N/m2] at these points, from its table, None: no table
    settlement : (n, 3) [m], None: no support settles; sectors : of its wind, None: none
    """

    wind: CaseWind | None = None
    sectors: Sectors | None = None
    points: np.ndarray | None = None
    pressure: np.ndarray | None = None
    settlement: np.ndarray | None = None


def read_case_inputs(
    job: Job, net: Net, zones: Zones, loaded: bool
) -> tuple[dict[str, CaseInputs], list[str]]:
    """Read the inputs of each case, by name, and notes. Raises InputError with all errors.

    loaded : whether nodes or elements have loads of their own
    """
    inputs_of: dict[str, CaseInputs] = {}
    notes: list[str] = []
    errors: list[str] = []
    wind, settlement = partial(_read_case_wind, zones), partial(_read_case_settlement, net)
    readers: tuple[Callable[..., Any], ...] = (wind, _read_case_pressures, settlement)
    for case in job.cases:
        inputs: dict[Any, Any] = {}
        for read in readers:
            try:
                part, new_notes = read(job, case)
                inputs, notes = inputs | part, notes + new_notes
            except InputError as error:
                errors += error.lines
        inputs_of[case.name] = CaseInputs(**inputs)
    raise_errors(dict.fromkeys(errors))
    notes += [*_zone_value_notes(job), *_unequal_factor_notes(job), *_omitted_action_notes(job, loaded)]
    return inputs_of, list(dict.fromkeys([*notes, *_wind_without_gusts_notes(job)]))


def _zone_value_notes(job: Job) -> Iterator[str]:
    """Yield a warning for each value of a case that does not reach zones with a value of their own."""
    for case in job.cases:
        for name, value in case.set.items():
            section, zone, key = split(name)
            base = getattr(job, section)
            own = base.zone_values(key) if base and not zone else {}
            listed = [
                f"{section}.zone.{other}.{key} = {_format_load(number)}"
                for other, number in own.items()
                if np.any(number) and f"{section}.zone.{other}.{key}" not in case.set
            ]
            if listed:
                shown, zones = format_value(value), format_list(sorted(listed))
                yield messages.ZONES_KEEP_VALUES(case=case.name, key=name, value=shown, zones=zones)


def _unequal_factor_notes(job: Job) -> Iterator[str]:
    """Yield a warning for each load of a case with another factor in a combination than the load of [load].

    Such a combination has factor x (value of the case - value of [load]) + factor of [load] x its value.
    """
    for case in job.cases if job.load else []:
        for name, value in case.set.items():
            section, zone, key = split(name)
            own = job.load.zone_values(key).get(zone, getattr(job.load, key)) if section == "load" else None
            if own is None or not np.any(own):
                continue
            sums, action = [], ACTION_OF_KEY[key]
            for one in job.combinations:
                f, g = action_factor(one, case.name), action_factor(one, action)
                if f and f != g:
                    sums.append(f"{format_value(one.name)}: {_format_sum(key, f, value, g, own)}")
            if sums:
                shown, base, listed = _format_load(value), _format_load(own), format_list(sums)
                yield messages.UNEQUAL_FACTORS(
                    case=case.name, key=name, action=action, value=shown, base=base, sums=listed
                )


def _format_sum(key: str, f: float, value: Any, g: float, base: Any) -> str:
    """Format the sum of a load of a case and of [load] in a combination, for a note.

    The result is omitted if it is not a value of the key: the weight of ice is not proportional to its
    thickness, and a pressure is a scalar along the normal but a vector along axes.
    """
    text = f"{f:g} x ({_format_load(value)} - {_format_load(base)}) + {g:g} x {_format_load(base)}"
    if key == "ice" or np.shape(value) != np.shape(base):
        return text
    return f"{text} = {_format_load(f * np.subtract(value, base) + g * np.array(base))}"


def _format_load(value: Any) -> str:
    """Format a load, or its components, for a note."""
    return "[" + ", ".join(f"{component:g}" for component in value) + "]" if np.ndim(value) else f"{value:g}"


def _omitted_action_notes(job: Job, loaded: bool) -> Iterator[str]:
    """Yield a warning for each action of [load] that some combinations omit, and each case that all omit.

    loaded : whether nodes or elements have loads of their own
    """
    if job.load is not None:
        on_roof = [value for key in LIVE_LOAD_KEYS for value in job.load.all_values(key)]
        live = any(value is not None and np.any(value) for value in on_roof) or loaded
        for name, acts, loads in (
            ("load", live, "snow, ice and pressure of [load], and loads of nodes and elements,"),
            ("temperature", job.load.temperature != 0.0, "changes of temperature of [load]"),
        ):
            silent = [format_value(one.name) for one in job.combinations if name not in one.factors]
            if acts and silent:
                yield messages.OMITTED_ACTION(combinations=format_list(silent), action=name, loads=loads)
    named = {name for one in job.combinations for name in one.factors}
    unnamed = [case.name for case in job.cases if named and case.name not in named]
    if unnamed:
        yield messages.OMITTED_CASES(cases=format_list(unnamed))


def _wind_without_gusts_notes(job: Job) -> list[str]:
    """Return a warning if combinations, or without any the checks, use static winds of the mean pressure."""
    cases = [c.name for c in job.cases if has_static_wind(c) and "wind.pressure_factor" not in c.set]
    uses = {one.name: [name for name in cases if action_factor(one, name)] for one in job.combinations}
    used = list(dict.fromkeys(name for names in uses.values() for name in names))
    combinations = format_list([format_value(name) for name, names in uses.items() if names])
    where = f" in [[combination]] {combinations}"
    if not (job.combinations or job.dynamics):
        used, where = cases, ""
    return [messages.CASES_WITHOUT_GUSTS(cases=format_list(used), where=where)] if used else []


def _read_case_wind(zones: Zones, job: Job, case: Case) -> tuple[dict[str, Any], list[str]]:
    """Return the static wind of a case with its sectors, and notes."""
    if not has_static_wind(case):
        return {}, []
    wind = static_wind(job.wind or Wind(), case)
    sectors = read_sectors(replace(job, wind=wind), zones.names)
    notes = list(sectors.notes) if sectors else []
    winds: list[Wind] = [static_wind(job.wind or Wind(), each) for each in job.cases if has_static_wind(each)]
    winds = [*winds, job.wind] if job.wind else winds
    directions = {each.direction % 360.0 for each in winds if _coefficients(each) == _coefficients(wind)}
    if "wind.direction" in case.set and len(directions) > 1 and not wind.sectors and any(_coefficients(wind)):
        origin = describe_origin(wind.direction)
        notes.append(messages.CASE_DIRECTION_IGNORED(case=case.name, direction=wind.direction, origin=origin))
    return {"wind": with_coefficients(wind, sectors, zones.of_parts), "sectors": sectors}, notes


def _coefficients(wind: Wind) -> tuple[Any, ...]:
    """Return the pressure coefficients of a wind, of the roof and of the zones."""
    return wind.pressure_coefficient, wind.zone_values("pressure_coefficient")


def _read_case_pressures(job: Job, case: Case) -> tuple[dict[str, Any], list[str]]:
    """Read the points and pressures of the table of a case; return them and notes. Raises InputError."""
    if case.pressure_table is None:
        return {}, []
    path = job.path.parent / case.pressure_table
    table = Table(path, ("x", "y", "z", "pressure", "coefficient"), tuple(tap_axes(job)))
    columns = [name for name in ("pressure", "coefficient") if name in table]
    if len(columns) != 1:
        table.wrong(messages.PRESSURE_COLUMNS())
        table.finish()
    values = table.numbers(columns[0], unit="N/m2" if columns[0] == "pressure" else "")
    points = table.stacked([axis for axis in "xyz" if axis in table], unit="m")
    if columns[0] == "coefficient" and case.factor is None:
        table.errors.append(messages.MISSING_FACTOR(path=job.path, case=case.name))
    table.check_no_gaps(values, points)
    pressure = values * (1.0 if case.factor is None else case.factor)
    return {"points": points, "pressure": pressure}, table.notes


def _read_case_settlement(net: Net, job: Job, case: Case) -> tuple[dict[str, Any], list[str]]:
    """Return the settlements of a case. Raises InputError for nodes or axes that are free."""
    if not case.settlement:
        return {}, []
    row_of = {number: p for p, number in enumerate(net.node_id.tolist())}
    settlement, errors, can_settle = np.zeros((net.n, 3)), [], settlement_axes(net, net.fixed)
    can_settle |= bool(job.stages)  # they hold and release nodes: `erection.settings.check_stages`
    for name, shift in case.settlement.items():
        p = row_of.get(int(name))
        if p is None:
            errors.append(messages.UNKNOWN_SETTLEMENT_NODE(path=job.path, case=case.name, node=int(name)))
            continue
        settlement[p] = shift
        axes = [axis for axis, held in zip("xyz", can_settle[p] | (settlement[p] == 0.0)) if not held]
        message = messages.ROTATED_SETTLEMENT if is_rotated(net)[p] else messages.FREE_SETTLEMENT_AXES
        if axes:
            errors.append(message(path=job.path, case=case.name, node=int(name), axes=", ".join(axes)))
    raise_errors(errors)
    return {"settlement": extend_to_inner_particles(net, settlement, net.fixed)}, []
