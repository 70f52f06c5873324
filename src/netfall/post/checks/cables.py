"""Checks of elements, and report tables on elements and cables: strengths, utilisation, lengths."""

from dataclasses import dataclass, replace
from itertools import compress

import h5py
import numpy as np

from netfall.core.errors import InputError
from netfall.job.values import counted as count_with_ids
from netfall.job.values import format_list
from netfall.physics.law.measures import REACHED_SHARE, heated_length, stretched_length
from netfall.post import messages
from netfall.post.checks.bending import (
    NEGLIGIBLE,
    bar_columns,
    bar_strengths,
    bending_strengths,
    is_bending,
    is_concrete,
    moment_columns,
)
from netfall.post.checks.codes import ERECTION_KIND, IN_TENSION, WITH_MOMENT, Check
from netfall.results import removals, states
from netfall.results.file import COMBINATION_KINDS, read_cases
from netfall.results.states import PERMANENT, Envelope, group_title, last_stage, passes_limit_point

NOT_VERIFIED = {  # reasons why a check cannot pass, worst first, and their text for a group in a report
    "no equilibrium": "FAILS: {} has no equilibrium.",
    "undecided": "UNDECIDED: no equilibrium of {} was found.",
    "not stable": "FAILS: {} is not stable.",
    "beyond limit point": "FAILS: the path to {} passes a limit point.",
    "not checked": "NOT CHECKED: there is neither a case nor a combination of this kind, so only {} count.",
}
# accidental: states after member removals, which EN 1990, 6.5.3, excludes from serviceability
ACCIDENTAL_KIND = "accidental"
OTHER_KINDS = "", ERECTION_KIND, ACCIDENTAL_KIND  # of states that are neither permanent nor of cases
UNVERIFIED_STATES = {  # of an equilibrium, also after a member removal: reason why no check passes
    "no_equilibrium": "no equilibrium",
    "undecided": "undecided",
    "unstable": "not stable",
    "beyond_limit_point": "beyond limit point",
}


def stage_kinds(f: h5py.File, envelope: Envelope) -> np.ndarray:
    """Return the kind of case (`results.file.Case`) of each stage in an envelope, or another kind.

    Others are PERMANENT, ERECTION_KIND, ACCIDENTAL_KIND and "". A form counts as PERMANENT.
    """
    kinds = {case.shown.place: case.kind for case in read_cases(f)} | {PERMANENT: PERMANENT}
    kinds |= {path: ERECTION_KIND for path in envelope.places if path.startswith("stages/")}
    if removals.REMOVAL in f:
        kinds |= dict.fromkeys((removals.REMOVAL, ""), ACCIDENTAL_KIND)  # and the motion
    first, *others = envelope.places
    return np.array([kinds.get(first or PERMANENT, PERMANENT), *(kinds.get(p, "") for p in others)], object)


def counted(kinds: np.ndarray, kind: str) -> np.ndarray:
    """Select the stages (stages,) that count in checks of a kind; kinds : from `stage_kinds`.

    If the job has combinations of this kind, these and what counts as PERMANENT count.
    Ultimate checks also include stages of erection, and stages without a kind or after member removals, since
    their loads are accidental. If the job has no such combinations, all stages except combinations of the
    other kind count, in service only the last of erection and none after removals. Checks of ERECTION_KIND
    include the stages of erection alone.
    """
    counts, (ultimate, service) = kinds == kind, COMBINATION_KINDS
    if not kind or not counts.any():
        counts = ~np.isin(kinds, COMBINATION_KINDS if kind else [])
        counts[np.flatnonzero(kinds == ERECTION_KIND)[: -1 if kind == service else 0]] = False
        counts &= (kind != service) | (kinds != ACCIDENTAL_KIND)
    elif kind != ERECTION_KIND:
        counts |= (kinds == PERMANENT) | np.isin(kinds, OTHER_KINDS) & (kind == ultimate)
    return counts


def states_not_verified(f: h5py.File, envelope: Envelope, selected: np.ndarray) -> list[tuple[str, str]]:
    """Return the titles of the states that cannot verify a check, each after one of NOT_VERIFIED.

    selected : (stages,) that count for a check, from `counted`. Stages of erection before the last need not
    be stable: their struts are held until the cables are taut.
    """
    paths = dict.fromkeys(path for path, counts in zip(envelope.places, selected) if counts and path)
    failed: list[tuple[str, str]] = []
    for path in paths:
        title = "the permanent state" if path == PERMANENT else group_title(f, path)
        if path == removals.REMOVAL:
            outcomes = enumerate(removals.removal_states(f[path]), 1)
            failed += [
                (UNVERIFIED_STATES[state], f"the net after removal {k}")
                for k, state in outcomes
                if state in UNVERIFIED_STATES
            ]
            continue
        state = f[path].attrs.get("state")
        is_held = state == "unstable" and path.startswith("stages/") and path != last_stage(f)
        if state in UNVERIFIED_STATES and not is_held:
            failed.append((UNVERIFIED_STATES[state], title))
        elif passes_limit_point(f, path):
            failed.append(("beyond limit point", title))
    chosen, has_form = np.flatnonzero(selected), not envelope.places[0].startswith("stages/")
    if len(selected) > 1 and all(envelope.places[k] == PERMANENT for k in chosen if k >= has_form):
        failed.append(("not checked", " and ".join(envelope.names[k] for k in chosen)))
    return sorted(failed, key=lambda pair: list(NOT_VERIFIED).index(pair[0]))


PASSES, NO_BENDING = "passes", "not checked for bending"
ROUNDING = 1e-9  # share of the compression of a bar; a smaller tension, as on top of a post, is rounding
FAILED_UTILISATION = 1.0 + 1e-6  # utilisation [-] that ranks a failed element above all passing ones


@dataclass(frozen=True)
class Cutting:
    """Conditions under which cables are measured.

    temperature : [K] above that of form finding
    load : [N], of cables; None: the force of each cable in the form-found geometry
    """

    temperature: float = 0.0
    load: float | None = None


@dataclass(frozen=True, eq=False)
class ElementCheck:
    """A check of all elements; arrays (m,).

    resistance, utilisation : [N], share; nan: the element has no such strength
    moment_resistance : [N m], nan: the check has no moments, or the element no such strength
    force, moment : tension, compression or the larger of both [N], and [N m], in the stage of the check with
    the largest utilisation
    of : index of that stage in the envelope
    fails : utilisation above 1, or the element yields, buckles, breaks or exceeds its strength in these
    stages, permanent loads included; its demand is then unknown, because its force is limited. In checks
    of tension an element with only a fracture strain fails without a utilisation.
    reason : one of NOT_VERIFIED; "": each stage that counts for the check is a stable equilibrium
    unchecked : element of a bending chain with moments that no check includes
    """

    check: Check
    resistance: np.ndarray
    moment_resistance: np.ndarray
    utilisation: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    of: np.ndarray
    fails: np.ndarray
    reason: str
    unchecked: np.ndarray

    @property
    def name(self) -> str:
        """Name of the check."""
        return self.check.name

    def ranking_key(self) -> np.ndarray:
        """Return the key (m,) that ranks the elements: the utilisation, or the force without one.

        Elements that fail rank first. Elements with a utilisation rank before all elements without one.
        """
        values = np.where(self.fails, np.fmax(self.utilisation, FAILED_UTILISATION), self.utilisation)
        return _ranking(values, self.force)

    def explain_no_utilisation(self) -> str:
        """Explain why no element has a utilisation."""
        if np.isfinite(self.resistance).any():
            return f"no element that has a strength for it is in {self.check.of}"
        return "no element has a strength for it"

    def results(self) -> np.ndarray:
        """Return the result of each element (m,): passes, not checked for bending, or FAILS.

        The result is empty for an element without utilisation. It is one of NOT_VERIFIED if the element would
        pass, but a stage of the check is not a stable equilibrium.
        """
        passes = self.reason or PASSES
        cases = self.fails, np.isnan(self.utilisation), self.unchecked & (passes == PASSES)
        return np.select(cases, ["FAILS", "", NO_BENDING], passes).astype(object)


def element_groups(f: h5py.File) -> np.ndarray:
    """Return the group names (m,) of the elements."""
    return f["net/group_names"].asstr()[:].astype(object)[f["net/group"][:]]


def element_types(f: h5py.File) -> np.ndarray:
    """Return the catalogue types (m,) of the elements, "": none."""
    if "type" not in f["net"]:
        return np.full(len(f["net/elements"]), "", object)
    return np.array([*f["net/type_names"].asstr()[:], ""], object)[f["net/type"][:]]


def tensile_strengths(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the tensile strengths (m,) [N] by name, as given; inf: none."""
    return {name: states.element_property(f, name, np.inf) for name in IN_TENSION}


def element_resistances(f: h5py.File, checks: list[Check]) -> list[np.ndarray]:
    """Compute the resistances (m,) [N] for each check."""
    strengths, groups = tensile_strengths(f) | bar_strengths(f) | bending_strengths(f), element_groups(f)
    return [check.resistance(strengths, groups) for check in checks]


def applicable_checks(f: h5py.File, checks: list[Check]) -> list[tuple[Check, np.ndarray]]:
    """Return checks and resistances (m,) [N], without checks of bars if no bar has the strength.

    A job without stages of erection has no checks of these. All checks are returned if none would remain.
    """
    checks = [check for check in checks if check.kind != ERECTION_KIND or "stages" in f] or checks
    pairs = list(zip(checks, element_resistances(f, checks)))
    return [pair for pair in pairs if pair[0].of == "tension" or np.isfinite(pair[1]).any()] or pairs


def check_elements(
    f: h5py.File, checks: list[tuple[Check, np.ndarray]], envelope: states.Envelope
) -> list[ElementCheck]:
    """Compare the force, and the moment if included, in each check with the resistance.

    An element that is only compressed has no utilisation in tension. One that is never compressed has none in
    compression. checks : from `applicable_checks`
    """
    kinds, caps, groups = stage_kinds(f, envelope), states.force_caps(f), element_groups(f)
    breaking, overloaded = states.breaking_forces(f), states.at_limit_in_permanent_state(f)
    is_motion = np.array([name == states.DYNAMIC_STAGE for name in envelope.names])
    failed = ~np.isnan(removals.fracture_times(f)) | states.yielded_elements(f)  # history rows can miss it
    buckles = states.element_property(f, "buckling", 0) == 1
    checked, bends, rows = [], np.isfinite(envelope.moment).any(axis=0), np.arange(len(caps.yielding))
    has_none = np.isinf(np.minimum.reduce(list(tensile_strengths(f).values())))
    for check, resistance in checks:
        stages, M_Rd = counted(kinds, check.kind), np.full(len(rows), np.nan)
        # a bar that yields or breaks in compression also fails in tension, because possibly no check of
        # compression includes it
        crushing = np.minimum(caps.yielding, np.where(buckles, breaking, np.inf))
        crushed = -envelope.low >= REACHED_SHARE * crushing
        force, cap = np.where(crushed, -envelope.low, envelope.high), np.minimum(caps.yielding, breaking)
        unused = is_only_compressed(f, envelope, stages) & ~crushed[stages].any(axis=0)
        if check.with_moment:
            M_Rd = check.resistance(dict.fromkeys(WITH_MOMENT, bending_strengths(f)["moment"]), groups)
            force = np.fmax(np.abs(envelope.high), np.abs(envelope.low))
            unused = np.zeros(len(rows), bool)
        if check.compression:
            force = np.fmax(-envelope.low, 0.0) if check.with_moment else -envelope.low
            unused = ~(np.fmin.reduce(envelope.low[stages]) < 0.0)
            cap = np.minimum(crushing, caps.buckling)
        # a moment acts like an axial force of the same utilisation
        demand = force + np.nan_to_num(envelope.moment * (resistance / M_Rd))
        most, of = states.largest_over_stages(np.where(stages[:, None], demand, np.nan))
        force, utilisation = force[of, rows], np.where(unused, np.nan, most / resistance)
        beyond = (
            (overloaded & (stages & (kinds == PERMANENT)).any())
            | (utilisation > 1.0)
            | (force >= REACHED_SHARE * cap)
            | (failed & (stages & is_motion).any())
        )
        reason = next((why for why, _ in states_not_verified(f, envelope, stages)), "")
        moment, fails = np.where(np.isnan(M_Rd), np.nan, envelope.moment[of, rows]), np.isfinite(utilisation)
        fails |= has_none & (check.of == "tension")
        numbers = resistance, M_Rd, utilisation, force, moment, of, fails & beyond
        checked.append(ElementCheck(check, *numbers, reason, bends))
    included = [np.isfinite(one.utilisation) for one in checked if one.check.with_moment]
    unchecked = bends & ~np.any([np.zeros(len(rows), bool), *included], axis=0)
    return [replace(one, unchecked=unchecked) for one in checked]


def is_only_compressed(f: h5py.File, envelope: states.Envelope, stages: np.ndarray) -> np.ndarray:
    """Select the bars (m,) without tension in any of the selected stages (stages,)."""
    most, least = np.fmax.reduce(envelope.high[stages]), np.fmin.reduce(envelope.low[stages])
    return f["net/bar"][:].astype(bool) & (np.nan_to_num(most) <= ROUNDING * np.fmax(-least, 0.0))


def element_name_columns(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the columns (m,) that identify an element: its id, its nodes' ids, its cable and its group."""
    ends = f["net/node_id"][:][f["net/elements"][:]]
    return {
        "element": f["net/element_id"][:],
        "start": ends[:, 0],
        "end": ends[:, 1],
        "cable": f["net/cable_names"].asstr()[:].astype(object)[f["net/cable"][:]],
        "group": element_groups(f),
    }


def element_columns(
    f: h5py.File, envelope: states.Envelope, checked: list[ElementCheck]
) -> dict[str, np.ndarray]:
    """Return the table of the elements, one row each. Raises InputError for a column with two meanings."""
    names = np.array(envelope.names, object)
    columns = element_name_columns(f) | {
        "unstressed_length": f["net/unstressed_length"][:],
        "tension_max": envelope.most,
        "case_max": np.where(np.isnan(envelope.most), "", names[envelope.of_most]),
        "time_max": envelope.time_of_max,
        "tension_min": envelope.least,
        "case_min": np.where(np.isnan(envelope.least), "", names[envelope.of_least]),
        "slack_in": _slack_stages(envelope.names, envelope.slack),
        "lost_at": removals.removal_times(f),
        "broken_at": removals.fracture_times(f),
    }
    if envelope.slack_time is not None:
        columns["slack_time"] = np.where(np.isnan(envelope.most), np.nan, envelope.slack_time)
    if "removal" in f:
        columns |= removals.largest_after_removals(f)
    columns |= bar_columns(f) | moment_columns(envelope)
    for one in checked:
        own = {
            f"resistance_{one.name}": one.resistance,
            f"utilisation_{one.name}": one.utilisation,
            f"result_{one.name}": one.results(),
            f"{one.check.of}_{one.name}": one.force,
            f"case_{one.name}": np.where(np.isnan(one.force), "", names[one.of]),
        }
        if one.check.with_moment:
            own[f"moment_{one.name}"] = one.moment
            own[f"moment_resistance_{one.name}"] = one.moment_resistance
        if clashes := sorted(own.keys() & columns.keys()):
            raise InputError(messages.COLUMN_TWICE(name=one.name, column=clashes[0]))
        columns |= own
    return columns


def cable_columns(
    f: h5py.File, envelope: states.Envelope, checked: list[ElementCheck], elements: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the table of the cables, one row each; elements : from `element_columns`

    Strengths are those of the element with the largest utilisation or, without one, the largest tension.
    """
    cable, count = f["net/cable"][:], len(f["net/cable_names"])
    ranking = _ranking(checked[0].utilisation, envelope.most)
    governing = _first_by_cable(ranking, cable)  # the governing element of each cable
    most_tensioned, least_tensioned = (_first_by_cable(N, cable) for N in (envelope.most, -envelope.least))
    strengths = {name: np.where(np.isinf(N), np.nan, N) for name, N in tensile_strengths(f).items()}
    columns = {
        "cable": f["net/cable_names"].asstr()[:].astype(object),
        "group": elements["group"][governing],
        "type": element_types(f)[governing],
        "elements": np.bincount(cable, minlength=count),
        "unstressed_length": np.bincount(cable, elements["unstressed_length"], count),
        "breaking_load": strengths["breaking_load"][governing],
        "yield_force": strengths["yield_force"][governing],
        "tension_max": envelope.most[most_tensioned],
        "case_max": elements["case_max"][most_tensioned],
        "time_max": envelope.time_of_max[most_tensioned],
        "element_max": elements["element"][most_tensioned],
        "tension_min": envelope.least[least_tensioned],
        "case_min": elements["case_min"][least_tensioned],
        "slack_in": _slack_stages(envelope.names, slack_cables(f, envelope)),
        "lost_at": _reduce_by_cable(np.fmin, elements["lost_at"], cable),
        "broken_at": _reduce_by_cable(np.fmin, elements["broken_at"], cable),
    }
    for name in ("tension_ratio", "dynamic_factor"):
        if name in elements:
            columns[name] = _reduce_by_cable(np.fmax, elements[name], cable)
    for one in checked:
        decisive = _first_by_cable(one.ranking_key(), cable)
        for quantity in ("resistance", "utilisation", "result", one.check.of, "case"):
            columns[f"{quantity}_{one.name}"] = elements[f"{quantity}_{one.name}"][decisive]
    return columns


def slack_cables(f: h5py.File, envelope: states.Envelope) -> np.ndarray:
    """Select the intact cables (stages, cables) that have a slack element in each stage."""
    slack, failed = (
        _reduce_by_cable(np.logical_or, rows, f["net/cable"][:]) for rows in (envelope.slack, envelope.gone)
    )
    return slack & ~failed


def cutting_columns(f: h5py.File, cutting: Cutting) -> dict[str, np.ndarray]:
    """Return the lengths [m] of the cables, one row each: form-found, unstressed, and as measured.

    length_in_form : nan for a cable that is absent from the form-found geometry

    A cable of unstressed length L0 is measured under the load N, at the temperature T above that of form
    finding. Its length is then L0 (1 + expansion T) (1 + N / EA), with logarithmic strain L0 (1 + expansion
    T) exp(N / EA). Bars are measured without a load.
    """
    cable, count = f["net/cable"][:], len(f["net/cable_names"])

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(cable, values, count)

    x, elements, L0 = states.start_position(f), f["net/elements"][:], f["net/unstressed_length"][:]
    L = np.where(states.absent(f), np.nan, np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1))
    load, warm, stretched = measured_lengths(f, cutting)
    return {
        "cable": f["net/cable_names"].asstr()[:].astype(object),
        "group": joined_words(element_groups(f), cable),
        "type": joined_words(element_types(f), cable),
        "elements": np.bincount(cable, minlength=count),
        "unstressed_length": total(L0),
        "length_in_form": total(L),
        "temperature": np.full(count, float(cutting.temperature)),
        "unstressed_length_at_temperature": total(warm),
        "measuring_load": load,
        "length_at_measuring_load": total(stretched),
        "mass": total(L0 * f["net/mass_per_length"][:]),
    }


def measured_lengths(f: h5py.File, cutting: Cutting) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the measuring loads (cables,) [N], and the lengths (m,) [m] of elements warm and loaded.

    The first lengths are unstressed at the measuring temperature, the second also under the measuring load.
    """
    cable, count = f["net/cable"][:], len(f["net/cable_names"])
    L0, EA = f["net/unstressed_length"][:], f["net/axial_stiffness"][:]
    mean = np.bincount(cable, states.start_tension(f) * L0, count) / np.bincount(cable, L0, count)
    first = np.unique(cable, return_index=True)[1]
    load = np.where(f["net/bar"][:][first], 0.0, mean if cutting.load is None else cutting.load)
    warm = heated_length(L0, f["net/expansion"][:], cutting.temperature)
    return load, warm, stretched_length(warm, load[cable], EA, states.strain_measure(f))


def excessive_load_warnings(f: h5py.File, cutting: Cutting) -> list[str]:
    """Return a warning if a given measuring load exceeds the tensile strength of cables."""
    strength = np.minimum.reduce(list(tensile_strengths(f).values()))
    exceeded = np.flatnonzero((strength < (cutting.load or 0.0)) & (f["net/bar"][:] == 0))
    if not len(exceeded):
        return []
    names = list(dict.fromkeys(f["net/cable_names"].asstr()[:][f["net/cable"][:][exceeded]]))
    count, shown, first = len(names), format_list(names), strength[exceeded[0]]
    return [messages.EXCESSIVE_MEASURING_LOAD(load=cutting.load, count=count, names=shown, strength=first)]


def missing_strength_warnings(
    f: h5py.File, envelope: states.Envelope, checked: list[ElementCheck]
) -> list[str]:
    """Return a warning if the tension of elements is not checked although others have a strength.

    It names cables without a breaking force, and bars in tension without any strength, that stand in a stage.
    """
    has_force, yields = (np.isfinite(strength) for strength in tensile_strengths(f).values())
    is_bar = f["net/bar"][:] == 1
    unchecked = ~is_concrete(f) & (envelope.most > NEGLIGIBLE * np.nanmax(envelope.most))
    for one in checked:
        if not one.check.compression:
            unchecked &= np.isnan(one.resistance)
    lacking = np.where(is_bar, unchecked, ~has_force & ~np.isnan(envelope.most))
    missing = lacking & (has_force.any() | np.where(is_bar, yields.any(), yields))
    used = [strength for one in checked for strength, _ in one.check.resistances]
    if "breaking_load" not in used or not missing.any():
        return []
    elements = count_with_ids("element", f["net/element_id"][:][missing])
    return [messages.NO_BREAKING_LOAD(elements=elements)]


def unchecked_compression_warnings(
    f: h5py.File, envelope: states.Envelope, checked: list[ElementCheck]
) -> list[str]:
    """Return a warning if no check of compression includes bars; those of concrete have a table instead.

    The compression of bending chains is part of their stability, which statics computes.
    """
    is_checked = (f["net/bar"][:] == 1) & ~is_bending(f) & ~is_concrete(f)
    compression = np.where(is_checked, np.fmax(-envelope.least, 0.0), 0.0)
    for one in checked:
        if one.check.compression:
            compression[np.isfinite(one.resistance)] = 0.0
    largest = np.nanmax(np.maximum(envelope.most, -envelope.least))
    missing, worst = compression > NEGLIGIBLE * largest, int(np.argmax(compression))
    if not missing.any():
        return []
    ids, state = f["net/element_id"][:], envelope.names[envelope.of_least[worst]]
    elements, force = count_with_ids("element", ids[missing]), compression[worst]
    return [messages.UNCHECKED_COMPRESSION(elements=elements, force=force, worst=ids[worst], state=state)]


def _ranking(utilisation: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Rank elements by utilisation; those without one follow in the order of their forces."""
    return np.where(np.isnan(utilisation), N / (1.0 + np.nanmax(np.abs(N))) - 2.0, utilisation)


def _first_by_cable(key: np.ndarray, cable: np.ndarray) -> np.ndarray:
    """Return for each cable the row of its element with the largest key (m,), the first of equal ones."""
    order = np.lexsort((np.arange(len(key)), -key, cable))
    return order[np.unique(cable[order], return_index=True)[1]]


def joined_words(words: np.ndarray, cable: np.ndarray) -> np.ndarray:
    """Join the different words (m,) of the elements of each cable, in alphabetical order."""
    parts = np.split(words[np.argsort(cable, kind="stable")], np.cumsum(np.bincount(cable))[:-1])
    lists = [sorted(set(part)) for part in parts]
    joined = [" + ".join(word or "none" for word in one) if one[1:] else one[0] for one in lists]
    return np.array(joined, object)


def _reduce_by_cable(reduce: np.ufunc, values: np.ndarray, cable: np.ndarray) -> np.ndarray:
    """Reduce values (..., m) of the elements to values (..., cables) of the cables."""
    order = np.argsort(cable, kind="stable")
    starts = np.unique(cable[order], return_index=True)[1]
    return reduce.reduceat(values[..., order], starts, axis=-1)


def _slack_stages(names: list[str], slack: np.ndarray) -> np.ndarray:
    """Join the names of the stages in which each column is slack; slack : (stages, k) bool."""
    return np.array(["; ".join(compress(names, is_slack)) for is_slack in slack.T], object)
