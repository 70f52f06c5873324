"""Roofs with an outer side: facades and canopies, their areas, zones, wind and pictures, by hand."""

import numpy as np
import pytest
from conftest import assert_same_results
from nets import model_of, table

from netfall.core.errors import InputError
from netfall.core.functions import lengths
from netfall.driver.check import check_job
from netfall.driver.reporting.wind import wind_lines
from netfall.job.read import read_job
from netfall.results.text import form_lines

CABLES = "[cable]\nmodulus = 1.6e11\narea = 400e-6\ndensity = 7850.0\nprestress = 200e3\n"
LOAD = "[load]\nself_weight = false\ntolerance = 1e-9\n"
OUTSIDE = "[roof]\nnormal = [0, -1, 0]\n"  # the outer side of the facade looks to -y
PRESSED = CABLES + LOAD + "pressure = 1000.0\n"


def rotated(x, angle):
    """Return points (n, 3) rotated about z by an angle [degrees]."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.asarray(x, float) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def facade(columns=8, rows=5, angle=0.0, width=40.0, height=25.0):
    """Return positions (n, 3) [m], supports (n,) and elements of a vertical grid in y = 0, its edge held."""
    i, k = (part.ravel() for part in np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)))
    x = np.column_stack([width / columns * i, 0.0 * i, height / rows * k])
    number = np.arange(len(x)).reshape(rows + 1, columns + 1)
    pairs = [np.stack([number[:, :-1], number[:, 1:]], -1), np.stack([number[:-1], number[1:]], -1)]
    edge = (i == 0) | (i == columns) | (k == 0) | (k == rows)
    return rotated(x, angle), edge, np.concatenate([pair.reshape(-1, 2) for pair in pairs])


def tables(x, edge, elements, group=None):
    """Return nodes.csv and elements.csv of a grid; groups of the elements."""
    group = ["net"] * len(elements) if group is None else group
    return (
        table("id,x,y,z,fixed", [(p, *at, int(held)) for p, (at, held) in enumerate(zip(x.tolist(), edge))]),
        table("start,end,group", [(*pair, name) for pair, name in zip(elements.tolist(), group)]),
    )


def facade_model(workshop, text, net=None):
    """Return the model of a job with the tables of a facade, or of another net."""
    return model_of(read_job(workshop.job(text, *tables(*(net or facade())))))


def test_areas_of_a_facade(workshop):
    """1000 m2 facing -y: 25 m2 at inner nodes, half on the sides, a quarter in the corners."""
    model, x = facade_model(workshop, PRESSED + OUTSIDE), facade()[0]
    sides = np.isin(x[:, 0], (0.0, 40.0)).astype(int) + np.isin(x[:, 2], (0.0, 25.0))
    assert np.allclose(model.roof.area, np.array([25.0, 12.5, 6.25])[sides], rtol=1e-12)
    assert np.allclose(model.roof.vector, model.roof.area[:, None] * [0.0, -1.0, 0.0], atol=1e-12)
    assert np.allclose(model.loading.live.sum(0), [0.0, 1e6, 0.0], atol=1e-6)
    assert np.abs(model.roof.plan_area).max() == 0.0


def test_a_form_that_moves_along_a_facade_is_a_warning(workshop):
    """A cushion of 1.5 m out of the plane is intended. 1.5 m down in the plane is a wrong prestress."""
    net = facade_model(workshop, PRESSED + OUTSIDE).net
    out, down = (list(form_lines(net, net.x + net.moves[:, None] * shift)) for shift in np.eye(3)[1:] * 1.5)
    assert not any("W719" in line for line in out)
    assert "28 of 54 nodes moved across [roof] normal by more than 2% of the span of 40 m" in "".join(down)


@pytest.mark.parametrize("lean", [0.0, -0.75, 0.75])
def test_snow_and_dead_load_on_a_facade(workshop, lean):
    """Cladding of 0.2 kN/m2 weighs 200 kN per 1000 m2. Snow acts on 750 m2 in plan, if they face upwards."""
    x, *others = facade()
    x[:, 1] += lean * x[:, 2]
    text = CABLES + "[load]\nself_weight = false\ndead = 200.0\nsnow = 750.0\n" + OUTSIDE
    model = facade_model(workshop, text, (x, *others))
    loading, snow = model.loading, 750.0 * 750.0 * (lean > 0.0)
    assert np.allclose(loading.permanent.sum(0), [0.0, 0.0, -200e3 * np.hypot(1.0, lean)])
    assert np.allclose(loading.live.sum(0), [0.0, 0.0, -snow]) and loading.live.any() == (snow > 0.0)
    notes = [note for note in model.start_notes if "snow: no effect" in note]
    shown = f"the {1000.0 * np.hypot(1.0, lean):.4g} m2 of roof are vertical or face downwards"
    assert [shown in note for note in notes] == [True] * (snow == 0.0)
    model = facade_model(workshop, text.replace("snow = 750.0\n", ""), (x, *others))
    assert not any("snow" in note for note in model.start_notes)


@pytest.mark.parametrize("angle", [30.0, 90.0, 200.0])
def test_a_rotated_facade_has_the_rotated_result(workshop, angle):
    """Areas to rounding, displacements to the tolerance of the equilibrium."""
    zone = '[[zone]]\nname = "top"\npolygon = [[3, 18], [43, 18], [43, 26], [3, 26]]\n'
    text, cases = PRESSED + "steps = 1\n" + zone + "[load.zone.top]\npressure = -500.0\n", []
    for each in (0.0, angle):
        x, edge, elements = facade(4, 3, each)
        along = rotated([[1.0, 0.0, 0.0]], each)[0]
        shift = 3.0 * along  # polygons count from the origin: shifted, to see that they do
        normal = rotated([[0.0, -1.0, 0.0]], each)[0].tolist()
        with workshop.solve(f"{text}[roof]\nnormal = {normal}\n", *tables(x + shift, edge, elements)) as f:
            cases.append((f["net/vector_area"][:], f["statics/displacement"][-1], f["net/tributary_area"][:]))
    (vector, u, area), (other_vector, other_u, other_area) = cases
    assert np.allclose(other_vector, rotated(vector, angle), atol=1e-9) and np.allclose(area, other_area)
    assert np.abs(other_u - rotated(u, angle)).max() < 1e-7 * lengths(u).max()
    assert u[:, 1].max() > 0.01 and lengths(u).max() > 0.0


def test_the_middle_of_a_flat_net_under_pressure(workshop):
    """One free node on four cables of 5 m: p 25 m2 = 4 w (T / l + EA / 2 l (w / l)2 ...), by statics."""
    x, edge, elements = facade(2, 2, width=10.0, height=10.0)
    with workshop.solve(PRESSED + "steps = 1\n" + OUTSIDE, *tables(x, edge, elements)) as f:
        w = f["statics/displacement"][-1][4, 1]
    EA, T, side = 1.6e11 * 400e-6, 200e3, 5.0
    L0 = side / (1.0 + T / EA)
    length = np.hypot(side, w)
    assert np.isclose(4 * EA * (length / L0 - 1.0) * w / length, 1000.0 * 25.0, rtol=1e-7)


def test_check_and_info_name_the_outer_side(workshop):
    """Both print the resultant of a pressure, for a facade without the key together with the key."""
    job = workshop.job(PRESSED + "steps = 1\n" + OUTSIDE, *tables(*facade(4, 3)))
    line = "outer side: a pressure of 1 kN/m2 on all faces has the resultant 0, 1000, 0 kN along x, y, z"
    lines = []
    check_job(read_job(job), lines.append, None)
    assert line in lines and "0 warnings" in lines
    with workshop.run(job):
        assert line in workshop.info()
    with pytest.raises(InputError, match=r"direction, \[roof\] normal = \[0, -?1, 0\], or"):
        facade_model(workshop, PRESSED)
    with pytest.raises(InputError, match=r"\[roof\] normal = \[0, 0, 0\]: has no direction"):
        facade_model(workshop, PRESSED + "[roof]\nnormal = [0, 0, 0]\n")


def test_a_steep_roof_without_the_key_is_a_warning(workshop):
    """A facade with a slope of 1 in 10: its upper side is named as the outer one."""
    x, edge, elements = facade(4, 3)
    x[:, 1] = 0.1 * x[:, 2]
    lean = (x, edge, elements)
    notes = facade_model(workshop, PRESSED, lean).layout.notes
    assert any("W239" in note for note in notes) and any("m2 in plan of 1005 m2" in note for note in notes)
    assert not any("W239" in note for note in facade_model(workshop, PRESSED + OUTSIDE, lean).layout.notes)


EDGE = '[[zone]]\nname = "edge"\npolygon = [[0, 0], [4, 0], [4, 25], [0, 25]]\ncut = true\n'  # m along, m up
SECTORS = "direction,pressure_coefficient,edge\n0,-0.5,-0.8\n90,0.8,1.2\n180,-0.5,-0.8\n270,-0.3,-0.6\n"
WIND = "speed = 20.0\nbase_height = 0.0\nprofile_exponent = 0.2\nturbulence_intensity = 0.18\n"
WIND += 'gust_field = "area_mean"\n'
DYNAMICS = "[dynamics]\nduration = 0.5\n"


def folded(steps=(4, 2, 2)):
    """Return a facade of 20 x 10 m in y = 0 and a roof of 20 x 8 m behind its upper edge, as one grid."""
    columns, rows, deep = steps
    x, edge, elements = facade(columns, rows + deep, 0.0, 20.0, float(rows + deep))
    along = x[:, 2] / rows
    x[:, 1] = np.clip(along - 1.0, 0.0, None) * 8.0 * rows / deep
    x[:, 2] = np.clip(along, 0.0, 1.0) * 10.0
    return x, edge, elements


def faces_of(columns, rows):
    """Return corners (f, 4) of the cells of a grid, anticlockwise seen from outside."""
    number = np.arange((columns + 1) * (rows + 1)).reshape(rows + 1, columns + 1)
    return np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], -1).reshape(-1, 4)


def face_table(corners):
    """Return faces.csv of faces (f, k)."""
    return table("face,node", [(f, p) for f, ring in enumerate(corners.tolist()) for p in ring])


def test_a_zone_by_a_polygon_in_the_plane_of_the_facade(workshop):
    """4 x 25 m at the edge: 100 m2 with their own pressure. After 90 degrees the same polygon applies."""
    text = PRESSED + EDGE + "[load.zone.edge]\npressure = -2000.0\n"
    model = facade_model(workshop, text + OUTSIDE)
    assert np.isclose(model.roof.zones.share[:, 0] @ model.roof.area, 100.0)
    assert np.allclose(model.loading.live.sum(0), [0.0, 900e3 - 200e3, 0.0], atol=1e-6)
    model = facade_model(workshop, text + "[roof]\nnormal = [2, 0, 0]\n", facade(angle=90.0))
    assert np.allclose(model.loading.live.sum(0), [-700e3, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("direction, roof, edge", [(90, 0.8, 1.2), (270, -0.3, -0.6), (135, 0.15, 0.2)])
def test_sectors_rotate_the_load_of_the_facade(workshop, direction, roof, edge):
    """Wind on it presses inward (+y), wind from behind sucks outward (-y), between them linear."""
    (workshop.folder / "sectors.csv").write_text(SECTORS)
    text = f'[wind]\n{WIND}direction = {direction}\nsectors = "sectors.csv"\n'
    model = facade_model(workshop, CABLES + OUTSIDE + EDGE + text + DYNAMICS)
    field, z = model.wind_field, model.x[:, 2]
    U = 20.0 * (np.maximum(z, 1.0) / 10.0) ** 0.2
    assert np.allclose(field.mean, U)
    share = model.roof.zones.share[:, 0]
    c = roof * (1.0 - share) + edge * share
    expected = 0.5 * 1.25 * c * U**2 * model.roof.area
    assert np.allclose(field.force * field.mean[:, None] ** 2, expected[:, None] * [0, 1, 0], atol=1e-6)


def test_a_canopy_and_its_facade_by_hand(workshop):
    """1 kN/m2 on 20 x 10 m vertical and 20 x 8 m flat: 200 kN inward, 160 kN down; snow on the flat part."""
    view = "[roof]\nnormal = [0, -1, 1]\n"
    model = facade_model(workshop, PRESSED + "snow = 500.0\n" + view, folded())
    x, live = model.x, model.loading.live
    assert np.allclose(live.sum(0), [0.0, 200e3, -160e3 - 80e3], atol=1e-6)
    edge = (x[:, 1] == 0.0) & (x[:, 2] == 10.0)
    at_ends = np.isin(x[edge, :1], (0.0, 20.0))  # others: halves of 5 x 5 m and of 5 x 4 m
    assert np.allclose(model.roof.vector[edge], np.where(at_ends, 0.5, 1.0) * [0, -12.5, 10], atol=1e-9)
    (workshop.folder / "faces.csv").write_text(face_table(faces_of(4, 4)))
    given = facade_model(workshop, PRESSED + "snow = 500.0\n" + view + 'faces = "faces.csv"\n', folded())
    assert np.allclose(given.roof.vector, model.roof.vector, atol=1e-12)


def test_normals_of_the_table_are_outward(workshop):
    """A facade that leans over its foot has downward normals; normals into the building are an error."""
    nodes, elements = tables(*facade(2, 2))
    text = PRESSED + "[roof]\nnormal = [0, -1, 0]\n"

    def with_normals(cells):
        head, *rows = nodes.splitlines()
        return "\n".join([head + ",normal_x,normal_y,normal_z", *(row + cells for row in rows)]) + "\n"

    job = read_job(workshop.job(text, with_normals(",0,-0.8,-0.6"), elements))
    assert np.allclose(model_of(job).loading.live.sum(0), [0.0, 0.8e6, 0.6e6], atol=1e-6)
    job = read_job(workshop.job(text, with_normals(",0,1,0"), elements))
    with pytest.raises(InputError, match="expected the outward normal"):
        model_of(job)


@pytest.mark.parametrize("parts", [1, 2, 3])
@pytest.mark.parametrize("by", ["groups", "polygons"])
def test_zones_of_a_canopy_and_its_facade_by_hand(workshop, by, parts):
    """Coefficients 0.8 and -1.2, pressures of 1 and -2 kN/m2, snow on one of them: exact also at the fold."""
    x, edge, elements = folded()
    where = {"facade": "groups = ['facade', 'fold']", "canopy": "groups = ['canopy', 'fold']"}
    if by == "polygons":  # seen from [0, -1, 1]: up is (y + z) / 2^0.5
        low, high = 10.0 / 2**0.5, 18.0 / 2**0.5
        ends = {"facade": (0.0, low), "canopy": (low, high)}
        where = {
            name: f"polygon = [[0, {a}], [20, {a}], [20, {b}], [0, {b}]]\ncut = true"
            for name, (a, b) in ends.items()
        }
    upright, flat = ((x[elements][:, :, k] == value).all(1) for k, value in ((1, 0.0), (2, 10.0)))
    group = np.where(upright & flat, "fold", np.where(upright, "facade", "canopy")).tolist()
    zones = "".join(f'[[zone]]\nname = "{name}"\n{what}\n' for name, what in where.items())
    loads = "[load.zone.facade]\npressure = 1000.0\n[load.zone.canopy]\npressure = -2000.0\nsnow = 500.0\n"
    wind = f"[wind]\npressure_coefficient = 0.0\n{WIND}[wind.zone.facade]\npressure_coefficient = 0.8\n"
    wind += "[wind.zone.canopy]\npressure_coefficient = -1.2\n"
    text = CABLES + LOAD + loads + zones + wind + DYNAMICS + "[roof]\nnormal = [0, -1, 1]\n"
    model = facade_model(workshop, f"subdivide = {parts}\n" + text, (x, edge, elements, group))
    assert np.allclose(model.loading.live.sum(0), [0.0, 200e3, 320e3 - 80e3], atol=1e-5)
    q = 0.5 * 1.25
    assert np.allclose(model.wind_field.force.sum(0), [0.0, 0.8 * q * 200.0, 1.2 * q * 160.0], atol=1e-9)
    assert np.allclose(model.roof.zones.share[:, :2].T @ model.roof.area, [200.0, 160.0])


def test_faces_with_the_wrong_orientation_are_refused(workshop):
    """One face with reversed corners is named. Without the key all are edge-on."""
    corners = faces_of(8, 5)
    corners[7] = corners[7][::-1]
    (workshop.folder / "faces.csv").write_text(face_table(corners))
    table_key = 'faces = "faces.csv"\n'
    away = r"face = 7: -25 m2 .* anticlockwise, seen from \[roof\] normal = \[0"
    with pytest.raises(InputError, match=away):
        facade_model(workshop, PRESSED + OUTSIDE + table_key)
    with pytest.raises(InputError, match=r"faces seen edge-on from above: 40, .* Give \[roof\] normal"):
        facade_model(workshop, PRESSED + "[roof]\n" + table_key)


def test_taps_and_tables_of_pressure_on_a_facade(workshop):
    """Nodes take the nearest points in space; pressure grows with height, so z is needed."""
    points = [(x, 0.0, z) for x in (0.0, 20.0, 40.0) for z in (0.0, 12.5, 25.0)]
    rows = table("x,y,z,pressure", [(*at, 100.0 * at[2]) for at in points])
    (workshop.folder / "wind.csv").write_text(rows)
    taps = table("name,x,y,z", [(f"t{k}", *at) for k, at in enumerate(points)])
    (workshop.folder / "taps.csv").write_text(taps)
    values = [100.0 * at[2] for at in points]
    heads = ",".join(["time", *(f"t{k}" for k in range(9))])
    (workshop.folder / "cp.csv").write_text(table(heads, [(0.0, *values), (9.0, *values)]))
    case = '[[case]]\nname = "wind"\npressure_table = "wind.csv"\n'
    x, edge, elements = facade(4, 2)
    with workshop.solve(CABLES + LOAD + case + OUTSIDE, *tables(x, edge, elements)) as f:
        reaction = f["cases/wind/reaction"][:].sum(0)
    share = [np.where(np.isin(x[:, k], (0, end)), 0.5, 1.0) for k, end in ((0, 40), (2, 25))]
    area = 125.0 * share[0] * share[1]
    wind = '[wind]\npressures = "cp.csv"\ntaps = "taps.csv"\nonset = "sudden"\n'
    job = read_job(workshop.job(CABLES + OUTSIDE + wind + DYNAMICS, *tables(x, edge, elements)))
    model = model_of(job)
    field = model.wind_field
    assert wind_lines(job, model)[0].endswith("each node interpolates the four nearest in space")
    tapped = (field.weight * np.array(values)[field.corner]).sum(1)
    at_tap = np.isin(x[:, 0], (0.0, 20.0, 40.0))  # the other nodes lie between two columns of taps
    assert np.allclose(tapped[at_tap], 100.0 * x[at_tap, 2], atol=1e-4) and np.ptp(tapped[~at_tap]) > 1000.0
    assert np.allclose(field.force, area[:, None] * [0.0, 1.0, 0.0])
    assert reaction[1] == pytest.approx((tapped * area).sum(), rel=1e-6)
    (workshop.folder / "wind.csv").write_text(rows.replace("x,y,z,pressure", "x,y,q,pressure"))
    with pytest.raises(InputError, match="column z is missing"):
        facade_model(workshop, CABLES + LOAD + case + OUTSIDE)


def test_gusts_on_a_facade_have_equal_bits_on_two_ranks(workshop):
    """With zones by a table of sectors."""
    (workshop.folder / "sectors.csv").write_text(SECTORS)
    text = CABLES + OUTSIDE + EDGE + f'[wind]\n{WIND}direction = 90\nsectors = "sectors.csv"\n' + DYNAMICS
    job = workshop.job(text, *tables(*facade()))
    with workshop.run(job) as one:
        assert len(one["history/time"]) > 10
        with workshop.run(job, ranks=2, output="two.vtkhdf") as two:
            assert_same_results(one, two)


def test_pictures_show_the_facade_from_outside(workshop):
    """Axes of the roof's picture: along the facade and height, 40 x 25 m."""
    from netfall.post.plots.roof import roof

    with workshop.solve(PRESSED + "steps = 1\n" + OUTSIDE, *tables(*facade())) as f:
        axes = roof(f).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("along the facade [m]", "height [m]")
    assert np.ptp(axes.get_xlim()) == pytest.approx(1.08 * 40.0) and np.ptp(axes.get_ylim()) > 25.0


def test_labels_of_modes_of_a_facade_do_not_reach_the_next_panel(workshop):
    """The label of y, across the facade, is below the axes in space, and was covered by the plan."""
    from netfall.post.plots.states import modes

    with workshop.solve(
        PRESSED + "steps = 1\n[modes]\ncount = 1\n" + OUTSIDE, *tables(*facade(height=40.0))
    ) as f:
        figure = modes(f)
    figure.draw_without_rendering()
    space, plan = figure.axes[:2]
    assert space.yaxis.label.get_window_extent().y0 > plan.get_window_extent().y1


def test_maps_of_a_study_show_the_facade_from_outside(workshop):
    """The net of a study has the axes of the facade, and its maps show 40 x 25 m."""
    from netfall.driver.sample import study_net
    from netfall.job.cache import NO_CACHE
    from netfall.parallel.mpi import MPI
    from netfall.post.plots.study.maps import _open_maps
    from netfall.study.answers.read import Study

    job = workshop.job(PRESSED + OUTSIDE, *tables(*facade()))
    net = study_net(MPI.COMM_SELF, lambda: read_job(job), NO_CACHE)
    nothing = np.zeros(0, int)
    _, ((plan,), _) = _open_maps(Study("a", "a", {}, {}, net, {}, {}, {}, nothing, nothing), "")
    assert (plan.get_xlabel(), plan.get_ylabel()) == ("along the facade [m]", "height [m]")
    assert np.ptp(plan.get_xlim()) == pytest.approx(1.08 * 40.0) and np.ptp(plan.get_ylim()) > 25.0


def test_an_exported_facade_gives_the_same_displacements(workshop):
    """With its outer side, and a limit by the span, which is not a path."""
    case = '[[case]]\nname = "wind"\nset = {"load.pressure" = 1000.0}\n'
    case += '[combinations]\nSLS = {kind = "SLS", wind = 1.0}\n'
    limits = '[limits]\ndisplacement = "span/40"\nspan = 25.0\n'
    f = workshop.solve(CABLES + LOAD + case + limits + OUTSIDE, *tables(*facade(4, 3)))
    u, other = (each["cases/wind/displacement"][:] for each in (f, workshop.run_exported()[0]))
    assert np.abs(u - other).max() < 1e-6 * u[:, 1].max() and u[:, 1].max() > 0.0


@pytest.mark.parametrize("form", ["", "[form_finding]\nmethod = 'force_density'\n"])
def test_a_folded_roof_with_zones_is_exported_with_a_job_unless_it_moved(workshop, form):
    """Its faces have zones of their own in the geometry as given, which nodes of the form do not store."""
    x, edge, elements = folded()
    group = np.where((x[elements][:, :, 1] == 0.0).all(1), "facade", "canopy").tolist()
    zones = "".join(f"[[zone]]\nname = '{name}'\ngroups = ['{name}']\n" for name in ("canopy", "facade"))
    text = CABLES + LOAD + "[load.zone.canopy]\npressure = 1000.0\n" + zones + "[roof]\nnormal = [0, -1, 1]\n"
    first = workshop.solve(form + text, *tables(x, edge, elements, group))
    if not form:
        again, _ = workshop.run_exported()
        assert np.array_equal(first["statics/displacement"][:], again["statics/displacement"][:])
        return
    lines = workshop.export()
    assert any("job.toml: not written: faces at a node have zones" in line for line in lines)
