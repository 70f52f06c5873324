"""One state of a result, as other programs take it: points, lines, ids that are unique, tensions."""

from dataclasses import dataclass

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.values import counted, nearest
from netfall.results.cases import Case, cases_of
from netfall.results.result import Result
from netfall.results.states import absent, start_position, start_tension

AXES = ("x", "y", "z")
MARK = "by netfall"  # stands in each file that is written: what has it may be replaced

RECORD = "provenance/net"  # what the tables of a net need besides /net


@dataclass(frozen=True)
class State:
    """p points, the nodes of the net and those that split off; m elements.

    name : what it is; time : [s], None: at rest; case : of the job, "": none; without either it is the form
    position, displacement : (p, 3) [m], from the form; fixed : (p, 3) bool
    node_id : (p,) unique, of points that split off above those of the net
    ends : (m, 2) rows of points; element_id : (m,) unique; cable : (m,) ids of the tables
    group : (m,) names; tension : (m,) [N]; broken : (m,) bool
    unstressed_length, unstressed_length_warm : (m,) [m] at the temperature of form finding, of the loads
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

    @property
    def is_form(self) -> bool:
        """Whether it is the form, or the net as given."""
        return self.time is None and not self.case

    def out(self) -> np.ndarray:
        """(m,) bool, elements that were taken out of the net: struck, lost, or broken without a fragment."""
        return self.ends[:, 0] == self.ends[:, 1]

    def told_out(self, what: str) -> list[str]:
        """A line on those, if there are any, for a file that leaves them out; what : as what."""
        ids = self.element_id[self.out()]
        return [f"{counted('element', ids)} out of the net by then: no {what}"] if len(ids) else []

    def unstressed(self) -> dict[str, np.ndarray]:
        """The unstressed lengths by name; at the temperature of the loads where they have one."""
        found = {"unstressed_length": self.unstressed_length}
        if (self.unstressed_length_warm != self.unstressed_length).any():
            found["unstressed_length_warm"] = self.unstressed_length_warm
        return found


def state_of(result: Result, time: float | None, case: str | None = None) -> State:
    """The form, the frame nearest to a time [s] (inf: the last one), or the equilibrium of a case.

    Raises InputError for a time that the run did not reach, a case that it does not have.
    """
    if time is None:
        position, tension, name = form_of(result) + ("form",)
        moved = np.zeros_like(position)
        if case is not None:
            shown = case_named(result, case).shown
            moved, tension, name = shown.position() - position, shown.tension(), shown.name
            position = shown.position()
        broken, ends = np.zeros(len(tension), bool), result.file["net/elements"][:]
        gone = absent(result.file)  # after the last stage of erection
        ends[gone, 1] = ends[gone, 0]
    else:
        frame = result.frame(min(time, float(result.time[-1])) if np.isinf(time) else time)
        position, tension, broken, ends = frame.position, frame.tension, frame.broken, frame.ends
        moved = frame.displacement
        time, name = frame.time, f"t = {frame.time:g} s"
    split = len(position) - len(result.nodes["id"])
    return State(
        name=name,
        time=time,
        case=case or "",
        position=position,
        displacement=moved,
        node_id=_unique(result.nodes["id"], split),
        fixed=np.vstack([result.nodes["fixed"], np.zeros((split, 3), bool)]),
        ends=ends,
        element_id=_unique(result.elements["id"]),
        cable=result.elements["id"],
        group=result.elements["group"],
        tension=tension,
        unstressed_length=result.elements["unstressed_length"],
        unstressed_length_warm=result.elements["unstressed_length_warm"],
        broken=broken,
    )


def case_named(result: Result, name: str) -> Case:
    """A case or combination of a result. Raises InputError where there is none, or no equilibrium in it."""
    cases = cases_of(result.file)
    found = next((case for case in cases if case.name == name), None)
    if found is None:
        known = [case.name for case in cases]
        advice = nearest(name, known) if known else "its job has no [[case]]"
        raise InputError(f"--case {name}: no such case in {result.path}; {advice}")
    if not found.carries:
        raise InputError(f"--case {name}: has no equilibrium ({found.reason}); expected a case that has one")
    return found


def form_of(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Position (n, 3) [m] and tension (m,) [N] of the form; of the given geometry if none was found."""
    return start_position(result.file), start_tension(result.file)


def lengths(x: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Lengths (m,) [m]."""
    return np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)


def _unique(ids: np.ndarray, more: int = 0) -> np.ndarray:
    """The ids; those that stand before already, and `more` at the end, get numbers above all."""
    first = np.zeros(len(ids), bool)
    first[np.unique(ids, return_index=True)[1]] = True
    found, highest = ids.copy(), int(ids.max())
    found[~first] = highest + 1 + np.arange((~first).sum())
    return np.append(found, int(found.max()) + 1 + np.arange(more))
