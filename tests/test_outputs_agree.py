"""One quantity is the same in each output: tables, summary, messages, pictures."""

import json

import h5py
import numpy as np
import pytest
from matplotlib.colors import to_rgba
from mpi4py import MPI
from results import rows_of
from study_files import columns, net, write_study

from netfall.driver.check import check_values
from netfall.driver.sample import run_sample
from netfall.exchange.export import export
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.post.page.states import select_drawn, shown_series
from netfall.post.page.study import net_page
from netfall.post.plots import canvas, states
from netfall.post.plots.collapse import collapse
from netfall.post.plots.curves import energies
from netfall.post.plots.study.maps import loss_map
from netfall.post.report.info import info_of_result
from netfall.study.answers.read import read_study

# A cable of three elements carries 60 kN at two nodes; the middle one has the least tension and strength.
NODES = "id,x,y,z,fixed,load_z\n10,0,0,0,1,0\n20,5,0,-1,0,-60e3\n30,10,0,-1,0,-60e3\n40,15,0,0,1,0\n"
WEAK = "id,start,end,cable,breaking_load\n7,10,20,M,900e3\n8,20,30,M,800e3\n9,30,40,M,900e3\n"
CABLE = "[cable]\naxial_stiffness = 80e6\nmass_per_length = 4.0\n"


def test_the_largest_tension_of_a_cable_is_that_of_its_elements(workshop):
    """The element with the largest utilisation need not be the one with the largest tension."""
    workshop.solve(CABLE + "[load]\nself_weight = false\nsteps = 1\n", NODES, WEAK).close()
    folder = workshop.report().folder
    (cable,), elements = rows_of(folder / "cables.csv"), rows_of(folder / "elements.csv")
    top = max(elements, key=lambda row: float(row["tension_max"]))
    assert cable["element_max"] == top["element"] != "8"
    assert cable["tension_max"] == top["tension_max"] != cable["tension_en1993"]
    assert cable["breaking_load"] == "800000"


def test_maps_of_removals_show_those_without_equilibrium(tmp_path):
    """Such a removal has no factor and may detach nothing: it is red on maps, and a choice of the page."""
    roof = net()
    removed = roof["element_id"][:3].astype(str).astype(object)
    samples = columns({"removed": removed}, np.zeros(3, bool), np.zeros(3))
    samples["dynamic_factor_max"] = np.array([1.5, np.nan, 1.8])
    samples["equilibrium_after_removal"] = np.array(["equilibrium", "no_equilibrium", "equilibrium"], object)
    write_study(tmp_path / "loss.study.h5", samples, {}, roof)
    study = read_study(tmp_path / "loss.study.h5")
    figure = loss_map(study)
    assert "red: no equilibrium afterwards, 1;" in figure.get_suptitle()
    red = [
        line
        for axes in figure.axes
        for lines in axes.collections
        if hasattr(lines, "get_segments") and np.allclose(lines.get_colors(), to_rgba(canvas.BROKEN))
        for line in lines.get_segments()
    ]
    ends = roof["particles"][roof["elements"][1], :2]
    assert len(red) == 2 and all(np.allclose(line, ends) for line in red)
    (choice,) = (each for each in net_page(study).data["quantities"] if "without an equil" in each["name"])
    assert choice["tension"] == (0.0, 1.0)


def test_elements_that_erection_removes_have_no_force_in_cases(workshop):
    """The smallest force of a case is that of the elements which are there, as `netfall info` prints it."""
    nodes = NODES + "60,5,0,-6,1,0\n"
    elements = WEAK.replace("id,start,end", "id,start,end,group").replace(",M", ",main,M")
    text = CABLE + '[load]\nself_weight = false\n[[stage]]\nname = "all"\n[[stage]]\nname = "main alone"\n'
    text += 'active = ["main"]\n[[case]]\nname = "more"\nset = {"load.temperature" = 5.0}\n'
    with workshop.solve(text, nodes, elements + "5,20,60,temporary,T,\n") as f:
        low, shown = f["cases/more/tension"][:3].min(), info_of_result(f)["equilibria"]["cases/more"]
    assert shown["tension_min"] == low > 100e3
    folder = workshop.report().folder
    main, temporary = rows_of(folder / "cases.csv")
    assert float(main["tension_min"]) == pytest.approx(low) and temporary["tension_min"] == ""
    assert f"| more | case | equilibrium | {low / 1e3:.5g} kN |" in (folder / "summary.md").read_text()


def test_the_picture_of_modes_has_all_damping_after_erection(workshop):
    """Damping ratios add up; modes are drawn about the net that erection has lifted."""
    text = '[net]\ngenerator = "saddle"\n[net.saddle]\nside = 20.0\nrise = 2.0\ncells = 2\n' + CABLE
    text += 'prestress = 50e3\n[form_finding]\n[load]\nself_weight = false\n[[stage]]\nname = "lift"\n'
    text += "move = {all = [0.0, 0.0, 30.0]}\n[modes]\ncount = 1\n[wind]\nspeed = 20.0\n"
    text += 'turbulence_intensity = 0.0\nbase_height = 10.0\npressure_coefficient = 0.5\nonset = "sudden"\n'
    text += "aerodynamic_damping = 0.5\n[dynamics]\nduration = 0.01\nmass_damping = 0.3\n"
    with workshop.solve(text) as f:
        ratios = [f[f"modes/{name}"][0] for name in ("damping_ratio", "air_damping_ratio")]
        space = states.modes(f).axes[0]
    assert min(ratios) > 1e-3
    assert f"damped by {100.0 * sum(ratios):.2g} % of the critical" in space.get_title()
    assert space.get_zlim()[0] > 25.0


def test_report_and_info_count_the_same_broken_elements(workshop):
    """Both parts of a subdivided cable break: one element of the tables."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,-10,0,1000,-9810\n"
    text = "subdivide = 2\n" + CABLE.replace("4.0", "0.01") + "breaking_load = 9e3\n"
    text += "[load]\nself_weight = false\n[dynamics]\nduration = 0.1\n"
    job = workshop.job(text, nodes, "id,start,end\n7,1,2\n")
    workshop.run(job).close()
    folder = workshop.report().folder
    lines = workshop.info().splitlines()
    assert sum(line.startswith("  t = ") for line in lines) == 2
    assert any("broken: 1 element" in line for line in lines)
    assert "\n1 element broke, the first at" in (folder / "summary.md").read_text()
    with h5py.File(folder.parent / "result.vtkhdf") as f:
        assert f["history/broken"][-1] == 2
        (motion,) = (series for series in shown_series(f, select_drawn(f))[0] if series.name == "motion")
        assert motion.broken[-1] == 1
        *_, last = collapse(f).axes
        assert ": 1 broken or removed" in last.get_title()
    outcomes = run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache())
    assert outcomes["broken"] == 1


def test_the_picture_of_the_motion_counts_slack_elements_as_the_report(workshop):
    """Four parts of one cable that hangs between two nodes, and a bar without force."""
    nodes = "id,x,y,z,fixed_x,fixed_y,fixed_z,mass\n1,0,0,0,1,1,1,\n2,4,0,0,0,1,1,9\n3,4,0,2,1,1,1,\n"
    text = "subdivide = 4\n" + CABLE + '[group.bar]\nkind = "bar"\nprestress = 0.0\n'
    text += "[load]\nself_weight = false\n[dynamics]\nduration = 0.01\n"
    elements = "id,start,end,group,unstressed_length\n7,1,2,,4.5\n8,2,3,bar,2\n"
    with workshop.solve(text, nodes, elements) as f:
        assert all(": 0 broken or removed, 1 slack" in axes.get_title() for axes in collapse(f).axes)


def test_the_picture_of_energies_omits_unknown_ones(workshop):
    """With energy = false works and errors are nan; the kinetic and the strain energy are known."""
    text = CABLE + "[load]\nself_weight = false\n[dynamics]\nduration = 0.1\n[output]\nenergy = false\n"
    with workshop.solve(text, NODES, WEAK) as f:
        figure = energies(f)
    (axes,) = figure.axes
    assert all(np.isfinite(line.get_ydata()).all() for line in axes.lines)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["kinetic", "strain (since t = 0)", "plastic dissipation"]


def test_check_prints_the_forces_of_the_last_stage(workshop):
    """The temperature of [load] acts in stages, so the forces that start the run include it."""
    text = CABLE + "[load]\nself_weight = false\ntemperature = -40.0\n"
    job = workshop.job(text + '[[stage]]\nname = "cold"\n', NODES, WEAK)
    with workshop.run(job) as f:
        N = f["stages/cold/tension"][:]
    values = check_values(read_job(job), [])
    assert (values["tension_min"], values["tension_max"]) == pytest.approx((N.min(), N.max()), rel=1e-9)


def test_check_prints_lengths_and_masses_at_the_temperature_of_form_finding(workshop):
    """The cutting list and /net/unstressed_length do the same if the loads are at another temperature."""
    warm = workshop.job(CABLE + "[load]\nself_weight = false\ntemperature = 80.0\n", NODES, WEAK, "warm")
    cold = workshop.job(CABLE + "[load]\nself_weight = false\n", NODES, WEAK, "cold")
    outputs = [list[str](), list[str]()]
    values = [check_values(read_job(job), lines) for job, lines in zip((warm, cold), outputs)]
    assert values[0]["unstressed_length"] == values[1]["unstressed_length"]
    with workshop.run(warm) as f:
        assert values[0]["unstressed_length"] == pytest.approx(f["net/unstressed_length"][:].sum(), rel=1e-12)
    shown = [[line for line in lines if line.startswith(("elements: un", "masses"))] for lines in outputs]
    assert shown[0][0].partition("; tension")[0] == shown[1][0].partition("; tension")[0]
    assert shown[0][1] == shown[1][1]


def test_an_exported_case_has_lengths_at_its_own_temperature(workshop):
    """The form has those at the temperature of [load]; the case is at another one."""
    text = CABLE + '[load]\nself_weight = false\ntemperature = -20.0\n[[case]]\nname = "hot"\n'
    workshop.solve(text + 'set = {"load.temperature" = 30.0}\n', NODES, WEAK).close()
    for case, temperature in ((None, -20.0), ("hot", 30.0)):
        path = workshop.folder / f"{case}.json"
        export(workshop.folder / "result.vtkhdf", path, list[str]().append, case=case)
        edge = json.loads(path.read_text())["data"]["edge"]["10"]["20"]
        ratio = edge["unstressed_length_warm"] / edge["unstressed_length"]
        assert ratio == pytest.approx(1.0 + 12e-6 * temperature, rel=1e-15)


def test_reactions_without_an_equilibrium_contain_the_elements_alone(workshop):
    """The file has no reactions of the last state of a load path, so the sum lacks loads on supports."""
    text = CABLE.replace("4.0", "100.0") + "[load]\nsteps = 2\nstop_at_strength = true\n"
    nodes = NODES.replace("0,0,1,0", "0,0,1,-10e3")
    workshop.solve(text, nodes, WEAK.replace("00e3", "0e3"), code=3)
    folder = workshop.report().folder
    last = rows_of(folder / "reactions.csv")[-1]
    assert last["stage"].endswith("reached of 1") and last["foundation"] == ""
    assert "\nan equilibrium under the whole load, only the pull" in (folder / "summary.md").read_text()


def test_the_report_has_the_largest_reaction_in_motion(workshop):
    """The cable falls into its load, and the peak of its tension is before the end of the stage."""
    text = CABLE.replace("4.0", "100.0") + "[load]\nsteps = 0\n[dynamics]\nduration = 0.5\n"
    with workshop.solve(text, NODES.replace("load_z", "mass").replace("-60e3", "6e3"), WEAK) as f:
        peak, end = (f[name][:].max() for name in ("envelope/tension_max", "final/tension"))
        assert peak > 1.2 * end
        assert f["envelope/reaction_max"][:].max() == pytest.approx(peak, rel=0.02)  # with half of its weight
    assert "Largest in motion: " in (workshop.report().folder / "summary.md").read_text()


@pytest.mark.parametrize(("duration", "is_short"), [(0.13, True), (0.5, False)])
def test_a_motion_too_short_for_its_peak_is_named(workshop, duration, is_short):
    """A weight on two cables loses one. Within a tenth of the period the other force has not doubled."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,-10,0,1000,-9810\n"
    text = CABLE.replace("80e6", "1e6") + "[load]\nself_weight = false\n"
    text += f"[[remove]]\nelements = [1]\ntime = 0.1\n[dynamics]\nduration = {duration}\n"
    workshop.solve(text, nodes, "id,start,end,unstressed_length\n1,1,2,10\n2,1,2,10\n").close()
    (line,) = (line for line in workshop.info().splitlines() if line.startswith("removal 1"))
    assert ("; element 2 did not reach the tension of" in line) == is_short, line
