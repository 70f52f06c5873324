"""Loss of members in the dynamic stage, [[remove]]: when it happens, and what becomes of the tensions.

At its step the elements leave the net (`mechanics.loss`). Their tensions stay as forces on their ends that
fade (`loads.FadingLoad`), and from then on the extremes of every element's tension are kept in each step.
What hung inside a lost cable goes to its ends (`handover`), in the motion and in the rest after it.
"""

import sys
from typing import NamedTuple

import h5py
import numpy as np
from mpi4py import MPI

from netfall.errors import DivergedError
from netfall.mechanics.loss import Carried, join, leave, lose_elements
from netfall.output.loss_lines import SOMETHING_BREAKS, elements_of
from netfall.parallel.subdomain import rows_of
from netfall.solve.committed import committed, put_back
from netfall.solve.equilibrium import STABLE
from netfall.solve.handover import HandOver
from netfall.solve.loads import FadingLoad
from netfall.solve.losses import Loss, comes_loose, leaving_then, losses_of
from netfall.solve.relaxation import Paused
from netfall.solve.restart import interrupted
from netfall.solve.static_report import error_words
from netfall.solve.statics import (
    Equilibrium,
    StaticPath,
    reference_force,
    settle,
)

PREFIX = "removal_"  # of its arrays in a checkpoint
# (losses, m) [N] on rank 0, nan where not known; rest: before the loss; lowest is not known of what broke.
TENSIONS = ("before", "highest", "lowest", "rest", "after")
MOST_ITERATIONS = 100_000  # in which the damaged net comes to rest, or is taken to have none
MOST_NAMED = 4  # elements or cables in one line
NO_CHANGE = 1e-3  # of the largest tension: what changes less has no dynamic factor


class Rest(NamedTuple):
    """What came of the rest after a loss.

    state : a key of `loss_lines.RESTS`; elements : global numbers, that break there
    """

    state: str
    elements: tuple[int, ...] = ()


def losses_now(run) -> list[Loss]:
    """What is lost in the dynamic stage of a run, on every rank. Collective."""
    if not (run.job.removes and run.job.dynamics):
        return []
    model = run.setup.model
    return run.comm.bcast(losses_of(run.job, model, run.schedule) if model else None)


class Removal:
    """The losses of a run, and the tensions around them; these on rank 0."""

    def __init__(self, run, losses: list[Loss], after: tuple[list[Rest], np.ndarray | None] | None):
        """after : of `rests_after`, None: of a run that is taken up"""
        self.distribution, self.losses, self.job = run.setup.distribution, losses, run.job
        self.model, self.step_at = run.setup.model, run.schedule.step_at
        self.dt, self.done = run.schedule.dt, 0
        self.rests = after[0] if after else []
        gid, self.log = self.distribution.subdomain.particle_gid, run.log
        self.area = self.model and self.model.area.copy()  # m2, (n,) on rank 0, of who has it by now
        there = {k for loss in losses for k in loss.entry.tolist()}
        self.fades = {
            k: FadingLoad(gid, run.job.removes[k].duration)
            for k in sorted(there)
            if run.job.removes[k].duration
        }
        self.tensions = None
        if self.model:
            shape = (len(losses), self.model.net.m)
            self.tensions = {name: np.full(shape, np.nan) for name in TENSIONS}
            if after is not None:
                self.tensions["rest"][:], self.tensions["after"][:] = after[1][:-1], after[1][1:]

    @property
    def next_step(self) -> int:
        """Step of the next loss; beyond every step after the last."""
        return self.losses[self.done].step if self.done < len(self.losses) else sys.maxsize

    def happen(self, simulation) -> None:
        """The loss that is due at the present step. Collective."""
        state, loss = simulation.state, self.losses[self.done]
        now = state.elements_now()
        self.close(state, now.N)
        self._keep("before", self.done, state, now.N)
        subdomain = self.distribution.subdomain
        rows = local_rows(subdomain.element_gid, loss.elements)
        force = self._forces(state, loss, rows, now)
        simulation.share_events()
        particles, handed = self._leaving(self.done)
        lose_elements(state, rows, self.dt)
        self._join(state, handed)
        leave(state, np.flatnonzero(np.isin(subdomain.particle_gid, particles)))
        simulation.plan.attach(state)
        self._begin_fades(loss, {k: force[loss.entry == k] for k in self.fades})
        self._hand_over(simulation, handed)
        simulation.loads.renew(state)
        state.highest[:] = state.lowest[:] = now.N
        self.done += 1
        simulation.result.losses = self.done

    def _forces(self, state, loss: Loss, rows: np.ndarray, now) -> np.ndarray:
        """Forces (k, 3) [N] of the elements that are lost on their starts, the same on every rank.

        Of what had broken before none. Collective.
        """
        force = np.zeros((len(loss.elements), 3))
        for e in rows[state.owned[rows].astype(bool) & (state.broken[rows] == 0)].tolist():
            a, b = state.ends[e]
            k = np.searchsorted(loss.elements, self.distribution.subdomain.element_gid[e])
            force[k] = now.N[e] / now.L[e] * (state.x[b] - state.x[a])
        self.distribution.comm.Allreduce(MPI.IN_PLACE, force, MPI.SUM)  # others add zeros
        return force

    def _leaving(self, k: int) -> tuple[np.ndarray, HandOver]:
        """The particles that leave at loss k, and what they hand over, as the log has it. Collective."""
        loss = self.losses[k]
        torn = {event.element for event in self.log.events if event.step < loss.step}
        torn &= set(loss.elements.tolist())
        if not torn:
            return loss.particles, loss.handed
        then = leaving_then(self.model, self.losses, k, torn) if self.model else None
        return self.distribution.comm.bcast(then)

    def _join(self, state, handed: HandOver) -> None:
        """What particles inside lost cables carry goes to others. Collective."""
        of = lambda rows: None if rows is None else handed.given(self.distribution, rows)
        given = Carried(of(state.mass), of(state.v), of(state.load), of(state.wind))
        row = rows_of(self.distribution.subdomain.particle_gid, handed.taker)
        here = row >= 0
        join(state, row[here], handed.source[here], handed.share[here], given)

    def _begin_fades(self, loss: Loss, force: dict[int, np.ndarray]) -> None:
        """The tensions that fade from a loss on; force : (k, 3) [N] of the elements of each entry."""
        for entry in sorted(set(loss.entry.tolist()) & set(self.fades)):
            mine = loss.entry == entry
            self.fades[entry].begin(loss.step * self.dt, loss.ends[mine], force[entry])

    def _hand_over(self, simulation, handed: HandOver) -> None:
        """All that particles have to hand over and that is not in the state. Collective."""
        simulation.loads.hand_over(handed, self.distribution)
        if simulation.tearing:
            simulation.tearing.hand_over(handed)
        if self.model:
            handed.move(self.area, np.arange(self.model.net.n))

    def close(self, state, N: np.ndarray) -> None:
        """End the time in which extremes belong to the last loss. N : (m,) [N], at its end. Collective."""
        if self.done:
            self._keep("highest", self.done - 1, state, np.maximum(state.highest, N))
            lowest = np.where(state.broken != 0, np.nan, np.minimum(state.lowest, N))
            self._keep("lowest", self.done - 1, state, lowest)

    def _keep(self, name: str, k: int, state, rows: np.ndarray) -> None:
        whole = self.distribution.gather_elements(rows, state.owned.astype(bool))
        if whole is not None:
            self.tensions[name][k] = whole

    # --- records

    def record(self) -> dict:
        """How far it has come, for `restore`."""
        return {"done": self.done, "rests": self.rests}

    def arrays(self) -> dict[str, np.ndarray]:
        """What a continuation needs, on rank 0."""
        if self.tensions is None:
            return {}
        forces = {str(k): fade.all_forces for k, fade in self.fades.items() if fade.zero < np.inf}
        return {f"{PREFIX}{name}": values for name, values in (self.tensions | forces).items()}

    def restore(self, record: dict, checkpoint, simulation) -> None:
        """Take up the record of an earlier run. checkpoint : on rank 0. Collective."""
        self.done = record["done"]
        self.rests = [Rest(state, tuple(elements)) for state, elements in record["rests"]]
        if checkpoint:
            self.tensions = {name: checkpoint.arrays[PREFIX + name] for name in TENSIONS}
        for k, loss in enumerate(self.losses[: self.done]):
            entries = sorted(set(loss.entry.tolist()) & set(self.fades))
            force = {e: checkpoint.arrays[f"{PREFIX}{e}"] for e in entries} if checkpoint else None
            self._begin_fades(loss, self.distribution.comm.bcast(force))
            self._hand_over(simulation, self._leaving(k)[1])

    # --- the result

    def columns(self) -> dict[str, np.ndarray]:
        """The datasets of /removal, a row for each entry of the job. Rank 0."""
        m, entries = self.model.net.m, self.job.removes
        names = ("tension_before", "tension_highest", "tension_lowest", "tension_peak", "tension_after")
        names = (*names, "dynamic_factor")
        found = {"time": np.array([entry.time for entry in entries])}
        found |= {name: np.full((len(entries), m), np.nan) for name in names}
        found["state"] = np.full(len(entries), "", h5py.string_dtype())
        gone, breaks = np.zeros(m, bool), []
        for k, loss in enumerate(self.losses):
            gone[loss.elements] = True
            before, highest, lowest, rest, after = (self.tensions[name][k] for name in TENSIONS)
            highest, lowest = np.where(gone, np.nan, highest), np.where(gone, np.nan, lowest)
            peak = farthest(before, highest, lowest, after)
            factor = np.where(np.isnan(lowest), np.nan, dynamic_factors(before, peak, rest, after))
            for entry in loss.entries:
                found["time"][entry] = loss.step * self.dt
                found["state"][entry] = self.rests[k].state
                breaks += [(e, entry) for e in self.rests[k].elements]
                for name, row in zip(names, (before, highest, lowest, peak, after, factor)):
                    found[name][entry] = row
        named = [loss.elements for loss in self.losses] or [np.zeros(0, np.int64)]
        entry = [loss.entry for loss in self.losses] or [np.zeros(0, np.int64)]
        found |= {"element": np.concatenate(named), "entry": np.concatenate(entry)}
        pairs = np.array(breaks, np.int64).reshape(-1, 2)
        return found | {"breaking_element": pairs[:, 0], "breaking_entry": pairs[:, 1]}


def farthest(before, highest, lowest, after) -> np.ndarray:
    """The extremes (m,) farthest from before in the direction of after; in either where that is not known.

    The highest of what broke, whose lowest is nan.
    """
    rises = np.where(np.isnan(after), highest - before >= before - lowest, after >= before)
    return np.where(rises | np.isnan(lowest), highest, lowest)


def dynamic_factors(before, peak, rest, after) -> np.ndarray:
    """(peak - before) / (after - before) (m,); nan where a loss changes nothing, or no rest is known.

    rest : (m,) [N] at rest before the loss, which is what it changes; before : in motion, gusts included
    """
    change, there = after - before, ~np.isnan(after)
    largest = max(np.abs(before).max(initial=0.0), np.abs(after[there]).max(initial=0.0))
    changed = np.minimum(np.abs(change), np.abs(after - np.where(np.isnan(rest), before, rest)))
    changes = there & (changed > NO_CHANGE * largest)
    return np.divide(peak - before, change, out=np.full(len(before), np.nan), where=changes)


def local_rows(gid: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rows of those of the wanted numbers that are among gid; both ascending."""
    return np.searchsorted(gid, wanted[np.isin(wanted, gid)])


# --- the rest of the damaged net


def rests_after(run, losses: list[Loss]) -> tuple[list[Rest], np.ndarray | None] | None:
    """The rest after each loss; tensions (losses + 1, m) [N] before any and after each, on rank 0.

    nan: no rest was found. From where the dynamic stage begins, with the losses so far, under all constant
    loads and the mean wind.
    Leaves the state as it was. Collective. Raises Interrupted where it is asked to stop.
    """
    if not losses:
        return None
    state, distribution, model = run.setup.state, run.setup.distribution, run.setup.model
    loads = loads_after(model, losses) if model else [None] * (len(losses) + 1)
    start, EA, broken = committed(state), state.EA.copy(), state.broken.copy()
    loose = run.comm.bcast(loose_after(model, losses, loads) if model else None)
    reference = reference_force(run, Equilibrium("loss", "", distribution.particles(loads[0])))
    mine = lambda tension: distribution.gather_elements(tension, state.owned.astype(bool))
    found, rests, best = [mine(state.elements_now().N)], [], start
    for loss, no_rest, whole in zip(losses, loose, loads[1:]):
        rows = local_rows(distribution.subdomain.element_gid, loss.elements)
        state.EA[rows], state.broken[rows] = 0.0, 1  # not slack: gone
        run.setup.finder = None  # what it keeps is of the net before
        load = distribution.particles(whole)
        words = f"the net without {words_of(run.job, loss)}"
        tension, rest = np.full(state.m, np.nan), Rest("no_equilibrium")
        line = f"no rest: a part of {words} hangs on nothing"
        if not no_rest:
            try:
                tension, rest, line = _settled(run, Equilibrium("loss", words, load, 1.0), reference)
                best = committed(state) if rest.state == "equilibrium" else best
            except Paused as pause:
                put_back(state, start)
                state.EA[:], state.broken[:] = EA, broken
                pause.path = run.saver.statics or StaticPath()
                raise interrupted(f"in statics, {words}", run.saver.pause_statics(pause)) from None
            except DivergedError as error:
                line = f"no rest: {error}"
        run.progress.say(line)
        rests.append(rest)
        put_back(state, best)
        found.append(mine(tension))
    put_back(state, start)
    state.EA[:], state.broken[:], run.setup.finder = EA, broken, None
    return rests, np.array(found) if model else None


def _settled(run, each: Equilibrium, reference: float) -> tuple[np.ndarray, Rest, str]:
    """Tensions (m,) [N] of this rank's elements at rest, what is known of it, a line on it. Collective."""
    most = min(MOST_ITERATIONS, run.job.load.max_iterations) if run.job.load else MOST_ITERATIONS
    settled = settle(run, each, reference, run.stop, most=most)
    rest, N = settled.found, settled.snapshot.N
    if rest.falls >= 0:
        node = run.comm.bcast(run.setup.model and run.setup.model.net.node_id[rest.falls])
        line = f"no rest of {each.words}: not stable at node {node}"
        return np.full_like(N, np.nan), Rest("unstable"), line
    line = f"rest of {each.words}: {error_words(rest.displacement_error, rest.tension_error)}"
    known = "" if rest.falls == STABLE else ", whether it is stable could not be told"
    line += f", residual {rest.residual:.3g} N, slack {settled.slack}{known}"
    if not settled.breaking:
        return N, Rest("equilibrium"), line
    ids = run.setup.model and run.setup.model.net.element_id[list(settled.breaking)]
    torn = run.comm.bcast(run.setup.model and elements_of(ids))
    return N, Rest("breaks", settled.breaking), f"{line}; {SOMETHING_BREAKS}: {torn}"


def loads_after(model, losses: list[Loss]) -> list[np.ndarray]:
    """What acts on the net without wind gusts, (n, 3) [N], before any loss and after each. Rank 0."""
    still, wind, gid = model.load.copy(), None, np.arange(model.net.n)
    if model.growing is not None:
        still += model.growing
    if model.mean_wind is not None:
        wind, square = model.wind.copy(), model.wind_field.mean_square(model.history.mean_gust)
    total = lambda: still.copy() if wind is None else still + wind * square[:, None]
    found = [total()]
    for loss in losses:
        for values in (still, wind):
            if values is not None:
                loss.handed.move(values, gid)
                values[loss.particles] = 0.0
        found.append(total())
    return found


def loose_after(model, losses: list[Loss], loads: list[np.ndarray]) -> list[bool]:
    """After each loss, whether a part of the net hangs on no support; loads : of `loads_after`. Rank 0."""
    there, gone = np.ones(model.net.m, bool), np.zeros(model.net.n, bool)
    found = []
    for loss, load in zip(losses, loads[1:]):
        there[loss.elements], gone[loss.particles] = False, True
        found.append(comes_loose(model.net, there, load, gone))
    return found


def words_of(job, loss: Loss) -> str:
    """What a loss takes, as the job names it."""
    names = []
    for k in loss.entries:
        entry = job.removes[k]
        for key, given in (("element", entry.elements), ("cable", entry.cables)):
            if given is not None:
                given = list(dict.fromkeys(given))
                few = ", ".join(map(str, given[:MOST_NAMED])) + ", ..." * (len(given) > MOST_NAMED)
                names.append(f"{key}{'s' * (len(given) > 1)} {few}")
        if entry.group is not None:
            names.append(f"group {entry.group}")
    return " and ".join(names)
