"""Actions of static cases and combinations: loads, temperature, prestress, settlements of supports.

A single case has all loads, with the values that it sets. A combination adds the difference between the
values of a case and those of [load], times the factor of the case. The effects of two cases therefore add. A
static wind exerts the pressure of the mean wind of [wind].
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from netfall.core.functions import lengths
from netfall.job.derived import load_settings, temperature_in
from netfall.job.job import Job
from netfall.job.keys.entries import Case, Combination, action_factor, apply_settings
from netfall.job.keys.models import Load
from netfall.loads.loads import dead_load, drag_areas, live_load, wind_force_area
from netfall.loads.wind.field import mean_wind_square
from netfall.loads.wind.measured import point_weights
from netfall.model.model import Model
from netfall.physics.law.measures import heated_length, prestressed_length

ALL_LOADS = "all loads"


@dataclass(frozen=True)
class Actions:
    """Actions in one equilibrium; None: as in the model.

    load : (n, 3) [N]; L0 : (m,) [m]; spring_rest, settlement : (n, 3) [m]
    """

    load: np.ndarray
    L0: np.ndarray | None = None
    spring_rest: np.ndarray | None = None
    settlement: np.ndarray | None = None


class StaticLoad(NamedTuple):
    """A load for which an equilibrium is computed.

    kind : "permanent", "case", "combination", "step", "at once" or "initial_state", see
        `driver.problem`; or "removal", `driver.removal.equilibria`
    title : its name in messages
    load : (n, 3) [N], owned and halo; factor : of the variable load; name : of a case
    from_permanent : whether it starts from the equilibrium under the permanent loads, not from the last one
    start_factor : load factor of the equilibrium that it starts from
    weights : factor of the self weight in it
    L0, spring_rest, settlement : as in `Actions`, on this rank; None: as in the model
    before : arrays of the state before unstressed lengths and held nodes changed, by name; None: no change
    """

    kind: str
    title: str
    load: np.ndarray
    factor: float = 0.0
    name: str = ""
    from_permanent: bool = False
    start_factor: float = 0.0
    L0: np.ndarray | None = None
    spring_rest: np.ndarray | None = None
    settlement: np.ndarray | None = None
    weights: float = 0.0
    before: dict[str, np.ndarray] | None = None

    def reached(self, share: float) -> float:
        """Return the load factor at a share of the load path from the start; nan for permanent loads."""
        reached = self.start_factor + share * (self.factor - self.start_factor)
        return np.nan if self.kind == "permanent" else reached


def case_actions(job: Job, case: Case, model: Model) -> Actions:
    """Return the actions of a case: permanent loads and [load], with the values of the case. Rank 0."""
    load, roof = load_settings(job), model.roof
    changed = apply_settings(load, "load", case.set)
    nodes = model.forces_of(model.layout.loads) + _load_table_forces(model, case)
    force = model.loading.permanent + live_load(changed, roof, nodes)
    if _sets_key(case, "dead"):
        force = force + dead_load(changed, roof) - dead_load(load, roof)
    pressure = _case_pressure_forces(model, case, changed)
    inputs = model.layout.cases[case.name]
    L0, spring_rest = None, _settled_spring_rest(model, model.spring_rest, inputs.settlement)
    if _sets_key(case, "temperature"):
        L0 = heated_length(model.cut_length, model.net.expansion, temperature_in(job, case))
    return Actions(force if pressure is None else force + pressure, L0, spring_rest, inputs.settlement)


def combination_actions(job: Job, combination: Combination, model: Model) -> Actions:
    """Return the actions of a combination. Rank 0."""
    load, net, factor = load_settings(job), model.net, partial(action_factor, combination)
    live = live_load(load, model.roof, model.forces_of(model.layout.loads))
    force = factor("permanent") * model.loading.permanent + factor("load") * live
    settlement = None
    for case in job.cases:
        share, inputs = factor(case.name), model.layout.cases[case.name]
        if share:  # values of the case less those of [load]
            changed, nodes = apply_settings(load, "load", case.set), _load_table_forces(model, case)
            difference = live_load(changed, model.roof, nodes)
            difference -= live_load(load, model.roof, np.zeros_like(nodes))
            difference += dead_load(changed, model.roof) - dead_load(load, model.roof)
            pressure = _case_pressure_forces(model, case, changed)
            force += share * (difference if pressure is None else difference + pressure)
            if inputs.settlement is not None:
                settlement = share * inputs.settlement + (0.0 if settlement is None else settlement)
    prestress, L = factor("prestress"), lengths(np.diff(model.x[net.elements], axis=1)[:, 0])
    L0 = prestressed_length(model.cut_length, L, model.N, net.EA, prestress, job.cable.strain_measure)
    spring_rest = model.spring_rest if prestress == 1.0 else prestress * model.spring_rest
    spring_rest = _settled_spring_rest(model, spring_rest, settlement)
    L0 = heated_length(L0, net.expansion, temperature_in(job, combination))
    return Actions(force, L0, spring_rest, settlement)


def _sets_key(case: Case, key: str) -> bool:
    """Return whether a case sets a key of [load], possibly in a zone."""
    return any(name.startswith("load.") and name.endswith(f".{key}") for name in case.set)


def _load_table_forces(model: Model, case: Case) -> np.ndarray:
    """Compute the forces (n, 3) [N] of the load table of a case; zero without loads of nodes or elements."""
    loads = model.layout.load_tables.get(case.load_table or "")
    return np.zeros_like(model.x) if loads is None else model.forces_of(loads)


def _case_pressure_forces(model: Model, case: Case, load: Load) -> np.ndarray | None:
    """Compute the forces (n, 3) [N] of static wind and pressure table of a case; None: the case has neither.

    load : [load] with the values of the case
    """
    inputs, force = model.layout.cases[case.name], None
    if inputs.wind is not None:
        square = mean_wind_square(model.x, inputs.wind)[:, None]
        drag = drag_areas(model.roof, inputs.wind, load)
        force = inputs.wind.pressure_factor * (wind_force_area(inputs.wind, model.roof, drag) * square)
    if inputs.points is not None:
        force = (0.0 if force is None else force) + pressure_table_forces(model, case)
    return force


def pressure_table_forces(model: Model, case: Case) -> np.ndarray:
    """Compute the forces (n, 3) [N] of the pressure table of a case."""
    inputs = model.layout.cases[case.name]
    corner, weight = point_weights(model.x, inputs.points, inputs.points.shape[1])
    pressure = (weight * inputs.pressure[corner]).sum(1)
    return -pressure[:, None] * model.roof.vector


def _settled_spring_rest(
    model: Model, spring_rest: np.ndarray, settlement: np.ndarray | None
) -> np.ndarray | None:
    """Return the displacements (n, 3) [m] at which settled springs carry no force; None: no change."""
    if not model.net.spring.any() or (settlement is None and spring_rest is model.spring_rest):
        return None
    if settlement is None:
        return spring_rest
    return spring_rest + np.where(model.net.spring > 0.0, settlement, 0.0)
