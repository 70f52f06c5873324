"""State of a result for other programs: points, lines, unique ids, tensions."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.exchange import messages
from netfall.job.derived import temperature_in
from netfall.job.keys.entries import Combination, action_factor
from netfall.job.validate import Validator
from netfall.job.values import counted, suggest
from netfall.physics.law.measures import heated_length, prestressed_length
from netfall.results.file import Case, read_cases, read_job_tables
from netfall.results.reader import Result
from netfall.results.states import (
    FORM_GROUP,
    PERMANENT,
    absent,
    group_title,
    last_stage,
    no_equilibrium,
    start_name,
    start_position,
    start_tension,
    strain_measure,
    support_angles,
)

MARK = "by netfall"  # mark in each exported file; only files with the mark are replaced
NET_RECORD = "provenance/net"  # group of the data that the tables of a net need in addition to /net


@dataclass(frozen=True)
class ExportState:
    """State of p points, the nodes of the net and split-off points, and of m elements.

    name : description; time : [s], None: static; case : of the job, or ""; without both it is the form
    position, displacement : (p, 3) [m], from the form; fixed : (p, 3) bool
    node_id : (p,) unique; points that split off have ids above those of the net
    ends : (m, 2) rows of points; element_id : (m,) unique; cable : (m,) ids of the tables
    group : (m,) names; tension : (m,) [N]; broken : (m,) bool
    unstressed_length : (m,) [m] at the temperature of form finding
    unstressed_length_warm : (m,) [m] at that of the loads or of the case, and with its factor of prestress
    warnings : on the state, for the user
    """

    name: str
    time: float | None
    case: str
    position: np.ndarray
    displacement: np.ndarray
    node_id: np.ndarray
    fixed: np.ndarray
    ends: np.ndarray
    element_id: np.ndarray
    cable: np.ndarray
    group: np.ndarray
    tension: np.ndarray
    unstressed_length: np.ndarray
    unstressed_length_warm: np.ndarray
    broken: np.ndarray
    warnings: list[str]

    @property
    def is_form(self) -> bool:
        """Whether the state is the form, or the net as given."""
        return self.time is None and not self.case

    def out(self) -> np.ndarray:
        """Select the elements (m,) that left the net.

        They were dismantled, removed, or broke without a fragment.
        """
        return self.ends[:, 0] == self.ends[:, 1]

    def connected(self) -> np.ndarray:
        """Select the points (p,) that are ends of elements in the net."""
        selected = np.zeros(len(self.node_id), bool)
        selected[self.ends[~self.out()]] = True
        return selected

    def removed_element_lines(self, objects: str) -> list[str]:
        """Return a line on the elements that left the net, if any; objects : missing objects of the file."""
        ids = self.element_id[self.out()]
        return [f"{counted('element', ids)} out of the net by then: no {objects}"] if len(ids) else []

    def unstressed(self) -> dict[str, np.ndarray]:
        """Return the unstressed lengths by name, also those under the loads if they differ."""
        by_name = {"unstressed_length": self.unstressed_length}
        if (self.unstressed_length_warm != self.unstressed_length).any():
            by_name["unstressed_length_warm"] = self.unstressed_length_warm
        return by_name


def export_state(result: Result, time: float | None, case: str | None) -> ExportState:
    """Return the form, the snapshot nearest to a time [s] (inf: the last one), or the equilibrium of a case.

    Raises InputError for a time that the run did not reach, or an unknown case.
    """
    places = FORM_GROUP, "deviation", last_stage(result.file)
    if time is None:
        position, tension = form_of(result)
        name = start_name(result.file).removeprefix("the ")
        displacement = np.zeros_like(position)
        if case is not None:
            shown = find_case(result, case).shown
            displacement, tension, name = shown.position() - position, shown.tension(), shown.name
            position = shown.position()
        broken, ends = np.zeros(len(tension), bool), result.file["net/elements"][:]
        removed = absent(result.file)  # after the last stage of erection
        ends[removed, 1] = ends[removed, 0]
    else:
        frame = result.frame(min(time, float(result.time[-1])) if np.isinf(time) else time)
        position, tension, broken, ends = frame.position, frame.tension, frame.broken, frame.ends
        displacement, places = frame.displacement, (*places, PERMANENT, "statics", "initial_state")
        time, name = frame.time, f"t = {frame.time:g} s"
    split_count = len(position) - len(result.nodes["id"])
    return ExportState(
        name=name,
        time=time,
        case=case or "",
        position=position,
        displacement=displacement,
        node_id=_unique(result.nodes["id"], split_count),
        fixed=np.vstack([result.nodes["fixed"], np.zeros((split_count, 3), bool)]),
        ends=ends,
        element_id=_unique(result.elements["id"]),
        cable=result.elements["id"],
        group=result.elements["group"],
        tension=tension,
        unstressed_length=result.elements["unstressed_length"],
        unstressed_length_warm=_warm_lengths(result, case),
        broken=broken,
        warnings=no_equilibrium_warnings(result.file, *places),
    )


def _warm_lengths(result: Result, case: str | None) -> np.ndarray:
    """Return the unstressed lengths (m,) [m] under the loads, or in a case or combination."""
    f, elements = result.file, result.elements
    if case is None:
        return elements["unstressed_length_warm"]
    job: Any = SimpleNamespace(**Validator("", []).sections(read_job_tables(f)))
    action = next(one for one in (*job.cases, *job.combinations) if one.name == case)
    factor = action_factor(action, "prestress") if isinstance(action, Combination) else 1.0
    x, tension = form_of(result)
    L, EA, strain = lengths(x, f["net/elements"][:]), elements["axial_stiffness"], strain_measure(f)
    L0 = prestressed_length(elements["unstressed_length"], L, tension, EA, factor, strain)
    return heated_length(L0, f["net/expansion"][:], temperature_in(job, action))


def guided_at_an_angle(result: Result, fixed: np.ndarray) -> np.ndarray:
    """Select points that are held along one horizontal axis at an angle; fixed : (p, 3) bool, of a state."""
    selected, angle = fixed[:, 0] != fixed[:, 1], support_angles(result.file)
    selected[: len(result.nodes["id"])] &= angle is not None and angle != 0.0
    return selected


def held_axes(result: Result, state: ExportState) -> np.ndarray:
    """Return the axes x, y, z (p, 3) bool along which points are held; in plan none at an angle."""
    return state.fixed & ~(guided_at_an_angle(result, state.fixed)[:, None] & [True, True, False])


def no_equilibrium_warnings(f: Any, *places: str) -> list[str]:
    """Return a warning if a group, of which a state is exported, ended without equilibrium; "": no group."""
    failed = [group_title(f, place) for place in places if place and place in f and no_equilibrium(f[place])]
    return [messages.STATE_WITHOUT_EQUILIBRIUM(state=name) for name in failed[:1]]


def find_case(result: Result, name: str) -> Case:
    """Return a case or combination of a result. Raises InputError if it is unknown or has no equilibrium."""
    cases = read_cases(result.file)
    match = next((case for case in cases if case.name == name), None)
    if match is None:
        names = [case.name for case in cases]
        advice = suggest(name, names) if names else "it has no cases"
        raise InputError(messages.UNKNOWN_CASE(case=name, path=result.path, advice=advice))
    if not match.carries:
        raise InputError(messages.CASE_WITHOUT_EQUILIBRIUM(case=name, reason=match.reason))
    return match


def form_of(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Return the position (n, 3) [m] and tension (m,) [N] of the form, or of the net as given without one."""
    return start_position(result.file), start_tension(result.file)


def lengths(x: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Compute the lengths (m,) [m] of elements."""
    return np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)


def _unique(ids: np.ndarray, added: int = 0) -> np.ndarray:
    """Make ids unique: repeated ids, and `added` further ones at the end, get numbers above all ids."""
    first = np.zeros(len(ids), bool)
    first[np.unique(ids, return_index=True)[1]] = True
    unique, highest = ids.copy(), int(ids.max())
    unique[~first] = highest + 1 + np.arange((~first).sum())
    return np.append(unique, int(unique.max()) + 1 + np.arange(added))
