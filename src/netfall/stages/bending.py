"""What is said of chains that bend at rest: sections that something not modelled keeps from tilting."""

import numpy as np

from netfall.mechanics.bending import joint_moments
from netfall.stages.scene import Scene

MUCH = 0.05  # of the largest moment: a hold against tilting above that is told


def largest_hold(scene: Scene) -> tuple[float, int]:
    """The largest moment that holds a section against tilting, and the number of its particle. Collective.

    As a share of the largest bending moment.
    """
    joints, gid = scene.state.joints, scene.distribution.subdomain.particle_gid
    moment, hold = np.empty((2, len(joints.stiffness)))
    joint_moments(scene.state.x, joints, moment, hold)
    k = int(np.argmax(hold)) if len(hold) else -1
    here = (float(hold[k]), -int(gid[joints.particles[k, 1]])) if k >= 0 else (0.0, 0)
    found = scene.comm.allgather((float(moment.max(initial=0.0)), here))
    most, (held, p) = max(each for each, _ in found), max(each for _, each in found)
    return held / most if most > 0.0 else 0.0, -p


def hold_notes(found: list[tuple[str, tuple[float, int]]], node_id: np.ndarray) -> list[str]:
    """Notes on equilibria in which sections are held by much; found : as of `largest_hold`."""
    return [
        f"note: {what}: the section at node {node_id[p]} is held against tilting by {share:.0%} of the "
        "largest bending moment, which nothing in the model does: a chain that is curved without moment "
        "bends truly in its plane alone; support it across, or take its moments there for a rough value"
        for what, (share, p) in found
        if share > MUCH
    ]
