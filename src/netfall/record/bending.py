"""Chains that bend: how far their sections lean on something that is not modelled."""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.bending import joint_moments
from netfall.mechanics.state import State

NIL = 1e-9  # of EI / l: a moment below that is rounding


def largest_hold(comm: MPI.Comm, state: State) -> tuple[float, int]:
    """The largest moment that holds a section against tilting, and the number of its particle. Collective.

    As a share of the largest bending moment.
    """
    joints = state.joints
    moment, hold = np.empty((2, len(joints.stiffness)))
    joint_moments(state.x, joints, moment, hold)
    k = int(np.argmax(hold)) if len(hold) else -1
    here = (float(hold[k]), -int(state.gid[joints.particles[k, 1]])) if k >= 0 else (0.0, 0)
    mine = float(moment.max(initial=0.0)), NIL * float(joints.stiffness.max(initial=0.0))
    found = comm.allgather((*mine, here))
    most, nil, (held, p) = (max(column) for column in zip(*found))
    return held / most if most > nil else 0.0, -p
