"""State of one rank: its arrays, filled with the initial values of the model."""

from collections.abc import Callable

import numpy as np

from netfall.geometry.sections import ROUNDING, values_of_key
from netfall.geometry.turned import global_held_axes, global_spring_stiffness, rotation_column
from netfall.job.job import Job
from netfall.model.model import Model
from netfall.parallel.subdomain import Distribution, rows_of
from netfall.physics.bending import Joints
from netfall.physics.fields import FIELDS, Features, Field
from netfall.physics.slip.motion import slip_points_of
from netfall.physics.state import State


def compressive_fracture_strain(model: Model) -> np.ndarray:
    """Return the fracture strains in compression (m,); -inf: none, or bars buckle before they break."""
    net, strain = model.net, model.net.fracture_strain
    by_load = np.isfinite(net.breaking_load) & (net.breaking_load <= net.EA * strain * (1.0 + ROUNDING))
    return np.where(net.buckling & ~(by_load & (model.euler < net.breaking_load)), -strain, -np.inf)


# Initial values of fields that are not attributes of the model or its net.
INITIAL_VALUES: dict[str, Callable[[Model], np.ndarray]] = {
    "x_start": lambda model: model.x,
    "free": lambda model: 1 - global_held_axes(model.net, model.net.fixed).astype(np.uint8),
    "spring": lambda model: global_spring_stiffness(model.net),
    "turned": lambda model: rotation_column(model.net, model.net.fixed),
    "course": lambda model: model.motion.course,
    "strand": lambda model: model.L0,
    "slip_place": lambda model: model.layout.slides.place,
    "slip_along": lambda model: model.layout.slides.along,
    "slip_share": lambda model: model.layout.slides.share,
    "friction": lambda model: model.layout.slides.at_nodes(model.layout.slides.friction, model.net.n),
    "resistance": lambda model: model.layout.slides.at_nodes(model.layout.slides.resistance, model.net.n),
    "eps_c": compressive_fracture_strain,
    "drag_size": lambda model: model.drag.size,
    "steady_speed": lambda model: model.drag.speed,
}


def initial_value(job: Job, model: Model, field: Field) -> np.ndarray:
    """Return the initial values of a field; those of a key of [cable] are 0 for elements without it."""
    name = field.name
    if field.feature.startswith("cable."):
        return values_of_key(job, model.net, field.feature.removeprefix("cable."), 0.0)
    if name in INITIAL_VALUES:
        return INITIAL_VALUES[name](model)
    return getattr(model if hasattr(model, name) else model.net, name)


def make_state(distribution: Distribution, job: Job, model: Model | None, features: Features) -> State:
    """Build the state of one rank; `given` fields start with the values of the model. Collective."""
    subdomain = distribution.subdomain
    width = int(np.bincount(subdomain.ends.ravel()).max(initial=0))
    state = State(features, subdomain.n_owned, subdomain.n_halo, len(subdomain.element_gid), width)
    state.gid[:], state.ends[:] = subdomain.particle_gid, subdomain.ends
    state.owned[:] = subdomain.element_owned
    for row in FIELDS:
        if row.given and features.has(row):
            distribute = distribution.particles if row.entity == "particle" else distribution.elements
            getattr(state, row.name)[:] = distribute(
                None if model is None else initial_value(job, model, row)
            )
    if features.drags:
        state.wind_along = distribution.comm.bcast(model and model.drag.along)
    if features.bending:
        _place_joints(distribution, model, state)
    if features.slip:
        slip_at = distribution.elements(None if model is None else model.layout.slides.at)
        state.slip_at[:] = rows_of(subdomain.particle_gid, slip_at.ravel()).reshape(slip_at.shape)
    if features.sliding:
        segment = distribution.elements(None if model is None else model.layout.slides.segment)
        state.places = slip_points_of(state, segment)
    return state


def _place_joints(distribution: Distribution, model: Model | None, state: State) -> None:
    """Give a state its joints, and each of its elements the joints at its two ends. Collective."""
    subdomain, joints = distribution.subdomain, None if model is None else model.joints
    owned = (subdomain.joints[:, 1] < subdomain.n_owned).astype(np.uint8)
    stiffness = distribution.joints(None if joints is None else joints.stiffness)
    rest = distribution.joints(None if joints is None else joints.rest)
    state.joints = Joints(subdomain.joints, stiffness, rest, owned)
    joint_at = distribution.elements(None if model is None else model.layout.chains.at)
    state.joint_at = np.where(
        joint_at >= 0, rows_of(subdomain.joint_gid, joint_at.ravel()).reshape(joint_at.shape), joint_at
    )
