"""Line smoother: the lines of elements, and their symmetric, bounded approximate inverse."""

import itertools

import numpy as np
import pytest
from nets import dense, problem_of, saddle

from netfall.job.read import read_job
from netfall.statics.multigrid import cycle
from netfall.statics.multigrid.lines import MOST_TOUCHING, LineSmoother, all_lines, distribute_lines
from netfall.statics.multigrid.tangent import incidence_of, tangent_rows

SADDLE = saddle("", 9, prestress=20e3, rise=4.0, section=(1.6e11, 400e-6, 7850.0))
SINGLE = 3e-6  # rounding of answers in single precision, as a share of the largest


def lines(ends, x, held=()) -> tuple[list[list[int]], int]:
    """Return the particles of each line, and `touching`; held : particles."""
    free = np.ones((len(x), 3), bool)
    free[list(held)] = False
    start, node, element, touching = all_lines(np.array(ends, np.uint32), np.array(x, float), free)
    ends = np.array(ends)
    for k in np.flatnonzero(element >= 0):
        assert set(ends[element[k]]) == set(node[k : k + 2])
    assert sorted(element[element >= 0]) == list(range(len(ends)))  # each in one line
    return [node[a:b].tolist() for a, b in itertools.pairwise(start)], touching


def test_straight_elements_form_one_line():
    """For any order of elements and ends; not across held particles or corners."""
    x = [(k, 0.1 * (k % 2), 0) for k in range(5)] + [(2, 1, 0), (2, -1, 0), (3, 2, 0)]
    ends = [(3, 2), (0, 1), (2, 1), (3, 4), (2, 5), (6, 2), (5, 7)]
    line_of, touching = lines(ends, x)
    assert sorted(min(line, line[::-1]) for line in line_of) == [[0, 1, 2, 3, 4], [5, 2, 6], [5, 7]]
    assert touching == 3  # two lines at 2, and another one after 5
    line_of, _ = lines(ends, x, held=[2])
    assert [2, 3, 4] in line_of or [4, 3, 2] in line_of


def test_a_ring_is_one_line_and_spokes_end_at_their_hub():
    """The ring's first particle is its last. At a hub of many spokes no two form one line."""
    turn = 2.0 * np.pi * np.arange(24) / 24
    rim = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    ring = [(k, (k + 1) % 24) for k in range(24)]
    line_of, touching = lines(ring, rim)
    assert len(line_of) == 1 and line_of[0][0] == line_of[0][-1] and len(line_of[0]) == 25 and touching == 2
    spokes = [(24, k) for k in range(24)]
    line_of, touching = lines(ring + spokes, [*rim, (0, 0, 0)])
    assert sorted(map(len, line_of)) == [2] * 24 + [25] and touching > MOST_TOUCHING


def smoother(job):
    """Return the smoother of a net's tangent at the start, and the tangent's matrix, on one rank."""
    scene = problem_of(job)
    state, distribution = scene.state, scene.distribution
    of_net = scene.finder.newton(scene.model.loading.permanent)
    K, at = of_net.tangent(), incidence_of(state.ends, distribution.subdomain.particle_gid, state.n_owned)
    rows = tangent_rows(distribution, of_net.net, K, at, 0.0)
    distributed = distribute_lines(distribution, state.ends, state.x_start, state.free)
    return LineSmoother(distributed, rows, of_net.net, K), dense(rows), of_net, K


def operator(lines: LineSmoother, n: int) -> np.ndarray:
    """Return the matrix (n, n) of a step."""
    columns = np.zeros((n, n))
    for k in range(n):
        r, x = np.zeros((2, n // 3, 3), np.float32)
        r.flat[k] = 1.0
        lines.add_step(r, x)
        columns[:, k] = x.ravel()
    return columns


@pytest.mark.parametrize("prestress", [20e3, 20.0, 0.2])
def test_a_step_of_lines_is_symmetric_positive_and_bounded(workshop, prestress):
    """Eigenvalues of lines are above 0 and at most 3, the lines at an element; a step halves them."""
    job = read_job(workshop.job(SADDLE), [f"cable.prestress={prestress}"])
    lines, matrix, *_ = smoother(job)
    step = operator(lines, len(matrix))
    assert np.abs(step - step.T).max() < SINGLE * np.abs(step).max()
    root = np.linalg.cholesky(matrix)
    values = np.linalg.eigvalsh(root.T @ (0.5 * (step + step.T)) @ root)
    assert lines.lines.touching == 3 and values[0] > 0.0 and 1.2 < values[-1] < 1.5 * (1.0 + 1e-3)


def test_one_step_solves_a_net_of_one_line(workshop):
    """A step is the inverse for a chain of ten cables under tension."""
    nodes = "id,x,y,z,fixed\n" + "".join(f"{k},{2 * k},0,0,{int(k in (0, 10))}\n" for k in range(11))
    elements = "id,start,end\n" + "".join(f"{k},{k},{k + 1}\n" for k in range(10))
    cable = SADDLE[SADDLE.index("[cable]") : SADDLE.index("[form")]
    lines, matrix, *_ = smoother(read_job(workshop.job(cable, nodes, elements)))
    assert lines.lines.touching == 1
    assert np.abs(operator(lines, len(matrix)) @ matrix - np.eye(len(matrix))).max() < 1e-3


@pytest.mark.parametrize("prestress", [20e3, 200.0])
def test_lines_need_fewer_iterations_than_particles(workshop, prestress, monkeypatch):
    """Conjugate gradients need at most 0.7 times as many: taut 11 for 17, soft 84 for 173."""
    job, counts = read_job(workshop.job(SADDLE), [f"cable.prestress={prestress}", "net.saddle.cells=40"]), []
    for most in (MOST_TOUCHING, 0):
        monkeypatch.setattr(cycle, "MOST_TOUCHING", most)
        *_, newton, K = smoother(job)
        newton.begin()
        counts.append(newton.solve(K, newton.cycle(K), newton.residual())[1])
    assert 0 < counts[0] < 0.7 * counts[1]
