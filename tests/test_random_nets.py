"""Random nets with all features have the same bits on one rank, on three, and after a restart."""

import os
import re
from collections import Counter
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import hypothesis
import hypothesis.strategies as st
import pytest
from conftest import run_on_standing_ranks
from drawn_jobs import FULL, OTHER, QUIET, jobs
from results import differences, figures

from netfall.job.keys.schema import LIST_KEYS, SECTIONS

EXAMPLES = int(os.environ.get("NETFALL_EXAMPLES", "40"))  # of random scenes, with --long


class Runs:
    """One job in its own folder, run by persistent ranks."""

    def __init__(self, drawn, run, folder: Path):
        """run : as `run_on_standing_ranks`"""
        self.drawn, self._run, self.folder = drawn, run, folder
        for name, text in (drawn.tables | {"job.toml": drawn.text}).items():
            (folder / name).write_text(text)

    def run(self, name: str, ranks: int, *more) -> tuple[int, str]:
        """Return exit code and messages of a run, whose result has this name."""
        line = ["run", "job.toml", "-o", f"{name}.vtkhdf", "--quiet", *more]
        done = self._run(*line, ranks=ranks, cwd=self.folder)
        return done.returncode, re.sub(r"\w+\.checkpoint\S*", "", done.stderr).strip()

    def same(self, what: str, first, other, name: str) -> None:
        """Return whether both ended with equal exit codes and messages, or with equal results."""
        assert other == first, f"{what}: {other}, on one rank {first}"
        if first[0] == 0:
            lines = differences(self.folder / "one.vtkhdf", self.folder / f"{name}.vtkhdf")
            assert not lines, f"{what}: " + "; ".join(lines[:8])

    def compare(self) -> int:
        """Return the exit code on one rank. Raises AssertionError if other ranks or a restart differ."""
        first = self.run("one", 1)
        stops, goes_on = self.drawn.ranks
        at_checkpoints = self.drawn.stop == "checkpoint"
        options = () if at_checkpoints and stops == 3 else ("--set", "output.checkpoint_interval=0")
        self.same("three ranks", first, self.run("three", 3, *options), "three")
        if first[0] != 0:
            return first[0]
        name = {1: "one", 3: "three"}[stops] if at_checkpoints else "paused"
        if not at_checkpoints:
            assert self.run(name, stops, "--walltime", "00:00:00")[0] == 4
        (checkpoint, *_) = sorted(self.folder.glob(f"{name}.checkpoint-*.h5"))
        again = self.run("again" if at_checkpoints else name, goes_on, "--restart", checkpoint.name)
        self.same(f"{stops} ranks to {checkpoint.name}, {goes_on} from there", first, again,
                  "again" if at_checkpoints else name)  # fmt: skip
        return 0


def tried(drawn, run, counts: Counter) -> None:
    with TemporaryDirectory() as folder:
        runs = Runs(drawn, run, Path(folder))
        code = runs.compare()
        counts[f"exit code {code}"] += 1
        if code == 0:
            counted = figures(Path(folder) / "one.vtkhdf")
            counts.update(name for name in ("broken", "yielded", "slack") if counted[name])


# What other tests have: combinations and cases (test_cases.py), erection, targets and lengths
# (test_erection.py), the form under permanent loads (test_validation_prestress.py), horizontal forces
# (test_horizontal_force.py), the check of bending (test_ring_and_mast_check.py).
SECTIONS_OF_THEIR_OWN = {"combination", "limits", "slide", "stage", "target"}
KEYS_OF_THEIR_OWN = {
    *("cable.bending", "cable.buckling", "cable.horizontal_force"),
    *("cable.section_modulus", "cable.design_strength"),
    *("cable.length_std", "cable.length_seed", "case.factor", "case.pressure_table"),
    *("case.load_table", "load.load_table"),
    *("case.settlement", "form_finding.loads", "load.stop_at_strength", "roof.normal"),
}


@pytest.mark.parametrize("scene", [FULL, OTHER], ids=["full", "other"])
def test_a_net_with_all_features_has_equal_bits_on_ranks_and_after_a_restart(scene):
    """Wind, taps, load ramps, fading removals, springs, struts, yield, fracture: three nets of each."""
    counts = Counter()

    @hypothesis.settings(max_examples=3, derandomize=True, **QUIET)
    @hypothesis.given(jobs(st.just(scene)))
    def of_the_scene(drawn):
        tried(drawn, partial(run_on_standing_ranks, code=None), counts)

    of_the_scene()
    assert counts["exit code 0"] >= 2 and counts["broken"] and counts["yielded"] and counts["slack"], counts


@pytest.mark.long
def test_nets_of_any_features_have_equal_bits_on_ranks_and_after_a_restart():
    """Features are random too. NETFALL_EXAMPLES is their number."""
    counts, run = Counter(), partial(run_on_standing_ranks, code=None, timeout=3000)

    @hypothesis.settings(max_examples=EXAMPLES, **QUIET)
    @hypothesis.given(jobs())
    def of_any_scene(drawn):
        tried(drawn, run, counts)
        print(dict(counts), flush=True)

    of_any_scene()
    assert counts["exit code 0"] > 0.7 * EXAMPLES
    assert min(counts[k] for k in ("broken", "yielded", "slack")) > 3


def keys_of(job: dict, place: str = "") -> set[str]:
    """Return names of the keys in nested dicts; those in groups and zones as those of the section."""
    keys = set()
    for name, value in job.items():
        if name == "group" and not place:
            keys |= keys_of(value, "cable.")
        elif name in SECTIONS or name in LIST_KEYS:
            entries = value if isinstance(value, list) else [value]
            keys |= set().union(*(keys_of(entry, f"{name}.") for entry in entries if isinstance(entry, dict)))
        elif isinstance(value, dict) and place != "case.":
            keys |= keys_of(value, place)
        else:
            keys.add(place + name)
    return keys


def test_every_key_of_a_job_is_drawn():
    """Except those of generated nets."""
    drawn_keys = set()

    @hypothesis.seed(2)  # fixed: other draws may lack a rare key
    @hypothesis.settings(max_examples=240, phases=[hypothesis.Phase.generate], **QUIET)
    @hypothesis.given(jobs())
    def collect(drawn):
        drawn_keys.update(keys_of(drawn.job))

    collect()
    named = (SECTIONS | LIST_KEYS).items()
    every = {f"{name}.{key.name}".removeprefix(".") for name, keys in named for key in keys}
    undrawn = {key for key in every if key.partition(".")[0] in SECTIONS_OF_THEIR_OWN} | KEYS_OF_THEIR_OWN
    assert every - drawn_keys - undrawn == {"net.generator"}
