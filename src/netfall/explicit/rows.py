"""Buffer of the history rows of one rank, and the envelope of a dynamic stage that they update.

The time loop fills the buffer, and `history.reduce_rows` empties it. The envelope has largest and smallest
values with their times.

Each rank records its own particles and elements from values that the energy check of a row computes anyway.
If rows are far apart, the envelope also includes steps between them (`explicit.sampling.update_envelope`). If
elements can yield, break or are removed, loads act at once or supports move, the largest forces are recorded
at each step, since vibrations and the waves after a fracture may be shorter than the time between two rows.
"""

from typing import Any

import numpy as np

from netfall.core.records import empty, f8, i8, i8_2
from netfall.explicit.energy import make_snapshot
from netfall.explicit.sampling import (
    LocalProbes,
    Rows,
    Table,
    include_reaction,
    update_moments,
    update_tension_envelope,
)
from netfall.model.layout import Probes
from netfall.parallel.subdomain import Distribution, Subdomain
from netfall.parallel.sums import LIMBS
from netfall.physics.state import State

TENSION = ("tension_max", "tension_max_time", "tension_min", "slack_time")  # (m,), of elements
DISPLACEMENT = ("displacement_max", "displacement_max_time")  # (n,), of particles of the net

MOMENT = "bending_moment_max"  # (m,), only with bending chains


class DynamicEnvelope:
    """The envelope of one rank. Its rows have the order of TENSION and DISPLACEMENT.

    tension : (4, m); displacement : (2, n_owned)
    reaction : (15, h) [N] highest components, lowest components, largest magnitude and its time [s]; then of
        the forces without loads at each step: highest components, lowest components, largest square
    supports : (h,) rows of the particles with a support, rigid, elastic or guided
    support_at : (n_owned,) as in `explicit.sampling.Rows`
    moment : (m,) [N m] the largest bending moment, nan: no bending; None: no bending chains
    """

    def __init__(self, distribution: Distribution, state: State):
        self.distribution = distribution
        subdomain = distribution.subdomain
        held = (state.free == 0) | (state.spring > 0.0 if state.features.springs else False)
        if state.turned is not None:
            held[:, 0] |= state.turned[:, :2].any(1)
        self.supports = np.flatnonzero(held[: subdomain.n_owned].any(1))
        self.support_at = np.full(subdomain.n_owned, -1)
        if state.highest is not None:
            self.support_at[self.supports] = np.arange(len(self.supports))
        self.reaction = np.full((15, len(self.supports)), -np.inf)
        self.reaction[3:6] = self.reaction[11:14] = np.inf
        # Not np.zeros: on untouched pages a masked store costs some hundred cycles.
        self.tension = np.full((len(TENSION), len(subdomain.element_gid)), 0.0)
        self.tension[0], self.tension[2] = -np.inf, np.inf
        self.displacement = np.full((len(DISPLACEMENT), subdomain.n_owned), 0.0)
        self.displacement[0] = -1.0
        self.moment = np.full(len(subdomain.element_gid), np.nan) if state.joints is not None else None

    def include_extremes(self, time: float, state: State) -> None:
        """Include the extremes of all steps so far, at a time [s], if the state records them."""
        if state.highest is not None:
            update_tension_envelope(time, state.highest, state.elements.lowest, self.tension)

    def columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Return the columns of elements (m,) and of particles (n_owned,), by name."""
        bends = {} if self.moment is None else {MOMENT: self.moment}
        R = self._reactions()
        reactions = {"reaction_highest": R[:, :3], "reaction_lowest": R[:, 3:6]}
        reactions |= {"reaction_max": R[:, 6], "reaction_max_time": R[:, 7]}
        displacements = dict(zip(DISPLACEMENT, self.displacement))
        return dict(zip(TENSION, self.tension)) | bends, displacements | reactions

    def _reactions(self) -> np.ndarray:
        """Return the columns (n_owned, 8) of `reaction` for all particles, 0 without a support."""
        reactions = np.zeros((self.displacement.shape[1], len(self.reaction)))
        reactions[self.supports] = self.reaction.T
        return reactions

    def record(self, state: State) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the data for `restore`, by global numbers on rank 0. Collective."""
        owned = state.owned.astype(bool)
        tension = self.distribution.gather_elements(self.tension.T, owned)
        displacement: Any = self.distribution.gather_particles(self.displacement.T)
        reaction: Any = self.distribution.gather_particles(self._reactions())
        bends: dict[str, Any] = {}
        if self.moment is not None:
            bends = {MOMENT: self.distribution.gather_elements(self.moment, owned)}
        if tension is None:
            return {}, {}
        return {}, {"tension": tension, "displacement": displacement, "reaction": reaction} | bends

    def restore(self, _: dict[str, Any], arrays: dict[str, np.ndarray] | None) -> None:
        """Restore the record of an earlier run. arrays : on rank 0. Collective."""
        distribution, n_owned = self.distribution, self.displacement.shape[1]
        tension, displacement, reaction = (
            arrays[name] if arrays else None for name in ("tension", "displacement", "reaction")
        )
        self.tension[:] = distribution.elements(tension).T
        self.displacement[:] = distribution.particles(displacement)[:n_owned].T
        self.reaction[:] = distribution.particles(reaction)[self.supports].T
        if self.moment is not None:
            self.moment[:] = distribution.elements(arrays[MOMENT] if arrays else None)


MOST_ROWS = 128  # rows in the table: 400 KB


class RowTable:
    """Rows of one rank that the history does not contain yet, and the envelope that they update."""

    def __init__(
        self,
        state: State,
        due: np.ndarray,
        dt: float,
        every: int,
        probes: Probes,
        envelope: DynamicEnvelope,
        slips: tuple[Any, ...] | None = None,
    ):
        """Allocate the table.

        due : (rows,) step numbers of all rows; dt : [s] time step by which rows are counted
        every : after so many steps without a row or an update, the envelope is updated
        slips : global numbers of `State.slip_points`, and count of all slip points; None: no sliding cables
        """
        subdomain = envelope.distribution.subdomain
        self.due, self.dt, self.gid, self.envelope = due, dt, subdomain.element_gid, envelope
        self.made, self.last, self.every = np.zeros(2, np.int64), np.zeros(1, np.int64), every
        k, values = MOST_ROWS, 3 * len(probes.particles) + len(probes.elements) + len(probes.named)
        self.local = local_probes(subdomain, probes)
        if slips:
            number, count = slips
            self.local = self.local.with_values(slip=values + number, difference=values + count + number)
            values += 2 * count
        self.snapshot = make_snapshot(state)
        sums = len(self.snapshot.observation.sums)
        self.table = Table(
            np.zeros(k, np.int64),
            np.zeros(k),
            np.zeros(k, np.int64),
            np.zeros((k, sums, LIMBS), np.int64),
            np.zeros((k, values)),
            np.zeros((k, 3)),
            np.zeros((k, 3), np.int64),
        )

    def of(self, state: State, second: np.ndarray) -> Rows:
        """Return the rows for the time loop. They stay valid as long as the arrays of the state do.

        second : (3, n) [m] second position array of the loop
        """
        if not self.snapshot.fits(state):
            self.snapshot = make_snapshot(state)
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
            supports=self.envelope.supports,
            support_at=self.envelope.support_at,
            second=second,
            reaction=self.envelope.reaction,
            include_reaction=include_reaction.address,
            update_moments=update_moments.address_if(self.envelope.moment is not None),
            joint_at=empty(i8_2) if state.joint_at is None else state.joint_at,
            local=self.local,
            table=self.table,
            observed=self.snapshot.bind(state),
            observation=self.snapshot.observation,
        )

    def is_due(self, number: int) -> bool:
        """Return whether a row is due at a step that is not computed yet."""
        k = self.made[0]
        return k < len(self.due) and self.due[k] == number

    @property
    def first_full_step(self) -> int:
        """Step number of the first row that the table cannot hold; beyond the last step if it holds all."""
        made, waiting = self.made.tolist()
        k = made + MOST_ROWS - waiting
        return int(self.due[k]) if k < len(self.due) else int(self.due[-1]) + 1

    @property
    def full(self) -> bool:
        """Whether the table cannot hold another row."""
        return self.made[1] == MOST_ROWS

    def take_rows(self) -> Table:
        """Remove the rows so far from the table, and return them. The next steps overwrite the arrays."""
        k = int(self.made[1])
        self.made[1] = 0
        return Table(*(getattr(self.table, name)[:k] for name in self.table.kind.fields))

    def copies(self) -> tuple[Any, ...]:
        """Return copies for `restore`, if the following steps have to be undone."""
        return tuple(array.copy() for array in self._mutable_arrays())

    def restore(self, copies: tuple[Any, ...]) -> None:
        """Restore the rows from copies of `copies`."""
        for array, before in zip(self._mutable_arrays(), copies):
            array[:] = before

    def _mutable_arrays(self) -> list[np.ndarray]:
        """Return all arrays other than the table that a new row changes.

        The table needs no copy: rows beyond the counter `made` are never read.
        """
        envelope = self.envelope
        arrays = self.made, self.last, envelope.tension, envelope.displacement, envelope.reaction
        return [*arrays] if envelope.moment is None else [*arrays, envelope.moment]


def local_probes(subdomain: Subdomain, probes: Probes) -> LocalProbes:
    """Return the probes of a rank, and the positions of their values in a row."""
    elements = np.concatenate([probes.elements, probes.named])
    matches = []
    for numbers, sought in (
        (subdomain.particle_gid[: subdomain.n_owned], probes.particles),
        (subdomain.element_gid, elements),
    ):
        pairs = [(row, k) for k, gid in enumerate(sought) for row in np.flatnonzero(numbers == gid)]
        matches.append(np.array(pairs, np.int64).reshape(-1, 2).T.copy())  # contiguous also without pairs
    (particle, particle_column), (element, element_column) = matches
    return LocalProbes(
        particle,
        3 * particle_column,
        element,
        3 * len(probes.particles) + element_column,
        empty(i8),
        empty(i8),
    )
