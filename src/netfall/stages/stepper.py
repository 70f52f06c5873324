"""Stepping a net in which elements break: how long a step is, and what is taken back and stepped again."""

import numpy as np

from netfall.job.asks import carries_weight
from netfall.mechanics.air import end_wind
from netfall.mechanics.events import COLUMNS
from netfall.mechanics.fracture import FractureRules
from netfall.mechanics.law.branches import stiffening
from netfall.mechanics.slip.motion import STEP
from netfall.net.net import GRAVITY
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.record.rows import RowTable
from netfall.stages.panels import Tearing
from netfall.stages.scene import Desk, Scene
from netfall.stages.step_limit import long_step_allowed
from netfall.stages.varying import VaryingLoads, ground_of
from netfall.step.loop import Interval
from netfall.step.plan import Plan, halo_width

CALM = 100  # long steps without a fracture, after which the step is a long one again


class Stepper:
    """The net in motion at step number n, on one rank: x(n), v(n-1/2), and the fractures so far.

    A step is a long one, of `stride` steps as they are counted, as long as nothing breaks (`Schedule`).
    made : steps so far, long or short; calm : number from which on a step may be a long one again
    """

    def __init__(self, scene: Scene, desk: Desk, loads: list, rows: RowTable):
        """Collective. loads : that vary, as `varying` has them; rows : of the history"""
        job, schedule, distribution = scene.job, scene.schedule, scene.distribution
        self.comm, self.state, self.schedule = scene.comm, scene.state, schedule
        self.log, self.model = desk.log, scene.model
        self.phases, self.stop = desk.phases, desk.stop
        self.loads = VaryingLoads(self.state, loads, schedule.step_at)
        self.zeta = job.dynamics.damping
        self.ground = ground_of(scene.comm, self.model, self.state)
        self.after_fracture = job.wind.after_fracture if job.wind else "none"
        stable_dt = schedule.stable_dt  # of branches, which make elements stiffer, a longer one
        if self.state.features.band:
            stable_dt *= float(np.sqrt(stiffening(self.state.features.band)))
        if self.state.features.sliding:  # to which slips add their share
            stable_dt /= STEP
        breaks = self.state.features.fracture
        rules = FractureRules(
            particles=distribution.n,
            n_owned=self.state.n_owned,
            first_split=self.state.first_split,
            element_gid=distribution.subdomain.element_gid,
            gravity=GRAVITY,
            own_weighs=bool(job.load and job.load.self_weight),
            carried_weighs=carries_weight(job),
            wind_stays=self.after_fracture not in ("particle", "detached"),
            stable_dt=stable_dt if self.state.features.fragments else np.nan,
        )
        self.subdomain, self.rows = distribution.subdomain, rows
        self.halo = Halo(scene.comm, self.subdomain, halo_width(self.state))
        self.plan = Plan(self.state, self.halo, rules if breaks else None, rows, self.ground)
        self.n, self.made, self.before_dt = 0, 0, 0.0
        self.stride, self.calm = schedule.stride, 0
        self.slack, self.stopping = 0, False
        self.tearing = None
        if self.after_fracture == "panels":
            self.tearing = Tearing(scene.comm, distribution, self.model, self.log.broken, stable_dt)
        with self.phases.phase("time loop"):  # compiled, or loaded
            self.plan.run(Interval(0, 0, 0.0, schedule.dt, self.zeta, 0.0, 1.0), self.phases.of_steps)

    @property
    def time(self) -> float:
        """Time [s] of the present step."""
        return self.n * self.schedule.dt

    @property
    def dt(self) -> float:
        """Length [s] of the steps that are taken now."""
        return self.stride * self.schedule.dt

    def advance_in_stride(self, stop: int) -> None:
        """Step towards number `stop`, or to it, with the step that the net has now.

        As long as nothing breaks that is the long one. If something does, the steps are taken back to the
        long step in which it happened, and from there on it is the short one, until nothing has broken for
        CALM long steps. All of this follows from the numbers of the steps in which elements break: the same
        on any ranks, and wherever rows, frames and checkpoints fall.
        """
        long = self.schedule.stride
        if self.stride == long:
            if long == 1:
                self.advance_through_fractures(stop)
            elif self.advance_to_first_fracture(stop):
                self.stride, self.calm = 1, self.n + CALM * long
            return
        self.advance_through_fractures(min(stop, self.calm))
        mine = self.plan.events.step[: self.plan.events.count[0]]
        known = self.log.step[-1] if len(self.log) else -1
        last = self.comm.allreduce(int(mine.max(initial=known)), MPI.MAX)
        self.calm = max(self.calm, (last // long + 1 + CALM) * long if last >= 0 else 0)
        if self.n == self.calm:
            of_step = self.schedule.long_dt, self.schedule.margin
            if long_step_allowed(self.comm, self.state, self.halo, *of_step):
                self.stride = long
            else:
                self.calm += CALM * long

    def advance_through_fractures(self, stop: int) -> None:
        """Step to number `stop` with the short step, whatever breaks."""
        known = len(self.log)
        while self.tearing and self.n < stop and self.advance_to_fracture(stop):
            self.tearing.tear(self.state, np.unique(self.log.element[known:]))
            self.plan.attach(self.state)
            known = len(self.log)
        if self.after_fracture == "all" and not known and self.advance_to_fracture(stop):
            end_wind(self.state)
        self.advance_block(stop)

    def interval(self, stop: int, trial: bool = False) -> Interval:
        """The steps from the present one to number `stop`, with the stride of now."""
        first, steps = self.n // self.stride, (stop - self.n) // self.stride
        now = first, steps, self.before_dt, self.dt, self.zeta
        return Interval(*now, self.loads.time, self.loads.dt, self.stride, trial)

    def advance_to_first_fracture(self, stop: int) -> bool:
        """Step to number `stop`, or to the step in which something is to break on any rank; whether it is."""
        whole = self.interval(stop, trial=True)
        steps = self.comm.allreduce(self.plan.try_out(whole, self.phases.of_steps), MPI.MIN)
        if steps < whole.steps:
            self.plan.take_back()
            self.advance_block(self.n + steps * self.stride)
            return True
        self._stepped(steps)
        return False

    def _stepped(self, steps: int) -> None:
        self.n += steps * self.stride
        self.made += steps
        self.before_dt = self.dt if steps else self.before_dt

    def advance_block(self, stop: int) -> None:
        """Step to number `stop` without a word to ranks that are not neighbours."""
        while self.n < stop:
            self._stepped(self.plan.run(self.interval(stop), self.phases.of_steps))

    def advance_to_fracture(self, stop: int) -> bool:
        """Step to number `stop`, or just behind the first fracture on any rank; whether there is one.

        What a fracture does to the whole net it does on all ranks in the same step, but a rank learns of one
        elsewhere only at the end of a block. So the steps to the first one are found by a trial, and no step
        waits for a reduction.
        """
        known = len(self.log)
        if self.advance_to_first_fracture(stop):
            while self.n < stop and len(self.log) == known:
                self.advance_block(self.n + 1)
                self.share_events()
        return len(self.log) > known

    def share_events(self) -> None:
        """Broadcast the fractures since the last time, so that every rank knows all of them.

        Hear of a wish to stop.
        """
        mine = self.plan.events
        counts = np.array([mine.count[0], self.stop.wanted], np.int64)
        self.comm.Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        events, stopping = counts.tolist()
        self.stopping = stopping > 0
        if events:
            parts = self.comm.allgather([getattr(mine, name)[: mine.count[0]] for name in COLUMNS])
            self.log.add(dict(zip(COLUMNS, map(np.concatenate, zip(*parts)))))
            mine.count[0] = 0
