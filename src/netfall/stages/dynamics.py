"""The dynamic stage: from the initial state through gusts and fractures to the end (paper 2.5, 3, 4)."""

from pathlib import Path

import numpy as np
from mpi4py import MPI

from netfall.ground.errors import DivergedError, interrupted
from netfall.job.asks import carries_weight
from netfall.job.job import Job
from netfall.mechanics.events import COLUMNS
from netfall.mechanics.fracture import FractureRules
from netfall.mechanics.state import State
from netfall.model.schedule import steps_line
from netfall.net.net import GRAVITY
from netfall.parallel.halo import Halo
from netfall.record.columns import Moment
from netfall.record.energy import Energies, most_extreme, take_snapshot, total_energies
from netfall.record.envelope import Envelope
from netfall.record.history import History, LocalProbes, most_strained, most_strained_of_all
from netfall.record.wind import wind_section
from netfall.stages import rests
from netfall.stages.panels import Tearing
from netfall.stages.removal import Removal
from netfall.stages.rests import losses_now
from netfall.stages.scene import Desk, Outcome, Scene
from netfall.stages.step_limit import long_step_allowed
from netfall.stages.varying import VaryingLoads, WindLoad, varying_loads
from netfall.step.loop import Interval
from netfall.step.plan import Plan, halo_width
from netfall.step.slots import collect_yield_of
from netfall.write.ids import event_ids

LOOK_STEPS = 100_000  # at most, between looks at the wish to stop: a tenth of a second on the smallest net
LOOK_WORK = 200_000_000  # steps of an element, at most, between them: two seconds on one rank
CALM = 100  # long steps without a fracture, after which the step is a long one again

NAME = "dynamics"


def required(job: Job) -> bool:
    """Whether the job has a dynamic stage."""
    return job.dynamics is not None


def run(scene: Scene, desk: Desk, outcomes: dict) -> Outcome:
    """Step through the dynamic stage; result : the `Simulation`. Collective."""
    removal, losses = None, losses_now(scene)
    if scene.job.removes:
        removal = Removal(scene, losses, outcomes[rests.NAME].result, desk.log)
    with desk.phases.phase("wind"):
        loads = varying_loads(scene) + (list(removal.fades.values()) if removal else [])
    schedule = scene.schedule
    desk.progress.say(f"dynamics: {scene.job.dynamics.duration:g} s in {steps_line(schedule)}")
    start = start_energies(scene) if desk.saver.stage != NAME else None
    simulation = Simulation(scene, desk, loads, removal)
    if start:
        simulation.begin(start)
    simulation.register()
    with desk.phases.phase(NAME):
        try:
            simulation.run()
        except DivergedError:  # on every rank
            simulation.halo.free()
            raise
    made = {"steps": simulation.made, "time_step": schedule.long_dt, "shortest_time_step": schedule.dt}
    return Outcome(simulation, sections=sections(scene, simulation), attributes=made)


def start_energies(scene: Scene) -> Energies:
    """The energies at the start. Collective."""
    return total_energies(scene.comm, scene.state, take_snapshot(scene.state, 0.0, 1.0, 0.0, 0.0))


def sections(scene: Scene, simulation) -> dict[str, dict[str, np.ndarray]]:
    """History, events, losses and wind, on rank 0."""
    model = scene.model
    if model is None:
        return {}
    history, events = simulation.history, simulation.log.columns()
    found = {"history": history.columns() | history.probe_columns()}
    found["events"] = events | event_ids(model.net, events)
    if simulation.removal:
        found["removal"] = simulation.removal.columns()
    if simulation.wind:
        found["wind"] = wind_section(scene.job, model, *simulation.wind.record_until(simulation.time))
    return found


class Simulation:
    """One run of the dynamic stage on all ranks.

    Order of events at a step n: the loads move on to the samples around t(n); the history row; the frame;
    what is lost; then the steps to the next target, in which elements break as they reach their fracture
    strain. In a long way to a target all ranks look at the same steps whether one has been asked to stop.
    """

    def __init__(self, scene: Scene, desk: Desk, loads: list, removal: Removal | None):
        """Collective. loads : that vary, as `varying` has them; removal : what is lost"""
        job, schedule, distribution = scene.job, scene.schedule, scene.distribution
        self.comm, self.state, self.schedule = scene.comm, scene.state, schedule
        self.log, self.removal, self.model = desk.log, removal, scene.model
        self.result, self.progress, self.phases = desk.result, desk.progress, desk.phases
        self.stop, self.saver = desk.stop, desk.saver
        probes = scene.comm.bcast(scene.model and scene.model.layout.probes)
        self.envelope, self.history = Envelope(distribution), History(probes)
        self.wind = next((load for load in loads if isinstance(load, WindLoad)), None)
        self.loads = VaryingLoads(self.state, loads)
        self.zeta = job.dynamics.damping
        self.after_fracture = job.wind.after_fracture if job.wind else "none"
        self.rules = FractureRules(
            particles=distribution.n,
            n_owned=self.state.n_owned,
            first_split=self.state.first_split,
            element_gid=distribution.subdomain.element_gid,
            gravity=GRAVITY,
            own_weighs=bool(job.load and job.load.self_weight),
            carried_weighs=carries_weight(job),
            wind_stays=self.after_fracture != "particle",
            stable_dt=schedule.stable_dt if self.state.features.fragments else None,
        )
        self.subdomain = distribution.subdomain
        self.halo = Halo(scene.comm, self.subdomain, halo_width(self.state))
        self.plan = Plan(self.state, self.halo, self.rules if self.state.features.fracture else None)
        self.n = 0  # step number: x(n), v(n-1/2)
        self.before_dt = 0.0
        self.made = 0  # steps, each of a stride
        self.stride = schedule.stride  # now
        self.calm = 0  # step number from which on a longer stride may be had again
        self.start_strain = self.start_plastic = 0.0  # J, from which energies count
        self.largest_work = 0.0
        self.slack = 0
        self.stopping = False
        looks = min(LOOK_STEPS, LOOK_WORK // max(1, distribution.m)) // schedule.stride
        self.look_every = max(1, looks) * schedule.stride  # steps
        self.probes = LocalProbes(self.subdomain, probes)
        self.tearing = None
        if self.after_fracture == "panels":
            self.tearing = Tearing(scene.comm, distribution, self.model, self.log.broken, schedule.stable_dt)
        with self.phases.phase("time loop"):  # compiled, or loaded
            self.plan.run(Interval(0, 0, 0.0, schedule.dt, self.zeta, 0.0, 1.0), self.phases.of_steps)

    @property
    def dt(self) -> float:
        """Length [s] of the steps that are taken now."""
        return self.stride * self.schedule.dt

    def begin(self, energies: Energies) -> None:
        """At the first step: what is stored and dissipated from there on counts."""
        self.start_strain, self.start_plastic = energies.strain, energies.plastic
        self.history.begin(energies.strain)

    def register(self) -> None:
        """Have all that moves saved with checkpoints; taken up where the run goes on from one. Collective."""
        saver = self.saver
        if self.wind:
            saver.register("wind", self.wind.record, self.wind.restore, everywhere=True)
        if self.removal:
            restore = lambda small, arrays: self.removal.restore(small, arrays, self)
            saver.register("removal", self.removal.record, restore)
        saver.register("simulation", self.record, self.restore)
        saver.register("history", self.history.record, self.history.restore, everywhere=True)
        envelope = self.envelope
        saver.register("envelope", lambda: envelope.record(self.state), envelope.restore)

    @property
    def time(self) -> float:
        """Time [s] of the present step."""
        return self.n * self.schedule.dt

    def run(self) -> None:
        """From the present step to the last. Raises Interrupted, with a checkpoint, if that is asked for."""
        history, frames, saves = (
            set(steps.tolist())
            for steps in (self.schedule.history, self.schedule.frames, self.schedule.checkpoints)
        )
        self.progress.start(self.n / self.schedule.steps, self.n)
        for target in sorted(
            step
            for step in history | frames | saves
            if step > self.n or (self.n == 0 and not len(self.history))
        ):
            self.advance_to(target)
            with self.phases.phase("dynamics: output"):
                snapshot = self.snapshot()
                self.watch_strains(snapshot)
                self.share_events(snapshot.slack)
                if target in history or target in saves:
                    energies = self.check_energies(snapshot)
                if target in history:
                    self.write_history(snapshot, energies)
                if target in frames:
                    self.result.write_frame(self.time, self.state, snapshot)
                self.report()
                if self.stopping and target < self.schedule.steps:
                    self.leave()
                if target in saves:
                    self.save()
        snapshot = self.snapshot()
        if self.removal:
            self.removal.close(self.state, snapshot.N)
        self.result.write_envelope(self.state, *self.envelope.columns())
        self.result.write_final(self.state, snapshot)
        self.halo.free()

    def snapshot(self):
        """Snapshot of the present step, with the loads at its time."""
        self.loads.advance(self.state, self.n, self.schedule.step_at)
        share = (self.time - self.loads.time) / self.loads.dt
        collect_yield_of(self.state)
        return take_snapshot(self.state, self.before_dt, self.dt, self.zeta, share)

    def record(self) -> tuple[dict, dict]:
        """Where the run stands, for `restore`. Collective."""
        small = {
            "step": self.n,
            "before_dt": self.before_dt,
            "made": self.made,
            "stride": self.stride,
            "calm": self.calm,
            "largest_work": self.largest_work,
            "start_strain": self.start_strain,
            "start_plastic": self.start_plastic,
            "most_strained": most_strained_of_all(self.comm, self.history.most_strained),
        }
        return small, {}

    def restore(self, small: dict, _: dict | None) -> None:
        """Take up the record of an earlier run; the loads stand where it left them."""
        self.n, self.before_dt, self.made = small["step"], small["before_dt"], small["made"]
        self.stride, self.calm = small["stride"], small["calm"]
        self.largest_work = small["largest_work"]
        self.history.most_strained = tuple(small["most_strained"])
        self.start_strain, self.start_plastic = small["start_strain"], small["start_plastic"]
        self.result.losses = self.removal.done if self.removal else 0
        self.loads.restart(self.state, self.n, self.schedule.step_at)

    def advance_to(self, target: int) -> None:
        """Step to number `target`, with the wind moving on where it is due.

        Raises Interrupted if asked to.
        """
        while self.n < target:
            stop = min(target, self.n - self.n % self.look_every + self.look_every)
            if self.removal:
                if self.n == self.removal.next_step:
                    self.removal.happen(self)
                stop = min(stop, self.removal.next_step)
            self.loads.advance(self.state, self.n, self.schedule.step_at)
            stop = min(stop, self.loads.due(self.schedule.step_at))
            while self.n < stop:
                self.advance_in_stride(stop)
            if self.n < target and self.n % self.look_every == 0:
                self.report()
                if self.comm.allreduce(self.stop.wanted, MPI.LOR):
                    self.share_events()
                    self.leave()

    def leave(self) -> None:
        """End here, with a checkpoint, because that is asked for. Raises Interrupted. Collective."""
        self.check_energies(self.snapshot())
        raise interrupted(f"at t = {self.time:.6g} s (step {self.n})", self.save())

    def save(self) -> Path:
        """Write a checkpoint of the present step; its path. Collective."""
        return self.saver.save(NAME, self.n, self.state)

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
            if long_step_allowed(
                self.comm, self.state, self.halo, self.schedule.long_dt, self.schedule.margin
            ):
                self.stride = long
            else:
                self.calm += CALM * long

    def advance_through_fractures(self, stop: int) -> None:
        """Step to number `stop` with the short step, whatever breaks."""
        if self.after_fracture == "all" and not len(self.log):
            self.advance_until_first_fracture(stop)
        elif self.tearing:
            self.advance_with_tearing(stop)
        else:
            self.advance_block(stop)

    def interval(self, stop: int, trial: bool = False) -> Interval:
        """The steps from the present one to number `stop`, with the stride of now."""
        first, steps = self.n // self.stride, (stop - self.n) // self.stride
        sample, watched = (self.loads.time, self.loads.dt), self.removal is not None and self.removal.done > 0
        return Interval(
            first, steps, self.before_dt, self.dt, self.zeta, *sample, self.stride, watched, trial
        )

    def advance_to_first_fracture(self, stop: int) -> bool:
        """Step to number `stop`, or to the step in which something breaks on any rank; whether it does."""
        whole = self.interval(stop, trial=True)
        mine = self.plan.try_out(whole, self.phases.of_steps)
        steps = self.comm.allreduce(mine, MPI.MIN)
        if steps < whole.steps:
            self.plan.take_back()
            if steps:
                self.plan.run(self.interval(self.n + steps * self.stride), self.phases.of_steps)
        self._stepped(steps)
        return steps < whole.steps

    def _stepped(self, steps: int) -> None:
        self.n += steps * self.stride
        self.made += steps
        self.before_dt = self.dt if steps else self.before_dt

    def advance_block(self, stop: int) -> None:
        """Step to number `stop` without a word to ranks that are not neighbours."""
        while self.n < stop:
            self._stepped(self.plan.run(self.interval(stop), self.phases.of_steps))

    def advance_until_first_fracture(self, stop: int) -> None:
        """For after_fracture = "all": all wind ends with the first fracture, at the same step on all ranks.

        A rank learns of a fracture elsewhere only at the end of a block. The block that holds the first one
        is therefore taken back and stepped again to just behind it; no step waits for a reduction.
        """
        first, begin, kept = self.first_fracture(stop)
        if first < stop:
            self.take_back(begin, kept)
            self.advance_block(first + 1)
            self.state.wind[:] = 0.0
            self.share_events()

    def advance_with_tearing(self, stop: int) -> None:
        """For after_fracture = "panels": panels leave in the step of the fracture, on all ranks.

        A block with fractures is stepped again to just behind the first; see `advance_until_first_fracture`.
        """
        while self.n < stop:
            first, begin, kept = self.first_fracture(stop)
            if first >= stop:
                return
            if first + 1 < self.n:
                self.take_back(begin, kept)
                self.advance_block(first + 1)
            known = len(self.log)
            self.share_events()
            self.tearing.tear(self.state, np.unique(self.log.element[known:]))
            self.plan.attach(self.state)

    def first_fracture(self, stop: int) -> tuple[int, tuple, State]:
        """A block up to `stop`: the step of the first fracture in it, and how it began, for `take_back`."""
        collect_yield_of(self.state)
        count = int(self.plan.events.count[0])
        begin, kept = (self.n, self.made, self.before_dt, count), self.state.copy()
        self.advance_block(stop)
        events = self.plan.events
        mine = int(events.step[: events.count[0]].min(initial=stop))
        return self.comm.allreduce(mine, MPI.MIN), begin, kept

    def take_back(self, begin: tuple, kept: State) -> None:
        """To where a block began."""
        self.n, self.made, self.before_dt, self.plan.events.count[0] = begin
        self.state = kept
        self.plan.attach(kept)

    def share_events(self, slack_here: int = 0) -> None:
        """Broadcast the fractures since the last time, so that every rank knows all of them.

        Count slack cables; hear of a wish to stop.
        """
        mine = self.plan.events
        counts = np.array([mine.count[0], slack_here, self.stop.wanted], np.int64)
        self.comm.Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        events, self.slack, stopping = counts.tolist()
        self.stopping = stopping > 0
        if events:
            parts = self.comm.allgather([column[: mine.count[0]] for column in mine[1:]])
            self.log.add(dict(zip(COLUMNS, map(np.concatenate, zip(*parts)))))
            mine.count[0] = 0

    def check_energies(self, snapshot) -> Energies:
        """The energies, before they are reported or the state is kept; stops a run that has diverged."""
        e = total_energies(self.comm, self.state, snapshot)
        # nan without the audit: then only what is not finite is seen
        known = np.maximum(self.largest_work, abs(e.external)) + self.start_strain
        if not np.isfinite(e.kinetic) or e.kinetic > 2 * known + 1e-9:
            raise divergence(self, snapshot, e.kinetic)
        return e

    def write_history(self, snapshot, e: Energies) -> None:
        """One row of /history, the probes' and the envelope's."""
        rows = self.history.rows["time"]
        self.envelope.add(self.time, self.time - rows[-1] if rows else 0.0, self.state, snapshot)
        self.largest_work = np.fmax(self.largest_work, abs(e.external))
        now = Moment(
            self.time,
            self.before_dt or self.dt,
            e,
            self.start_strain,
            self.start_plastic,
            self.slack,
            len(self.log.broken),
        )
        self.history.add(self.probes.values(self.comm, self.state, snapshot), now)

    def watch_strains(self, snapshot) -> None:
        """Keep the largest strain so far, for the end of the run."""
        gid = self.subdomain.element_gid
        now = most_strained(self.state, self.time, snapshot.eps, snapshot.N, gid)
        self.history.most_strained = max(self.history.most_strained, now)

    def report(self) -> None:
        """Progress on rank 0."""
        s = self.schedule
        share = self.n / s.steps
        self.progress.at(
            share,
            f"t = {self.time:.3f} s",
            self.n,
            "steps",
            f"slack {self.slack}, broken {len(self.log.broken)}",
        )


def divergence(simulation, snapshot, kinetic: float) -> DivergedError:
    """Names the fastest particle and the element with the largest strain, on every rank. Collective.

    kinetic : [J]
    """
    s = simulation
    particle, element = most_extreme(s.comm, s.state, s.subdomain.element_gid, snapshot)
    node, element = s.comm.bcast(s.model and (s.model.node_name(particle), s.model.id_of(element)))
    return DivergedError(
        f"diverged at t = {s.time:.6g} s (step {s.n}): kinetic energy {kinetic:.3g} J is "
        f"out of all proportion to the external work; fastest: {node}, most strained: element {element}; "
        "take a smaller time_step or safety"
    )
