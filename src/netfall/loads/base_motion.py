"""Motion of supports, [[motion]]: records of displacement or acceleration, and the supports that they move.

A displacement is linear between the rows of its table and constant after the last row. An acceleration is
linear between its rows, integrated twice in closed form, and zero after the last row. A record of PEER (.AT2)
is corrected first: the least-squares parabola through zero, c1 t + c2 t^2, is subtracted from its velocity.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError, raise_errors
from netfall.core.functions import lengths
from netfall.geometry.net import GRAVITY, Net, parent_ends
from netfall.geometry.turned import is_rotated
from netfall.job.csv_table import AXES, Table
from netfall.job.derived import moves_supports, starts_in_form
from netfall.job.job import Job, read_bytes
from netfall.job.validate import is_record
from netfall.job.values import counted, format_list
from netfall.loads import messages

ZERO_DISPLACEMENT = 1e-9  # m: largest displacement at the start that counts as zero
MAX_MOTION = 5.0  # m: displacement of a support above which netfall doubts the unit
SEARCH_BLOCK = 256  # particles per block in the search for the nearest support: bounds the memory
EQUAL_DISTANCE = 1e-9  # relative difference up to which distances to supports count as equal


@dataclass(frozen=True)
class Motion:
    """Motion of supports: arrays of `physics.supports.Ground`, and the course (n,) of each particle."""

    time: np.ndarray
    first: np.ndarray
    place: np.ndarray
    parts: np.ndarray
    record: np.ndarray
    delay: np.ndarray
    start: np.ndarray
    course: np.ndarray
    notes: list[str]


def make_motion(job: Job, net: Net, x: np.ndarray, before_stages: bool) -> Motion:
    """Build the motion of supports of a net at x (n, 3) [m]. Rank 0. Raises InputError with all errors.

    before_stages : whether stages of erection follow, which may fix further nodes
    """
    errors: list[str] = []
    notes: list[str] = []
    records: list[Any] = []
    courses_of: dict[Any, Any] = {}
    for number, entry in enumerate(job.motions, 1):
        nodes = _nodes(net, entry)
        try:
            time, rows, record_notes = _record(job, entry, number)
            records.append((time, rows))
            notes += record_notes
            notes += [] if before_stages else _free_axis_notes(net, nodes, rows, number)
        except InputError as error:
            errors += error.lines
        notes += _half_moved_notes(net, nodes, number)
        errors += _node_errors(job, net, entry, number, nodes, before_stages)
        for p, delay in zip(nodes.tolist(), _delays(x[nodes], entry).tolist()):
            courses_of.setdefault(p, []).append((number - 1, delay))
    raise_errors(errors)
    courses = sorted(set(map(tuple, courses_of.values())))
    row_of = {course: k for k, course in enumerate(courses)}
    course = np.full(net.n, -1, np.int32)
    for p, parts in courses_of.items():
        course[p] = row_of[tuple(parts)]
    start = _start(net, course, courses, records)
    if start.any():
        velocity = ", ".join(f"{v:.4g}" for v in start[0])
        notes.append(messages.INITIAL_GROUND_VELOCITY(velocity=velocity))
    parts = [part for course_parts in courses for part in course_parts]
    return Motion(
        np.concatenate([time for time, _ in records]),
        np.cumsum([0, *(len(time) for time, _ in records)]),
        np.concatenate([rows for _, rows in records]),
        np.cumsum([0, *map(len, courses)]),
        np.array([record for record, _ in parts], np.int64),
        np.array([delay for _, delay in parts], np.float64),
        start,
        _nearest(net, x, course),
        notes,
    )


# --- supports that move


def _nodes(net: Net, entry: Any) -> np.ndarray:
    """Return the rows of the supports that an entry moves."""
    held = np.asarray(net.fixed.any(1))
    chosen = held if entry.nodes is None else np.isin(net.node_id, entry.nodes)
    return np.flatnonzero(chosen | (chosen[parent_ends(net)].all(1) & held))


def _node_errors(
    job: Job, net: Net, entry: Any, number: int, rows: np.ndarray, before_stages: bool
) -> Iterator[str]:
    """Yield an error for each defect of the nodes of an entry; rows : of these nodes."""
    held, sprung = net.fixed.any(1), net.spring.any(1)

    def ids(chosen: Any) -> Any:
        return net.node_id[rows[chosen[rows]]]

    for message, nodes in (
        (messages.UNKNOWN_MOTION_NODES, sorted(set(entry.nodes or ()) - set(net.node_id.tolist()))),
        (messages.FREE_MOTION_NODES, ids(~held & (not before_stages))),
        (messages.SPRUNG_MOTION_NODES, net.node_id[sprung] if entry.nodes is None else ids(sprung)),
        (messages.ROTATED_MOTION_NODES, ids(is_rotated(net))),
    ):
        if len(nodes):
            yield message(path=job.path, number=number, ids=format_list(nodes))
    if not held.any():
        yield messages.NO_SUPPORTS_TO_MOVE(path=job.path, number=number)


def _half_moved_notes(net: Net, rows: np.ndarray, number: int) -> Iterator[str]:
    """Yield a warning on subdivided elements between a moving support, one of `rows`, and a fixed one."""
    moves, ends = np.isin(np.arange(net.n), rows), net.undivided()
    half = net.fixed[ends].all((1, 2)) & (moves[ends].sum(1) == 1) & (net.parts > 1)
    if half.any():
        elements = counted("element", net.element_id[:: net.parts][half])
        yield messages.HALF_MOVED_ELEMENTS(number=number, elements=elements)


def _free_axis_notes(net: Net, nodes: np.ndarray, motion: np.ndarray, number: int) -> Iterator[str]:
    """Yield a warning if a motion, coefficients (r, 4, 3), has components in which all its nodes are free."""
    free = (np.abs(motion).max((0, 1)) > 0.0) & ~net.fixed[nodes].any(0)
    if free.any() and len(nodes):
        axes = ", ".join(np.array(AXES)[free])
        yield messages.MOTION_OF_FREE_AXES(number=number, axes=axes)


def sudden_load_notes(job: Job, load: np.ndarray) -> Iterator[str]:
    """Yield a warning if supports move and loads (k,) [N] that the form does not carry act at once."""
    if moves_supports(job) and starts_in_form(job) and load.any():
        yield messages.SUDDEN_LOADS_WITH_MOTION()


def _delays(x: np.ndarray, entry: Any) -> np.ndarray:
    """Compute the arrival times (k,) [s] of a wave at supports at x (k, 3) [m], 0 at the first support."""
    if entry.speed is None or entry.travel is None or not len(x):
        return np.zeros(len(x))
    along = x[:, 0] * entry.travel[0] + x[:, 1] * entry.travel[1] + x[:, 2] * entry.travel[2]
    along /= lengths(np.array(entry.travel, float))
    return (along - along.min()) / entry.speed


def _nearest(net: Net, x: np.ndarray, course: np.ndarray) -> np.ndarray:
    """Return, for each particle, the course (n,) of the nearest support in plan.

    If several supports are equally near, the first course counts, whatever their order and rounding.
    """
    supports = np.flatnonzero(net.fixed.any(1))
    supports = supports[np.argsort(course[supports], kind="stable")]
    nearest = course.copy()
    free_particles = np.setdiff1d(np.arange(net.n), supports)
    for first in range(0, len(free_particles), SEARCH_BLOCK):
        rows = free_particles[first : first + SEARCH_BLOCK]
        distance = lengths(x[rows, None, :2] - x[None, supports, :2])
        is_nearest = distance <= (1.0 + EQUAL_DISTANCE) * distance.min(1, keepdims=True)
        nearest[rows] = course[supports[np.argmax(is_nearest, axis=1)]]
    return nearest


def _start(net: Net, course: np.ndarray, courses: list[Any], records: list[Any]) -> np.ndarray:
    """Compute the velocity (courses, 3) [m/s] before the first step.

    It is the initial velocity of the supports if all of them move with the same velocity, and zero otherwise.
    """
    moving = ([records[r][1][0, 1] for r, delay in parts if delay == 0.0] for parts in courses)
    start = np.array([sum(velocities, np.zeros(3)) for velocities in moving]).reshape(-1, 3)
    all_move = (course[net.fixed.any(1)] >= 0).all()
    return start if all_move and (start == start[:1]).all() else np.zeros_like(start)


# --- records


def _record(job: Job, entry: Any, number: int) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Read times (r,) [s] from 0 on, their coefficients (r, 4, 3), and notes. Raises InputError."""
    path = job.path.parent / (entry.displacement or entry.acceleration)
    if entry.displacement:
        table, time, x = _table(path, entry)
        rows, peak = _displacement_coefficients(table, time, entry.scale * x), lengths(entry.scale * x).max()
        file = entry.displacement
        unit_note = messages.LARGE_SUPPORT_DISPLACEMENT(number=number, file=file, peak=peak, limit=MAX_MOTION)
        return *rows, table.notes + [unit_note] * bool(peak > MAX_MOTION)
    if is_record(entry):
        time, a = read_at2(path)
        a = entry.scale * GRAVITY * a[:, None] * _unit_vector(entry.direction)
        notes = []
        if entry.baseline is not False:
            slope = _fit_parabola(time, _integrate_acceleration(time, a)[:, 1])
            change = slope[0] + 2.0 * time[:, None] * slope[1]
            a = a - change
            notes.append(messages.BASELINE_CORRECTION(number=number, peak=lengths(change).max()))
    else:
        table, time, a = _table(path, entry)
        if time[0] > 0.0:
            table.wrong(messages.RECORD_STARTS_LATE(time=time[0]))
            table.finish()
        early = messages.RECORD_BEFORE_START(number=number, file=entry.acceleration)
        notes = table.notes + [early] * bool(a[time < 0.0].any())
        time, a = _rows_from_zero(time, entry.scale * a)
    coefficients = _integrate_acceleration(time, a)
    return time, coefficients, [*notes, _drift_note(number, a, time[-1], coefficients)]


def _unit_vector(vector: Any) -> np.ndarray:
    """Return the unit vector along a vector."""
    return np.array(vector, float) / lengths(np.array(vector, float))


def _table(path: Path, entry: Any) -> tuple[Table, np.ndarray, np.ndarray]:
    """Read a table, its times (r,) [s] and its values (r, 3). Raises InputError."""
    unit = "m/s2" if entry.acceleration else "m"
    known = ("time", *AXES) if entry.direction is None else ("time", "acceleration")
    table = Table(path, known, known[:1] if entry.direction is None else known)
    time = table.numbers("time", unit="s")
    values = table.stacked(known[1:], 0.0 if entry.direction is None else np.nan, unit=unit)
    columns = [name for name in known[1:] if name in table]
    if not columns:
        table.wrong(messages.NO_VALUE_COLUMN())
    table.finish()
    table.ascending("time", time)
    table.check_no_gaps(time, *(table.numbers(name, unit=unit) for name in columns))
    return table, time, values if entry.direction is None else values * _unit_vector(entry.direction)


def _rows_from_zero(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows (r,), (r, 3) from time 0 on, with a row at 0; values before the first row equal it."""
    first = np.array([np.interp(0.0, time, column) for column in values.T])
    later = time > 0.0
    return np.append(0.0, time[later]), np.vstack([first, values[later]])


def _displacement_coefficients(
    table: Table, time: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute coefficients (r, 4, 3) of a displacement x (r, 3) [m] that is linear between times (r,) [s]."""
    time, x = _rows_from_zero(time, x)
    if np.abs(x[0]).max() > ZERO_DISPLACEMENT:
        table.wrong(messages.NONZERO_START(displacement=", ".join(f"{value:g}" for value in x[0])))
        table.finish()
    coefficients = np.zeros((len(time), 4, 3))
    coefficients[:, 0] = x - x[0]
    coefficients[:-1, 1] = np.diff(x, axis=0) / np.diff(time)[:, None]
    return time, coefficients


def _integrate_acceleration(time: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Integrate accelerations a (r, 3) [m/s2], linear between times (r,), to coefficients (r, 4, 3)."""
    h = np.diff(time)[:, None]
    coefficients = np.zeros((len(time), 4, 3))
    v = np.zeros_like(a)
    v[1:] = np.cumsum(0.5 * h * (a[1:] + a[:-1]), axis=0)
    coefficients[1:, 0] = np.cumsum(h * v[:-1] + h * h * (2.0 * a[:-1] + a[1:]) / 6.0, axis=0)
    coefficients[:, 1] = v
    coefficients[:-1, 2] = 0.5 * a[:-1]
    coefficients[:-1, 3] = np.diff(a, axis=0) / h / 6.0
    return coefficients


def _fit_parabola(time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Fit c1, c2 (2, 3) of c1 t + c2 t^2 to velocities v (r, 3) [m/s] at times (r,) [s] by least squares."""
    t = time / time[-1]
    sums = [float(np.sum(t**k)) for k in (2, 3, 4)]
    right = np.array([np.sum(t[:, None] * v, axis=0), np.sum((t * t)[:, None] * v, axis=0)])
    det = sums[0] * sums[2] - sums[1] * sums[1]
    if det <= 0.0:
        return np.zeros((2, 3))
    c1 = (sums[2] * right[0] - sums[1] * right[1]) / det
    c2 = (sums[0] * right[1] - sums[1] * right[0]) / det
    return np.array([c1 / time[-1], c2 / time[-1] ** 2])


def _drift_note(number: int, a: np.ndarray, end: float, place: np.ndarray) -> str:
    """Describe the peaks of an integrated record, accelerations a (r, 3) [m/s2], and its drift at the end."""
    x, v = lengths(place[:, 0]), lengths(place[:, 1])
    return messages.RECORD_DRIFT(
        number=number,
        acceleration=lengths(a).max(),
        largest=x.max(),
        displacement=x[-1],
        end=end,
        velocity=v[-1],
    )


# --- PEER's files (.AT2)

HEADER_LINES = 4  # header lines before the numbers
UNIT = re.compile(r"\bunits?\s+(of|in|:)\s+g\b", re.I)


def read_at2(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read times (r,) [s] and accelerations (r,) [g]. Raises InputError.

    The fourth line of the header has "NPTS= 3000, DT= .0100 SEC"; one of them has "UNITS OF G".
    """
    lines = read_bytes(path).decode("utf-8", "replace").splitlines()
    last = lines[HEADER_LINES - 1] if len(lines) >= HEADER_LINES else ""
    points, step = (re.search(rf"{name}\s*=\s*([0-9.Ee+-]+)", last, re.I) for name in ("NPTS", "DT"))
    if not (points and step):
        raise InputError(messages.RECORD_HEADER(path=path, line=last[:60]))
    try:
        count, dt = int(float(points[1])), float(step[1])
        a = np.array(" ".join(lines[HEADER_LINES:]).split(), float)
    except ValueError as error:
        raise InputError(messages.RECORD_NOT_NUMERIC(path=path, error=error)) from None
    if len(a) != count or count < 2 or not dt > 0.0 or not np.isfinite(a).all():
        finite = int(np.isfinite(a).sum())
        raise InputError(messages.RECORD_LENGTH(path=path, found=finite, count=count, step=dt))
    if not UNIT.search("\n".join(lines[:HEADER_LINES])):
        raise InputError(messages.RECORD_UNIT(path=path))
    return dt * np.arange(count), a
