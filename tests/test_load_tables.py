"""Tables of loads compared with nodes' loads and with `set`, by hand; and errors in tables."""

import numpy as np
import pytest
from conftest import assert_same_bits_on, assert_same_results, lines_with, run_on_standing_ranks
from scipy.optimize import brentq, fsolve
from test_cases import SADDLE
from test_validation_statics import catenary

from netfall.geometry.net import GRAVITY
from netfall.job.read import read_job

CABLES = "[cable]\nmodulus = 1e9\narea = 1e-3\ndensity = 1000.0\n"  # EA = 1 MN
LOAD = "[load]\nself_weight = false\ntolerance = 1e-10\n"
NODES = "id,x,y,z,fixed\n1,0,0,0,1\n2,4,0,-3,0\n3,8,0,0,1\n"
TWO = "id,start,end,group\n7,1,2,left\n9,2,3,right\n"
EA, LENGTH = 1e6, 5.0  # N, m
LOADED = "id,x,y,z,fixed,load_x,load_z\n1,0,0,0,1,,\n2,4,0,-3,0,10,-1000\n3,8,0,0,1,,\n"
RIG = "node,load_x,load_z\n6,300,-2000\n7,,-1500\n6,,-500\n"  # N; node 6 has two lamps


def case(name: str, what: str = "") -> str:
    """Return an entry [[case]] with a table of its name."""
    return f'[[case]]\nname = "{name}"\nload_table = "{name}.csv"\n{what}'


def symmetric(weight: float) -> float:
    """Return the force [N] of the two cables under a weight [N] at their middle."""

    def force(sag):
        return EA * (np.hypot(4.0, 3.0 + sag) / LENGTH - 1.0)

    def misses(sag):
        return 2.0 * force(sag) * (3.0 + sag) / np.hypot(4.0, 3.0 + sag) - weight

    return force(brentq(misses, 0.0, 1.0, xtol=1e-15)) if weight else 0.0


def test_a_load_table_has_the_bits_of_loads_of_nodes(both_ways):
    """In a case, in [load], and as load_x, load_z of nodes.csv. Two rows of a node are added."""
    folder = both_ways.folder
    (folder / "rig.csv").write_text("node,load_x,load_z\n-,N,kN\n2,10,-0.6\n2,,-0.4\n")
    text = CABLES + LOAD + '[[case]]\nname = "own"\nset = {"load.dead" = 0.0}\n'
    nodes = both_ways.solve(text, LOADED, TWO)
    table = both_ways.solve(CABLES + LOAD + case("rig"), NODES, TWO, output="case.vtkhdf")
    text = CABLES + LOAD + 'load_table = "rig.csv"\nsteps = 1\n'
    steps = both_ways.solve(text, NODES, TWO, output="load.vtkhdf")
    for name in ("tension", "displacement"):
        expected = nodes["cases/own"][name][:]
        assert np.array_equal(table["cases/rig"][name][:], expected)
        assert np.abs(steps["statics"][name][-1] - expected).max() < 1e-9 * np.abs(expected).max()


def test_loads_of_nodes_and_elements_by_hand(workshop):
    """1 kN at the middle; 20 and 10 N/m of 5 m of cable: half at each end, 75 N at the middle."""
    (workshop.folder / "rig.csv").write_text("node,load_z\n2,-1000\n")
    (workshop.folder / "line.csv").write_text("element,line_z\n7,-20\n9,-10\n")
    sums = "[combinations]\nboth = {rig = 1.5, line = 2.0}\n"
    f = workshop.solve(CABLES + LOAD + case("rig") + case("line") + sums, NODES, TWO)
    for name, weight in (("rig", 1000.0), ("line", 75.0), ("both", 1500.0 + 150.0)):
        assert f[f"cases/{name}/tension"][:] == pytest.approx([symmetric(weight)] * 2, rel=1e-8)
    job = workshop.job(CABLES + LOAD + case("rig") + case("line"), LOADED, TWO)
    lines = lines_with("load table", "check", job, cwd=workshop.folder)
    assert lines == [
        "load table nodes.csv of [net]: resultant 0.01, 0, -1 kN along x, y, z",
        "load table rig.csv of [[case]] rig: resultant 0, 0, -1 kN along x, y, z",
        "load table line.csv of [[case]] line: resultant 0, 0, -0.15 kN along x, y, z",
    ]


def elastic_catenary(span: float, rise: float, L0: float, w: float) -> tuple[float, float]:
    """Horizontal force and vertical force at the upper end [N] of a cable with w [N/m of unstressed length].

    Irvine, Cable Structures (1981), section 1.3.
    """

    def misses(at):
        x, z = catenary(*at, w, EA, L0, 1)
        return x - span, z - rise

    return tuple(fsolve(misses, (2000.0, 2000.0), xtol=1e-12))


def test_a_line_on_an_inclined_cable_by_hand(workshop):
    """30 N/m of 49.9 m between ends 40 m apart and 30 m in height: an elastic catenary.

    Loads at 16 and 32 nodes come to it with the square of their distance. The weight of a cable with the
    density of that load has the same forces.
    """
    (workshop.folder / "ice.csv").write_text("element,line_z\n7,-30\n8,-30\n")
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,20,0,15,0\n3,40,0,30,1\n"
    elements = "id,start,end,unstressed_length\n7,1,2,24.95\n8,2,3,24.95\n"
    H, V = elastic_catenary(40.0, 30.0, 49.9, 30.0)
    load, far = '[load]\nself_weight = false\nload_table = "ice.csv"\ntolerance = 1e-10\nsteps = 1\n', []
    for parts in (8, 16):
        job = workshop.job(CABLES + load, nodes, elements)
        more = ("--set", f"net.subdivide={parts}")
        N = workshop.run(job, *more)["statics/tension"][-1]
        own = ("--set", "load.self_weight=true", "--set", f"cable.density={30.0 / GRAVITY / 1e-3!r}")
        job.write_text(job.read_text().replace('load_table = "ice.csv"\n', ""))
        with workshop.run(job, *more, *own, output="own.vtkhdf") as f:
            assert pytest.approx(f["statics/tension"][-1], rel=1e-9) == N
        s = 49.9 - (np.arange(2 * parts) + 0.5) * 49.9 / (2 * parts)  # from the upper end
        far.append(np.abs(N / np.hypot(H, V - 30.0 * s) - 1.0).max())
    assert far[1] < 3e-4 and far[0] / far[1] == pytest.approx(4.0, rel=0.1)


def test_rows_of_zones_equal_values_of_set(workshop):
    """All bits, in a case, in [load] and in combinations; also for a vector of pressures."""
    (workshop.folder / "drift.csv").write_text("zone,snow,pressure_z\n-,kN/m2,-\nhalf,0.4,-50\n")
    of_set = '"load.zone.half.snow" = 400.0, "load.zone.half.pressure" = [0.0, 0.0, -50.0]'
    text = SADDLE + LOAD + "snow = 100.0\nsteps = 1\n"
    sums = "[combinations]\nu = {drift = 1.5, load = 1.5, temperature = 0.0}\n"
    f = workshop.solve(text + case("drift") + sums)
    by_hand = text + f'[[case]]\nname = "drift"\nset = {{{of_set}}}\n' + sums
    with workshop.solve(by_hand, name="set", output="set.vtkhdf") as g:
        for name in ("drift", "u"):
            assert np.array_equal(f[f"cases/{name}/tension"][:], g[f"cases/{name}/tension"][:])
    own = text.replace("snow = 100.0\n", 'snow = 100.0\nload_table = "drift.csv"\n')
    keys = text + "[load.zone.half]\nsnow = 400.0\npressure = [0.0, 0.0, -50.0]\n"
    with workshop.solve(own, output="own.vtkhdf") as g, workshop.solve(keys, output="keys.vtkhdf") as h:
        assert np.array_equal(g["statics/tension"][:], h["statics/tension"][:])
    (line,) = lines_with("load table", "check", workshop.job(text + case("drift")), cwd=workshop.folder)
    share, plan, surface = f["net/zone_share"][:, 0], f["net/plan_area"][:], f["net/tributary_area"][:]
    weight = 0.4 * (share @ plan) + 0.05 * (share @ surface)  # kN
    assert float(line.split()[9]) == pytest.approx(-weight, rel=1e-3)


def test_tables_of_stages_apply_until_another_one(workshop):
    """The loads are 1 kN, still 1 kN, 75 N, none; then a case, without the loads of stages."""
    (workshop.folder / "rig.csv").write_text("node,load_z\n2,-1000\n")
    (workshop.folder / "line.csv").write_text("element,line_z\n7,-20\n9,-10\n")
    names = {"rigged": 1000.0, "still": 1000.0, "iced": 75.0, "bare": 0.0, "half": 50.0}
    table = {"rigged": "rig.csv", "iced": "line.csv", "bare": "none", "half": "line.csv"}
    text = CABLES + LOAD
    for name in names:
        text += f'[[stage]]\nname = "{name}"\n'
        text += f'load_table = "{table.get(name)}"\n' * (name in table)
        text += 'active = ["left"]\nhold = [2]\n' * (name == "half")
    f = workshop.solve(text + case("rig"), NODES, TWO)
    for name, weight in names.items():
        if name != "half":
            assert f[f"stages/{name}/tension"][:] == pytest.approx([symmetric(weight)] * 2, abs=1e-6)
    assert f["stages/half/reaction"][1, 2] == pytest.approx(-50.0)  # the right one is out, with its load


def test_values_of_zones_return_to_those_of_load(workshop):
    """A stage has snow by a table, the next another table: its missing values are those of [load]."""
    (workshop.folder / "deep.csv").write_text("zone,snow\nhalf,900\n")
    (workshop.folder / "lift.csv").write_text("zone,pressure\nhalf,-100\n")
    stages = "".join(
        f'[[stage]]\nname = "{name}"\nload_table = "{name}{end}"\n'
        for name, end in (("deep", ".csv"), ("lift", ".csv"), ("none", ""))
    )
    job = read_job(workshop.job(SADDLE + LOAD + "snow = 100.0\n" + stages))
    snow, pressure = "load.zone.half.snow", "load.zone.half.pressure"
    assert [stage.set for stage in job.stages] == [
        {snow: 900.0},
        {snow: 100.0, pressure: -100.0},
        {pressure: None},
    ]


MOVES = SADDLE + LOAD + 'load_table = "rig.csv"\n[dynamics]\nduration = 0.2\nmass_damping = 1.0\n'
MOVES += "[output]\nhistory_interval = 0.01\nframes = 4\ncheckpoint_interval = 0.1\n" + case("rig")


def test_a_load_table_has_equal_bits_on_ranks_and_after_a_restart(workshop):
    """The table acts suddenly without a static stage."""
    (workshop.folder / "rig.csv").write_text(RIG)
    job = workshop.job(MOVES)
    one = workshop.run(job)
    assert np.abs(one["envelope/displacement_max"][:]).max() > 1e-3
    assert_same_bits_on(2, job, one, workshop, "result")


def test_a_load_table_moves_the_net_like_loads_of_nodes(workshop):
    """Every dataset of the dynamic stage has the same bits."""
    (workshop.folder / "rig.csv").write_text("node,load_x,load_z\n2,10,-1000\n")
    ends = "[dynamics]\nduration = 0.2\n[output]\nhistory_interval = 0.01\nframes = 4\n"
    table = workshop.solve(CABLES + LOAD + 'load_table = "rig.csv"\n' + ends, NODES, TWO)
    with workshop.solve(CABLES + LOAD + ends, LOADED, TWO, output="nodes.vtkhdf") as nodes:
        assert assert_same_results(nodes, table) > 20


def test_a_changed_table_changes_the_digest(workshop):
    """A checkpoint of other loads is refused."""
    (workshop.folder / "rig.csv").write_text(RIG)
    job = workshop.job(MOVES)
    first = read_job(job).digest()
    (workshop.folder / "rig.csv").write_text(RIG.replace("2000", "2001"))
    assert read_job(job).digest() != first


def test_an_exported_job_uses_its_load_tables(workshop):
    """Loads of nodes, elements and a zone: cases have the same bits."""
    (workshop.folder / "rig.csv").write_text(RIG)
    (workshop.folder / "ice.csv").write_text("element,line_z\n3,-40\n4,-60\n3,-5\n")
    (workshop.folder / "drift.csv").write_text("zone,snow\nhalf,400\n")
    whole = SADDLE.replace("cut = true", "cut = false")
    f = workshop.solve(whole + LOAD + case("rig") + case("ice") + case("drift"))
    again, _ = workshop.run_exported()
    for name in ("rig", "ice", "drift"):
        assert np.array_equal(f[f"cases/{name}/tension"][:], again[f"cases/{name}/tension"][:])


WRONG = [
    ("node,load_z\n2,-1\n77,-1\n", "rig.csv: line 3: node = 77: the net has no such node. Give the id of"),
    ("element,line_z\n5,-1\n", "rig.csv: line 2: element = 5: the net has no such element. Give the id of"),
    ("node,load_z\n2,much\n", "rig.csv: line 2: load_z = 'much': expected a number in N"),
    ("node,load_z\n2.5,1\n", "rig.csv: line 2: node = '2.5': expected an integer"),
    ("node,load_z\n-,m\n2,1\n", "rig.csv: column load_z: unit \"m\" has another dimension"),
    ("node,line_z\n2,1\n", "rig.csv: columns node, line_z: expected node with load_x, load_y, load_z; or"),
    ("node,element,load_z\n2,7,1\n", "rig.csv: columns node, element, load_z: expected node with load_x"),
    ("node\n2\n", "rig.csv: columns node: expected node with load_x"),
    ("load_z\n2\n", "rig.csv: columns load_z: expected node with load_x"),
    ("node,laod_z\n2,1\n", "unknown column; did you mean \"load_z\"?"),
    ("zone,snow\nhalf,-3\n", "rig.csv: line 2: zone.snow = '-3.0': expected a number from 0 to 1e+09 N/m2"),
    ("zone,snow\na,3\na,4\n", 'rig.csv: line 3: zone = "a": line 2 has this zone already'),
    ("zone,pressure,pressure_z\na,3,4\n", "columns pressure and pressure_x, pressure_y, pressure_z exclude"),
    ("", "rig.csv: empty; expected a header with node, element, zone, load_x"),
    (None, "rig.csv: No such file or directory"),
    ("zone,snow\nhelf,3\n", 'rig.csv: line 2: zone: there is no zone "helf"; did you mean "half"?'),
    ("zone,snow\nhalf,3\n", "[[case]] rig: set: load.zone.half.snow and load_table exclude each other"),
]  # fmt: skip


@pytest.mark.parametrize("rows, line", WRONG)
def test_a_wrong_table_is_refused_with_its_row(workshop, rows, line):
    """File, row, column, value, allowed range and known zones; exit code 2."""
    if rows is not None:
        (workshop.folder / "rig.csv").write_text(rows)
    job = workshop.job(CABLES + LOAD + case("rig"), NODES, TWO)
    if "half" in line:
        more = 'set = {"load.zone.half.snow" = 4.0}\n' * ("exclude" in line)
        job = workshop.job(SADDLE + LOAD + case("rig", more))
    assert line.replace("zone.snow", "snow") in run_on_standing_ranks("check", job, code=2).stderr


@pytest.mark.parametrize(
    "part, line",
    [
        ('[[case]]\nname = "a"\nload_table = "none"\n', "none: No such file or directory"),
        ('[[stage]]\nname = "a"\nload_table = "none"\n', "no effect without one in an earlier stage"),
    ],
)
def test_none_ends_only_the_table_of_an_earlier_stage(workshop, part, line):
    """The table of [load] acts in all stages and cases."""
    (workshop.folder / "rig.csv").write_text("node,load_z\n5,-100\n")
    job = workshop.job(SADDLE + LOAD + 'load_table = "rig.csv"\n' + part)
    assert line in run_on_standing_ranks("check", job, code=2).stderr


def test_all_errors_of_tables_come_at_once(workshop):
    """For two tables of zones, and only once if two cases name one table."""
    (workshop.folder / "a.csv").write_text("zone,snow\nhalf,-1\n")
    (workshop.folder / "b.csv").write_text("zone,dead\nhalf,1\nrest,x\n")
    job = workshop.job(SADDLE + LOAD + case("a") + case("b") + '[[case]]\nname = "c"\nload_table = "a.csv"\n')
    lines = run_on_standing_ranks("check", job, code=2).stderr.splitlines()
    assert len(lines) == 2 and "a.csv: line 2: snow" in lines[0] and "b.csv: line 3: dead" in lines[1]


def test_combinations_without_the_loads_of_a_table_are_named(workshop):
    """A table of [load] without the factor of load; weights of nodes without mass if they move."""
    (workshop.folder / "rig.csv").write_text("node,load_z\n2,-1000\n")
    text = CABLES + LOAD + 'load_table = "rig.csv"\n[dynamics]\nduration = 0.01\n'
    text += '[[case]]\nname = "a"\nset = {"load.temperature" = 5.0}\n[combinations]\nu = {a = 1.0}\n'
    job = workshop.job(text, NODES, TWO)
    output = workshop.check(job)
    assert "the factors do not name load, so snow, ice and pressure of [load], and loads of nodes" in output
    assert "W342" in output and "warning: load_z of node 2: 1000 N downward without mass" in output
