"""Samples of a study that fail before their whole load acts count as failed."""

import pytest
from mpi4py import MPI

from netfall.core.errors import InputError
from netfall.driver.sample import run_sample
from netfall.job.cache import ResultCache
from netfall.job.read import read_job
from netfall.study.file import read_study_plan
from netfall.study.study import _first_net

# Two cables of 5 m in line between supports, with 100 kN; EA / (2 L) is 6.4 MN/m.
LINE = """[cable]
modulus = 160e9
area = 400e-6
density = 8000.0
prestress = 100e3
{strength}
[form_finding]
method = "given_geometry"
[load]
self_weight = false
{more}
"""
# A weight of 10 kN on two cables with a prestress of 1 kN; the dynamic stage begins after a load step.
WEIGHT = "steps = 1\n[dynamics]\nduration = 1e-3"
SHORTER = '[[stage]]\nname = "pull"\nlengths = {A = {change = -0.01}}'  # 64 kN more in both cables


def weak_job(workshop, strength, more="steps = 1", load=0.0):
    """Return the job of LINE, with a load [N] along the line at the middle node."""
    nodes = f"id,x,y,z,fixed,load_x\n1,0,0,0,1,0\n2,5,0,0,0,{load}\n3,10,0,0,1,0\n"
    text = LINE.format(strength=strength, more=more)
    return workshop.job(text, nodes, "start,end,cable\n1,2,A\n2,3,B\n", name="line")


@pytest.mark.parametrize(
    "strength, more, load, code",
    [
        ("breaking_load = 110e3\nstrength_cov = 0.1\nstrength_seed = 7", "steps = 1", 0.0, "E243"),
        ("yield_stress = 275e6\nstrength_cov = 0.1\nstrength_seed = 7", "steps = 1", 0.0, "E223"),
        ("breaking_load = 110e3\nlength_std = 4e-3\nlength_seed = 3", "steps = 1", 0.0, "E435"),
        ("breaking_load = 110e3", SHORTER, 0.0, "Reduce the forces of the form, [[target]] and [[stage]]"),
        ("yield_stress = 275e6\nlength_std = 4e-3\nlength_seed = 8", "steps = 1", 0.0, "E615"),
        ("yield_stress = 400e6", SHORTER, 0.0, "E614"),
        ("breaking_load = 110e3", WEIGHT, 30e3, "E620"),
    ],
)
def test_a_sample_that_is_too_weak_has_failed(workshop, strength, more, load, code):
    """Strength, length, erection or load: such samples count in the failed share."""
    job = weak_job(workshop, strength, more, load)
    outcomes = run_sample(MPI.COMM_SELF, lambda: read_job(job), None, ResultCache())
    assert code in outcomes["reason"] and outcomes["state"] == "no_equilibrium"
    assert (outcomes["first_fracture"], outcomes["detached_area"]) == (0.0, 1.0)


def test_a_wrong_sample_has_not_failed_by_its_strength(workshop):
    """A compressed cable is an error of the job, not a failure by its strength."""
    job = weak_job(workshop, "breaking_load = 110e3")
    read = lambda: read_job(job, ["cable.prestress=-1.0"])
    assert run_sample(MPI.COMM_SELF, read, None, ResultCache())["state"] == "failed"


def test_a_study_may_begin_with_a_weak_sample(workshop):
    """Its net is that of the first valid sample. Without one the error is that of the net."""
    weak_job(workshop, "breaking_load = 110e3\nstrength_cov = 0.1")
    study = workshop.folder / "s.toml"
    study.write_text('job = "line.toml"\n[vary]\n"cable.strength_seed" = [7, 1]\n')
    job, net = _first_net(read_study_plan(study))
    assert job.cable.strength_seed == 1 and net.m == 2
    study.write_text('job = "line.toml"\n[vary]\n"cable.strength_seed" = [7, 2]\n')
    with pytest.raises(InputError, match="E243"):
        _first_net(read_study_plan(study))


def test_a_random_value_without_a_net_is_an_error_before_the_study(workshop):
    """A negative prestress is an error, because its samples would be missing in all shares."""
    weak_job(workshop, "breaking_load = 110e3")
    study = workshop.folder / "s.toml"
    drawn = '"cable.prestress" = {distribution = "normal", mean = 30e3, deviation = %s}'
    study.write_text('job = "line.toml"\n[sampling]\ncount = 64\n' + drawn % "30e3")
    with pytest.raises(InputError, match=r"s\.toml: cable\.prestress = -.*E222"):
        read_study_plan(study)
    study.write_text(study.read_text().replace("mean = 30e3", "mean = 150e3"))  # some exceed 110 kN
    assert len(read_study_plan(study)) == 64
