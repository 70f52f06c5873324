"""Plausibility checks of the start of a job: elements that fail at once, and values in another unit."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from netfall.core.errors import raise_errors
from netfall.core.functions import lengths
from netfall.core.quantities import kN
from netfall.core.types import BoolArray, IntArray
from netfall.geometry.bars import euler_load
from netfall.geometry.net import GRAVITY, Net
from netfall.job.job import Job
from netfall.job.values import counted, format_value
from netfall.loads.wind.coherence import LOWEST_HEIGHT
from netfall.loads.wind.measured import TableHistory, ambiguous_particles
from netfall.physics.law.limits import caps_of
from netfall.physics.law.measures import exceeds_stiffness, strains

# Column of the net, its key, unit, range plausible for cables, and an example in that unit.
SECTION_RANGES = (
    ("modulus", "modulus", "Pa", 1e6, 2e12, "steel has 2e11 Pa; was GPa or N/mm2 meant?"),
    ("section", "area", "m2", 1e-9, 1.0, "a rope of 20 mm has some 3e-4 m2; was mm2 or cm2 meant?"),
    ("density", "density", "kg/m3", 100.0, 25e3, "steel has 7850 kg/m3; was g/cm3 or t/m3 meant?"),
    ("yield_stress", "yield_stress", "Pa", 1e6, 1e11, "cable steel has some 1.5e9 Pa; was N/mm2 meant?"),
    ("fracture_strain", "fracture_strain", "", 1e-6, 1.0, "4 percent are 0.04"),
)
# Plausible ranges of bars, where they differ from those of cables.
BAR_RANGES = {"section": (1e-6, 50.0, "a tube of 200 mm has some 6e-3 m2; was mm2 or cm2 meant?")}
MATERIAL_COLUMNS = (
    "modulus",
    "section",
    "density",
)  # nominal elements derive these columns from their stiffness
# Section, key (also in zones, cases and stages), unit, range plausible for roofs, and an example.
LOAD_RANGES = (
    ("load", "dead", "N/m2", 5.0, 2e4, "cladding weighs 10 to 3000; is it in kN/m2, or kg/m2?"),
    ("load", "snow", "N/m2", 20.0, 5e4, "codes have 300 to 10000; is it in kN/m2?"),
    ("load", "pressure", "N/m2", 5.0, 5e4, "storms press with 300 to 5000; is it in kN/m2?"),
    ("load", "temperature", "K", 0.0, 150.0, "it is a change from that of form finding, not a temperature"),
    ("load", "added_mass", "kg/m2", 0.0, 1e3, "air that moves along has 10 to 100"),
    ("wind", "speed", "m/s", 0.0, 90.0, "storms have a mean of up to 70 at 10 m; is it in km/h?"),
    ("wind", "pressure_coefficient", "", 0.0, 20.0, "codes have -4 to 2; is it a pressure?"),
    ("wind", "air_density", "kg/m3", 0.5, 2.0, "air has some 1.25"),
)
SAMPLED_ROWS = 1000  # rows of a time table that are enough to judge its magnitude
MAX_PLAUSIBLE_DAMPING = (
    20.0  # 1/s: largest plausible [dynamics] mass_damping; it halves a velocity in 1 / 29 s
)
MAX_PLAUSIBLE_FACTOR = 10.0  # largest plausible factor of a combination
WIDEST, MIN_PLAUSIBLE_EXTENT = 3e3, 0.3  # m: plausible extents of nets
MAX_WEIGHT_RATIO = (
    100.0  # largest plausible ratio of the weight of nodes to the weight of their mass, or its inverse
)
MIN_BREAKING_STRAIN = 1e-4  # smallest plausible strain at the breaking force
MIN_WAVE_SPEED, MAX_WAVE_SPEED = (
    400.0,
    20e3,
)  # m/s: plausible speeds of axial waves, sqrt(E / rho); steel has some 5000
MIN_PRESTRESS_STRAIN = 3e-6  # smallest plausible strain of the tightest element of a prestressed net
MIN_START_STRAIN, MAX_START_STRAIN = -0.5, 0.1  # plausible strains at the start
FAR = 3.0  # diagonals of the roof in plan: taps and points beyond that are probably in another unit
ROUNDING = 1e-10  # share of the largest force below which a force counts as zero
COLLAPSED_LENGTH_RATIO = (
    1e-6  # share of its given length below which an element has collapsed in form finding
)
UNITS_HINT = "check the units of modulus (Pa), area (m2), prestress (N) and unstressed_length (m)"


def unit_notes(net: Net) -> list[str]:
    """Return a note for each section value that no cable or bar material has."""

    def elements(rows: IntArray) -> str:
        return counted("element", net.element_id[rows])

    notes = []
    for column, key, unit, *of_cables in SECTION_RANGES:
        given = ~net.nominal if column in MATERIAL_COLUMNS else np.ones(net.m, bool)
        for kind, of_kind in (("cables", ~net.bar), ("bars", net.bar)):
            low, high, example = BAR_RANGES.get(column, of_cables) if kind == "bars" else of_cables
            values = getattr(net, column)
            odd = np.flatnonzero(given & of_kind & np.isfinite(values) & ((values < low) | (values > high)))
            if len(odd):
                value = f"{key} = {values[odd[0]]:g} {unit}".strip()
                notes.append(
                    f"{value} of {elements(odd)} is far from what {kind} have, {low:g} to {high:g}: {example}"
                )
    speed = np.sqrt(net.modulus / net.density)
    odd = np.flatnonzero((speed < MIN_WAVE_SPEED) | (speed > MAX_WAVE_SPEED))
    if len(odd) and not notes:
        notes.append(
            f"stiffness and mass of {elements(odd)}: waves run along them at {speed[odd[0]]:.4g} m/s, in "
            "steel at 5000 m/s; stiffness is in N, mass_per_length in kg/m: were kN, or g/m, meant?"
        )
    weak = np.flatnonzero(net.breaking_load < MIN_BREAKING_STRAIN * net.EA)
    for e in weak[:1]:
        notes.append(
            f"breaking_load = {net.breaking_load[e]:g} N of {elements(weak)} is a strain of "
            f"{net.breaking_load[e] / net.EA[e]:.2g}, at which no cable breaks; was kN meant?"
        )
    size = float(np.ptp(net.x, axis=0).max())
    if not MIN_PLAUSIBLE_EXTENT <= size <= WIDEST:
        notes.append(f"the net is {size:.4g} m from end to end; [net] unit is that of the coordinates")
    strain = np.abs(net.prestress / net.EA).max()
    if 0.0 < strain < MIN_PRESTRESS_STRAIN and not notes:
        most = np.abs(net.prestress).max()
        notes.append(f"prestress of up to {most:g} N is a strain of {strain:.2g} at most; was kN meant?")
    return notes


def load_notes(job: Job) -> Iterator[str]:
    """Yield a note for each load, wind, factor or damping of a size that no roof has."""
    for section, key, unit, low, high, example in LOAD_RANGES:
        given = [value for value in job.values(section, key) if value is not None and np.any(value)]
        for value in [value for value in given if not low <= np.abs(value).max() <= high][:1]:
            yield f"{f'{key} = {format_value(value)} {unit}'.strip()} is far from what roofs have: {example}"
    for combination in job.combinations:
        for name, factor in combination.factors.items():
            if abs(factor) > MAX_PLAUSIBLE_FACTOR:
                text = f"factors: {name} = {factor:g} is far from what codes have, 0 to 2"
                yield f'[[combination]] "{combination.name}": {text}'
    if job.dynamics and job.dynamics.mass_damping > MAX_PLAUSIBLE_DAMPING:
        yield (
            f"[dynamics] mass_damping = {job.dynamics.mass_damping:g} 1/s is far from what roofs have: it is "
            "mass_damping x period / 4 pi of the critical damping; netfall check has it in each mode"
        )


def table_notes(
    job: Job, coefficient: np.ndarray | None, measured: TableHistory | None, cases: dict[str, Any]
) -> Iterator[str]:
    """Yield a note for each table of wind or pressure of a size that no roof has.

    Arguments as in `layout.Layout`.
    """
    wind, tables = job.wind, []
    if wind and wind.sectors:
        tables.append(("pressure_coefficient", wind.sectors, coefficient))
    if measured:
        end = min(job.dynamics.duration, measured.time[min(SAMPLED_ROWS, len(measured.time) - 1)])
        values = measured.until(end)[1]
        tables.append(("pressure" if wind.taps else "speed", wind.pressures or wind.file, values))
    for name, case in cases.items():
        if case.pressure is not None:
            tables.append(("pressure", f"[[case]] {name}: pressure_table", case.pressure))
    for key, table, values in tables:
        _, _, unit, low, high, example = next(row for row in LOAD_RANGES if row[1] == key)
        value = float(np.abs(values).max())
        if value and not low <= value <= high:
            text = f"{key} of up to {value:.4g} {unit}".strip()
            yield f"{table}: {text} is far from what roofs have: {example}"
    if measured and len(measured.time) > 1 and measured.time[1] >= job.dynamics.duration:
        problem = f"no row between 0 and the duration, {job.dynamics.duration:g} s"
        yield f"{wind.pressures or wind.file}: {problem}: time is in seconds"


def weight_notes(job: Job, net: Net) -> list[str]:
    """Return notes on nodes with weight but no mass, mass but no weight, or an implausible ratio."""
    down, heavy, free = net.load[:, 2] < 0.0, net.mass > 0.0, ~net.fixed[:, 2]
    if job.dynamics is None:
        return []

    def nodes(rows: BoolArray) -> str:
        return counted("node", net.node_id[rows])

    def weight(rows: BoolArray) -> float:
        return -float(net.load[rows, 2].sum())

    notes, massless, weightless, both = [], down & ~heavy & free, heavy & ~down & free, down & heavy & free
    if massless.any():
        notes.append(
            f"column load_z of {nodes(massless)}: {weight(massless):.4g} N downward without mass: loads of "
            "nodes have no inertia; of weights, column mass has to have theirs, "
            f"{weight(massless) / GRAVITY:.4g} kg in all, or periods come out too short"
        )
    if weightless.any() and job.load and (job.load.self_weight or job.load.dead):
        mass = float(net.mass[weightless].sum())
        notes.append(
            f"column mass of {nodes(weightless)}: {mass:.4g} kg without weight: self_weight is that of "
            f"elements; if it hangs there, column load_z has to have -{mass * GRAVITY:.4g} N in all"
        )
    mass = float(net.mass[both].sum())
    if (
        both.any()
        and not mass * GRAVITY / MAX_WEIGHT_RATIO <= weight(both) <= mass * GRAVITY * MAX_WEIGHT_RATIO
    ):
        notes.append(
            f"columns load_z and mass of {nodes(both)}: {weight(both):.4g} N downward with {mass:.4g} kg, "
            f"which weigh {mass * GRAVITY:.4g} N; loads are in N, masses in kg: was kN or t meant?"
        )
    return notes


def strain_notes(net: Net, eps: np.ndarray) -> Iterator[str]:
    """Yield notes on strains eps (m,) at the start that no net is built with."""
    for outside, state, limit in (
        (eps > MAX_START_STRAIN, "stretched", MAX_START_STRAIN),
        (eps < MIN_START_STRAIN, "compressed or slack", -MIN_START_STRAIN),
    ):
        if outside.any():
            e = int(np.argmax(np.where(outside, np.abs(eps), 0.0)))
            yield (
                f"{int(outside.sum())} elements start {state} by more than {limit:.0%} of their unstressed "
                f"length, the most is element {net.element_id[e]} with a strain of {eps[e]:.3g}; {UNITS_HINT}"
            )


def check_initial_strains(job: Job, net: Net, N: np.ndarray, L: np.ndarray, L0: np.ndarray) -> list[str]:
    """Check the strains of elements of unstressed length L0 at lengths L (m,) [m] and forces N (m,) [N].

    Returns notes. Raises InputError if elements yield or break at the start.
    """
    eps = strains(L, L0, job.cable.strain_measure)
    errors = []
    for exceeds, name, value, limit in (
        (eps > net.fracture_strain, "fracture_strain", eps, net.fracture_strain),
        (np.abs(N) > net.yield_force, "yield force [N]", N, net.yield_force),
    ):
        ids = net.element_id[exceeds]
        for e in np.flatnonzero(exceeds)[:1]:
            errors.append(
                f"{job.path}: {counted('element', ids)} start{'s' * (len(np.unique(ids)) == 1)} beyond "
                f"{name}: {value[e]:.4g} in element {describe_element(net, e, L0)} at a length of "
                f"{L[e]:.6g} m, "
                f"allowed {limit[e]:.4g}, with EA = {net.EA[e]:.4g} N; {UNITS_HINT}"
            )
    raise_errors(errors)
    return [*strain_notes(net, eps), *_subdivided_bar_notes(net, N)]


def describe_element(net: Net, e: int, L0: np.ndarray) -> str:
    """Name an element by its id, the ids of its nodes and its length; L0 : (m,) [m], unstressed lengths."""
    ids = "-".join(str(net.node_id[p]) for p in net.elements[e])
    return f"{net.element_id[e]} (nodes {ids}, {L0[e]:.4g} m)"


def low_node_notes(job: Job, net: Net, x: np.ndarray, wind: np.ndarray) -> Iterator[str]:
    """Yield a note on nodes below or so near the ground that the wind profile does not reach them.

    x : (n, 3) [m]; wind : (n, 3) [N s2/m2] force at 1 m/s
    """
    height = x[:, 2] + job.wind.base_height
    low = np.flatnonzero((height < LOWEST_HEIGHT) & wind.any(1) & ~net.fixed.all(1))
    if not job.wind.pressures and len(low):
        p = low[np.argmin(height[low])]
        yield (
            f"[wind] base_height = {job.wind.base_height:g}: {len(low)} nodes in the wind are less than "
            f"{LOWEST_HEIGHT:g} m above ground, the lowest is node {net.node_id[p]} at {height[p]:.4g} m; "
            f"they get the speed at {LOWEST_HEIGHT:g} m (base_height is the height of z = 0 above ground)"
        )


def point_notes(key: str, what: str, net: Net, places: np.ndarray | None, axes: int = 2) -> Iterator[str]:
    """Yield notes on points far outside the given roof, and on nodes with five or more nearest points.

    places : (c, 2 or 3) [m], None: none; what : noun for the points of key; axes : as in `point_weights`
    """
    if places is None:
        return
    x, y, free = net.x[:, :2], places[:, :2], np.flatnonzero(~net.fixed.all(1))
    low, high = x.min(0), x.max(0)
    outside, size = lengths(np.maximum(0.0, np.maximum(low - y, y - high))), lengths(high - low)
    far = np.flatnonzero(outside > FAR * size)
    if len(far):
        k = far[np.argmax(outside[far])]
        yield (
            f"{key}: {len(far)} of {len(places)} {what} lie far outside the roof, the farthest at x, y = "
            f"{y[k, 0]:g}, {y[k, 1]:g} m by {outside[k]:.4g} m, the net from {low[0]:g}, {low[1]:g} to "
            f"{high[0]:g}, {high[1]:g} m: x and y are in metres, in the axes of the net, whatever [net] unit "
            "is"
        )
    rows = free[ambiguous_particles(net.x[free], places, axes)] if len(free) else free
    if len(rows):
        yield (
            f"{key}: {counted('node', net.node_id[rows])}: five or more {what} are as near, of which four "
            "count, by their order in the table; another one there says what holds"
        )


def _subdivided_bar_notes(net: Net, N: np.ndarray) -> Iterator[str]:
    """Yield a note on subdivided bars compressed by N (m,) [N]: nothing keeps their inner nodes in line."""
    hinged = np.ones(net.m, bool) if net.bending is None else ~net.bending
    rows = np.flatnonzero((N < 0.0) & hinged & (net.parts > 1))[:: net.parts]
    if len(rows):
        yield (
            f"[net] subdivide cuts {counted('element', net.element_id[rows])} in parts, compressed bars "
            "without bending stiffness, which buckle at the nodes between them; subdivide = 1 leaves them "
            "whole"
        )


def check_tensions(job: Job, net: Net, N: np.ndarray, L: np.ndarray) -> None:
    """Check axial forces N (m,) [N] at lengths L (m,) [m].

    Raises InputError for forces that no element can have.
    """
    yield_force, EA = net.yield_force, net.EA
    euler = caps_of(yield_force, euler_load(net, L), net.buckling, net.bending).buckling
    compressed = (N < -ROUNDING * np.abs(N).max(initial=0.0)) & ~net.bar
    checks = (
        (compressed, N, ': a cable carries no compression; give its group kind = "bar"'),
        (
            np.abs(N) > yield_force,
            yield_force,
            ", above the yield force {}; lower the prestress or choose a larger area",
        ),
        (N < -euler, euler, ", beyond Euler's load {}; choose a stiffer section"),
        (
            N > net.breaking_load,
            net.breaking_load,
            ", above the breaking load {}; lower the prestress or choose a stronger cable",
        ),
    )
    errors = [
        f"{job.path}: element {net.element_id[e]}: its axial force is {kN(N[e])} in the initial state"
        + remedy.format(kN(limit[e]))
        for exceeds, limit, remedy in checks
        for e in np.flatnonzero(exceeds)[:1]
    ]
    for e in np.flatnonzero(exceeds_stiffness(N, EA, job.cable.strain_measure))[:1]:
        problem = f"its axial force {kN(N[e])} is beyond its stiffness EA; choose a larger area"
        errors.append(f"{job.path}: element {net.element_id[e]}: {problem}")
    relative = L / net.lengths()
    if not relative.min() > COLLAPSED_LENGTH_RATIO:
        e = int(np.argmin(relative))
        ids = "-".join(map(str, net.node_id[net.elements[e]]))
        errors.append(
            f"{job.path}: [form_finding]: the form has collapsed: element {net.element_id[e]} (nodes {ids}) "
            f"is {L[e]:.3g} m long in it, {net.lengths()[e]:.4g} m as given; fix more nodes, or give "
            "prestresses or force densities that hold the free ones apart"
        )
    raise_errors(errors)
