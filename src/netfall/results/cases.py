"""Static load cases and combinations of a result, with the outcome of each."""

from typing import Any, NamedTuple

from netfall.results.file import read_job_tables
from netfall.results.states import WITHOUT, StateView, equilibrium_groups, group_equilibria

# a load case on its own; kinds of a combination
PLAIN, COMBINATION_KINDS = "case", ("ULS", "SLS")
EQUILIBRIUM = "equilibrium"


class Case(NamedTuple):
    """A static load case or combination and its equilibrium.

    name : as in the job; kind : PLAIN, or one of COMBINATION_KINDS
    shown : the equilibrium, or the last state that the load path reached
    state : equilibrium | no_equilibrium | unstable | undecided
    load_factor : the largest that was reached; reason : why the load path ended there, "" if it did not
    """

    name: str
    kind: str
    shown: StateView
    state: str = EQUILIBRIUM
    load_factor: float = 1.0
    reason: str = ""

    @property
    def carries(self) -> bool:
        """Whether the structure is in equilibrium under the full load."""
        return self.state not in WITHOUT


def read_cases(f: Any) -> list[Case]:
    """Return the static load cases and combinations in the order of the job."""
    combinations = read_job_tables(f).get("combination", [])
    kinds = {
        combination["name"]: combination.get("kind", COMBINATION_KINDS[0]) for combination in combinations
    }
    places = [place for place in equilibrium_groups(f) if place.startswith("cases/")]
    return [_case(f, place, kinds.get(place.removeprefix("cases/"), PLAIN)) for place in places]


def _case(f: Any, place: str, kind: str) -> Case:
    attrs, (shown,) = f[place].attrs, group_equilibria(f, place)
    name = place.removeprefix("cases/")
    if "state" not in attrs:
        return Case(name, kind, shown, EQUILIBRIUM if f[place]["stable"][()] else "unstable")
    return Case(name, kind, shown, str(attrs["state"]), float(attrs["load_factor"]), str(attrs["reason"]))
