"""The dynamic stage: from the initial state through gusts and fractures to the end (paper 2.5 step 3, 3, 4)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from netfall.errors import DivergedError
from netfall.mechanics.state import State
from netfall.net.net import Net
from netfall.output.progress import Progress
from netfall.output.result import Result
from netfall.parallel.halo import Halo
from netfall.solve.energy import Energies, take_snapshot, total_energies
from netfall.solve.fracture import split_particles, take_out
from netfall.solve.restart import interrupted
from netfall.solve.stepping import Plan, halo_width, run_steps
from netfall.solve.stop import StopRequest
from netfall.solve.windload import WindLoad

ROUNDING = 1e-9  # of a step: a time this close to one counts as on it
QUOTIENT = 4.0 * np.finfo(float).eps  # of a time divided by the step: its rounding, which counts in long runs
LOOK_STEPS = 100_000  # at most, between looks at the wish to stop: a tenth of a second on the smallest net
LOOK_WORK = 200_000_000  # steps of an element, at most, between them: two seconds on one rank


def step_at(times, dt: float):
    """Numbers of the first steps of length dt [s] at or after the times [s], as whole floats."""
    steps = times / dt
    return np.ceil(steps - np.maximum(ROUNDING, QUOTIENT * steps))


@dataclass(frozen=True)
class Schedule:
    """Steps of one length dt [s], and the step numbers at which something is due."""

    dt: float
    steps: int
    history: np.ndarray
    frames: np.ndarray
    checkpoints: np.ndarray
    stable_dt: float  # s, for which fragments are stable: longer than the step by the margin of safety

    def step_at(self, time: float) -> int:
        """First step at or after a time [s]."""
        return int(step_at(time, self.dt))


def make_schedule(limit: float, dynamics, output) -> Schedule:
    """Steps for the job: its own length, or for "auto" the largest within `limit` [s] that fits the history rows."""
    if dynamics.time_step == "auto":
        every = min(output.history, dynamics.duration)
        dt = every / max(1.0, np.ceil(every / (dynamics.safety * limit) - ROUNDING))
    else:
        dt = dynamics.time_step
    steps = max(1, int(step_at(dynamics.duration, dt)))
    rows = np.arange(int(np.floor(steps * dt / output.history + ROUNDING)) + 1) * output.history
    frames = np.linspace(0.0, steps * dt, output.frames + 1)
    at = lambda times: np.unique(np.append(np.minimum(step_at(times, dt), steps), steps)).astype(np.int64)
    every = output.checkpoint
    saves = np.arange(1, int(np.floor(steps * dt / every)) + 1) * every if every > 0 else np.zeros(0)
    saves = step_at(saves, dt).astype(np.int64)
    return Schedule(
        float(dt), steps, at(rows), at(frames), saves[saves < steps], float(min(dt / dynamics.safety, limit))
    )


@dataclass
class Probes:
    """Particles and elements whose histories are kept, in global numbers."""

    particles: np.ndarray
    elements: np.ndarray


def find_probes(net: Net, places) -> Probes:
    """The particles nearest in plan to the places (p, 2) [m], and the elements that meet there."""
    particles = [int(np.argmin(np.sum((net.x[:, :2] - np.array(place)) ** 2, axis=1))) for place in places]
    return Probes(np.array(particles, np.int64), np.flatnonzero(np.isin(net.elements, particles).any(1)))


def probe_remarks(net: Net, x: np.ndarray, places) -> list[str]:
    """Notes on probes that lie farther from any node in plan than the longest element is; x (n, 3) [m] initial state."""
    longest = np.sqrt(np.sum((x[net.elements[:, 1]] - x[net.elements[:, 0]]) ** 2, axis=1)).max(initial=0.0)
    remarks = []
    for place, p in zip(places, find_probes(net, places).particles):
        away = float(np.hypot(*(net.x[p, :2] - np.array(place))))
        if away > longest:
            remarks.append(
                f"note: [output] probes: [{place[0]:g}, {place[1]:g}] is {away:.4g} m away from every node, the longest element "
                f"{longest:.4g} m long; its histories are those of node {net.node_id[p]}, at [{net.x[p, 0]:.6g}, {net.x[p, 1]:.6g}]"
            )
    return remarks


class Simulation:
    """One run of the dynamic stage on all ranks.

    Order of events at a step n: the wind moves on to the samples around t(n); the history row; the frame; then
    the steps to the next target, in which elements part as they reach their fracture strain. In a long way to
    a target all ranks look at the same steps whether one of them has been asked to stop.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        state: State,
        result: Result,
        schedule: Schedule,
        job,
        wind: WindLoad | None,
        probes: Probes,
        start_strain: float,
        start_plastic: float,
        progress: Progress,
        stop: StopRequest,
        save: Callable,
        phases,
    ):
        """save(simulation) : writes a checkpoint and returns its path. Collective. phases : `roof.Phases`"""
        self.comm, self.state, self.result, self.schedule = comm, state, result, schedule
        self.zeta = job.dynamics.damping
        self.self_weight = bool(job.load and job.load.self_weight)
        self.carried_weight = bool(job.load and job.load.dead)
        self.after_fracture = job.wind.after_fracture if job.wind else "none"
        self.wind = wind
        self.progress = progress
        self.halo = Halo(comm, result.distribution.piece, halo_width(state))
        self.plan = Plan(state, self.halo)
        self.n = 0  # step number: x(n), v(n-1/2)
        self.before_dt = 0.0
        self.events: list = []  # of this rank, not yet shared
        self.start_strain, self.start_plastic = start_strain, start_plastic  # J; energies count from here
        self.largest_work = 0.0
        self.slack = 0
        self.stop, self.save, self.phases = stop, save, phases
        self.stopping = False
        self.look_every = max(1, min(LOOK_STEPS, LOOK_WORK // max(1, result.distribution.m)))  # steps
        self._find_probes(probes)
        with phases.phase("time loop"):  # compiled, or loaded
            run_steps(self.halo, self.plan, 0, 0, 0.0, schedule.dt, self.zeta, 0.0, 1.0, phases.of_steps)

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
            if step > self.n or self.n == 0 and not self.result.history
        ):
            self.advance_to(target)
            with self.phases.phase("dynamics: output"):
                snapshot = self.look()
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
                    self.save(self)
        self.result.write_final(self.state, self.look())
        self.halo.free()

    def look(self):
        """Snapshot of the present step, with the wind at its time."""
        if self.wind:
            self.wind.advance(self.state, self.n, self.schedule.step_at)
        return take_snapshot(self.state, self.before_dt, self.schedule.dt, self.zeta, self.wind_share())

    def record(self) -> dict:
        """Where the run stands, for `restore`."""
        return {
            "step": self.n,
            "before_dt": self.before_dt,
            "largest_work": self.largest_work,
            "start_strain": self.start_strain,
            "start_plastic": self.start_plastic,
        }

    def restore(self, record: dict) -> None:
        """Take up the record of an earlier run."""
        self.n, self.before_dt, self.largest_work = (
            record["step"],
            record["before_dt"],
            record["largest_work"],
        )

    def wind_share(self) -> float:
        """Place of the present time between the wind's two samples."""
        return (self.time - self.wind.time) / self.wind.dt if self.wind else 0.0

    def advance_to(self, target: int) -> None:
        """Step to number `target`, with the wind moving on where it is due. Raises Interrupted if asked to."""
        while self.n < target:
            stop = min(target, self.n - self.n % self.look_every + self.look_every)
            if self.wind:
                self.wind.advance(self.state, self.n, self.schedule.step_at)
                stop = min(stop, self.wind.due(self.schedule.step_at))
            if self.after_fracture == "all" and not self.result.events:
                self.advance_until_first_fracture(stop)
            else:
                self.advance_block(stop)
            if self.n < target and self.n % self.look_every == 0:
                self.report()
                if self.comm.allreduce(self.stop.wanted, MPI.LOR):
                    self.share_events()
                    self.leave()

    def leave(self) -> None:
        """End here, with a checkpoint, because that is asked for. Raises Interrupted. Collective."""
        self.check_energies(self.look())
        raise interrupted(f"at t = {self.time:.6g} s (step {self.n})", self.save(self))

    def advance_block(self, stop: int) -> None:
        """Step to number `stop` without a word to ranks that are not neighbours."""
        wind_time, wind_dt = (self.wind.time, self.wind.dt) if self.wind else (0.0, 1.0)
        dt = self.schedule.dt
        while self.n < stop:
            done, count, error = run_steps(
                self.halo,
                self.plan,
                self.n,
                stop - self.n,
                self.before_dt,
                dt,
                self.zeta,
                wind_time,
                wind_dt,
                self.phases.of_steps,
            )
            if error:
                raise MPI.Exception(error)
            self.n += done
            self.before_dt = dt
            if count:
                self.state.place()
                piece = self.result.distribution.piece
                wind_stays = self.after_fracture != "particle"
                if self.state.scene.fragments:
                    parted = split_particles(
                        self.state,
                        count,
                        self.n - 1,
                        self.result.distribution.n,
                        piece.element_gid,
                        self.self_weight,
                        self.carried_weight,
                        wind_stays,
                        dt,
                        self.schedule.stable_dt,
                    )
                    self.plan.attach(self.state)
                else:
                    parted = take_out(self.state, count, self.n - 1, piece.element_gid, wind_stays, dt)
                self.events += [((self.n - 1) * dt, event) for event in parted]
        self.state.end_block()

    def advance_until_first_fracture(self, stop: int) -> None:
        """For after_fracture = "all": the whole wind ends with the first fracture, at the same step on all ranks.

        A rank learns of a fracture elsewhere only at the end of a block. The block that holds the first one is
        therefore taken back and stepped again to just behind it; no step waits for a reduction.
        """
        begin, kept = (self.n, self.before_dt, len(self.events)), self.state.copy()
        self.advance_block(stop)
        mine = min((event.step for _, event in self.events), default=stop)
        first = self.comm.allreduce(mine, MPI.MIN)
        if first < stop:
            self.n, self.before_dt, count = begin
            self.events, self.state = self.events[:count], kept
            self.plan.attach(kept)
            self.advance_block(first + 1)
            self.state.wind[:] = 0.0
            self.share_events()

    def share_events(self, slack_here: int = 0) -> None:
        """Broadcast the fractures since the last time, so that every rank knows all of them; count slack cables; hear of a wish to stop."""
        counts = np.array([len(self.events), slack_here, self.stop.wanted], np.int64)
        self.comm.Allreduce(MPI.IN_PLACE, counts, MPI.SUM)
        events, self.slack, stopping = counts.tolist()
        self.stopping = stopping > 0
        if events:
            self.result.add_events([event for part in self.comm.allgather(self.events) for event in part])
            self.events = []

    def check_energies(self, snapshot) -> Energies:
        """The energies, before they are reported or the state is kept; stops a run that has diverged."""
        e = total_energies(self.comm, self.state, snapshot)
        known = (
            np.maximum(self.largest_work, abs(e.external)) + self.start_strain
        )  # nan without the audit: then only what is not finite is seen
        if not np.isfinite(e.kinetic) or e.kinetic > 2 * known + 1e-9:
            self.stop_diverged(snapshot, e.kinetic)
        return e

    def write_history(self, snapshot, e: Energies) -> None:
        """One row of /history, and the probes'."""
        strain, plastic = e.strain - self.start_strain, e.plastic - self.start_plastic
        self.largest_work = np.fmax(self.largest_work, abs(e.external))
        scale = self.largest_work or 1.0
        identity = e.kinetic + e.internal + e.damping - e.external
        balance = e.kinetic + strain + plastic + e.damping - e.external
        self.result.history.append(
            [
                self.time,
                self.schedule.dt,
                e.kinetic,
                strain,
                plastic,
                e.damping,
                e.external,
                identity / scale,
                balance / scale,
                self.slack,
                len(self.result.broken),
            ]
        )
        self.result.probes.append(self._probe_values(snapshot))

    def stop_diverged(self, snapshot, kinetic: float) -> None:
        """Name the fastest particle and the element with the largest strain, and stop on every rank."""
        speed = np.nan_to_num(np.abs(snapshot.velocity).max(1, initial=0.0), nan=np.inf)
        speed[
            ~self.state.free[snapshot.rows].any(1)
        ] = -1.0  # a support takes over what is no number from its neighbours
        strain = np.nan_to_num(np.abs(snapshot.eps), nan=np.inf)
        piece = self.result.distribution.piece
        here = (
            speed.max(initial=-1.0),
            int(self.state.gid[snapshot.rows[speed.argmax()]]) if len(speed) else -1,
            strain.max(initial=-1.0),
            int(piece.element_gid[strain.argmax()]) if len(strain) else -1,
        )
        every = self.comm.allgather(here)
        particle, element = max(every, key=lambda h: h[0])[1], max(every, key=lambda h: h[2])[3]
        raise DivergedError(
            f"diverged at t = {self.time:.6g} s (step {self.n}): kinetic energy {kinetic:.3g} J is out of all proportion to the "
            f"external work; fastest particle {particle}, most strained element {element}; take a smaller time_step or safety"
        )

    def _find_probes(self, probes: Probes) -> None:
        piece = self.result.distribution.piece
        self.probes = probes
        self._probe_rows = [
            (k, int(row))
            for k, gid in enumerate(probes.particles)
            for row in np.flatnonzero(piece.particle_gid[: piece.n_owned] == gid)
        ]
        self._probe_elements = [
            (k, int(row))
            for k, gid in enumerate(probes.elements)
            for row in np.flatnonzero(piece.element_gid == gid)
        ]

    def _probe_values(self, snapshot) -> np.ndarray:
        """Displacements (p, 3) and tensions (k,) of the probes in one row, the same on every rank."""
        values = np.zeros(3 * len(self.probes.particles) + len(self.probes.elements))
        for k, row in self._probe_rows:
            values[3 * k : 3 * k + 3] = self.state.x[row] - self.state.x_start[row]
        for k, row in self._probe_elements:
            if self.state.owned[row]:
                values[3 * len(self.probes.particles) + k] = snapshot.N[row]
        values += 0.0  # no negative zeros
        self.comm.Allreduce(MPI.IN_PLACE, values, MPI.SUM)  # one term each but for zeros, so exact
        return values

    def wind_record(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Times (t,) [s] and gusts (t, c) [m/s] of the samples over the simulated time, for the result file."""
        if not self.wind:
            return None
        last = next(
            (k for k, (time, _) in enumerate(self.wind.samples) if time >= self.time),
            len(self.wind.samples) - 1,
        )
        used = self.wind.samples[: last + 1]
        return np.array([time for time, _ in used]), np.array([gust for _, gust in used])

    def report(self) -> None:
        """Progress on rank 0."""
        s = self.schedule
        share = self.n / s.steps
        self.progress.at(
            share,
            f"t = {self.time:.3f} s",
            self.n,
            "steps",
            f"slack {self.slack}, broken {len(self.result.broken)}",
        )
