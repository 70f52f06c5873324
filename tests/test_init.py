"""First steps of users: `netfall init`, and the examples in --help."""

import json
import re
import shlex
from inspect import signature

import h5py
import numpy as np
import pytest
from conftest import STEEL, run_on_standing_ranks
from nets import bare_saddle, table

from netfall.cli.jobs import EXAMPLES
from netfall.cli.parser import COMMANDS, parser, read_command
from netfall.driver.check import check_job, plot_job_net
from netfall.geometry.build import build_net
from netfall.job.keys.schema import job_schema
from netfall.job.read import read_job
from netfall.model.layout import make_layout
from netfall.post.plots import canvas
from netfall.post.plots.net import select_cables


def test_the_first_job_is_valid(tmp_path):
    """The job passes the check unchanged. It replaces no file."""
    path = tmp_path / "roof.toml"
    run_on_standing_ranks("init", path)
    lines = []
    check_job(read_job(path), lines.append)
    assert any(line.startswith("stages: form finding") for line in lines)
    assert "exists already" in run_on_standing_ranks("init", path, code=2).stderr


@pytest.mark.parametrize("name, command", COMMANDS.items())
def test_help_has_examples_that_the_command_takes(name, command):
    """Each command has an example; its function accepts the options of the example."""
    parsers = next(action for action in parser()._actions if action.dest == "command").choices
    _, _, examples = parsers[name].format_help().partition("\n\nexample")
    lines = [line for line in examples.splitlines() if "  " in line]
    assert lines and all(f"netfall {name}" in line for line in lines)
    for line in lines:
        words = shlex.split(line)
        call = read_command(words[words.index("netfall") + 1 :])
        assert call.func is command.function
        signature(call.func).bind(**call.keywords)


DRAWN = """
[[zone]]
name = "glass"
groups = ["edge"]
[[zone]]
name = "drift"
polygon = [[3.5, -1.0], [9.0, -1.0], [9.0, 2.0], [3.5, 2.0]]
cut = false
[load.zone.drift]
snow = 900.0
[wind]
speed = 25.0
direction = 200.0
pressure_coefficient = -0.6
base_height = 10.0
surface_drag = 0.03
gust_field = "point"
[[remove]]
time = 0.1
elements = [5, 9]
[dynamics]
duration = 0.2
[output]
probes = [6, [4.0, 3.9]]
elements = [3]
"""


def drawn_net() -> tuple[str, str]:
    """Tables of a net of 4 x 4 nodes, 2 m apart: three corners held, one in part, two nodes on springs."""
    number = lambda i, j: 1 + 4 * i + j
    held = {1: "1,1,1,0", 4: "1,1,1,0", 13: "1,1,1,0", 16: "0,1,1,0", 2: "0,0,0,1e6", 3: "0,0,0,1e6"}
    at = ((number(i, j), 2 * i, 2 * j) for i in range(4) for j in range(4))
    nodes = [(node, x, y, 0, held.get(node, "0,0,0,0")) for node, x, y in at]
    pairs = [(number(i, j), number(i + 1, j), j) for i in range(3) for j in range(4)]
    pairs += [(number(i, j), number(i, j + 1), i) for i in range(4) for j in range(3)]
    rows = [(k, a, b, "net" if s else "edge") for k, (a, b, s) in enumerate(pairs, 1)]
    heads = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_z", "id,start,end,group"
    return table(heads[0], nodes), table(heads[1], rows)


def test_the_picture_of_check_shows_the_job(workshop, monkeypatch):
    """Its legend counts the entries of the tables."""
    figures = []
    monkeypatch.setattr(canvas.plt, "close", figures.append)
    job = workshop.job(STEEL + DRAWN, *drawn_net())
    read = read_job(job)
    picture = plot_job_net(read, make_layout(read, 1), workshop.folder / "pictures")
    assert picture.name == "job_net.png" and picture.stat().st_size > 10_000
    legends = [legend for half in figures[0].subfigs for legend in half.legends]
    labels = [text.get_text() for legend in legends for text in legend.get_texts()]
    assert {"edge, 6", "net, 18", "supports, 3", "springs, 2 (z: 2)", "probes, 2"} <= set(labels)
    assert {"held in part, 1 (y: 1, z: 1)", "to be removed, 2", "[output] elements, 1"} <= set(labels)
    # nodes of "drift": (4, 0), (6, 0) and (4, 2), (6, 2), of which the first two are at the edge too
    assert "zone drift, 4 nodes, 9 m2 in plan" in labels
    assert "wind of 25 m/s to 200 degrees (from 20 degrees)" in labels
    assert "zone glass, 5 nodes, 8 m2 in plan" in labels and "no zone, 7 nodes, 19 m2 in plan" in labels


def test_the_picture_of_a_large_net_shows_every_kth_cable(tmp_path):
    """The choice is even in each group: a saddle of 100 cables each way shows each fifth."""
    path = tmp_path / "job.toml"
    path.write_text(bare_saddle(101, rise=2.0))
    net = build_net(read_job(path))
    rows, every = select_cables(net.cable, net.group, net.m // 5)
    assert every == 5 and net.m == 20_200
    for group, axis in ((0, 1), (1, 0)):
        in_group = rows[net.group[rows] == group]
        at = np.unique(net.x[net.elements[in_group], axis].round(9))
        assert len(at) == 20 and len(in_group) == 20 * 101 and np.allclose(np.diff(at), 5 * 40.0 / 101)


@pytest.mark.parametrize("name", EXAMPLES)
def test_each_example_is_short_and_runs(tmp_path, name):
    """An example needs no other file; editors find its schema next to it. A collapse warns only of yield."""
    run_on_standing_ranks("init", "--example", name, cwd=tmp_path)
    text = (tmp_path / f"{name}.toml").read_text()
    assert len([line for line in text.splitlines() if line and not line.startswith("#")]) <= 40
    assert text.splitlines()[0] == "#:schema ./netfall.schema.json"
    assert json.loads((tmp_path / "netfall.schema.json").read_text()) == job_schema()
    done = run_on_standing_ranks("run", f"{name}.toml", "--set", "title=short", cwd=tmp_path)
    assert set(re.findall(r"\[(W\d+)\]", done.stdout + done.stderr)) <= {"W734"}


def test_examples_with_tables_by_hand(tmp_path):
    """Facade: 0.8 kN/m2 on 15 x 12 m is 144 kN. Edge cables: q L in the form, then weights and snow."""
    for name in ("facade", "edge-cables"):
        run_on_standing_ranks("init", "--example", name, cwd=tmp_path)
        run_on_standing_ranks("run", f"{name}.toml", "-q", cwd=tmp_path)
        again = run_on_standing_ranks("init", "other.toml", "--example", name, cwd=tmp_path, code=2)
        assert f"{name}_nodes.csv: the file exists already" in again.stderr
    with h5py.File(tmp_path / "facade.vtkhdf") as f:
        assert np.allclose(f["cases/wind on it/reaction"][:, 1].sum(), 144e3, rtol=1e-6)
        assert np.allclose(f["cases/wind from behind/reaction"][:, 1].sum(), -90e3, rtol=1e-6)
    with h5py.File(tmp_path / "edge-cables.vtkhdf") as f:
        x, (a, b) = f["form_finding/position"][:], f["net/elements"][2]  # the middle of an edge cable
        assert np.isclose(f["form_finding/tension"][2], 75e3 * np.linalg.norm(x[b] - x[a]), rtol=1e-6)
        steel = 7850.0 * np.where(f["net/group"][:] == list(f["net/group_names"]).index(b"edge"), 2e-3, 3e-4)
        weight = 9.81 * (steel * f["net/unstressed_length"][:]).sum()
        weight += 50.0 * f["net/tributary_area"][:].sum()
        snow = 600.0 * f["net/plan_area"][:].sum()
        assert np.isclose(-f["cases/snow/reaction"][:, 2].sum(), weight + snow, rtol=1e-6)


def test_check_and_info_print_json(tmp_path):
    """One object in SI units, with the errors of a wrong job and exit code 2."""
    run_on_standing_ranks("init", "--example", "dome", cwd=tmp_path)
    values = json.loads(run_on_standing_ranks("check", "dome.toml", "--json", cwd=tmp_path).stdout)
    assert values["valid"] and values["elements"] == 600 and values["groups"]["strut"] == 96
    command = ["check", "dome.toml", "--json", "--set", "load.snoww=1"]
    wrong = run_on_standing_ranks(*command, cwd=tmp_path, code=2)
    (line,) = json.loads(wrong.stdout)["errors"]
    assert "snoww: unknown key" in line and "[load]" in line
    run_on_standing_ranks("run", "dome.toml", "-q", cwd=tmp_path)
    info = json.loads(run_on_standing_ranks("info", "dome.vtkhdf", "--json", cwd=tmp_path).stdout)
    case = info["equilibria"]["cases/snow on one half"]
    assert info["exit_state"] == "finished" and case["state"] == "equilibrium" and case["stable"]
    assert case["tension_min"] < 0.0 < case["tension_max"]  # struts and cables
