"""Supports in rotated axes: the column `angle` of nodes.csv."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Workshop, assert_same_results, run_on_standing_ranks
from test_validation_opensees import tensions_in_opensees

from netfall.core.errors import InputError
from netfall.core.functions import from_rotated_axes, lengths
from netfall.driver.modes import modes_at
from netfall.exchange.export import export
from netfall.geometry.build import build_net
from netfall.job.csv_table import write_table
from netfall.job.read import read_job
from netfall.physics.supports import project_on_guides
from netfall.post.checks.nodes import reaction_columns
from netfall.statics.form.self_stress import self_stress

ANGLE = 37.0  # degrees
SAME = 1e-9  # of the largest: each equilibrium is found to 1e-11
SAME_FORM = 1e-8  # of forms that are found to 3e-11
BARS = ("ring_outer", "ring_truss", "strut")
JOB = (
    '[net]\nnodes = "nodes.csv"\nelements = "elements.csv"\n'
    "[cable]\ndensity = 7850.0\n"
    + "".join(f'[group.{group}]\nkind = "bar"\n' for group in BARS)
    + '[roof]\ngroups = ["ring_outer", "ring_upper", "upper", "hoop"]\n'
    "openings = [[0.0, 0.0]]\n[load]\ntolerance = 1e-11\nself_weight = true\ndead = 250.0\nsteps = 2\n"
    '[[case]]\nname = "snow"\nset = {"load.snow" = 400.0}\n'
    '[[combination]]\nname = "all"\nfactors = {permanent = 1.35, snow = 1.5, load = 1.2, prestress = 1.1}\n'
)


def wheel(folder, angle: float, more: str = "", tighter: float = 1.0, guides: bool = True):
    """Return tables and job of a wheel of twelve spokes, turned about z with all its supports.

    tighter : factor of the prestress of three elements, which loads the supports
    guides : whether any is held along a line; otherwise a stiff spring replaces it

    Of the supports at the ring one is held along a line and has a spring across, two have springs.
    """
    changes = [f"net.wheel.{change}" for change in ("spokes=12", "hoops=1", "ring_groups=false")]
    net = build_net(read_job(ROOT / "jobs" / "wheel.toml", changes))
    supports = np.flatnonzero(net.fixed.any(1))
    fixed, spring = net.fixed.astype(int), np.zeros((net.n, 3))
    spring[supports[1], :2], spring[supports[2], :2] = (2e7, 0.0), (3e7, 5e6)
    fixed[supports[4], 0], spring[supports[4], 1] = 1, 4e6
    if not guides:
        held = fixed[:, :2] > 0
        spring[:, :2], fixed[:, :2] = np.where(held, 1e9, spring[:, :2]), 0
    load = np.random.default_rng(1).normal(0.0, 2e3, (net.n, 3))
    turned = np.full(net.n, angle)
    x, load = from_rotated_axes(net.x, turned), from_rotated_axes(load, turned)
    columns = {"id": net.node_id} | {k: x[:, i] for i, k in enumerate("xyz")}
    for name, rows in (("fixed", fixed), ("spring", spring), ("load", load)):
        columns |= {f"{name}_{k}": rows[:, i] for i, k in enumerate("xyz")}
    folder.mkdir()
    write_table(folder / "nodes.csv", columns | ({"angle": turned} if angle else {}))
    start, end = net.node_id[net.elements].T
    names = np.array(net.group_names)[net.group]
    prestress = net.prestress.copy()
    prestress[np.flatnonzero(prestress > 0.0)[:3]] *= tighter
    elements = {"start": start, "end": end, "group": names, "prestress": prestress}
    write_table(folder / "elements.csv", elements | {"area": net.section, "modulus": net.modulus})
    (folder / "job.toml").write_text(JOB + more)
    return folder / "job.toml"


def both(folder: Path, of, *more, **how) -> list:
    """Return of(job) for the job of a wheel and for that of the same one rotated; arguments as in `wheel`."""
    angles = {"straight": 0.0, "turned": ANGLE}
    return [of(wheel(folder / name, angle, *more, **how)) for name, angle in angles.items()]


def guided_in(job: Path, cells=("0", "1")) -> tuple[int, str]:
    """Return row and id of the first node whose columns from fixed_x on have these cells."""
    rows = [line.split(",") for line in (job.parent / "nodes.csv").read_text().splitlines()[1:]]
    return next((k, row[0]) for k, row in enumerate(rows) if row[4 : 4 + len(cells)] == list(cells))


def result_of(job: Path):
    """Return the result of a job, next to its folder and with its name."""
    return Workshop(job.parent.parent, True).run(job, output=f"{job.parent.name}.vtkhdf")


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """Return the results of a wheel and of the same one rotated."""
    return both(tmp_path_factory.mktemp("wheels"), result_of)


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference, relative to the largest value."""
    return np.abs(one - other).max() / np.abs(one).max()


def rotated_rows(rows: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) rotated by ANGLE."""
    return from_rotated_axes(rows, np.full(len(rows), ANGLE))


def assert_rotated(one, other, within: float = SAME, row=...) -> None:
    """Check that tensions of two states are equal, and displacements and reactions rotated."""
    assert apart(one["tension"][row], other["tension"][row]) < within
    for name in ("displacement", "reaction"):
        assert apart(rotated_rows(one[name][row]), other[name][row]) < within, name


@pytest.mark.parametrize("place", ["statics", "cases/snow", "cases/all"])
def test_a_net_rotated_with_its_supports_has_rotated_results(wheels, place):
    assert_rotated(*(f[place] for f in wheels), row=-1 if place == "statics" else ...)


def test_the_reactions_of_the_report_rotate_with_the_net(wheels):
    one, other = map(reaction_columns, wheels)
    for kind in ("force", "foundation"):
        rows, turned = (np.column_stack([f[f"{kind}_{k}"] for k in "xyz"]) for f in (one, other))
        assert apart(rotated_rows(rows), turned) < SAME, kind


def test_exported_tables_of_a_rotated_net_give_the_same_forces(wheels, tmp_path):
    """Lengths replace the prestress, to rounding."""
    folder = Path(wheels[1].filename).parent
    export(folder / "turned.vtkhdf", tmp_path / "again", print)
    f = Workshop(tmp_path, True).run(tmp_path / "again" / "job.toml")
    assert apart(f["cases/all/tension"][:], wheels[1]["cases/all/tension"][:]) < SAME
    with pytest.raises(InputError, match="held along one axis at an angle, for which OpenSees has no fix"):
        export(folder / "turned.vtkhdf", tmp_path / "w.tcl", print)


def test_a_bar_at_a_guide_with_a_spring_by_hand(workshop):
    """A load and a bar along x, a guide at 30 degrees with a spring along it: d = F c / (k + c^2 EA / L). The
    spring carries k d along the guide, the guide the remaining load and bar force across it.
    """
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,spring_x,angle,load_x\n"
    nodes += "1,0,0,0,0,1,1,2e6,30,1000\n2,-4,0,0,1,1,1,0,0,0\n"
    text = '[cable]\nkind = "bar"\nmodulus = 1e10\narea = 4e-4\ndensity = 1.0\n[load]\nself_weight = false\n'
    text += 'tolerance = 1e-12\n[[case]]\nname = "a"\nset = {"load.snow" = 0.0}\n'
    f = workshop.solve(text, nodes, "start,end\n2,1\n")
    c, s, k, bar = np.sqrt(0.75), 0.5, 2e6, 1e6
    d = 1000.0 * c / (k + c * c * bar)
    along, across = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
    by_hand = k * d * along + (1000.0 - bar * c * d) * -s * across
    # the bar turns by d s / L = 2.7e-5, which the hand calculation omits
    assert f["cases/a/displacement"][0] == pytest.approx(d * along, rel=1e-4, abs=1e-12)
    assert f["cases/a/tension"][0] == pytest.approx(bar * c * d, rel=1e-4)
    assert f["cases/a/reaction"][0] == pytest.approx(by_hand, rel=1e-4, abs=0.02)
    assert f["cases/a/reaction"][:].sum(0) == pytest.approx([1000.0, 0.0, 0.0], abs=1e-6)


def test_opensees_finds_the_tensions_of_a_wheel_on_rotated_springs(tmp_path):
    """zeroLength elements have the axes of the springs."""
    f = Workshop(tmp_path, True).run(wheel(tmp_path / "w", ANGLE, guides=False))
    export(tmp_path / "result.vtkhdf", tmp_path / "s.tcl", print, case="snow")
    assert (tmp_path / "s.tcl").read_text().count("-orient") == 7
    theirs = tensions_in_opensees(tmp_path / "s.tcl")
    assert [*theirs] == f["net/element_id"][:].tolist()
    # of the largest; the case is found to 1e-11, OpenSees stops at ways of 1e-12 m
    assert apart(f["cases/snow/tension"][:], np.array([*theirs.values()])) < 1e-8


FORM = "[form_finding]\ntolerance = 3e-11\nmodulus_factor = 1.0\n"


def test_forms_and_springs_with_initial_reactions_rotate(tmp_path):
    """Form finding also holds rotated axes with springs, which then carry the reactions without motion."""
    results = both(tmp_path, result_of, FORM, tighter=1.05)
    assert_rotated(*(f["cases/all"] for f in results), SAME_FORM)
    assert np.abs(results[1]["provenance/net/spring_rest"][:]).max() > 1e-6


def test_the_self_stress_of_a_geometry_rotates(tmp_path):
    """Each node is in equilibrium along its free rotated axes, for the states nearest to a prestress."""

    def of(job):
        net = build_net(read_job(job))
        alone = replace(net, group=np.arange(net.m), group_names=[str(e) for e in range(net.m)])
        return net, self_stress(alone, None, 1e-9)

    (_, one), (net, other) = both(tmp_path, of, tighter=1.05)
    assert apart(one.N, other.N) < SAME and len(one.states) == len(other.states)
    assert np.abs(other.residual).max() < SAME * np.abs(one.N).max()
    assert apart(net.prestress, one.N) > 1e-4  # the nearest, not what was asked


def test_modes_rotate_with_the_supports(tmp_path):
    def of(job):
        net = build_net(read_job(job))
        L = lengths(net.x[net.elements[:, 1]] - net.x[net.elements[:, 0]])
        L0 = L / (1.0 + net.prestress / net.EA)
        return modes_at(net, net.x, net.prestress, L0, np.full(net.n, 1e3), 4)

    one, other = both(tmp_path, of)
    assert other.period == pytest.approx(one.period, rel=1e-8)
    assert other.effective_mass[:, 2] == pytest.approx(one.effective_mass[:, 2], rel=1e-6, abs=1e-12)
    shape = rotated_rows(one.shape[0])
    assert min(np.abs(shape - other.shape[0]).max(), np.abs(shape + other.shape[0]).max()) < 1e-6


STAGES = """[[stage]]
name = "tight"
hold = [{guided}]
lengths = {{"hoop" = {{change = -0.002}}}}
[[stage]]
name = "let go"
release = [{guided}]
set = {{"load.snow" = 200.0}}
"""


def test_stages_of_erection_rotate_with_the_supports(tmp_path):
    def of(job):
        guided = guided_in(job, ["1", "0", "1", "0.0"])[1]
        loads = JOB.split("[[case]]")[0].replace("steps = 2", "steps = 0")
        job.write_text(loads + STAGES.format(guided=guided))
        return result_of(job)

    results = both(tmp_path, of)
    for stage in ("tight", "let go"):
        one, other = (f[f"stages/{stage}"] for f in results)
        assert one.attrs["state"] == other.attrs["state"] == "equilibrium"
        assert_rotated(one, other)


def test_a_guided_support_moves_while_both_axes_are_held(tmp_path):
    """Otherwise it is refused with this remedy. Later it keeps its displacement across the guide."""
    job = wheel(tmp_path / "w", ANGLE)
    row, guided = guided_in(job)
    move = f'[[stage]]\nname = "moved"\nmove = {{{guided} = [0.0, 0.001, 0.0]}}\n'
    held = f'hold = {{{guided} = "xy"}}\n[[stage]]\nname = "free"\nrelease = {{{guided} = "x"}}\n'
    text = JOB.split("[[case]]")[0].replace("steps = 2", "steps = 0")
    job.write_text(text + move)
    done = Workshop(tmp_path, True).run(job, code=2)
    advice = "along both axes in plan, and release in the next stage the axes that were free before"
    assert advice in done.stdout + done.stderr
    job.write_text(text + move + held)
    f = Workshop(tmp_path, True).run(job)
    angle = np.radians(ANGLE)
    moved, free = (f[f"stages/{name}/displacement"][row] for name in ("moved", "free"))
    assert moved == pytest.approx([0.0, 0.001, 0.0], abs=1e-12)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    assert free[:2] @ across == pytest.approx(moved[:2] @ across, abs=1e-12)
    assert f["stages/moved/reaction"][row, :2] @ along != pytest.approx(0.0, abs=1.0)
    assert f["stages/free/reaction"][row, :2] @ along == pytest.approx(0.0, abs=1e-3)


MOVES = "[[remove]]\nelements = [{lost}]\ntime = 0.1\n[dynamics]\n"
MOVES += "duration = 0.3\nmass_damping = 0.5\n[output]\nframes = 3\nhistory_interval = 0.05\n"


def hoop_of(path) -> int:
    """Return the first element of a table that is a hoop."""
    lines = path.read_text().splitlines()[1:]
    return next(e for e, line in enumerate(lines) if ",hoop," in line)


@pytest.fixture(scope="module")
def swings(tmp_path_factory):
    """Return a case and the motion of a wheel without a hoop, and of the same one rotated, on one rank."""

    def of(job):
        loads = JOB.replace("steps = 2\n", "steps = 0\n").split("[[combination]]")[0]
        job.write_text(loads + MOVES.format(lost=hoop_of(job.parent / "elements.csv")))
        return result_of(job)

    return both(tmp_path_factory.mktemp("swings"), of)


def test_the_motion_rotates_with_the_supports(swings):
    one, other = swings
    assert apart(one["final/tension"][:], other["final/tension"][:]) < SAME
    for name in ("tension_before", "tension_peak", "tension_after"):
        assert apart(*(np.nan_to_num(f[f"removal/{name}"][:]) for f in swings)) < SAME, name
    moved = [f["final/position"][:] - f["net/particles"][:] for f in swings]
    assert apart(rotated_rows(moved[0]), moved[1]) < SAME
    for name in ("kinetic_energy", "strain_energy", "external_work", "damping_work"):
        assert apart(one[f"history/{name}"][:], other[f"history/{name}"][:]) < SAME, name
    # forces of springs and guides among them; rounding over a thousand steps
    assert np.abs(other["history/work_identity_error"][:]).max() < 1e-11
    assert np.abs(other["history/energy_balance_error"][:]).max() == pytest.approx(
        np.abs(one["history/energy_balance_error"][:]).max(), rel=1e-6, abs=5e-11
    )


def test_rotated_supports_have_the_same_bits_on_ranks(swings):
    """In statics, after a removal and in motion: halo particles stay on their guides like owned ones."""
    folder = Path(swings[1].filename).parent
    with Workshop(folder, True).run(folder / "turned" / "job.toml", ranks=3) as several:
        assert_same_results(swings[1], several)


@pytest.mark.parametrize(
    "more, words",
    [
        ('[[slide]]\ngroup = "hoop"\n', "[[slide]] does not support rotated supports"),
        ('[form_finding]\nmethod = "force_density"\n', 'method = "force_density" does not support rotated'),
    ],
)
def test_features_without_rotated_supports_are_refused(tmp_path, more, words):
    job = wheel(tmp_path / "w", ANGLE, more)
    done = Workshop(tmp_path, True).run(job, code=2)
    assert words in done.stdout + done.stderr and "7 nodes" in done.stdout + done.stderr


def test_a_guided_support_can_settle_only_along_z(tmp_path):
    """Along x or y: exit code 2. An angle without held axes is a note."""
    job = wheel(tmp_path / "w", ANGLE)
    case = f'[[case]]\nname = "way"\nsettlement = {{{guided_in(job)[1]} = [0.01, 0.0, -0.02]}}\n'
    job.write_text(JOB + case)
    done = Workshop(tmp_path, True).run(job, code=2)
    assert "settles only along z" in done.stdout + done.stderr
    job.write_text(JOB)
    assert "column angle of" in run_on_standing_ranks("check", job).stdout


def test_an_infinite_force_at_a_guide_gives_nan_without_a_warning():
    """A run that diverges prints no warning of NumPy."""
    forces = np.array([[np.inf, 1.0, 0.0], [2.0, 1.0, 0.0]])
    project_on_guides(np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), forces)
    assert np.isnan(forces[0, 0]) and forces[1].tolist() == [0.0, 1.0, 0.0]
