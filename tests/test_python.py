"""netfall from Python: results by the ids of tables, nets from arrays, ranks started for the user."""

import sys
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import (
    BIN,
    ROOT,
    assert_same_results,
    error_lines,
    on_ranks,
    run_on_standing_ranks,
    run_process,
    standing_runs_of_python,
)

import netfall
from netfall.api import run as api_run
from netfall.core.errors import interruption_error

PAGE = ROOT / "src" / "netfall" / "docs" / "pages" / "tutorials" / "four-cables.md"


def file_of_page(name: str) -> str:
    return PAGE.read_text(encoding="utf-8").split(f'title="{name}"\n')[1].split("```")[0]


def cross(**sections) -> dict:
    """Return the net of the tutorial from arrays: four cables and a weight; ids do not start at 0."""
    return {
        "title": 'Four cables, "crossed"',
        "net": {
            "nodes": np.array([[-10, 0, 2], [10, 0, 2], [0, -10, 0], [0, 10, 0], [0, 0, 0]]),
            "elements": [[1, 5], [2, 5], [3, 5], [4, 5]],
            "fixed": np.array([True] * 4 + [False]),
            "groups": ["hanging"] * 2 + ["bracing"] * 2,
            "node_id": np.arange(1, 6),
            "element_id": [1, 2, 13, 14],
            "node_columns": {"mass": [0.0] * 4 + [1000.0], "load_z": [0.0] * 4 + [-10e3]},
        },
        "cable": {"modulus": 1.6e11, "area": np.float64(500e-6), "density": 7850.0, "prestress": 100e3},
        "form_finding": {"modulus_factor": 0},
        "load": {"steps": 0, "self_weight": False},
        "dynamics": {"duration": 0.2},
        "output": {"frames": 40, "probes": [[0.0, 0.0]]},
        **sections,
    }


@pytest.fixture
def standing():
    with standing_runs_of_python():
        yield


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_importing_netfall_loads_neither_compiler_nor_mpi():
    heavy = "numba, mpi4py, numpy, h5py, matplotlib"
    text = f"import netfall, sys; dir(netfall); print([n for n in '{heavy}'.split(', ') if n in sys.modules])"
    done = run_process(BIN / "python", "-c", text)
    assert done.stdout.strip() == "[]", done.stderr


def test_the_names_of_the_interface_are_listed():
    """An interpreter completes `netfall.` to names that are not imported yet, and to no others."""
    assert dir(netfall) == sorted([*netfall.__all__, "__version__"])


def test_a_net_from_arrays_moves_and_breaks_as_in_the_tutorial(here, standing):
    """Histories by id agree with the hand calculation, also the state after the fracture. Numbers are ids."""
    with netfall.run(cross()) as swing:
        z = swing.displacement(node=5)[:, 2]  # from the form; in equilibrium under the weight twice 0.02815 m
        assert z.min() == pytest.approx(-0.0563, abs=2e-4)  # the frame nearest to the lowest point
        assert swing.tension(element=1)[0] == pytest.approx(100e3, rel=1e-6)
        assert (swing.tension(element=1) == swing.tension(element=[13, 1])[:, 1]).all()
        assert swing.history["kinetic_energy"][0] < swing.history["kinetic_energy"].max()
        assert not hasattr(swing, "wind") and swing.elements["group"].tolist()[2:] == ["bracing"] * 2
        assert swing.nodes["id"].tolist() == [1, 2, 3, 4, 5]
        assert swing.elements["end"].tolist() == [5] * 4
        with pytest.raises(AttributeError, match=r"the job has no \[\[case\]\] or \[\[combination\]\]"):
            print(swing.cases)
        with pytest.raises(KeyError, match=r"element 3: .* 1 to 14"):
            swing.tension(element=3)
        with pytest.raises(TypeError, match="element '1': expected an id, which is a whole number"):
            swing.tension(element="1")
        with pytest.raises(KeyError, match="did you mean"):
            swing.history["kinetic_enegy"]
        place = swing.path
        assert place.exists()
    assert not place.parent.exists()  # temporary files are removed
    with netfall.run(cross(), {"cable.fracture_strain": 0.0017}) as broken:
        assert broken.events["time"][:2] == pytest.approx([0.1211] * 2, abs=5e-5)
        assert broken.events["element"][:2].tolist() == [1, 2]
        state = broken.frame(0.2)
        assert state.broken[:2].all() and state.element.tolist() == [1, 2, 13, 14]
        new = state.ends[0][state.ends[0] >= 5]  # the point that split off, from the weight or a support
        assert len(new) == 1 and state.node[new[0]] in (1, 5) and len(state.position) == len(state.node)
        assert state.tension == pytest.approx(broken.file["final/tension"][:], rel=1e-6)  # single precision
        length = np.linalg.norm(np.diff(state.position[state.ends], axis=1)[:, 0], axis=1)
        expected = (length - broken.elements["unstressed_length"]) / broken.elements["unstressed_length"]
        assert state.strain == pytest.approx(expected, abs=1e-6)  # single precision
        with pytest.raises(netfall.InputError, match=r"0 to 0\.2 s"):
            broken.frame(4.2)


def test_started_ranks_give_the_bits_of_the_command(here):
    job = cross()
    netfall.run(job, output="one.vtkhdf").close()
    netfall.run(job, ranks=2, output="two.vtkhdf").close()
    for name in ("cross.toml", "nodes.csv", "elements.csv"):
        text = file_of_page(name)
        (here / name).write_text(text.replace("\n3, 3", "\n13, 3").replace("\n4, 4, 5, b", "\n14, 4, 5, b"))
    settings = ["load.steps=0", "dynamics.duration=0.2", "output.frames=40"]
    options = [word for setting in settings for word in ("--set", setting)]
    run_on_standing_ranks("run", "cross.toml", *options, "-o", "command.vtkhdf", cwd=here)
    with h5py.File("one.vtkhdf") as one:
        for other in ("two.vtkhdf", "command.vtkhdf"):
            with h5py.File(other) as file:
                assert_same_results(one, file)
    assert [path.name for path in here.iterdir() if path.name.startswith(".netfall")] == []


def test_paths_of_a_dict_are_relative_to_the_working_directory(here, standing):
    """Also paths of cases. A file with the name of a case or group does not matter."""
    (here / "rig.csv").write_text("node,load_z\n5,-2e3\n")
    for name in ("rig", "hanging"):
        (here / name).touch()
    job = cross(dynamics={"duration": 0.01}, case=[{"name": "rig", "load_table": "rig.csv"}])
    with netfall.run(job | {"group": {"hanging": {"area": 500e-6}}}) as result:
        assert result.cases["rig"]["load"][4, 2] == -12e3


@pytest.mark.parametrize("ranks", [1, 2])
def test_errors_of_the_command_are_raised(here, ranks):
    wrong = {"cable.modulos": 1.0, "cable.area": "thick"}
    assert error_lines(netfall.run, cross(), wrong, ranks=ranks) == [
        'job: [cable] area = "thick": expected a number from 1e-12 to 10000 m2 [E126]',
        'job: [cable] modulos: unknown key; did you mean "modulus"? [E125]',
    ]
    with pytest.raises(netfall.DivergedError, match="form finding"):
        pulled = {"element_columns": {"prestress": [4e5, 1e5, 1e5, 1e5]}}  # to the first support
        netfall.run(cross(net=cross()["net"] | pulled), ranks=ranks)
    with pytest.raises(netfall.InputError, match=r"fixed has the shape \(3,\) of int64: expected \(5,\)"):
        netfall.run(cross() | {"net": cross()["net"] | {"fixed": [1, 1, 0]}}, ranks=ranks)


def test_a_script_under_mpirun_is_refused(here):
    """Each rank would start the whole run."""
    script = "import netfall\ntry: netfall.run('a.toml')\nexcept netfall.InputError as error: print(error)"
    done = run_process(*on_ranks(2), sys.executable, "-c", script, cwd=here)
    assert done.stdout.count("netfall.run: starts the ranks of a run itself") == 2


SPEEDS = "t = 2 s: speeds without bound"
diverged = netfall.DivergedError(f"{SPEEDS} [E642]")
diverged.checkpoint = Path("{}")
STOPS = [
    (
        interruption_error("at t = 1 s", Path("{}")),
        "note: interrupted. Give output to keep a checkpoint [N069]",
    ),
    (diverged, f"{SPEEDS}. [E642]"),
]


@pytest.mark.parametrize("error, text", STOPS)
def test_no_message_names_a_removed_checkpoint(here, monkeypatch, error, text):
    """Without output, messages do not name checkpoints, because their folder is removed with the run."""

    def command(launcher, ranks, job, output, *settings, module):
        message = str(error).format(*[output.with_suffix(".checkpoint-5-000000009200.h5")] * 2)
        code = f"import sys; print({message!r}, file=sys.stderr); sys.exit({error.exit_code})"
        return [sys.executable, "-c", code]

    monkeypatch.setattr(api_run, "run_command", command)
    with pytest.raises(type(error)) as raised:
        netfall.run("my roof.toml")
    assert str(raised.value) == text and "--restart" in str(error)


def test_an_empty_list_of_ids_has_no_tensions_and_a_closed_result_is_named(here, standing):
    """An empty list of ids gives (f, 0). A closed result names this reason, not a section of the job."""
    result = netfall.run(cross(), output="r.vtkhdf")
    frames = len(result.time)
    assert result.tension(element=[]).shape == (frames, 0)
    assert result.displacement(node=[]).shape == (frames, 0, 3)
    tables = result.nodes, result.history
    result.close()
    for ask in (
        lambda: result.statics,
        lambda: hasattr(result, "wind"),
        lambda: result.tension(element=1),
        lambda: result.time,
        lambda: result.frame(0.1),
        lambda: result.title,
        lambda: tables[0]["x"],
    ):
        with pytest.raises(ValueError, match=r"this result is closed; netfall.open\('r.vtkhdf'\) opens it"):
            ask()
    with pytest.raises(ValueError, match="kinetic_energy: the result is closed"):
        tables[1]["kinetic_energy"]
    assert repr(result) == "Result r.vtkhdf, closed"
    brief = netfall.run(cross(), {"dynamics.duration": 0.01})
    brief.close()
    with pytest.raises(ValueError, match=r"its file was temporary\. Run the job with an output to keep it"):
        brief.statics  # noqa: B018


ARRAYS = {"nodes": np.zeros((3, 3)), "elements": [[0, 1], [1, 2]]}


def masked(values):
    """Return an array whose first row is masked."""
    array = np.ma.masked_array(values, mask=False)
    array[0] = np.ma.masked
    return array


ROWS = "expected an array, whose rows have the"
WRONG = [  # arrays of a net and the error
    ({"nodes": [[0, 0, 0], [1, 0]], "elements": [[0, 1]]}, f"Net: nodes: {ROWS}"),
    ({"nodes": np.eye(3), "elements": [[0, 1], [2]]}, f"Net: elements: {ROWS}"),
    ({"node_columns": {"load_z": np.array([0, np.nan, 0])}}, "'load_z': nan in row 1: expected a number"),
    ({"node_columns": {"load_z": [0.0, np.nan, None]}}, "'load_z': nan in row 1: expected a number"),
    ({"groups": ["a", "a\nb"]}, r"groups 'group': 'a\\nb' in row 1: expected one line"),
    ({"nodes": masked(np.zeros((3, 3)))}, "Net: nodes has the shape .* of object"),
    ({"elements": masked([[0, 1], [1, 2]])}, "Net: elements has the shape .* of object"),
    ({"fixed": masked(np.zeros(3, int))}, "Net: fixed has the shape .* of object"),
    ({"groups": "a", "element_columns": {"group": "b"}}, "element_columns 'group': would replace groups"),
]


@pytest.mark.parametrize("arrays, message", WRONG)
def test_wrong_arrays_of_a_net_are_refused(arrays, message):
    """Rows of several lengths, nan, which a table refuses too, a line break, masked values of arrays."""
    net = netfall.Net(**ARRAYS | arrays)
    with pytest.raises(netfall.InputError, match=message):
        net.node_table(), net.element_table()


def test_empty_and_masked_cells_of_a_net_are_empty():
    """None is an empty cell, as the default; the value behind the mask of a numpy array is not used."""
    for loads in ([0.0, None, 1.0], np.ma.masked_array([0.0, 9e9, 1.0], mask=[False, True, False])):
        table = netfall.Net(**ARRAYS, node_columns={"load_z": loads}).node_table()
        assert table["load_z"].tolist() == [0.0, None, 1.0]
    with pytest.raises(netfall.InputError, match=r"nodes without elements\. Give both"):
        netfall.run({"net": {"nodes": np.zeros((2, 3))}})


def test_columns_do_not_replace_the_arrays_of_a_net():
    """A column cannot repeat nodes, elements, fixed, groups or ids; one error names all."""
    arrays = {"nodes": np.zeros((2, 3)), "elements": [[0, 1]], "groups": "a"}
    columns = {"id": [5, 6], " X": 1.0, "fixed_z": 1, "mass": 2.0}
    assert error_lines(lambda: netfall.Net(**arrays, node_columns=columns).node_table()) == [
        "Net: node_columns 'id': would replace node_id. Give it as node_id. [E065]",
        "Net: node_columns ' X': would replace nodes. Give it as nodes. [E065]",
        "Net: node_columns 'fixed_z': would replace fixed. Give it as fixed. [E065]",
    ]
    plain = netfall.Net(nodes=np.zeros((2, 3)), elements=[[0, 1]], element_columns={"group": "b"})
    assert plain.element_table()["group"].tolist() == ["b"]


def test_warnings_of_a_run_are_warnings_of_python(here, standing):
    """A case without an equilibrium does not end the run, so its forces need a warning."""
    job = cross(case=[{"name": "cold", "set": {"load.temperature": -100.0}}])
    job |= {
        "cable": job["cable"] | {"breaking_load": 1.5e5},
        "load": {"stop_at_strength": True, "self_weight": False},
    }
    del job["dynamics"], job["output"]
    with pytest.warns(UserWarning, match=r"^case cold: no equilibrium.* \[W\d+\]$"):
        result = netfall.run(job)
    assert result.file["cases/cold"].attrs["state"] == "no_equilibrium"
    assert any(line.startswith("warning: case cold: no equilibrium") for line in result.warnings)
    result.close()
    with warnings.catch_warnings(action="error"), pytest.raises(UserWarning, match="no equilibrium"):
        netfall.run(job)
    assert not [*here.glob(".netfall-*")]
    with warnings.catch_warnings(record=True) as repeated:
        netfall.run(job, quiet=False).close()
    assert not repeated


def test_paths_in_overrides_of_a_dict_are_relative_to_the_working_directory(here, standing):
    """Like those in the dict, although the job file is in another folder."""
    (here / "lamp.csv").write_text("node,load_z\n5,-500\n")
    job = cross(load={"steps": 1, "self_weight": False})
    del job["dynamics"], job["output"]
    lower = []
    for table, overrides in ({"load_table": "lamp.csv"}, {}), ({}, {"load.load_table": "lamp.csv"}), ({}, {}):
        with netfall.run(job | {"load": job["load"] | table}, overrides) as result:
            lower.append(result.statics["displacement"][-1, 4, 2])
    assert lower[0] == lower[1] < lower[2]


def test_a_key_of_a_dict_has_a_value_and_a_file(here):
    """None is refused with its key, also in an entry. The message of a missing file names the folder."""
    for wrong, place in (
        ({"load": {"snow": None}}, "[load] snow = None:"),
        ({"title": None}, "title = None:"),
        ({"case": [{"name": "s", "set": {"load.snow": None}}]}, "[[case]] set.load.snow = None:"),
    ):
        with pytest.raises(netfall.InputError) as raised:
            netfall.run(cross(**wrong))
        assert raised.value.lines[0].startswith(f"{place} a job cannot hold a NoneType.")
    with pytest.raises(netfall.InputError, match=r"none\.csv: No such.*in a dict to the working"):
        netfall.run(cross(load={"load_table": "none.csv"}))


def test_keys_of_a_dict_may_be_ids(here, standing):
    """An array moves a support like a list does."""
    down = np.array([0.0, 0.0, -0.05])
    job = cross(case=[{"name": "sinks", "settlement": {np.int64(1): down, 2: down}}])
    del job["dynamics"], job["output"]
    with netfall.run(job) as result:
        assert result.cases["sinks"]["displacement"][:2] == pytest.approx(np.array([down, down]))
