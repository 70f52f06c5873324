"""Steps of a net in which elements break: the length of a step, and the repetition of long steps."""

import numpy as np

from netfall.driver.cladding_loss import PanelTearing
from netfall.driver.problem import Problem, RunContext
from netfall.driver.step_limit import is_long_step_stable
from netfall.driver.varying_loads import VaryingLoad, VaryingLoads, ground_of
from netfall.explicit.loop import Interval
from netfall.explicit.plan import StepPlan, halo_width
from netfall.explicit.rows import RowTable
from netfall.geometry.net import GRAVITY
from netfall.job.derived import has_carried_weight
from netfall.loads.removal import Redistribution
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.physics.air import remove_wind
from netfall.physics.events import COLUMNS
from netfall.physics.fracture import FractureRules
from netfall.physics.law.branches import branch_stiffening
from netfall.physics.slip.motion import SLIP_STEP_SHARE

CALM_STEPS = 100  # long steps without a fracture, after which long steps are allowed again


class Stepper:
    """Net in motion at step number n, on one rank: x(n), v(n-1/2), and the fractures so far.

    A step is long, with `stride` counted steps, while nothing breaks (`Schedule`).
    made : steps so far, long or short; calm : number from which on a step may be long again
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
        stable_dt = schedule.stable_dt  # Maxwell branches stiffen elements, so this one is longer
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
        )
        self.distribution, self.subdomain, self.rows = distribution, distribution.subdomain, rows
        self.halo = Halo(problem.comm, self.subdomain, halo_width(self.state))
        self.plan = StepPlan(self.state, self.halo, rules if breaks else None, rows, self.ground)
        self.n, self.made, self.before_dt = 0, 0, 0.0
        self.stride, self.calm = schedule.stride, 0
        self.slack, self.stopping = 0, False
        self.tearing = None
        if self.after_fracture == "panels":
            self.tearing = PanelTearing(problem.comm, distribution, self.model, self.log.broken, stable_dt)
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
        step in which it broke. From there on steps are short, until nothing has broken for CALM_STEPS long
        steps. The choice depends only on the numbers of the steps in which elements break. So it is the same
        on any number of ranks, and independent of rows, snapshots and checkpoints.
        """
        long = self.schedule.stride
        if self.stride == long:
            if long == 1:
                self.advance_through_fractures(stop)
            elif self.advance_to_first_fracture(stop):
                self.stride, self.calm = 1, self.n + CALM_STEPS * long
            return
        self.advance_through_fractures(min(stop, self.calm))
        local_steps = self.plan.events.step[: self.plan.events.count[0]]
        last_known = self.log.step[-1] if len(self.log) else -1
        last_fracture = self.comm.allreduce(int(local_steps.max(initial=last_known)), MPI.MAX)
        self.calm = max(
            self.calm, (last_fracture // long + 1 + CALM_STEPS) * long if last_fracture >= 0 else 0
        )
        if self.n == self.calm:
            long_dt, margin = self.schedule.long_dt, self.schedule.margin
            if is_long_step_stable(self.comm, self.state, self.halo, long_dt, margin):
                self.stride = long
            else:
                self.calm += CALM_STEPS * long

    def advance_through_fractures(self, stop: int) -> None:
        """Step to number `stop` with the short step, through any fractures."""
        count = len(self.log)
        while self.tearing and self.n < stop and self.advance_to_fracture(stop):
            self.tearing.remove_from(self.state, np.unique(self.log.element[count:]))
            self.plan.attach(self.state)
            count = len(self.log)
        if self.after_fracture == "all" and not count and self.advance_to_fracture(stop):
            remove_wind(self.state)
        self.advance_block(stop)

    def redistribute(self, redistribution: Redistribution) -> None:
        """Move what acts on leaving particles to others, except what is in the state. Collective."""
        self.loads.redistribute(redistribution, self.distribution)
        if self.tearing:
            self.tearing.redistribute(redistribution)

    def interval(self, stop: int, trial: bool = False) -> Interval:
        """Return the interval from the present step to number `stop`, with the present stride."""
        first, steps = self.n // self.stride, (stop - self.n) // self.stride
        loads = self.loads
        return Interval(
            first, steps, self.before_dt, self.dt, self.zeta, loads.time, loads.dt, self.stride, trial
        )

    def advance_to_first_fracture(self, stop: int) -> bool:
        """Step to number `stop`, or to the step before a fracture on any rank; return whether one is due."""
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
        self.made += steps
        self.before_dt = self.dt if steps else self.before_dt

    def advance_block(self, stop: int) -> None:
        """Step to number `stop` without communication except with neighbours."""
        while self.n < stop:
            self._count_steps(self.plan.run(self.interval(stop), self.phases.of_steps))

    def advance_to_fracture(self, stop: int) -> bool:
        """Step to number `stop`, or just beyond the first fracture on any rank; return whether there is one.

        A fracture acts on the whole net in the same step on all ranks. But other ranks learn of it only at
        the end of a block. So a trial finds the number of steps to the first fracture, and no step waits for
        a reduction.
        """
        count = len(self.log)
        if self.advance_to_first_fracture(stop):
            while self.n < stop and len(self.log) == count:
                self.advance_block(self.n + 1)
                self.share_events()
        return len(self.log) > count

    def share_events(self) -> None:
        """Broadcast the fractures since the last call to every rank, and receive the stop flag."""
        local_events = self.plan.events
        counts = np.array([local_events.count[0], self.stop.wanted], np.int64)
        self.comm.Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        events, stopping = counts.tolist()
        self.stopping = stopping > 0
        if events:
            columns = self.comm.allgather(
                [getattr(local_events, name)[: local_events.count[0]] for name in COLUMNS]
            )
            self.log.add(dict(zip(COLUMNS, map(np.concatenate, zip(*columns)))))
            local_events.count[0] = 0
