"""Properties that follow from the keys of a job: its stages, its loads, and whether anything can break."""

from netfall.job.job import Job
from netfall.job.keys.entries import Case, Combination, action_factor, has_static_wind, static_wind
from netfall.job.keys.models import Dynamics, Load, Wind


def carries_permanent(job: Job) -> bool:
    """Return whether the form-found geometry carries the permanent loads."""
    return job.form_finding is not None and job.form_finding.loads == "permanent"


def starts_in_mean_wind(job: Job) -> bool:
    """Return whether the dynamic stage starts from the equilibrium under the mean wind."""
    return job.wind is not None and job.wind.onset == "static"


def gust_ramp(job: Job) -> float:
    """Return the time [s] over which gusts grow in the dynamic stage; 0: they act from its start."""
    return job.wind.ramp if job.wind and starts_in_mean_wind(job) else 0.0


def starts_loaded_for_removal(job: Job) -> bool:
    """Return whether the dynamic stage starts from the loaded equilibrium: removals, but no wind."""
    return bool(job.removes and job.dynamics) and job.wind is None


def starts_in_form(job: Job) -> bool:
    """Return whether the dynamic stage starts from the form, in which the loads then act at once."""
    loaded = job.stages or load_steps(job) or starts_in_mean_wind(job) or starts_loaded_for_removal(job)
    return job.form_finding is not None and job.dynamics is not None and not loaded


def load_steps(job: Job) -> int:
    """Return the number of load steps: as given, otherwise 1 for a job without other uses of its loads.

    0 without [load].
    """
    if job.load is None:
        return 0
    if job.load.steps is None:
        return int(not (job.dynamics or job.cases or job.combinations))
    return job.load.steps


def has_statics(job: Job) -> bool:
    """Return whether equilibria are computed before the dynamic stage."""
    rests = starts_in_mean_wind(job) or starts_loaded_for_removal(job)
    return has_load_cases(job) or rests


def has_load_cases(job: Job) -> bool:
    """Return whether equilibria are computed in which an exceeded strength is only reported."""
    return bool(job.cases or job.combinations or load_steps(job))


def permanent_weight_factor(job: Job) -> float:
    """Return the factor of self weight in the permanent loads: 1, or 0 without self weight."""
    return float(bool(job.load and job.load.self_weight))


def has_growing_pressure(job: Job) -> bool:
    """Return whether the pressure of [load] grows in the dynamic stage."""
    load = job.load
    has_pressure = any(value is not None for value in job.loads("pressure"))
    return bool(job.dynamics and has_pressure and load and load.ramp and not load_steps(job))


def has_varying_forces(job: Job) -> bool:
    """Return whether forces other than those of the wind vary in the dynamic stage."""
    return has_growing_pressure(job) or any(entry.duration for entry in job.removes)


def has_carried_weight(job: Job) -> bool:
    """Return whether particles carry weight in addition to the elements: dead load, snow or ice."""
    load = job.load
    return load is not None and any([load.ice, *load.all_values("dead"), *load.all_values("snow")])


def has_aerodynamic_damping(job: Job) -> bool:
    """Return whether the air damps the motion of the roof."""
    return job.wind is not None and any(job.wind.all_values("aerodynamic_damping"))


def has_fragment_drag(job: Job) -> bool:
    """Return whether the relative wind drags detached fragments, which needs a known wind speed."""
    wind = job.wind
    return wind is not None and wind.after_fracture == "detached" and bool(wind.speed or wind.file)


def has_added_air_mass(job: Job) -> bool:
    """Return whether air moves with the roof."""
    return any(job.loads("added_mass"))


def has_second_moments(job: Job) -> bool:
    """Return whether any bar has a second moment."""
    return any(each.given().get("second_moment") for each in (job.cable, *job.groups.values()))


def mode_count(job: Job) -> int:
    """Return the number of natural modes to compute; 0 without [modes]."""
    return job.modes.count if job.modes else 0


def dynamic_settings(job: Job) -> Dynamics:
    """Return [dynamics] of a job that has it."""
    if job.dynamics is None:
        raise ValueError("the job has no [dynamics]")
    return job.dynamics


def moves_supports(job: Job) -> bool:
    """Return whether supports move in the dynamic stage."""
    return bool(job.motions and job.dynamics)


def is_shaken(job: Job) -> bool:
    """Return whether loads act at once or supports move in the dynamic stage, which excites vibrations."""
    return job.dynamics is not None and (moves_supports(job) or not starts_in_mean_wind(job))


def roof_groups(job: Job) -> list[str]:
    """Return the groups whose faces carry the roof; empty: all groups."""
    return list(job.roof.groups or ()) if job.roof else []


def has_wind_pressure(job: Job) -> bool:
    """Return whether a wind acts on the roof, also a static wind of a case, or a table of pressures."""
    winds: list[Wind] = [job.wind] if job.wind else []
    winds += [static_wind(job.wind or Wind(), case) for case in job.cases if has_static_wind(case)]
    damped = any(any(wind.all_values("aerodynamic_damping")) for wind in winds)
    return damped or any(map(_presses_on_roof, winds)) or any(case.pressure_table for case in job.cases)


def tap_axes(job: Job) -> str:
    """Return the axes of taps and tables of pressures: "xy", with `[roof] normal` "xyz"."""
    return "xyz" if job.roof and job.roof.normal else "xy"


def _presses_on_roof(wind: Wind) -> bool:
    """Return whether a wind has coefficients or pressures for the roof."""
    values = wind.all_values("pressure_coefficient")
    return bool(wind.pressures or wind.sectors or any(value is not None for value in values))


def winds_beside_roof(job: Job) -> list[str]:
    """Return the places of the winds that act only on elements with a diameter, not on the roof."""
    winds: dict[str, Wind] = {"[wind]": job.wind} if job.wind else {}
    for case in job.cases:
        if has_static_wind(case) and not case.pressure_table:
            winds[f"[[case]] {case.name}: set: wind"] = static_wind(job.wind or Wind(), case)
    return [place for place, wind in winds.items() if not _presses_on_roof(wind)]


def has_area_loads(job: Job) -> bool:
    """Return whether anything acts on the areas of the roof."""
    weighs = any(job.loads("dead") + job.loads("snow") + job.loads("added_mass"))
    return weighs or has_wind_pressure(job) or any(value is not None for value in job.loads("pressure"))


def has_normal_loads(job: Job) -> bool:
    """Return whether anything acts along the normals of the roof."""
    return has_wind_pressure(job) or any(isinstance(value, int | float) for value in job.loads("pressure"))


def breaks_equilibrium(job: Job, kind: str, factor: float) -> bool:
    """Return whether an exceeded strength means that a load has no equilibrium.

    This holds for [load] stop_at_strength, and for the equilibrium that the dynamic stage starts from.
    """
    starts = kind in ("at once", "initial_state") or (kind == "step" and factor == 1.0)
    return kind != "removal" and (load_settings(job).stop_at_strength or bool(starts and job.dynamics))


def temperature_in(job: Job, action: Case | Combination) -> float:
    """Return the change of temperature [K] in a case or combination."""
    base = load_settings(job).temperature
    own = {case.name: float(case.set.get("load.temperature", base)) for case in job.cases}
    if isinstance(action, Case):
        return own[action.name]
    temperature = action_factor(action, "temperature") * base
    for name, value in own.items():
        temperature += action_factor(action, name) * (value - base)
    return temperature


def load_settings(job: Job) -> Load:
    """Return the keys of [load]; without [load] their defaults, but without self weight."""
    return job.load or Load(self_weight=False)
