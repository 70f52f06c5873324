"""Kill runs at random moments, restart them on other ranks, and compare the results with an undisturbed run.

SIGKILL ends one rank, mpirun, or all processes at a random moment, mostly after some checkpoints. Frames and
checkpoints are so frequent that many kills interrupt a write. The run restarts from its newest complete
checkpoint, or from the start, on one to four ranks. It may be killed again before it finishes.
"""

import contextlib
import os
import random
import re
import signal
import subprocess
import time
from pathlib import Path

import h5py
from conftest import BIN, ENVIRONMENT
from nets import STORM, saddle
from results import assert_same_results

JOB = f"""{saddle(cells=8)}[load]
self_weight = true
{STORM}[dynamics]
duration = 0.4
time_step = 4e-5
mass_damping = 0.2
[output]
history_interval = 0.005
frames = 80
checkpoint_interval = 0.02
probes = [[0.0, 0.0]]
"""


def changed(text: str = JOB, **values: float) -> str:
    """Return the job with other values of its keys."""
    for key, value in values.items():
        text, count = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.M)
        assert count == 1, key
    return text


HANG = 60.0  # s after which processes of a killed run count as hanging


def command(folder: Path, ranks: int, restart: Path | None) -> list[str]:
    """Return the command line of a run."""
    line = [BIN / "mpirun", "-n", ranks, BIN / "netfall", "run", folder / "job.toml"]
    line += ["-o", folder / "result.vtkhdf", "--quiet"]
    return list(map(str, line + (["--restart", restart] if restart else [])))


def processes_of(folder: Path) -> list[int]:
    """Return the running processes whose command line contains the folder: mpirun and the ranks."""
    processes = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                if (
                    str(folder).encode() in (entry / "cmdline").read_bytes()
                    and "Z" not in (entry / "stat").read_text().rsplit(")", 1)[1].split()[0]
                ):
                    processes.append(int(entry.name))
            except OSError:
                continue
    return processes


def newest_checkpoint(folder: Path) -> Path | None:
    """Return the checkpoint with the largest step."""
    return max(folder.glob("result.checkpoint-*.h5"), default=None)


def kill(folder: Path, process: subprocess.Popen, choice: random.Random) -> str:
    """Kill one rank, mpirun, or all; return which."""
    everything = processes_of(folder)
    ranks = [p for p in everything if p != process.pid]
    what = choice.choice(["rank", "mpirun", "group"])
    victims = {
        "rank": ranks[:1] if not ranks else [choice.choice(ranks)],
        "mpirun": [process.pid],
        "group": everything,
    }[what]
    for victim in victims:
        with contextlib.suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
    process.wait(HANG)
    end = time.monotonic() + HANG
    while processes_of(folder):
        if time.monotonic() > end:
            raise AssertionError(f"hangs after the kill of {what}: {processes_of(folder)}")
        time.sleep(0.05)
    return what


def wait_for_a_moment(
    folder: Path, process: subprocess.Popen, restart: Path | None, choice: random.Random, longest: float
) -> None:
    """Wait for a random time (one case in four), or until shortly after some more checkpoints."""
    if choice.random() < 0.25:
        time.sleep(choice.uniform(0.3, longest))
        return
    last, left, end = restart, choice.randint(1, 12), time.monotonic() + longest
    while left and process.poll() is None and time.monotonic() < end:
        newest = newest_checkpoint(folder)
        if newest != last:
            last, left = newest, left - 1
        time.sleep(0.002)
    time.sleep(choice.uniform(0.0, 0.1))


def run_with_kills(
    folder: Path, choice: random.Random, longest: float, kills_left: int, most_ranks: int
) -> int:
    """Run with one to three kills and restarts until there is a result; return the number of kills."""
    killed = 0
    kills = choice.randint(1, min(3, kills_left))
    while True:
        ranks, restart = choice.randint(1, most_ranks), newest_checkpoint(folder)
        process = subprocess.Popen(
            command(folder, ranks, restart),
            env=ENVIRONMENT,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        if killed < kills:
            wait_for_a_moment(folder, process, restart, choice, longest)
            if process.poll() is None:
                what = kill(folder, process, choice)
                killed += 1
                process.stdout.close()
                process.stderr.close()
                print(
                    f"  {ranks} ranks, from {restart.name if restart else 'the start'}: killed {what}",
                    flush=True,
                )
                continue
        out, error = process.communicate(timeout=300)
        assert process.returncode == 0, (out + error).decode()
        print(f"  {ranks} ranks, from {restart.name if restart else 'the start'}: finished", flush=True)
        return killed


def repeat_runs_with_kills(
    top: Path, expected: Path, kills: int, choice: random.Random, longest: float, most_ranks: int
) -> int:
    """Repeat runs until there were enough kills; compare each result with `expected`; return their number."""
    killed = run = 0
    while killed < kills:
        folder = top / f"run{run}"
        folder.mkdir()
        (folder / "job.toml").write_text(JOB)
        killed += run_with_kills(folder, choice, longest, kills - killed, most_ranks)
        with h5py.File(expected) as one, h5py.File(folder / "result.vtkhdf") as other:
            datasets = assert_same_results(one, other)
        left = sorted(p.name for p in folder.iterdir() if ".part" in p.name or ".segment" in p.name)
        assert not left, left
        run += 1
        print(f"run {run}: {killed} kills so far, {datasets} datasets equal to the bit", flush=True)
    return run
