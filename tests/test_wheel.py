"""The spoked wheel: its equilibrium by hand, its areas, and the shipped job."""

import numpy as np
import pytest
from conftest import ROOT, assert_same_results, run_on_standing_ranks
from nets import pulls

from netfall.geometry.generators.wheel import BRACE, GROUPS, largest_brace_force, wheel
from netfall.job.keys.net import Wheel
from netfall.job.read import read_job
from netfall.model.layout import make_layout

N_SPOKES, R, INNER, HEIGHT, DEPTH = 24, 50.0, 20.0, 6.0, 2.0
H, T = 5e5, 1e4  # N
SINE = np.sin(np.pi / N_SPOKES)


def dimensions(**others):
    sizes = {"diameter": 2 * R, "opening": 2 * INNER, "ring_height": HEIGHT, "ring_depth": DEPTH}
    return Wheel(**sizes, spokes=N_SPOKES, spoke_force=H, **others)


def small(hoops=2, hoop_force=T, brace_force=0.0):
    return wheel(dimensions(hoops=hoops, hoop_force=hoop_force, brace_force=brace_force))


def of(net, group):
    """The forces [N] of the elements of a group."""
    return net.prestress[net.group == net.group_names.index(group)]


@pytest.mark.parametrize("hoops", [0, 1, 5])
@pytest.mark.parametrize("hoop_force", [0.0, T])
@pytest.mark.parametrize("brace_force", [0.0, 8e4])
def test_every_node_is_in_equilibrium_without_reactions(hoops, hoop_force, brace_force):
    """Supports have no reactions either: the wheel is self-stressed."""
    net = small(hoops, hoop_force, brace_force)
    rounding = 1e-13 * np.abs(net.prestress).max()  # of the sums
    assert np.abs(pulls(net.x, net.elements, net.prestress)).max() < rounding


def test_forces_of_the_rings_by_hand():
    """H / (2 sin(pi / n)) in the tension rings; in the outer one that of both layers, with two hoops."""
    net = small()
    for group in ("ring_upper", "ring_lower"):
        assert of(net, group) == pytest.approx(np.full(N_SPOKES, H / (2 * SINE)), rel=1e-13)  # rounding
    outer = (2 * H + 2 * 2 * T * SINE) / (2 * SINE)
    assert of(net, "ring_outer") == pytest.approx(np.full(N_SPOKES, -outer), rel=1e-13)
    assert of(net, "hoop") == pytest.approx(np.full(2 * N_SPOKES, T), rel=1e-13)
    assert (of(net, "ring_truss") == 0).all() and np.ptp(of(net, "strut")) < 1e-9 * -of(net, "strut").max()
    assert (of(net, "upper") > H).all() and (of(net, "strut") < 0).all()


def test_diagonals_take_over_from_the_rings_and_push_on_their_struts():
    """q = D / l each: the rings lose q a, a their side, and the struts between them gain 2 q h."""
    D, side = 8e4, 2 * INNER * SINE
    plain, net, q = small(), small(brace_force=D), 8e4 / np.hypot(side, HEIGHT)
    assert of(net, BRACE) == pytest.approx(np.full(2 * N_SPOKES, D), rel=1e-13)
    for ring in ("ring_upper", "ring_lower"):
        assert of(net, ring) == pytest.approx(of(plain, ring) - q * side, rel=1e-12)
    push = of(plain, "strut")[0]
    expected = np.repeat([push - 2 * q * HEIGHT, push], [N_SPOKES, 2 * N_SPOKES])
    assert np.sort(of(net, "strut")) == pytest.approx(expected, rel=1e-12)
    assert net.m == plain.m + 2 * N_SPOKES and plain.group_names == GROUPS


def test_diagonals_that_leave_the_rings_slack_are_refused(workshop):
    """From the force on at which the rings' own force density is zero, H / (2 s a), a their side."""
    side = 2 * INNER * SINE
    most = H / (2 * SINE * side) * np.hypot(side, HEIGHT)
    assert largest_brace_force(dimensions()) == pytest.approx(most, rel=1e-14)
    done = run_on_standing_ranks(
        "check", workshop.job(CHECKED), "--set", f"net.wheel.brace_force={1.001 * most}", code=2
    )
    assert f"expected less than {most:.4g} N" in done.stderr


def test_without_hoops_it_is_a_pair_of_straight_cables():
    """Then slopes are equal above and below: heights +-h / 2, strut force H h / (2 (R - r))."""
    net = small(hoops=0, hoop_force=0.0)
    rings = net.x[np.hypot(*net.x[:, :2].T) < INNER + 1e-9]
    assert sorted(set(np.round(rings[:, 2], 9))) == [-HEIGHT / 2, HEIGHT / 2]
    strut = H * 0.5 * HEIGHT / (R - INNER)
    assert of(net, "strut") == pytest.approx(np.full(N_SPOKES, -strut), rel=1e-13)


CHECKED = """
[net]
generator = "wheel"
[net.wheel]
diameter = 100.0
opening = 40.0
ring_height = 6.0
ring_depth = 2.0
spokes = 24
hoops = 2
spoke_force = 5e5
hoop_force = 1e4
[cable]
modulus = 1.6e11
area = 1e-3
density = 8000.0
[group.ring_upper]
area = 6e-3
[group.ring_lower]
area = 6e-3
[group.ring_outer]
kind = "bar"
area = 0.1
[group.ring_truss]
kind = "bar"
area = 0.02
[group.strut]
kind = "bar"
area = 3e-3
[roof]
groups = ["ring_outer", "ring_upper", "upper", "hoop"]
openings = [[0.0, 0.0]]
[load]
self_weight = false
dead = 300.0
[dynamics]
duration = 0.1
mass_damping = 0.2
"""


def test_a_force_of_hoops_without_hoops_is_a_note(workshop):
    for hoops, notes in ((0, 1), (1, 0)):
        job = read_job(workshop.job(CHECKED), [f"net.wheel.hoops={hoops}"])
        text = "".join(make_layout(job, 1).notes)
        assert text.count("[net.wheel] hoop_force: no effect: with hoops = 0 there are none. [N451]") == notes


def test_check_prints_area_mass_and_stability_of_a_wheel(workshop):
    """Area in plan n / 2 sin(2 pi / n) (R^2 - r^2), without the opening; masses as given; no mechanism."""
    done = run_on_standing_ranks("check", workshop.job(CHECKED))
    lines = {line.split(":")[0].split()[0]: line for line in done.stdout.splitlines()}
    plan = 0.5 * N_SPOKES * np.sin(2 * np.pi / N_SPOKES) * (R**2 - INNER**2)
    assert f"{plan:.1f} m2 in plan" in lines["roof"], done.stdout
    net, areas = small(), dict.fromkeys(GROUPS, 1e-3)
    areas |= {"ring_upper": 6e-3, "ring_lower": 6e-3, "ring_outer": 0.1, "ring_truss": 0.02, "strut": 3e-3}
    area = np.array([areas[name] for name in GROUPS])[net.group]
    own = float((8000.0 * area * net.lengths() / (1.0 + net.prestress / (1.6e11 * area))).sum())
    assert f"elements {own:.4g} kg" in lines["masses"], done.stdout
    assert "mechanism" not in done.stdout and "not stable" not in done.stdout and "modes" in lines


def test_two_layers_without_roof_groups_are_refused(workshop):
    text = CHECKED.replace('groups = ["ring_outer", "ring_upper", "upper", "hoop"]\n', "")
    done = run_on_standing_ranks("check", workshop.job(text), code=2)
    assert "above one another" in done.stderr and "[roof] groups" in done.stderr


SHORT = ("--set", "dynamics.duration=0.2", "--set", "output.frames=4")


@pytest.fixture(scope="module")
def shipped(shared_workshop):
    return shared_workshop.run(ROOT / "jobs" / "wheel.toml", *SHORT)


def test_the_drift_is_carried_to_the_supports(shipped):
    """The upright reactions of the two cases differ by 750 N/m2 on the area of the zone in plan."""
    f = shipped
    x, elements, held = f["net/particles"][:], f["net/elements"][:], f["net/fixed"][:, 2].astype(bool)
    pull = {
        name: pulls(x + f[f"cases/{name}/displacement"][:], elements, f[f"cases/{name}/tension"][:])[held, 2]
        for name in ("snow", "drift")
    }
    zones = [name.decode() for name in f["net/zone_names"][:]]
    share = f["net/zone_share"][:, zones.index("drift")]  # the zone is cut
    area = (f["net/plan_area"][:] * share)[~held].sum()
    more = pull["snow"].sum() - pull["drift"].sum()
    assert more == pytest.approx(750.0 * area, abs=2 * 432 * 12.0)  # residuals of 12 N at most at each node


def test_all_equilibria_are_stable_with_taut_cables(shipped):
    """Each is reported as stable; an independent eigenvalue shows that the tangent is positive definite."""
    f = shipped
    for name in ("cases/snow", "cases/drift", "initial_state"):
        assert f[name]["stable"][()] == 1 and f[name]["slack"][()] == 0, name
    for name in ("snow", "drift"):
        u, N = f[f"cases/{name}/displacement"][:], f[f"cases/{name}/tension"][:]
        assert softest(f, u, N) > 1e3, name  # N/m; -1e3 in snow without diagonals


def softest(f, u, N):
    """Smallest eigenvalue [N/m] of the tangent of the shipped wheel under tensions N at displacements u."""
    x, elements = f["net/particles"][:] + u, f["net/elements"][:]
    d = x[elements[:, 1]] - x[elements[:, 0]]
    L = np.linalg.norm(d, axis=1)
    along = d / L[:, None]
    q, k = N / L, f["net/axial_stiffness"][:] / f["net/unstressed_length"][:]
    block = np.einsum("e,ei,ej->eij", k - q, along, along) + q[:, None, None] * np.eye(3)
    K = np.zeros((len(x), 3, len(x), 3))
    for (a, b), B in zip(elements, block):
        K[a, :, a] += B
        K[b, :, b] += B
        K[a, :, b] -= B
        K[b, :, a] -= B
    free = ~f["net/fixed"][:].astype(bool).ravel()
    return np.linalg.eigvalsh(K.reshape(3 * len(x), -1)[np.ix_(free, free)])[0]


def test_it_rests_in_the_mean_wind_and_its_modes_are_about_that(shipped):
    f = shipped
    assert len(f["events/time"]) == 0 and f["initial_state/residual"][()] < 12.0
    assert np.isfinite(f["modes/period"][:]).all() and (np.diff(f["modes/period"][:]) <= 0).all()
    ratio = 0.3 * f["modes/period"][:] / (4 * np.pi)
    assert f["modes/damping_ratio"][:] == pytest.approx(ratio, rel=1e-14)


@pytest.mark.long
def test_the_same_bits_on_two_ranks_and_through_a_restart(shipped, shared_workshop):
    """All datasets are equal, also modes, which a resumed run does not compute again."""
    job = ROOT / "jobs" / "wheel.toml"
    with shared_workshop.run(job, *SHORT, ranks=2, output="two.vtkhdf") as two:
        assert assert_same_results(shipped, two) > 90
    more = (*SHORT, "--set", "output.checkpoint_interval=0.08")
    shared_workshop.run(job, *more, output="saved.vtkhdf").close()
    last = sorted(shared_workshop.folder.glob("saved.checkpoint-5-*.h5"))[-1]
    with shared_workshop.run(job, *more, "--restart", last, ranks=2, output="saved.vtkhdf") as again:
        assert assert_same_results(shipped, again) > 90
