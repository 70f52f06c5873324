"""The outcomes of a run, as a study keeps them: what each is, its unit, and what stands there without it."""

from typing import NamedTuple

NAN = float("nan")


class Outcome(NamedTuple):
    """A column of /members of a study file that comes of a run.

    empty : while nothing is known, or where there is nothing of the kind; its type is that of the column
    of_losses : there if members are lost
    of_run : a run gives it; else the table of the study adds it
    """

    name: str
    empty: float | int | str
    unit: str = ""
    of_losses: bool = False
    of_run: bool = True

    @property
    def dtype(self) -> type:
        """Of the column."""
        return object if self.empty == "" else type(self.empty)


OUTCOMES = (
    Outcome("first_fracture", NAN, "s"),
    Outcome("first_element", -1),
    Outcome("first_element_id", -1, of_run=False),
    Outcome("broken", 0),
    Outcome("roof_lost", NAN),
    Outcome("displacement_max", NAN, "m"),
    Outcome("tension_max", NAN, "N"),
    Outcome("utilisation_max", NAN),
    Outcome("balance_error", NAN),
    Outcome("dynamic_factor_max", NAN, of_losses=True),
    Outcome("dynamic_factor_element", -1, of_losses=True),
    Outcome("dynamic_factor_element_id", -1, of_losses=True, of_run=False),
    Outcome("rest_after_loss", "", of_losses=True),
    Outcome("gusts", 0, of_losses=True),
    Outcome("duration", NAN, "s", of_run=False),
    Outcome("seconds", NAN, "s"),
    Outcome("state", ""),
    Outcome("reason", ""),
)
BY_NAME = {each.name: each for each in OUTCOMES}
OF_RUN = tuple(each for each in OUTCOMES if each.of_run)
# What is told of a run of which nothing is known; times and elements : of its fractures
NOTHING = {each.name: each.empty for each in OF_RUN} | {"times": [], "elements": []}
