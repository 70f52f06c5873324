"""The dynamic stage: from the initial state through gusts and fractures to the end (paper 2.5, 3, 4)."""

from pathlib import Path

import numpy as np

from netfall.ground.errors import DivergedError, interrupted
from netfall.job.asks import own_weight
from netfall.job.job import Job
from netfall.mechanics.ground import begin_with_ground, move_ground
from netfall.mechanics.law.measures import largest_stiffness
from netfall.mechanics.slip.inertia import slip_inertia
from netfall.mechanics.slip.motion import beside
from netfall.model.schedule import steps_line
from netfall.record.energy import Energies, energies_of, most_extreme, take_snapshot, total_energies
from netfall.record.envelope import Envelope
from netfall.record.history import History, columns_at, most_strained, most_strained_of_all
from netfall.record.rows import RowTable
from netfall.record.wind import wind_section
from netfall.stages import rests
from netfall.stages.detaching import Detaching
from netfall.stages.removal import Removal
from netfall.stages.rests import losses_now
from netfall.stages.scene import Desk, Outcome, Scene
from netfall.stages.stepper import Stepper
from netfall.stages.varying import WindLoad, varying_loads
from netfall.write.ids import event_ids
from netfall.write.result import slide_section

WIDEN_STEPS = 50  # at most, that are a long one each, between times at which the envelope is widened
LOOK_STEPS = 100_000  # at most, between looks at the wish to stop: a tenth of a second on the smallest net
LOOK_WORK = 200_000_000  # steps of an element, at most, between them: two seconds on one rank

NAME = "dynamics"
KEPT = ("before_dt", "made", "stride", "calm", "largest_work", "start_strain", "start_plastic")


def required(job: Job) -> bool:
    """Whether the job has a dynamic stage."""
    return job.dynamics is not None


def run(scene: Scene, desk: Desk, outcomes: dict) -> Outcome:
    """Step through the dynamic stage; result : the `Simulation`. Collective."""
    losses, removal, start, state, schedule = losses_now(scene), None, None, scene.state, scene.schedule
    if scene.job.removes:
        removal = Removal(scene, losses, outcomes[rests.NAME].result, desk.log)
    with desk.phases.phase("wind"):
        loads = varying_loads(scene) + (list(removal.fades.values()) if removal else [])
    desk.progress.say(f"dynamics: {scene.job.dynamics.duration:g} s in {steps_line(schedule)}")
    if desk.saver.stage != NAME:
        if state.features.sliding:
            begin_slipping(scene)
        start = total_energies(scene.comm, state, take_snapshot(state, 0.0, 1.0, 0.0, 0.0))
        if state.features.band:
            rest_branches(state)
    simulation = Simulation(scene, desk, loads, removal)
    if start:
        simulation.begin(start)
    simulation.register()
    try:
        with desk.phases.phase(NAME):
            simulation.run()
    except DivergedError:  # on every rank
        simulation.halo.free()
        raise
    made = {"steps": simulation.made, "time_step": schedule.long_dt, "shortest_time_step": schedule.dt}
    return Outcome(simulation, sections=sections(scene, simulation), attributes=made)


def begin_slipping(scene: Scene) -> None:
    """Slips get their inertia, and the weight that goes with them, which stays as it is here. Collective."""
    state, places = scene.state, scene.state.places
    scene.finder.slips.weigh(own_weight(scene.job))
    stiffness = beside(places, state.slip_share**2 * largest_stiffness(state.EA, state.L0))
    inertia = slip_inertia(beside(places, state.half_mass), stiffness, scene.schedule.long_dt)
    state.slip_mass[places.node, places.column] = inertia


def rest_branches(state) -> None:
    """The branches of all elements as they are where it has long been at rest: they add nothing."""
    N = state.elements_now().N
    for branch, alpha in zip((state.branch_a, state.branch_b, state.branch_c), state.branches[0]):
        branch[:] = alpha * N


def sections(scene: Scene, simulation) -> dict[str, dict[str, np.ndarray]]:
    """History, events, losses and wind, on rank 0."""
    model = scene.model
    locked = (
        scene.distribution.gather_particles(scene.state.slip_locked) if scene.state.features.sliding else None
    )
    if model is None:
        return {}
    history, events = simulation.history, simulation.log.columns()
    found = {"history": history.columns() | history.probe_columns()}
    found["events"] = events | event_ids(model.net, events)
    if model.layout.slides:
        found["slide"] = slide_section(model.net, model.layout.slides) | history.slip_columns()
        time = locked[model.layout.slides.node, model.layout.slides.column]  # when too little was left
        found["slide"]["stopped"] = np.where(time > 0.0, time, np.nan)
    if simulation.removal:
        found["removal"] = simulation.removal.columns()
    if simulation.detaching and (parts := simulation.detaching.columns(simulation.wind)):
        found["detached"] = parts
    if simulation.wind:
        found["wind"] = wind_section(scene.job, model, *simulation.wind.record_until(simulation.time))
    return found


class Simulation(Stepper):
    """One run of the dynamic stage on all ranks.

    Order of events at a step n: the loads move on to the samples around t(n); the history row; the frame;
    what is lost; which parts are detached; then the steps to the next target, in which elements break as they
    reach their fracture strain. Rows on the way to a target are made in the time loop, and taken up by all
    ranks together when there is no room for more, at a look, and before anything that comes after them. In a
    long way to a target all ranks look at the same steps whether one has been asked to stop.
    """

    def __init__(self, scene: Scene, desk: Desk, loads: list, removal: Removal | None):
        """Collective. loads : that vary, as `varying` has them; removal : what is lost"""
        probes = scene.comm.bcast(scene.model and scene.model.layout.probes)
        self.envelope = Envelope(scene.distribution, scene.state.joints is not None)
        self.history = History(probes, scene.state.features)
        s, subdomain = scene.schedule, scene.distribution.subdomain
        slips = scene.finder.slips.numbers() if scene.state.features.sliding else None
        of_steps = s.history, s.dt, WIDEN_STEPS * s.stride
        rows = RowTable(scene.state, *of_steps, subdomain, probes, self.envelope, slips)
        super().__init__(scene, desk, loads, rows)
        self.removal = removal
        self.detaching = Detaching(scene) if scene.state.features.detaches else None
        self.result, self.progress, self.saver = desk.result, desk.progress, desk.saver
        self.wind = next((load for load in loads if isinstance(load, WindLoad)), None)
        self.start_strain = self.start_plastic = 0.0  # J, from which energies count
        self.largest_work = 0.0
        looks = min(LOOK_STEPS, LOOK_WORK // max(1, scene.distribution.m)) // s.stride
        self.look_every = max(1, looks) * s.stride  # steps

    def begin(self, energies: Energies) -> None:
        """At the first step: what is stored and dissipated from there on counts."""
        self.start_strain, self.start_plastic = energies.strain, energies.plastic
        self.history.begin(energies.strain)
        if self.state.highest is not None:
            self.state.begin_extremes(self.state.elements_now().N)
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
        if self.detaching:
            saver.register("detached", self.detaching.record, self.detaching.restore, everywhere=True)
        saver.register("simulation", self.record, self.restore)
        saver.register("history", self.history.record, self.restore_history, everywhere=True)
        envelope = self.envelope
        saver.register("envelope", lambda: envelope.record(self.state), envelope.restore)

    def run(self) -> None:
        """From the present step to the last. Raises Interrupted, with a checkpoint, if that is asked for."""
        frames, saves = (set(steps.tolist()) for steps in (self.schedule.frames, self.schedule.checkpoints))
        losses = {loss.step for loss in self.removal.losses} if self.removal else set()
        targets = frames | saves | losses | {0, self.schedule.steps}
        self.progress.start(self.n / self.schedule.steps, self.n)
        for target in sorted(targets):
            if target < self.n or (target == self.n and len(self.history)):
                continue
            self.advance_to(target)
            with self.phases.phase("dynamics: output"):
                self.at_target(target in frames, target in saves)
        snapshot = self.snapshot()
        if self.removal:
            self.removal.close(self.state, snapshot.N)
        self.envelope.take_in(self.time, self.state)
        self.result.write_envelope(self.state, *self.envelope.columns())
        self.result.write_final(self.state, snapshot)
        self.halo.free()

    def at_target(self, framed: bool, saved: bool) -> None:
        """What is due at the present step: a row, a frame, a checkpoint. Collective."""
        snapshot = self.snapshot()
        if framed or saved:
            now = most_strained(self.state, self.time, snapshot.eps, snapshot.N, self.subdomain.element_gid)
            self.history.most_strained = max(self.history.most_strained, now)
        if not self.make_row() and saved:
            self.check_energies(snapshot)
        self.take_up_rows()
        if framed:
            self.result.write_frame(self.time, self.state, snapshot)
        self.report()
        if self.stopping and self.n < self.schedule.steps:
            self.leave()
        if saved:
            self.save()

    def make_row(self) -> bool:
        """Make the history row of the present step, if one is due that is not made yet; whether it was."""
        if self.rows.full:
            self.take_up_rows()
        if not self.rows.is_due(self.n):
            return False
        self.plan.run(self.interval(self.n)._replace(row=True), self.phases.of_steps)
        return True

    def snapshot(self):
        """Snapshot of the present step, with the loads at its time, in place of the one before."""
        self.loads.advance(self.state, self.n)
        share = (self.time - self.loads.time) / self.loads.dt
        self.plan.collect_yield()
        if self.ground:
            number = self.n // self.stride
            times = number * self.dt, self.before_dt, (number + 1) * self.dt
            move_ground(*times, self.zeta, self.ground, self.state.particles)
        step = self.before_dt, self.dt, self.zeta, share
        return self.rows.snapshot.take(self.state, *step)

    def record(self) -> tuple[dict, dict]:
        """Where the run stands, for `restore`. Collective."""
        small = {name: getattr(self, name) for name in KEPT}
        small |= {"step": self.n, "widened": int(self.rows.last[0])}
        return small | {"most_strained": most_strained_of_all(self.comm, self.history.most_strained)}, {}

    def restore(self, small: dict, _: dict | None) -> None:
        """Take up the record of an earlier run; the loads stand where it left them."""
        for name in KEPT:
            setattr(self, name, small[name])
        self.n, self.rows.last[:] = small["step"], small["widened"]
        self.history.most_strained = tuple(small["most_strained"])
        self.result.losses = self.removal.done if self.removal else 0
        self.loads.renew(self.state)
        self.loads.advance(self.state, self.n)

    def restore_history(self, small: dict, arrays: dict[str, np.ndarray]) -> None:
        """Take up the rows of an earlier run."""
        self.history.restore(small, arrays)
        self.rows.made[:] = len(arrays["time"]), 0

    def advance_to(self, target: int) -> None:
        """Step to number `target`, with the wind moving on where it is due, and rows on the way.

        Raises Interrupted if asked to.
        """
        while self.n < target:
            stop = min(target, self.n - self.n % self.look_every + self.look_every, self.rows.full_at)
            if self.removal:
                if self.n == self.removal.next_step:
                    self.removal.happen(self)
                stop = min(stop, self.removal.next_step)
            self.loads.advance(self.state, self.n)
            stop = min(stop, self.loads.due())
            while self.n < stop:
                self.advance_in_stride(min(stop, self.find_detached()))
            if self.n < target and (self.n % self.look_every == 0 or self.rows.full):
                with self.phases.phase("dynamics: output"):
                    self.take_up_rows()
                    self.report()
                    if self.stopping:
                        self.leave()

    def find_detached(self) -> int:
        """Find the parts that are detached, if that is due now; the step at which it is due next. Collective.

        It never is as long as steps are long ones and nothing has broken or was lost.
        """
        intact = self.stride > 1 and not self.calm and not (self.removal and self.removal.done)
        if self.detaching is None or intact:
            return self.schedule.steps
        if self.detaching.due(self.n) == self.n:
            if self.detaching.has_news(self.state):
                self.make_row()  # of the state before, wherever targets fall
                if self.detaching.evaluate(self.state):
                    self.plan.attach(self.state)
            self.detaching.follow(self.state, self.n)
            self.detaching.evaluated = self.n
        return self.detaching.due(self.n)

    def leave(self) -> None:
        """End here, with a checkpoint, because that is asked for. Raises Interrupted. Collective."""
        self.check_energies(self.snapshot())
        raise interrupted(f"at t = {self.time:.6g} s (step {self.n})", self.save())

    def save(self) -> Path:
        """Write a checkpoint of the present step; its path. Collective."""
        return self.saver.save(NAME, self.n, self.state)

    def check_energies(self, snapshot) -> None:
        """Before the state is kept; stops a run that has diverged. Collective."""
        e = total_energies(self.comm, self.state, snapshot)
        if diverges(e, self.largest_work, self.start_strain):
            extreme = most_extreme(self.state, self.subdomain.element_gid, snapshot)
            raise divergence(self, self.n, e.kinetic, extreme)

    def take_up_rows(self) -> None:
        """The rows so far become those of /history; stops a run that has diverged. Collective."""
        found = self.rows.take_up(self.comm)
        self.share_events()
        if not len(found.number):
            return
        energies = energies_of(self.state, found.sums)
        work = np.fmax.accumulate(np.append(self.largest_work, energies.given))
        wrong = np.flatnonzero(diverges(energies, work[:-1], self.start_strain))
        for k in wrong[:1].tolist():
            extreme = (found.size[k, 0], int(found.who[k, 0]), found.size[k, 1], int(found.who[k, 1]))
            raise divergence(self, int(found.number[k]), float(energies.kinetic[k]), extreme)
        self.largest_work = work[-1]
        self.slack = int(found.slack[-1])
        time = found.number * self.schedule.dt
        for k in np.flatnonzero(found.who[:, 2] >= 0).tolist():
            strained = float(found.size[k, 2]), float(time[k]), int(found.who[k, 2])
            self.history.most_strained = max(self.history.most_strained, strained)
        columns = columns_at(time, found.time_step, energies, (self.start_strain, self.start_plastic))
        broken = np.searchsorted(self.log.breaking, found.number)  # elements broken before each row
        self.history.add(found.probes, columns | {"slack": found.slack, "broken": broken})

    def report(self) -> None:
        """Progress on rank 0."""
        share, done = self.n / self.schedule.steps, f"t = {self.time:.3f} s"
        self.progress.at(share, done, self.n, "steps", f"slack {self.slack}, broken {len(self.log.broken)}")


def diverges(energies: Energies, work, stored: float):
    """Whether there is more motion than work could give.

    work : [J] the largest that was given before; stored : [J] in the elements at the start
    """
    # nan without the audit: then only what is not finite is seen
    known = np.maximum(work, energies.given) + stored
    return ~np.isfinite(energies.kinetic) | (energies.kinetic > 2 * known + 1e-9)


def divergence(simulation, number: int, kinetic: float, extreme: tuple) -> DivergedError:
    """Names the fastest particle and the element with the largest strain, on every rank. Collective.

    number : of the step; kinetic : [J]; extreme : of this rank, as of `energy.most_extreme`
    """
    s = simulation
    every = s.comm.allgather(extreme)
    particle, element = max(every, key=lambda h: h[0])[1], max(every, key=lambda h: h[2])[3]
    node, element = s.comm.bcast(s.model and (s.model.node_name(particle), s.model.id_of(element)))
    return DivergedError(
        f"diverged at t = {number * s.schedule.dt:.6g} s (step {number}): kinetic energy {kinetic:.3g} J is "
        f"out of all proportion to the external work; fastest: {node}, most strained: element {element}; "
        "take a smaller time_step or safety"
    )
