"""Wind and ice on elements with a diameter, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import BARE, STEEL, refused, run_on_standing_ranks
from nets import problem_of, table
from results import rows_of
from scipy.optimize import brentq
from test_gusts import load_on

from netfall.driver.check import check_values
from netfall.geometry.net import GRAVITY
from netfall.geometry.slender import SlenderElements
from netfall.job.read import read_job
from netfall.loads.loads import exposed_patches
from netfall.loads.wind.surface import SurfaceMeans, make_surface

STIFF = BARE.replace("1.95e11", "1e14")
RHO, U = 1.25, 30.0  # kg/m3, m/s
HEAD = "id,x,y,z,fixed\n"
UNIFORM = '"wind.speed" = 30.0, "wind.profile_exponent" = 0.0'


def case(settings: str, name: str = "wind") -> str:
    return f'[[case]]\nname = "{name}"\nset = {{{settings}}}\n'


def stay(elevation: float) -> tuple[str, str, np.ndarray]:
    """Return tables and axis of a stay of 40 m in two elements that rises along x; its middle is free."""
    axis = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    rows = [(k, *x, int(k != 1)) for k, x in enumerate(np.outer((0, 20, 40), axis))]
    return table("id,x,y,z,fixed", rows), "start,end,group\n0,1,g\n1,2,g\n", axis


@pytest.mark.parametrize("direction", [0.0, 180.0, 90.0, 30.0])
def test_wind_on_an_inclined_stay_acts_across_its_axis(workshop, direction):
    """F = q c_d d L sin^2 of the angle between wind and axis. Along the plane of the stay, rising at b, it is
    q c_d d L sin^2 b, sin b of it along the wind and cos b of it down or up.
    """
    b, d, c_d, L = np.radians(50.0), 0.1, 0.7, 40.0
    nodes, elements, axis = stay(b)
    text = BARE + f"[group.g]\nprestress = 2e4\ndiameter = {d}\ndrag_coefficient = {c_d}\n"
    text += case(f'{UNIFORM}, "wind.direction" = {direction}')
    f = workshop.run_here(workshop.job(text, nodes, elements))
    force = f["cases/wind/load"][:]
    full, a = 0.5 * RHO * U**2 * c_d * d * L, np.radians(direction)
    sin = np.sqrt(1.0 - (np.cos(a) * np.cos(b)) ** 2)
    total = force.sum(0)
    assert np.linalg.norm(total) == pytest.approx(full * sin**2, rel=1e-12)
    assert total @ axis == pytest.approx(0.0, abs=1e-12 * full)
    drag = total @ [np.cos(a), np.sin(a), 0.0]
    assert drag == pytest.approx(full * sin**3, rel=1e-12)  # never a thrust
    if direction in (0.0, 180.0):
        sign = np.cos(a)
        by_hand = [sign * np.sin(b) ** 3, 0.0, -sign * np.sin(b) ** 2 * np.cos(b)]
        assert total == pytest.approx(full * np.array(by_hand), rel=1e-12, abs=1e-12 * full)
    assert force == pytest.approx(np.outer((0.25, 0.5, 0.25), total), rel=1e-12, abs=1e-12 * full)


def test_a_horizontal_cable_deflects_with_the_wind(workshop):
    """The middle node of 2 x 20 m has half of the wind: 2 N w / l = F / 2, N = EA (l / L0 - 1)."""
    d, EA, l0 = 0.05, 1.95e11 * 683.08e-6, 20.0
    L0, F = l0 / (1.0 + 1e4 / EA), 0.5 * RHO * U**2 * 1.2 * d * 40.0
    pull = lambda w: 2.0 * EA * (np.hypot(l0, w) / L0 - 1.0) * w / np.hypot(l0, w) - F / 2.0
    text = BARE + f"prestress = 1e4\ndiameter = {d}\n" + case(f'{UNIFORM}, "wind.direction" = 90.0')
    nodes = HEAD + "0,0,0,10,1\n1,20,0,10,0\n2,40,0,10,1\n"
    f = workshop.run_here(workshop.job(text, nodes, "start,end\n0,1\n1,2\n"))
    moved = f["cases/wind/displacement"][1]
    assert moved == pytest.approx([0.0, brentq(pull, 0.0, 5.0, xtol=1e-12), 0.0], rel=1e-5, abs=1e-7)


MAST = HEAD + "0,0,0,0,1\n1,0,0,60,0\n2,-40,-30,0,1\n3,-40,30,0,1\n"
GUYS = "start,end,group\n0,1,mast\n2,1,guy\n3,1,guy\n"
SECTIONS = STIFF + '[group.mast]\nkind = "bar"\ndiameter = 0.4\ndrag_coefficient = 1.0\n'
SECTIONS += "[group.guy]\ndiameter = 0.03\n"


def on_top_and_foot(ice: float, direction: float, exponent: float, base: float):
    """Return the wind [N] at 30 m/s on the four nodes of the guyed mast, by hand."""
    x = np.array([[0, 0, 0], [0, 0, 60], [-40, -30, 0], [-40, 30, 0]], float)
    u = np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction)), 0.0])
    force = np.zeros((4, 3))
    for a, b, c_d, d in ((0, 1, 1.0, 0.4), (2, 1, 1.2, 0.03), (3, 1, 1.2, 0.03)):
        L = np.linalg.norm(x[b] - x[a])
        across = np.cross((x[b] - x[a]) / L, np.cross(u, (x[b] - x[a]) / L))
        F = 0.5 * RHO * c_d * (d + 2.0 * ice) * L * np.linalg.norm(across) * across
        for node in (a, b):
            force[node] += 0.5 * F * (U * (max(x[node, 2] + base, 1.0) / 10.0) ** exponent) ** 2
    return x, force


@pytest.mark.parametrize("direction, ice", [(0.0, 0.0), (20.0, 0.02)])
def test_a_guyed_mast_by_statics(workshop, direction, ice):
    """Three forces hold the top of a hinged mast with two windward guys; foundations carry all wind."""
    exponent, base = 0.16, 5.0
    settings = f'"wind.speed" = {U}, "wind.base_height" = {base}, "wind.direction" = {direction}'
    text = SECTIONS + "[load]\nself_weight = false\n" + case(settings + f', "load.ice" = {ice}' * (ice > 0.0))
    job = workshop.job(text, MAST, GUYS)
    f = workshop.run_here(job)
    x, force = on_top_and_foot(ice, direction, exponent, base)
    L = np.linalg.norm(x[1] - x[[0, 2, 3]], axis=1)
    if ice:
        weight = GRAVITY * 900.0 * np.pi * (np.array([0.4, 0.03, 0.03]) * ice + ice**2) * L
        force[[0, 2, 3], 2] -= 0.5 * weight
        force[1, 2] -= 0.5 * weight.sum()
    assert f["cases/wind/load"][:] == pytest.approx(force, rel=1e-9, abs=1e-9 * np.abs(force).max())
    axes = (x[[0, 2, 3]] - x[1]).T / L
    N = np.linalg.solve(axes, -force[1])
    assert f["cases/wind/tension"][:] == pytest.approx(N, rel=1e-4)
    assert N[0] < 0.0 < N[1:].min()
    f.close()
    run_on_standing_ranks("report", workshop.folder / "result.vtkhdf", "-o", workshop.folder / "report")
    rows = rows_of(workshop.folder / "report" / "reactions.csv")
    at = {row["node"]: row for row in rows if row["stage"] == "case wind"}
    foundation = np.array([[float(at[k][f"foundation_{axis}"]) for axis in "xyz"] for k in "023"])
    assert foundation.sum(0) == pytest.approx(force.sum(0), rel=1e-4, abs=1e-4 * np.abs(force).max())
    assert foundation[0] == pytest.approx(force[0] - N[0] * axes[:, 0], rel=1e-4, abs=1.0)
    lines: list[str] = []
    loads = {each["load"]: each["resultant"] for each in check_values(read_job(job), lines)["slender_loads"]}
    drag = on_top_and_foot(ice, direction, exponent, base)[1].sum(0)
    assert loads["wind of [[case]] wind"] == pytest.approx(drag, rel=1e-9)
    assert ("ice of [[case]] wind" in loads) == bool(ice)
    assert any("wind of [[case]] wind on elements with a diameter: resultant" in line for line in lines)
    assert not any("area" in line for line in lines if line.startswith("warning"))


# --- ice, gusts, ranks


def model_of(job):
    """Return the model of a job, and its wind field."""
    model = problem_of(read_job(job)).root_model
    return model, model.wind_field


GUSTY = """[wind]
speed = 25.0
base_height = 0.0
turbulence_intensity = 0.2
gust_field = "area_mean"
direction = 35.0
{more}
[dynamics]
duration = {duration}
mass_damping = 0.5
"""


def mast(levels: int = 3, parts: int = 4, diameter: float = 0.3) -> tuple[str, str, str]:
    """Return a mast of 60 m with guys at levels in three directions, balanced by one force at each level."""
    k = levels * parts
    nodes = [f"{i},0,0,{60.0 * i / k},{int(i == 0)}" for i in range(k + 1)]
    elements = [f"{i},{i + 1},mast{i // parts}" for i in range(k)]
    for j, angle in enumerate(np.radians([90.0, 210.0, 330.0])):
        nodes.append(f"{k + 1 + j},{float(40 * np.cos(angle))!r},{float(40 * np.sin(angle))!r},0,1")
        elements += [f"{k + 1 + j},{parts * (i + 1)},guy{i}" for i in range(levels)]
    text = BARE + '[group."mast*"]\nkind = "bar"\narea = 6e-3\nsecond_moment = 3e-5\nbending = true\n'
    text += f'diameter = {diameter}\ndrag_coefficient = 0.9\nprestress = -1e5\n[group."guy*"]\n'
    text += f'prestress = 4e4\ndiameter = {diameter / 10.0}\n[form_finding]\nmethod = "given_geometry"\n'
    return text, HEAD + "\n".join(nodes) + "\n", "start,end,group\n" + "\n".join(elements) + "\n"


def mast_job(workshop, more: str, name: str = "job", bends: bool = True):
    """Return a job of the mast with one level and further sections."""
    text, *tables = mast(1, 2)
    return workshop.job((text if bends else text.replace("bending = true\n", "")) + more, *tables, name)


def test_ice_has_weight_and_mass(workshop):
    """rho_ice pi (d t + t^2) per metre of unstressed length, as a mass and as a live load."""
    wind = GUSTY.format(duration=0.01, more="")
    job = mast_job(workshop, "[load]\nice = 0.015\n" + wind)
    bare = mast_job(workshop, "[load]\n" + wind, "bare")
    (iced, field), (light, bare_field) = model_of(job), model_of(bare)
    d, guys = np.where(iced.net.bar, 0.3, 0.03), ~iced.net.bar
    mass = 900.0 * np.pi * (d * 0.015 + 0.015**2) * iced.L0
    added = iced.mass - light.mass
    assert added.sum() == pytest.approx(mass.sum(), rel=1e-12)
    assert added[-3:] == pytest.approx(0.5 * mass[guys], rel=1e-12)
    assert iced.loading.carried == pytest.approx(added, rel=1e-9)
    assert iced.load[:, 2] - light.load[:, 2] == pytest.approx(-GRAVITY * added, rel=1e-9)
    thicker = field.force[[0, -1], 0] / bare_field.force[[0, -1], 0]  # only of the mast, only of a guy
    assert thicker == pytest.approx([(0.3 + 0.03) / 0.3, (0.03 + 0.03) / 0.03], rel=1e-12)


def test_ice_of_combinations_is_an_action(workshop):
    """A combination has the case's factor times its ice, and that of `load` times the ice of [load]."""
    text = "[load]\nself_weight = false\nice = 0.01\n" + case('"load.ice" = 0.03', "iced")
    text += "[combinations]\n" + '"one" = {load = 1.5, iced = 1.2}\n'
    f = workshop.run_here(mast_job(workshop, text))
    L0, d = f["net/unstressed_length"][:], f["net/diameter"][:]
    assert f["load/ice"][()] == 0.01
    weight = lambda t: GRAVITY * 900.0 * np.pi * ((d * t + t * t) * L0).sum()
    assert -f["cases/iced/load"][:, 2].sum() == pytest.approx(weight(0.03), rel=1e-12)
    combined = 1.5 * weight(0.01) + 1.2 * (weight(0.03) - weight(0.01))
    assert -f["cases/one/load"][:, 2].sum() == pytest.approx(combined, rel=1e-12)


def test_the_mean_wind_in_motion_is_that_of_statics(workshop):
    """Without gusts the dynamic stage has the equilibrium of a case with that wind."""
    wind = GUSTY.format(duration=0.2, more="").replace("= 0.2\ngust", "= 0.0\ngust")
    load = "[load]\nice = 0.01\ntolerance = 1e-9\n" + case('"wind.pressure_factor" = 1.0')
    f = workshop.run_here(mast_job(workshop, load + wind))
    statics = f["net/particles"][:] + f["cases/wind/displacement"][:]
    moved = f["VTKHDF/Points"][-len(statics) :]
    size = np.abs(f["cases/wind/displacement"][:]).max()
    assert size > 0.01
    assert moved == pytest.approx(statics, abs=1e-5 * size)


def test_gusts_on_a_mast_have_the_variance_of_the_coherence(workshop):
    """The resultant of 2 f U g over all nodes has the sum over pairs of Davenport's coherence."""
    from netfall.loads.wind.field import _correlation
    from netfall.physics.wind_spectra import make_gust

    text, nodes, elements = mast(3, 6)
    job = workshop.job(text + "[load]\n" + GUSTY.format(duration=1.0, more=""), nodes, elements)
    model, field = model_of(job)
    wind = read_job(job).wind
    along = np.array([np.cos(np.radians(35.0)), np.sin(np.radians(35.0)), 0.0])
    load = 2.0 * (field.force @ along) * field.mean
    of_points = load_on(field, load)
    variance = of_points @ field.model.covariance @ of_points
    gust, slender = make_gust(wind), model.roof.slender
    drag = 0.5 * RHO * slender.drag_areas(35.0, 0.0) @ along
    row, end, part = (grid.ravel() for grid in np.indices((len(slender.ends), 2, 6)))
    part = (part + 0.5) / 12.0
    node, far = slender.ends[row, end], slender.ends[row, 1 - end]
    x = model.x[node] + part[:, None] * (model.x[far] - model.x[node])
    mean = field.mean[node]
    load = 2.0 * drag[row] / 12.0 * mean
    assert load.sum() == pytest.approx(2.0 * ((field.force @ along) * field.mean).sum(), rel=1e-9)
    y = np.column_stack([x @ along, x @ [-along[1], along[0], 0.0], x[:, 2]])
    apart = np.abs(y[:, None] - y[None]) * wind.coherence_decay
    delay = np.linalg.norm(apart, axis=2) / (0.5 * (mean[:, None] + mean))
    correlation = _correlation(delay.ravel(), gust, wind.time_step).reshape(delay.shape)
    assert variance == pytest.approx(load @ correlation @ load * gust.deviation**2, rel=0.03)
    assert 0.3 < variance / (load.sum() * gust.deviation) ** 2 < 0.9  # neither equal nor independent gusts
    text = mast(3, 6, 0.6)[0] + "[load]\n" + GUSTY.format(duration=1.0, more="")
    thick = workshop.job(text, nodes, elements, "thick")
    assert model_of(thick)[1].force == pytest.approx(2.0 * field.force, rel=1e-12)


@pytest.mark.parametrize("direction", [0.0, 35.0])
def test_fast_gusts_average_over_long_elements(workshop, direction):
    """The load on a mast of six elements of 10 m by the integral over its height, up to 10 Hz.

    The nodes as squares of the exposed area had 1.8 times the power at 5 Hz.
    """
    nodes = table("id,x,y,z,fixed", [(k, 0, 0, 10 * k, int(k == 0)) for k in range(7)])
    elements = table("start,end,group", [(k, k + 1, "mast") for k in range(6)])
    text = BARE + "[group.mast]\ndiameter = 0.3\ndrag_coefficient = 1.0\nprestress = 1e5\n"
    text += f"[wind]\nspeed = 40.0\nbase_height = 10.0\nturbulence_intensity = 0.2\ndirection = {direction}\n"
    job = read_job(workshop.job(text + "[dynamics]\nduration = 0.1\n", nodes, elements))
    model, _ = model_of(job.path)
    patches = exposed_patches(model.roof, model.x, job.wind, job.load)
    assert patches[0][:, 2] == pytest.approx([2.5, 10, 20, 30, 40, 50, 57.5])
    surface = make_surface(patches, model.wind, np.full(7, 40.0), np.array([8.0, 16.0, 10.0]), 25)
    share = surface.over_patches(surface.area)[:, None] / surface.area.sum()
    n, a = np.array([0.1, 0.5, 1.0, 2.5, 5.0, 10.0]), np.linspace(0.0, 60.0, 20_001)
    ours = SurfaceMeans(*surface.pairs(share, (8.0, 16.0, 10.0))).covariances(n, np.eye(6))[:, 0, 0]
    expected = [np.trapezoid(2.0 * (60.0 - a) * np.exp(-f * 10.0 * a / 40.0), a) / 60.0**2 for f in n]
    assert ours == pytest.approx(expected, rel=0.05)


def test_roof_areas_next_to_their_nodes_have_no_negative_variance():
    """Level areas of nodes without slender elements, whose centres are above the nodes."""
    x = np.random.default_rng(1).uniform(-1.0, 1.0, (1000, 3))
    ends, axis = np.array([[0, 1]]), np.array([[0.0, 0.0, 1.0]])
    slender = SlenderElements(1000, np.zeros(1, int), ends, axis, *np.ones((4, 1)))
    level = np.array([0.0, 0.0, 1.0]) * np.linspace(0.1, 0.7, 1000)[:, None]
    roof = SimpleNamespace(vector=level, centre=0.7 * x, slender=slender)
    centre, variance = exposed_patches(roof, x, SimpleNamespace(direction=0.0), None)
    assert centre[2:] == pytest.approx(0.7 * x[2:]) and variance.min() == 0.0


# --- detached parts, input


def test_detached_cables_have_the_drag_of_their_length(workshop):
    """rho / 2 times the roof area and half of c_d (d + 2 t) L of each element at a node, in any direction."""
    text = "[load]\nice = 0.02\n" + GUSTY.format(duration=0.1, more="")
    text += "[[remove]]\ngroup = 'guy0'\ntime = 0.05\n"
    model, _ = model_of(mast_job(workshop, text, bends=False))
    guy = 0.5 * 0.5 * RHO * 1.2 * (0.03 + 0.04) * np.hypot(40.0, 60.0)
    assert model.drag.size[-3:] == pytest.approx(guy, rel=1e-12)
    bar = 0.5 * RHO * 0.9 * (0.3 + 0.04) * 60.0
    assert model.drag.size.sum() == pytest.approx(bar + 6.0 * guy, rel=1e-12)


@pytest.mark.parametrize(
    "old, new, error",
    [
        ("diameter = 0.03\n", "drag_coefficient = 1.1\n", "[group.guy*] drag_coefficient: has no effect"),
        ("[load]\n", "[load]\nice = -0.01\n", "[load] ice = -0.01"),
        ("diameter = 0.03\n", "diameter = 0.0\n", "diameter = 0.0"),
    ],
)
def test_wrong_keys_are_refused(workshop, old, new, error):
    text, nodes, elements = mast(1, 2)
    text += "[load]\n"
    assert text.count(old) == 1
    assert error in refused("check", workshop.job(text.replace(old, new), nodes, elements))


@pytest.mark.parametrize(
    "more, words",
    [
        ("[load]\nice = 0.01\n", "[load] ice: has no effect without [group.NAME] diameter"),
        (case('"load.ice" = 0.01'), "[[case]] wind: set: ice: has no effect without"),
        (
            '[[stage]]\nname = "a"\nset = {"load.ice" = 0.01}\n',
            "[[stage]] a: set: ice: has no effect without",
        ),
        (GUSTY.format(duration=0.1, more=""), "pressure_coefficient: missing"),
    ],
)
def test_ice_and_a_wind_without_a_coefficient_need_a_diameter(workshop, more, words):
    text, *tables = mast(1, 2)
    rest = (line for line in text.splitlines(True) if not line.startswith(("diameter", "drag")))
    assert words in refused("check", workshop.job("".join(rest) + more, *tables))


SQUARE = (  # a roof of four triangles
    HEAD + "0,0,0,9,1\n1,10,0,9,1\n2,10,10,9,1\n3,0,10,9,1\n4,5,5,9,0\n",
    "start,end\n0,1\n1,2\n2,3\n3,0\n0,4\n1,4\n2,4\n3,4\n",
)


def test_pressures_at_taps_leave_cables_without_wind(workshop):
    """The roof has its pressures, the cables have only ice, and netfall warns."""
    (workshop.folder / "taps.csv").write_text("name,x,y\na,5,5\n")
    (workshop.folder / "pressures.csv").write_text("time,a\n0,300\n1,300\n")
    text = STEEL + "diameter = 0.03\n[load]\nice = 0.01\n" + '[wind]\npressures = "pressures.csv"\n'
    job = workshop.job(text + 'taps = "taps.csv"\n[dynamics]\nduration = 0.1\n', *SQUARE)
    lines: list[str] = []
    values = check_values(read_job(job), lines)
    assert any("[W470]" in line for line in values["warnings"])
    assert [each["load"] for each in values["slender_loads"]] == ["ice of [load]"]
    model, field = model_of(job)
    assert field.force == pytest.approx(-model.roof.vector)


def test_a_roof_without_a_coefficient_and_a_diameter_without_effect_are_named(workshop):
    """The wind acts only on the cables, with a coefficient of 0 on purpose; without it a diameter is idle."""
    values = check_values(read_job(mast_job(workshop, "")), [])  # neither wind nor ice
    assert any("[N471]" in line for line in values["notes"])
    for more, is_named in (("", True), ("pressure_coefficient = 0\n", False)):
        text = STEEL + "diameter = 0.03\n" + GUSTY.format(duration=0.1, more=more)
        job = workshop.job(text, *SQUARE)
        warnings = check_values(read_job(job), [])["warnings"]
        assert any("[W472]" in line for line in warnings) == is_named
        force = model_of(job)[1].force
        assert force[4, 2] == 0.0 < np.hypot(*force[4, :2])


@pytest.mark.parametrize("wind, places", [("", ""), (GUSTY, "[wind], ")])
def test_each_wind_without_a_coefficient_is_named(workshop, wind, places):
    """In case a and [wind] the wind acts only on cables; the pressures of case c act on the roof."""
    (workshop.folder / "roof.csv").write_text("x,y,pressure\n5,5,300\n")
    text = STEEL + "diameter = 0.03\n" + wind.format(duration=0.1, more="")
    text += case(UNIFORM, "a") + case(UNIFORM + ', "wind.pressure_coefficient" = -1.0', "b")
    text += case(UNIFORM, "c") + 'pressure_table = "roof.csv"\n'
    warnings = check_values(read_job(workshop.job(text, *SQUARE)), [])["warnings"]
    (line,) = [line for line in warnings if "[W472]" in line]
    assert f"warning: {places}[[case]] a: set: wind: pressure_coefficient: missing" in line


def test_wind_and_ice_of_a_removed_guy_go_to_its_ends(workshop):
    """Like its mass: sums of loads stay, and its inner nodes have none."""
    from netfall.driver.removal.equilibria import loads_after_removals
    from netfall.loads.removal import make_removals

    text = "[load]\nself_weight = false\nice = 0.02\n" + GUSTY.format(duration=0.1, more="")
    path = mast_job(workshop, text + "[[remove]]\nelements = [2]\ntime = 0.05\n", bends=False)
    path.write_text(path.read_text().replace("[net]\n", "[net]\nsubdivide = 2\n"))
    job = read_job(path)
    problem = problem_of(job)
    (loss,) = make_removals(job, problem.root_model, problem.schedule)
    before, after = loads_after_removals(problem.root_model, [loss])[0]
    (inner,) = loss.particles
    assert before[inner].any() and not after[inner].any()
    square = problem.root_model.wind_field.mean_square(problem.root_model.history.mean_gust)
    wind = problem.root_model.wind
    ice = before - wind * square[:, None]
    assert ice[:, :2] == pytest.approx(0.0, abs=1e-9) and ice[inner, 2] < 0.0
    ends = problem.root_model.net.undivided()[2]
    moved = 0.5 * (ice[inner] + np.outer(square[ends], wind[inner]))
    assert (after - before)[ends] == pytest.approx(moved, rel=1e-9, abs=1e-9)


def test_ice_of_stages_acts_on_active_elements(workshop):
    """One of two cables is active only in the second stage."""
    nodes = HEAD + "0,0,0,9,1\n1,10,0,8,0\n2,20,0,9,1\n3,10,10,9,1\n"
    text = BARE + "prestress = 1e3\ndiameter = 0.02\n[group.late]\ndiameter = 0.05\n"
    text += '[[stage]]\nname = "a"\nactive = ["first"]\nset = {"load.ice" = 0.02}\n'
    text += '[[stage]]\nname = "b"\nactive = ["first", "late"]\n[load]\nself_weight = false\n'
    f = workshop.run_here(workshop.job(text, nodes, "start,end,group\n0,1,first\n1,2,first\n3,1,late\n"))
    d = np.array([0.02, 0.02, 0.05])
    for stage, rows in (("a", [0, 1]), ("b", [0, 1, 2])):
        weight = GRAVITY * 900.0 * np.pi * (d * 0.02 + 0.02**2) * f[f"stages/{stage}/unstressed_length"][:]
        assert -f[f"stages/{stage}/reaction"][:, 2].sum() == pytest.approx(weight[rows].sum(), rel=1e-5)
