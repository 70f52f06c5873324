"""Chains that bend: how far their sections lean on something that is not modelled."""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.bending import joint_moments
from netfall.mechanics.state import State


def largest_hold(comm: MPI.Comm, state: State) -> tuple[float, int]:
    """The largest moment that holds a section against tilting, and the number of its particle. Collective.

    As a share of the largest bending moment.
    """
    joints = state.joints
    moment, hold = np.empty((2, len(joints.stiffness)))
    joint_moments(state.x, joints, moment, hold)
    k = int(np.argmax(hold)) if len(hold) else -1
    here = (float(hold[k]), -int(state.gid[joints.particles[k, 1]])) if k >= 0 else (0.0, 0)
    found = comm.allgather((float(moment.max(initial=0.0)), here))
    most, (held, p) = max(each for each, _ in found), max(each for _, each in found)
    return held / most if most > 0.0 else 0.0, -p
