"""The columns of the history and of a state: what each is, its unit, and where its value comes from.

A column is added by a row here: the file, its units, the page of datasets, Python and checkpoints follow.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

NONE = "1"  # the unit of what has no dimension


class Moment(NamedTuple):
    """What rows (k,) of the history are taken from: energies [J] as of `energy.Energies`, those at the start.

    time, time_step : (k,) [s]; slack : (k,) cables; broken : (k,) elements
    """

    time: np.ndarray
    time_step: np.ndarray
    energies: object
    start_strain: float
    start_plastic: float
    slack: np.ndarray
    broken: np.ndarray

    @property
    def strain(self) -> np.ndarray:
        """Strain energy [J] since the start."""
        return self.energies.strain - self.start_strain

    @property
    def plastic(self) -> np.ndarray:
        """Dissipated [J] since the start."""
        return self.energies.plastic - self.start_plastic


class Column(NamedTuple):
    """A column of the history: value : of a `Moment`.

    share : of which energy the value becomes a share, a name in `history.SCALES`; "": it is none
    needs : the feature of `mechanics.fields.Features` without which there is no such column
    """

    name: str
    unit: str
    meaning: str
    value: Callable[[Moment], np.ndarray]
    dtype: type = np.float64
    share: str = ""
    needs: str = ""


def _identity(now: Moment) -> np.ndarray:
    e = now.energies
    return e.kinetic + e.internal + e.damping + e.air + e.slip - e.external - e.support


def _balance(now: Moment) -> np.ndarray:
    e = now.energies
    gone = e.kinetic + now.strain + now.plastic + e.damping + e.air + e.band + e.slip
    return gone - e.external - e.support


SHARE = "share of the largest energy that took part so far"
ATTACHED = "a path of unbroken elements joins to a support"
HISTORY = (
    Column("time", "s", "", lambda now: now.time),
    Column("time_step", "s", "of the step before the row", lambda now: now.time_step),
    Column("kinetic_energy", "J", "of all particles", lambda now: now.energies.kinetic),
    Column("strain_energy", "J", "change since the start", lambda now: now.strain),
    Column(
        "plastic_dissipation",
        "J",
        "also what was stored in elements that were lost, or taken out with `fragments = false`",
        lambda now: now.plastic,
    ),
    Column("damping_work", "J", "", lambda now: now.energies.damping),
    Column("air_work", "J", "taken by `[wind] air_damping`", lambda now: now.energies.air, needs="air"),
    Column(
        "band_damping_work",
        "J",
        "against the branches of `damping_ratio`: what they dissipated, and the little that they store",
        lambda now: now.energies.band,
        needs="band",
    ),
    Column(
        "slip_dissipation",
        "J",
        "heat of clamps and saddles over which cables slip, [[slide]]",
        lambda now: now.energies.slip,
        needs="sliding",
    ),
    Column(
        "support_work",
        "J",
        "of the supports that move, [[motion]], and of the ground that damping holds to",
        lambda now: now.energies.support,
        needs="motion",
    ),
    Column("external_work", "J", "", lambda now: now.energies.external),
    Column(
        "attached_energy",
        "J",
        f"kinetic, and strain with that of the prestress, of all that {ATTACHED}",
        lambda now: now.energies.attached,
    ),
    Column("identity_error", NONE, SHARE, _identity, share="in_play"),
    Column("balance_error", NONE, SHARE, _balance, share="in_play"),
    Column(
        "balance_error_attached",
        NONE,
        "the same error as a share of the largest `attached_energy` so far",
        _balance,
        share="attached",
    ),
    Column("slack", NONE, "elements of cables without tension", lambda now: now.slack, np.int64),
    Column("broken", NONE, "elements broken", lambda now: now.broken, np.int64),
)


class Sight(NamedTuple):
    """What the columns of a state are taken from, on one rank: `state.State`, `energy.Snapshot`.

    rows : (r,) the particles that are reported; node_id : (r,) ids; element_id, group, element_gid : (m,)
    """

    state: object
    snapshot: object
    rows: np.ndarray
    node_id: np.ndarray | None = None
    element_id: np.ndarray | None = None
    group: np.ndarray | None = None
    element_gid: np.ndarray | None = None


class Field(NamedTuple):
    """A column of a state, of points or cells; value : (r, *tail) or (m, *tail), of a `Sight`."""

    name: str
    dtype: type
    tail: tuple[int, ...]
    unit: str
    meaning: str
    value: Callable[[Sight], np.ndarray]
    needs: str = ""  # the feature of `mechanics.fields.Features` without which there is none


def _moved(sight: Sight) -> np.ndarray:
    return sight.state.x[sight.rows] - sight.state.x_start[sight.rows]


POINT_FIELDS = (  # of each state
    Field("displacement", np.float32, (3,), "m", "", _moved),
    Field("velocity", np.float32, (3,), "m/s", "", lambda sight: sight.snapshot.velocity),
)
CELL_FIELDS = (
    Field("tension", np.float32, (), "N", "", lambda sight: sight.snapshot.N),
    Field("strain", np.float32, (), NONE, "", lambda sight: sight.snapshot.eps),
    Field("plastic_strain", np.float32, (), NONE, "", lambda sight: sight.snapshot.eps_p),
    Field(
        "broken",
        np.uint8,
        (),
        NONE,
        "1 from the fracture, or the loss, on; 2: taken out by the erection",
        lambda sight: sight.state.broken,
    ),
    Field(
        "bending_moment",
        np.float32,
        (2,),
        "N m",
        "size >= 0, at start and end; 0 at an end of a chain, nan: no bending. Where bars bend",
        lambda sight: sight.state.bending_moments(),
        "bending",
    ),
)
NUMBERS = "number, the same on any number of ranks"
POINT_NUMBERS = (  # of each mesh: they change only when elements break
    Field("node_id", np.int64, (), NONE, "id of the tables", lambda sight: sight.node_id),
    Field("GlobalPointId", np.int64, (), NONE, NUMBERS, lambda sight: sight.state.gid[sight.rows]),
)
CELL_NUMBERS = (
    Field("group", np.int32, (), NONE, "number of the group, as in `/net/group`", lambda sight: sight.group),
    Field("element_id", np.int64, (), NONE, "id of the tables", lambda sight: sight.element_id),
    Field("GlobalCellId", np.int64, (), NONE, NUMBERS, lambda sight: sight.element_gid),
)
