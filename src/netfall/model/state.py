"""The state of one rank: its arrays, with what the model has of them."""

import numpy as np

from netfall.mechanics.fields import FIELDS, Features
from netfall.mechanics.state import State
from netfall.model.model import Model
from netfall.parallel.subdomain import Distribution


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
    return state
