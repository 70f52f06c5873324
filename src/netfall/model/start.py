"""Plausibility checks of the start of a job: elements that fail at once, and values in another unit."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from netfall.core.arrays import BoolArray, FloatArray, IntArray
from netfall.core.errors import raise_errors
from netfall.core.functions import lengths
from netfall.geometry.bars import euler_load
from netfall.geometry.net import GRAVITY, Net
from netfall.job import messages as job_messages
from netfall.job.derived import mode_count
from netfall.job.job import Job
from netfall.job.values import counted, format_value
from netfall.loads.wind.measured import TableHistory, ambiguous_particles
from netfall.model import messages
from netfall.physics.law.measures import caps_of, exceeds_stiffness, strains
from netfall.physics.wind_spectra import LOWEST_HEIGHT

# Column of the net, its key, unit, plausible range for cables, and an example in that unit.
SECTION_RANGES = (
    ("modulus", "modulus", "Pa", 1e6, 2e12, "Steel has 2e11 Pa. Check for GPa or N/mm2."),
    ("section", "area", "m2", 1e-9, 1.0, "A rope of 20 mm has 3e-4 m2. Check for mm2 or cm2."),
    ("density", "density", "kg/m3", 100.0, 25e3, "Steel has 7850 kg/m3. Check for g/cm3 or t/m3."),
    ("yield_stress", "yield_stress", "Pa", 1e6, 1e11, "Cable steel has 1.5e9 Pa. Check for N/mm2."),
    ("fracture_strain", "fracture_strain", "", 1e-6, 1.0, "Write 4 % as 0.04."),
    ("diameter", "diameter", "m", 1e-3, 5.0, "A rope of 20 mm has 0.02 m. Check for mm."),
)
# smallest plausible ratio of a cable's diameter to that of a solid circle of its area; 16 parallel ropes
MIN_DIAMETER_RATIO = 0.25
# Plausible ranges of bars, if they differ from those of cables.
BAR_RANGES = {"section": (1e-6, 50.0, "A tube of 200 mm has 6e-3 m2. Check for mm2 or cm2.")}
MATERIAL_COLUMNS = ("modulus", "section", "density")  # nominal elements derive them from their stiffness
# Section, key (also in zones, cases and stages), unit, range plausible for roofs, and an example.
LOAD_RANGES = (
    ("load", "dead", "N/m2", 5.0, 2e4, "Cladding weighs 10 to 3000 N/m2. Check for kN/m2 or kg/m2."),
    ("load", "snow", "N/m2", 20.0, 5e4, "Codes give 300 to 10000 N/m2. Check for kN/m2."),
    ("load", "ice", "m", 1e-3, 0.3, "Codes give 5 to 100 mm. Check for mm."),
    ("load", "pressure", "N/m2", 5.0, 5e4, "Storms press with 300 to 5000 N/m2. Check for kN/m2."),
    ("load", "temperature", "K", 0.0, 150.0, "Give the change from the temperature of form finding."),
    ("load", "added_mass", "kg/m2", 0.0, 1e3, "The air that moves with a roof has 10 to 100 kg/m2."),
    ("wind", "speed", "m/s", 0.0, 90.0, "The mean speed of storms at 10 m is up to 70 m/s. Check for km/h."),
    ("wind", "pressure_coefficient", "", 0.0, 20.0, "Codes give -4 to 2. Check for a pressure."),
    ("wind", "air_density", "kg/m3", 0.5, 2.0, "Air has 1.25 kg/m3."),
)
SAMPLED_ROWS = 1000  # rows of a time table that suffice to judge its magnitude
# 1/s: largest plausible [dynamics] mass_damping; it halves a velocity in 1 / 29 s
MAX_PLAUSIBLE_DAMPING = 20.0
MAX_PLAUSIBLE_FACTOR = 10.0  # largest plausible factor of a combination
MAX_SETTLEMENT = 1.0  # m: largest plausible settlement of a support
WIDEST, MIN_PLAUSIBLE_EXTENT = 3e3, 0.3  # m: plausible extents of nets
# largest plausible ratio of the weight of nodes to the weight of their mass, or its inverse
MAX_WEIGHT_RATIO = 100.0
MIN_BREAKING_STRAIN, MAX_BREAKING_STRAIN = 1e-4, 1.0  # plausible strains at the breaking force
# m/s: plausible speeds of axial waves, sqrt(E / rho); steel has some 5000
MIN_WAVE_SPEED, MAX_WAVE_SPEED = 400.0, 20e3
MIN_PRESTRESS_STRAIN = 3e-6  # smallest plausible strain of the most tensioned element of a prestressed net
MIN_START_STRAIN, MAX_START_STRAIN = -0.5, 0.1  # plausible strains at the start
MAX_LOWEST_HEIGHT = 200.0  # m above ground: range of EN 1991-1-4; the lowest node of a roof or mast is below
MAX_DISTANCE = 3.0  # diagonals of the roof in plan: taps and points beyond that are probably in another unit
NEGLIGIBLE_FORCE = 1e-10  # share of the largest force below which a force counts as zero
# share of its given length below which an element has collapsed in form finding
COLLAPSED_LENGTH_RATIO = 1e-6


def unit_notes(net: Net) -> list[str]:
    """Return a warning for each section value that is implausible for a cable or bar."""

    def elements(rows: IntArray) -> str:
        return counted("element", net.element_id[rows])

    notes, breaking_strain = [], net.breaking_load / net.EA
    for column, key, unit, *of_cables in SECTION_RANGES:
        given = ~net.nominal if column in MATERIAL_COLUMNS else np.ones(net.m, bool)
        given &= (column != "fracture_strain") | (net.fracture_strain != breaking_strain)
        for kind, of_kind in (("cables", ~net.bar), ("bars", net.bar)):
            low, high, example = BAR_RANGES.get(column, of_cables) if kind == "bars" else of_cables
            values = np.asarray(0.0 if getattr(net, column) is None else getattr(net, column))
            is_given = given & of_kind & np.isfinite(values) & (values != 0.0)  # zero means no diameter
            odd = np.flatnonzero(is_given & ((values < low) | (values > high)))
            if len(odd):
                value = f"{key} = {values[odd[0]]:g} {unit}".strip()
                notes.append(
                    messages.IMPLAUSIBLE_SECTION(
                        value=value, elements=elements(odd), kind=kind, low=low, high=high, example=example
                    )
                )
    diameter = np.zeros(net.m) if net.diameter is None else net.diameter
    solid = np.sqrt(4.0 * net.section / np.pi)
    is_rope = ~net.nominal & ~net.bar & (diameter > 0.0)
    odd = np.flatnonzero(is_rope & (diameter < MIN_DIAMETER_RATIO * solid))
    for e in odd[:1]:
        value, kind = f"diameter = {diameter[e]:g} m", f"cables of {net.section[e]:g} m2"
        low, example, rows = solid[e], "A solid rod has the smaller value. Check for mm.", elements(odd)
        notes.append(
            messages.IMPLAUSIBLE_SECTION(
                value=value, elements=rows, kind=kind, low=low, high=5.0, example=example
            )
        )
    speed = np.sqrt(net.modulus / net.density)
    odd = np.flatnonzero((speed < MIN_WAVE_SPEED) | (speed > MAX_WAVE_SPEED))
    if len(odd) and not notes:
        notes.append(messages.IMPLAUSIBLE_WAVE_SPEED(elements=elements(odd), speed=speed[odd[0]]))
    strong = np.isfinite(breaking_strain) & (breaking_strain > MAX_BREAKING_STRAIN)
    odd = np.flatnonzero((breaking_strain < MIN_BREAKING_STRAIN) | strong)
    for e in odd[:1]:
        load, strain = net.breaking_load[e], breaking_strain[e]
        notes.append(messages.IMPLAUSIBLE_BREAKING_STRAIN(load=load, elements=elements(odd), strain=strain))
    size = float(np.ptp(net.x, axis=0).max())
    if not MIN_PLAUSIBLE_EXTENT <= size <= WIDEST:
        notes.append(messages.IMPLAUSIBLE_EXTENT(size=size, low=MIN_PLAUSIBLE_EXTENT, high=WIDEST))
    strain = np.abs(net.prestress / net.EA).max()
    if 0.0 < strain < MIN_PRESTRESS_STRAIN and not notes:
        force = np.abs(net.prestress).max()
        notes.append(messages.LOW_PRESTRESS(force=force, strain=strain, limit=MIN_PRESTRESS_STRAIN))
    return notes


def load_notes(job: Job) -> Iterator[str]:
    """Yield a warning for each load, settlement, factor or damping that is implausible for a roof."""
    for section, key, unit, low, high, example in LOAD_RANGES:
        given = [value for value in job.values(section, key) if value is not None and np.any(value)]
        for value in [value for value in given if not low <= np.abs(value).max() <= high][:1]:
            text = f"{section}.{key} = {format_value(value)} {unit}".strip()
            yield messages.IMPLAUSIBLE_LOAD(value=text, low=low, high=high, example=example)
    for case in job.cases:
        settled = max((abs(part) for shift in case.settlement.values() for part in shift), default=0.0)
        if settled > MAX_SETTLEMENT:
            text = f"[[case]] {case.name}: settlement of up to {settled:g} m"
            yield messages.IMPLAUSIBLE_LOAD(
                value=text,
                low=0.0,
                high=MAX_SETTLEMENT,
                example="Supports settle by millimetres. Check for mm.",
            )
    for combination in job.combinations:
        for name, factor in combination.factors.items():
            if abs(factor) > MAX_PLAUSIBLE_FACTOR:
                label = combination.name
                yield messages.IMPLAUSIBLE_FACTOR(combination=label, name=name, factor=factor)
    if job.dynamics and job.dynamics.mass_damping > MAX_PLAUSIBLE_DAMPING:
        damping = job.dynamics.mass_damping
        yield messages.HIGH_MASS_DAMPING(damping=damping, limit=MAX_PLAUSIBLE_DAMPING)


def table_notes(
    job: Job, coefficient: np.ndarray | None, measured: TableHistory | None, cases: dict[str, Any]
) -> Iterator[str]:
    """Yield a warning for each table of wind or pressure with implausible values.

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
            yield messages.IMPLAUSIBLE_TABLE(table=table, value=text, low=low, high=high, example=example)
    if measured and len(measured.time) > 1 and measured.time[1] >= job.dynamics.duration:
        table = wind.pressures or wind.file
        yield messages.NO_ROW_IN_DURATION(table=table, duration=job.dynamics.duration)


def weight_notes(job: Job, net: Net, load: FloatArray) -> Iterator[str]:
    """Yield warnings on nodes with weight but no mass, mass but no weight, or an implausible ratio.

    load : (n, 3) [N] of the nodes
    """
    down, heavy, free = load[:, 2] < 0.0, net.mass > 0.0, ~net.fixed[:, 2]
    if not (job.dynamics or mode_count(job)):
        return

    def nodes(rows: BoolArray) -> str:
        return counted("node", net.node_id[rows])

    def weight(rows: BoolArray) -> float:
        return -float(load[rows, 2].sum())

    massless, weightless, both = down & ~heavy & free, heavy & ~down & free, down & heavy & free
    if massless.any():
        yield messages.LOAD_WITHOUT_MASS(
            nodes=nodes(massless), weight=weight(massless), mass=weight(massless) / GRAVITY
        )
    if weightless.any() and job.load and (job.load.self_weight or job.load.dead):
        mass = float(net.mass[weightless].sum())
        yield messages.MASS_WITHOUT_LOAD(nodes=nodes(weightless), mass=mass, weight=mass * GRAVITY)
    mass = float(net.mass[both].sum())
    if (
        both.any()
        and not mass * GRAVITY / MAX_WEIGHT_RATIO <= weight(both) <= mass * GRAVITY * MAX_WEIGHT_RATIO
    ):
        yield messages.IMPLAUSIBLE_WEIGHT(
            nodes=nodes(both), load=weight(both), mass=mass, weight=mass * GRAVITY
        )


def start_notes(net: Net, eps: np.ndarray, N: np.ndarray) -> Iterator[str]:
    """Yield warnings on implausible strains eps (m,) at the start.

    N (m,) [N] shows which subdivided bars are compressed; their inner nodes are not held.
    """
    for outside, state, limit in (
        (eps > MAX_START_STRAIN, "stretched", MAX_START_STRAIN),
        (eps < MIN_START_STRAIN, "compressed or slack", -MIN_START_STRAIN),
    ):
        if outside.any():
            e = int(np.argmax(np.where(outside, np.abs(eps), 0.0)))
            yield messages.START_STRAIN(
                count=int(outside.sum()), state=state, limit=limit, element=net.element_id[e], strain=eps[e]
            )
    hinged = np.ones(net.m, bool) if net.bending is None else ~net.bending
    rows = np.flatnonzero((N < 0.0) & hinged & (net.parts > 1))[:: net.parts]
    if len(rows):
        yield messages.SUBDIVIDED_BARS(elements=counted("element", net.element_id[rows]))


def check_initial_strains(job: Job, net: Net, N: np.ndarray, L: np.ndarray, L0: np.ndarray) -> list[str]:
    """Check the strains of elements of unstressed length L0 at lengths L (m,) [m] and forces N (m,) [N].

    Returns warnings. Raises InputError if elements yield or break at the start.
    """
    eps = strains(L, L0, job.cable.strain_measure)
    errors = []
    for exceeds, name, value, limit in (
        (eps > net.fracture_strain, "fracture_strain", eps, net.fracture_strain),
        (np.abs(N) > net.yield_force, "yield force [N]", N, net.yield_force),
    ):
        for e in np.flatnonzero(exceeds)[:1]:
            errors.append(
                messages.STARTS_BEYOND_LIMIT(
                    path=job.path,
                    elements=counted("element", net.element_id[exceeds]),
                    name=name,
                    value=value[e],
                    element=describe_element(net, e, L0),
                    length=L[e],
                    limit=limit[e],
                    stiffness=net.EA[e],
                )
            )
    raise_errors(errors)
    return list(start_notes(net, eps, N))


def describe_element(net: Net, e: int, L0: np.ndarray) -> str:
    """Name an element by its id, the ids of its nodes and its length; L0 : (m,) [m], unstressed lengths."""
    ids = "-".join(str(net.node_id[p]) for p in net.elements[e])
    return f"{net.element_id[e]} (nodes {ids}, {L0[e]:.4g} m)"


def wind_height_notes(net: Net, x: np.ndarray, winds: dict[str, tuple[Any, FloatArray]]) -> Iterator[str]:
    """Yield a warning on nodes below the range of the wind profile, or if all nodes are far above ground.

    x : (n, 3) [m]; winds : section and force (n, 3) [N s2/m2] at 1 m/s, by their place in the job; of
        those with the same base_height the first is named
    """
    named = set()
    for place, (wind, force) in winds.items():
        height = x[:, 2] + wind.base_height
        height = np.where(force.any(1) & ~net.fixed.all(1), height, np.inf)
        p, count = int(np.argmin(height)), int((height < LOWEST_HEIGHT).sum())
        is_high = MAX_LOWEST_HEIGHT < height[p] < np.inf
        if not (count or is_high) or not wind.profile_exponent or wind.pressures or wind.base_height in named:
            continue
        named.add(wind.base_height)
        base, node, lowest = wind.base_height, net.node_id[p], height[p]
        if is_high:
            yield job_messages.LARGE_BASE_HEIGHT(
                place=place, base_height=base, limit=MAX_LOWEST_HEIGHT, node=node, height=lowest
            )
        else:
            yield messages.BELOW_WIND_PROFILE(
                place=place, base_height=base, count=count, node=node, height=lowest, lowest=LOWEST_HEIGHT
            )


def point_notes(key: str, what: str, net: Net, places: np.ndarray | None, axes: int = 2) -> Iterator[str]:
    """Yield warnings on points far outside the given roof, and on nodes with five or more nearest points.

    places : (c, 2 or 3) [m], None: none; what : noun for the points of key; axes : as in `point_weights`
    """
    if places is None:
        return
    x, y, free = net.x[:, :2], places[:, :2], np.flatnonzero(~net.fixed.all(1))
    low, high = x.min(0), x.max(0)
    outside, size = lengths(np.maximum(0.0, np.maximum(low - y, y - high))), lengths(high - low)
    far = np.flatnonzero(outside > MAX_DISTANCE * size)
    if len(far):
        k = far[np.argmax(outside[far])]
        yield messages.FAR_POINTS(
            place=key,
            count=len(far),
            total=len(places),
            kind=what,
            x=y[k, 0],
            y=y[k, 1],
            distance=outside[k],
            low=f"{low[0]:g}, {low[1]:g}",
            high=f"{high[0]:g}, {high[1]:g}",
        )
    rows = free[ambiguous_particles(net.x[free], places, axes)] if len(free) else free
    if len(rows):
        nodes = counted("node", net.node_id[rows])
        yield messages.EQUALLY_NEAR_POINTS(place=key, nodes=nodes, kind=what)


def check_tensions(job: Job, net: Net, N: np.ndarray, L: np.ndarray) -> None:
    """Check axial forces N (m,) [N] at lengths L (m,) [m].

    Raises InputError for impossible forces.
    """
    yield_force, EA = net.yield_force, net.EA
    euler = caps_of(yield_force, euler_load(net, L), net.buckling, net.bending).buckling
    compressed = (N < -NEGLIGIBLE_FORCE * np.abs(N).max(initial=0.0)) & ~net.bar
    checks = (
        (compressed, N, messages.CABLE_COMPRESSED),
        (np.abs(N) > yield_force, yield_force, messages.ABOVE_YIELD_FORCE),
        (N < -euler, euler, messages.BEYOND_EULER_LOAD),
        (N > net.breaking_load, net.breaking_load, messages.ABOVE_BREAKING_FORCE),
        (exceeds_stiffness(N, EA, job.cable.strain_measure), EA, messages.BEYOND_STIFFNESS),
    )
    errors = [
        message(path=job.path, element=net.element_id[e], force=N[e], limit=limit[e])
        for exceeds, limit, message in checks
        for e in np.flatnonzero(exceeds)[:1]
    ]
    relative = L / net.lengths()
    if not relative.min() > COLLAPSED_LENGTH_RATIO:
        e = int(np.argmin(relative))
        ids = "-".join(map(str, net.node_id[net.elements[e]]))
        errors.append(
            messages.FORM_COLLAPSED(
                path=job.path, element=net.element_id[e], nodes=ids, length=L[e], given=net.lengths()[e]
            )
        )
    raise_errors(errors)
