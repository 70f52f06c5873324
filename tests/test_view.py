"""`netfall view`: the page contains the data of the result, and draws them in a browser without network."""

import contextlib
import json
import re
import shutil
import sys
import time
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import Mock

import browser
import h5py
import numpy as np
import pytest
from conftest import STEEL, run_on_standing_ranks, wait_for
from matplotlib.colors import to_hex
from study_files import columns, write_study

from netfall import Net, run
from netfall.core.errors import InputError, naming_extras
from netfall.post.page import page, states
from netfall.post.page.page import MAX_DRAWN_DISPLACEMENT, select_hanging
from netfall.post.page.states import MAX_CODE, MISSING, ArrayBlock, select_drawn, shown_series
from netfall.post.page.study import choose_sample, net_page, sample_page
from netfall.post.plots.force import SLACK
from netfall.post.plots.states import find_equilibrium, one_state
from netfall.post.plots.utilisation import OVERUSED_COLOUR
from netfall.results.file import Frames
from netfall.results.states import start_position
from netfall.study.answers.read import read_study

BREAKS = f"""
title = "All </script> breaks & falls"
[net]
generator = "saddle"
[net.saddle]
cells = 4
{STEEL}yield_stress = 1.75e9
fracture_strain = 0.0404
[form_finding]
method = "force_density"
[wind]
speed = 200.0
pressure_coefficient = -9.0
base_height = 10.0
onset = "sudden"
surface_drag = 0.0
[dynamics]
duration = 0.5
[output]
frames = 25
"""
needs_k3d = pytest.mark.skipif(find_spec("k3d") is None, reason="k3d is not installed")
needs_browser = pytest.mark.skipif(
    find_spec("k3d") is None or not browser.is_there(), reason="no k3d, no Chromium, or no driver of it"
)


@contextlib.contextmanager
def opened(path: Path, *options):
    """Return a browser with a page; nothing in the page has failed."""
    with browser.browser(*options) as tab:
        tab.open(path)
        yield tab
        assert tab.faults() == []


@contextlib.contextmanager
def page_of(job: dict, folder: Path):
    """Return a browser with the page of the result of a job, and the result."""
    with run(job, output=folder / "r.vtkhdf") as result:
        page.write_page(folder / "r.vtkhdf", folder / "r.html")
        with opened(folder / "r.html") as tab:
            yield tab, result


@pytest.fixture(scope="module")
def broken(shared_workshop) -> Path:
    """Return the result of a saddle that breaks in a storm."""
    with shared_workshop.solve(BREAKS) as file:
        assert len(file["events/time"]) > 5
    return shared_workshop.folder / "result.vtkhdf"


@pytest.fixture(scope="module")
def its_page(broken) -> Path:
    done = run_on_standing_ranks("view", broken)
    assert "26 frames" in done.stdout and "result.html" in done.stdout
    return broken.with_suffix(".html")


def test_numbers_of_states_are_within_half_a_unit():
    """Integer shares of the largest value. nan and distant points have no value; small values are not 0."""
    values = np.random.default_rng(1).normal(size=(5, 40))
    values[2, 3], values[3, 4], values[4, 5], values[1, 6] = np.nan, 50.0, 1e-9, 0.0
    numbers = ArrayBlock()
    numbers.add_series(values, 4.0, nonzero=True)
    whole = np.cumsum(np.frombuffer(numbers.parts[0], "<i2")[: values.size].reshape(5, 40), 0, dtype=np.int16)
    assert whole[2, 3] == MISSING and whole[3, 4] == MISSING and whole[4, 5] == 1 and whole[1, 6] == 0
    known, unit = (whole != MISSING) & (np.abs(values) > 1e-6), np.frombuffer(numbers.parts[1], "<f4")
    assert known.sum() == 196 and unit.tolist() == [np.float32(4.0 / MAX_CODE)]
    assert np.abs(whole * unit - values)[known].max() <= 0.501 * unit  # 0.001: rounding


def test_elements_are_drawn_at_the_positions_of_the_result(broken):
    """Ends of each element in each frame, also those that split off. Broken elements have no force."""
    with h5py.File(broken) as f:
        drawn = select_drawn(f)
        (motion, *rest), left_out = shown_series(f, drawn)
        frames = Frames(f)
        assert len(drawn.loose) > 5 and left_out == [] and [each.name for each in rest] == ["form"]
        for k in range(len(frames.times)):
            lines = (drawn.start + motion.displacement[k])[drawn.ends]
            assert np.abs(lines - frames.lines(k)).max() < 1e-4  # m: single precision
            torn = frames.cell("broken", k).astype(bool)
            assert len(frames.cell("tension", k, 0, 0)) == len(frames.point("displacement", k, 0, 0)) == 0
            assert np.array_equal(np.isnan(motion.tension[k]), torn) and motion.broken[k] == torn.sum()
            assert np.array_equal(motion.tension[k][~torn], frames.cell("tension", k)[~torn])
        assert np.array_equal(rest[0].tension[0], f["form_finding/tension"][:])
        assert np.array_equal(drawn.start, start_position(f)[drawn.origin])


@pytest.mark.parametrize(
    "broken_ones, expected", [([], [0, 1]), ([1], [0]), ([0], [0, 1, 2]), ([0, 1, 2], [0, 1, 2])]
)
def test_the_view_follows_the_supported_part(broken_ones, expected):
    """Two elements hang on node 0 in a row, a third one falls. If no part is supported, all count."""
    frames = Mock(there=np.ones(3, bool))
    frames.ends.return_value = np.array([[0, 1], [1, 2], [3, 4]])
    frames.broken.return_value = np.isin(np.arange(3), broken_ones)
    assert np.flatnonzero(select_hanging(frames, 0, np.array([0]))).tolist() == expected


def test_a_large_result_is_thinned_with_a_note(broken, monkeypatch):
    monkeypatch.setattr(states, "MOST_ELEMENTS", 14)
    monkeypatch.setattr(states, "MOST_VALUES", 14 * 10)
    with h5py.File(broken) as f:
        drawn = select_drawn(f)
        (motion, *_), left_out = shown_series(f, drawn)
        assert drawn.every == 2 and len(drawn.rows) == 16
        cables = f["net/cable"][:]
        assert all(np.isin(np.flatnonzero(cables == name), drawn.rows).all() for name in cables[drawn.rows])
        assert left_out == ["one in 4 of the frames", "one in 2 of the cables"]
        assert np.array_equal(motion.time, f["VTKHDF/Steps/Values"][::4])


def test_a_missing_k3d_is_named_with_its_extra(broken, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "k3d", None)
    with pytest.raises(InputError, match=re.escape("pip install 'netfall[view]'")), naming_extras():
        page.write_page(broken, tmp_path / "page.html")
    assert [*tmp_path.iterdir()] == []


class References(HTMLParser):
    """The targets of a page's tags."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        names = ("src", "href", "action", "data", "poster", "srcset")
        self.found += [value for name, value in attrs if name in names]


@needs_k3d
def test_a_page_needs_no_other_files(its_page):
    text = its_page.read_text()
    reading = References()
    reading.feed(text)
    assert reading.found == [] and "[[" not in text.split("page-data")[0]
    assert "<title>All &lt;/script&gt; breaks &amp; falls</title>" in text
    data = json.loads(re.search(r'id="page-data">(.*?)</script>', text, re.S)[1])
    assert data["title"] == "All </script> breaks & falls" and len(data["states"]) == 2


@needs_browser
def test_the_page_draws_and_plays(its_page, broken):
    """The browser reports the times of the frames and the positions of lines. Playing changes the picture."""
    with opened(its_page) as tab, h5py.File(broken) as f:
        tab.run("return netfall.then(() => 1)")
        frames = Frames(f)
        assert tab.run("return K3DInstance.then(k => k.getTimeSeriesInfo().times)") == frames.times.tolist()
        first = tab.picture()
        some = int(np.argmax([frames.cell("broken", k).any() for k in range(len(frames.times))]))
        for step in (some, len(frames.times) - 1):
            tab.run(f"return K3DInstance.then(k => k.setTime({frames.times[step]})).then(() => 1)")
            drawn = {
                kind: tab.run(f"return netfall.then(s => [...s.kinds[{kind}].vertices])")
                for kind in ("TAUT", "SLACK", "BROKEN")
            }
            compare_lines(drawn, f, step)
        assert tab.picture() != first
        tab.run("document.getElementById('play').click()")
        one = tab.run("return netfall.then(s => s.frame)")
        wait_for(lambda: tab.run("return netfall.then(s => s.frame)") != one)
        tab.run("return netfall.then(s => choose(s, 1))")
        assert tab.run("return document.getElementById('foot').style.display") == "none"
        assert tab.run("return performance.getEntriesByType('resource').map(r => r.name)") == []


ROLLER = {  # a strut from a support to a node that runs along x, and ropes over one that is held along y
    "net": Net(
        nodes=np.array([[0, 0, 0], [4, 0, 1], [8, 0, 0]]),
        elements=[[0, 1], [1, 2], [0, 2]],
        groups=["up", "up", "strut"],
        fixed=np.array([[1, 1, 1], [0, 1, 0], [0, 1, 1]], bool),
        node_columns={"load_z": [0.0, 5.0, 0.0]},
    ),
    "cable": {"modulus": 1.6e11, "area": 5e-4, "density": 7850.0},
    "group": {"strut": {"kind": "bar"}},
    "load": {"steps": 1},
}


@needs_browser
def test_partly_held_nodes_have_their_own_colour(tmp_path):
    """One support of three nodes; the other two are held along some axes."""
    mark = "const at = s.k3d.getWorld().ObjectsListJson[{}]; return [...at.positions.data, at.color]"
    with page_of(ROLLER, tmp_path) as (tab, _):
        marks = [
            tab.run(f"return netfall.then(s => {{ {mark.format(k)}; }})") for k in ("SUPPORTS", "GUIDED")
        ]
    assert marks == [[0, 0, 0, 0x111111], [4, 0, 1, 8, 0, 0, 0x7A4B00]]


@needs_browser
def test_squares_are_at_the_supports_of_the_state(tmp_path):
    """The first stage holds a node that the second releases, and lifts all supports."""
    stages = [{"name": "grip", "hold": [1]}, {"name": "lift", "release": [1], "move": {"all": [0, 0, 2.0]}}]
    marks = "const of = (k) => { const at = s.k3d.getWorld().ObjectsListJson[k];"
    marks += "return at.visible ? [...at.positions.data] : []; }; return [of(SUPPORTS), of(GUIDED)];"
    with page_of(ROLLER | {"stage": stages}, tmp_path) as (tab, result):
        last = result.file["stages/lift/displacement"][:] + result.file["net/particles"][:]
        for k, (full, guided) in enumerate([([[0, 0, 0], [4, 0, 1]], [[8, 0, 0]]), (last[:1], last[2:])]):
            choice = f"choose(s, s.page.states.findIndex(t => t.name.includes('{stages[k]['name']}')));"
            at = tab.run(f"return netfall.then(s => {{ {choice} {marks} }})")
            assert np.allclose(at[0], np.ravel(full), atol=1e-3), (k, at)
            assert np.allclose(at[1], np.ravel(guided), atol=1e-2), (k, at)


@needs_browser
def test_each_view_shows_the_whole_net_and_a_click_selects_an_element(its_page):
    """Points and axis numbers are visible after each button. The text describes the selected element."""
    numbers = "[...document.querySelectorAll('#canvasTarget div[style*=\"0.75em\"]')]"
    shown = f"return {numbers}.filter(n => n.style.display === 'block').map(n => n.style.transform)"
    points = "return netfall.then(s => { const { camera } = s.k3d.getWorld(), n = s.points.length / 3;"
    points += "const place = (k) => s.points.subarray(3 * k, 3 * k + 3);"
    points += "const at = (k) => camera.position.clone().set(...place(k)).project(camera);"
    points += "return [...Array(n).keys()].map(k => at(k).toArray()); })"
    with opened(its_page) as tab:
        for side in ("plan", "front", "side", "space"):
            tab.run(f"return netfall.then(() => document.querySelector('[data-view={side}]').click())")
            time.sleep(0.5)  # until it is drawn, or somewhat later
            wait_for(lambda: np.abs(np.array(tab.run(points))).max() < 1.0)
            in_sight = lambda labels: len(labels) > 8 and not any("1000px" in each for each in labels)
            wait_for(lambda: in_sight(tab.run(shown)))  # where k3d puts hidden labels
        tab.run("return netfall.then(s => { s.picked = 3; draw(s); })")
        marked, drawn = (f"return netfall.then(s => [...s.kinds[{k}].vertices])" for k in ("PICKED", "TAUT"))
        assert tab.run(marked) == tab.run(drawn)[18:24]
        assert tab.run("return document.getElementById('picked').textContent").startswith("element 3")


@needs_browser
def test_a_browser_that_cannot_draw_shows_a_message(its_page):
    with browser.browser("--disable-3d-apis") as tab:
        tab.open(its_page)
        assert "WebGL is switched off" in tab.run("return document.getElementById('fault').textContent")


@needs_browser
def test_the_page_shows_forces_of_weak_elements_beside_strong_ones(tmp_path):
    """All four digits of stays with 1 / 3200 of the force of a chord are those of the result."""
    nodes = np.array([[0, 0, 0], [9, 0, 0], [-9, 0, 0], [0, 9, 0], [0, -9, 0]])
    elements, groups = [[0, 1], [0, 2], [0, 3], [0, 4]], ["", "", "stay", "stay"]
    net = Net(nodes, elements, groups=groups, fixed=np.arange(5) > 0)
    cable = {"modulus": 1.6e11, "area": 2e-2, "density": 7850.0, "prestress": 16e6}
    job = {"net": net, "cable": cable, "group": {"stay": {"area": 3e-5, "prestress": 4999.0}}}
    picked = "s.picked = 3; tellPicked(s); return document.getElementById('picked').textContent"
    with page_of(job | {"load": {"steps": 1}}, tmp_path) as (tab, _):
        shown = tab.run(f"return netfall.then(s => {{ {picked} }})")
    assert "axial force 0.004999 MN; elastic strain 0.1041 %" in shown


@needs_browser
def test_the_parts_of_a_slack_element_are_drawn_slack(tmp_path):
    """They hang from each other with less than their weight of 620 N, in the page and in a picture."""
    net = {"nodes": np.array([[0, 0, 0], [9, 0, 0], [18, 0, 0]]), "elements": [[0, 1], [1, 2]]}
    net |= {"fixed": np.array([True, False, True]), "node_columns": {"load_x": [0.0, 9e6, 0.0]}}
    net |= {"subdivide": 4}
    cable = {"modulus": 1.6e11, "area": 9e-4, "density": 7850.0, "prestress": 5e4}
    job = {"net": net, "cable": cable, "form_finding": {"method": "given_geometry"}, "load": {"steps": 1}}
    kinds = "[...Array(8).keys()].map(e => kindOf(s, e) === SLACK)"
    with page_of(job, tmp_path) as (tab, result):
        N = result.file["statics/tension"][-1]
        assert (N[4:] > 0.0).all() and (N[4:] < 620.0).all()
        figure = one_state(result.file, find_equilibrium(result.file, "statics"))
        drawn = tab.run(
            f"return netfall.then(s => {{ choose(s, s.page.states.length - 1); return {kinds} }})"
        )
    figure.draw_without_rendering()
    slack = [c for c in figure.axes[0].collections if to_hex(c.get_edgecolor()[0]) == SLACK]
    assert [len(lines.get_segments()) for lines in slack] == [4]
    assert drawn == [False] * 4 + [True] * 4


@needs_browser
def test_a_compressed_bar_has_no_utilisation_in_tension(tmp_path):
    """A negative share of the tensile resistance would hide that it may buckle."""
    cable = ROLLER["cable"] | {"yield_stress": 235e6}
    choose = "document.getElementById('state').value = s.page.states.length - 1;"
    choose += "document.getElementById('state').dispatchEvent(new Event('change'));"
    with page_of(ROLLER | {"cable": cable}, tmp_path) as (tab, _):
        texts = [
            tab.run(f"""return netfall.then(s => {{ {choose} s.picked = {element}; tellPicked(s);
                return document.getElementById('picked').textContent }})""")
            for element in (0, 2)
        ]
    assert "ultimate none" in texts[1] and "force -" in texts[1]
    assert "none" not in texts[0]


@needs_browser
def test_a_net_in_survey_coordinates_is_drawn_exactly(tmp_path):
    """Single precision resolves coordinates of 5,400 km to 0.5 m only."""
    nodes, place = np.array([[0, 0, 0], [4, 1, 1], [8, 0.3, 0]]), np.array([512345.0, 5412345.0, 430.0])
    net = Net(nodes=nodes + place, elements=[[0, 1], [1, 2]], fixed=[True, False, True])
    cable = {"modulus": 1.6e11, "area": 5e-4, "density": 7850.0}
    with page_of({"net": net, "cable": cable, "load": {"steps": 1}}, tmp_path) as (tab, _):
        drawn = np.reshape(tab.run("return netfall.then(s => [...s.page.start])"), (-1, 3))
        low, high = np.array(tab.run("return netfall.then(s => s.page.window)"))
    assert drawn - drawn[0] == pytest.approx(nodes, abs=1e-5)
    assert (drawn >= low).all() and (drawn <= high).all()
    assert (page.far_origin(np.array([[0.0, -50.0, 0.0], [8.0, 50.0, 1.0]])) == 0.0).all()


@needs_browser
def test_the_colours_show_the_overload_of_one_state(tmp_path):
    """Many snapshots without overload do not limit the colour scales below it."""
    cable = {"modulus": 160e9, "area": 4e-4, "density": 7850.0, "prestress": 60e3, "breaking_load": 200e3}
    job = {"net": {"generator": "saddle", "saddle": {"cells": 4}}, "cable": cable, "form_finding": {}}
    job |= {"case": [{"name": "snow", "set": {"load.snow": 2000.0}}], "dynamics": {"duration": 0.5}}
    choose = """for (const [id, part] of [['state', 'snow'], ['quantity', 'utilisation']]) {
        const list = document.getElementById(id), all = [...list.options];
        list.value = all.findIndex(option => option.text.includes(part));
        list.dispatchEvent(new Event('change'));
    }"""
    colours = "return netfall.then(s => [...s.kinds[TAUT].colours].filter((_, k) => k % 2))"
    with page_of(job, tmp_path) as (tab, result):
        tension = result.cases["snow"]["tension"]
        largest = page.build_page(result.file).data["quantities"][0]["tension"][1]
        assert tension.max() > 200e3 and largest > 0.98 * tension.max()
        tab.run(f"return netfall.then(() => {{ {choose} return 1 }})")
        over = tension > 200e3 / 1.5
        assert over.any() and not over.all()
        assert ([colour == int(OVERUSED_COLOUR[1:], 16) for colour in tab.run(colours)] == over).all()
        legend = tab.run("return document.getElementById('legend').textContent")
        assert "by the tension in the middle" in legend and "magenta: above 1" in legend


def compare_lines(drawn: dict[str, list], f, step: int) -> None:
    """Check that each element is drawn once with its kind and position, except distant ones."""
    frames, x = Frames(f), start_position(f)
    lines, N = frames.lines(step), frames.cell("tension", step)
    reach = MAX_DRAWN_DISPLACEMENT * np.ptp(x, axis=0).max()
    is_drawn = np.abs(lines - x[f["net/elements"][:]]).max((1, 2)) <= reach
    broken = frames.cell("broken", step).astype(bool)
    for kind, rows in {"TAUT": ~broken & (N != 0), "SLACK": ~broken & (N == 0), "BROKEN": broken}.items():
        vertices = np.array(drawn[kind], float).reshape(-1, 2, 3)  # None, of NaN, becomes nan
        has_line = ~np.isnan(vertices).any((1, 2))
        assert np.array_equal(has_line, rows & is_drawn), kind
        # half of the unit; single precision adds a tenth of it
        assert not has_line.any() or np.abs(vertices - lines)[has_line].max() < 0.6 * reach / MAX_CODE, kind


def shares_of(made, name: str) -> np.ndarray:
    """Return the values of the elements in a choice of a page, by the start of its name."""
    (place,) = (each["values"] for each in made.data["quantities"] if each["name"].startswith(name))
    return np.frombuffer(b"".join(made.numbers.parts), "<f4", place["length"], place["from"])


def test_the_page_of_a_study_has_the_map_of_first_fractures(tmp_path):
    """Shares of the samples with fractures; nan: never first."""
    failed = np.array([True, True, False, True])
    samples = columns({"wind.seed": np.arange(4)}, failed, np.full(4, 0.1))
    samples["first_element"] = np.array([7, 7, -1, 9])
    write_study(tmp_path / "s.study.h5", samples, {})
    made = net_page(read_study(tmp_path / "s.study.h5"))
    shares = shares_of(made, "first to break, share of the 3 samples")
    assert shares[[7, 9]] == pytest.approx([2 / 3, 1 / 3]) and np.isnan(np.delete(shares, [7, 9])).all()
    assert [state["name"] for state in made.data["states"]] == ["initial state of each sample"]


def test_the_page_of_a_study_shows_a_kept_sample(broken, tmp_path):
    """The one with the largest detached area, or a given one, together with the map of the study."""
    with h5py.File(broken) as f:
        names = ("particles", "elements", "element_id", "node_id", "fixed", "group", "tributary_area")
        roof = {name: f["net"][name][:] for name in names}
    failed = np.array([False, True, True])
    samples = columns({"wind.seed": np.arange(3)}, failed, np.array([0.0, 0.1, 0.3]))
    write_study(tmp_path / "s.study.h5", samples, {}, roof)
    (tmp_path / "s.samples").mkdir()
    for k in (1, 2):
        shutil.copy(broken, tmp_path / "s.samples" / f"{k:06d}.vtkhdf")
    study = read_study(tmp_path / "s.study.h5")
    made = sample_page(study, tmp_path / "s.samples", choose_sample(study, tmp_path / "s.samples", None))
    assert made.data["title"] == "a roof, sample 2" and len(made.data["states"][0]["time"]) == 26
    assert shares_of(made, "first to break")[7] == 1.0
    assert choose_sample(study, tmp_path / "s.samples", 1) == 1
    with pytest.raises(InputError, match=r"--sample 0: no file .*000000"):
        choose_sample(study, tmp_path / "s.samples", 0)


def test_a_page_does_not_replace_a_result_or_job(broken, tmp_path):
    copy = tmp_path / "result.vtkhdf"
    shutil.copy(broken, copy)
    answer = run_on_standing_ranks("view", copy, "-o", copy, code=2)
    assert "[E041]" in answer.stderr and copy.read_bytes() == broken.read_bytes()
    for command in ("view", "report"):
        assert "[E702]" in run_on_standing_ranks(command, ".", cwd=tmp_path, code=2).stderr
