"""Log of fractures: elements, times, and the numbers of the particles that split off."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from netfall.core.arrays import AnyArray, Integer
from netfall.core.kernels import inner_kernel
from netfall.core.records import Record, f8, i8


class FractureStep(NamedTuple):
    """Step in which something breaks. time : [s] at its start; step : its number; dt : [s], its length"""

    time: float
    step: int
    dt: float


class Events(Record):
    """Fractures of one rank not yet shared with other ranks: an entry per element end, in order of time.

    count : (1,) number of entries; the other arrays have spare capacity, and hold global numbers
    time : [s]; step : number of the step, as `Schedule` counts them
    new_particle : -1 if nothing split: at a loose end or without fragments; mass : [kg] of the new particle
    """

    count: i8
    time: f8
    step: i8
    element: i8
    particle: i8
    new_particle: i8
    strain: f8
    mass: f8


REALS = ("time", "strain", "mass")
COLUMNS = {name: np.float64 if name in REALS else np.int64 for name in list(Events.kind.fields)[1:]}


def allocate_events(capacity: int, before: Events | None = None) -> Events:
    """Allocate a log for `capacity` fractures, which starts with the entries of `before`."""
    columns = {name: np.zeros(capacity, dtype) for name, dtype in COLUMNS.items()}
    if before is None:
        return Events(np.zeros(1, np.int64), **columns)
    count = before.count[0]
    for name, column in columns.items():
        column[:count] = getattr(before, name)[:count]
    return Events(before.count, **columns)


@inner_kernel
def add_event(
    events: Events,
    when: FractureStep,
    element: Integer,
    particle: Integer,
    new_particle: Integer,
    strain: float,
    mass: float,
) -> None:
    """Append a fracture to the log. when : `FractureStep`"""
    k = events.count[0]
    events.time[k], events.step[k] = when.time, when.step
    events.element[k], events.particle[k] = element, particle
    events.new_particle[k], events.strain[k], events.mass[k] = new_particle, strain, mass
    events.count[0] = k + 1


class EventLog:
    """All fractures of a run so far, equal on every rank, ordered by step, element and particle.

    time, step, element, particle, new_particle, strain, mass [kg] : (k,) as in `Events`
    broken : elements, ascending; breaking : the steps in which these broke, ascending
    split_gid : numbers of the particles that have split off, ascending
    """

    if TYPE_CHECKING:

        def __getattr__(self: Any, name: str) -> AnyArray:
            """Return a column of COLUMNS."""

    def __init__(self, particles: int):
        """Start an empty log; particles : number in the net, whose rows precede those that split off."""
        self.particles = particles
        for name, dtype in COLUMNS.items():
            setattr(self, name, np.zeros(0, dtype))
        self.broken = self.breaking = self.split_gid = np.zeros(0, np.int64)

    def __len__(self) -> int:
        return len(self.step)

    def add(self, columns: dict[str, np.ndarray]) -> None:
        """Add the fractures since the last call, from all ranks: the columns by name."""
        order = np.lexsort((columns["particle"], columns["element"], columns["step"]))
        for name in COLUMNS:
            setattr(self, name, np.concatenate([getattr(self, name), columns[name][order]]))
        element, first = np.unique(columns["element"][order], return_index=True)
        steps = columns["step"][order][first][~np.isin(element, self.broken)]
        self.breaking = np.sort(np.concatenate([self.breaking, steps]))
        self.broken = np.union1d(self.broken, element)
        new = columns["new_particle"]
        self.split_gid = np.sort(np.concatenate([self.split_gid, new[new >= 0]]))

    @property
    def points(self) -> int:
        """Number of particles of the net and of those that split off."""
        return self.particles + len(self.split_gid)

    def row_of(self, gid: np.ndarray) -> np.ndarray:
        """Return global rows of particles: the net by number, then those that split off by number."""
        return np.where(gid < self.particles, gid, self.particles + np.searchsorted(self.split_gid, gid))

    def columns(self) -> dict[str, np.ndarray]:
        """Return the log as columns, for the result file and for checkpoints."""
        return {name: getattr(self, name) for name in COLUMNS}

    def restore(self, columns: dict[str, np.ndarray]) -> None:
        """Load the columns of an earlier run."""
        self.add({name: columns[name] for name in COLUMNS})
