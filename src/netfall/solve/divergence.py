"""The end of a run that has diverged, in words."""

from netfall.errors import DivergedError
from netfall.solve.energy import most_extreme


def divergence(simulation, snapshot, kinetic: float) -> DivergedError:
    """Names the fastest particle and the element with the largest strain, on every rank. Collective.

    kinetic : [J]
    """
    s = simulation
    particle, element = most_extreme(s.comm, s.state, s.subdomain.element_gid, snapshot)
    node, element = s.comm.bcast(s.model and (s.model.node_name(particle), s.model.id_of(element)))
    return DivergedError(
        f"diverged at t = {s.time:.6g} s (step {s.n}): kinetic energy {kinetic:.3g} J is "
        f"out of all proportion to the external work; fastest: {node}, most strained: element {element}; "
        "take a smaller time_step or safety"
    )
