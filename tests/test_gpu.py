"""Steps on a GPU have the bits of the CPU, in numba's simulator of CUDA; unsupported features are refused."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import h5py
import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
from conftest import ENVIRONMENT, ROOT, run_netfall, run_process
from drawn_jobs import FLAGS, QUIET, WINDS, jobs
from nets import bare_saddle
from results import differences, figures

from netfall.core.errors import InputError
from netfall.gpu import memory, stepper

ON_GPU = dict.fromkeys(FLAGS, True) | {"motion": False, "band": False, "rests": False}
ALL = ON_GPU | {"logarithmic": False, "wind": "gusts"}
OTHER = ON_GPU | {"fragments": False, "wind": "taps"}

SIMULATED = (sys.executable, ROOT / "tests" / "simulated_gpu.py")

JOB = bare_saddle(3, 2e4, side=20.0, rise=2.0, section=(1e11, 1e-4, 7850.0))
JOB += "[dynamics]\nduration = 0.01\n"


def scenes():
    """Scenes of which a GPU can step any."""
    flags = {name: st.booleans() if can_be_on else st.just(False) for name, can_be_on in ON_GPU.items()}
    return st.fixed_dictionaries(flags | {"wind": st.sampled_from(WINDS)})


def compare(folder: Path, drawn_from, count: int, how: str) -> Counter:
    """Draw jobs and run them on CPU and simulated GPU, as `gpu_runs` does; count the results."""
    places: list[Path] = []

    @hypothesis.settings(max_examples=count, derandomize=True, phases=[hypothesis.Phase.generate], **QUIET)
    @hypothesis.given(jobs(drawn_from))
    def draw(job):
        place = folder / str(len(places))
        place.mkdir()
        for name, text in (job.tables | {"job.toml": job.text}).items():
            (place / name).write_text(text)
        places.append(place)

    draw()
    return run_on_both(places, how)


def run_on_both(places: list[Path], how: str) -> Counter:
    """Run job.toml of each folder on CPU and simulated GPU; count the results of successful runs."""
    command = [*SIMULATED, "gpu_runs", how, *places]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800, env=os.environ)
    assert done.returncode == 0, done.stderr
    counts: Counter = Counter()
    for place, line in zip(places, done.stdout.splitlines(), strict=True):
        name, on_cpu, on_gpu, *lines = line.split(" ")
        assert name == place.name and on_gpu == on_cpu and not any(lines), line
        counts[f"exit code {on_cpu}"] += 1
        if on_cpu == "0":
            figures_of_run = figures(place / "cpu.vtkhdf")
            counts.update(key for key in ("broken", "yielded", "slack") if figures_of_run[key])
    return counts


@pytest.mark.parametrize("scene, how", [(ALL, "alone"), (OTHER, "crowded")], ids=["alone", "crowded"])
def test_a_gpu_gives_the_bits_of_the_cpu_in_every_dataset(tmp_path, scene, how):
    """Nets with everything that a GPU steps, in the simulator."""
    counts = compare(tmp_path, st.just(scene), 2, how)
    assert counts["exit code 0"] == 2 and counts["broken"] and counts["yielded"] and counts["slack"], counts


def test_yield_and_extremes_between_rows_have_the_bits_of_the_cpu(tmp_path):
    """120 steps without a row, in which cables yield and none can break."""
    text = JOB.replace("[dynamics]", "yield_stress = 2.05e8\n[dynamics]")
    text = text.replace("duration = 0.01", "duration = 0.012\ntime_step = 1e-4")
    text += "[load]\npressure = [0.0, 0.0, 4000.0]\n"
    (tmp_path / "job.toml").write_text(text + "[output]\nframes = 1\nhistory_interval = 0.012\n")
    assert run_on_both([tmp_path], "alone")["yielded"]


@pytest.mark.parametrize("after", ["detached", "particle"])
def test_a_collapse_changes_little_of_the_state_on_the_host(tmp_path, after):
    """Its bits are those of the CPU, and the host copies the state to the GPU a few times only."""
    text = (ROOT / "jobs" / "stadium.toml").read_text().replace('"detached"', f'"{after}"')
    text = text.replace("speed = 54.0", "speed = 70.0").replace("duration = 6.0", "duration = 2.0")
    (tmp_path / "job.toml").write_text(text)
    assert run_on_both([tmp_path], "looped")["broken"]


@pytest.mark.long
@pytest.mark.parametrize("how", ["alone", "together"])
def test_a_gpu_gives_the_bits_of_the_cpu_for_random_nets(tmp_path, how):
    """Thirty-six scenes, of which some are refused on both."""
    counts = compare(tmp_path, scenes(), 36, how)
    assert counts["exit code 0"] >= 20, counts
    assert min(counts[key] for key in ("broken", "yielded", "slack")) > 3, counts


STUDY = """
job = "job.toml"
[vary]
"wind.seed" = [1, 2]
[run]
keep_results = "all"
"""
GUSTS = """
[wind]
speed = 60.0
turbulence_intensity = 0.2
onset = "sudden"
time_step = 0.005
pressure_coefficient = -1.2
base_height = 10.0
"""


def test_a_study_on_a_gpu_has_the_outcomes_of_the_cpu(tmp_path):
    """With the result files of its samples, in which cables break, and a part that is removed."""
    text = JOB.replace("[dynamics]", "fracture_strain = 0.0021\n[dynamics]") + GUSTS
    (tmp_path / "job.toml").write_text(text + "[[remove]]\nelements = [0]\ntime = 0.002\n")
    (tmp_path / "study.toml").write_text(STUDY)
    environment = ENVIRONMENT | {"PYTHONWARNINGS": "ignore::RuntimeWarning"}  # 1 / 0 in kernels
    for device in ("cpu", "gpu"):
        arguments = ("study.toml", "--workers", 1, "--device", device, "-o", f"{device}.study.h5")
        launcher = ("--launcher", shlex.join(map(str, SIMULATED)) + " {ranks}")
        line = (*SIMULATED, "netfall", "study", *arguments, *launcher)
        run_process(*line, cwd=tmp_path, environment=environment)
    lines = differences(tmp_path / "cpu.study.h5", tmp_path / "gpu.study.h5")
    assert {line.partition(":")[0] for line in lines} <= {"provenance/command", "samples/seconds"}, lines
    with h5py.File(tmp_path / "gpu.study.h5", "r") as file:
        assert (file["samples/broken"][:] > 0).all()
    for number in range(2):
        name = f"{number:06d}.vtkhdf"
        assert not differences(tmp_path / "cpu.samples" / name, tmp_path / "gpu.samples" / name)


FAULTY = """
import os
from netfall.gpu.stepper import Gpu, GpuNet

class Faulty(Gpu):
    def launch(self, nets):
        raise OSError

def waits():
    together.start(lambda: None)
    together.advance(GpuNet())

together = Faulty(lambda error: os._exit(7))
together.start(waits)
together.join()
"""


def test_an_error_at_the_end_of_a_task_ends_the_tasks_that_wait():
    """The last task that runs ends, and the launch for the other one fails."""
    assert subprocess.run([sys.executable, "-c", FAULTY], timeout=60).returncode == 7


def test_a_net_too_large_for_the_device_waits_for_others_or_is_refused(monkeypatch):
    """It needs 2 GB of 1 GB, of which another net has a part."""
    monkeypatch.setattr(memory, "free_memory", lambda: 1e9)
    net = SimpleNamespace(allocate=lambda work: False, staged=SimpleNamespace(size=1.8e9))
    gpu, other = stepper.Gpu(), memory.GpuNet()
    gpu.nets.add(other)
    other.memory = np.zeros(1)
    monkeypatch.setattr(gpu, "advance", lambda net: other.release())
    with pytest.raises(InputError, match=r"2(\.0)? GB.*1(\.0)? GB.*E074"):
        gpu.upload(net, SimpleNamespace())
    assert not other.memory.size


@pytest.mark.parametrize(
    "more, ranks, feature",
    [
        ("axial_damping_ratio = 0.01\naxial_damping_band = [1.0, 10.0]\n", 1, "axial damping"),
        ("", 2, "more than one rank"),
    ],
)
def test_unsupported_features_are_refused_or_run_on_the_cpu(tmp_path, more, ranks, feature):
    """`--device gpu` names it in an error, `--device auto` in a note."""
    (tmp_path / "job.toml").write_text(JOB + more)
    refused = run_netfall("run", "job.toml", "--device", "gpu", ranks=ranks, cwd=tmp_path, code=2)
    assert f"error: --device gpu: not possible with {feature}. " in refused.stderr
    assert "[E072]" in refused.stderr and not list(tmp_path.glob("*.vtkhdf"))
    on_cpu = run_netfall("run", "job.toml", "--device", "auto", ranks=ranks, cwd=tmp_path)
    assert f"note: --device auto: the CPU is used: {feature}" in on_cpu.stdout + on_cpu.stderr
    assert (tmp_path / "job.vtkhdf").exists()
    study = f'job = "job.toml"\n[vary]\n"cable.prestress" = [2e4]\n[run]\nranks = {ranks}\n'
    (tmp_path / "study.toml").write_text(study)
    refused = run_netfall("study", "study.toml", "--device", "gpu", cwd=tmp_path, code=2)
    assert f"error: --device gpu: not possible with {feature}. " in refused.stderr


WITHOUT_MEMORY = """
import simulated_gpu
simulated_gpu.use()
from netfall.gpu import memory
memory.free_memory = lambda: 1e3  # bytes
from netfall.__main__ import main
main()
"""


@pytest.mark.parametrize("device", ["gpu", "auto"])
def test_a_net_that_does_not_fit_the_device_is_refused(tmp_path, device):
    """One line prints the needed and the free memory."""
    (tmp_path / "job.toml").write_text(JOB)
    line = [sys.executable, "-c", WITHOUT_MEMORY, "run", "job.toml", "--device", device]
    environment = ENVIRONMENT | {"PYTHONPATH": str(ROOT / "tests")}
    done = run_process(*line, cwd=tmp_path, environment=environment, code=2)
    fact = r"error: the net needs [\d.e-]+ GB of the GPU, and 1e-06 GB of it are free. Run with --device cpu"
    assert re.search(fact, done.stderr)
    assert not list(tmp_path.glob("*.vtkhdf"))


def test_a_gpu_gives_no_times_of_parts_of_a_step(tmp_path):
    """A GPU does not measure them: they were zero."""
    (tmp_path / "job.toml").write_text(JOB)
    for device in ("cpu", "gpu"):
        arguments = ("job.toml", "--profile", "--device", device, "-o", f"{device}.vtkhdf")
        run_process(*SIMULATED, "netfall", "run", *arguments, cwd=tmp_path, environment=ENVIRONMENT)
        with h5py.File(tmp_path / f"{device}.vtkhdf") as file:
            assert ("dynamics: positions" in file["provenance/timings"].attrs) == (device == "cpu")


def test_the_comparison_of_devices_prints_no_rate_of_a_failed_study(tmp_path):
    """The study ends with exit code 3."""
    for name, line in {"netfall": '[ "$1" != study ] || exit 3', "python": "exit 0"}.items():
        (tmp_path / name).write_text(f"#!/bin/bash\n{line}\n")
        (tmp_path / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = ["bash", ROOT / "jobs" / "bench" / "gpu.sh"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment)
    assert done.returncode == 3 and "a minute" not in done.stdout, done.stdout


def test_a_missing_extra_is_named_in_one_line(tmp_path):
    """The job is refused before anything is computed."""
    (tmp_path / "job.toml").write_text(JOB)
    done = run_netfall("run", "job.toml", "--device", "gpu", cwd=tmp_path, code=2)
    assert "needs numba-cuda, which is not installed" in done.stderr and "netfall[gpu]" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.long
def test_the_step_compiles_for_a_device_without_products_that_may_be_fused(tmp_path):
    """With the versions of the extra, in an environment of their own; no device is needed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    requirements = [*project["dependencies"], *project["optional-dependencies"]["gpu"]]
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "gpu"], check=True)
    python = tmp_path / "gpu" / "bin" / "python"
    pip = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:"]
    if subprocess.run([*pip, *requirements], timeout=3600).returncode:
        pytest.skip("packages cannot be had here")
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    command = [python, ROOT / "tests" / "gpu_ptx.py", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800, env=environment)
    assert done.returncode == 0, done.stderr
    for report in json.loads(done.stdout).values():
        print(report)
        for factor in report["products"]:  # a product with a power of two is exact, fused or not
            assert re.fullmatch("0d[0-9A-F]{3}0{13}", factor), factor
        assert report["fused"] > 100 and report["spilled"] < 4000
