"""The static cases and combinations of a result: what they are of, and what came of each."""

from typing import NamedTuple

from netfall.results.file import job_of
from netfall.results.states import WITHOUT, ShownState, state_groups, states_of

PLAIN, KINDS = "case", ("ultimate", "service")  # a case as it stands; a combination of either kind
EQUILIBRIUM = "equilibrium"


class Case(NamedTuple):
    """A case or combination.

    name : as in the job; kind : PLAIN, or one of KINDS; shown : its equilibrium, or that which was reached
    state : equilibrium | no_equilibrium | unstable | undecided; load_factor : reached; reason : why no more
    """

    name: str
    kind: str
    shown: ShownState
    state: str = EQUILIBRIUM
    load_factor: float = 1.0
    reason: str = ""

    @property
    def carries(self) -> bool:
        """Whether an equilibrium was found under the whole load."""
        return self.state not in WITHOUT


def cases_of(f) -> list[Case]:
    """The cases and combinations, in the order of the job."""
    combinations = job_of(f).get("combination", [])
    kinds = {each["name"]: each.get("kind", KINDS[0]) for each in combinations}
    places = [place for place in state_groups(f) if place.startswith("cases/")]
    return [_case(f, place, kinds.get(place.removeprefix("cases/"), PLAIN)) for place in places]


def _case(f, place: str, kind: str) -> Case:
    attrs, (shown,) = f[place].attrs, states_of(f, place)
    name = place.removeprefix("cases/")
    if "state" not in attrs:
        return Case(name, kind, shown, EQUILIBRIUM if f[place]["stable"][()] else "unstable")
    return Case(name, kind, shown, str(attrs["state"]), float(attrs["load_factor"]), str(attrs["reason"]))
