"""Compare the present code with an earlier commit: every result must be the same to the last bit.

    .venv/bin/python tests/same_bits.py COMMIT                  all cases
    .venv/bin/python tests/same_bits.py COMMIT --quick          the shipped jobs only, as they stand
    .venv/bin/python tests/same_bits.py COMMIT --only stadium --only net-1-07
    .venv/bin/python tests/same_bits.py COMMIT --seed 2 --nets 60
    .venv/bin/python tests/same_bits.py COMMIT --new history/loss_work

Cases are the shipped jobs (with fragments and without) and random nets of any scene (drawn_jobs.py).
The earlier code runs each case on one rank, once: its results and its compiled kernels are kept in
build/same_bits/COMMIT. The present code runs it on one rank and on several, and random nets also from a
checkpoint or after a pause, on other ranks. Compared are names, shapes, types and bytes of all datasets and
attributes, but those of /provenance; and, of runs that end early, exit code and message. The exit code is 1
if anything differs or is missing. Results that differ are left in build/same_bits/work-*.
"""

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import h5py
import llvmlite.binding
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from drawn_jobs import some_jobs

ROOT = Path(__file__).resolve().parents[1]
MPIRUN = ROOT / ".venv" / "bin" / "mpirun"
CACHE = ROOT / "build" / "same_bits"
RESULT = "result.vtkhdf"
LONGEST = 600  # s of a run; then it counts as hanging
SHOWN = 5  # differences printed for a run
MPI_LOCK = threading.Lock()  # several ranks at a time fill the machine


# --- comparison


def contents(file: h5py.File) -> dict[str, np.ndarray]:
    """All datasets and attributes ("name@attribute") but those of /provenance."""
    found = {f"/@{key}": np.asarray(value) for key, value in file.attrs.items()}

    def add(name, item):
        if name.split("/")[0] == "provenance":
            return
        found.update({f"{name}@{key}": np.asarray(value) for key, value in item.attrs.items()})
        if isinstance(item, h5py.Dataset):
            found[name] = np.asarray(item[()])

    file.visititems(add)
    return found


def differences(old: Path, new: Path, allowed: tuple[str, ...] = ()) -> tuple[int, list[str]]:
    """Number of datasets compared, and a line for each that differs.

    allowed : names, or their beginnings, of what may be new
    """
    with h5py.File(old, "r") as a, h5py.File(new, "r") as b:
        one, other = contents(a), contents(b)
    lines = [f"{name}: missing" for name in one if name not in other]
    lines += [f"{name}: new" for name in other if name not in one and not name.startswith(allowed or "\n")]
    for name in one:
        if name in other:
            lines += difference(name, one[name], other[name])
    return sum("@" not in name for name in one), lines


def difference(name: str, a: np.ndarray, b: np.ndarray) -> list[str]:
    """How two arrays differ: no line, or one."""
    if a.dtype != b.dtype:
        return [f"{name}: type {b.dtype}, was {a.dtype}"]
    if a.shape != b.shape:
        return [f"{name}: shape {b.shape}, was {a.shape}"]
    if a.dtype == object:
        return [] if a.tolist() == b.tolist() else [f"{name}: another text"]
    if a.tobytes() == b.tobytes():
        return []
    rows = lambda v: np.frombuffer(v.tobytes(), np.uint8).reshape(v.size, -1)
    wrong = np.flatnonzero((rows(a) != rows(b)).any(1))
    first = wrong[0]
    place = [int(k) for k in np.unravel_index(first, a.shape)]
    values = f"{b.flat[first]!r}, was {a.flat[first]!r}"
    return [f"{name}: {len(wrong)} of {a.size} values differ, the first at {place}: {values}"]


# --- cases


@dataclass
class Case:
    """A job with its files, what is overridden, and how the present code runs it."""

    name: str
    files: dict[str, str]
    overrides: tuple[str, ...] = ()
    ranks: tuple[int, ...] = (1, 3)
    stop: str = "never"  # how a run is interrupted and taken up again: never | checkpoint | pause
    variant: str = ""  # cases of one variant run the same compiled code

    def digest(self) -> str:
        """Fingerprint of what is computed, and with what: bits differ between processors and libraries."""
        machine = [
            llvmlite.binding.get_host_cpu_name(),
            *(version(name) for name in ("numba", "numpy", "scipy")),
        ]
        text = json.dumps([self.files, self.overrides, machine], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def shipped_cases(quick: bool) -> list[Case]:
    """The jobs of jobs/, with fragments and without; `quick`: as they stand."""
    wanted = {
        "stadium-40": ("stadium", "wind.speed=40"),
        "stadium-80": ("stadium", "wind.speed=80", 'wind.onset="sudden"'),
    }
    wanted |= {"saddle": ("saddle",), "olympia": ("olympia",)}
    cases = []
    for name, (job, *overrides) in wanted.items():
        files = {"job.toml": (ROOT / "jobs" / f"{job}.toml").read_text()}
        files |= {f"{job}/{p.name}": p.read_text() for p in sorted((ROOT / "jobs" / job).glob("*.csv"))}
        if quick and name != "stadium-40":
            cases.append(Case(name, files, tuple(overrides), (1, 3)))
        for fragments in () if quick else ("true", "false"):
            more = (f"dynamics.fragments={fragments}",)
            full = name + ("-taken-out" if fragments == "false" else "")
            variant = f"{'stadium' if job == 'saddle' else job} {more}"
            cases.append(Case(full, files, (*overrides, *more), (1, 2, 3), variant=variant))
    return cases


def net_cases(count: int, seed: int) -> list[Case]:
    """The random nets."""
    return [
        Case(
            f"net-{seed}-{k:02d}",
            {"job.toml": job.text} | job.tables,
            stop=job.stop,
            variant=str(job.scene),
        )
        for k, job in enumerate(some_jobs(count, seed))
    ]


def in_turn(cases: list[Case]) -> list[Case]:
    """The cases, those of one variant far apart: the second finds compiled what the first needed."""
    seen: dict[str, int] = {}
    turn = {}
    for case in cases:
        turn[case.name] = seen[case.variant] = seen.get(case.variant, -1) + 1
    return sorted(cases, key=lambda case: turn[case.name])


# --- runs


@dataclass
class Run:
    """How a run ended: exit code, what it wrote to stderr, its result file."""

    code: int
    error: str
    result: Path
    seconds: float = 0.0


def run(source: Path, folder: Path, case: Case, ranks=1, output=RESULT, more: tuple[str, ...] = ()) -> Run:
    """Run a case with the code in `source` in a folder where its files are."""
    command = [sys.executable, "-m", "netfall", "run", "job.toml", "-o", output, *more]
    for override in case.overrides:
        command += ["--set", override]
    if ranks > 1:
        command = [str(MPIRUN), "-n", str(ranks), *command]
    environment = os.environ | {"PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1"}
    begin = time.monotonic()
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LONGEST,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return Run(-1, f"hangs: no end after {LONGEST} s", folder / output)
    error = without_mpirun(done.stderr)
    return Run(done.returncode, error, folder / output, time.monotonic() - begin)


def without_mpirun(text: str) -> str:
    """Messages without what mpirun adds between lines of dashes."""
    return re.sub(r"-{40,}\n.*?-{40,}\n", "", text, flags=re.DOTALL).strip()


def put_files(case: Case, folder: Path) -> Path:
    """The folder, new, with the files of the case."""
    for name, text in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


class Earlier:
    """The code of a commit, unpacked, and its results; both stay for the next sitting."""

    def __init__(self, commit: str):
        """Raises CalledProcessError for what is no commit."""
        git = lambda *words: (
            subprocess.run(["git", "-C", str(ROOT), *words], check=True, capture_output=True).stdout
        )
        self.name = git("rev-parse", "--verify", f"{commit}^{{commit}}").decode().strip()
        self.folder = CACHE / self.name[:12]
        self.source = self.folder / "tree" / "src"
        if not self.source.is_dir():
            self.folder.mkdir(parents=True, exist_ok=True)
            unpacked = Path(tempfile.mkdtemp(dir=self.folder))
            subprocess.run(
                ["tar", "-x", "-C", str(unpacked)], input=git("archive", self.name, "src"), check=True
            )
            unpacked.rename(self.folder / "tree")

    def run(self, case: Case, work: Path) -> Run:
        """The case on one rank, or what is kept of an earlier run of it."""
        kept = self.folder / "results" / f"{case.name}-{case.digest()}.json"
        result = kept.with_suffix(".vtkhdf")
        if not kept.exists():
            kept.parent.mkdir(exist_ok=True)
            folder = put_files(case, work / "old")
            done = run(self.source, folder, case)
            if done.code < 0:  # killed or hanging: nothing to keep
                return done
            if done.code == 0:
                shutil.copy(done.result, result)
            kept.write_text(json.dumps([done.code, done.error]))
        return Run(*json.loads(kept.read_text()), result)


class Verdict:
    """What came of a case: a line, the differences of each of its runs, and figures for the tally."""

    def __init__(self, case: Case, old: Run, allowed: tuple[str, ...]):
        self.case, self.old, self.allowed = case, old, allowed
        self.datasets = 0
        self.runs: list[str] = []
        self.wrong: dict[str, list[str]] = {}
        self.figures = figures(old.result) if old.code == 0 else {}
        if old.code not in (0, 2, 3):
            self.wrong["earlier code"] = [f"exit code {old.code}: {old.error[-300:]}"]

    def compare(self, what: str, new: Run) -> bool:
        """Note whether a run of the present code ended as the old one."""
        self.runs.append(f"{what} {new.seconds:.1f} s")
        lines = []
        if new.code != self.old.code:
            lines.append(f"exit code {new.code}, was {self.old.code}: {new.error[-300:]}")
        elif new.error != self.old.error:
            lines.append(f"message {new.error[-300:]!r}, was {self.old.error[-300:]!r}")
        if new.code == self.old.code == 0:
            self.datasets, more = differences(self.old.result, new.result, self.allowed)
            lines += more
        if lines:
            self.wrong[what] = lines
        return not lines

    def text(self) -> str:
        """The line of the case, and a few for what differs."""
        ended = f"{self.datasets} datasets" if self.old.code == 0 else f"exit code {self.old.code}"
        seen = "".join(f", {value} {name}" for name, value in self.figures.items() if value)
        state = "DIFFERS" if self.wrong else "equal"
        lines = [f"{state:8}{self.case.name:26} {'; '.join(self.runs)}: {ended}{seen}"]
        if self.old.code:
            lines.append(f"        {self.old.error[-160:]}")
        for what, wrong in self.wrong.items():
            lines += [f"    {what}: {line}" for line in wrong[:SHOWN]]
            lines += [f"    {what}: and {len(wrong) - SHOWN} more"] * (len(wrong) > SHOWN)
        return "\n".join(lines)


def figures(result: Path) -> dict[str, int]:
    """How many elements broke and yielded, the largest number of slack cables, the steps."""
    with h5py.File(result, "r") as file:
        last = lambda name: int(np.max(file[name][()], initial=0)) if name in file else 0
        yielded = int(np.count_nonzero(file["final/plastic_strain"])) if "final/plastic_strain" in file else 0
        steps = (
            round(file["history/time"][-1] / file["history/time_step"][-1]) if "history/time" in file else 0
        )
        return dict(broken=last("history/broken"), yielded=yielded, slack=last("history/slack"), steps=steps)


def judge(case: Case, earlier: Earlier, work: Path, allowed: tuple[str, ...]) -> Verdict:
    """Run a case with both codes. What differs stays in the folder `work`."""
    verdict = Verdict(case, earlier.run(case, work), allowed)
    for ranks in case.ranks:
        with MPI_LOCK if ranks > 1 else threading.Lock():
            new = run(ROOT / "src", put_files(case, work / f"ranks-{ranks}"), case, ranks)
        verdict.compare(f"{ranks} rank{'s' if ranks > 1 else ''}", new)
    if verdict.old.code == 0 and case.stop != "never":
        with MPI_LOCK:
            {"checkpoint": restart_from_checkpoints, "pause": restart_after_pause}[case.stop](verdict, work)
    if not verdict.wrong:
        shutil.rmtree(work, ignore_errors=True)
    return verdict


def restart_from_checkpoints(verdict: Verdict, work: Path) -> None:
    """The older checkpoint of the run on one rank, on three; the newer one of that on three, on two."""
    for ranks, pick, later in ((1, 0, 3), (3, -1, 2)):
        folder = work / f"ranks-{ranks}"
        kept = sorted(path.name for path in folder.glob("result.checkpoint-5-*.h5"))
        what = f"{later} from a checkpoint of {ranks}"
        if not kept:
            verdict.wrong[what] = ["no checkpoint was written"]
            continue
        more = ("--restart", kept[pick])
        verdict.compare(what, run(ROOT / "src", folder, verdict.case, later, "again.vtkhdf", more))


def restart_after_pause(verdict: Verdict, work: Path) -> None:
    """Stopped at the first occasion on three ranks, taken up on two."""
    folder, what = put_files(verdict.case, work / "paused"), "2 after a pause of 3"
    paused = run(ROOT / "src", folder, verdict.case, 3, RESULT, ("--walltime", "00:00:00"))
    kept = sorted(path.name for path in folder.glob("result.checkpoint-*.h5"))
    if paused.code != 4 or not kept:
        verdict.wrong[what] = [
            f"did not stop: exit code {paused.code}, {len(kept)} checkpoints: {paused.error[-300:]}"
        ]
        return
    verdict.compare(what, run(ROOT / "src", folder, verdict.case, 2, RESULT, ("--restart", kept[-1])))


# --- the sitting


def source_digest(source: Path) -> str:
    """Fingerprint of the code, to see whether it changed while the cases ran."""
    files = sorted(source.rglob("*.py"))
    return hashlib.sha256(
        b"".join(str(p.relative_to(source)).encode() + p.read_bytes() for p in files)
    ).hexdigest()


def check_imports(source: Path) -> None:
    """Stop unless Python takes netfall from there, and from nowhere else."""
    found = subprocess.run(
        [sys.executable, "-c", "import netfall; print(netfall.__file__)"],
        cwd=tempfile.gettempdir(),
        env=os.environ | {"PYTHONPATH": str(source)},
        capture_output=True,
        text=True,
        check=True,
    )
    if Path(found.stdout.strip()).parents[1].resolve() != source.resolve():
        sys.exit(f"netfall is taken from {found.stdout.strip()}; expected {source}")


def tally(verdicts: list[Verdict]) -> str:
    """What the random nets went through, in lines."""
    nets = [v for v in verdicts if v.case.name.startswith("net-")]
    having = lambda name: sum(bool(v.figures.get(name)) for v in nets)
    codes = [v.old.code for v in nets]
    steps = [v.figures["steps"] for v in nets if v.figures]
    return (
        f"{len(nets)} nets of {len({v.case.variant for v in nets})} scenes: "
        f"{having('broken')} break, {having('yielded')} yield, {having('slack')} go slack; "
        f"{codes.count(2)} refused, {len(codes) - codes.count(2) - codes.count(0)} end early; "
        f"steps {min(steps, default=0)} to {max(steps, default=0)}"
    )


def options() -> argparse.Namespace:
    """The command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("commit", help="the earlier commit")
    p.add_argument("--only", action="append", default=[], metavar="NAME", help="cases whose names begin so")
    p.add_argument("--nets", type=int, help="number of random nets (default: 36; with --quick none)")
    p.add_argument("--seed", type=int, default=1, help="of the random nets (default: 1)")
    p.add_argument("--quick", action="store_true", help="shipped jobs as they stand on 1 and 3 ranks")
    p.add_argument(
        "--new", action="append", default=[], metavar="NAME", help="datasets that may be new, by beginning"
    )
    p.add_argument("--jobs", type=int, default=2, help="cases at a time (default: 2)")
    p.add_argument("--list", action="store_true", help="print the names of the cases and end")
    return p.parse_args()


def main() -> None:
    """Run and compare all cases; exit code 1 if something differs."""
    asked = options()
    nets = asked.nets if asked.nets is not None else 0 if asked.quick else 36
    cases = in_turn(shipped_cases(asked.quick) + net_cases(nets, asked.seed))
    cases = [c for c in cases if not asked.only or c.name.startswith(tuple(asked.only))]
    if asked.list or not cases:
        print(*(case.name for case in cases), sep="\n")
        sys.exit(0 if cases else "no such case; --list prints the names")
    earlier, begin, before = Earlier(asked.commit), time.monotonic(), source_digest(ROOT / "src")
    for source in (earlier.source, ROOT / "src"):
        check_imports(source)
    work = Path(tempfile.mkdtemp(prefix="work-", dir=CACHE))
    with ThreadPoolExecutor(asked.jobs) as pool:
        found = [pool.submit(judge, c, earlier, work / c.name, tuple(asked.new)) for c in cases]
        verdicts = []
        for future in found:
            verdicts.append(future.result())
            print(verdicts[-1].text(), flush=True)
    wrong = [v.case.name for v in verdicts if v.wrong]
    if nets:
        print(tally(verdicts))
    took = f"{time.monotonic() - begin:.0f} s"
    if source_digest(ROOT / "src") != before:
        sys.exit(f"src was changed while the cases ran: nothing is shown by them ({took})")
    if wrong:
        print(f"{len(wrong)} of {len(cases)} cases DIFFER from {earlier.name[:12]}; see {work} ({took})")
        sys.exit(f"differ: {', '.join(wrong)}")
    shutil.rmtree(work)
    runs = sum(len(v.runs) for v in verdicts)
    print(f"{len(cases)} cases, {runs} runs, all equal to {earlier.name[:12]} to the last bit ({took})")


if __name__ == "__main__":
    main()
