"""The rows of the history on their way from the time loop of each rank to the history, the same on all."""

from typing import NamedTuple

import numpy as np

from netfall.core.records import empty, f8, i8, i8_2
from netfall.mechanics.state import State
from netfall.model.probes import Probes
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Subdomain
from netfall.parallel.sums import LIMBS, rounded_of_all
from netfall.record.energy import make_room
from netfall.record.envelope import Envelope
from netfall.step.rows import Local, Rows, Table

MOST_ROWS = 128  # in the table, 400 KB


class TakenUp(NamedTuple):
    """Rows as `step.rows.Table` has them, of all ranks; sums : (k, s) [J], rounded"""

    number: np.ndarray
    time_step: np.ndarray
    slack: np.ndarray
    sums: np.ndarray
    probes: np.ndarray
    size: np.ndarray
    who: np.ndarray


class RowTable:
    """The rows of one rank that are made and not yet taken up; what the envelope has of them."""

    def __init__(
        self,
        state: State,
        due: np.ndarray,
        dt: float,
        every: int,
        subdomain,
        probes: Probes,
        envelope: Envelope,
        slips: tuple | None = None,
    ):
        """due : (rows,) numbers of the steps of all rows; dt : [s] length of the steps as they are counted

        every : so many of them after a row, or after the last time, the envelope is widened without one
        slips : which of all places each of `State.places` is, and how many there are; None: nothing slips
        """
        self.due, self.dt, self.gid, self.envelope = due, dt, subdomain.element_gid, envelope
        self.made, self.last, self.every = np.zeros(2, np.int64), np.zeros(1, np.int64), every
        k, values = MOST_ROWS, 3 * len(probes.particles) + len(probes.elements) + len(probes.named)
        self.local = local_probes(subdomain, probes)
        if slips:
            number, count = slips
            self.local = self.local.replaced(slip=values + number, difference=values + count + number)
            values += 2 * count
        self.snapshot = make_room(state)
        whole, sums = lambda *shape: np.zeros(shape, np.int64), len(self.snapshot.room.sums)
        self.table = Table(
            whole(k),
            np.zeros(k),
            whole(k),
            whole(k, sums, LIMBS),
            np.zeros((k, values)),
            np.zeros((k, 3)),
            whole(k, 3),
        )

    def of(self, state: State) -> Rows:
        """What the time loop takes, as long as the arrays of the state stay."""
        if not self.snapshot.fits(state):
            self.snapshot = make_room(state)
        return Rows(
            due=self.due,
            dt=self.dt,
            made=self.made,
            every=self.every,
            last=self.last,
            element_gid=self.gid,
            tension=self.envelope.tension,
            displacement=self.envelope.displacement,
            moment=empty(f8) if self.envelope.moment is None else self.envelope.moment,
            joint_at=empty(i8_2) if state.joint_at is None else state.joint_at,
            local=self.local,
            table=self.table,
            subject=self.snapshot.look_at(state),
            room=self.snapshot.room,
        )

    def is_due(self, number: int) -> bool:
        """Whether a row is due at a step that is not made yet."""
        k = self.made[0]
        return k < len(self.due) and self.due[k] == number

    @property
    def full_at(self) -> int:
        """Number of the step whose row has no room any more; beyond the last step if all have."""
        made, waiting = self.made.tolist()
        k = made + MOST_ROWS - waiting
        return int(self.due[k]) if k < len(self.due) else int(self.due[-1]) + 1

    @property
    def full(self) -> bool:
        """Whether there is no room for another row."""
        return self.made[1] == MOST_ROWS

    def take_up(self, comm: MPI.Comm) -> TakenUp:
        """The rows so far, which are no longer in the table; the same on every rank but for size and who.

        Their sums are (k, s) [J], as `step.audit.Room` orders them. Collective.
        """
        k = int(self.made[1])
        number, time_step, slack, sums, probes, size, who = (
            getattr(self.table, name)[:k] for name in self.table.kind.fields
        )
        self.made[1] = 0
        comm.Allreduce(MPI.IN_PLACE, slack, MPI.SUM)
        probes = probes.copy()
        comm.Allreduce(MPI.IN_PLACE, probes, MPI.SUM)  # one term each but for zeros, so exact
        total = rounded_of_all(comm, sums.reshape(-1, LIMBS)).reshape(sums.shape[:2])
        return TakenUp(number.copy(), time_step.copy(), slack.copy(), total, probes, size, who)

    def keep(self) -> tuple:
        """What `put_back` needs, if the steps from here on are taken back."""
        return tuple(array.copy() for array in self._changing())

    def put_back(self, kept: tuple) -> None:
        """The rows are those that there were then."""
        for array, before in zip(self._changing(), kept):
            array[:] = before

    def _changing(self) -> list[np.ndarray]:
        """What a row changes besides the table: rows that are not made are not read there."""
        envelope = self.envelope
        arrays = self.made, self.last, envelope.tension, envelope.displacement, envelope.moment
        return [array for array in arrays if array is not None]


def local_probes(subdomain: Subdomain, probes: Probes) -> Local:
    """The probes that a rank has, and the places of their values in a row."""
    elements = np.concatenate([probes.elements, probes.named])
    found = []
    for numbers, sought in (
        (subdomain.particle_gid[: subdomain.n_owned], probes.particles),
        (subdomain.element_gid, elements),
    ):
        pairs = [(row, k) for k, gid in enumerate(sought) for row in np.flatnonzero(numbers == gid)]
        found.append(np.array(pairs, np.int64).reshape(-1, 2).T.copy())  # contiguous however many
    (particle, of_particle), (element, of_element) = found
    return Local(
        particle, 3 * of_particle, element, 3 * len(probes.particles) + of_element, empty(i8), empty(i8)
    )
