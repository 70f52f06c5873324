"""A job has the same bits on any number of ranks; partitions are read, written and refused."""

import subprocess
import sys

import pytest
from conftest import ENVIRONMENT, ROOT, STEEL, assert_same_results, run_on_standing_ranks, run_process

from netfall.geometry.generators import generate as generators
from netfall.job.keys.net import Saddle
from netfall.parallel.partition import metis_partition, read_partition, write_partition

COLLAPSE = f"""[net]
generator = "stadium"
{STEEL}yield_stress = 1.75e9
fracture_strain = 0.0404
[form_finding]
[load]
dead = 1000.0
self_weight = true
pressure = [0.0, 0.0, 300.0]
steps = 2
tolerance = 1e-3
[wind]
onset = "sudden"
speed = 80.0
pressure_coefficient = -1.3
base_height = 10.0
surface_drag = 0.03
gust_field = "point"
after_fracture = "{{after}}"
[dynamics]
duration = 1.0
mass_damping = 0.5
[output]
frames = 10
history_interval = 0.02
probes = [[0.0, 15.0], [22.0, 10.0]]
"""


LONG = pytest.mark.long


@pytest.mark.parametrize(
    "ranks, per_node, after, least",
    [
        (2, None, "all", 4),
        (3, 2, "detached", 100),
        pytest.param(2, 1, "detached", 100, marks=LONG),
        *(pytest.param(n, None, "detached", 100, marks=LONG) for n in (3, 4)),
    ],
)
def test_a_collapse_is_the_same_on_any_number_of_ranks(workshop, ranks, per_node, after, least):
    """All bits except /provenance, with neighbours on one node and on others; the whole wind ends."""
    job = workshop.job(COLLAPSE.format(after=after))
    nodes = {"NETFALL_RANKS_PER_NODE": str(per_node)} if per_node else None
    with (
        workshop.run(job) as one,
        workshop.run(job, ranks=ranks, output="b.vtkhdf", environment=nodes) as other,
    ):
        assert one["history/broken"][-1] > least
        assert assert_same_results(one, other) > 40
        assert other["provenance"].attrs["ranks"] == ranks


def test_an_invalid_number_of_ranks_on_a_node_is_refused(workshop):
    done = workshop.solve(SMALL, ranks=2, code=2, environment={"NETFALL_RANKS_PER_NODE": "two"})
    assert "NETFALL_RANKS_PER_NODE" in done.stderr
    assert '"two"' in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("ranks", [3, pytest.param(5, marks=pytest.mark.long)])
def test_more_ranks_than_free_particles(workshop, ranks):
    """A cable and a small net with fracture, on up to five ranks with one particle or none."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,-10,0,10000,-98100\n"
    cable = STEEL.replace("prestress = 100e3\n", "yield_stress = 1e12\nfracture_strain = 1e-3\n")
    cable += "[dynamics]\nduration = 0.1\n[output]\nframes = 5\n"
    job = workshop.job(cable, nodes, "start,end\n1,2\n", name="cable")
    one, many = workshop.run(job, output="a.vtkhdf"), workshop.run(job, ranks=ranks, output="b.vtkhdf")
    assert len(one["events/step"]) == 1
    assert_same_results(one, many)


SMALL = '[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 6\n' + STEEL
SMALL += "[form_finding]\nmodulus_factor = 0\n[dynamics]\nduration = 0.02\n"


def test_partition_by_hand_is_used_and_changes_no_bit(workshop):
    job = workshop.job(SMALL)
    assert "edge cut" in run_on_standing_ranks("partition", job, "-n", 3, cwd=workshop.folder).stdout
    graph = (workshop.folder / "partitions" / "job.graph").read_text().split("\n")
    assert graph[0].split() == ["45", "60", "011"]
    first = workshop.run(job, ranks=3, output="a.vtkhdf")
    path = workshop.folder / "partitions" / "job.graph.part.3"
    path.write_text("".join(f"{0 if k < 40 else 2}\n" for k in range(45)))  # rank 1 owns nothing
    second = workshop.run(job, ranks=3, output="b.vtkhdf")
    assert second["provenance"].attrs["partition"] == "partitions/job.graph.part.3"
    assert_same_results(first, second)


def test_a_partition_has_at_most_one_part_per_particle(workshop):
    job = workshop.job(SMALL)
    done = run_on_standing_ranks("partition", job, "-n", 46, cwd=workshop.folder, code=2)
    assert done.stderr == "error: -n 46: expected at most as many parts as particles, 45 [E032]\n"
    assert not (workshop.folder / "partitions").exists()


@pytest.mark.parametrize(
    "damage, message",
    [
        (
            lambda folder: (folder / "job.graph").write_text("3 2 010\n1 2\n2 1 3\n1 2\n"),
            "belongs to another net",
        ),
        (lambda folder: (folder / "job.graph").unlink(), "cannot be read"),
        (lambda folder: (folder / "job.graph.part.2").write_text("0\n1\n"), "damaged"),
        (lambda folder: (folder / "job.graph.part.2").write_text("7\n" * 45), "damaged"),
        (lambda folder: (folder / "job.graph.part.2").write_bytes(b"\x00\xff" * 45), "cannot be read"),
    ],
)
def test_foreign_or_damaged_partition_is_refused(workshop, damage, message):
    job = workshop.job(SMALL)
    run_on_standing_ranks("partition", job, "-n", 2, cwd=workshop.folder)
    damage(workshop.folder / "partitions")
    done = workshop.run(job, ranks=2, code=2)
    assert message in done.stderr and "netfall partition" in done.stderr


@pytest.mark.parametrize("name", ["saddle", "stadium", "olympia", "wheel"])
def test_shipped_partitions_belong_to_the_shipped_jobs(name):
    from netfall.geometry.build import build_net
    from netfall.job.read import read_job

    net = build_net(read_job(ROOT / "jobs" / f"{name}.toml"))
    for parts in (2, 3, 4):
        part = read_partition(name, net.n, net.elements, parts, ROOT / "partitions")
        assert part is not None and set(part) == set(range(parts))


def test_partition_files_have_the_format_of_metis(tmp_path):
    """Neighbours from 1 with symmetric weights of edges, counted once; a line of parts for each vertex."""
    net = generators.saddle(Saddle(side=40.0, rise=2.0, cells=5))
    write_partition(tmp_path, "x", net.elements, metis_partition(net.n, net.elements, 2), 2)
    lines = [line.split() for line in (tmp_path / "x.graph").read_text().splitlines()]
    rows = [[int(word) for word in line[1::2]] for line in lines[1:]]
    assert all(
        int(weight) == (2 if abs(q - p) == 1 else 1)
        for p, line in enumerate(lines[1:], 1)
        for q, weight in zip(map(int, line[1::2]), line[2::2])
    )
    assert int(lines[0][1]) == net.m == sum(map(len, rows)) // 2
    assert all(p + 1 in rows[q - 1] for p, row in enumerate(rows) for q in row)
    assert len((tmp_path / "x.graph.part.2").read_text().split()) == net.n


ALONE = """
import os, sys
from netfall.parallel.alone import start_mpi
before = dict(os.environ)
start_mpi()
assert dict(os.environ) == before, "a process that is started here would find another environment"
if "mpi4py.MPI" in sys.modules:
    from mpi4py import MPI
    print(MPI.COMM_WORLD.size)
"""


@pytest.mark.parametrize("rank, output", [(None, "1\n"), ("0", "")])
def test_a_process_without_a_launcher_starts_mpi_by_itself(rank, output):
    """The process restores all settings. A process that a launcher started is left alone."""
    environment = {"PMI_RANK": rank} if rank else {}
    assert run_process(sys.executable, "-c", ALONE, environment=ENVIRONMENT | environment).stdout == output


OPENS_LATER = (
    ALONE
    + """
print("there", flush=True)
sys.stdin.readline()
MPI.File.Open(MPI.COMM_WORLD, sys.argv[1], MPI.MODE_CREATE | MPI.MODE_RDWR).Close()
"""
)


def test_the_end_of_one_process_does_not_affect_another(tmp_path):
    """Two of one user without a launcher: the second opens a file after the first has ended."""
    environment = ENVIRONMENT | {"TMPDIR": str(tmp_path)}
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    command = [sys.executable, "-c", OPENS_LATER, str(tmp_path / "file")]
    with subprocess.Popen(command, env=environment, text=True, **pipes) as second:
        assert [second.stdout.readline() for _ in range(2)] == ["1\n", "there\n"]
        subprocess.run([sys.executable, "-c", ALONE], env=environment, capture_output=True, check=True)
        _, error = second.communicate("go\n")
    assert (second.returncode, error) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
