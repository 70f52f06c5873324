"""Dynamic stage: from the initial state through gusts and fractures to the end (paper 2.5, 3, 4)."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError, interruption_error
from netfall.driver import messages
from netfall.driver.dynamics.detaching import DetachedParts
from netfall.driver.dynamics.stepper import Stepper
from netfall.driver.dynamics.varying_loads import VaryingLoad, WindLoad, varying_loads
from netfall.driver.problem import Outcome, Problem, RunContext
from netfall.driver.removal import equilibria as removal_equilibria
from netfall.driver.removal.equilibria import planned_removals
from netfall.driver.removal.members import MemberRemoval
from netfall.explicit import energy
from netfall.explicit.history import (
    History,
    history_columns,
    largest_unlimited_strain_of_ranks,
    most_strained,
    reduce_rows,
)
from netfall.explicit.rows import DynamicEnvelope, RowTable
from netfall.explicit.wind_section import wind_section
from netfall.job.derived import permanent_weight_factor
from netfall.job.job import Job
from netfall.model.schedule import describe_steps
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.slip.law import slip_inertia
from netfall.physics.slip.motion import adjacent_sums
from netfall.physics.supports import move_ground, start_with_ground
from netfall.results.writer import event_ids, slide_section

ENVELOPE_STEPS = 50  # largest number of long steps between updates of the envelope
# largest number of steps between checks of the stop flag: 0.1 s of wall time on the smallest net
CHECK_STEPS = 100_000
# largest number of element steps between these checks: 2 s of wall time on one rank
MAX_CHECK_WORK = 200_000_000

NAME = "dynamics"
RECORDED = ("before_dt", "steps", "stride", "short_until", "largest_work", "start_strain", "start_plastic")


def required(job: Job) -> bool:
    """Return whether the job has a dynamic stage."""
    return job.dynamics is not None


def run(problem: Problem, context: RunContext, outcomes: dict[str, Any]) -> Outcome:
    """Run the dynamic stage; result : the `Simulation`. Collective. outcomes : of earlier stages, by name"""
    removals, state, schedule = planned_removals(problem), problem.state, problem.dynamic_schedule
    removal = start = None
    if problem.job.removes:
        removal = MemberRemoval(problem, removals, outcomes[removal_equilibria.NAME].result, context.log)
    with context.phases.phase("wind"):
        loads = [*varying_loads(problem), *(removal.fades.values() if removal else ())]
    context.progress.say(f"dynamics: {problem.dynamics.duration:g} s in {describe_steps(schedule)}")
    if context.saver.stage != NAME:  # not resumed within this stage
        if state.features.sliding:
            set_slip_inertia(problem)
        snapshot = energy.take_snapshot(state)
        start = energy.total_energies(problem.comm, state, snapshot)
        rounding = energy.rounding_energy(problem.comm, state, snapshot, schedule.steps)
        if state.branches is not None:  # long-term equilibrium, in which the Maxwell branches add no force
            N = state.present_element_state().N
            for branch, alpha in zip((state.branch_a, state.branch_b, state.branch_c), state.branches[0]):
                branch[:] = alpha * N
    simulation = Simulation(problem, context, loads, removal)
    if start:
        simulation.begin(start, rounding)
    simulation.register()
    try:
        with context.phases.phase(NAME):
            simulation.run()
    except DivergedError:  # on every rank
        simulation.halo.free()
        raise
    attributes = {"steps": simulation.steps, "time_step": schedule.long_dt, "shortest_time_step": schedule.dt}
    return Outcome(simulation, sections=sections(problem, simulation), attributes=attributes)


def set_slip_inertia(problem: Problem) -> None:
    """Set the inertia of slips and the weight that goes with them, which stay constant. Collective."""
    state, points, slips = problem.state, problem.state.slip_points, problem.finder.slips
    assert points is not None and slips is not None  # cables slide
    slips.freeze_weights(permanent_weight_factor(problem.job))
    stiffness = adjacent_sums(points, state.slip_share**2 * largest_stiffness(state.EA, state.L0))
    mass, dt = adjacent_sums(points, state.half_mass), problem.dynamic_schedule.long_dt
    inertia = slip_inertia(mass, stiffness, dt)
    state.slip_mass[points.node, points.column] = inertia


def sections(problem: Problem, simulation: "Simulation") -> dict[str, dict[str, np.ndarray]]:
    """Return the datasets of history, events, removals and wind, on rank 0."""
    model = problem.model
    locked_at = None
    if problem.state.features.sliding:
        locked_at = problem.distribution.gather_particles(problem.state.slip_locked)
    if model is None:
        return {}
    history, events = simulation.history, simulation.log.columns()
    datasets = {"history": history.columns() | history.probe_columns()}
    datasets["events"] = events | event_ids(model.net, events)
    if model.layout.slides and locked_at is not None:
        datasets["slide"] = slide_section(model.net, model.layout.slides) | history.slip_columns()
        # [s] at which a slip point stopped because the remaining segment was too short
        time = locked_at[model.layout.slides.node, model.layout.slides.column]
        datasets["slide"]["stopped"] = np.where(time > 0.0, time, np.nan)
    if simulation.removal:
        datasets["removal"] = simulation.removal.columns()
    if simulation.detaching and (parts := simulation.detaching.columns(simulation.wind)):
        datasets["detached"] = parts
    if simulation.wind:
        datasets["wind"] = wind_section(problem.job, model, *simulation.wind.record_until(simulation.time))
    return datasets


class Simulation(Stepper):
    """Run of the dynamic stage on all ranks.

    Order of events at a step n:

    - the loads advance to the samples around t(n),
    - the history row,
    - the snapshot,
    - member removals,
    - detached parts,
    - the steps to the next target, in which elements break as they reach their fracture strain.

    The time loop makes history rows between targets. All ranks collect them together when the buffer is full,
    at a check of the stop flag, and before any later output. If a target is far, all ranks check the stop
    flag at the same steps before it.
    """

    def __init__(
        self, problem: Problem, context: RunContext, loads: list[VaryingLoad], removal: MemberRemoval | None
    ):
        """Collective. loads : varying ones, see `varying_loads`; removal : of members or None"""
        probes = problem.comm.bcast(problem.model and problem.model.layout.probes)
        self.envelope = DynamicEnvelope(problem.distribution, problem.state)
        self.history = History(probes, problem.state.features, problem.comm.rank == 0)
        schedule = problem.dynamic_schedule
        finder_slips, is_sliding = problem.finder.slips, problem.state.features.sliding
        slips = finder_slips.numbers() if finder_slips is not None and is_sliding else None
        update_every, due = ENVELOPE_STEPS * schedule.stride, schedule.history
        rows = RowTable(problem.state, due, schedule.dt, update_every, probes, self.envelope, slips)
        super().__init__(problem, context, loads, rows)
        self.removal = removal
        self.detaching = DetachedParts(problem) if problem.state.features.detaches else None
        self.result, self.progress, self.saver = context.result, context.progress, context.saver
        self.wind = next((load for load in loads if isinstance(load, WindLoad)), None)
        self.start_strain = self.start_plastic = 0.0  # J, reference of energies
        self.largest_work = 0.0
        check_steps = min(CHECK_STEPS, MAX_CHECK_WORK // max(1, problem.distribution.m)) // schedule.stride
        self.check_every = max(1, check_steps) * schedule.stride  # steps

    def begin(self, energies: energy.Energies, rounding: float) -> None:
        """Set the energies at the first step, the reference of later ones; rounding : as in `History`"""
        self.start_strain, self.start_plastic = energies.strain, energies.plastic
        self.history.begin(energies.strain, rounding)
        if self.state.highest is not None:
            self.state.reset_extremes(self.state.present_element_state().N)
        if self.ground:
            start_with_ground(self.state, self.ground)

    def register(self) -> None:
        """Register all changing data for checkpoints and restore them in a resumed run. Collective."""
        saver = self.saver
        if self.removal:
            restore = partial(self.removal.restore, self.redistribute)
            saver.register("removal", self.removal.record, restore)
        if self.detaching:
            saver.register("detached", self.detaching.record, self.detaching.restore, everywhere=True)
        saver.register("simulation", self.record, self.restore)
        saver.register("history", self.history.record, self.restore_history, everywhere=True)
        envelope = self.envelope
        saver.register("envelope", lambda: envelope.record(self.state), envelope.restore)

    def run(self) -> None:
        """Step from the present step to the last. Raises Interrupted, with a checkpoint, at a stop signal."""
        frames, saves = (set(steps.tolist()) for steps in (self.schedule.frames, self.schedule.checkpoints))
        frames = frames if self.result.is_stored else set()
        removals = {removed.step for removed in self.removal.removals} if self.removal else set()
        targets = frames | saves | removals | {0, self.schedule.steps}
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
        self.envelope.include_extremes(self.time, self.state)
        self.result.write_envelope(self.state, *self.envelope.columns())
        self.result.write_final(self.state, snapshot)
        self.halo.free()

    def at_target(self, has_frame: bool, has_checkpoint: bool) -> None:
        """Write the row, snapshot and checkpoint that are due at the present step. Collective."""
        self.loads.advance(self.state, self.n)
        row_made = self.make_row()
        snapshot = self.snapshot()
        if has_frame or has_checkpoint:
            strain_record = most_strained(
                self.state, self.time, snapshot.eps, snapshot.N, self.subdomain.element_gid
            )
            self.history.most_strained = max(self.history.most_strained, strain_record)
        if not row_made and has_checkpoint:
            self.check_energies(snapshot)
        self.collect_rows()
        if has_frame:
            self.result.write_frame(self.time, self.state, snapshot)
        self.report()
        if self.stopping and self.n < self.schedule.steps:
            self.stop_with_checkpoint()
        if has_checkpoint:
            self.save()

    def make_row(self) -> bool:
        """Make the history row of the present step if it is due and missing; return whether it was."""
        if self.rows.full:
            self.collect_rows()
        if not self.rows.is_due(self.n):
            return False
        self.update_envelope()
        return True

    def snapshot(self) -> energy.Snapshot:
        """Take a snapshot of the present step, with the loads at its time. It replaces the last snapshot."""
        self.loads.advance(self.state, self.n)
        share = (self.time - self.loads.time) / self.loads.dt
        self.plan.read()
        if self.ground:
            number = self.n // self.stride
            now, after = number * self.dt, (number + 1) * self.dt
            move_ground(now, self.before_dt, after, self.zeta, self.ground, self.state.particles)
        return self.rows.snapshot.take(self.state, self.before_dt, self.dt, self.zeta, share)

    def record(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the record that `restore` needs. Collective."""
        small = {name: getattr(self, name) for name in RECORDED}
        small |= {"step": self.n, "envelope_step": int(self.rows.last[0])}
        small["most_strained"] = largest_unlimited_strain_of_ranks(self.comm, self.history.most_strained)
        return small, {}

    def restore(self, small: dict[str, Any], _: dict[str, Any] | None) -> None:
        """Restore the record of an earlier run; the loads advance from their first samples."""
        for name in RECORDED:
            setattr(self, name, small[name])
        self.n, self.rows.last[:] = small["step"], small["envelope_step"]
        self.history.most_strained = tuple(small["most_strained"])
        self.result.removals = self.removal.done if self.removal else 0
        self.loads.update_samples(self.state)
        self.loads.advance(self.state, self.n)

    def restore_history(self, small: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore the history rows of an earlier run."""
        self.history.restore(small, arrays)
        self.rows.made[:] = len(arrays["time"]), 0

    def advance_to(self, target: int) -> None:
        """Step to `target`, with updates of wind and history rows. Raises Interrupted at a stop signal."""
        while self.n < target:
            next_check = self.n - self.n % self.check_every + self.check_every
            stop = min(target, next_check, self.rows.first_full_step)
            if self.removal:
                if self.n == self.removal.next_step:
                    self.remove_members(self.removal)
                stop = min(stop, self.removal.next_step)
            self.loads.advance(self.state, self.n)
            stop = min(stop, self.loads.next_sample_step())
            while self.n < stop:
                self.advance_in_stride(min(stop, self.find_detached()))
            if self.n < target and (self.n % self.check_every == 0 or self.rows.full):
                with self.phases.phase("dynamics: output"):
                    self.collect_rows()
                    self.report()
                    if self.stopping:
                        self.stop_with_checkpoint()

    def remove_members(self, removal: MemberRemoval) -> None:
        """Carry out the member removal that is due at the present step. Collective."""
        self.update_envelope()  # before the extremes of the axial forces restart
        self.plan.collect()
        self.share_events()
        elements = self.state.present_element_state()
        self.state.include_extremes(elements.N)
        self.envelope.include_extremes(self.time, self.state)
        redistribution = removal.remove_from(self.state, elements, self.time, self.before_dt, self.dt)
        self.plan.attach(self.state)
        self.redistribute(redistribution)
        self.loads.update_samples(self.state)
        self.state.reset_extremes(elements.N)
        self.result.removals = removal.done

    def find_detached(self) -> int:
        """Find the detached parts if the evaluation is due; return the step of the next one. Collective.

        No evaluation is due while steps are long and nothing has broken or was removed.
        """
        is_intact = self.stride > 1 and not self.short_until and not (self.removal and self.removal.done)
        if self.detaching is None or is_intact:
            return self.schedule.steps
        if self.detaching.next_evaluation_step(self.n) == self.n:
            removed = self.removal.done if self.removal else 0
            logged = self.comm.allreduce(self.plan.event_count)
            has_changed = self.detaching.has_changed(len(self.log) + logged + removed)
            if has_changed or self.detaching.follows_any:
                self.plan.read(*self.detaching.arrays_read(self.state))
            if has_changed and self.detaching.find_parts(self.state):
                self.plan.collect()
                self.make_row()  # row of the earlier state, independent of targets
                if self.detaching.update_state(self.state):
                    self.plan.attach(self.state)
            self.detaching.record_parts(self.state, self.n)
        return self.detaching.next_evaluation_step(self.n)

    def stop_with_checkpoint(self) -> None:
        """Save a checkpoint and raise Interrupted. Collective."""
        self.check_energies(self.snapshot())
        raise interruption_error(f"at t = {self.time:.6g} s (step {self.n})", self.save())

    def save(self) -> Path:
        """Write a checkpoint of the present step; return its path. Collective."""
        return self.saver.save(NAME, self.n, self.state)

    def check_energies(self, snapshot: energy.Snapshot) -> None:
        """Raise DivergedError if the run has diverged, before the state is saved. Collective."""
        energies = energy.total_energies(self.comm, self.state, snapshot)
        if diverges(energies, self.largest_work, self.start_strain):
            extreme = energy.local_extremes(self.state, self.subdomain.element_gid, snapshot)
            raise self.divergence_error(self.n, energies.kinetic, extreme)

    def divergence_error(self, number: int, kinetic: float, extreme: tuple[Any, ...]) -> DivergedError:
        """Return the error that names the fastest particle and the element with the largest strain.

        Collective. number : of the step; kinetic : [J]; extreme : of this rank, as of `local_extremes`
        """
        model, extremes = self.model, self.comm.allgather(extreme)
        particle = max(extremes, key=lambda entry: entry[0])[1]
        element = max(extremes, key=lambda entry: entry[2])[3]
        node, element = self.comm.bcast(model and (model.node_name(particle), model.element_id_of(element)))
        return DivergedError(
            messages.DIVERGED(
                time=number * self.schedule.dt, step=number, kinetic=kinetic, node=node, element=element
            )
        )

    def collect_rows(self) -> None:
        """Move the buffered rows to /history. Raise DivergedError if the run has diverged. Collective."""
        buffered = reduce_rows(self.comm, self.plan.take_rows())
        self.share_events()
        if not len(buffered.number):
            return
        energies = energy.energies_from_sums(self.state, buffered.sums)
        work = np.fmax.accumulate(np.append(self.largest_work, energies.given))
        diverged = np.flatnonzero(diverges(energies, work[:-1], self.start_strain))
        for k in diverged[:1].tolist():
            (speed, strain, *_), (particle, element, *_) = buffered.size[k], buffered.who[k]
            extreme = speed, int(particle), strain, int(element)
            kinetic = float(np.atleast_1d(energies.kinetic)[k])
            raise self.divergence_error(int(buffered.number[k]), kinetic, extreme)
        self.largest_work = work[-1]
        self.slack = int(buffered.slack[-1])
        time = buffered.number * self.schedule.dt
        for k in np.flatnonzero(buffered.who[:, 2] >= 0).tolist():
            strain_record = float(buffered.size[k, 2]), float(time[k]), int(buffered.who[k, 2])
            self.history.most_strained = max(self.history.most_strained, strain_record)
        broken = np.searchsorted(self.log.breaking, buffered.number)  # elements broken before each row
        start = self.start_strain, self.start_plastic
        self.history.add(buffered.probes, history_columns(buffered, time, energies, broken, start))

    def report(self) -> None:
        """Report the progress on rank 0."""
        if self.model is None or not self.progress.shown:
            return
        share, position = self.n / self.schedule.steps, f"t = {self.time:.3f} s"
        broken = len(np.unique(self.model.net.element_id[self.log.broken]))
        self.progress.at(share, position, self.n, "steps", f"slack {self.slack}, broken {broken}")


def diverges(energies: energy.Energies, work: float | np.ndarray, stored: float) -> np.ndarray:
    """Return whether the kinetic energy exceeds what the work can supply.

    work : [J] the largest earlier external work; stored : [J] in the elements at the start
    """
    # nan without the energy check: then only an infinite or nan value shows divergence
    supply = np.maximum(work, energies.given) + stored
    return ~np.isfinite(energies.kinetic) | (energies.kinetic > 2 * supply + 1e-9)
