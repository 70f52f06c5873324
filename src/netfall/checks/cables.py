"""What a report tells of elements and cables: strengths, utilisation, lengths. Plain columns by name."""

from dataclasses import dataclass

import numpy as np

from netfall.checks.codes import STRENGTHS, Check
from netfall.mechanics.material import stretched_length, warm_length
from netfall.results.losses import broken_at, largest_factor, lost_at
from netfall.results.states import Envelope, start_position, start_tension, strain_measure


@dataclass(frozen=True)
class Cutting:
    """How cables are measured: temperature [K] from that of form finding, load [N] (None: as in the form)."""

    temperature: float = 0.0
    load: float | None = None


@dataclass(frozen=True)
class Checked:
    """The checks of all elements.

    resistance, utilisation : (m,) [N], share, by the name of the check; nan: the element has no such strength
    """

    checks: list[Check]
    resistance: dict[str, np.ndarray]
    utilisation: dict[str, np.ndarray]

    def decisive(self, tension: np.ndarray) -> np.ndarray:
        """By what elements (m,) are compared: utilisation in the first check, without it the tension [N].

        An element with a utilisation comes before all without.
        """
        first = self.utilisation[self.checks[0].name]
        return np.where(np.isnan(first), tension / (1.0 + np.abs(tension).max()) - 2.0, first)


def groups_of(f) -> np.ndarray:
    """Names (m,) of the elements' groups."""
    return f["net/group_names"].asstr()[:].astype(object)[f["net/group"][:]]


def types_of(f) -> np.ndarray:
    """Names (m,) of the elements' types in the catalogue, "": none."""
    if "type" not in f["net"]:
        return np.full(len(f["net/elements"]), "", object)
    return np.array([*f["net/type_names"].asstr()[:], ""], object)[f["net/type"][:]]


def strengths_of(f) -> dict[str, np.ndarray]:
    """Strengths (m,) [N] as given, inf: none."""
    none = np.full(len(f["net/elements"]), np.inf)
    return {name: f["net"][name][:] if name in f["net"] else none for name in STRENGTHS}


def resistances_of(f, checks: list[Check]) -> dict[str, np.ndarray]:
    """Resistances (m,) [N] by the names of the checks."""
    strengths, groups = strengths_of(f), groups_of(f)
    return {check.name: check.resistance(strengths, groups) for check in checks}


def check_elements(f, checks: list[Check], resistance: dict, envelope: Envelope) -> Checked:
    """The largest tension as a share of the resistances. What is only compressed has none."""
    none = only_compressed(f, envelope)
    used = {name: np.where(none, np.nan, envelope.most / R) for name, R in resistance.items()}
    return Checked(checks, resistance, used)


def only_compressed(f, envelope: Envelope) -> np.ndarray:
    """Bars (m,) that are in tension in no stage."""
    return f["net/bar"][:].astype(bool) & (envelope.most <= 0.0)


def element_columns(f, envelope: Envelope, checked: Checked) -> dict[str, np.ndarray]:
    """A row for each element."""
    names, ends = np.array(envelope.names, object), f["net/node_id"][:][f["net/elements"][:]]
    columns = {
        "element": f["net/element_id"][:],
        "start": ends[:, 0],
        "end": ends[:, 1],
        "cable": f["net/cable_names"].asstr()[:].astype(object)[f["net/cable"][:]],
        "group": groups_of(f),
        "unstressed_length": f["net/unstressed_length"][:],
        "tension_max": envelope.most,
        "case_max": names[envelope.of_most],
        "time_max": envelope.time_most,
        "tension_min": envelope.least,
        "case_min": names[envelope.of_least],
        "slack_in": _slack_words(envelope.names, envelope.slack),
        "lost_at": lost_at(f),
        "broken_at": broken_at(f),
    }
    if envelope.slack_time is not None:
        columns["slack_time"] = envelope.slack_time
    if "removal" in f:
        columns["dynamic_factor"] = largest_factor(f)
    for check in checked.checks:
        columns[f"resistance_{check.name}"] = checked.resistance[check.name]
        columns[f"utilisation_{check.name}"] = checked.utilisation[check.name]
    return columns


def cable_columns(f, envelope: Envelope, checked: Checked) -> dict[str, np.ndarray]:
    """A row for each cable; what governs it is its element with the largest utilisation, or tension."""
    cable, count = f["net/cable"][:], len(f["net/cable_names"])
    at = _first_by(checked.decisive(envelope.most), cable)  # the element that governs each cable
    low = _first_by(-envelope.least, cable)
    each = element_columns(f, envelope, checked)
    strengths = {name: np.where(np.isinf(N), np.nan, N)[at] for name, N in strengths_of(f).items()}
    slack = _any_of(envelope.slack, cable, count) & ~_any_of(envelope.gone, cable, count)
    columns = {
        "cable": f["net/cable_names"].asstr()[:].astype(object),
        "group": each["group"][at],
        "type": types_of(f)[at],
        "elements": np.bincount(cable, minlength=count),
        "unstressed_length": np.bincount(cable, each["unstressed_length"], count),
        "breaking_load": strengths["breaking_load"],
        "yield_force": strengths["yield_force"],
        "tension_max": envelope.most[at],
        "case_max": each["case_max"][at],
        "time_max": envelope.time_most[at],
        "element_max": each["element"][at],
        "tension_min": envelope.least[low],
        "case_min": each["case_min"][low],
        "slack_in": _slack_words(envelope.names, slack),
        "lost_at": _least_of(each["lost_at"], cable, count),
        "broken_at": _least_of(each["broken_at"], cable, count),
    }
    if "dynamic_factor" in each:
        columns["dynamic_factor"] = -_least_of(-each["dynamic_factor"], cable, count)
    for check in checked.checks:
        for name in (f"resistance_{check.name}", f"utilisation_{check.name}"):
            columns[name] = each[name][at]
    return columns


def cutting_columns(f, cutting: Cutting) -> dict[str, np.ndarray]:
    """A row for each cable: its lengths [m] in the form, unstressed, and as it is measured.

    At the temperature T above that of form finding and the load N a piece of unstressed length L0 measures
    L0 (1 + expansion T) (1 + N / EA), with the logarithmic strain L0 (1 + expansion T) exp(N / EA). A load
    that is given is that of cables; bars are then measured without any.
    """
    cable, count = f["net/cable"][:], len(f["net/cable_names"])
    total = lambda values: np.bincount(cable, values, count)
    x, elements, L0 = start_position(f), f["net/elements"][:], f["net/unstressed_length"][:]
    EA, first = f["net/axial_stiffness"][:], np.unique(cable, return_index=True)[1]
    if cutting.load is None:
        load = total(start_tension(f) * L0) / total(L0)
    else:
        load = np.where(f["net/bar"][:][first], 0.0, cutting.load)
    warm = warm_length(L0, f["net/expansion"][:], cutting.temperature)
    stretched = stretched_length(warm, load[cable], EA, strain_measure(f))
    return {
        "cable": f["net/cable_names"].asstr()[:].astype(object),
        "group": _words_of(groups_of(f), cable, count),
        "type": _words_of(types_of(f), cable, count),
        "elements": np.bincount(cable, minlength=count),
        "unstressed_length": total(L0),
        "length_in_form": total(np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1)),
        "temperature": np.full(count, float(cutting.temperature)),
        "unstressed_length_at_temperature": total(warm),
        "measuring_load": load,
        "length_at_measuring_load": total(stretched),
        "mass": total(L0 * f["net/mass_per_length"][:]),
    }


def _first_by(key: np.ndarray, cable: np.ndarray) -> np.ndarray:
    """For each cable the row of its element with the largest key (m,), the first of equal ones."""
    order = np.lexsort((np.arange(len(key)), -key, cable))
    return order[np.unique(cable[order], return_index=True)[1]]


def _words_of(words: np.ndarray, cable: np.ndarray, count: int) -> np.ndarray:
    """The word of each cable, from those (m,) of its elements; all of them if they differ."""
    found: list[list[str]] = [[] for _ in range(count)]
    for number, word in dict.fromkeys(zip(cable.tolist(), words.tolist())):
        found[number].append(word)
    return np.array(
        [" + ".join(word or "none" for word in each) if each[1:] else each[0] for each in found], object
    )


def _least_of(values: np.ndarray, cable: np.ndarray, count: int) -> np.ndarray:
    """The least of the values (m,) of each cable, nan: none."""
    least = np.full(count, np.inf)
    np.minimum.at(least, cable, np.where(np.isnan(values), np.inf, values))
    return np.where(np.isfinite(least), least, np.nan)


def _any_of(which: np.ndarray, cable: np.ndarray, count: int) -> np.ndarray:
    """In which stages any element of each cable is one of which (stages, m) bool; (stages, cables) bool."""
    found = np.zeros((len(which), count), bool)
    for stage, of_elements in zip(found, which):
        np.logical_or.at(stage, cable, of_elements)
    return found


def _slack_words(names: list[str], slack: np.ndarray) -> np.ndarray:
    """The stages in which each is slack, by name; slack : (stages, k) bool."""
    words = np.full(slack.shape[1], "", object)
    for k in np.flatnonzero(slack.any(0)):
        words[k] = "; ".join(name for name, is_slack in zip(names, slack[:, k]) if is_slack)
    return words
