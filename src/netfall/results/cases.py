"""Static load cases and combinations of a result, with the outcome of each."""

from typing import NamedTuple

from netfall.results.file import job_of
from netfall.results.states import WITHOUT, ShownState, state_groups, states_of

PLAIN, KINDS = "case", ("ultimate", "service")  # a load case on its own; kinds of a combination (ULS, SLS)
EQUILIBRIUM = "equilibrium"


class Case(NamedTuple):
    """A static load case or combination and its equilibrium.

    name : as in the job; kind : PLAIN, or one of KINDS
    shown : the equilibrium, or the last state that the load path reached
    state : equilibrium | no_equilibrium | unstable | undecided
    load_factor : the largest that was reached; reason : why the load path ended there, "" if it did not
    """

    name: str
    kind: str
    shown: ShownState
    state: str = EQUILIBRIUM
    load_factor: float = 1.0
    reason: str = ""

    @property
    def carries(self) -> bool:
        """Whether the structure is in equilibrium under the full load."""
        return self.state not in WITHOUT


def cases_of(f) -> list[Case]:
    """Return the static load cases and combinations in the order of the job."""
    combinations = job_of(f).get("combination", [])
    kinds = {combination["name"]: combination.get("kind", KINDS[0]) for combination in combinations}
    places = [place for place in state_groups(f) if place.startswith("cases/")]
    return [_case(f, place, kinds.get(place.removeprefix("cases/"), PLAIN)) for place in places]


def _case(f, place: str, kind: str) -> Case:
    attrs, (shown,) = f[place].attrs, states_of(f, place)
    name = place.removeprefix("cases/")
    if "state" not in attrs:
        return Case(name, kind, shown, EQUILIBRIUM if f[place]["stable"][()] else "unstable")
    return Case(name, kind, shown, str(attrs["state"]), float(attrs["load_factor"]), str(attrs["reason"]))
