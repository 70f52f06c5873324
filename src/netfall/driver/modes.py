"""Lowest natural periods and modes of a net about an equilibrium, and its damping ratios.

Small vibrations about the equilibrium satisfy K u = omega^2 M u with the tangent stiffness K of all elements:

    k = dN/dL of the elastic law along an element, N / L across it, and the springs of supports.

Slack cables and elements removed in a stage of erection have no stiffness. Bars buckled at Euler's load have
no axial stiffness. Elements that have yielded respond elastically. Cables slip over frictionless pulleys and
stick at all other slip points. Shift-invert Lanczos (ARPACK) runs on rank 0 about a shift just below zero,
from a fixed start vector. Mass-proportional damping, v' = -zeta v, has the damping ratio zeta / (2 omega) =
zeta T / (4 pi).
"""

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from netfall.core.functions import from_rotated_axes, to_rotated_axes
from netfall.core.timings import NEVER_STOP
from netfall.driver import messages
from netfall.driver.problem import Outcome, Problem, RunContext, equilibria, loaded
from netfall.driver.statics.equilibrium import solve_equilibrium
from netfall.geometry.net import GRAVITY, Net
from netfall.geometry.turned import global_spring_stiffness, rotation_column
from netfall.job import derived
from netfall.job.job import Job
from netfall.job.values import format_list
from netfall.model.model import Model
from netfall.physics.air import damping_vectors
from netfall.physics.law.branches import band_branches
from netfall.physics.law.measures import REACHED_SHARE, elastic_stiffness
from netfall.physics.state import restore_saved, save_state
from netfall.statics.multigrid.tangent import Tangent, block_matrix, incidence_of, joint_tangent
from netfall.statics.slip import SlipTangent

# of the largest diagonal of M^-1 K [-]: a smaller omega^2 is rounding, and the mode is a mechanism
ZERO_OMEGA2 = 1e-12
# distance of the shift below zero, over the same [-], so that mechanisms can be found too
EIGENVALUE_SHIFT = 1e-11
MAX_DENSE_AXES = 300  # free axes up to which a dense solver finds all modes
SPARE_MODES = 4  # modes computed in addition: equal periods come in pairs, none of which may be missed
# stiffness, relative to that of a segment [-], that holds a closed cable, which could circulate freely
CLOSED_CABLE_STIFFNESS = 1e-9
GOLDEN = 0.6180339887498949
MAX_ROOT_STEPS = 20  # of Newton's method for a damped frequency, which needs 3 to 8
MODES = 6  # number that `check` prints
MAX_CHECK_ELEMENTS = 50_000  # number of elements up to which `check` prints modes
MOVING_DISPLACEMENT = 0.5  # of the largest displacement [-]: nodes above it are named for a mechanism
LOAD_NAMES = {"step": "the static loads", "at once": "the constant loads", "initial_state": "the mean wind"}


@final
@dataclass(frozen=True)
class Modes:
    """Modes of lowest omega^2, ascending.

    period : (k,) [s]; inf: no stiffness, a mechanism; nan: omega^2 < 0, the equilibrium is unstable
    shape : (k, n, 3), the largest displacement of a node is 1, its largest component positive
    effective_mass : (k, 3) share of the mass that moves along each axis: (u.M e)^2 / (u.M u) / (e.M e), u the
        shape, e the unit motion along the axis (Chopra, Dynamics of Structures, 13.2)
    stretch : (k,) axial stiffness of the elements over the whole stiffness in the mode; the rest is prestress
    unstable : number of negative omega^2 of the net
    """

    period: np.ndarray
    shape: np.ndarray
    effective_mass: np.ndarray
    stretch: np.ndarray
    unstable: int

    def damping_ratio(self, zeta: float) -> np.ndarray:
        """Compute the damping ratio (k,) of mass-proportional damping zeta [1/s] in each mode."""
        if zeta == 0.0:  # also for a mechanism, whose period is infinite
            return np.where(np.isnan(self.period), np.nan, 0.0)
        return zeta * self.period / (4.0 * np.pi)


def modes_at(
    net: Net,
    x: np.ndarray,
    N: np.ndarray,
    L0: np.ndarray,
    mass: np.ndarray,
    count: int,
    strain: str = "engineering",
    joints: Any = None,
    slip: SlipTangent | None = None,
    carries: Any = True,
) -> Modes:
    """Compute the lowest modes of a net in equilibrium at x (n, 3) [m] with axial forces N (m,) [N].

    L0 : (m,) [m]; mass : (n,) [kg]; count : largest number of modes; strain : its measure
    joints : `Joints` of bending chains; slip : `SlipTangent` of sliding cables
    carries : (m,) bool, elements in the net and not buckled
    """
    from scipy.sparse import diags_array  # imported here: it takes 0.2 s to load

    moves = np.flatnonzero((~net.fixed & (mass > 0.0)[:, None]).ravel())
    if not len(moves):
        return Modes(np.zeros(0), np.zeros((0, net.n, 3)), np.zeros((0, 3)), np.zeros(0), 0)
    vectors_along = x[net.elements[:, 1]] - x[net.elements[:, 0]]
    L = np.linalg.norm(vectors_along, axis=1)
    stiffness = elastic_stiffness(net.EA, L0, L, strain)
    axial = np.where(((N > 0.0) | net.bar) & carries, stiffness, 0.0)
    free = np.ones((net.n, 3), bool)  # held axes are omitted below
    number, nodal = np.arange(net.n), np.zeros(net.n)
    tangent = Tangent(
        N,
        vectors_along / L[:, None],
        axial,
        N / L,
        global_spring_stiffness(net),
        nodal,
        None if joints is None else joint_tangent(x, joints, nodal.copy()),
        between=None if net.angle is None else rotation_column(net, net.fixed)[:, 2],
    )
    at = incidence_of(net.elements, number, net.n)
    K = block_matrix(net.elements, tangent, free, nodal, number, at, net.n)
    if slip is not None:
        K = _with_slips(K, slip, net.elements)
    unit_motions, K = _in_own_axes(net, K)
    root = 1.0 / np.sqrt(np.repeat(mass, 3)[moves])
    scaled = (diags_array(root) @ K.tocsr()[moves][:, moves] @ diags_array(root)).tocsc()
    values, vectors, unstable = _lowest(scaled, min(count, len(moves)))
    threshold = ZERO_OMEGA2 * scaled.diagonal().max()
    with np.errstate(divide="ignore", invalid="ignore"):
        periods = 2.0 * np.pi / np.sqrt(np.where(np.abs(values) <= threshold, 0.0, values))
    unit_motion = (1.0 / root)[:, None] * unit_motions[moves]  # vectors are M^1/2 u, of length 1
    share = (vectors.T @ unit_motion) ** 2 / np.maximum((unit_motion**2).sum(0), np.finfo(float).tiny)
    shape = np.zeros((len(values), 3 * net.n))
    shape[:, moves] = (vectors * root[:, None]).T
    shape = _scaled(np.array([from_rotated_axes(mode, net.angle) for mode in shape.reshape(-1, net.n, 3)]))
    difference = shape[:, net.elements[:, 1]] - shape[:, net.elements[:, 0]]
    elongation = np.sum(difference * tangent.direction, axis=2)
    modal_stiffness = np.maximum(values, threshold) * (np.sum(shape**2, axis=2) @ mass)
    stretch = np.divide(
        elongation**2 @ axial, modal_stiffness, out=np.zeros(len(values)), where=modal_stiffness > 0.0
    )
    return Modes(periods, shape, share, stretch, unstable)


def _in_own_axes(net: Net, K: Any) -> tuple[np.ndarray, Any]:
    """Return unit motions (3 n, 3) along x, y and z, and the stiffness K, in the axes of the supports."""
    along = [to_rotated_axes(np.tile(unit, (net.n, 1)), net.angle) for unit in np.eye(3)]
    rotations = np.stack(along, axis=-1)  # (n, 3, 3), of each node
    if net.angle is not None:
        from scipy.sparse import bsr_array  # imported here: it takes 0.2 s to load

        rotation = bsr_array((rotations, np.arange(net.n), np.arange(net.n + 1)))
        K = rotation @ K @ rotation.T
    return rotations.reshape(-1, 3), K


def _with_slips(K: Any, slip: SlipTangent, elements: np.ndarray) -> Any:
    """Subtract the effect of slip from the stiffness K (3 n, 3 n) of a net whose cables stick.

    elements : (m, 2). See `statics.slip`. Weights do not follow slips, as in the dynamic stage.
    """
    from scipy.sparse import coo_array, diags_array, eye_array
    from scipy.sparse.linalg import spsolve

    chains, q, k = slip.slips.chains, len(slip.coupling), len(slip.way)
    sides = np.concatenate([chains.slip_in[chains.segment], chains.slip_out[chains.segment]])
    e = np.tile(np.arange(q), 2)
    slips = (sides >= 0) & (slip.way[sides] != 0)
    # derivative of the unstressed length by the slips at both ends of the element's segment
    derivative = np.concatenate([chains.share, -chains.share])
    length_by_slip = coo_array((derivative[slips], (e[slips], sides[slips])), (q, k)).tocsr()
    ends = np.where(chains.along[:, None] > 0, elements[chains.element], elements[chains.element, ::-1])
    pull = slip.coupling[:, None] * slip.direction
    axes = (3 * ends[:, :, None] + np.arange(3)).ravel()
    pulls = (np.stack([-pull, pull], axis=1).ravel(), (axes, np.repeat(np.arange(q), 6)))
    force_by_slip = coo_array(pulls, (K.shape[0], q)).tocsr() @ length_by_slip
    rows = np.flatnonzero(np.diff(force_by_slip.indptr))
    if not len(rows):
        return K
    slip_stiffness = length_by_slip.T @ diags_array(slip.stiffness) @ length_by_slip
    slip_stiffness = slip_stiffness + CLOSED_CABLE_STIFFNESS * slip_stiffness.diagonal().max() * eye_array(k)
    reduction = (force_by_slip[rows] @ spsolve(slip_stiffness.tocsc(), force_by_slip[rows].T.tocsc())).tocoo()
    return K - coo_array((reduction.data, (rows[reduction.row], rows[reduction.col])), K.shape)


def _lowest(matrix: Any, count: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the `count` lowest values and vectors of a symmetric matrix, and the number of negative values.

    If values are far below zero, the result has those closest to zero.
    """
    size, top = matrix.shape[0], float(np.abs(matrix.diagonal()).max())
    if top == 0.0:  # slack cables only
        return np.zeros(count), np.eye(size, count), 0
    if size <= max(MAX_DENSE_AXES, 4 * (count + SPARE_MODES)):
        values, vectors = np.linalg.eigh(matrix.toarray())
        return values[:count], vectors[:, :count], int((values < -EIGENVALUE_SHIFT * top).sum())
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    shift = -EIGENVALUE_SHIFT * top
    factors = splu(
        (matrix - shift * eye_array(size)).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    unstable = int((factors.U.diagonal() < 0.0).sum())  # Sylvester's law of inertia
    values, vectors = eigsh(
        matrix,
        count + SPARE_MODES,
        sigma=shift,
        OPinv=LinearOperator(matrix.shape, factors.solve),
        v0=(np.arange(1, size + 1) * GOLDEN) % 1.0 - 0.5,
    )
    order = np.argsort(values, kind="stable")[:count]
    return values[order], vectors[:, order], unstable


def _scaled(shape: np.ndarray) -> np.ndarray:
    """Scale shapes (k, n, 3) so that the largest displacement is 1 and their largest component positive."""
    flat = shape.reshape(len(shape), -1)
    largest = np.take_along_axis(flat, np.abs(flat).argmax(1)[:, None], 1)
    size = np.linalg.norm(shape, axis=2).max(1) * np.sign(largest[:, 0])
    return shape / size[:, None, None]


NAME = "modes"


def required(job: Job) -> bool:
    """Return whether the job requests modes."""
    return derived.mode_count(job) > 0


def run(problem: Problem, context: RunContext, outcomes: dict[str, Any]) -> Outcome:
    """Compute the modes about the last equilibrium of the statics and write /modes. Collective."""
    job = problem.job
    if context.saver.is_completed(NAME):
        return Outcome()
    with context.phases.phase(NAME):
        modes, section = current_modes(problem, derived.mode_count(job)), None
        if modes:
            model = problem.root_model
            section = {"period": modes.period, "shape": modes.shape, "effective_mass": modes.effective_mass}
            if job.dynamics:
                section["damping_ratio"] = mass_damping(job, model, modes)
            if job.dynamics and job.dynamics.axial_damping_ratio:
                section["band_damping_ratio"] = band_damping(job, modes)
            if model.air is not None:
                section["air_damping_ratio"] = aerodynamic_damping(job, model, modes)
        context.result.write_whole(NAME, section)
    return Outcome()


def current_modes(problem: Problem, count: int) -> Modes | None:
    """Compute the lowest modes of the net in its present state, on rank 0, None elsewhere. Collective."""
    gather, state, model = problem.distribution.gather_elements, problem.state, problem.model
    x = problem.distribution.gather_particles(state.x)
    N, L0, EA = gather(state.present_element_state().N), gather(state.L0), gather(state.EA)
    slip = problem.finder.slips and problem.finder.slips.pulley_tangent()
    if model is None or x is None or N is None or L0 is None or EA is None:
        return None
    # otherwise removed in a stage of erection, or buckled
    carries = (EA > 0.0) & (-N < REACHED_SHARE * model.euler)
    strain = state.features.strain
    return modes_at(model.net, x, N, L0, model.mass_unscaled, count, strain, model.joints, slip, carries)


def mode_lines(job: Job, problem: Problem) -> list[str]:
    """Return the text of `check` on modes and damping. Changes the state. One rank."""
    model = problem.root_model
    if model.net.m > MAX_CHECK_ELEMENTS:
        return [f"modes: left out, since the net has more than {MAX_CHECK_ELEMENTS} elements"]
    place, warnings = set_last_equilibrium(job, problem)
    modes = current_modes(problem, MODES)
    if modes is None or not len(modes.period):
        return warnings
    lines = [f"modes {place}: periods {_row(modes.period)} s", *warnings]

    def moving_nodes(selected: np.ndarray) -> str:
        moves_most = (np.linalg.norm(modes.shape[selected], axis=2) > MOVING_DISPLACEMENT).any(0)
        return format_list(model.net.node_id[moves_most])

    mechanisms, unstable = np.isinf(modes.period), np.isnan(modes.period)
    if mechanisms.any():
        lines.append(messages.MECHANISMS(count=int(mechanisms.sum()), nodes=moving_nodes(mechanisms)))
    if unstable.any():
        count, nodes = int(unstable.sum()), moving_nodes(unstable)
        lines.append(messages.UNSTABLE_MODES(count=count, nodes=nodes, total=modes.unstable))
    return lines + (_damping_lines(job, model, modes) if job.dynamics else [])


def set_last_equilibrium(job: Job, problem: Problem) -> tuple[str, list[str]]:
    """Bring the state to the last equilibrium of the run, if any; return its name and warnings. One rank.

    The full load is applied at once, in contrast to the steps of a run.
    """
    requests = [request for request in equilibria(problem) if request.load_case.kind in LOAD_NAMES]
    if not derived.has_statics(job) or not requests:
        return "in the initial state, without loads", []
    last = loaded(problem, requests[-1])
    start = save_state(problem.state)
    loads = "all loads" if derived.starts_loaded_for_removal(job) else LOAD_NAMES[last.kind]
    if not solve_equilibrium(problem, last, None, NEVER_STOP).carries:
        restore_saved(problem.state, start)
        return "in the initial state", [messages.MODES_WITHOUT_EQUILIBRIUM(loads=loads)]
    return f"in equilibrium under {loads}", []


def _damping_lines(job: Job, model: Model, modes: Modes) -> list[str]:
    """Return the text on the damping ratio of each kind of damping, and on free fall with mass damping."""
    dynamics = derived.dynamic_settings(job)
    zeta, air = dynamics.mass_damping, ", without the added mass of the air" * derived.has_added_air_mass(job)
    lines = [
        f"damping: mass_damping = {zeta:g} 1/s is {_percent(mass_damping(job, model, modes))} of the "
        f"critical in them (mass_damping x period / 4 pi{air})"
    ]
    if zeta:
        lines.append(
            f"falling: mass_damping = {zeta:g} 1/s also limits the speed of falling parts, to "
            f"g / mass_damping = {GRAVITY / zeta:.4g} m/s"
        )
    if dynamics.axial_damping_ratio:
        lines.append(
            f"damping: axial_damping_ratio is {_percent(band_damping(job, modes))} in them: it acts on the "
            f"stretch of elements, {_percent(modes.stretch)} of the modal stiffness, and not on prestress"
        )
    if job.wind is None or not np.isfinite(modes.period).any():
        return lines
    if model.air is not None:
        percent = _percent(aerodynamic_damping(job, model, modes))
        lines.append(f"damping: aerodynamic damping is {percent} at the mean wind")
    elif not job.wind.pressures and model.roof.area.any():
        percent = _percent(aerodynamic_damping(job, model, modes, kappa=1.0))
        lines.append(
            f"damping: without aerodynamic damping, which would be about {percent} "
            "([wind] aerodynamic_damping = 1)"
        )
    return lines


def mass_damping(job: Job, model: Model, modes: Modes) -> np.ndarray:
    """Compute the damping ratio (k,) of `mass_damping`, which does not act on the added mass of the air."""
    ratio = modes.damping_ratio(derived.dynamic_settings(job).mass_damping)
    if model.air_mass is None:
        return ratio
    square, mass = np.sum(modes.shape**2, axis=2), model.mass_unscaled
    return ratio * ((square @ (mass - model.air_mass)) / (square @ mass))


def band_damping(job: Job, modes: Modes) -> np.ndarray:
    """Compute the damping ratio (k,) of `axial_damping_ratio`, which acts only on the axial stiffness.

    In a mode of frequency omega and axial share s of its stiffness, motion exp(lambda t) satisfies lambda^2 +
    omega^2 (1 + s sum alpha lambda tau / (1 + lambda tau)) = 0. The ratio is -Re lambda / |lambda|
    of the root that oscillates.
    """
    dynamics = derived.dynamic_settings(job)
    low, high = dynamics.axial_damping_band or (np.nan, np.nan)
    branches = band_branches(dynamics.axial_damping_ratio or 0.0, low, high)
    alpha, tau = np.reshape(np.array(branches), (2, -1, 1))
    omega2, share = (2.0 * np.pi / modes.period) ** 2, modes.stretch
    root = 1j * np.sqrt(omega2)
    with np.errstate(invalid="ignore"):  # a mechanism does not vibrate, an unstable mode has no frequency
        for _ in range(MAX_ROOT_STEPS):
            delayed = 1.0 + root * tau
            excess = root**2 + omega2 * (1.0 + share * np.sum(alpha * root * tau / delayed, axis=0))
            root = root - excess / (2.0 * root + omega2 * share * np.sum(alpha * tau / delayed**2, axis=0))
        return np.where(omega2 == 0.0, 0.0, -root.real / np.abs(root))


def aerodynamic_damping(job: Job, model: Model, modes: Modes, kappa: float | None = None) -> np.ndarray:
    """Compute the aerodynamic damping ratio (k,) at the mean wind.

    sum |U| (c phi)^2 / (2 omega sum M phi^2), c of `physics.air`; kappa : for the whole roof, None: as given
    """
    speed = np.ones(model.net.n)  # for pressures at taps the speed is contained in c
    field, history = model.wind_field, model.history
    if field is not None and history is not None and not field.tapped:
        speed = np.abs(field.mean + np.sum(field.weight * history.mean_gust[field.corner], axis=1))
    c = model.air
    if kappa is not None and job.wind is not None:
        c = damping_vectors(kappa * job.wind.air_density * model.roof.vector)
    modal_damping = np.sum(modes.shape * c, axis=2) ** 2 @ speed
    modal_mass = np.sum(modes.shape**2, axis=2) @ model.mass_unscaled
    return modal_damping / modal_mass * modes.period / (4.0 * np.pi)


def _row(values: np.ndarray) -> str:
    """Format numbers for one line of text."""
    return ", ".join(f"{value:.4g}" for value in values)


def _percent(shares: np.ndarray) -> str:
    """Format shares as per cent for one line of text."""
    return f"{_row(100.0 * shares)} %"
