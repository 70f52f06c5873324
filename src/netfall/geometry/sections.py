"""Sections and strengths of the elements.

Sections are given by modulus, area and density, by axial stiffness, mass per length and breaking force, or
by a type of a catalogue. [cable] applies to all elements, [group.NAME] to a group, and a row of elements.csv
to one element; the most specific value applies. Within one of these levels, explicit values take precedence
over `type`. The net always has modulus, section and density. Without an area the section is that of steel of
the same mass, and the modulus reproduces the given axial stiffness.

An element breaks at its breaking force F_u. The law is N = EA (eps - eps_p) up to the yield force N_y. If F_u
<= N_y, the element therefore breaks at the total strain F_u / EA, in either strain measure. Tension never
exceeds N_y, so an element with F_u > N_y breaks at its fracture_strain.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import raise_errors
from netfall.core.functions import exp, log1p, quantile
from netfall.geometry import messages
from netfall.geometry.net import Net
from netfall.job import messages as job_messages
from netfall.job.csv_table import Table
from netfall.job.job import Job
from netfall.job.keys.groups import group_values, own_values, pattern_values, section_of_key
from netfall.job.keys.schema import EXCLUSIVE_KEYS
from netfall.job.validate import missing_key_error
from netfall.job.values import counted, format_value, suggest

INSTEAD_OF_AREA = {"axial_stiffness": "modulus", "mass_per_length": "density"}  # and keys that need the area
TYPE_COLUMNS = ("mass_per_length", "axial_stiffness", "breaking_load", "area")
SECTION_COLUMNS = (*TYPE_COLUMNS, "modulus", "density")
ROW_COLUMNS = ("prestress", "yield_stress", "fracture_strain", "expansion")
STEEL_DENSITY = 7850.0  # kg/m3, density of nominal sections
MAX_EXCESS = 1e-9  # relative excess up to which a breaking force equals the yield force
RANDOM_DIGITS = 9  # digits of random draws; logarithms of different libraries agree in more digits
STRENGTH_COUNTER = 1 << 128  # Philox counter of the first strength; gusts start at each multiple of 1 << 192
LENGTH_COUNTER = 2 << 128  # counter of the first length error


def set_sections(job: Job, net: Net, rows: dict[str, Any]) -> None:
    """Set sections and strengths of the elements of a net. Raises InputError.

    rows : columns of elements.csv by their names, (m,) nan where empty, `type` a list of words; {}: no table
    """
    for column in fields(Net):
        key = column.metadata.get("key")
        if key and key not in SECTION_COLUMNS:
            values = values_of_key(job, net, key, column.metadata["absent"])
            setattr(net, column.name, np.array(values, float))
    net.bar = values_of_key(job, net, "kind") == "bar"
    horizontal_force = _horizontal_force(job, net)
    horizontal_force[np.isfinite(net.force_density) | np.isfinite(rows.get("prestress", np.nan))] = np.nan
    if (given := np.isfinite(horizontal_force)).any():
        net.horizontal_force = horizontal_force
        net.prestress = np.where(given, horizontal_force, net.prestress)
    diameter = values_of_key(job, net, "diameter", 0.0)
    if diameter.any():
        net.diameter, net.drag_coefficient = diameter, values_of_key(job, net, "drag_coefficient")
    for name in ROW_COLUMNS:
        if name in rows:
            setattr(net, name, np.where(np.isnan(rows[name]), getattr(net, name), rows[name]))
    if "kind" in rows:
        net.bar = np.where(np.isnan(rows["kind"]), net.bar, rows["kind"] == 1.0)
    resolved = _found(job, net, rows)
    net.notes += dict.fromkeys(_group_area_notes(job, net, resolved))
    net.notes += [*_row_area_notes(net, rows, resolved), *_row_prestress_notes(job, net, rows)]
    errors = _missing_key_errors(job, net, resolved)
    raise_errors([*errors, *dict.fromkeys(_diameter_errors(job, net))])
    net.breaking_load = np.where(np.isnan(resolved["breaking_load"]), np.inf, resolved["breaking_load"])
    area, stiffness, mass = resolved["area"], resolved["axial_stiffness"], resolved["mass_per_length"]
    net.nominal = np.isnan(area)
    net.section = np.where(net.nominal, mass / STEEL_DENSITY, area)
    net.modulus = np.where(np.isnan(stiffness), resolved["modulus"], stiffness / net.section)
    net.density = np.where(np.isnan(mass), resolved["density"], mass / net.section)


def values_of_key(job: Job, net: Net, key: str, absent: Any = None) -> np.ndarray:
    """Return the values (m,) of a key of [cable] or of the group of each element; absent : without a value"""
    values = [getattr(job.group_properties(name), key) for name in net.group_names]
    return np.array([absent if value is None else value for value in values])[net.group]


def _horizontal_force(job: Job, net: Net) -> np.ndarray:
    """Return the horizontal forces (m,) [N] of the groups; nan: none, or a more specific prestress."""
    values = []
    for name in net.group_names:
        levels = [job.cable.given(), pattern_values(job.groups, name), own_values(job.groups, name)]
        given = [level for level in levels if {"prestress", "horizontal_force"} & level.keys()]
        values.append(given[-1].get("horizontal_force", np.nan) if given else np.nan)
    return np.array(values, float)[net.group]


def given_cable_keys(job: Job) -> tuple[str, ...]:
    """Return the keys that [cable] or one of its groups gives, sorted."""
    return tuple(sorted({key for table in (job.cable, *job.groups.values()) for key in table.given()}))


# --- values by level: [cable], group, row


def _found(job: Job, net: Net, rows: dict[str, Any]) -> dict[str, np.ndarray]:
    """Resolve each of SECTION_COLUMNS (m,) from [cable], the group and the row; nan: not given."""
    (types, notes), names = read_catalogue(job), net.group_names
    net.notes += notes
    common = _level_values([dict(job.cable)] * len(names))
    patterns = _level_values([pattern_values(job.groups, name) for name in names])
    groups = _level_values([own_values(job.groups, name) for name in names])
    resolved, own = (
        {name: np.full(len(names), np.nan) for name in (*SECTION_COLUMNS, "type")} for _ in range(2)
    )

    def in_group(k: Any) -> Any:
        return f"{job.path}: [group.{section_of_key(job.groups, names[k], 'type')}]"

    errors = _override_level(resolved, common, types, lambda k: f"{job.path}: [cable]")
    for level in (patterns, groups):
        errors += _override_level(resolved, level, types, in_group)
        _override_level(own, level, types, in_group)
    resolved, own = ({name: values[net.group] for name, values in level.items()} for level in (resolved, own))
    bars = net.bar & (job.cable.kind != "bar")  # bars although [cable] describes cables
    for name in ("breaking_load", "type"):  # the values of [cable] are for cables
        resolved[name] = np.where(bars, own[name], resolved[name])
    if rows:
        of_rows = {name: rows[name] for name in SECTION_COLUMNS if name in rows}
        of_rows["type"] = np.array(rows.get("type") or [""] * net.m)
        place = f"{job.path.parent / str(job.net.elements)}: element"
        errors += _override_level(resolved, of_rows, types, lambda e: f"{place} {net.element_id[e]}:")
    raise_errors(errors)
    if types:
        number = resolved["type"]
        net.type, net.type_names = np.where(np.isnan(number), -1, number).astype(int), list(types)
    return resolved


def _level_values(tables: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return the values of tables for SECTION_COLUMNS, (k,) nan: not given, and "type", "": none."""
    level = {name: np.array([table.get(name) for table in tables], float) for name in SECTION_COLUMNS}
    return level | {"type": np.array([table.get("type") or "" for table in tables])}


def _rows_of(
    words: np.ndarray, types: dict[str, Any], place: Callable[..., Any]
) -> tuple[np.ndarray, list[str]]:
    """Return the rows (k,) of the named types, -1: none, and an error for each unknown name."""
    if not (words != "").any():  # saves one second of sorting for a million elements
        return np.full(len(words), -1), []
    names, first, inverse = np.unique(words, return_index=True, return_inverse=True)
    number = {name: k for k, name in enumerate(types)}
    errors = []
    for name, e in zip(names.tolist(), first):
        if name and types and name not in number:
            error = messages.UNKNOWN_TYPE(name=format_value(name), suggestion=suggest(name, types))
            errors.append(f"{place(e)} {error}")
        elif name and not types:
            errors.append(f"{place(e)} {messages.TYPE_WITHOUT_CATALOGUE(name=format_value(name))}")
    return np.array([number.get(str(name), -1) for name in names])[inverse], errors


def _override_level(
    resolved: dict[str, Any], level: dict[str, Any], types: dict[str, Any], place: Callable[..., Any]
) -> list[str]:
    """Override values with those of a more specific level: first its types (k,), then its explicit values.

    Returns an error for each unknown type; place(row) : text that locates a row
    """
    row, errors = _rows_of(level["type"], types, place)
    typed = row >= 0
    if typed.any():
        table = np.array(list(types.values()))
        for name in SECTION_COLUMNS:
            resolved[name][typed] = np.nan
        for k, name in enumerate(TYPE_COLUMNS):
            resolved[name][typed] = table[row[typed], k]
        resolved["type"][typed] = row[typed]
    for one, other in EXCLUSIVE_KEYS:
        for name, alternative in ((one, other), (other, one)):
            if name in level:
                resolved[alternative][~np.isnan(level[name])] = np.nan
    for name in level.keys() & {*SECTION_COLUMNS}:
        resolved[name] = np.where(np.isnan(level[name]), resolved[name], level[name])
    return errors


def read_catalogue(job: Job) -> tuple[dict[str, tuple[float, ...]], list[str]]:
    """Read TYPE_COLUMNS of each type of the catalogue, nan: none, and notes. Raises InputError."""
    if job.cable.catalogue is None:
        return {}, []
    path = job.path.parent / Path(job.cable.catalogue)
    table = Table(path, ("name", *TYPE_COLUMNS), ("name", *TYPE_COLUMNS[:3]))
    least, units = 1e-12, ("kg/m", "N", "N", "m2")
    columns = [table.numbers(name, low=least, unit=unit) for name, unit in zip(TYPE_COLUMNS, units)]
    types: dict[str, tuple[float, ...]] = {}
    for name in TYPE_COLUMNS[:2]:
        table.full(name)
    for k, name in enumerate(table.words("name")):
        if name == "" or name in types:
            table.wrong(messages.DUPLICATE_TYPE(row=table.at(k), name=name))
        types[name] = tuple(float(column[k]) for column in columns)
    table.finish()
    return types, table.notes


def _missing_key_errors(job: Job, net: Net, resolved: dict[str, np.ndarray]) -> Iterator[str]:
    """Yield an error for each key that the elements of a group lack."""
    absent = {name: np.isnan(values) for name, values in resolved.items()}
    lacking = (
        (absent["modulus"] & absent["axial_stiffness"], "modulus"),
        (absent["area"] & (~absent["modulus"] | (absent["mass_per_length"] & ~absent["density"])), "area"),
        (absent["density"] & absent["mass_per_length"], "density"),
    )
    for rows, key in lacking:
        for name, ids in net.ids_by_group(rows):
            place = f"group.{name}" if name in job.groups else "cable"
            yield f"{job.path}: [{place}] {missing_key_error(key, f' for element {ids[0]}')}"


def _row_prestress_notes(job: Job, net: Net, rows: dict[str, Any]) -> Iterator[str]:
    """Yield notes on some rows with a prestress and its replacement; `unused` has the notes on all rows."""
    by_density = job.form_finding is not None and job.form_finding.method == "force_density"
    given = np.nan_to_num(rows.get("prestress", np.zeros(net.m))) != 0.0
    for column, counts in (("unstressed_length", True), ("force_density", by_density)):
        has_other = np.isfinite(getattr(net, column))
        if counts and (given & has_other).any() and not has_other.all():
            elements = counted("element", net.element_id[given & has_other])
            yield job_messages.PRESTRESS_REPLACED(elements=elements, column=column)


def _row_area_notes(net: Net, rows: dict[str, Any], resolved: dict[str, np.ndarray]) -> Iterator[str]:
    """Yield a note for each group with an area in a row that does not change its EA or mass."""
    has_type = np.array(rows.get("type") or [""] * net.m) != ""
    has_area = np.isfinite(rows.get("area", np.full(net.m, np.nan))) & ~has_type
    for key, column in INSTEAD_OF_AREA.items():
        idle = has_area & np.isfinite(resolved[key])
        for name, ids in net.ids_by_group(idle):
            group = f" of group {format_value(name)}" if name else ""
            area = f"column area of {counted('element', ids)}{group}"
            yield job_messages.AREA_WITHOUT_EFFECT(area=area, key=key, column=column)


def _group_area_notes(job: Job, net: Net, resolved: dict[str, Any]) -> Iterator[str]:
    """Yield a note for each group whose area does not change its EA or mass, which [cable] gives."""
    for g, name in enumerate(net.group_names):
        given = group_values(job.groups, name)
        for key, column in INSTEAD_OF_AREA.items() if "area" in given else ():
            if not {key, column, "type"} & given.keys() and np.isfinite(resolved[key][net.group == g]).any():
                area = f"[group.{section_of_key(job.groups, name, 'area')}] area"
                yield job_messages.AREA_WITHOUT_EFFECT(area=area, key=key, column=column)


def _diameter_errors(job: Job, net: Net) -> Iterator[str]:
    """Yield an error for each section with a drag coefficient for elements without a diameter."""
    error = job_messages.NEEDS(key="drag_coefficient", needed="diameter")
    if job.cable.given().get("drag_coefficient") and net.diameter is None:
        yield f"{job.path}: [cable] {error}"
    for name in net.group_names:
        of_group = group_values(job.groups, name)
        if "drag_coefficient" in of_group and job.group_properties(name).diameter is None:
            yield f"{job.path}: [group.{section_of_key(job.groups, name, 'drag_coefficient')}] {error}"


# --- strength


def set_strengths(job: Job, net: Net) -> None:
    """Draw the random strength and length of each cable, and set fracture strains from breaking forces."""
    if net.strength_cov.any():
        z = _random_normal_by_cable(net, job.cable.strength_seed, STRENGTH_COUNTER)
        spread = np.sqrt(log1p(net.strength_cov**2))  # lognormal, with mean 1
        net.strength = np.round(exp(spread * z - 0.5 * spread**2), RANDOM_DIGITS)
        for name in ("yield_stress", "breaking_load", "fracture_strain"):
            setattr(net, name, getattr(net, name) * net.strength)
    if np.isfinite(net.breaking_load).any():
        reached = net.breaking_load <= net.yield_force * (1.0 + MAX_EXCESS)
        strain = np.where(reached, net.breaking_load / net.EA, np.inf)
        net.fracture_strain = np.minimum(net.fracture_strain, strain)
    if net.length_std.any():
        largest = np.zeros(len(net.cable_names))  # of the groups that a cable belongs to
        np.maximum.at(largest, net.cable, net.length_std)
        net.length_std = largest[net.cable]
        error = net.length_std * _random_normal_by_cable(net, job.cable.length_seed, LENGTH_COUNTER)
        net.length_error = np.round(error, RANDOM_DIGITS)


def _random_normal_by_cable(net: Net, seed: int, counter: int) -> np.ndarray:
    """Return a standard normal number (m,) for the cable of each element, from a counter of Philox on."""
    raw = np.random.Philox(key=seed, counter=counter).random_raw(len(net.cable_names))
    return quantile(((raw >> np.uint64(12)) + 0.5) * 2.0**-52)[net.cable]


def strength_errors(job: Job, net: Net) -> Iterator[str]:
    """Yield errors for elements that break at the start, or never at their breaking force."""
    limit, dynamics, breaks = net.yield_force, job.dynamics, np.isfinite(net.fracture_strain)
    drawn = " (as drawn by strength_cov)" if net.strength_cov.any() else ""
    unreachable = np.isfinite(net.breaking_load) & (net.breaking_load > limit * (1.0 + MAX_EXCESS)) & ~breaks
    brittle = net.bar & np.isfinite(limit) & (net.breaking_load < limit * (1.0 - MAX_EXCESS))
    brittle &= True if net.buckling is None else ~net.buckling  # these may break in compression
    for e in np.flatnonzero(net.prestress > net.breaking_load)[:1]:
        element, strength, force = f"element {net.element_id[e]}", net.breaking_load[e], net.prestress[e]
        yield messages.WEAKER_THAN_PRESTRESS(element=element, strength=strength, drawn=drawn, force=force)
    for message, rows in ((messages.BREAKING_ABOVE_YIELD, unreachable), (messages.BRITTLE_BAR, brittle)):
        for e in np.flatnonzero(rows)[:1]:
            element, strength = f"element {net.element_id[e]}", net.breaking_load[e]
            yield message(element=element, strength=strength, drawn=drawn, limit=limit[e])
    if dynamics is not None and dynamics.mass_scaling and dynamics.fragments and breaks.any():
        yield messages.MASS_SCALING_WITH_FRAGMENTS(value=dynamics.mass_scaling)


def strength_notes(job: Job, net: Net) -> Iterator[str]:
    """Yield notes on strength keys without effect and warnings about bars with a doubtful strength."""
    inherited = np.nan if job.cable.yield_stress is None else job.cable.yield_stress
    for g, name in enumerate(() if job.cable.kind == "bar" else net.group_names):
        own, given = group_values(job.groups, name), net.yield_stress / net.strength  # a row may differ
        bars = (net.group == g) & (np.abs(given - inherited) <= MAX_EXCESS * inherited)
        if own.get("kind") == "bar" and not own.get("yield_stress") and bars.any():  # intended for cables
            named_bars = counted("bar", net.element_id[bars])
            yield messages.INHERITED_YIELD_STRESS(name=name, bars=named_bars, value=inherited)
    if np.isfinite(net.fracture_strain).any():
        unlimited = net.bar & np.isinf(net.yield_stress) & np.isinf(net.fracture_strain)
        for name, ids in net.ids_by_group(unlimited):
            group = f" of group {format_value(name)}" if name else ""
            yield messages.UNLIMITED_BARS(bars=counted("bar", ids), group=group)
    scatters = bool(net.strength_cov.any())
    for seed, scatter in (("strength_seed", "strength_cov"), ("length_seed", "length_std")):
        if f"cable.{seed}" in job.given() and not getattr(net, scatter).any():
            yield messages.SEED_WITHOUT_SCATTER(seed=seed, scatter=scatter)
    limits = (net.yield_stress, net.fracture_strain, net.breaking_load)
    if scatters and not any(np.isfinite(limit).any() for limit in limits):
        yield messages.SCATTER_WITHOUT_STRENGTH()
    for e in np.flatnonzero(net.nominal & np.isfinite(net.yield_stress))[:1]:
        yield messages.NOMINAL_YIELD_STRESS(element=net.element_id[e], area=net.section[e])
    if job.cable.catalogue and not (net.type >= 0).any():
        yield messages.UNUSED_CATALOGUE()
