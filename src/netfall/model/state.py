"""The state of one rank: its arrays, with what the model has of them."""

import numpy as np

from netfall.mechanics.bending import Joints
from netfall.mechanics.fields import FIELDS, Features
from netfall.mechanics.slip.motion import places_of
from netfall.mechanics.state import State
from netfall.model.model import Model
from netfall.parallel.subdomain import Distribution, rows_of


def make_state(distribution: Distribution, model: Model | None, features: Features) -> State:
    """The state of one rank; fields that are `given` start with what the model has. Collective."""
    subdomain = distribution.subdomain
    width = int(np.bincount(subdomain.ends.ravel()).max(initial=0))
    state = State(features, subdomain.n_owned, subdomain.n_halo, len(subdomain.element_gid), width)
    state.gid[:], state.ends[:] = subdomain.particle_gid, subdomain.ends
    state.owned[:] = subdomain.element_owned
    for row in FIELDS:
        if row.given and features.has(row):
            spread = distribution.particles if row.entity == "particle" else distribution.elements
            getattr(state, row.name)[:] = spread(None if model is None else model.column(row.name))
    if features.bending:
        _place_joints(distribution, model, state)
    if features.sliding:
        state.places = places_of(state.ends, state.slip_place, state.slip_along, state.n_owned)
    return state


def _place_joints(distribution: Distribution, model: Model | None, state: State) -> None:
    """Give a state its joints, and which of them each of its elements has at its ends. Collective."""
    d, of = distribution.subdomain, model and model.joints
    owned = (d.joints[:, 1] < d.n_owned).astype(np.uint8)
    state.joints = Joints(d.joints, *(distribution.joints(of and of[k]) for k in (1, 2)), owned)
    at = distribution.elements(model and model.layout.chains.at)
    state.joint_at = np.where(at >= 0, rows_of(d.joint_gid, at.ravel()).reshape(at.shape), at)
