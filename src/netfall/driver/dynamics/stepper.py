"""Steps of a net in which elements break: their length, and the repetition of long steps."""

import numpy as np

from netfall.driver.dynamics.detaching import PanelTearing
from netfall.driver.dynamics.varying_loads import VaryingLoad, VaryingLoads, ground_of
from netfall.driver.problem import Problem, RunContext
from netfall.explicit.loop import Interval
from netfall.explicit.plan import halo_width
from netfall.explicit.rows import RowTable
from netfall.geometry.net import GRAVITY
from netfall.job.derived import has_carried_weight
from netfall.loads.removal import Redistribution
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.physics.air import remove_wind
from netfall.physics.bending import add_joint_bounds
from netfall.physics.events import COLUMNS
from netfall.physics.fracture import FractureRules
from netfall.physics.law.branches import branch_stiffening
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.slip.motion import SLIP_STEP_SHARE
from netfall.physics.state import State
from netfall.physics.supports import largest_springs


def is_long_step_stable(comm: MPI.Comm, state: State, halo: Halo, dt: float, margin: float) -> bool:
    """Return whether the present net, with fragment ends, is stable with the step dt [s]. Collective.

    The criterion is that of `stability.any_shape_limits` for the intact net. It limits omega dt to 1 times
    `margin` at a cable, which may change between slack and taut, and to 2 times `margin` at a bar.
    halo : of any width
    """
    s, k = state, np.where(state.EA > 0.0, largest_stiffness(state.EA, state.L0), 0.0)
    k = k * branch_stiffening(s.features.band) if s.features.band else k
    stiffness = np.bincount(s.ends.ravel(), np.repeat(k, 2), s.n_local)
    if s.features.springs:
        stiffness += largest_springs(s.spring, s.turned)[: s.n_local]
    if s.joints is not None:
        add_joint_bounds(s.x, s.joints, 1.0, stiffness)
    moves = s.per_mass[: s.n_local] > 0.0
    square = np.zeros((s.n_local, halo.width))
    square[:, 0] = np.where(moves, stiffness * s.per_mass[: s.n_local], 0.0)
    halo.update(square)
    largest = np.where(s.bar != 0, 2.0, 1.0) * margin
    omega2 = np.where(k > 0.0, square[s.ends, 0].sum(1), 0.0)
    allowed = bool((omega2 * dt * dt <= largest * largest).all())
    if s.joints is not None:
        of_joints = square[s.joints.particles, 0].sum(1)
        allowed &= bool((of_joints * dt * dt <= (2.0 * margin) ** 2).all())
    return comm.allreduce(allowed, MPI.LAND)


SHORT_SPAN = 100  # number of long steps without a fracture, after which long steps are allowed again


class Stepper:
    """Net in motion at step number n, on one rank: x(n), v(n-1/2), and the fractures so far.

    While nothing breaks, a step is long: `stride` counted steps (`Schedule`).
    steps : number so far, long or short; short_until : step number from which steps may be long again
    """

    def __init__(self, problem: Problem, context: RunContext, loads: list[VaryingLoad], rows: RowTable):
        """Collective. loads : that vary, see `varying_loads`; rows : of the history"""
        job, schedule, distribution = problem.job, problem.dynamic_schedule, problem.distribution
        self.comm, self.state, self.schedule = problem.comm, problem.state, schedule
        self.log, self.model = context.log, problem.model
        self.phases, self.stop = context.phases, context.stop
        self.loads = VaryingLoads(self.state, loads, schedule.step_at)
        self.zeta = problem.dynamics.mass_damping
        self.ground = ground_of(problem.comm, self.model, self.state)
        self.after_fracture = job.wind.after_fracture if job.wind else "none"
        stable_dt = schedule.stable_dt  # longer, because Maxwell branches stiffen elements
        if self.state.features.band:
            stable_dt *= float(np.sqrt(branch_stiffening(self.state.features.band)))
        if self.state.features.sliding:  # slips add their share to it
            stable_dt /= SLIP_STEP_SHARE
        breaks = self.state.features.fracture
        rules = FractureRules(
            particles=distribution.n,
            n_owned=self.state.n_owned,
            first_split=self.state.first_split,
            element_gid=distribution.subdomain.element_gid,
            gravity=GRAVITY,
            own_weighs=bool(job.load and job.load.self_weight),
            carried_weighs=has_carried_weight(job),
            wind_stays=self.after_fracture not in ("particle", "detached"),
            stable_dt=stable_dt if self.state.features.fragments else np.nan,
            zeta=self.zeta,
        )
        self.distribution, self.subdomain, self.rows = distribution, distribution.subdomain, rows
        self.halo = Halo(problem.comm, self.subdomain, halo_width(self.state))
        self.plan = context.make_plan(self.state, self.halo, rules if breaks else None, rows, self.ground)
        self.n, self.steps, self.before_dt = 0, 0, 0.0
        self.stride, self.short_until = schedule.stride, 0
        self.slack, self.stopping = 0, False
        self.tearing = None
        if self.after_fracture == "panels":
            self.tearing = PanelTearing(distribution, self.model, self.log.broken, stable_dt)
        with self.phases.phase("time loop"):  # compiles or loads the kernels
            self.plan.run(Interval(0, 0, 0.0, schedule.dt, self.zeta, 0.0, 1.0), self.phases.of_steps)

    @property
    def time(self) -> float:
        """Return the time [s] of the present step."""
        return self.n * self.schedule.dt

    @property
    def dt(self) -> float:
        """Return the length [s] of the present steps."""
        return self.stride * self.schedule.dt

    def advance_in_stride(self, stop: int) -> None:
        """Step towards number `stop` with long or short steps.

        While nothing breaks, steps are long. If an element breaks, the state returns to the start of the long
        step in which it broke. From there on steps are short, until nothing has broken for SHORT_SPAN long
        steps. The choice depends only on the numbers of the steps in which elements break. It is therefore
        the same on any number of ranks, and independent of rows, snapshots and checkpoints.
        """
        long = self.schedule.stride
        if self.stride == long:
            if long == 1:
                self.advance_through_fractures(stop)
            elif self.advance_to_first_fracture(stop):
                if self.rows.is_due(self.n):  # with the long step, as at an output
                    self.update_envelope()
                self.stride, self.short_until = 1, self.n + SHORT_SPAN * long
            return
        self.advance_through_fractures(min(stop, self.short_until))
        local_steps = self.plan.logged_events()["step"]
        last_known = self.log.step[-1] if len(self.log) else -1
        last_fracture = self.comm.allreduce(int(local_steps.max(initial=last_known)), MPI.MAX)
        self.short_until = max(
            self.short_until, (last_fracture // long + 1 + SHORT_SPAN) * long if last_fracture >= 0 else 0
        )
        if self.n == self.short_until:
            long_dt, margin = self.schedule.long_dt, self.schedule.margin
            particles, elements = self.state.particles, self.state.elements
            self.plan.read(elements.EA, elements.L0, elements.ends, particles.per_mass)
            if is_long_step_stable(self.comm, self.state, self.halo, long_dt, margin):
                self.stride = long
            else:
                self.short_until += SHORT_SPAN * long

    def advance_through_fractures(self, stop: int) -> None:
        """Step to number `stop` with the short step, through any fractures."""
        count = len(self.log)
        while self.tearing and self.n < stop and self.advance_to_fracture(stop):
            self.plan.collect()
            self.tearing.remove_from(self.state, np.unique(self.log.element[count:]))
            self.plan.attach(self.state)
            count = len(self.log)
        if self.after_fracture == "all" and not count and self.advance_to_fracture(stop):
            self.plan.collect()
            remove_wind(self.state)
        self.advance_block(stop)

    def redistribute(self, redistribution: Redistribution) -> None:
        """Move the loads of removed particles to others, except loads in the state. Collective."""
        self.loads.redistribute(redistribution, self.distribution)
        if self.tearing:
            self.tearing.redistribute(redistribution)

    def update_envelope(self) -> None:
        """Update the envelope at the present step, and make its history row if it is due and missing."""
        self.plan.run(self.interval(self.n)._replace(row=True), self.phases.of_steps)

    def interval(self, stop: int, trial: bool = False) -> Interval:
        """Return the interval from the present step to number `stop`, with the present stride."""
        first, steps = self.n // self.stride, (stop - self.n) // self.stride
        loads = self.loads
        return Interval(
            first, steps, self.before_dt, self.dt, self.zeta, loads.time, loads.dt, self.stride, trial
        )

    def advance_to_first_fracture(self, stop: int) -> bool:
        """Step to number `stop`, or to the step before a fracture on any rank; return whether one follows."""
        interval = self.interval(stop, trial=True)
        steps = self.comm.allreduce(self.plan.run_trial(interval, self.phases.of_steps), MPI.MIN)
        if steps < interval.steps:
            self.plan.revert_trial()
            self.advance_block(self.n + steps * self.stride)
            return True
        self._count_steps(steps)
        return False

    def _count_steps(self, steps: int) -> None:
        self.n += steps * self.stride
        self.steps += steps
        self.before_dt = self.dt if steps else self.before_dt

    def advance_block(self, stop: int) -> None:
        """Step to number `stop` without communication except with neighbours."""
        while self.n < stop:
            self._count_steps(self.plan.run(self.interval(stop), self.phases.of_steps))

    def advance_to_fracture(self, stop: int) -> bool:
        """Step to number `stop`, or just beyond the first fracture on any rank; return whether there is one.

        A fracture acts on the whole net in the same step on all ranks, but other ranks learn of it only at
        the end of a block. A trial therefore finds the number of steps to the first fracture, so that no step
        waits for a reduction.
        """
        count = len(self.log)
        if self.advance_to_first_fracture(stop):
            while self.n < stop and len(self.log) == count:
                self.advance_block(self.n + 1)
                self.share_events()
        return len(self.log) > count

    def share_events(self) -> None:
        """Broadcast the fractures since the last call to every rank, and receive the stop flag."""
        counts = np.array([self.plan.event_count, self.stop.is_set], np.int64)
        self.comm.Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        events, stopping = counts.tolist()
        self.stopping = stopping > 0
        if events:
            columns = self.comm.allgather(list(self.plan.logged_events().values()))
            self.log.add(dict(zip(COLUMNS, map(np.concatenate, zip(*columns)))))
            self.plan.events.count[0] = 0
