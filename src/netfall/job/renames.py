"""Names of job and study files that version 0.5 changed: an old one is an error that gives the new one."""

from typing import Any

from netfall.job import messages
from netfall.job.keys.schema import GENERATOR_KEYS
from netfall.job.values import format_value

# Old and new names of keys, each with its section. Keys of [cable] stand in groups too, keys of [load] and
# [wind] in zones and in `set`. [run] and [[failure]] belong to study files.
RENAMED_KEYS = {
    "cable.expansion": "cable.thermal_expansion",
    "cable.strain": "cable.strain_measure",
    "cable.strength_deviation": "cable.strength_cov",
    "cable.length_deviation": "cable.length_std",
    "load.air_mass": "load.added_mass",
    "load.breaking": "load.stop_at_strength",
    "wind.shape_coefficient": "wind.pressure_coefficient",
    "wind.turbulence": "wind.turbulence_intensity",
    "wind.roughness": "wind.surface_drag",
    "wind.gusts": "wind.gust_field",
    "wind.air_damping": "wind.aerodynamic_damping",
    "dynamics.damping": "dynamics.mass_damping",
    "dynamics.damping_ratio": "dynamics.axial_damping_ratio",
    "dynamics.damping_band": "dynamics.axial_damping_band",
    "output.history": "output.history_interval",
    "output.checkpoint": "output.checkpoint_interval",
    "output.modes": "modes.count",
    "slide.resistance": "slide.slip_resistance",
    "target.by": "target.adjust",
    "run.keep": "run.keep_results",
    "failure.of": "failure.outcome",
    "failure.above": "failure.limit",
    "failure.by": "failure.depth",
}
RENAMED_VALUES = {  # new values by old ones, for each key
    "form_finding.method": {"keep": "given_geometry"},
    "wind.gust_field": {"means": "area_mean", "points": "point"},
    "combination.kind": {"ultimate": "ULS", "service": "SLS"},
    "failure.outcome": {"roof_lost": "detached_area", "balance_error": "energy_balance_error"},
}
# Removed keys, with the reason for the removal.
REMOVED_KEYS = {"dynamics.precision": "numbers have double precision (jobs/trade/README.md)"}


def renamed_key_error(place: str, name: str, table: dict[str, Any]) -> str:
    """Return the error for an old name of a key, with the new one; "" for any other name.

    place : of the table, as in `validate.Validator.wrong`; name : dotted in `set` of cases and stages
    """
    shown = format_value(name)[1:-1]
    if place == "cable" and isinstance(table[name], dict):
        return messages.RENAMED_KEY(name=shown, new=f"[group.{shown}]")
    generators = [generator for generator, keys in GENERATOR_KEYS.items() if name in keys]
    if place == "net" and table.get("generator") in generators:
        return messages.RENAMED_KEY(name=name, new=f"[net.{table['generator']}] {name}")
    if place == "net" and generators:
        return messages.OTHER_GENERATOR(name=name, generators=" or ".join(map(format_value, generators)))
    old = _with_section(place, name)
    if old in REMOVED_KEYS:
        return messages.REMOVED_KEY(name=name, reason=REMOVED_KEYS[old])
    if old not in RENAMED_KEYS:
        return ""
    (old_section, _, old_key), (section, _, key) = old.partition("."), RENAMED_KEYS[old].partition(".")
    new = name.removesuffix(old_key) + key if section == old_section else f"[{section}] {key}"
    return messages.RENAMED_KEY(name=name, new=new)


def renamed_value_error(place: str, name: str, value: object) -> str:
    """Return the error for an old value of a key, with the new one; "" for any other value."""
    new_values = RENAMED_VALUES.get(_with_section(place, name), {})
    if not isinstance(value, str) or value not in new_values:
        return ""
    shown = f"{name} = {format_value(value)}"
    return messages.RENAMED_KEY(name=shown, new=format_value(new_values[value]))


def _with_section(place: str, name: str) -> str:
    """Return a key with its section, as in the tables above: "wind.speed" for [wind.zone.edge] speed."""
    if "set:" in place:
        return f"{name.partition('.')[0]}.{name.rpartition('.')[2]}"
    section = place.lstrip("[").partition("]")[0].partition(".")[0]
    return f"{'cable' if section == 'group' else section}.{name}"
