"""Results for other programs contain the data of the result file."""

import json
import tomllib

import ezdxf
import numpy as np
import pytest
from conftest import ROOT, run_on_standing_ranks
from nets import table
from results import contents
from results import rows_of as rows
from test_python import cross
from test_validation_opensees import shipped, tensions_in_opensees

import netfall
from netfall.api.run import _job_file
from netfall.core.errors import InputError
from netfall.exchange.drawings.importing import import_file
from netfall.exchange.drawings.reading import ImportOptions, read_net
from netfall.exchange.export import export

# Digits of a number that a text holds in full.
EXACT = 1e-15
FLAT = {"area": 1.0, "normal_x": 0.0, "normal_y": 0.0, "normal_z": 1.0}


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """Return the four cables of the tutorial, some of which break; each element is half a cable."""
    path = tmp_path_factory.mktemp("export") / "cross.vtkhdf"
    more = [w for each in ("cable.fracture_strain=0.0017", "net.subdivide=2") for w in ("--set", each)]
    run(cross(load={"self_weight": True}), path, *more)
    return path


def run(job, output, *settings, code=0):
    """Run a job, a file or a dict, in this process."""
    if isinstance(job, dict):
        (folder := output.with_suffix(".job")).mkdir()
        job = _job_file(job, folder)
    run_on_standing_ranks("run", job, "-o", output, "--quiet", *settings, cwd=output.parent, code=code)


def written(result, target, time=None, case=None, unit="m"):
    """Return the output of `export`; the file is at `target`."""
    lines = []
    export(result, target, lines.append, time, case, unit)
    return lines


def written_and_again(job, folder, name="r") -> list[str]:
    """Run a job and its exported tables; return the output of the export."""
    run(job, folder / "r.vtkhdf")
    lines = written(folder / "r.vtkhdf", folder / name)
    run(folder / name / "job.toml", folder / "again.vtkhdf")
    return lines


def test_a_net_whose_faces_are_cut_by_zones_is_exported_without_a_job(tmp_path):
    """nodes.csv has shares of nodes, under which faces of other directions would have other loads."""
    zone = {"name": "corner", "polygon": [[0, 0], [9, 0], [9, 9], [0, 9]]}
    run(FORMED | {"zone": [zone], "load": LOADS}, tmp_path / "c.vtkhdf")
    lines = written(tmp_path / "c.vtkhdf", tmp_path / "a.csv")
    assert any("job.toml: not written: faces at a node have zones" in line for line in lines)


def test_polygons_that_cut_faces_as_given_are_those_of_the_exported_job(tmp_path):
    """The same faces have the same zones again. Each of the overlapping zones has its own pressure."""
    zones = [{"name": "a", "polygon": [[-2, -2], [9, -3], [9, 9], [-1, 9]]}, {"name": "b", "groups": ["y"]}]
    zones += [{"name": "c", "polygon": [[1, 1], [5, 1], [5, 4]]}, {"name": "far", "polygon": FAR}]
    load = LOADS | {"zone": {name: {"pressure": 900.0 * k} for k, name in enumerate("abc")}}
    written_and_again({"net": SADDLE, "cable": STEEL, "zone": zones, "load": load}, tmp_path)
    first, again = both(tmp_path, "statics", "net")
    for name in ("statics/displacement", "net/zone_share", "net/zone_names"):
        assert np.array_equal(first[name], again[name]), name


def both(folder, *groups):
    """Return the datasets of some groups of the results of `written_and_again`."""
    return [values_of(folder / f"{name}.vtkhdf", groups) for name in ("r", "again")]


def test_a_limit_of_a_group_is_not_taken_for_a_file(tmp_path):
    """[limits.group.NAME] displacement has a unit: no file is missing, and the exported job keeps it."""
    limits = {"displacement": "span/40", "span": 4.0, "group": {"*": {"displacement": "0.3 m"}}}
    run(cross(limits=limits, load={"self_weight": True}), tmp_path / "c.vtkhdf")
    assert not any("W762" in line for line in written(tmp_path / "c.vtkhdf", tmp_path / "a.csv"))
    assert 'displacement = "0.3 m"' in (tmp_path / "a.csv" / "job.toml").read_text()


def test_a_table_that_changed_after_the_run_is_a_warning(tmp_path):
    """The exported job then does not repeat the run."""
    table = tmp_path / "lamp.csv"
    table.write_text("node,load_z\n5,-500\n")
    run(cross(load={"self_weight": True, "load_table": str(table)}), tmp_path / "c.vtkhdf")
    output = "\n".join(written(tmp_path / "c.vtkhdf", tmp_path / "a.csv"))
    assert "lamp.csv: copied from" in output and "W764" not in output
    table.write_text("node,load_z\n5,-900\n")
    assert any("[W764]" in line for line in written(tmp_path / "c.vtkhdf", tmp_path / "b.csv"))


def test_exported_tables_give_the_same_net(broken, tmp_path):
    """The form and its tensions follow from the tables through the prestress. Ids are unique."""
    written(broken, tmp_path / "t.csv")
    job = {"net": {name: str(tmp_path / f"t.csv/{name}.csv") for name in ("nodes", "elements")}}
    job |= {"cable": cross()["cable"], "load": {"self_weight": True, "steps": 1}}
    run(job, tmp_path / "again.vtkhdf")
    with netfall.open(tmp_path / "again.vtkhdf") as again, netfall.open(broken) as result:
        assert again.nodes["x"] == pytest.approx(result.form_finding["position"][:, 0], abs=EXACT)
        free = result.form_finding["unstressed_length"]
        assert again.elements["unstressed_length"] == pytest.approx(free, rel=3 * EXACT)
        assert len(set(again.elements["id"])) == 8 and len(set(result.elements["id"])) == 4
        table = rows(tmp_path / "t.csv" / "history.csv")
        assert [float(row["kinetic_energy"]) for row in table] == result.history["kinetic_energy"].tolist()
        assert float(table[-1]["displacement_z of node 5"]) == result.history["probe_displacement"][-1, 0, 2]
        events = rows(tmp_path / "t.csv" / "events.csv")
        assert [int(row["element"]) for row in events] == result.events["element"].tolist() != []


STEEL = {"modulus": 1.6e11, "area": 5e-4, "density": 7850.0, "prestress": 5e4}
EMPTY = None
TABLES = {  # a net that has a value in every column, some of them in some rows alone
    "nodes": np.array([[-10, 0, 2], [10, 0, 2], [0, -10, 0], [0, 10, 0], [0, 0, 0.3], [5, 5, 0.5]]),
    "elements": [[1, 5], [2, 5], [3, 5], [4, 5], [5, 6], [6, 2], [6, 4]],
    "fixed": np.array([True] * 3 + [False] * 3),
    "groups": ["up", "up", "low", "low", "link", "strut", "up"],
    "node_id": np.arange(1, 7),
    "element_id": [1, 2, 13, 14, 15, 16, 17],
    "node_columns": {
        "mass": [0, 0, 0, 0, 1000.0, 20.0],
        "load_x": [0, 0, 0, 0, 10.0, 0],
        "load_z": [0, 0, 0, 0, -1e4, -1e3],
        "area": [EMPTY, EMPTY, 0, 0, 7.0, 5.0],
        "normal_x": [0, 0, 0, 0, 0.1, 0.3],
        "normal_y": [0, 0, 0, 0, 0.2, 0.3],
        "normal_z": [1, 1, 1, 1, 1, 0.9],
        **{f"spring_{k}": [0, 0, 0, stiffness, 0, 0] for k, stiffness in zip("xyz", (3e6, 2e6, 1e6))},
        "zone": ["", "", "", "east", "east", "west"],
    },
    "element_columns": {
        "area": [5e-4, EMPTY, 6e-4, 5e-4, 5e-4, 1e-3, 5e-4],
        "modulus": [EMPTY, 1.5e11] + [EMPTY] * 5,
        "breaking_load": [4e5, 5e5, 6e5, 7e5] + [EMPTY] * 3,
        "yield_stress": [EMPTY] * 4 + [9e8] + [EMPTY] * 2,
        "cable": ["A", "A", "", "", "B", "", ""],
        "prestress": [1e5, 1e5, 9e4, 9e4, 5e4, -2e3, 4e4],
    },
}
IN_ZONES = {
    "zone": ["left", "", "left/front", "left", "left/front", "front"],
    "zone_share": ["", "", "0.5/0.25", 0.5, "0.25/0.25", 0.3],
}
SECTIONS = STEEL | {"thermal_expansion": 1.5e-5, "strength_cov": 0.1}
GROUPS = {
    "strut": {"kind": "bar", "thermal_expansion": 1e-5},
    "low": {"density": 8000.0, "fracture_strain": 0.03},
}
LOADS = {"snow": 300.0, "pressure": 100.0, "self_weight": True, "steps": 1, "temperature": -15.0}
FAR = [[90, 90], [91, 90], [91, 91]]
SADDLE = {"generator": "saddle", "saddle": {"side": 20.0, "rise": 3.0, "cells": 6}}
POLYGONS = [
    {"name": "corner", "polygon": [[0, 0], [10, 0], [10, 10], [0, 10]], "cut": False},
]
IN_FULL = {"net": TABLES, "cable": SECTIONS, "group": GROUPS, "load": LOADS}
FORMED = {"net": SADDLE, "cable": STEEL, "form_finding": {}}
AGAIN = {
    "every column": IN_FULL | {"form_finding": {}},
    "logarithmic": IN_FULL | {"cable": SECTIONS | {"strain_measure": "logarithmic"}},
    "warm, as given": IN_FULL | {"load": LOADS | {"temperature": 30.0}},
    "corners and zones": FORMED | {"zone": POLYGONS, "load": LOADS | {"zone": {"corner": {"snow": 900.0}}}},
    "shares of zones": IN_FULL  # of a node that two of them share a zone that has it whole takes the rest
    | {
        "net": TABLES | {"node_columns": TABLES["node_columns"] | IN_ZONES},
        "zone": [
            {"name": "all", "polygon": [[-20, -20], [20, -20], [20, 20], [-20, 20]], "cut": False},
            {"name": "left"},
            {"name": "front"},
        ],
        "load": LOADS | {"zone": {"all": {"snow": 700.0}, "left": {"snow": 900.0}, "front": {"dead": 50.0}}},
    },
    "errors of length, lost in motion": {
        "net": TABLES | {"node_columns": TABLES["node_columns"] | {"zone": ""}},
        "cable": SECTIONS | {"length_std": 0.002},
        "group": GROUPS | {"strut": GROUPS["strut"] | {"second_moment": 1e-6}},
        "form_finding": {},
        "load": {"self_weight": True},
        "dynamics": {"duration": 0.05, "fragments": False},
        "output": {"probes": [[0.0, 0.0], 6], "elements": [13], "frames": 2},
        "remove": [{"elements": [2], "time": 0.01}, {"cables": ["B"], "time": 0.02}],
    },
}


def values_of(path, groups):
    """Return the datasets of some groups of a result by their names."""
    with netfall.open(path) as result:
        names = (
            (group, name) for group in groups if group in result.file for name in contents(result.file[group])
        )
        return {f"{group}/{name}": result.file[group][name][()] for group, name in names if "@" not in name}


@pytest.mark.parametrize("name", AGAIN)
def test_a_run_of_exported_tables_has_the_same_net_and_bits(tmp_path, name):
    """Columns, areas, strengths and equilibria are equal. A second export has equal files."""
    written_and_again(AGAIN[name], tmp_path, "a")
    written(tmp_path / "again.vtkhdf", tmp_path / "b")
    files = sorted(path.name for path in (tmp_path / "a").iterdir() if path.name != "README.txt")
    assert {"nodes.csv", "elements.csv", "job.toml"} < set(files)
    for file in files:
        if file != "history.csv":  # names elements by their ids, of which parts have got their own
            assert (tmp_path / "b" / file).read_bytes() == (tmp_path / "a" / file).read_bytes(), file
    groups = ("net", "statics", "cases", "initial_state", "removal", "final", "envelope")
    first, again = both(tmp_path, *groups)
    assert first.keys() == again.keys()
    moved = {"net/particles", "net/element_id", "net/zone_names", "removal/element"}  # the form; parts' ids
    moved.add("net/buckling_length")  # without effect for cables; for bars see /net/euler_load
    for key in first.keys() - moved:
        assert np.array_equal(first[key], again[key], equal_nan=first[key].dtype.kind == "f"), key
    if "output" in AGAIN[name]:
        exported = tomllib.loads((tmp_path / "a" / "job.toml").read_text())
        assert list(exported["output"]) == list(AGAIN[name]["output"])  # keys keep their order
    if name == "every column":
        table = {row["id"]: row for row in rows(tmp_path / "a" / "elements.csv")}
        words = [table["13"][name] for name in ("start", "end", "group", "kind", "cable", "area", "modulus")]
        assert words == ["3", "5", "low", "cable", "e13", "0.0006", "160000000000.0"]
        words = [table["13"][name] for name in ("density", "expansion", "yield_stress", "breaking_load")]
        assert words == ["8000.0", "1.5e-05", "", "600000.0"]
        node = {row["id"]: row for row in rows(tmp_path / "a" / "nodes.csv")}["5"]
        assert (node["mass"], node["load_x"], node["area"], node["zone"]) == ("1000.0", "10.0", "7.0", "east")


def test_exports_omit_elements_that_a_stage_removed(tmp_path):
    """Model, drawing and Graph lack the stay. The tables have the random strengths, and no job."""
    first = {"elements": [1, 4], "groups": "stay", "element_id": 9}
    net = TABLES | {name: [value, *TABLES[name]] for name, value in first.items()}
    first = {"cable": "", "prestress": 2e3}
    net["element_columns"] = {k: [first.get(k, EMPTY), *v] for k, v in TABLES["element_columns"].items()}
    job = {"net": net, "cable": SECTIONS, "form_finding": {}, "load": LOADS}
    job["group"] = GROUPS | {"stay": {"area": 2e-4}}
    job["stage"] = [{"name": "struck", "active": ["up", "low", "link", "strut"]}]
    run(job, tmp_path / "r.vtkhdf")
    endings = {".json": "edges", ".dxf": "lines", ".tcl": "trusses", "": "rows"}
    lines = {end: written(tmp_path / "r.vtkhdf", tmp_path / f"r{end}") for end in endings}
    for end, what in endings.items():
        assert end == ".tcl" or ": last stage of erection" in lines[end][0], end
        assert f"element 9 out of the net by then: no {what}" in lines[end], end
    assert (tmp_path / "r.tcl").read_text().count("element corotTruss") == 7
    assert "4" not in json.loads((tmp_path / "r.json").read_text())["data"]["edge"]["1"]
    assert any("job.toml: not written: a stage of erection took elements out" in line for line in lines[""])
    with netfall.open(tmp_path / "r.vtkhdf") as result:
        net = result.file["net"]
        is_present = net["element_id"][:] != 9
        drawn = (net["breaking_load"][:] * net["strength"][:])[is_present]
    table = rows(tmp_path / "r" / "elements.csv")
    exported = np.array([float(row["breaking_load"] or np.inf) for row in table])
    assert exported == pytest.approx(drawn)


FAILED = {  # what fails, the change of the job, and which exports show what the search left
    "stage jack": ({"stage": [{"name": "jack", "lengths": {"hanging": {"force": -10.0}}}]}, "rdte"),
    "statics": ({"load": {"temperature": -200.0, "steps": 1}}, "te"),
    "form finding": ({"target": [{"group": "hanging", "force": -10.0, "adjust": "hanging"}]}, "rdte"),
}


@pytest.mark.parametrize("place", FAILED)
def test_a_state_without_equilibrium_has_a_warning(tmp_path, place):
    """No search reaches a compressed cable, or a load that breaks cables. Other states have no warning."""
    change, warned = FAILED[place]
    run(cross(cable=STEEL | {"fracture_strain": 0.0017}, **change), tmp_path / "r.vtkhdf", code=3)
    for name, time in (("r", None), ("d.dxf", None), ("t.tcl", None), ("e.dxf", np.inf)):
        lines = written(tmp_path / "r.vtkhdf", tmp_path / name, time)
        assert any(f"warning: {place}: no equil" in line for line in lines) == (name[0] in warned), name
        if name == "r" and "r" in warned:
            assert f"{place}: no equilibrium" in (tmp_path / name / "README.txt").read_text()
        permanent_loads_fail = name == "t.tcl" and place == "statics"
        assert ("statics, permanent loads, no equilibrium;" in lines[0]) == permanent_loads_fail, name


def test_faces_of_removed_elements_are_exported(tmp_path):
    """A cross in a square without its rim has corners as positions; its tables have the same loads."""
    net = {
        "nodes": np.array([[x, y, 0.2 * x * x] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)]),
        "elements": [[0, 1], [1, 2], [2, 5], [5, 8], [8, 7], [7, 6], [6, 3], [3, 0]],
        "fixed": np.array([True] * 4 + [False] + [True] * 4),
        "groups": ["rim"] * 8 + ["cross"] * 4,
    }
    net["elements"] += [[4, k] for k in (1, 3, 5, 7)]
    job = {"net": net, "cable": STEEL, "load": {"snow": 500.0, "steps": 0}}
    job["stage"] = [{"name": "open", "active": ["cross"]}]
    shifts = {"0": [0.0, 0.0, 0.01], "1": [0.0, 0.0, -0.01]}
    job["case"] = [{"name": "both", "settlement": shifts}]
    run(job, tmp_path / "r.vtkhdf")
    assert "; 4 points on layer supports" in written(tmp_path / "r.vtkhdf", tmp_path / "r.dxf")[0]
    written(tmp_path / "r.vtkhdf", tmp_path / "r")
    names = ("nodes", "elements")
    job |= {"net": {name: str(tmp_path / f"r/{name}.csv") for name in names}, "stage": []}
    job["roof"] = {"faces": str(tmp_path / "r/faces.csv")}
    job["case"] = [{"name": "both", "settlement": {"1": shifts["1"]}}]
    run(job, tmp_path / "again.vtkhdf")
    first, again = (values_of(tmp_path / f"{run}.vtkhdf", ["net", "cases"]) for run in ("r", "again"))
    is_present = np.isin(first["net/node_id"], again["net/node_id"])
    assert is_present.sum() == 5
    for name in ("both/displacement", "both/load"):
        assert again[f"cases/{name}"] == pytest.approx(first[f"cases/{name}"][is_present], abs=1e-9), name


def test_a_form_with_permanent_load_runs_again_without_a_warning_of_its_balance(tmp_path):
    """The form is in equilibrium under that load only; a given net without balance has the warning."""
    nodes = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, -2.0], [10.0, 0.0, 0.0]])
    net = {"nodes": nodes, "elements": [[0, 1], [1, 2]], "fixed": np.array([True, False, True])}
    net["element_columns"] = {"prestress": [2e4, 2e4]}
    job = {"net": net, "cable": STEEL, "load": {"self_weight": True, "steps": 1}}
    run(job, tmp_path / "given.vtkhdf")
    form = {"method": "force_density", "loads": "permanent"}
    written_and_again(job | {"form_finding": form}, tmp_path)
    attributes = [values_of(tmp_path / f"{name}.vtkhdf", ["provenance"]) for name in ("given", "r", "again")]
    assert ["W632" in str(each["provenance/warnings"]) for each in attributes] == [True, False, False]


BEAM = {"modulus": 2e11, "area": 1e-3, "density": 7850.0, "prestress": 0.0, "second_moment": 1e-6}
BEAM |= {"kind": "bar", "bending": True}
X = [[-4.0, 0.0, 0.0], [0.0, 0.0, -1.0], [4.0, 0.0, 0.0]]
IN_LINE = {"nodes": X, "elements": [[0, 1], [1, 2]], "fixed": [1, 0, 1], "groups": ["A", "A"]}
HANGING = {"net": IN_LINE, "cable": STEEL, "load": {"steps": 1}}
NOT_AGAIN = {  # part of the reason, and the change of the job
    "parts of subdivided elements": {"net": IN_LINE | {"subdivide": 2}},
    "cables slip": {"slide": [{"group": "A"}]},
    "moments after erection": {"cable": BEAM, "stage": [{"name": "wait"}]},
    "a zone has no nodes": {"zone": [{"name": "far", "polygon": FAR}]},
}


@pytest.mark.parametrize("reason", NOT_AGAIN)
def test_no_job_is_exported_that_would_compute_something_else(tmp_path, reason):
    """The tables are written, and a note gives the reason."""
    run(HANGING | NOT_AGAIN[reason], tmp_path / "r.vtkhdf")
    lines = written(tmp_path / "r.vtkhdf", tmp_path / "r.csv")
    assert any("job.toml: not written" in line and reason in line for line in lines)
    assert {path.name for path in (tmp_path / "r.csv").iterdir()} == {
        "nodes.csv",
        "elements.csv",
        "README.txt",
    }


def test_exported_bars_bend_only_where_they_did_in_the_run(tmp_path):
    """Two beams of one group cross at a node, so all four arms end there. They have no moment at the node."""
    x = [(k, 0.0, 0.0) for k in (-4, -2, 0, 2, 4)] + [(0.0, k, 0.0) for k in (-4, -2, 2, 4)]
    ends = [(0, 1), (1, 2), (2, 3), (3, 4), (5, 6), (6, 2), (2, 7), (7, 8)]
    net = {"nodes": np.array(x), "elements": ends, "fixed": np.isin(np.arange(9), (0, 4, 5, 8))}
    net["node_columns"] = {"load_z": [0, -1e3, -1e3, -1e3, *([0] * 5)]}
    bars = {"modulus": 2e11, "area": 1e-3, "density": 7850.0, "second_moment": 1e-6}
    job = {"net": net, "cable": bars | {"kind": "bar", "bending": True}, "load": {"steps": 1}}
    written_and_again(job, tmp_path)
    first, again = both(tmp_path, "statics")
    for name in ("statics/bending_moment", "statics/displacement"):
        assert np.array_equal(first[name], again[name])
    assert first["statics/bending_moment"][-1].max() > 500.0


def test_shares_of_zones_are_columns(tmp_path):
    """Half of the areas of nine nodes and all of others."""
    side = np.arange(9) - 4.0
    x, y = (grid.ravel() for grid in np.meshgrid(side, side, indexing="ij"))
    row = np.arange(81).reshape(9, 9)
    pairs = (row[1:], row[:-1]), (row.T[1:], row.T[:-1])
    net = {
        "nodes": np.column_stack([x, y, 0 * x]),
        "elements": np.vstack([np.column_stack([a.ravel(), b.ravel()]) for a, b in pairs]),
        "fixed": (np.abs(x) == 4) | (np.abs(y) == 4),
        "node_columns": {
            "area": np.ones(81),
            "zone": ["left"] * 45 + [""] * 36,
            "zone_share": [""] * 36 + [0.5] * 9 + [""] * 36,
        },
    }
    case = {"name": "drift", "set": {"load.zone.left.snow": 50.0}}
    job = {"net": net, "cable": STEEL, "case": [case]}
    job["load"] = {"snow": 100.0, "zone": {"left": {"snow": 300.0}}}
    written_and_again(job, tmp_path)
    cells = {row["id"]: (row["zone"], row["zone_share"]) for row in rows(tmp_path / "r" / "nodes.csv")}
    assert cells["0"] == ("left", "") and cells["80"] == ("", "")
    assert {cells[str(node)] for node in range(36, 45)} == {("left", "0.5")}
    with netfall.open(tmp_path / "again.vtkhdf") as again:
        snow = again.file["load/snow"][:]
        assert snow[:36] == pytest.approx(300.0) and snow[36:45] == pytest.approx(200.0)
        assert snow[45:] == pytest.approx(100.0) and list(again.cases) == ["drift"]


def test_data_that_a_format_cannot_store_are_named(tmp_path):
    """Only data that the net has: a net without strengths loses none."""
    run(AGAIN["every column"], tmp_path / "r.vtkhdf")
    run(GIVEN, tmp_path / "plain.vtkhdf")
    notes = {
        (name, ending): written(tmp_path / f"{name}.vtkhdf", tmp_path / f"{name}.{ending}")[-1]
        for name in ("r", "plain")
        for ending in ("dxf", "json", "tcl", "vtu")
    }
    many = "mass per length, bars, cables of several elements, strengths, springs, loads of nodes"
    assert notes["r", "json"] == (
        f"note: a .json does not contain this net's stiffness, {many}, masses of nodes, roof areas, zones, "
        "temperature. A .csv does. [N750]"
    )
    assert "a .dxf does not contain this net's ids, tensions, unstressed le" in notes["r", "dxf"]
    assert "groups, mass per length, cables of several elements, strengths, masses" in notes["r", "tcl"]
    chain = "mass per length, cables of several elements. A .csv does. [N750]"
    assert notes["plain", "tcl"] == f"note: a .tcl does not contain this net's {chain}"
    assert notes["plain", "json"].endswith(f"net's stiffness, {chain}")


def test_files_of_the_job_are_copied_without_replacing_tables(tmp_path):
    """Taps in a file nodes.csv, their pressures in events.csv; two supports moved by one file."""
    (tmp_path / "tunnel").mkdir()
    names, places = "ABCDE", [(0, 0), (9, 9), (-9, 9), (9, -9), (-9, -9)]
    taps = "".join(f"{name},{x},{y}\n" for name, (x, y) in zip(names, places))
    (tmp_path / "tunnel" / "nodes.csv").write_text("name,x,y\n" + taps)
    (tmp_path / "tunnel" / "events.csv").write_text("time,A,B,C,D,E\n0,-1,-2,-3,-4,-5\n9,-5,-4,-3,-2,-1\n")
    (tmp_path / "move.csv").write_text("time,z\n0,0\n0.1,0.01\n")
    wind = {"taps": str(tmp_path / "tunnel/nodes.csv"), "pressures": str(tmp_path / "tunnel/events.csv")}
    move = [{"nodes": [node], "displacement": str(tmp_path / "move.csv")} for node in (1, 2)]
    job = cross(wind=wind, motion=move, dynamics={"duration": 0.05})
    job["net"]["node_columns"] |= FLAT
    lines = written_and_again(job, tmp_path)
    copies = [line.split(":")[0].rpartition("/")[2] for line in lines if ": copied from" in line]
    assert sorted(copies) == ["move.csv", "other_events.csv", "other_nodes.csv"]
    first, again = both(tmp_path, "initial_state", "final")
    for key in first:
        assert np.array_equal(first[key], again[key]), key


def test_a_folder_with_other_tables_is_refused(broken, tmp_path):
    """netfall did not export its nodes.csv: exit code 2, nothing written."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "nodes.csv").write_text("id,x,y,z\n")
    with pytest.raises(InputError, match=r"has nodes\.csv already, and netfall did not export it"):
        written(broken, tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["nodes.csv"]
    written(broken, tmp_path / "ours")
    # netfall replaces its own tables and removes the job of the form
    written(broken, tmp_path / "ours", 0.1)
    names = {path.name for path in (tmp_path / "ours").iterdir()}
    assert names == {"nodes.csv", "elements.csv", "history.csv", "events.csv", "README.txt"}


def test_an_export_removes_tables_of_an_earlier_export(broken, tmp_path):
    """A result without dynamics replaces one with it. A user's history or copied file is not replaced."""
    written(broken, tmp_path / "a")
    run(GIVEN, tmp_path / "still.vtkhdf")
    assert (tmp_path / "a" / "history.csv").exists()
    written(tmp_path / "still.vtkhdf", tmp_path / "a")
    assert not (tmp_path / "a" / "history.csv").exists() and not (tmp_path / "a" / "events.csv").exists()
    (tmp_path / "wind.csv").write_text("time,speed\n0,20\n9,20\n")
    wind = {"file": str(tmp_path / "wind.csv"), "base_height": 0.0, "pressure_coefficient": -0.1}
    gusty = cross(wind=wind, dynamics={"duration": 0.02})
    gusty["net"]["node_columns"] |= FLAT
    run(gusty, tmp_path / "gusty.vtkhdf")
    for name, why in (("history.csv", "has history.csv"), ("wind.csv", "has another wind.csv")):
        folder = tmp_path / name.removesuffix(".csv")
        folder.mkdir()
        (folder / name).write_text("my own")
        with pytest.raises(InputError, match=f"{why} already"):
            written(tmp_path / "gusty.vtkhdf", folder)
        assert [(path.name, path.read_text()) for path in folder.iterdir()] == [(name, "my own")]


def test_a_drawing_shows_the_form_and_the_broken_state(broken, tmp_path):
    """Lines in metres by group, supports as points. At the end broken elements have their own layer."""
    written(broken, tmp_path / "form.dxf")
    written(broken, tmp_path / "end.dxf", np.inf)
    form, end = (ezdxf.readfile(tmp_path / f"{name}.dxf") for name in ("form", "end"))
    with netfall.open(broken) as result:
        x = result.form_finding["position"][result.file["net/elements"][:]]
        last = result.frame(0.2)
        layers = [line.dxf.layer for line in end.modelspace().query("LINE")]
        assert [layer == "broken" for layer in layers] == last.broken.tolist()
        for drawing, expected in ((form, x), (end, last.position[last.ends])):
            lines = drawing.modelspace().query("LINE")
            ends = np.array([[line.dxf.start, line.dxf.end] for line in lines])
            assert ends == pytest.approx(expected, abs=EXACT)
    assert form.header["$INSUNITS"] == 6  # metres
    assert [line.dxf.layer for line in form.modelspace().query("LINE")] == ["hanging"] * 4 + ["bracing"] * 4
    points = [tuple(point.dxf.location) for point in form.modelspace().query("POINT[layer=='supports']")]
    assert points == [(-10, 0, 2), (10, 0, 2), (0, -10, 0), (0, 10, 0)]


ROLLER = {  # a rope from a support to a node that runs along x, and a weight between them
    "net": {
        "nodes": np.array([[0, 0, 0], [4, 0, 1], [8, 0, 0]]),
        "elements": [[1, 2], [2, 3], [1, 3]],
        "groups": ["up", "up", "strut"],
        "fixed": np.array([[1, 1, 1], [0, 1, 0], [0, 1, 1]], bool),
        "node_columns": {"load_z": [0.0, 5.0, 0.0]},
        "node_id": [1, 2, 3],
    },
    "cable": STEEL | {"prestress": 0.0},
    "group": {"strut": {"kind": "bar"}},
    "load": {"steps": 1},
}


def test_partly_held_nodes_have_their_own_layer(tmp_path):
    """A drawing has no axes, and its import no such support. JSON and VTU have both."""
    run(ROLLER, tmp_path / "r.vtkhdf")
    x, fixed = (np.array(ROLLER["net"][name]) for name in ("nodes", "fixed"))
    for ending, layer in (("dxf", "supports"), ("json", None), ("vtu", None)):
        lines = written(tmp_path / "r.vtkhdf", tmp_path / f"r.{ending}")
        assert ("1 point on layer supports, 2 on layer held in part" in lines[0]) == bool(layer), ending
        assert ("axes of supports" in lines[-1]) == bool(layer), ending
        options = ImportOptions(supports=layer)
        import_file(tmp_path / f"r.{ending}", tmp_path / f"of_{ending}", options, lines.append)
        back = {tuple(float(row[k]) for k in "xyz"): row for row in rows(tmp_path / f"of_{ending}/nodes.csv")}
        for place, axes in zip(x.tolist(), fixed):
            row = back[tuple(place)]
            held = [row[f"fixed_{k}"] for k in "xyz"] if layer is None else [row["fixed"]] * 3
            assert held == [str(int(axis)) for axis in (axes if layer is None else [axes.all()] * 3)], ending
        text = "supports: 3 of 3 nodes are held (as given in the file; 2 along some axes only)"
        assert (text in lines) == (layer is None), ending


@pytest.mark.parametrize("ending", ["json", "vtu"])
def test_a_support_along_one_axis_at_an_angle_has_no_axis_in_plan(tmp_path, ending):
    """Files without angles would hold it along x. A support that is held fully is the same at any angle."""
    net = ROLLER["net"] | {"node_columns": {"angle": [30.0] * 3}}
    run(ROLLER | {"net": net}, tmp_path / "r.vtkhdf")
    lines = written(tmp_path / "r.vtkhdf", tmp_path / f"r.{ending}")
    assert "angles of supports" in lines[-1]
    import_file(tmp_path / f"r.{ending}", tmp_path / "back", ImportOptions(), lines.append)
    back = {tuple(float(row[k]) for k in "xyz"): row for row in rows(tmp_path / "back" / "nodes.csv")}
    for place, (x, y, z) in zip(net["nodes"], net["fixed"]):
        in_plan = [x, y] if x == y else [False, False]
        held = [back[tuple(map(float, place))][f"fixed_{k}"] for k in "xyz"]
        assert held == [str(int(axis)) for axis in (*in_plan, z)]


GIVEN_NAMES = ["supports", "Broken", "0", "a/b", "A_B", "", "cables", "Defpoints"]


def test_each_group_has_its_own_layer(tmp_path):
    """Also groups named like other layers, like those of every drawing, or equal except for case."""
    angle = 2 * np.pi * np.arange(8) / 8
    rim = np.column_stack([10 * np.cos(angle), 10 * np.sin(angle), 0 * angle])
    net = {
        "nodes": np.vstack([rim, [0, 0, 0]]),
        "elements": [[k, 8] for k in range(8)],
        "fixed": np.arange(9) < 8,
        "groups": GIVEN_NAMES,
    }
    run({"net": net, "cable": STEEL}, tmp_path / "r.vtkhdf")
    notes = written(tmp_path / "r.vtkhdf", tmp_path / "r.dxf")
    lines = ezdxf.readfile(tmp_path / "r.dxf").modelspace().query("LINE")
    layers = ["supports_2", "Broken_2", "0", "a_b", "A_B_2", "cables", "cables_2", "Defpoints_2"]
    assert sorted(e.dxf.layer for e in lines) == sorted(layers[:3] + ["A_B", "a_b_2"] + layers[5:])
    back = read_net(tmp_path / "r.dxf", ImportOptions(supports="supports"))
    assert len(back.net.ends) == 8 and back.held.sum() == 8 and "0, A_B, Broken_2, Def" in notes[0]


def test_removed_elements_are_not_exported(tmp_path):
    """A removed cable of two parts leaves six of eight elements. All numbers of a JSON are valid."""
    lost = {"remove": [{"elements": [14], "time": 0.02}], "net": cross()["net"] | {"subdivide": 2}}
    job = cross(**lost, dynamics={"duration": 0.05}, output={"frames": 2})
    run(job, tmp_path / "r.vtkhdf")
    result, endings = tmp_path / "r.vtkhdf", ("json", "dxf", "csv", "vtu")
    notes = {end: written(result, tmp_path / f"r.{end}", np.inf) for end in endings}
    assert notes["json"][1] == "2 elements (14, 18) out of the net by then: no edges"
    assert notes["dxf"][1] == "2 elements (14, 18) out of the net by then: no lines"
    assert notes["vtu"][1] == notes["dxf"][1] and "6 lines" in notes["vtu"][0]
    assert "2 elements (14, 18) out of the net by then: no rows" in notes["csv"]
    table = rows(tmp_path / "r.csv" / "elements.csv")
    assert len(table) == 6 and all(row["start"] != row["end"] for row in table)

    def refuse(word):
        raise AssertionError(word)

    graph = json.loads((tmp_path / "r.json").read_text(), parse_constant=refuse)["data"]
    assert sum(len(edges) for edges in graph["edge"].values()) == 6
    lines = ezdxf.readfile(tmp_path / "r.dxf").modelspace().query("LINE")
    assert [e.dxf.layer for e in lines] == ["hanging"] * 4 + ["bracing"] * 2


def test_export_and_import_end_with_the_number_of_their_warnings(broken, tmp_path):
    drawing = tmp_path / "form.dxf"
    for command in (
        ("export", broken, "-o", drawing),
        ("import", drawing, "-o", tmp_path / "net", "--supports", "supports"),
    ):
        output = run_on_standing_ranks(*command).stdout.splitlines()
        count = sum(line.strip().startswith("warning: ") for line in output)
        assert output[-1].startswith(f"{count} warning")


@pytest.mark.parametrize("ending", ["dxf", "json", "vtu"])
def test_an_exported_form_is_imported_as_the_same_net(broken, tmp_path, ending):
    """Positions, elements and supports."""
    written(broken, tmp_path / f"form.{ending}")
    supports = "supports" if ending == "dxf" else None
    again = read_net(tmp_path / f"form.{ending}", ImportOptions(supports=supports))
    with netfall.open(broken) as result:
        x = result.form_finding["position"][result.file["net/elements"][:]]
    in_order = lambda lines: lines[np.lexsort(lines.reshape(-1, 6).T)]  # a Graph is ordered by its nodes
    assert in_order(again.net.x[again.net.ends]) == pytest.approx(in_order(x), abs=EXACT)
    assert again.net.x[again.held].tolist() == [[-10, 0, 2], [10, 0, 2], [0, -10, 0], [0, 10, 0]]


def test_compas_and_vtk_files_contain_the_state(broken, tmp_path):
    """Nodes, edges and values, read by the standard library and by VTK."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    written(broken, tmp_path / "state.json", 0.1)
    written(broken, tmp_path / "state.vtu", 0.1)
    document = json.loads((tmp_path / "state.json").read_text())
    assert document["dtype"] == "compas.datastructures/Graph"
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "state.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    with netfall.open(broken) as result:
        frame = result.frame(0.1)
    node, edge = document["data"]["node"], document["data"]["edge"]
    places = np.array([[node[name][k] for k in "xyz"] for name in node])
    assert places == pytest.approx(frame.position, abs=EXACT)
    q = [values["q"] for ends in edge.values() for values in ends.values()]
    length = np.linalg.norm(np.diff(frame.position[frame.ends], axis=1)[:, 0], axis=1)
    assert sorted(q) == pytest.approx(sorted(frame.tension / length), rel=3 * EXACT)
    assert [name for name in node if node[name]["is_anchor"]] == ["1", "2", "3", "4"]
    assert vtk_to_numpy(grid.GetPoints().GetData()) == pytest.approx(frame.position, abs=EXACT)
    assert (vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 2) == frame.ends).all()
    assert (vtk_to_numpy(grid.GetCellData().GetArray("tension")) == frame.tension).all()


GIVEN = {  # two cables of 1.98 m in a gap of 4 m; EA = 1 MN
    "net": {
        "nodes": np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0]]),
        "elements": [[0, 1], [1, 2]],
        "fixed": np.array([True, False, True]),
        "element_columns": {"unstressed_length": 1.98},
    },
    "cable": {"modulus": 1e10, "area": 1e-4, "density": 1.0, "thermal_expansion": 1e-4},
}


@pytest.mark.parametrize("strain, law", [("engineering", lambda e: e), ("logarithmic", np.log1p)])
def test_tensions_of_a_given_geometry_are_those_of_the_law(tmp_path, strain, law):
    """EA (L / L0 - 1) or EA ln(L / L0); the model for OpenSees 30 K warmer, L0 (1 + 30 alpha)."""
    job = GIVEN | {"cable": GIVEN["cable"] | {"strain_measure": strain}}
    job["load"] = {"temperature": 30.0, "steps": 1}
    run(job, tmp_path / "r.vtkhdf")
    with netfall.open(tmp_path / "r.vtkhdf") as result:
        assert result.elements["unstressed_length"].tolist() == [1.98] * 2
        warm = 1.98 * (1.0 + 30.0 * 1e-4)
        assert result.elements["unstressed_length_warm"] == pytest.approx([warm] * 2, rel=EXACT)
        stored = result.file["net/unstressed_length_warm"][:]
        assert (stored == result.elements["unstressed_length_warm"]).all()
    written(tmp_path / "r.vtkhdf", tmp_path / "r.json")
    lines = written(tmp_path / "r.vtkhdf", tmp_path / "r.tcl")
    edge = json.loads((tmp_path / "r.json").read_text())["data"]["edge"]["0"]["1"]
    assert edge["tension"] == pytest.approx(1e6 * law(2.0 / 1.98 - 1.0), rel=1e-12)  # of 1e-2 in lengths
    assert (edge["unstressed_length"], edge["unstressed_length_warm"]) == pytest.approx((1.98, warm))
    materials = words_of(tmp_path / "r.tcl", "uniaxialMaterial")
    E = float(next(w[2] for w in materials if w[0] == "Elastic"))
    eps = float(next(w[3] for w in materials if w[0] == "InitStrainMaterial"))
    assert E * eps == pytest.approx(1e6 * law(2.0 / warm - 1.0), rel=1e-9)  # the equilibrium's tolerance
    assert any("not linear elastic" in line for line in lines) == (strain == "logarithmic")


@pytest.mark.parametrize("case, length", [("cold", 1.98 * 0.999), ("both", 2 / (1 + 1.2 / 99) * 0.9995)])
def test_lengths_of_a_case_have_its_temperature_and_prestress(tmp_path, case, length):
    """10 K colder; then 1.2 times the strain 1/99 at 0.5 x 30 + 0.5 x (-10 - 30) = -5 K. All is elastic."""
    factors = {"prestress": 1.2, "temperature": 0.5, "cold": 0.5}
    job = GIVEN | {"load": {"temperature": 30.0}, "combination": [{"name": "both", "factors": factors}]}
    job["case"] = [{"name": "cold", "set": {"load.temperature": -10.0}}]
    run(job, tmp_path / "r.vtkhdf")
    assert not any("W754" in line for line in written(tmp_path / "r.vtkhdf", tmp_path / "r.tcl", case=case))
    written(tmp_path / "r.vtkhdf", tmp_path / "r.json", case=case)
    edge = json.loads((tmp_path / "r.json").read_text())["data"]["edge"]["0"]["1"]
    assert edge["unstressed_length_warm"] == pytest.approx(length, rel=1e-12)
    assert edge["tension"] == pytest.approx(1e6 * (2.0 / length - 1.0), rel=1e-9)


def test_the_lengths_in_the_tables_of_a_motion_explain_its_forces(tmp_path):
    """EA (L / L0 - 1), with L0 at the temperature of the loads, which is 30 K above that of the net."""
    run(GIVEN | {"load": {"temperature": 30.0}, "dynamics": {"duration": 0.05}}, tmp_path / "r.vtkhdf")
    written(tmp_path / "r.vtkhdf", tmp_path / "r", np.inf)
    x = {row["id"]: [float(row[k]) for k in "xyz"] for row in rows(tmp_path / "r" / "nodes.csv")}
    for row in rows(tmp_path / "r" / "elements.csv"):
        L = np.linalg.norm(np.subtract(x[row["end"]], x[row["start"]]))
        force = 1e6 * (L / float(row["unstressed_length_warm"]) - 1.0)
        assert float(row["tension"]) == pytest.approx(force, rel=1e-5)  # single precision


def test_a_model_for_opensees_has_tags_and_names_that_it_can_read(tmp_path):
    """Tags are 32-bit integers. Tcl would execute brackets, and replace text after a $."""
    job = GIVEN | {"load": {"steps": 1}}
    run(job, tmp_path / "r.vtkhdf")
    written(tmp_path / "r.vtkhdf", tmp_path / "a[exit]$b{.tcl")
    text = (tmp_path / "a[exit]$b{.tcl").read_text().split("# --- the equilibrium")[1]
    assert text.count(r"a\[exit\]\$b\{") == text.count("exit") - 1 == 3  # one is the command
    for name, last in (("s", 2**31 - 1), ("t", 2**31)):
        run(job | {"net": job["net"] | {"element_id": [1, last]}}, tmp_path / f"{name}.vtkhdf")
    written(tmp_path / "s.vtkhdf", tmp_path / "s.tcl")
    with pytest.raises(netfall.InputError, match="ids up to 2147483648: OpenSees takes tags up to"):
        written(tmp_path / "t.vtkhdf", tmp_path / "t.tcl")


@pytest.fixture(scope="module")
def stadium(tmp_path_factory):
    """Return the stadium under its cladding, 48 cables slack, as a result and as a model for OpenSees."""
    folder = tmp_path_factory.mktemp("stadium")
    load = "[load]\nself_weight = false\ndead = 1000.0\nsteps = 1\ntolerance = 1e-10\n"
    (folder / "job.toml").write_text(shipped("stadium").replace("1e-11", "1e-10") + load)
    run(folder / "job.toml", folder / "s.vtkhdf")
    written(folder / "s.vtkhdf", folder / "s.tcl")
    return folder


def words_of(path, command):
    """Return the words of the lines that begin with a command."""
    lines = (line.split() for line in path.read_text().splitlines())
    return [words[1:] for words in lines if words and words[0] == command]


def apart_in_opensees(model, result, tensions: str) -> float:
    """Return the largest difference of OpenSees' tensions from a dataset, relative to the largest tension."""
    theirs = tensions_in_opensees(model)
    with netfall.open(result) as r:
        ours = dict(zip(r.elements["id"].tolist(), np.atleast_2d(r.file[tensions])[-1]))
    assert sorted(theirs) == sorted(ours)
    return max(abs(ours[e] - theirs[e]) for e in ours) / max(ours.values())


def test_the_model_for_opensees_is_in_the_same_equilibrium(stadium):
    """The truss forces in the text, at netfall's positions, balance its loads."""
    path = stadium / "s.tcl"
    x = {int(tag): np.array(place, float) for tag, *place in words_of(path, "node")}
    materials = words_of(path, "uniaxialMaterial")
    modulus = {tag: float(E) for kind, tag, E, *_ in materials if kind == "Elastic"}
    initial = {w[1]: (modulus[w[2]], float(w[3])) for w in materials if w[0] == "InitStrainMaterial"}
    force = {tag: np.zeros(3) for tag in x}
    for tag, *load in words_of(path, "load"):
        force[int(tag)] += np.array(load, float)
    with netfall.open(stadium / "s.vtkhdf") as result:
        moved = dict(zip(result.nodes["id"].tolist(), result.statics["displacement"][-1]))
        theirs = result.statics["tension"][-1]
    ours = []
    for _, _tag, a, b, area, material in words_of(path, "element"):
        a, b = int(a), int(b)
        E, strain = initial[material]
        length, along = np.linalg.norm(x[b] - x[a]), x[b] + moved[b] - x[a] - moved[a]
        N = max(0.0, E * float(area) * ((np.linalg.norm(along) - length) / length + strain))
        ours.append(N)
        force[a] += N * along / np.linalg.norm(along)
        force[b] -= N * along / np.linalg.norm(along)
    for tag, *_ in words_of(path, "fix"):
        del force[int(tag)]
    # a strain of 1e-3 is right to 2e-13 of itself: twice differences of lengths, right to their last bit
    assert ours == pytest.approx(theirs, abs=1e-11 * theirs.max()) and (theirs == 0).sum() == 48
    assert max(np.abs(f).max() for f in force.values()) < 1e-9 * theirs.max()  # what counts as no load


def test_opensees_finds_the_same_tensions(stadium):
    """OpenSees runs the exported model from the form."""
    # both stop at a residual of 1e-10 of the prestress; 1.1e-10 was found
    assert apart_in_opensees(stadium / "s.tcl", stadium / "s.vtkhdf", "statics/tension") < 1e-9


@pytest.fixture(scope="module")
def on_springs(tmp_path_factory):
    """Return the shipped wheel on springs, some with a displacement, under drifted snow."""
    folder = tmp_path_factory.mktemp("springs")
    text = (ROOT / "jobs" / "wheel.toml").read_text().split("[wind]")[0]
    (folder / "wheel.toml").write_text(text.replace("cut = true", "cut = false"))
    run(folder / "wheel.toml", folder / "w.vtkhdf")
    written(folder / "w.vtkhdf", folder / "tables.csv")
    nodes = rows(folder / "tables.csv" / "nodes.csv")
    for number, row in enumerate(nodes):
        for k in "xyz":
            held = row[f"fixed_{k}"] == "1"
            row |= {f"fixed_{k}": "0", f"spring_{k}": "3e7" if held else "0"}
            row |= {f"spring_rest_{k}": f"{1e-3 * (number % 3)}" if held else "0"}
    text = table(",".join(nodes[0]), (row.values() for row in nodes))
    (folder / "tables.csv" / "nodes.csv").write_text(text)
    run(folder / "tables.csv" / "job.toml", folder / "s.vtkhdf", "--set", "load.tolerance=1e-10")
    return folder


def test_opensees_finds_the_tensions_of_a_wheel_on_springs(on_springs):
    """zeroLength elements begin with the displacement of the springs; the state is that of a case."""
    lines = written(on_springs / "s.vtkhdf", on_springs / "s.tcl", case="drift")
    springs = words_of(on_springs / "s.tcl", "element")
    assert sum(words[0] == "zeroLength" for words in springs) == 72 and "case drift" in lines[0]
    assert lines[0].endswith("on springs: 72")
    # of the largest; the case is found to 1e-10
    assert apart_in_opensees(on_springs / "s.tcl", on_springs / "s.vtkhdf", "cases/drift/tension") < 1e-6


def test_a_drawing_has_layers_of_supports_and_springs_in_its_unit(on_springs, tmp_path):
    """In mm, in the state of a case. An unknown case is refused, and a unit of a format without one."""
    lines = written(on_springs / "s.vtkhdf", tmp_path / "s.dxf", case="drift", unit="mm")
    assert "lines in mm" in lines[0] and "72 on layer springs" in lines[0]
    drawing = ezdxf.readfile(tmp_path / "s.dxf")
    assert drawing.units == ezdxf.units.MM
    with netfall.open(on_springs / "s.vtkhdf") as result:
        sprung = result.file["net/spring"][:].any(1)
        x = result.file["net/particles"][:] + result.file["cases/drift/displacement"][:]
    points = [p.dxf.location for p in drawing.modelspace().query('POINT[layer=="springs"]')]
    assert np.array([tuple(p) for p in points]) == pytest.approx(1e3 * x[sprung], abs=1e-9)
    for words, more in (('did you mean "drift"', {"case": "drft"}), ("written in metres", {"unit": "mm"})):
        with pytest.raises(InputError, match=words):
            written(on_springs / "s.vtkhdf", tmp_path / "s.vtu", **more)
        assert not (tmp_path / "s.vtu").exists()


def test_exports_that_are_not_possible_are_refused(broken, tmp_path):
    """An unknown suffix, a time after the end, or a motion as an equilibrium: exit code 2 and no file."""
    for name, time, words in (
        ("a.stl", None, "the ending names the format, expected one of .csv, .dxf"),
        ("a.dxf", 9.0, "time 9 s: the frames are from 0 to 0.2 s"),
        ("a.tcl", 0.1, "Leave --time out"),
        ("none/a.dxf", None, "does not exist"),
    ):
        with pytest.raises(InputError, match=words):
            written(broken, tmp_path / name, time)
    done = run_on_standing_ranks("export", broken, "-o", tmp_path / "a.json", "--time", "late", code=2)
    assert "expected a time >= 0 in s, or end" in done.stderr
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "own.dxf").write_text("drawn by hand")
    with pytest.raises(InputError, match="exists, and netfall did not export it"):
        written(broken, tmp_path / "own.dxf")
    for name in ("a.dxf", "a.tcl", "a.json", "a.vtu", "a.csv"):  # what netfall wrote it writes again
        assert written(broken, tmp_path / name) == written(broken, tmp_path / name)
