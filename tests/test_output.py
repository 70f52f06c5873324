"""The result file: read by VTK as in ParaView, complete by the contract, whole or absent; pictures, text."""

import contextlib
import os
import pty
import re
import shutil
import subprocess
import termios
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import SimpleNamespace

import h5py
import imageio_ffmpeg
import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import BIN, ENVIRONMENT, ROOT, STEEL, run_netfall, run_on_standing_ranks, run_process
from drawings import Sketch
from kill_runs import changed
from matplotlib.text import Text
from nets import MAST, STORM, bare_saddle, mast_and_ring, saddle, stage
from PIL import Image, ImageSequence

from netfall.core.errors import InputError
from netfall.core.progress import Progress
from netfall.driver.check import HISTORY_COPIES
from netfall.exchange.export import export
from netfall.explicit.history import PROBE_ROWS, History
from netfall.physics.fields import Features
from netfall.post.plots import canvas, run
from netfall.post.plots.canvas import (
    VIEWS,
    add_labels,
    open_charts,
    open_space_panels,
    save,
    set_figure_title,
)
from netfall.post.plots.collapse import collapse, select_snapshots
from netfall.post.plots.curves import displacements, load_displacement, tensions, wind
from netfall.post.plots.film import FilmView, animate
from netfall.post.plots.force import OF_MOTION, ForceScale, add_force_scales
from netfall.post.plots.run import file_suffix, plot_all, plot_state
from netfall.post.plots.states import _governing, deflection_scale, stages, states
from netfall.post.report.info import info_of_result, print_info
from netfall.post.report.report import write_report
from netfall.results.locks import whole
from netfall.results.states import StateView
from netfall.results.warning_text import balance_warnings

JOB = f"""title = "Storm over a saddle"
{saddle()}[load]
self_weight = false
pressure = [0.0, 0.0, 200.0]
steps = 3
{STORM}[dynamics]
duration = 0.8
mass_damping = 0.2
[output]
history_interval = 0.004
frames = 16
probes = [[0.0, 0.0]]
"""


@pytest.fixture(scope="module")
def storm(shared_workshop):
    return shared_workshop.solve(JOB, name="storm", ranks=2, output="storm.vtkhdf")


OF_ROWS = (
    *("time", "time_step", "kinetic_energy", "strain_energy", "plastic_dissipation", "damping_work"),
    *("external_work", "work_identity_error", "energy_balance_error", "slack", "broken"),
)


def test_the_file_has_the_datasets_of_the_contract(storm):
    f = storm
    n, m, steps = len(f["net/particles"]), len(f["net/elements"]), 4
    rows, events, ends = len(f["history/time"]), len(f["events/time"]), len(f["final/position"])
    shapes = {f"history/{name}": (rows,) for name in OF_ROWS} | {"history/probe_displacement": (rows, 1, 3)}
    of_events = ("time", "step", "element", "particle", "new_particle", "strain")
    shapes |= {f"events/{name}": (events,) for name in of_events}
    shapes |= {"form_finding/position": (n, 3), "net/fixed": (n, 3), "net/tributary_area": (n,)}
    shapes |= {f"form_finding/{name}": (m,) for name in ("tension", "unstressed_length")}
    shapes |= {"form_finding/iterations": (), "form_finding/residual": (), "net/group": (m,)}
    shapes |= {f"statics/{name}": (steps,) for name in ("load_factor", "residual")}
    shapes |= {"statics/displacement": (steps, n, 3), "statics/tension": (steps, m)}
    shapes |= {"final/particle_id": (ends,), "final/position": (ends, 3), "final/velocity": (ends, 3)}
    shapes |= {f"final/{name}": (m,) for name in ("tension", "plastic_strain", "element_id")}
    points = len(f["wind/mean_speed"])
    shapes |= {"wind/control_point": (points, 3), "wind/speed": (len(f["wind/time"]), points)}
    assert {name: f[name].shape for name in shapes} == shapes
    assert events > 3 and ends == n + (f["events/new_particle"][:] >= 0).sum()
    p = f["provenance"]
    assert p["job"].asstr()[()] == JOB and p.attrs["exit_state"] == "finished"
    assert p.attrs["limit_after_fracture"] > p.attrs["time_step"]
    assert f["final/position"].dtype == np.float64


def test_small_displacements_do_not_look_as_large_as_others(storm, tmp_path):
    """A thousandth of the motion along x fills no panel of its own."""
    shutil.copy(storm.filename, tmp_path / "small.h5")
    with h5py.File(tmp_path / "small.h5", "r+") as f:
        moved = f["history/probe_displacement"][:]
        moved[..., 0] = 1e-3 * moved[..., 2]
        f["history/probe_displacement"][:] = moved
        charts = displacements(f).axes
        largest = np.abs(moved).max()
    assert max(np.ptp(axes.get_ylim()) for axes in charts) >= largest
    assert max(np.ptp(axes.get_ylim()) for axes in charts if "x [m]" in axes.get_ylabel()) >= 0.019 * largest


def test_every_numeric_dataset_has_its_unit(storm):
    """Also those of VTK's own format and of the tables of the net. Texts have none."""
    unit_of = {}

    def look(path, item):
        if hasattr(item, "dtype"):
            unit_of[path] = (item.dtype.kind == "O", item.attrs.get("unit"))

    storm.visititems(look)
    assert all((unit is None) == text for text, unit in unit_of.values()), unit_of
    units = {"VTKHDF/Points": "m", "VTKHDF/CellData/tension": "N", "provenance/net/density": "kg/m3"}
    assert {path: unit_of[path][1] for path in units} == units


def vtk_steps(path):
    """Yield each step as VTK's reader returns it: time, points, lines, arrays by name."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    for step in range(reader.GetNumberOfSteps()):
        reader.SetStep(step)
        reader.Update()
        grid = reader.GetOutputDataObject(0)
        if grid.IsA("vtkPartitionedDataSet"):
            assert grid.GetNumberOfPartitions() == 1
            grid = grid.GetPartition(0)
        arrays = {
            data.GetArrayName(k): vtk_to_numpy(data.GetArray(k)).copy()
            for data in (grid.GetPointData(), grid.GetCellData())
            for k in range(data.GetNumberOfArrays())
        }
        lines = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 2).copy()
        yield reader.GetTimeValue(), vtk_to_numpy(grid.GetPoints().GetData()).copy(), lines, arrays


def test_vtk_reads_the_series(storm):
    """Times, counts, arrays and connectivity at each step, before and after fractures."""
    n, elements = len(storm["net/particles"]), storm["net/elements"][:]
    steps = storm["events/step"][:] * storm["provenance"].attrs["shortest_time_step"]
    when = storm["events/time"][:]
    assert np.allclose(steps, when)
    snapshots = list(vtk_steps(storm.filename))
    assert len(snapshots) == 17
    start = storm["form_finding/position"][:]
    for time, points, lines, arrays in snapshots:
        past = when < time - 1e-12
        new = np.sort(storm["events/new_particle"][:][past])
        new = new[new >= 0]
        assert len(points) == n + len(new) and len(lines) == len(elements)
        assert np.array_equal(arrays["GlobalPointId"], np.concatenate([np.arange(n), new]))
        assert np.array_equal(arrays["GlobalCellId"], np.arange(len(elements)))
        expected = elements.copy()
        for e, p in zip(storm["events/element"][:][past], storm["events/new_particle"][:][past]):
            if p >= 0:
                expected[e, (p - n) % 2] = n + np.searchsorted(new, p)
        assert np.array_equal(lines, expected)
        assert np.array_equal(np.flatnonzero(arrays["broken"]), np.unique(storm["events/element"][:][past]))
        assert np.allclose(points[:n] - arrays["displacement"][:n], start, atol=1e-4)
        assert np.array_equal(arrays["group"], storm["net/group"][:])
        assert np.array_equal(arrays["element_id"], np.arange(len(elements)))
        origin = elements[(new - n) // 2, (new - n) % 2]
        assert np.array_equal(arrays["node_id"], np.concatenate([np.arange(n), origin]))
    _, points, _, arrays = snapshots[-1]
    assert np.array_equal(points, storm["final/position"][:])
    for name in ("tension", "plastic_strain"):
        assert np.allclose(arrays[name], storm[f"final/{name}"][:], rtol=1e-6)
    assert np.allclose(arrays["velocity"], storm["final/velocity"][:], rtol=1e-6)
    assert len(snapshots[0][1]) == n < len(points)


PRESSED_MAST = STEEL + MAST + "[form_finding]\n", *mast_and_ring()
STILL = '[net]\ngenerator = "saddle"\n' + STEEL + "[form_finding]\n"
ODD_NODES = "id,x,y,z,fixed,load_z,mass\n100,0,0,0,1,0,0\n7,10,0,0,0,-1e6,1000\n55,20,0,0,1,0,0\n"
ODD_ELEMENTS = "id,start,end\n31,100,7\n-4,55,7\n"
ODD_JOB = "subdivide = 2\n" + STEEL
ODD_JOB += "fracture_strain = 0.03\n[dynamics]\nduration = 0.1\n[output]\nframes = 20\n"


@pytest.mark.parametrize("ranks", [1, 2])
def test_every_step_has_the_ids_of_the_tables(workshop, ranks):
    """Halves of a cable have its id, a split-off particle that of its node; inner nodes are 101 and 102."""
    f = workshop.solve(ODD_JOB, ODD_NODES, ODD_ELEMENTS, ranks=ranks)
    nodes, ends = [100, 7, 55, 101, 102], [[100, 101], [101, 7], [55, 102], [102, 7]]
    assert f["net/node_id"][:].tolist() == nodes
    for *_, arrays in (steps := list(vtk_steps(f.filename))):
        assert arrays["element_id"].tolist() == [31, 31, -4, -4]
        split = arrays["GlobalPointId"][len(nodes) :] - len(nodes)
        assert arrays["node_id"].tolist() == nodes + [ends[s // 2][s % 2] for s in split]
    events = f["events"]
    assert len(steps[0][-1]["node_id"]) == len(nodes) < len(steps[-1][-1]["node_id"])
    assert events["element_id"][:].tolist() == [31 if e < 2 else -4 for e in events["element"]]
    assert all(p in ends[e] for e, p in zip(events["element"], events["node_id"][:]))
    e = events["element"][0]
    place = f"element {events['element_id'][0]} ({ends[e][0]}-{ends[e][1]}) at node {events['node_id'][0]}"
    assert place in run_on_standing_ranks("info", f.filename).stdout


def test_two_processes_may_write_the_same_file(tmp_path):
    """Each writes to its own file, and the last one to end replaces the result."""
    with whole(tmp_path / "a.txt") as first, whole(tmp_path / "a.txt") as second:
        first.write_text("first")
        second.write_text("second")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "first"


def test_a_job_without_dynamics_has_one_frame_and_no_film(workshop):
    f = workshop.solve(STILL)
    ((time, points, _, arrays),) = vtk_steps(f.filename)
    assert time == 0 and np.array_equal(points, f["form_finding/position"][:])
    assert np.allclose(arrays["tension"], f["form_finding/tension"][:], rtol=1e-6)
    assert "history" not in f
    with pytest.raises(InputError, match=r"no frames to animate.*\[dynamics\] duration"):
        animate(Path(f.filename), workshop.folder, "gif", 15)
    assert {p.name for p in workshop.folder.iterdir()} == {"job.toml", "result.vtkhdf"}


def test_pictures_are_drawn_without_a_display(storm, shared_workshop):
    from matplotlib.image import imread

    run_on_standing_ranks("plot", storm.filename, "-o", shared_workshop.folder / "pictures")
    names = {path.name for path in (shared_workshop.folder / "pictures").iterdir()}
    subjects = ("form", "states", "roof", "load_displacement", "collapse", "energies", "tensions")
    assert names == {f"storm_{subject}.png" for subject in (*subjects, "displacements", "wind")}
    for name in names:
        assert imread(shared_workshop.folder / "pictures" / name)[..., :3].std() > 0.02


def load_path(path, factors, tension, z, attributes=()):
    """Return the picture of the load path of one element, by its tension [N] and its node's height [m]."""
    with h5py.File(path, "w") as f:
        f["statics/load_factor"], f["statics/tension"] = factors, np.array(tension)[:, None]
        f["statics/displacement"] = [[[0.0, 0.0, value]] for value in z]
        f["net/group"], f["net/group_names"], f["net/node_id"] = [0], ["a"], [34]
        f["net/particles"], f["provenance/title"] = np.zeros((1, 3)), "roof"
        f["statics"].attrs.update({"state": "equilibrium", **dict(attributes)})
        return load_displacement(f)


def test_a_plot_removes_pictures_of_an_earlier_result(workshop):
    """The wind of an earlier run must not pass for that of this one, which has none."""
    workshop.solve(*PRESSED_MAST).close()
    result, folder = workshop.folder / "result.vtkhdf", workshop.folder
    drawn = plot_all(result, folder)
    (folder / "result_wind.png").write_bytes(drawn[0].read_bytes())
    (folder / "result_modes.png").write_text("of the user")
    assert plot_all(result, folder) == drawn
    assert {*folder.glob("*.png")} == {*drawn, folder / "result_modes.png"}


def test_the_largest_force_of_each_group_is_drawn_and_no_steady_wind(workshop):
    """Suction stretches the sagging cables x. No speed changes, so a picture of speeds shows nothing."""
    steady = STORM.replace("surface_drag = 0.03", "surface_drag = 0.0")
    with workshop.solve(f"{saddle('')}{steady}[dynamics]\nduration = 0.2\n") as f:
        peak, group = f["envelope/tension_max"][:], f["net/group"][:]
        lines = tensions(f).axes[0].lines
        labels = [line.get_label() for line in lines if "element" in line.get_label()]
        largest = {name: np.argmax(np.where(group == k, peak, 0.0)) for k, name in enumerate("xy")}
        assert wind(f) is None and sorted(label.split(" (")[0] for label in labels) == [
            f"{name} element {f['net/element_id'][e]}" for name, e in largest.items()
        ]


def test_a_plot_keeps_the_picture_of_a_case_named_wind(workshop):
    """Its file has the name of the picture of a wind, for which the result has no data."""
    case = "[[case]]\nname = 'wind'\nset = {'load.temperature' = 5.0}\n"
    workshop.solve(STEEL + MAST + "[form_finding]\n" + case, *mast_and_ring()).close()
    result = workshop.folder / "result.vtkhdf"
    path = plot_state(result, workshop.folder, "wind")
    assert path not in plot_all(result, workshop.folder) and path.name == "result_wind.png" and path.exists()


def test_a_load_path_within_the_tolerance_is_not_drawn(tmp_path):
    """Displacements of 74 mm that change by 5e-9 m are noise; 1e-6 m are drawn without an offset."""
    for change, drawn in ((5e-9, False), (1e-6, True)):
        tension, z = [9e3, 9e3 * (1 + 5e-8)], [-0.0743, -0.0743 - change]
        figure = load_path(tmp_path / "path.h5", [0.0, 1.0], tension, z)
        assert (figure is not None) == drawn
    figure.draw_without_rendering()
    assert figure.axes[0].xaxis.get_offset_text().get_text() == ""
    ticks = [label.get_text() for label in figure.axes[0].get_xticklabels()]
    assert len(set(ticks)) == len(ticks)


@pytest.mark.parametrize(
    "attributes, title",
    [
        ({"state": "no_equilibrium"}, "roof: statics, load factor 0.43, reached of 1"),
        ({"limit_load_factor": 0.32}, "roof: statics, load factor 0.43 (limit point on the path)"),
    ],
)
def test_a_load_path_shows_that_the_load_is_not_carried(tmp_path, attributes, title):
    """The curve alone does not show that it ends below the full load, or jumps at a limit point."""
    figure = load_path(tmp_path / "path.h5", [0.0, 0.43], [0.0, 9e3], [0.0, -0.5], attributes)
    assert figure.get_suptitle() == title


def test_labels_in_space_do_not_overlap():
    """A flat net has two vertical ticks, and the label of z is left of that of the plan."""
    x = np.array([[480.0, 288.0, 118.8], [516.0, 312.0, 121.3]])
    figure, space, plan = canvas.open_space_and_plan(x)
    canvas.set_plan(plan, x[:, :2])
    figure.draw_without_rendering()
    assert [label.get_text() for label in space.get_zticklabels()] == ["119", "121"]
    assert space.zaxis.label.get_window_extent().x1 + 10 < plan.yaxis.label.get_window_extent().x0


def test_panels_of_a_tall_net_keep_their_labels_out_of_titles():
    """The lowest label of the upper panel ends above the title of the panel below."""
    figure, panels = canvas.open_space_panels(np.array([[-20.0, -35.0, 0.0], [40.0, 35.0, 60.0]]), 3)
    title = panels[2].set_title("combination ULS wind: -301.8 to 50.04 kN")
    figure.draw_without_rendering()
    assert panels[0].xaxis.label.get_window_extent().y0 > title.get_window_extent().y1


def test_selected_snapshots_show_events():
    """Around the first fracture and later ones, after removals, and at the largest motion.

    Of five fractures 35 % are two, 70 % are four; of ten 10 % are one, and 70 % are seven.
    """
    times, none = np.linspace(0.0, 10.0, 101), np.zeros(0)
    fractures = np.array([4.05, 4.15, 4.35, 4.55, 9.0])
    shown = times[select_snapshots(times, fractures, none, 4.2)]
    assert shown == pytest.approx([0.0, 4.0, 4.1, 4.2, 4.6, 9.1])
    ten = times[select_snapshots(times, 0.05 + np.arange(10.0), none, 4.2)]
    assert ten == pytest.approx([0.0, 0.1, 3.1, 4.3, 6.1, 9.1])
    assert times[select_snapshots(times, fractures[:1], np.array([2.0, 6.0]), 6.55)] == pytest.approx(
        [0.0, 1.9, 2.1, 4.1, 6.1, 6.6]  # removed at 2 s
    )
    assert times[select_snapshots(times, none, none, 3.04)] == pytest.approx([0, 2, 3.1, 4, 6, 10])


def test_colour_scales_cover_nearly_all_forces():
    """Tension and compression have one each. A fragment's peak is outside."""
    N = np.concatenate([np.linspace(1.0, 100.0, 1000), [1e6, 0.0, -5.0, -5.0]])
    assert ForceScale.of(N).tension == (0.0, 1e6)  # in equilibrium it is an overload
    scale = ForceScale.of(N, percentiles=OF_MOTION)
    assert scale.tension[0] == 0.0 and 98.0 < scale.tension[1] < 101.0  # 99 of 100
    assert scale.compression == pytest.approx((0.99 * 5.0, 1.01 * 5.0))
    assert ForceScale.of(np.array([98.0, 104.0])).tension[0] > 97.0  # a narrow range is not lost on 0 to 104


def test_colour_scales_ignore_elements_that_cannot_move():
    """A tie between two supports does not count, unless there is no other element."""
    N, moves = np.array([5e6, 1e3, 2e3, -7e6, -4e3]), np.array([False, True, True, False, True])
    scale = ForceScale.of(N, moves)
    assert scale.tension[1] == pytest.approx(2e3, rel=0.01) and scale.compression[1] < 4.1e3
    assert ForceScale.of(N[:1], moves[:1]).tension[1] > 4.9e6


def run_of_a_hung_weight(workshop, more: str, held="0,1,0", column="mass", value="400"):
    """Return the result of a weight on two cables. held : its axes; column, value : of it"""
    nodes = f"id,x,y,z,fixed_x,fixed_y,fixed_z,load_z,{column}\n1,-4,0,3,1,1,1,,\n2,4,0,3,1,1,1,,\n"
    nodes += f"3,0,0,0,{held},-4e3,{value}\n"
    text = STEEL.replace("100e3", "0.0") + more
    return workshop.solve(text, nodes, "start,end\n1,3\n2,3\n")


def test_pictures_distinguish_partly_held_nodes(workshop):
    """A weight on two cables that can only move along z: two squares, and a triangle that moves with it."""
    more = "[dynamics]\nduration = 0.5\n[output]\nframes = 4\n"
    with run_of_a_hung_weight(workshop, more, "1,1,0") as f:
        panel = collapse(f).axes[-1]
        drawn = {line.get_label(): line.get_data_3d() for line in panel.lines}
        part = "held in part, 1 (x: 1, y: 1)"
        assert {label for label in drawn if label[0] != "_"} == {"supports, 2", part}
        place = f["VTKHDF/Points"][-3:][f["VTKHDF/PointData/node_id"][-3:] == 3][0]
        assert np.ravel(drawn[part]) == pytest.approx(place, abs=1e-6)


def test_the_collapse_shows_as_many_dashed_elements_as_are_removed(workshop):
    """One of two cables is removed, the other breaks without fragments; at 0.1 s the first is still there."""
    more = "breaking_load = 8e3\n[[remove]]\nelements = [0]\ntime = 0.1\n[dynamics]\nduration = 0.5\n"
    more += "fragments = false\n[output]\nframes = 5\n"
    with run_of_a_hung_weight(workshop, more, "1,1,0") as f:
        panels = (figure := collapse(f)).axes
        legend = [text.get_text() for text in figure.legends[0].get_texts()]
        titles = [panel.get_title() for panel in panels]
        counts = [int(re.search(r"s: (\d) broken or removed", title)[1]) for title in titles]
        dashed = [
            sum(len(lines._segments3d) for lines in panel.collections if lines.get_linestyle()[0][1])
            for panel in panels
        ]
        assert any(title.startswith("t = 0.1 s: 0 broken") for title in titles)
        assert dashed == counts and counts[-1] == 2 and "broken; dashed: out of the net" in legend


def test_the_stages_explain_the_supports_of_each_of_them(workshop):
    """The weight is held in the first stage only."""
    more = stage("held", hold="[3]") + stage("free", release="[3]")
    with run_of_a_hung_weight(workshop, more) as f:
        shown = [text.get_text() for text in stages(f).legends[0].get_texts()]
    assert shown == ["supports, 3", "supports, 2"]


def test_a_mast_and_its_guys_have_no_edge_through_the_supports(workshop):
    """Four supports that surround the guys in plan, around no roof."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,-2,3.4641016,0,1\n3,-2,-3.4641016,0,1\n4,4,0,0,1\n5,0,0,6,0\n"
    elements = "start,end,group\n1,5,mast\n2,5,guy\n3,5,guy\n4,5,guy\n"
    text = STEEL.replace("100e3", "1e3") + MAST.replace("-50e3", "-2496.15")  # 3 x 1 kN x 6 m / 7.21 m
    text += "[load]\nself_weight = true\nsteps = 1\n"
    with workshop.solve(text, nodes, elements) as f:
        assert [line.get_label() for line in states(f).axes[0].lines] == ["supports, 4"]


def test_the_forces_of_a_picture_have_one_unit(workshop):
    """Of two states one has less than 2 kN; of two scales one ends below 2 MN."""
    more = "[load]\nself_weight = true\nsteps = 1\n"
    with run_of_a_hung_weight(workshop, more) as f:
        titles = [panel.get_title() for panel in states(f).axes[:2]]
        assert len(titles) == 2 and all(title.endswith(" kN") for title in titles)
    figure, panels = open_space_panels(np.eye(3), 1)
    forces = np.array([3e5, -2.3e6])
    add_force_scales(panels, ForceScale.of(forces), forces)
    labels = [bar.get_xlabel() for bar in figure.axes[1:]]
    assert labels == ["tension [MN], 0.3 to 0.3", "compression [MN], 2.3 to 2.3"]


def test_legends_name_axes_of_turned_supports_as_their_own(workshop):
    """The weight is held along its own x, at 30 degrees from x."""
    with run_of_a_hung_weight(workshop, "[load]\nsteps = 1\n", "1,0,0", "angle", "30") as f:
        labels = {line.get_label() for line in states(f).axes[0].lines}
    assert {"supports, 2", "held in part, 1 (own axes, x: 1)"} <= labels, labels


def test_pictures_distinguish_springs_from_supports(workshop):
    """A weight on two cables, held along x and y, and by a spring along z."""
    more = "[load]\nself_weight = false\nsteps = 1\n"
    with run_of_a_hung_weight(workshop, more, "1,1,0", "spring_z", "1e6") as f:
        figure = states(f)
        labels = {line.get_label() for line in figure.axes[0].lines}
        shown = {"supports, 2", "held in part, 1 (x: 1, y: 1)", "springs, 1 (z: 1)"}
        assert {label for label in labels if label[0] != "_"} == shown
        assert {text.get_text() for text in figure.legends[0].get_texts()} == shown
        sunk = -f["statics/displacement"][-1, 2, 2]
        factor = deflection_scale(sunk, 8.0)  # m, the largest extent: the cables are 8 m apart
        words = f"deflections from the net as given drawn {factor:g} times"
        title = " ".join(figure._suptitle.get_text().split())
        assert factor > 1.0 and "one scale of forces in all panels" in title and words in title
        drawn = next(line for line in figure.axes[1].lines if line.get_label() == "springs, 1 (z: 1)")
        assert drawn.get_data_3d()[2] == pytest.approx(-factor * sunk)


def test_info_describes_what_happened(storm):
    text = run_on_standing_ranks("info", storm.filename).stdout
    facts = ["Storm over a saddle", "on 2 ranks", "finished", "form finding:", "statics: 3 load steps"]
    facts += ["work identity", "change of energy over the stage", f"element {storm['events/element'][0]} "]
    for words in facts:
        assert words in text, words
    at_end = info_of_result(storm)["dynamics"]["at_end"]
    assert at_end["time"] == storm["history/time"][-1] and "work_identity_error" in at_end
    assert not {"probe_particle", "probe_element", "element", "element_id"} & at_end.keys()


REFUSED_WITHOUT = {  # a dataset, group or attribute: what reads it
    "history/work_identity_error": ["info", "plot"],
    "net/node_id": ["info", "plot", "report", "export"],
    "events/node_id": ["info", "export"],
    "envelope": ["info", "plot", "report", "export"],
    "VTKHDF": ["info", "plot", "report", "export"],
    "final/tension": ["info", "report"],
    "form_finding/residual_real_material": ["info"],
    "net/unstressed_length": ["info", "plot", "report", "export"],
    "provenance/net/ring_face": ["plot", "export"],
    "provenance/title": ["info", "plot", "report", "export"],
}


@pytest.mark.parametrize("lacking", REFUSED_WITHOUT)
def test_a_file_of_another_version_is_refused_in_one_line(storm, tmp_path, lacking, monkeypatch):
    for drawer in (run, canvas):  # pictures are made, but not drawn
        monkeypatch.setattr(drawer, "save", lambda figure, path: plt.close(figure) or path.touch() or path)
    path = tmp_path / "old.vtkhdf"
    shutil.copy(storm.filename, path)
    with h5py.File(path, "r+") as file:
        if lacking in file:
            del file[lacking]
        else:
            group, name = lacking.split("/")
            del file[group].attrs[name]
    line = f"{path}: {lacking.split('/')[-1]} is not in this file, which another version of netfall wrote"
    refused = []
    for name, read in (
        ("info", lambda: print_info(path, lambda line: None)),
        ("plot", lambda: plot_all(path, tmp_path)),
        ("report", lambda: write_report(path, tmp_path)),
        ("export", lambda: export(path, tmp_path / "tables", lambda line: None)),
    ):
        try:
            read()
        except InputError as error:
            assert error.lines == [f"{line}. Run the job again [E706]"]
            refused.append(name)
    assert refused == REFUSED_WITHOUT[lacking]


def test_the_old_file_remains_until_the_new_one_is_complete(workshop):
    job = workshop.job(*PRESSED_MAST)
    workshop.run(job).close()
    before = {p: p.read_bytes() for p in workshop.folder.iterdir()}
    workshop.run(job, "--set", "form_finding.max_iterations=5", code=3)
    assert {p: p.read_bytes() for p in workshop.folder.iterdir()} == before


@cache
def check_output(name: str) -> str:
    """Return the output of `netfall check` for a shipped job; a wheel is lifted by millimetres, for time."""
    job = ROOT / "jobs" / f"{name}.toml"
    if name != "wheel_erection":
        return run_on_standing_ranks("check", job).stdout
    with NamedTemporaryFile("w", suffix=".toml") as lower:
        lower.write(job.read_text().replace("change = 0.35", "change = 7e-3").replace("-0.05", "-1e-3"))
        lower.flush()
        return run_on_standing_ranks("check", lower.name).stdout


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "jobs").glob("*.toml")))
def test_the_expected_run_time_includes_the_start(name):
    """Within a factor of two: start, net, form, erection and equilibria, not only the steps."""
    text = (ROOT / "jobs" / f"{name}.toml").read_text()
    least, most = re.search(r"# Takes +([0-9.]+)(?: to ([0-9.]+))? s", text).groups()
    output = check_output(name)
    expected = float(re.search(r"expected run time about ([0-9.]+) s", output)[1])
    assert 0.5 * float(least) <= expected <= 2.0 * float(most or least)
    assert "compilation in the first run" in output


def test_the_expected_run_time_counts_erection_targets_and_removals():
    """Eight stages, three targets; with clamps two stages and three equilibria."""
    times = {}
    for name in ("wheel_erection", "dome_rings", "clamps"):
        line = check_output(name)
        parts = (re.search(rf"{part} ([0-9.]+) s", line) for part in ("erection", "equilibria"))
        times[name] = [float(match[1]) for match in parts]
        assert "needs relaxation, which takes seconds" in line
    assert times["wheel_erection"][0] == pytest.approx(8 * 480 * 2.5e-4, rel=0.05)
    assert times["dome_rings"][0] == pytest.approx(8 * 600 * 2.5e-4, rel=0.05)
    assert times["clamps"] == pytest.approx([2 * 480 * 2.5e-4, 3 * 480 * 1e-4], rel=0.05)


def test_the_expected_run_time_counts_checkpoints():
    """In a small net they take 26 ms each: 299 within 6 s, one every 20 ms."""
    often = ("--set", "output.checkpoint_interval=0.02")
    output = run_on_standing_ranks("check", ROOT / "jobs" / "saddle.toml", *often).stdout
    assert float(re.search(r"checkpoints ([0-9.]+) s", output)[1]) == pytest.approx(299 * 0.0264, rel=0.05)


@pytest.mark.parametrize("name", ["saddle", "stadium", "olympia", "wheel"])
def test_shipped_jobs_are_valid_and_described(name):
    described = ("valid", "particles", "stable step", "memory:", "expected run time", "modes ")
    for words in (*described, "of the critical"):
        assert words in check_output(name), words


def test_check_estimates_the_size_of_the_result(tmp_path):
    """For the stadium without fractures; with many, and for other jobs: test_processors.py."""
    job = ROOT / "jobs" / "stadium.toml"
    settings = ["--set", "wind.speed=30", "--set", "dynamics.duration=2"]
    run_on_standing_ranks("run", job, "-o", tmp_path / "result.vtkhdf", *settings)
    assert_expected_size(run_on_standing_ranks("check", job, *settings).stdout, tmp_path / "result.vtkhdf")


def assert_expected_size(output, result):
    """Check that the size is right to a tenth, or between both sizes if elements break."""
    least, most = re.search(r"result file about ([0-9.]+) MB(?:, up to ([0-9.]+) MB)?", output).groups()
    with h5py.File(result) as f:
        broken = f["history/broken"][-1]
    assert 0.9 * float(least) < result.stat().st_size / 1e6 < 1.1 * float(most if broken else least)


TORN = f"""{bare_saddle(20, 2e4, side=80.0, rise=4.0, section=(1.6e11, 1e-4, 7850.0))}yield_stress = 1.4e9
fracture_strain = 0.004
[form_finding]
[load]
dead = 300.0
[wind]
speed = 110.0
turbulence_intensity = 0.2
base_height = 10.0
pressure_coefficient = -5.0
onset = "sudden"
gust_field = "area_mean"
seed = 4
[dynamics]
duration = 5.0
[output]
probes = {list(range(200))}
"""


def test_check_gives_the_size_of_a_torn_net_and_the_memory_of_its_history(workshop):
    """A particle splits off at most of the elements. Rank 0 joins and writes the rows of 200 probes."""
    job = workshop.job(TORN)
    output = run_on_standing_ranks("check", job).stdout
    with workshop.run(job) as f:
        assert f["history/broken"][-1] > 0.6 * len(f["net/elements"])
        rows = sum(values.nbytes for values in f["history"].values())
        assert_expected_size(output, Path(f.filename))
    memory = float(re.search(r"([0-9.]+) MB on rank 0 for history rows", output)[1])
    assert memory == pytest.approx(HISTORY_COPIES * rows / 1e6, rel=0.1)


@pytest.mark.parametrize("keeps", [False, True])
def test_only_the_rank_that_writes_keeps_the_rows_of_probes(keeps):
    """200 probes have fifty times the size of the other columns, also in a resumed run."""
    history = History(None, Features(), keeps)
    columns = {name: np.zeros(3) for name in history.names}
    history.add(np.ones((3, 800)), columns)
    history.restore({"scales": history.scales}, columns | {PROBE_ROWS: np.ones((3, 800))})
    history.add(np.ones((1, 800)), {name: np.zeros(1) for name in history.names})
    size = sum(values.nbytes for block in history.blocks for values in block.values())
    assert size == 4 * 8 * (len(history.names) + (800 if keeps else 0)) and len(history) == 4


def test_of_many_cases_the_governing_ones_are_drawn():
    """30 cases include one without equilibrium, those with the largest force of an element, and the first."""
    forces = np.ones((30, 40))
    forces[29], forces[28, 0], forces[27, 1:3] = 5.0, -9.0, 7.0
    cases = [StateView(f"{k}", lambda k=k: forces[k], None, place=f"cases/{k}") for k in range(30)]
    labels = {case.place: SimpleNamespace(attrs={"state": "equilibrium"}) for case in cases}
    labels["cases/25"].attrs["state"] = "no_equilibrium"
    drawn = [int(case.name) for case in _governing(labels, cases)]
    assert drawn == [*range(20), 25, 27, 28, 29]


def test_a_matplotlibrc_of_the_user_does_not_change_pictures(tmp_path):
    """Pictures have the settings of netfall, not LaTeX, a decimal comma or simplified lines."""
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\npath.simplify_threshold: 1.0\n")
    names = "'text.usetex', 'path.simplify_threshold', 'axes.titlesize'"
    code = "from netfall.post.plots.canvas import plt; print(*map(plt.rcParams.get, (" + names + ")))"
    done = run_process(BIN / "python", "-c", code, environment=ENVIRONMENT | {"MATPLOTLIBRC": str(tmp_path)})
    assert done.stdout.split() == ["False", str(plt.rcParamsDefault["path.simplify_threshold"]), "9.0"]


def test_progress_is_plain_lines_without_a_terminal(workshop):
    """Progress has no bar, although mpirun gives each rank a terminal. --quiet prints nothing."""
    job = workshop.job(STILL + "[dynamics]\nduration = 0.05\n")
    done = run_netfall("run", job, "-o", workshop.folder / "x.vtkhdf", ranks=2)
    assert done.stdout.count("100 %") == 1
    line = next(line for line in done.stdout.splitlines() if "100 %" in line)
    assert all(words in line for words in ("t = 0.050 s", "steps/s", "left", "slack 0", "broken 0"))
    quiet = run_on_standing_ranks("run", job, "-o", workshop.folder / "x.vtkhdf", "--quiet")
    assert quiet.stdout == "" and quiet.stderr == ""


def test_a_terminal_of_80_columns_shows_all_of_the_progress(monkeypatch):
    """The bar is as wide as the text leaves it, so that counts of slack and broken elements are visible."""
    reader, terminal = pty.openpty()
    termios.tcsetwinsize(terminal, (24, 80))
    with os.fdopen(terminal, "w", encoding="utf-8") as screen:
        monkeypatch.setattr("sys.stdout", screen)
        progress = Progress(True)
        progress.at(1.0, "t = 1000.000 s", 100_000, "steps", "slack 12, broken 7")
        progress.end()
        assert os.read(reader, 4096).decode().rstrip().endswith("slack 12, broken 7")
    os.close(reader)


def test_a_full_disk_is_an_error_of_one_line(workshop, ranks=2):
    """A limit on file sizes replaces the full disk. The error names file and space; no file remains."""
    job = workshop.job(changed(checkpoint_interval=0))
    limited = "from mpi4py import MPI; import resource; resource.setrlimit(resource.RLIMIT_FSIZE, "
    limited += "(300_000, 300_000)); from netfall.__main__ import main; main()"
    command = [BIN / "mpirun", "-n", ranks, BIN / "python", "-c", limited, "run", job, "--quiet"]
    output = ["-o", workshop.folder / "full.vtkhdf", "--set", "output.frames=2000"]
    done = run_process(*command, *output, timeout=120, code=1)
    assert "Traceback" not in done.stderr, done.stderr
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("error: "))
    assert "full.vtkhdf: cannot be written" in line and "MB are free in" in line
    assert {path.name for path in workshop.folder.iterdir()} == {"job.toml"}


def test_an_output_path_in_use_is_refused(workshop):
    """A file that is not a result stays, also one that is open or in use. An old result is replaced."""
    import fcntl

    job = workshop.job(changed(duration=0.002))
    place = workshop.folder / "result.vtkhdf"
    place.write_text("precious")
    assert "is not a result of netfall" in workshop.run(job, code=2).stderr
    assert place.read_text() == "precious"
    place.unlink()
    workshop.run(job).close()
    workshop.run(job).close()
    with h5py.File(place, "r+"):
        assert "another run or program is writing" in workshop.run(job, code=2).stderr
    with open(workshop.folder / ".result.vtkhdf.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "another run or program is writing" in workshop.run(job, code=2).stderr
    workshop.run(job).close()
    assert not (workshop.folder / ".result.vtkhdf.lock").exists()


def pictures_of(path: Path, rows: slice) -> tuple[list[np.ndarray], list[int], float]:
    """Return these rows of the pictures of a film, their numbers of red pixels, and its duration [s]."""
    with Image.open(path) as film:
        frames = [(frame.convert("RGB"), frame.info["duration"]) for frame in ImageSequence.Iterator(film)]
    pictures = [np.asarray(picture, float)[rows] for picture, _ in frames]
    red = [int(((p[..., 0] > 180) & (p[..., 1:] < 90).all(-1)).sum()) for p in pictures]
    return pictures, red, sum(duration for _, duration in frames) / 1000


def test_animation_has_a_picture_for_each_frame(storm, tmp_path):
    """17 frames at 15 a second on average, each unlike the one before. Elements that break become red."""
    path, text = animate(Path(storm.filename), tmp_path, "gif", 15)
    assert path.name == "storm_collapse.gif" and text.startswith("17 frames at 15 a second: 1.13 s for 0.8 s")
    pictures, red, seconds = pictures_of(path, slice(60, 340))  # without title and bars
    assert len(pictures) == 17 and seconds == pytest.approx(17 / 15, abs=0.01)  # a GIF counts hundredths
    assert all((one != other).any() for one, other in pairwise(pictures))
    assert len(storm["events/time"]) > 3 and max(red[-5:]) > red[0] + 20


def test_a_film_shows_a_removed_element_and_its_end(workshop):
    """Frames are at whole time steps, here 0.3003 s. Removed elements have no line in the result."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,5,0,-1,0\n3,10,0,0,1\n4,5,5,0,1\n"
    elements = "id,start,end,prestress\n1,1,2,2e4\n2,2,3,2e4\n3,2,4,0\n"
    text = STEEL + "[dynamics]\nduration = 0.6006\ntime_step = 7.7e-4\n[output]\nframes = 6\n"
    text += "[[remove]]\nelements = [3]\ntime = 0.1\n"
    with workshop.solve(text, nodes, elements) as f:
        times, path = f["VTKHDF/Steps/Values"][:], Path(f.filename)
    assert times[3] == pytest.approx(0.3003)
    film, words = animate(path, workshop.folder, "gif", 10, FilmView(until=0.3))
    assert words.startswith("4 frames at 10 a second: 0.4 s for 0.3003 s")
    _, red, _ = pictures_of(film, slice(150, 440))
    assert red[3] > red[0] + 20


@pytest.mark.parametrize("most, shown", [(6, 5), (4, 4)])
def test_a_film_has_no_more_frames_than_the_limit(storm, tmp_path, monkeypatch, most, shown):
    """The last of the 17 frames is shown in addition to every fourth or sixth."""
    monkeypatch.setattr("netfall.post.plots.film.MAX_FRAMES", most)
    _, text = animate(Path(storm.filename), tmp_path, "gif", 15)
    assert text.startswith(f"{shown} frames")


def test_animation_with_another_view_size_and_end(storm, tmp_path):
    """The file is MP4, read by ffmpeg. An end before the second frame is an error."""
    shot = FilmView(VIEWS["plan"], (640, 480), 1.3, 0.41)
    path, description = animate(Path(storm.filename), tmp_path, "mp4", 10, shot)
    assert description.startswith("9 frames at 10 a second: 0.9 s for 0.4 s")  # of every 0.05 s
    with contextlib.closing(imageio_ffmpeg.read_frames(str(path))) as reader:
        assert next(reader)["size"] == (640, 480)
    assert imageio_ffmpeg.count_frames_and_secs(str(path))[0] == 9
    with pytest.raises(InputError, match=r"the second frame is at 0\.05 s"):
        animate(Path(storm.filename), tmp_path, "gif", 10, FilmView(until=0.01))


def test_pictures_of_similar_names_have_different_files():
    """A truncated or similar name gets a number."""
    groups = ["cases/a b", "cases/a_b", "cases/aa", "cases/aab"]
    names = [file_suffix(group.split("/")[1], group, groups, 9) for group in groups]
    assert names == ["a_b", "a_b-2", "aa", "aab"]
    assert len({file_suffix(group.split("/")[1], group, groups, 3) for group in groups}) == 4


def test_each_state_has_its_own_page(storm, tmp_path):
    assert plot_state(Path(storm.filename), tmp_path, "statics").name == "storm_statics.png"
    long = tmp_path / f"{'s' * 246}.vtkhdf"  # with the whole name of the case no file could be made
    long.symlink_to(storm.filename)
    assert plot_state(long, tmp_path, "statics").name == f"{'s' * 246}_stat.png"
    with pytest.raises(InputError, match="--case stom: no such state; this result has form, statics"):
        plot_state(Path(storm.filename), tmp_path, "stom")


@pytest.mark.parametrize(
    "size, extent, scale",
    [(0.05, 50.0, 50), (4.0, 50.0, 0.5), (0.0, 1.0, 1), (6e-9, 60.0, 1), (1e-4, 60.0, 2e4)],
)
def test_deflections_have_a_round_scale_and_errors_of_an_equilibrium_have_none(size, extent, scale):
    """A deflection of 6e-9 m of a roof of 60 m is such an error; one of 0.1 mm is not."""
    assert deflection_scale(size, extent) == scale


@pytest.mark.parametrize("sizes", [(305.0, 0.0, 66.0), (108.0, 0.0, 13.0)])
def test_labels_of_axes_in_space_lie_beside_their_ticks(sizes):
    """A cable with a tie, and one over two pylons, both seen from the front."""
    figure, panels = open_space_panels(np.array([[0.0, 0.0, 0.0], sizes]) - [24.0, 0.0, 0.0], 2)
    figure.draw_without_rendering()
    axis = panels[0].xaxis
    label = axis.label.get_window_extent()
    ticks = [tick.label1.get_window_extent() for tick in axis.get_major_ticks() if tick.label1.get_text()]
    assert len(ticks) > 2 and not any(label.overlaps(tick) for tick in ticks)


def test_labels_of_axes_in_space_contain_the_offset_of_coordinates():
    """Its own text would overlap the label."""
    points = np.array([[512300.0, 5412300.0, 0.0], [512330.0, 5412330.0, 5.0]])
    _, (axes,) = open_space_panels(points, 1)
    labels = [axis.get_label_text() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    assert labels == ["x [m], +5.123e5", "y [m], +5.4123e6", "z [m]"]
    assert not axes.yaxis.offsetText.get_visible()
    plt.close(axes.figure)


def test_labels_do_not_overlap_and_stay_within_the_picture():
    """Twelve around one position, and one that fits neither left nor right."""
    figure, ((axes,),) = open_charts(1, 1, 6, 5)
    texts = [*(f"element {k}" for k in range(12)), "node 209: (116.2, 7.3, -578.0) mm, down"]
    add_labels(axes, np.array([(0.5, 0.5)] * 12 + [(0.7, 0.9)]), texts)
    figure.canvas.draw()
    labels = [label for label in axes.texts if label.get_text()]  # the others are lines to places
    frame, boxes = axes.get_window_extent(), [Text.get_window_extent(label) for label in labels]
    assert [label.get_text() for label in labels] == texts
    assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 for box in boxes)
    for one, other in combinations(boxes, 2):
        across = min(one.x1, other.x1) - max(one.x0, other.x0)
        up = min(one.y1, other.y1) - max(one.y0, other.y0)
        assert min(across, up) < 0.5  # half a pixel


def first_line_of(*arguments, folder):
    """Return the first line of a command whose output is then closed, its exit code and errors."""
    command = [BIN / "netfall", *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=ENVIRONMENT, cwd=folder, **pipes) as running:
        line = running.stdout.readline()
        running.stdout.close()
        errors = running.stderr.read()
    return line, running.returncode, errors


def test_a_run_continues_after_its_output_is_closed(workshop):
    """`head -1` closes it, or it is closed from the start: the same result, no text on standard error."""
    job = workshop.job(JOB.replace("duration = 0.8", "duration = 0.2"))
    line, code, errors = first_line_of("run", job, "-o", "head.vtkhdf", folder=workshop.folder)
    assert (line.startswith("netfall "), code, errors) == (True, 0, "")
    command = f"{BIN / 'netfall'} run {job} -o closed.vtkhdf >&-"
    assert run_process("bash", "-c", command, cwd=workshop.folder).stderr == ""
    with workshop.open("head.vtkhdf") as one, workshop.open("closed.vtkhdf") as two:
        assert (one["history/kinetic_energy"][:] == two["history/kinetic_energy"][:]).all()
        assert one["history/time"][-1] == pytest.approx(0.2)


def test_an_import_writes_its_tables_after_its_output_is_closed(tmp_path):
    """The tables exist without an error of a full disk; so do the files of export."""
    Sketch().net().save(tmp_path / "roof.dxf")
    command = f"{BIN / 'netfall'} import roof.dxf -o roof | true; echo ${{PIPESTATUS[0]}}"
    done = run_process("bash", "-c", command, cwd=tmp_path)
    assert (done.stdout.strip(), done.stderr) == ("1", "")
    assert {path.name for path in (tmp_path / "roof").iterdir()} >= {"nodes.csv", "report.txt", "roof.toml"}


@pytest.mark.parametrize("last, words", [(0.001, "from t = 1 s to 2 s"), (0.02, "from t = 1 s on")])
def test_a_large_energy_balance_error_is_named_with_its_time(last, words):
    """A sudden start has an error relative to little energy, which may be small later."""
    history = {"time": np.arange(4.0), "work_identity_error": np.zeros(4)}
    off = {"energy_balance_error": [0.0, -0.02, 0.03, last]}
    off["balance_error_attached"] = [0.0, -0.01, 0.04, 0.5 * last]
    (warning,) = balance_warnings(history | off)
    shares = "0.03 of the energy that took part, 0.04 of the largest stored in attached parts (limit 0.001)"
    assert f"off by up to {shares}, {words}. " in warning
    assert [*balance_warnings(history | dict.fromkeys(off, np.full(4, 9e-4)))] == []


@pytest.mark.parametrize("width", [4.6, 5.4, 12.0])
def test_a_title_stays_within_a_narrow_picture(width):
    figure = plt.figure(figsize=(width, 4.0))
    rest = ": random inputs and outcomes (grey: not significant)"
    set_figure_title(figure, "Roof over the Market Hall", rest)
    box = figure._suptitle.get_window_extent(figure.canvas.get_renderer())
    assert box.x0 >= 0.0 and box.x1 <= width * figure.dpi


def test_dollars_in_names_are_not_formulas(tmp_path):
    figure, ((axes,),) = open_charts(1, 1, 6, 4)
    axes.semilogy([1, 2, 3], [1e-8, 1e-5, 1.0])
    set_figure_title(figure, r"Roof of 5 M$ \nowhere 7 M$", ": errors")
    save(figure, tmp_path / "a.png")
    assert figure._suptitle.get_text() == r"Roof of 5 M$ \nowhere 7 M$: errors"
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert "1e\N{MINUS SIGN}05" in labels and not any("$" in label for label in labels)
