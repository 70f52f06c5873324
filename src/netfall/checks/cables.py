"""What a report tells of elements and cables: strengths, utilisation, lengths. Plain columns by name."""

from dataclasses import dataclass
from itertools import compress

import numpy as np

from netfall.checks.buckling import bar_columns, moment_columns, strengths_of_bars
from netfall.checks.codes import IN_TENSION, Check
from netfall.checks.counted import counted, places_of, stage_kinds, unborne_of
from netfall.mechanics.law.limits import REACHED
from netfall.mechanics.law.measures import stretched_length, warm_length
from netfall.results import states
from netfall.results.losses import broken_at, largest_after, lost_at

PASSES = "passes"
ABOVE = 1.0 + 1e-6  # a utilisation of what fails, in comparing


@dataclass(frozen=True)
class Cutting:
    """How cables are measured: temperature [K] from that of form finding, load [N] (None: as in the form)."""

    temperature: float = 0.0
    load: float | None = None


@dataclass(frozen=True)
class Checked:
    """The checks of all elements.

    By the name of the check, (m,) each:
    resistance, utilisation : [N], share; nan: the element has no such strength
    force, of : the largest tension, or compression, [N] in the stages that count for the check, and which of
        the envelope's it is
    fails : used above 1, or yields, has buckled or broke in these stages: what had been asked of it is not
        known then, since it carries no more
    unborne : one of UNBORNE, "": each stage that counts for the check is a stable equilibrium
    bends : (m,), of a chain of bars that bends, whose moments no check knows
    """

    checks: list[Check]
    resistance: dict[str, np.ndarray]
    utilisation: dict[str, np.ndarray]
    force: dict[str, np.ndarray]
    of: dict[str, np.ndarray]
    fails: dict[str, np.ndarray]
    unborne: dict[str, str]
    bends: np.ndarray

    def decisive(self, check: str) -> np.ndarray:
        """By what elements (m,) are compared in a check: its utilisation, without it the force.

        An element with a utilisation comes before all without, one that fails before all that do not.
        """
        used = np.where(self.fails[check], np.fmax(self.utilisation[check], ABOVE), self.utilisation[check])
        return _by(used, self.force[check])

    def why_empty(self, check: Check) -> str:
        """Why no element has a utilisation in a check."""
        if np.isfinite(self.resistance[check.name]).any():
            return f"no element that has a strength for it is in {check.of}"
        return "no element has a strength for it"


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
    return {name: f["net"][name][:] if name in f["net"] else none for name in IN_TENSION}


def resistances_of(f, checks: list[Check]) -> dict[str, np.ndarray]:
    """Resistances (m,) [N] by the names of the checks."""
    strengths, groups = strengths_of(f) | strengths_of_bars(f), groups_of(f)
    return {check.name: check.resistance(strengths, groups) for check in checks}


def applicable(checks: list[Check], resistance: dict) -> tuple[list[Check], dict]:
    """The checks, and resistances by their names, without those of compression that no bar has."""
    there = [each for each in checks if not each.compression or np.isfinite(resistance[each.name]).any()]
    return there or checks, {each.name: resistance[each.name] for each in there or checks}


def check_elements(f, checks: list[Check], resistance: dict, envelope: states.Envelope) -> Checked:
    """The largest force of what counts for each check over its resistance; of bars, if they have any."""
    kinds = stage_kinds(f, envelope)
    stages = {check.name: counted(kinds, check.kind) for check in checks}
    largest = {False: envelope.largest, True: envelope.largest_compression}
    found = {check.name: largest[check.compression](stages[check.name]) for check in checks}
    force, of = ({name: pair[k] for name, pair in found.items()} for k in (0, 1))
    none = {False: only_compressed(f, envelope), True: ~(envelope.least < 0.0)}
    used = {
        each.name: np.where(none[each.compression], np.nan, force[each.name] / resistance[each.name])
        for each in checks
    }
    caps = states.caps_of(f)
    most = {False: caps.yielding, True: np.minimum(caps.yielding, caps.buckling)}
    moving = np.array([name == states.MOTION for name in envelope.names])
    moved = ~np.isnan(broken_at(f)) | states.yielded_in(f)  # between rows of the history too
    fails = {}
    for each in checks:
        at_most = force[each.name] >= REACHED * most[each.compression]
        beyond = (used[each.name] > 1.0) | at_most | (moved & (stages[each.name] & moving).any())
        fails[each.name] = np.isfinite(used[each.name]) & beyond
    moment = moment_columns(f).get("bending_moment_max", np.full(len(caps.yielding), np.nan))
    unborne = {name: unborne_of(f, places_of(envelope, which)) for name, which in stages.items()}
    return Checked(checks, resistance, used, force, of, fails, unborne, np.isfinite(moment))


def results_of(checked: Checked, check: str) -> np.ndarray:
    """Of each element (m,) in a check: passes, also without its bending, FAILS, "": it has no utilisation.

    One of UNBORNE: it would pass, but something that counts for the check is not borne.
    """
    passes = checked.unborne[check] or PASSES
    results = np.isnan(checked.utilisation[check]), checked.fails[check], checked.bends & (passes == PASSES)
    return np.select(results, ["", "FAILS", f"{PASSES} without bending"], passes).astype(object)


def only_compressed(f, envelope: states.Envelope) -> np.ndarray:
    """Bars (m,) that are in tension in no stage."""
    return f["net/bar"][:].astype(bool) & (envelope.most <= 0.0)


def names_of_elements(f) -> dict[str, np.ndarray]:
    """Columns (m,) by which an element is known: ids of it and its nodes, its cable and its group."""
    ends = f["net/node_id"][:][f["net/elements"][:]]
    return {
        "element": f["net/element_id"][:],
        "start": ends[:, 0],
        "end": ends[:, 1],
        "cable": f["net/cable_names"].asstr()[:].astype(object)[f["net/cable"][:]],
        "group": groups_of(f),
    }


def element_columns(f, envelope: states.Envelope, checked: Checked) -> dict[str, np.ndarray]:
    """A row for each element."""
    names = np.array(envelope.names, object)
    columns = names_of_elements(f) | {
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
        columns |= largest_after(f)
    columns |= bar_columns(f) | moment_columns(f)
    for check in checked.checks:
        columns[f"resistance_{check.name}"] = checked.resistance[check.name]
        columns[f"utilisation_{check.name}"] = checked.utilisation[check.name]
        columns[f"result_{check.name}"] = results_of(checked, check.name)
        columns[f"{check.of}_{check.name}"] = checked.force[check.name]
        columns[f"case_{check.name}"] = names[checked.of[check.name]]
    return columns


def cable_columns(f, envelope: states.Envelope, checked: Checked) -> dict[str, np.ndarray]:
    """A row for each cable; what governs it is its element with the largest utilisation, or tension."""
    cable, count = f["net/cable"][:], len(f["net/cable_names"])
    governs = _by(checked.utilisation[checked.checks[0].name], envelope.most)
    at = _first_by(governs, cable)  # the element that governs each cable
    low = _first_by(-envelope.least, cable)
    each = element_columns(f, envelope, checked)
    strengths = {name: np.where(np.isinf(N), np.nan, N)[at] for name, N in strengths_of(f).items()}
    slack = _of_cables(np.logical_or, envelope.slack, cable)
    slack &= ~_of_cables(np.logical_or, envelope.gone, cable)
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
        "lost_at": _of_cables(np.fmin, each["lost_at"], cable),
        "broken_at": _of_cables(np.fmin, each["broken_at"], cable),
    }
    for name in ("tension_ratio", "dynamic_factor"):
        if name in each:
            columns[name] = _of_cables(np.fmax, each[name], cable)
    for check in checked.checks:
        governs = _first_by(checked.decisive(check.name), cable)
        for what in ("resistance", "utilisation", "result", check.of, "case"):
            columns[f"{what}_{check.name}"] = each[f"{what}_{check.name}"][governs]
    return columns


def cutting_columns(f, cutting: Cutting) -> dict[str, np.ndarray]:
    """A row for each cable: its lengths [m] in the form, nan: it is not there, unstressed, and as measured.

    At the temperature T above that of form finding and the load N a piece of unstressed length L0 measures
    L0 (1 + expansion T) (1 + N / EA), with the logarithmic strain L0 (1 + expansion T) exp(N / EA). A load
    that is given is that of cables; bars are then measured without any.
    """
    cable, count = f["net/cable"][:], len(f["net/cable_names"])
    total = lambda values: np.bincount(cable, values, count)
    x, elements, L0 = states.start_position(f), f["net/elements"][:], f["net/unstressed_length"][:]
    L = np.where(states.absent(f), np.nan, np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1))
    load, warm, stretched = measured_lengths(f, cutting)
    return {
        "cable": f["net/cable_names"].asstr()[:].astype(object),
        "group": _words_of(groups_of(f), cable),
        "type": _words_of(types_of(f), cable),
        "elements": np.bincount(cable, minlength=count),
        "unstressed_length": total(L0),
        "length_in_form": total(L),
        "temperature": np.full(count, float(cutting.temperature)),
        "unstressed_length_at_temperature": total(warm),
        "measuring_load": load,
        "length_at_measuring_load": total(stretched),
        "mass": total(L0 * f["net/mass_per_length"][:]),
    }


def measured_lengths(f, cutting: Cutting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measuring loads (cables,) [N]; lengths (m,) [m] of the elements unstressed and warm, and under them."""
    cable, count = f["net/cable"][:], len(f["net/cable_names"])
    L0, EA = f["net/unstressed_length"][:], f["net/axial_stiffness"][:]
    if cutting.load is None:
        load = np.bincount(cable, states.start_tension(f) * L0, count) / np.bincount(cable, L0, count)
    else:
        first = np.unique(cable, return_index=True)[1]
        load = np.where(f["net/bar"][:][first], 0.0, cutting.load)
    warm = warm_length(L0, f["net/expansion"][:], cutting.temperature)
    return load, warm, stretched_length(warm, load[cable], EA, states.strain_measure(f))


def _by(used: np.ndarray, N: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(used), N / (1.0 + np.abs(N).max()) - 2.0, used)


def _first_by(key: np.ndarray, cable: np.ndarray) -> np.ndarray:
    """For each cable the row of its element with the largest key (m,), the first of equal ones."""
    order = np.lexsort((np.arange(len(key)), -key, cable))
    return order[np.unique(cable[order], return_index=True)[1]]


def _words_of(words: np.ndarray, cable: np.ndarray) -> np.ndarray:
    """The word of each cable, from those (m,) of its elements; all of them if they differ."""
    found: dict[int, dict[str, None]] = {}
    for number, word in zip(cable.tolist(), words.tolist()):
        found.setdefault(number, {})[word] = None
    each = [[*found[number]] for number in sorted(found)]
    return np.array(
        [" + ".join(word or "none" for word in one) if one[1:] else one[0] for one in each], object
    )


def _of_cables(reduce: np.ufunc, values: np.ndarray, cable: np.ndarray) -> np.ndarray:
    """Reduce values (..., m) of the elements to those (..., cables) of their cables."""
    order = np.argsort(cable, kind="stable")
    starts = np.unique(cable[order], return_index=True)[1]
    return reduce.reduceat(values[..., order], starts, axis=-1)


def _slack_words(names: list[str], slack: np.ndarray) -> np.ndarray:
    """The stages in which each is slack, by name; slack : (stages, k) bool."""
    return np.array(["; ".join(compress(names, each)) for each in slack.T], object)
