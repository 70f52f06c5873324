"""Notes on given keys and columns that have no effect in a job."""

import difflib
from collections.abc import Iterator
from typing import Any

import numpy as np

from netfall.geometry.net import Net
from netfall.geometry.turned import is_rotated
from netfall.geometry.zones import RoofAreas, Zones, named_zones
from netfall.job import derived
from netfall.job.job import Job
from netfall.job.keys.entries import has_static_wind
from netfall.job.keys.groups import displacement_limits, group_values, is_pattern
from netfall.job.keys.schema import SECTIONS
from netfall.job.values import counted, format_value
from netfall.loads.wind.sectors import Sectors, describe_origin
from netfall.model import messages
from netfall.physics.wind_spectra import turbulence_intensity

# similarity (difflib) above which two names of groups probably mean the same group
GROUP_NAME_SIMILARITY = 0.8
MAX_UPRIGHT_SHARE = 1e-6  # area in plan over surface area [-] below which a roof counts as upright
GUST_KEYS = (
    *("time_step", "ar_order", "seed", "control_points", "gust_field", "coherence_decay", "spectrum"),
    "gust_length",
)


def without_effect(job: Job, net: Net) -> list[str]:
    """Return a note for each given key of the job file, or column of a table, without effect."""
    given = job.given()
    notes = []
    for section, keys, idle, why in _unused_keys(job, net):
        idle_keys = [key for key in keys if f"{section}.{key}" in given]
        if idle and idle_keys:
            keys_text = ", ".join(idle_keys)
            notes.append(messages.KEYS_WITHOUT_EFFECT(section=section, keys=keys_text, reason=why))
    notes += [*_unused_section_notes(job, net, given), *_unused_column_notes(job, net)]
    notes += _slender_notes(job) if net.diameter is not None else []
    return [*notes, *_misspelt_group_notes(job, net)]


def _unused_keys(job: Job, net: Net) -> Iterator[tuple[Any, ...]]:
    """Yield rows of: section, keys, whether they have no effect, and the reason."""
    breaks, form, load = bool(np.isfinite(net.fracture_strain).any()), job.form_finding, job.load
    yield from _unused_dynamics_keys(job, breaks)
    if job.net.generator in ("wheel", "dome"):
        reason = f"the generator {job.net.generator} computes the prestress of its equilibrium"
        yield "cable", ("prestress",), True, reason
    yield from _unused_load_keys(job, net, breaks) if load else ()
    if limits := job.limits:
        shares = any(isinstance(table.displacement, str) for table in (limits, *limits.group.values()))
        limited = bool(displacement_limits(limits, net.group_names))
        yield "limits", ("span", "from"), not limited, "no displacement is limited"
        yield "limits", ("span",), limited and not shares, "no displacement is a share of it"
    if form:
        linear = f'method = "{form.method}" is one linear solve'
        weightless = not (load and load.self_weight) and not any(job.loads("dead"))
        none = "there is neither self weight nor dead load"
        yield "form_finding", ("start", "modulus_factor", "max_iterations"), form.method != "fpm", linear
        yield "form_finding", ("loads",), derived.carries_permanent(job) and weightless, none
    yield from _unused_wind_keys(job, breaks) if job.wind else ()
    bare = not (form or derived.has_area_loads(job))
    why = "neither wind nor dead load nor pressure acts on the roof"
    yield "roof", ("groups", "openings", "lines"), bare, why


def _unused_dynamics_keys(job: Job, breaks: bool) -> list[tuple[Any, ...]]:
    """List the rows of [output] and [dynamics]; breaks : whether any element can break."""
    dynamics, of_motion = job.dynamics, [key.name for key in SECTIONS["output"] if key.name != "modes"]
    if not dynamics:
        return [("output", of_motion, True, "there is no [dynamics]")]
    no_fragments, late = not dynamics.fragments, job.output.checkpoint_interval >= dynamics.duration
    fixed = dynamics.time_step != "auto" and (no_fragments or not breaks)
    why = "with fragments = false no fragments form"
    return [
        ("output", ("checkpoint_interval",), late, "it is not shorter than the duration"),
        ("dynamics", ("safety",), fixed, "time_step is fixed"),
        ("dynamics", ("fragment_mass", "fragments"), not breaks, "nothing can break"),
        ("dynamics", ("fragment_mass",), breaks and no_fragments, why),
    ]


def _unused_load_keys(job: Job, net: Net, breaks: bool) -> list[tuple[Any, ...]]:
    """List the rows of [load]; breaks : whether any element can break."""
    builds_up = job.targets or job.stages or net.length_error.any()
    no_statics = job.dynamics and not derived.has_statics(job) and not builds_up
    no_inertia = not (job.dynamics or derived.mode_count(job))
    has_loads = derived.has_load_cases(job) or builds_up
    reason = "the pressure grows only in a dynamic stage without load steps"
    return [
        ("load", ("tolerance", "max_iterations"), no_statics, "with steps = 0 there is no statics"),
        ("load", ("stop_at_strength",), not breaks, "nothing can break"),
        ("load", ("stop_at_strength",), breaks and not has_loads, "there is no case and no load step"),
        ("load", ("added_mass",), no_inertia, "it is inertia, and there is neither [dynamics] nor a mode"),
        ("load", ("ramp",), not derived.has_growing_pressure(job), reason),
    ]


def _unused_wind_keys(job: Job, breaks: bool) -> list[tuple[Any, ...]]:
    """List the rows of [wind]; breaks : whether any element can break."""
    wind, by_taps = job.wind, "the wind comes from pressures"
    generated = wind.speed and not wind.pressures
    source = f"the wind comes from {'file' if wind.file else 'pressures'}"
    of_generator = ("surface_drag", "turbulence_intensity", *GUST_KEYS)
    of_speed = ("air_density", "direction", "profile_exponent", "base_height")
    zero_key = "surface_drag" if wind.turbulence_intensity is None else "turbulence_intensity"
    no_gusts = generated and turbulence_intensity(wind) == 0
    detaches, sudden = breaks or bool(job.removes), wind.onset == "sudden"
    drag = detaches and derived.has_fragment_drag(job)
    needs_speed = derived.has_aerodynamic_damping(job) or drag
    return [
        ("wind", of_generator, not generated, source),
        ("wind", of_speed, wind.pressures and not needs_speed, by_taps),
        ("wind", ("direction",), wind.pressures and needs_speed and not drag, by_taps),
        ("wind", (*GUST_KEYS, "ramp"), no_gusts, f"with {zero_key} = 0 there are no gusts"),
        ("wind", ("after_fracture",), not detaches, "nothing can break"),
        ("wind", ("ramp",), sudden and not no_gusts, 'with onset = "sudden" the gusts do not grow'),
    ]


def _unused_section_notes(job: Job, net: Net, given: set[str]) -> Iterator[str]:
    """Yield notes on whole sections without effect."""
    load, wind, on_roof = job.load, job.wind, derived.has_area_loads(job)
    if job.net.wheel and job.net.wheel.hoop_force and not job.net.wheel.hoops:
        reason = "with hoops = 0 there are none"
        yield messages.KEYS_WITHOUT_EFFECT(section="net.wheel", keys="hoop_force", reason=reason)
    if job.limits and not any(combination.kind == "SLS" for combination in job.combinations):
        yield messages.LIMITS_NOT_CHECKED()
    for number, entry in enumerate(job.removes, 1):
        if entry.time >= job.dynamics.duration:
            duration = job.dynamics.duration
            yield messages.REMOVAL_AFTER_END(number=number, time=entry.time, duration=duration)
    is_applied = derived.has_statics(job) or job.dynamics or job.stages or derived.carries_permanent(job)
    if load and not is_applied:
        yield messages.LOAD_NOT_APPLIED()
    acts = load and (load.self_weight or load.ice or load.temperature or load.load_table)
    loaded = on_roof or wind or acts or net.load.any() or job.removes
    breaks = bool(np.isfinite(net.fracture_strain).any())
    if job.dynamics and breaks and not loaded:
        yield messages.NOTHING_LOADS()
    moves_air = wind and (
        derived.has_aerodynamic_damping(job) or (derived.has_fragment_drag(job) and (breaks or job.removes))
    )
    of_zones = wind and any(any(zone.given().values()) for zone in wind.zone.values())
    acts_elsewhere = moves_air or of_zones or net.diameter is not None
    if wind and wind.pressure_coefficient == 0 and not acts_elsewhere:
        yield messages.WIND_WITHOUT_EFFECT()
    if wind and wind.pressure_coefficient and "wind.direction" in given:
        origin = describe_origin(wind.direction)
        yield messages.DIRECTION_IGNORED(direction=wind.direction, origin=origin)


def _slender_notes(job: Job) -> Iterator[str]:
    """Yield a warning if no wind acts on elements with a diameter, or a note if nothing acts on them."""
    if job.wind and job.wind.pressures:
        yield messages.NO_WIND_ON_DIAMETERS()
    elif not (job.wind or any(job.loads("ice")) or any(map(has_static_wind, job.cases))):
        yield messages.UNUSED_DIAMETER()


def _misspelt_group_notes(job: Job, net: Net) -> list[str]:
    """Return a warning on groups of a table that use [cable] although a section has a similar name."""
    if job.net.generator:
        return []
    sections = {name.lower(): name for name in reversed(job.groups) if not is_pattern(name)}
    similar = {}
    for name in net.group_names:
        close = difflib.get_close_matches(name.lower(), sections, 1, GROUP_NAME_SIMILARITY)
        if name and not group_values(job.groups, name) and name not in job.groups and close:
            similar[name] = f"[group.{sections[close[0]]}]"
    if not similar:
        return []
    groups = counted("group", np.array([format_value(name) for name in similar]))
    return [messages.MISSPELT_GROUPS(groups=groups, sections=" or ".join(dict.fromkeys(similar.values())))]


def unused_zone_notes(job: Job, zones: Zones, tables: list[Sectors | None]) -> list[str]:
    """Return a note for each zone without values; tables : sectors of [wind] and of the cases."""
    named = {name for name, _ in named_zones(job)}.union(*(table.of_zone for table in tables if table))
    return [messages.UNUSED_ZONE(name=format_value(name)) for name in zones.names if name not in named]


def zone_without_area_notes(zones: Zones, area: np.ndarray) -> list[str]:
    """Return a warning for each zone whose nodes have no area of the roof; area : (n,) [m2] of surface."""
    return [
        messages.ZONE_WITHOUT_AREA(name=format_value(name))
        for name, share in zip(zones.names, zones.share.T)
        if share.any() and not (share * area).any()
    ]


def snow_on_upright_notes(job: Job, roof: RoofAreas) -> list[str]:
    """Return a note if snow acts on a roof without area in plan, as an upright one."""
    is_upright = roof.area.any() and roof.plan_area.sum() <= MAX_UPRIGHT_SHARE * roof.area.sum()
    return [messages.SNOW_ON_UPRIGHT(area=roof.area.sum())] if is_upright and any(job.loads("snow")) else []


def _unused_column_notes(job: Job, net: Net) -> Iterator[str]:
    """Yield notes on columns of the tables, and on the prestress, without effect."""
    form_finding, prestressed = job.form_finding, net.prestress.any()
    has_density = np.isfinite(net.force_density)
    if has_density.any() and not (
        form_finding and "force_density" in (form_finding.method, form_finding.start)
    ):
        yield messages.UNUSED_FORCE_DENSITY()
    if prestressed and form_finding and form_finding.method == "force_density" and has_density.all():
        yield messages.UNUSED_PRESTRESS(column="a force_density")
    if prestressed and np.isfinite(net.unstressed_length).all():
        yield messages.UNUSED_PRESTRESS(column="an unstressed_length")
    if net.load.any() and not job.dynamics and not derived.has_statics(job) and not job.stages:
        yield messages.NODE_LOADS_NOT_APPLIED()
    if net.mass.any() and not (job.dynamics or derived.mode_count(job)):
        yield messages.MASS_WITHOUT_DYNAMICS()
    elif (held := (net.mass > 0.0) & net.fixed.all(1)).any() and not any(s.release for s in job.stages):
        yield messages.MASS_ON_HELD_NODES(nodes=counted("node", net.node_id[held]))
    without_effect = 0 if net.angle is None else np.count_nonzero((net.angle != 0.0) & ~is_rotated(net))
    if without_effect:
        yield messages.UNUSED_ANGLE(count=without_effect)
    first_breaks = net.yield_stress >= net.fracture_strain * net.modulus
    breaks = derived.load_settings(job).stop_at_strength or not derived.has_load_cases(job)
    brittle = ~net.bar & np.isfinite(net.yield_stress) & first_breaks & breaks
    for e in np.flatnonzero(brittle)[:1]:
        count, element, fracture = int(brittle.sum()), net.element_id[e], net.fracture_strain[e]
        yielding = net.yield_stress[e] / net.modulus[e]
        yield messages.UNUSED_YIELD_STRESS(count=count, element=element, fracture=fracture, yielding=yielding)
