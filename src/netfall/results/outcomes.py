"""Outcomes of a run that a study records: name, unit, and value while unknown."""

from typing import Any, NamedTuple

NAN = float("nan")


class OutcomeColumn(NamedTuple):
    """A column of /samples of a study file.

    empty : value while the outcome is unknown or does not apply; its type is that of the column
    needs_removal : present if members are removed
    needs_depth : present if a depth is given
    is_outcome : a run returns the value; otherwise the table of the study adds it
    needs_dynamics : needs a dynamic stage; equilibria lack it
    """

    name: str
    empty: float | int | str
    unit: str = ""
    needs_removal: bool = False
    needs_depth: bool = False
    is_outcome: bool = True
    needs_dynamics: bool = False

    @property
    def dtype(self) -> type:
        """Type of the column."""
        return object if self.empty == "" else type(self.empty)

    @property
    def measured(self) -> bool:
        """Whether the value measures damage, so that a failure criterion may refer to it."""
        return self.is_outcome and self.dtype in (int, float) and self.name not in NOT_DAMAGE


NOT_DAMAGE = (
    *("first_element", "first_element_id", "dynamic_factor_element", "dynamic_factor_element_id"),
    *("tension_ratio_element", "tension_ratio_element_id"),
    *("gusts", "seconds"),
)
OUTCOMES = (
    OutcomeColumn("first_fracture", NAN, "s", needs_dynamics=True),
    OutcomeColumn("first_element", -1),
    OutcomeColumn("first_element_id", -1),
    OutcomeColumn("broken", 0, needs_dynamics=True),
    OutcomeColumn("detached_area", NAN, needs_dynamics=True),
    OutcomeColumn("displacement_max", NAN, "m"),
    OutcomeColumn("tension_max", NAN, "N"),
    OutcomeColumn("utilisation_max", NAN),
    OutcomeColumn("utilisation_before_break", NAN),
    OutcomeColumn("sunk_area", NAN, needs_depth=True),
    OutcomeColumn("energy_balance_error", NAN, needs_dynamics=True),
    OutcomeColumn("balance_error_attached", NAN, needs_dynamics=True),
    OutcomeColumn("tension_ratio_max", NAN, needs_removal=True),
    OutcomeColumn("tension_ratio_element", -1, needs_removal=True),
    OutcomeColumn("tension_ratio_element_id", -1, needs_removal=True),
    OutcomeColumn("dynamic_factor_max", NAN, needs_removal=True),
    OutcomeColumn("dynamic_factor_element", -1, needs_removal=True),
    OutcomeColumn("dynamic_factor_element_id", -1, needs_removal=True),
    OutcomeColumn("equilibrium_after_removal", "", needs_removal=True),
    OutcomeColumn("gusts", 0, needs_removal=True),
    OutcomeColumn("duration", NAN, "s", is_outcome=False),
    OutcomeColumn("seconds", NAN, "s"),
    OutcomeColumn("state", ""),
    OutcomeColumn("reason", ""),
)
OUTCOME_BY_NAME = {each.name: each for each in OUTCOMES}
RUN_OUTCOMES = tuple(each for each in OUTCOMES if each.is_outcome)
# Outcomes of a run without any result; times and elements : of its fractures
NOTHING: dict[str, Any] = {each.name: each.empty for each in RUN_OUTCOMES} | {"times": [], "elements": []}
