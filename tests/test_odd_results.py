"""Every command that reads results, on every kind of result: an answer, or one line on missing data."""

import inspect
from pathlib import Path

import h5py
import pytest
from conftest import BARE, ROOT, STEEL, run_on_standing_ranks
from matplotlib.figure import Figure

import netfall
from netfall.core.errors import InputError
from netfall.post.plots.run import PICTURES, draw_pictures
from netfall.results.reader import Result

SADDLE = '[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 4\n' + STEEL
BREAKS = SADDLE + "yield_stress = 1.75e9\nfracture_strain = 0.0404\n"
FOUND = '[form_finding]\nmethod = "force_density"\n'
LOADED = "[load]\nself_weight = false\nsnow = 300.0\n"
SHORT = "[dynamics]\nduration = 0.02\n"
WIND = '[wind]\nspeed = 20.0\npressure_coefficient = -1.0\nbase_height = 10.0\nonset = "sudden"\n'
WIND += "surface_drag = 0.0\n"
LOST = "[[remove]]\nelements = [ELEMENT]\ntime = 0.005\n"
TRIPOD = "id,x,y,z,fixed\n1,0,0,0,1\n2,6,0,0,1\n3,3,5,0,1\n4,3,2,3,0\n"
LEGS = "id,start,end\n1,1,4\n2,2,4\n3,3,4\n"
BARS = STEEL.replace("prestress = 100e3", 'kind = "bar"') + "[load]\nself_weight = true\nsteps = 1\n"
ROPE = "id,x,y,z,fixed\n1,0,0,0,1\n2,0,0,-5,0\n", "id,start,end\n1,1,2\n"
HANGS = BARE + "[load]\nself_weight = true\n"

# Name: the job, and its tables where it has some.
JOBS = {
    "net alone": (SADDLE,),
    "form alone": (SADDLE + FOUND,),
    "statics alone": (SADDLE + LOADED + "steps = 2\n",),
    "dynamics alone": (SADDLE + SHORT,),
    "modes": (SADDLE + FOUND + "[modes]\ncount = 3\n",),
    "cases alone": (SADDLE + FOUND + LOADED + '[[case]]\nname = "a b"\nset = {"load.snow" = 500.0}\n',),
    "two losses, the second of nothing more": (
        SADDLE + FOUND + LOADED + SHORT + LOST.replace("ELEMENT", "3") + LOST.replace("ELEMENT", "4"),
    ),
    "wind, nothing that breaks": (SADDLE + FOUND + WIND + SHORT,),
    "all slack, in motion": (SADDLE + FOUND + "[load]\nself_weight = false\ntemperature = 300.0\n" + SHORT,),
    "no tension anywhere": (SADDLE.replace("100e3", "0.0") + SHORT,),
    "all breaks": (
        BREAKS + FOUND + WIND.replace("20.0", "200.0").replace("-1.0", "-9.0") + SHORT.replace("0.02", "0.5"),
    ),
    "one element": (HANGS + "steps = 1\n" + SHORT, *ROPE),
    "one element, lost": (HANGS + SHORT + LOST.replace("ELEMENT", "1"), *ROPE),
    "compressed bars in motion": (BARS + SHORT, TRIPOD, LEGS),
    "compressed bars with a strength": (BARS.replace("[load]", "breaking_load = 1e6\n[load]"), TRIPOD, LEGS),
    "a history of one row": (SADDLE + FOUND + SHORT.replace("0.02", "0.001"),),
    "no audit": (BREAKS + FOUND + WIND + SHORT + "[output]\nenergy = false\n",),
    "all slack": (SADDLE + FOUND + "[load]\nself_weight = false\ntemperature = 300.0\nsteps = 1\n",),
    "one element that breaks": (HANGS + "[dynamics]\nduration = 0.05\n", *ROPE),
    "compressed bars alone": (BARS, TRIPOD, LEGS),
    "probes, at rest without a load": (
        SADDLE + FOUND + SHORT + "[output]\nprobes = [[0.0, 0.0]]\nelements = [3]\nframes = 1\n",
    ),
}
ALWAYS = ("olympia", "saddle")  # of the shipped jobs
SUFFIXES = ("", ".csv", ".dxf", ".json", ".tcl", ".vtu")


def answers(*arguments, cwd) -> str:
    """Return netfall's answer to a command, or a line for each missing thing if it cannot run it."""
    done = run_on_standing_ranks(*arguments, cwd=cwd, code=None)
    assert done.returncode in (0, 2), (arguments, done.returncode, done.stderr[-500:])
    assert "Traceback" not in done.stderr and "rank 0" not in done.stderr, (arguments, done.stderr)
    if done.returncode == 2:
        lines = done.stderr.strip().splitlines()
        assert lines and all(len(line) > 30 and ": " in line for line in lines), (arguments, done.stderr)
    else:
        assert done.stdout.strip() and not done.stderr, (arguments, done.stderr)
    return done.stdout + done.stderr


def draw_what_a_report_lacks(path, folder) -> None:
    """The other pictures, as far as their pixels."""
    with pytest.MonkeyPatch.context() as patch, h5py.File(path) as f:
        patch.setattr(Figure, "savefig", lambda _, place, **__: Path(place).touch())
        draw_pictures(f, folder, "", *(PICTURES.keys() - {"form", "stages", "states"}))


def goes_through_everything(path, folder) -> None:
    """info, report, export to every ending, and all that Python reads."""
    assert "nan" not in answers("info", path, cwd=folder)
    report = answers("report", path, "-o", folder / "report", cwd=folder)
    assert "summary.md" in report and "utilisation.png" in report
    answers("view", path, "-o", folder / "page.html", cwd=folder)
    for suffix in SUFFIXES:
        answers("export", path, "-o", folder / f"exported{suffix}", cwd=folder)
    read_all(path)


def read_all(path) -> None:
    """Read every property and method of a result. Errors of missing data name the missing part of the job."""
    with netfall.open(path) as result:
        for name in (name for name, _ in inspect.getmembers(Result)):
            if name.startswith("_") or name in ("close", "rest"):  # rest: an old name
                continue
            try:
                value = getattr(result, name)
                if callable(value):
                    required = [
                        p for p in inspect.signature(value).parameters.values() if p.default is p.empty
                    ]
                    value = value(*[0.0 for _ in required])
                repr(value)
            except (AttributeError, InputError) as error:
                assert len(str(error)) > 30 and "object has no attribute" not in str(error), (name, error)


@pytest.mark.parametrize("name", JOBS)
def test_every_odd_result_is_answered(workshop, name):
    text, *tables = JOBS[name]
    workshop.solve(text, *tables).close()
    goes_through_everything(workshop.folder / "result.vtkhdf", workshop.folder)
    draw_what_a_report_lacks(workshop.folder / "result.vtkhdf", workshop.folder)


SHIPPED = sorted((ROOT / "jobs").glob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_job_is_answered(path, tmp_path, request):
    """The first instants of its dynamic stage, if it has one; the smallest always, the others with --long."""
    if path.stem not in ALWAYS and not request.config.getoption("--long"):
        pytest.skip("takes minutes; --long runs it")
    dynamic = "[dynamics]" in path.read_text()
    short = ("--set", "dynamics.duration=0.05", "--set", "output.frames=2") if dynamic else ()
    result = tmp_path / "result.vtkhdf"
    run_on_standing_ranks("run", path, *short, "-o", result, "--quiet", cwd=tmp_path)
    goes_through_everything(result, tmp_path)
    answers("plot", result, "-o", tmp_path / "pictures", cwd=tmp_path)
    if dynamic:
        animated = answers("plot", result, "--animate", "--format", "gif", "-o", tmp_path, cwd=tmp_path)
        assert "result_collapse.gif" in animated


def test_other_files_are_refused_as_results(workshop):
    """A partial file, a truncated file, a text, other HDF5 and nothing give one line each, code 2."""
    job = workshop.job(SADDLE + FOUND + WIND + SHORT + "[output]\ncheckpoint_interval = 0.01\nframes = 4\n")
    workshop.run(job, "--walltime", "00:00:00", code=4)
    places = {path.suffix or path.name: path for path in workshop.folder.iterdir() if path != job}
    (checkpoint,) = (path for path in places.values() if "checkpoint" in path.name)
    (segment,) = (path for path in places.values() if "segment" in path.name)
    with workshop.run(job, output="whole.vtkhdf") as file:
        whole = file.filename
    odd = {"checkpoint": checkpoint, "segment": segment}
    for name, content in (("cut", Path(whole).read_bytes()[:4000]), ("empty", b""), ("text", b"a,b\n1,2\n")):
        odd[name] = workshop.folder / f"{name}.vtkhdf"
        odd[name].write_bytes(content)
    odd["other"] = workshop.folder / "other.vtkhdf"
    h5py.File(odd["other"], "w").close()
    odd |= {"missing": workshop.folder / "missing.vtkhdf", "folder": workshop.folder, "job": job}
    files = {*workshop.folder.rglob("*")}
    for path in odd.values():
        for command in ("info", "plot", "view", "report", "export"):
            new = workshop.folder / ("new.html" if command == "view" else "new")
            more = () if command == "info" else ("-o", new)
            done = run_on_standing_ranks(command, path, *more, cwd=workshop.folder, code=2)
            assert len(done.stderr.strip().splitlines()) == 1 and str(path) in done.stderr, done.stderr
        with pytest.raises(InputError, match=str(path)):
            netfall.open(path)
    assert {*workshop.folder.rglob("*")} == files  # and nothing was written


def test_the_file_of_a_run_without_an_equilibrium_records_it(workshop):
    text = HANGS.replace("density = 7850.0", "density = 7850.0\nbreaking_load = 10.0")
    done = workshop.solve(text + "steps = 1\nstop_at_strength = true\n", *ROPE, code=3)
    assert "element 1 breaks" in done.stderr
    (file,) = workshop.folder.glob("*.vtkhdf")
    with h5py.File(file) as f:
        attrs = f["statics"].attrs
        assert attrs["state"] == "no_equilibrium" and attrs["elements"].tolist() == [1]
