"""The log of fractures: what broke, when, and the numbers of the particles that split off."""

from typing import NamedTuple

import numpy as np


class Event(NamedTuple):
    """One fracture at one end of an element, in global numbers.

    new_particle : -1 where nothing split, at a loose end or without fragments; mass : [kg] of the new
        particle
    """

    time: float
    step: int
    element: int
    particle: int
    new_particle: int
    strain: float
    mass: float


class EventLog:
    """All fractures of a run so far, the same on every rank, in the order of step, element and particle.

    broken : elements; split_gid : numbers of the particles that have split off, ascending
    """

    def __init__(self, particles: int):
        """particles : of the net, whose rows come before those that split off"""
        self.particles = particles
        self.events: list[Event] = []
        self.broken: set[int] = set()
        self.split_gid = np.zeros(0, np.int64)

    def __len__(self) -> int:
        return len(self.events)

    def add(self, events: list[Event]) -> None:
        """Fractures since the last call, from all ranks."""
        self.events += sorted(events, key=lambda event: (event.step, event.element, event.particle))
        self.broken.update(event.element for event in events)
        new = [event.new_particle for event in events if event.new_particle >= 0]
        self.split_gid = np.sort(np.concatenate([self.split_gid, np.array(new, np.int64)]))

    @property
    def points(self) -> int:
        """Particles of the net and those that split off."""
        return self.particles + len(self.split_gid)

    def row_of(self, gid: np.ndarray) -> np.ndarray:
        """Global rows of particles: the net's by number, then those that split off by number."""
        return np.where(gid < self.particles, gid, self.particles + np.searchsorted(self.split_gid, gid))

    def columns(self) -> dict[str, np.ndarray]:
        """The log as columns, for the result file and for checkpoints."""
        return {
            name: np.array([getattr(event, name) for event in self.events], dtype)
            for name, dtype in Event.__annotations__.items()
        }

    def restore(self, columns: dict[str, np.ndarray]) -> None:
        """Take up the columns of an earlier run."""
        self.add([Event(*row) for row in zip(*(columns[name].tolist() for name in Event._fields))])
