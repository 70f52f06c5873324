"""Wrong answers that look right: each is refused, or said, or the right one by hand calculation."""

import numpy as np
import pytest
from conftest import run_netfall

SECTION = "[cable]\nmodulus = 1.6e11\narea = 1e-4\ndensity = 7850.0\n"


def the_line(done) -> str:
    """The one line of a refusal."""
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.splitlines()
    return line


# --- form finding

CROSS = "id,x,y,z,fixed\n1,-2,0,0,1\n2,2,0,0,1\n3,0,-2,1,1\n4,0,2,1,1\n5,0.5,0.3,0,0\n"
TO_MIDDLE = "start,end,force_density\n1,5,3\n2,5,3\n3,5,1\n4,5,1\n"


def test_form_finding_by_particles_without_prestress_is_refused(workshop):
    """A table with force densities alone: what to give instead, with which the middle is at z = 2 / 8."""
    job = workshop.job(SECTION + "[form_finding]\n", CROSS, TO_MIDDLE)
    line = the_line(run_netfall("run", job))
    assert "no element that can move has a prestress" in line and 'or method = "force_density"' in line
    f = workshop.run(job, "--set", 'form_finding.method="force_density"')
    assert np.allclose(f["form_finding/position"][4], [0, 0, 0.25], atol=1e-15)


def test_a_prestress_between_supports_alone_finds_no_form(workshop):
    """What cannot move holds nothing."""
    elements = "start,end,prestress\n1,5,0\n2,5,0\n3,5,0\n4,5,0\n1,3,1000\n"
    job = workshop.job(SECTION + "[form_finding]\n", CROSS, elements)
    assert "no element that can move has a prestress, and" in the_line(run_netfall("check", job))


def test_a_collapsed_form_is_refused(workshop):
    """A triangle that hangs on one node shrinks into it; the shortest element is named with both lengths."""
    nodes = "id,x,y,z,fixed\n1,-2,0,0,1\n2,2,0,0,1\n3,0,1,0,0\n7,0,2,0,0\n8,0.5,2.5,0,0\n"
    elements = "id,start,end\n11,1,3\n12,2,3\n13,3,7\n14,7,8\n15,8,3\n"
    job = workshop.job(
        SECTION + 'prestress = 1e4\n[form_finding]\nmethod = "force_density"\n', nodes, elements
    )
    line = the_line(run_netfall("run", job))
    assert "the form has collapsed: element 1" in line and "m as given" in line
    assert not list(workshop.folder.glob("*.vtkhdf"))


def test_a_form_a_thousand_times_smaller_than_its_start_is_found(workshop):
    """Force densities place the free node whatever the start: in the middle of 2 mm, from 2 m away."""
    nodes = "id,x,y,z,fixed\n1,-0.001,0,0,1\n2,0.001,0,0,1\n3,0,2,0,0\n"
    job = workshop.job(
        SECTION + '[form_finding]\nmethod = "force_density"\n',
        nodes,
        "start,end,force_density\n1,3,5\n2,3,5\n",
    )
    assert np.allclose(workshop.run(job)["form_finding/position"][2], 0.0, atol=1e-15)


# --- tolerances

SPAN = "id,x,y,z,fixed,load_x,load_z\n1,-1,0,0,1,{0},0\n2,0,0,0,0,0,-1\n3,1,0,0,1,0,0\n4,-2,0,-1,1,0,0\n"
THIN = "[cable]\nmodulus = 1.6e11\narea = 1e-6\ndensity = 7850.0\n"


@pytest.mark.parametrize("on_support, backstay", [(0, 0), (1e9, 0), (0, 1e9)])
def test_what_supports_take_does_not_loosen_statics(both_ways, on_support, backstay):
    """1 N on the middle of a span of 2 m under 1000 N sags by 1 / (2 * 1000) m, whatever acts on supports.

    Stretch adds EA w^2 / 2 = 0.02 N to the tension: 2e-5 of the sag.
    """
    elements = f"start,end,prestress,area\n1,2,1000,\n2,3,1000,\n1,4,{backstay},1\n"
    job = both_ways.job(THIN + "[load]\nsteps = 1\ntolerance = 1e-9\n", SPAN.format(on_support), elements)
    sag = both_ways.run(job, ranks=2)["statics/displacement"][-1, 1, 2]
    assert np.isclose(sag, -5e-4, rtol=5e-5)


def test_a_backstay_does_not_loosen_form_finding(both_ways):
    """The middle of a span starts 0.5 m above it and ends on it: tolerance 1e-6 of the span's 1000 N."""
    nodes = SPAN.format(0).replace("2,0,0,0,0", "2,0.3,0,0.5,0")
    elements = "start,end,prestress,area\n1,2,1000,\n2,3,1000,\n1,4,1e9,1\n"
    job = both_ways.job(THIN + "[form_finding]\n", nodes, elements)
    f = both_ways.run(job, ranks=2)
    assert abs(f["form_finding/position"][1, 2]) < 1e-6 and f["form_finding/residual"][()] <= 1e-6
