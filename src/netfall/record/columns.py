"""The columns of the history and of a state, and where their values come from.

A column is added by a row here, and one in results/README.md, which has units and meanings; the file, Python
and checkpoints follow.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


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


HISTORY = (
    Column("time", lambda now: now.time),
    Column("time_step", lambda now: now.time_step),
    Column("kinetic_energy", lambda now: now.energies.kinetic),
    Column("strain_energy", lambda now: now.strain),
    Column("plastic_dissipation", lambda now: now.plastic),
    Column("damping_work", lambda now: now.energies.damping),
    Column("air_work", lambda now: now.energies.air, needs="air"),
    Column("band_damping_work", lambda now: now.energies.band, needs="band"),
    Column("slip_dissipation", lambda now: now.energies.slip, needs="sliding"),
    Column("support_work", lambda now: now.energies.support, needs="motion"),
    Column("external_work", lambda now: now.energies.external),
    Column("attached_energy", lambda now: now.energies.attached),
    Column("identity_error", _identity, share="in_play"),
    Column("balance_error", _balance, share="in_play"),
    Column("balance_error_attached", _balance, share="attached"),
    Column("slack", lambda now: now.slack, np.int64),
    Column("broken", lambda now: now.broken, np.int64),
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
    value: Callable[[Sight], np.ndarray]
    needs: str = ""  # the feature of `mechanics.fields.Features` without which there is none


def _moved(sight: Sight) -> np.ndarray:
    return sight.state.x[sight.rows] - sight.state.x_start[sight.rows]


POINT_FIELDS = (  # of each state
    Field("displacement", np.float32, (3,), _moved),
    Field("velocity", np.float32, (3,), lambda sight: sight.snapshot.velocity),
)
CELL_FIELDS = (
    Field("tension", np.float32, (), lambda sight: sight.snapshot.N),
    Field("strain", np.float32, (), lambda sight: sight.snapshot.eps),
    Field("plastic_strain", np.float32, (), lambda sight: sight.snapshot.eps_p),
    Field("broken", np.uint8, (), lambda sight: sight.state.broken),
    Field("bending_moment", np.float32, (2,), lambda sight: sight.state.bending_moments(), "bending"),
)
POINT_NUMBERS = (  # of each mesh: they change only when elements break
    Field("node_id", np.int64, (), lambda sight: sight.node_id),
    Field("GlobalPointId", np.int64, (), lambda sight: sight.state.gid[sight.rows]),
)
CELL_NUMBERS = (
    Field("group", np.int32, (), lambda sight: sight.group),
    Field("element_id", np.int64, (), lambda sight: sight.element_id),
    Field("GlobalCellId", np.int64, (), lambda sight: sight.element_gid),
)
