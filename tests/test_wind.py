"""The wind on a roof: its force, tables of speeds, the output of `check`, the options after a fracture."""

import math
import re

import numpy as np
import pytest
from conftest import STEEL, run_on_standing_ranks
from nets import STORM, model_of, saddle

from netfall.core.errors import InputError
from netfall.explicit.wind_section import expected_gust_factor
from netfall.job.read import read_job
from netfall.loads.wind.measured import point_weights
from netfall.physics.wind_spectra import Gust, davenport, en1991

FLAT = '[net]\ngenerator = "saddle"\n[net.saddle]\nside = 40.0\nrise = 0.0\ncells = 4\n' + STEEL
FLAT += "[form_finding]\nmodulus_factor = 0\n"
BLOW = (
    "[wind]\nonset = 'sudden'\nspeed = 30.0\nsurface_drag = {k}\npressure_coefficient = {u}\n"
    "base_height = 10.0\nair_density = 1.25\nprofile_exponent = 0.0\n"
    "[dynamics]\nduration = 0.002\ntime_step = 1e-5\n[output]\nhistory_interval = 0.001\n"
)


def measured(workshop, speeds: str, points: str = "") -> str:
    """Return the job of a flat roof in a wind from tables."""
    (workshop.folder / "speed.csv").write_text(speeds)
    (workshop.folder / "points.csv").write_text(points)
    keys = 'file = "speed.csv"' + '\npoints = "points.csv"' * bool(points)
    return FLAT + BLOW.format(k=0.0, u=-1.0).replace("speed = 30.0\nsurface_drag = 0.0", keys)


def test_measured_wind_from_a_table(workshop):
    """Speeds from a table, interpolated in time: impulse of a linear ramp on a flat roof."""
    f = workshop.solve(measured(workshop, "time,speed\n-1,99\n0,0\n0.001,20\n0.004,20\n"))
    mass = 7850 * 683.08e-6 * 20 / (1 + 100e3 / (1.95e11 * 683.08e-6))
    impulse = 100 * 0.625 * (20**2 / 3 * 0.001 + 20**2 * 0.001)
    free = ~f["net/fixed"][:].astype(bool).all(1)
    assert np.allclose(f["final/velocity"][:][free, 2], impulse / mass, rtol=2e-3)
    assert np.allclose(f["wind/speed"][:3, 0], [0, 20, 20])


MAST = "name,x,y,z\nWest,-15,0,5\nEast,15,0,30\n"


def test_measured_wind_at_several_points(workshop):
    """Each place has a column. A node near it has almost its speed, adjusted to the node's height."""
    text = measured(workshop, "time,East,west\n0,30,20\n0.004,30,20\n", MAST)
    f = workshop.solve(text.replace("profile_exponent = 0.0", "profile_exponent = 0.2"))
    assert f["wind/control_point"][:].tolist() == [[-15, 0, 5], [15, 0, 30]]
    assert f["wind/mean_speed"][:].tolist() == [20, 30] and f["wind/gust_factor"][:].tolist() == [1, 1]
    free = ~f["net/fixed"][:].astype(bool).all(1)
    x, v = f["net/particles"][:][free], f["final/velocity"][:][free, 2]
    mass = 7850 * 683.08e-6 * 20 / (1 + 100e3 / (1.95e11 * 683.08e-6))
    left, right = 1 / np.hypot(x[:, 0] + 15, x[:, 1]) ** 2, 1 / np.hypot(x[:, 0] - 15, x[:, 1]) ** 2
    # all nodes are 10 m above ground, the places 15 m and 40 m
    speed = (left * 20 * (10 / 15) ** 0.2 + right * 30 * (10 / 40) ** 0.2) / (left + right)
    # the net barely resists within 2 ms, the neighbours in proportion to the difference of speeds
    assert np.allclose(v, 100 * 0.625 * speed**2 * 0.002 / mass, rtol=5e-3)
    assert np.ptp(speed) > 2


def test_weights_of_places_sum_to_one_and_are_continuous():
    """A place has its own speed. There is no jump where the fourth nearest changes, or with fewer places."""
    rng = np.random.default_rng(1)
    places = rng.uniform(-50, 50, (9, 3))
    line = np.column_stack([np.linspace(-60, 60, 20_001), np.full(20_001, 3.0), np.zeros(20_001)])
    corner, weight = point_weights(line, places)
    assert np.allclose(weight.sum(1), 1) and weight.min() >= 0
    speeds = rng.uniform(10, 40, 9)
    along = (weight * speeds[corner]).sum(1)
    assert len(np.unique(np.sort(corner, axis=1), axis=0)) > 5  # the nearest change
    assert np.abs(np.diff(along)).max() < 0.1  # m/s in 6 mm; the smallest change of a set moves none
    corner, weight = point_weights(places, places)
    assert (corner[:, 0] == np.arange(9)).all() and np.allclose(weight[:, 0], 1, atol=1e-6)
    corner, weight = point_weights(line, places[:1])
    assert (weight[:, 0] == 1).all() and (weight[:, 1:] == 0).all()
    square = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.6, 0.8, 0]])  # all at one distance
    assert np.isfinite(point_weights(np.zeros((1, 3)), square)[1]).all()


@pytest.mark.parametrize(
    "points, speeds, message",
    [
        (MAST, "time,west\n0,1\n1,1\n", "column east is missing; expected time, west, east"),
        (MAST, "time,west,east\n0,1,\n1,1,1\n", "empty cells"),
        (
            MAST + "west,0,0,1\n",
            "time,west,east\n0,1,1\n1,1,1\n",
            "line 4: name = 'west': expected a unique name",
        ),
        (MAST + "top,15,0,50\n", "time\n0\n", "at the same x, y as 'east'. Give one height"),
        (MAST + "low,3,3,-9.5\n", "time\n0\n", "name = 'low': 0.5 m above ground"),
        (MAST + "low,3,3\n", "time\n0\n", "line 4: 3 values"),
        (MAST + "low,3,3,\n", "time\n0\n", "empty cells"),
        (MAST + "time,3,3,1\n", "time\n0\n", "name = 'time': expected a unique name"),
    ],
)
def test_wrong_points_are_refused(workshop, points, speeds, message):
    assert message in workshop.solve(measured(workshop, speeds, points), code=2).stderr


@pytest.mark.parametrize(
    "keys, message",
    [
        (
            "surface_drag = 0.03\nturbulence_intensity = 0.2\n",
            "surface_drag and turbulence_intensity exclude each other",
        ),
        ('points = "points.csv"\n', "points: has no effect without file"),
        ("turbulence_intensity = 1.5\n", "turbulence_intensity = 1.5: expected a number from 0 to 1"),
        ('spectrum = "karman"\n', 'expected one of "davenport", "kaimal", "von_karman", "en1991"'),
        ("gust_length = 0\n", 'expected a number from 0.1 to 100000 m or "auto"'),
        ("direction = 400\n", "expected a number from -360 to 360 degrees"),
    ],
)
def test_wrong_keys_of_the_gusts_are_refused(tmp_path, keys, message):
    job = tmp_path / "job.toml"
    job.write_text(FLAT + BLOW.replace("surface_drag = {k}\n", keys).format(u=-1.0))
    with pytest.raises(InputError, match=re.escape(message)):
        read_job(job)


def checked(workshop, keys):
    """Return the lines of `check` on the wind of a flat roof at 10 m, and its notes on the wind."""
    keys += "" if "gust_field = " in keys or "= 0\n" in keys else 'gust_field = "point"\n'
    text = FLAT + BLOW.replace("surface_drag = {k}\n", keys).format(u=-1.0).replace("= 0.002", "= 60.0")
    text = text.replace("time_step = 1e-5", "time_step = 0.001").replace("speed = 30.0", "speed = 40.0")
    job = workshop.job(text)
    done = run_on_standing_ranks("check", job)
    words = ("wind:", "gusts:", "note: [wind]", "warning: [wind]")
    return [line for line in done.stdout.splitlines() if line.startswith(words)]


def test_check_describes_the_gusts(workshop):
    lines = checked(workshop, "surface_drag = 0.05\n")
    intensity = np.sqrt(6 * 0.05)
    assert f"intensity {intensity:.3g} there ({40 * intensity:.3g} m/s, davenport)" in lines[0]
    negative = 0.5 * math.erfc(1 / intensity / math.sqrt(2))  # of a normal distribution
    assert f"{negative:.2%} of their speeds negative" in lines[0] and negative > 0.03
    assert "the duration covers 2 gust lengths (1200 m / U0 = 30 s): use several seeds" in lines[1]
    n = np.linspace(1e-6, 10, 2_000_001)
    S = (x := 30 * n) / (1 + x**2) ** (4 / 3)
    above = (1 + 300.0**2) ** (-1 / 3)  # x = 1200 m 10 Hz / 40 m/s
    assert f"samples 0.05 s apart lack {above:.2%} of the variance (above 10 Hz)" in lines[2]
    S = S / S.sum()
    # mean over time of (1 - s)^2 + s^2 + 2 s (1 - s) R
    between = (1 - (S * np.cos(2 * np.pi * n * 0.05)).sum()) / 3
    match = float(re.search(r"interpolation removes ([\d.]+)%", lines[2])[1])
    assert match == pytest.approx(100 * between, abs=0.02)  # digits; a uniform grid here
    assert re.search(r"differs from that of Davenport's coherence by \S+ over the roof \(root", lines[3])
    assert [line.split(":")[1][:14] for line in lines[4:]] == [" [wind] surfac"]
    line = checked(workshop, "surface_drag = 0.05\ncoherence_decay = [100.0, 200.0, 100.0]\n")[-1]
    match = re.search(
        r"standard deviation is ([\d.]+) times that of the coherence, at ([\d.]+) Hz ([\d.]+) times", line
    )
    assert 1.1 <= float(match[1]) < float(match[3]) and 0.8 < float(match[2]) < 1.25
    line = checked(workshop, 'surface_drag = 0.05\ngust_field = "area_mean"\n')[4]
    share = re.search(r"a node has (\d+)% to (\d+)% of the standard deviation", line)
    assert 50 < float(share[1]) < float(share[2]) < 110


def test_expected_gust_factor():
    """The factor equals that of records with the same correlation. Davenport's peak factor is too large."""
    speed, sigma, dt = 40.0, 7.2, 0.05
    n = np.linspace(1e-5, 10, 1_000_001)
    S = (x := 30 * n) / (1 + x**2) ** (4 / 3)
    gust = Gust(davenport, speed, sigma, 1200.0, 0.0)
    lag = np.arange(601) * dt
    share = 2 / 3 * 30 * (n[1] - n[0]) * S
    correlation = np.array([(share * np.cos(2 * np.pi * n * tau)).sum() for tau in lag])
    root = np.linalg.cholesky(correlation[np.abs(np.subtract.outer(*2 * [np.arange(601)]))])
    records = root @ np.random.default_rng(1).standard_normal((601, 20_000))
    for duration in (4.0, 30.0):
        largest = records[: int(duration / dt) + 1].max(0).mean()
        factor = expected_gust_factor(gust, dt, duration)
        assert factor == pytest.approx(1 + sigma / speed * largest, abs=0.01)  # of 0.24 and 0.42
    # records of 0.0063 s hold fewer gusts; 1.56 sigma: of records of 26,000 s
    assert expected_gust_factor(gust, dt / 8, 4.0) == pytest.approx(1 + sigma / speed * 1.56, abs=0.01)
    g = np.sqrt(2 * np.log(1e5 * np.sqrt((n**2 * S).sum() / S.sum())))  # too long for records
    expected = expected_gust_factor(gust, dt, 1e5)
    assert expected == pytest.approx(1 + sigma / speed * (g + 0.5772 / g), abs=0.01)


def test_the_expected_gust_factor_of_an_hour_of_short_steps_is_a_mean_over_records():
    """It has no jump at 131072 samples: both steps give the mean of records, below Davenport's factor."""
    gust = Gust(en1991, 40.0, 6.0, 1200.0, 0.0)
    n = np.geomspace(1e-6, 25.0, 100_000)
    S = gust.spectrum(n)
    g = np.sqrt(2 * np.log(3600 * np.sqrt(np.trapezoid(n**2 * S, n) / np.trapezoid(S, n))))
    longer, shorter = (expected_gust_factor(gust, dt, 3600.0) for dt in (0.02, 0.028))
    assert longer == pytest.approx(shorter, abs=0.03)
    assert longer < 1 + gust.deviation / gust.speed * (g + 0.5772 / g) - 0.05


def test_the_expected_gust_factor_of_short_gusts_is_a_mean_over_many_durations():
    """The factor of the spectrum of EN 1991-1-4 equals that of an independent realisation of 50 hours."""
    speed, sigma, length, dt, duration, count = 30.0, 6.0, 63.2, 0.1, 60.0, 1_800_000
    n = np.fft.rfftfreq(count, dt)
    S = sigma**2 * length / speed * 6.8 / (1 + 10.2 * n * length / speed) ** (5 / 3)
    white = np.fft.rfft(np.random.default_rng(2).standard_normal(count))  # one-sided density 2 dt
    record = np.fft.irfft(white * np.sqrt(S / (2 * dt)), count)
    window = round(duration / dt) + 1
    largest = record[: count // window * window].reshape(-1, window).max(1).mean()
    gust = Gust(en1991, speed, sigma, length, 0.0)
    assert expected_gust_factor(gust, dt, duration) == pytest.approx(1 + largest / speed, abs=0.005)


def test_check_names_the_losses_of_time_step_and_lags(workshop):
    """A step of 0.5 s, two lags, coefficients independent of the direction; no note if all is well."""
    lines = checked(workshop, "turbulence_intensity = 0.18\ntime_step = 0.5\nar_order = 2\ndirection = 30\n")
    places = ("time_step = 0.5:", "ar_order = 2: the spectrum", "direction = 30 (from 210 degrees):")
    notes = [next(line for line in lines if word in line) for word in places]
    assert len(lines) == 7 and all(note.startswith(("note: ", "warning: ")) for note in notes), lines
    above, rest = (1 + 30.0**2) ** (-1 / 3), float(re.search(r"([\d.]+)% of the variance", notes[0])[1])
    assert above < rest / 100 < 1.7 * above  # less the part that interpolation removes
    quiet = checked(workshop, 'turbulence_intensity = 0.18\nspectrum = "kaimal"\ntime_step = 0.02\n')
    assert [line for line in quiet if line.startswith(("note", "warning"))] == []
    assert checked(workshop, "surface_drag = 0\n") == [
        "wind: steady, 40 m/s at 10 m, to 0 degrees (from 180 degrees)"
    ]


def test_gusts_without_load_have_no_note(workshop):
    """Coefficients are 0, so no gust is too strong."""
    text = FLAT + BLOW.replace(
        "surface_drag = {k}",
        "coherence_decay = [100.0, 200.0, 100.0]\nturbulence_intensity = 0.18\ngust_field = 'point'",
    )
    done = [run_on_standing_ranks("check", workshop.job(text.format(u=u))) for u in (-1.0, 0.0)]
    assert ['gust_field = "point"' in each.stdout for each in done] == [True, False]
    assert not any("nan" in each.stdout + each.stderr or "Warning" in each.stderr for each in done)


@pytest.mark.parametrize("points, weak", [(9, True), (49, False)])
def test_means_that_are_weak_at_nodes_are_noted(workshop, points, weak):
    lines = checked(
        workshop,
        f'surface_drag = 0.03\ncontrol_points = {points}\ngust_field = "area_mean"\n'
        "coherence_decay = [24.0, 60.0, 10.0]\n",
    )
    least = re.search(r"a node has (\d+%) to", " ".join(lines))[1]
    notes = [line for line in lines if line.startswith("warning") and '"area_mean"' in line]
    assert len(notes) == weak and all(f"(smallest {least})" in note for note in notes), lines


def facade_tables() -> tuple[str, str]:
    """Return tables of a facade of 40 x 25 m with nodes every 5 m, areas and normals, its rim held."""
    places = [(k, j) for k in range(9) for j in range(6)]
    nodes = "id,x,y,z,fixed,area,normal_x,normal_y,normal_z\n"
    for k, j in places:
        edges = (k in (0, 8)) + (j in (0, 5))
        nodes += f"{10 * k + j},0,{5 * k},{5 * j},{int(edges > 0)},{25 / 2**edges},1,0,0\n"
    elements = [f"{10 * k + j},{10 * k + j + 10}\n" for k, j in places if k < 8]
    elements += [f"{10 * k + j},{10 * k + j + 1}\n" for k, j in places if j < 5]
    return nodes, "start,end\n" + "".join(elements)


@pytest.mark.parametrize("gusts", ["area_mean", "point"])
def test_a_facade_from_tables_has_gusts_over_its_height(workshop, gusts):
    """Each decay changes the gusts. `check` and /wind state the difference from the coherence."""
    keys = f"turbulence_intensity = 0.18\ngust_field = '{gusts}'\nMORE\n"
    text, errors = STEEL + BLOW.replace("surface_drag = {k}\n", keys).format(u=1.0), []
    for decay in ("[8.0, 16.0, 10.0]", "[8.0, 4.0, 10.0]", "[8.0, 16.0, 1.0]", "[8.0, 16.0, 300.0]"):
        job = read_job(workshop.job(text.replace("MORE", f"coherence_decay = {decay}"), *facade_tables()))
        field = model_of(job).wind_field
        load = np.bincount(field.corner.ravel(), (field.force[:, :1] * field.weight).ravel())
        errors.append(np.sqrt(load @ field.model.covariance @ load))
    assert errors[1] > 1.02 * errors[0] and errors[3] < 0.6 * errors[0], errors
    # gusts at points are too strong, the more so the less they are alike: with 1 about the load of 10
    assert errors[2] > 1.02 * errors[0] if gusts == "area_mean" else errors[2] != errors[0], errors
    job = workshop.job(text.replace("MORE\n", ""), *facade_tables())
    (line,) = re.findall("gusts: the correlation.*", run_on_standing_ranks("check", job).stdout)
    match = re.search(r"by (\S+) over the roof, (\S+) in height \(root mean", line)
    computed = workshop.run(job)["wind/coherence_error"][:]
    assert [f"{error:.2g}" for error in computed] == [match[1], match[2]] and (computed < 0.3).all()


def test_a_result_describes_its_gusts(workshop):
    text = FLAT + BLOW.replace(
        "surface_drag = {k}", "turbulence_intensity = 0.6\ngust_field = 'point'"
    ).format(u=-1.0)
    f = workshop.solve(text.replace("duration = 0.002", "duration = 0.5"))["wind"]
    u, mean = f["speed"][:], f["mean_speed"][:]
    assert (f["gust_factor"][:] == u.max(0) / mean).all()
    assert (f["negative_share"][:] == (u < 0).mean(0)).all()
    assert f["turbulence"][()] == 0.6 and f["gust_lengths"][()] == pytest.approx(0.5 * 30 / 1200)
    assert f["variance_beyond"][()] == pytest.approx((1 + 400.0**2) ** (-1 / 3), rel=1e-3)  # quadrature
    assert 0 < f["variance_between"][()] < f["variance_beyond"][()] < 0.03
    assert abs(f["spectrum_misfit"][()]) < 0.15


@pytest.mark.parametrize(
    "table, message",
    [
        ("time,speed\n0,1\n0,2\n", "not above the row before"),
        ("time,speed\n0,1\n0.001,1\n", "covers 0 to 0.001 s"),
        ("time,speed\n0,1\n1,-2\n", "speed = '-2'"),
        ("time,velocity\n0,1\n", "column speed is missing"),
    ],
)
def test_wrong_wind_table_is_refused(workshop, table, message):
    assert message in workshop.solve(measured(workshop, table), code=2).stderr


def test_wind_without_normals_is_refused(workshop):
    """The table has areas but the net no face in plan, so the wind would have no direction."""
    nodes = "id,x,y,z,fixed,area\n1,0,0,0,1,5\n2,10,0,0,0,10\n3,20,0,0,1,5\n"
    done = workshop.solve(STEEL + BLOW.format(k=0.0, u=-1.0), nodes, "start,end\n1,2\n2,3\n", code=2)
    assert "1 free nodes with a roof area meet no closed face in plan (first: node 2)" in done.stderr


AFTER = f"""{saddle()}{STORM}after_fracture = "{{after}}"
[dynamics]
duration = 1.0
[output]
history_interval = 0.002
frames = 20
"""


def test_options_of_the_wind_after_a_fracture(workshop):
    """all: no more external work after the first fracture; particle: less than none."""
    f = {
        after: workshop.solve(AFTER.format(after=after), name=after, output=f"{after}.vtkhdf")
        for after in ("particle", "all", "none")
    }
    first = {after: (g["events/step"][0], g["events/element"][0]) for after, g in f.items()}
    assert len(set(first.values())) == 1
    t, work = f["all"]["history/time"][:], f["all"]["history/external_work"][:]
    after = t > f["all"]["events/time"][0] + 0.002
    assert after.sum() > 50 and np.ptp(work[after]) == 0.0
    assert np.ptp(f["particle"]["history/external_work"][:][after]) > 0
    assert f["none"]["history/external_work"][-1] != f["particle"]["history/external_work"][-1]
