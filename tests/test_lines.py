"""Lines of elements: which ones there are, and that their answers together are a bounded inverse."""

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
    """The particles of each line, and `touching`; held : particles."""
    free = np.ones((len(x), 3), bool)
    free[list(held)] = False
    start, node, element, touching = all_lines(np.array(ends, np.uint32), np.array(x, float), free)
    ends = np.array(ends)
    for k in np.flatnonzero(element >= 0):
        assert set(ends[element[k]]) == set(node[k : k + 2])
    assert sorted(element[element >= 0]) == list(range(len(ends)))  # each in one line
    return [node[a:b].tolist() for a, b in itertools.pairwise(start)], touching


def test_elements_that_run_straight_on_are_one_line():
    """Whatever the order of the elements and of their ends; not over what is held, nor round a corner."""
    x = [(k, 0.1 * (k % 2), 0) for k in range(5)] + [(2, 1, 0), (2, -1, 0), (3, 2, 0)]
    ends = [(3, 2), (0, 1), (2, 1), (3, 4), (2, 5), (6, 2), (5, 7)]
    found, touching = lines(ends, x)
    assert sorted(min(line, line[::-1]) for line in found) == [[0, 1, 2, 3, 4], [5, 2, 6], [5, 7]]
    assert touching == 3  # two lines at 2, and behind 5 another one
    found, _ = lines(ends, x, held=[2])
    assert [2, 3, 4] in found or [4, 3, 2] in found


def test_a_ring_is_one_line_and_spokes_end_at_a_hub_of_many():
    """The ring's first particle is its last; at a hub of so many spokes no two are one line."""
    turn = 2.0 * np.pi * np.arange(24) / 24
    rim = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    ring = [(k, (k + 1) % 24) for k in range(24)]
    found, touching = lines(ring, rim)
    assert len(found) == 1 and found[0][0] == found[0][-1] and len(found[0]) == 25 and touching == 2
    spokes = [(24, k) for k in range(24)]
    found, touching = lines(ring + spokes, [*rim, (0, 0, 0)])
    assert sorted(map(len, found)) == [2] * 24 + [25] and touching > MOST_TOUCHING


def smoother(job):
    """That of a net's tangent at the start, and the tangent's matrix; both of one rank."""
    scene = problem_of(job)
    state, distribution = scene.state, scene.distribution
    of_net = scene.finder.newton(scene.model.loading.permanent)
    K, at = of_net.tangent(), incidence_of(state.ends, distribution.subdomain.particle_gid, state.n_owned)
    rows = tangent_rows(distribution, of_net.net, K, at, 0.0)
    found = distribute_lines(distribution, state.ends, state.x_start, state.free)
    return LineSmoother(found, rows, of_net.net, K), dense(rows), of_net, K


def operator(lines: LineSmoother, n: int) -> np.ndarray:
    """The matrix (n, n) of a step."""
    columns = np.zeros((n, n))
    for k in range(n):
        r, x = np.zeros((2, n // 3, 3), np.float32)
        r.flat[k] = 1.0
        lines.add_step(r, x)
        columns[:, k] = x.ravel()
    return columns


@pytest.mark.parametrize("prestress", [20e3, 20.0, 0.2])
def test_the_answers_of_lines_are_symmetric_positive_and_bounded(workshop, prestress):
    """Of lines alone the eigenvalues go from above 0 to as many as touch an element, 3; a step takes half."""
    job = read_job(workshop.job(SADDLE), [f"cable.prestress={prestress}"])
    lines, matrix, *_ = smoother(job)
    step = operator(lines, len(matrix))
    assert np.abs(step - step.T).max() < SINGLE * np.abs(step).max()
    root = np.linalg.cholesky(matrix)
    values = np.linalg.eigvalsh(root.T @ (0.5 * (step + step.T)) @ root)
    assert lines.lines.touching == 3 and values[0] > 0.0 and 1.2 < values[-1] < 1.5 * (1.0 + 1e-3)


def test_a_net_of_one_line_is_solved_at_once(workshop):
    """A chain of ten cables under tension: a step is the inverse."""
    nodes = "id,x,y,z,fixed\n" + "".join(f"{k},{2 * k},0,0,{int(k in (0, 10))}\n" for k in range(11))
    elements = "id,start,end\n" + "".join(f"{k},{k},{k + 1}\n" for k in range(10))
    cable = SADDLE[SADDLE.index("[cable]") : SADDLE.index("[form")]
    lines, matrix, *_ = smoother(read_job(workshop.job(cable, nodes, elements)))
    assert lines.lines.touching == 1
    assert np.abs(operator(lines, len(matrix)) @ matrix - np.eye(len(matrix))).max() < 1e-3


@pytest.mark.parametrize("prestress", [20e3, 200.0])
def test_by_lines_conjugate_gradients_take_fewer_iterations_than_by_particles(
    workshop, prestress, monkeypatch
):
    """At most 0.7 times as many: taut 11 for 17, soft 84 for 173."""
    job, counts = read_job(workshop.job(SADDLE), [f"cable.prestress={prestress}", "net.saddle.cells=40"]), []
    for most in (MOST_TOUCHING, 0):
        monkeypatch.setattr(cycle, "MOST_TOUCHING", most)
        *_, newton, K = smoother(job)
        newton.begin()
        counts.append(newton.solve(K, newton.cycle(K), newton.residual())[1])
    assert 0 < counts[0] < 0.7 * counts[1]
