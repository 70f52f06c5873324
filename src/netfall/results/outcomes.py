"""Outcomes of a run that a study records: name, unit, and value while unknown."""

from typing import NamedTuple

NAN = float("nan")


class MemberColumn(NamedTuple):
    """A column of /members of a study file.

    empty : value while the outcome is unknown or does not apply; its type is that of the column
    of_losses : present if members are removed
    of_depth : present if a depth is given
    of_run : a run returns the value; otherwise the table of the study adds it
    of_motion : needs a dynamic stage; equilibria lack it
    """

    name: str
    empty: float | int | str
    unit: str = ""
    of_losses: bool = False
    of_depth: bool = False
    of_run: bool = True
    of_motion: bool = False

    @property
    def dtype(self) -> type:
        """Type of the column."""
        return object if self.empty == "" else type(self.empty)

    @property
    def measured(self) -> bool:
        """Whether the value measures damage, so that a failure criterion may refer to it."""
        return self.of_run and self.dtype in (int, float) and self.name not in NO_MEASURE


NO_MEASURE = (
    *("first_element", "first_element_id", "dynamic_factor_element", "dynamic_factor_element_id"),
    *("tension_ratio_element", "tension_ratio_element_id"),
    *("gusts", "seconds"),
)
OUTCOMES = (
    MemberColumn("first_fracture", NAN, "s", of_motion=True),
    MemberColumn("first_element", -1),
    MemberColumn("first_element_id", -1),
    MemberColumn("broken", 0, of_motion=True),
    MemberColumn("roof_lost", NAN, of_motion=True),
    MemberColumn("displacement_max", NAN, "m"),
    MemberColumn("tension_max", NAN, "N"),
    MemberColumn("utilisation_max", NAN),
    MemberColumn("utilisation_before_break", NAN),
    MemberColumn("sunk_area", NAN, of_depth=True),
    MemberColumn("balance_error", NAN, of_motion=True),
    MemberColumn("balance_error_attached", NAN, of_motion=True),
    MemberColumn("tension_ratio_max", NAN, of_losses=True),
    MemberColumn("tension_ratio_element", -1, of_losses=True),
    MemberColumn("tension_ratio_element_id", -1, of_losses=True),
    MemberColumn("dynamic_factor_max", NAN, of_losses=True),
    MemberColumn("dynamic_factor_element", -1, of_losses=True),
    MemberColumn("dynamic_factor_element_id", -1, of_losses=True),
    MemberColumn("rest_after_loss", "", of_losses=True),
    MemberColumn("gusts", 0, of_losses=True),
    MemberColumn("duration", NAN, "s", of_run=False),
    MemberColumn("seconds", NAN, "s"),
    MemberColumn("state", ""),
    MemberColumn("reason", ""),
)
BY_NAME = {each.name: each for each in OUTCOMES}
OF_RUN = tuple(each for each in OUTCOMES if each.of_run)
# Outcomes of a run without any result; times and elements : of its fractures
NOTHING = {each.name: each.empty for each in OF_RUN} | {"times": [], "elements": []}
