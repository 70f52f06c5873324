"""Fracture by splitting particles: who parts, what is kept, what follows."""

import numpy as np
import pytest
from conftest import STEEL

BRITTLE = STEEL.replace("prestress = 100e3\n", "fracture_strain = 1e-3\n")
EA, RHO_A = 1.95e11 * 683.08e-6, 7850.0 * 683.08e-6
DYNAMICS = "[dynamics]\nduration = {}\n[output]\nhistory = 0.001\nframes = {}\n"


def events(f):
    return [tuple(f[f"events/{name}"][k] for name in ("step", "element", "particle", "new_particle")) for k in range(len(f["events/step"]))]


def test_weight_on_a_cable_that_breaks_falls_freely(workshop):
    """The cable parts from the support (there the force is larger); weight and cable then fall together."""
    nodes = "id,x,y,z,fixed,mass,load_z\n1,0,0,0,1,0,0\n2,0,0,-10,0,10000,-98100\n"
    f = workshop.run(workshop.job(BRITTLE + DYNAMICS.format(0.5, 50), nodes, "start,end\n1,2\n"))
    (step, element, particle, new), = events(f)
    assert (element, particle, new) == (0, 0, 2)  # new number: n + 2 element + end
    assert 1e-3 < f["events/strain"][0] < 1.05e-3  # one step's growth above the fracture strain
    # after the fracture the centre of mass of weight and cable moves with the load's acceleration alone
    late = f["VTKHDF/Steps/Values"][:] > f["events/time"][0] + 0.01
    where = [(int(o), n) for o, n in zip(f["VTKHDF/Steps/PointOffsets"][:], f["VTKHDF/NumberOfPoints"][:][f["VTKHDF/Steps/PartOffsets"][:]])]
    half = 0.5 * RHO_A * 10
    centre = np.array([(10000 + half) * f["VTKHDF/Points"][o + 1, 2] + half * f["VTKHDF/Points"][o + 2, 2] for (o, n), l in zip(where, late) if l]) / (10000 + 2 * half)
    second = np.diff(centre, 2) / np.diff(f["VTKHDF/Steps/Values"][:][late])[0] ** 2
    assert np.allclose(second, -98100 / (10000 + 2 * half), rtol=1e-3)
    assert np.abs(f["history/identity_error"][:]).max() < 1e-12


@pytest.mark.parametrize("weakest", [0, 3, 7])
def test_chain_breaks_at_its_weakest_element(workshop, weakest):
    """A chain pulled at its end breaks where its area is least."""
    n = 8
    nodes = "id,x,y,z,fixed,load_x\n" + "".join(f"{k},{k},0,0,{int(k == 0)},{150000 if k == n else 0}\n" for k in range(n + 1))
    elements = "start,end,area\n" + "".join(f"{k},{k + 1},{4e-4 if k == weakest else 8e-4}\n" for k in range(n))
    f = workshop.run(workshop.job(BRITTLE.replace("1e-3", "2e-3") + DYNAMICS.format(0.05, 10), nodes, elements))
    assert events(f)[0][1] == weakest


def test_equal_forces_part_both_ends(workshop):
    """A symmetric chain pulled from both sides: its weak middle parts at both ends, momentum stays zero."""
    nodes = "id,x,y,z,mass,load_x\n1,0,0,0,500,-100000\n2,1,0,0,100,0\n3,2,0,0,100,0\n4,3,0,0,500,100000\n"
    elements = "start,end,area\n1,2,1e-3\n2,3,4e-4\n3,4,1e-3\n"
    f = workshop.run(workshop.job(BRITTLE + DYNAMICS.format(0.02, 10), nodes, elements))
    first, second = events(f)[:2]
    assert first[:3] == (second[0], 1, 1) and second[2] == 2
    assert {first[3], second[3]} == {4 + 2, 4 + 3}
    assert f["history/broken"][-1] == 1
    x, v = f["final/position"][:], f["final/velocity"][:]
    assert len(x) == 6 and np.allclose(v[:4, 0] + v[[3, 2, 1, 0], 0], 0, atol=1e-9)


def test_loose_end_only_counts_as_broken(workshop):
    """Two free masses on one element: nothing is left to split."""
    nodes = "id,x,y,z,mass,load_x\n1,0,0,0,500,-200000\n2,1,0,0,500,200000\n"
    f = workshop.run(workshop.job(BRITTLE + DYNAMICS.format(0.01, 5), nodes, "start,end\n1,2\n"))
    assert [e[3] for e in events(f)] == [-1, -1]
    assert f["history/broken"][-1] == 1 and len(f["final/position"]) == 2


PULLED = '[net]\ngenerator = "saddle"\nside = 40.0\ncells = 6\n' + STEEL + """yield_stress = 1.75e9
fracture_strain = 0.0404
[form_finding]
modulus_factor = 0
[load]
pressure = [0.0, 0.0, 12000.0]
[dynamics]
duration = {}
[output]
frames = 10
"""


def test_symmetric_net_breaks_symmetrically(workshop):
    """Under uniform load the first fractures of the saddle come in mirror images, in the same step."""
    f = workshop.run(workshop.job(PULLED.format(0.3)))
    x, elements = f["net/particles"][:], f["net/elements"][:]
    middle = 0.5 * (x[elements[:, 0]] + x[elements[:, 1]])
    step = f["events/step"][:]
    first = set(f["events/element"][:][step == step[0]].tolist())
    assert first
    for e in first:
        for mirror in ((-1, 1), (1, -1)):
            place = middle[e, :2] * mirror
            assert any(np.allclose(middle[o, :2], place, atol=1e-6) for o in first), (e, mirror)


def test_mass_and_energy_through_a_collapse(workshop):
    """Through many fractures the work identity holds to 1e-10 and the physical balance to 1e-3 of the external work."""
    f = workshop.run(workshop.job(PULLED.format(0.6)), "--set", "dynamics.safety=0.4")
    assert f["history/broken"][-1] > 10
    assert np.abs(f["history/identity_error"][:]).max() < 1e-10
    assert np.abs(f["history/balance_error"][:]).max() < 1e-3
    # each new particle is one that an event names, and the final numbering is complete
    new = f["events/new_particle"][:]
    n = len(f["net/particles"])
    assert sorted(f["final/particle_id"][:].tolist()) == sorted(list(range(n)) + [p for p in new if p >= 0])


def test_refused_step_names_the_fragments(workshop):
    """A step that only the intact net would stand is refused, with the element that sets the limit."""
    done = workshop.run(workshop.job(PULLED.format(0.3)), "--set", "dynamics.time_step=2e-3", code=2)
    assert "fragments that a fracture leaves" in done.stderr and "set by element" in done.stderr
