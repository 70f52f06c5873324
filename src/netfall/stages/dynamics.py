"""The dynamic stage: from the initial state through gusts and fractures to the end (paper 2.5, 3, 4)."""

from pathlib import Path

import numpy as np
from mpi4py import MPI

from netfall.ground.errors import DivergedError, interrupted
from netfall.job.job import Job
from netfall.mechanics.ground import begin_with_ground, move_ground
from netfall.model.schedule import steps_line
from netfall.record.columns import Moment
from netfall.record.energy import Energies, most_extreme, take_snapshot, total_energies
from netfall.record.envelope import NO_ENVELOPE, Envelope
from netfall.record.history import MOST_STRAIN, History, LocalProbes, most_strained, most_strained_of_all
from netfall.record.wind import wind_section
from netfall.stages import rests
from netfall.stages.removal import Removal
from netfall.stages.rests import losses_now
from netfall.stages.scene import Desk, Outcome, Scene
from netfall.stages.stepper import Stepper
from netfall.stages.varying import WindLoad, varying_loads
from netfall.write.ids import event_ids

LOOK_STEPS = 100_000  # at most, between looks at the wish to stop: a tenth of a second on the smallest net
LOOK_WORK = 200_000_000  # steps of an element, at most, between them: two seconds on one rank

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
    if start and scene.state.features.band:
        rest_branches(scene.state)
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


def rest_branches(state) -> None:
    """The branches of all elements as they are where it has long been at rest: they add nothing."""
    N = state.elements_now().N
    state.branch_a[:], state.branch_b[:], state.branch_c[:] = N, N, N


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


class Simulation(Stepper):
    """One run of the dynamic stage on all ranks.

    Order of events at a step n: the loads move on to the samples around t(n); the history row; the frame;
    what is lost; then the steps to the next target, in which elements break as they reach their fracture
    strain. In a long way to a target all ranks look at the same steps whether one has been asked to stop.
    """

    def __init__(self, scene: Scene, desk: Desk, loads: list, removal: Removal | None):
        """Collective. loads : that vary, as `varying` has them; removal : what is lost"""
        super().__init__(scene, desk, loads)
        self.removal = removal
        self.result, self.progress, self.saver = desk.result, desk.progress, desk.saver
        probes = scene.comm.bcast(scene.model and scene.model.layout.probes)
        self.envelope = Envelope(scene.distribution, scene.state.joints is not None)
        self.history = History(probes, scene.state.features)
        self.wind = next((load for load in loads if isinstance(load, WindLoad)), None)
        self.start_strain = self.start_plastic = 0.0  # J, from which energies count
        self.largest_work, self.room = 0.0, None
        looks = min(LOOK_STEPS, LOOK_WORK // max(1, scene.distribution.m)) // self.schedule.stride
        self.look_every = max(1, looks) * self.schedule.stride  # steps
        self.probes = LocalProbes(self.subdomain, probes)

    def begin(self, energies: Energies) -> None:
        """At the first step: what is stored and dissipated from there on counts."""
        self.start_strain, self.start_plastic = energies.strain, energies.plastic
        self.history.begin(energies.strain)
        if self.ground:
            begin_with_ground(self.state, self.ground)

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
                snapshot = self.snapshot(row=target in history)
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

    def snapshot(self, row: bool = False):
        """Snapshot of the present step, with the loads at its time, in place of the one before.

        row : whether it becomes a row of the history, which the envelope is of
        """
        self.loads.advance(self.state, self.n, self.schedule.step_at)
        share = (self.time - self.loads.time) / self.loads.dt
        self.plan.collect_yield(self.state)
        rows, envelope = self.history.rows["time"], NO_ENVELOPE
        if row:
            envelope = self.envelope.at(self.time, self.time - rows[-1] if rows else 0.0)
        if self.ground:
            number = self.n // self.stride
            times = number * self.dt, self.before_dt, (number + 1) * self.dt
            move_ground(*times, self.zeta, self.ground, self.state.particles)
        step = self.before_dt, self.dt, self.zeta, share
        self.room = take_snapshot(self.state, *step, self.room, envelope)
        if row and self.state.joints is not None:
            self.envelope.take_moments(self.state.bending_moments())
        return self.room

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
        self.watched = self.result.losses > 0
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

    def check_energies(self, snapshot) -> Energies:
        """The energies, before they are reported or the state is kept; stops a run that has diverged."""
        e = total_energies(self.comm, self.state, snapshot)
        # nan without the audit: then only what is not finite is seen
        known = np.maximum(self.largest_work, abs(e.external) + abs(e.support)) + self.start_strain
        if not np.isfinite(e.kinetic) or e.kinetic > 2 * known + 1e-9:
            raise divergence(self, snapshot, e.kinetic)
        return e

    def write_history(self, snapshot, e: Energies) -> None:
        """One row of /history, and the probes'."""
        self.largest_work = np.fmax(self.largest_work, abs(e.external) + abs(e.support))
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
        if snapshot.largest > MOST_STRAIN:
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
