"""The element law compared with the paper's Fig. 3 by hand; energy of both strain measures."""

import itertools
import math

import numpy as np
import pytest
from test_python import cross

import netfall
from netfall.core.kernels import kernel
from netfall.physics.fields import Elements
from netfall.physics.law.element import axial_force, stored_energy, strain, yield_energy
from netfall.physics.law.law import LawParameters, build_law
from netfall.results.warning_text import dynamic_limit_warnings_of

EA, YIELD = 1000.0, 10.0  # N; yield strain 0.01


def element(bar, euler) -> Elements:
    """Return a single element of 1 m that yields or buckles, without fields that the law does not read."""
    values = {"EA": EA, "yield_force": YIELD, "L0": 1.0} | ({} if euler is None else {"euler": euler})
    columns = {name: np.array([value]) for name, value in values.items()}
    return Elements.absent().with_values(bar=np.array([bar], np.uint8), **columns)


def law_with(logarithmic: bool) -> LawParameters:
    measure = "logarithmic" if logarithmic else "engineering"
    return build_law(measure, True, EA, YIELD, None, np.inf, None)


@kernel
def energy_at(elements, N, L, eps_p, law):
    return stored_energy(elements, 0, N, L, eps_p, law)


@kernel
def follow_lengths(lengths, elements, law, path):
    """Write force, plastic strain and dissipation at each length into path (n, 3)."""
    eps_p, heat = 0.0, 0.0
    for k in range(lengths.shape[0]):
        N, new = axial_force(elements, 0, strain(lengths[k], elements.L0[0], law), eps_p)
        if new != eps_p:
            heat += yield_energy(elements, 0, eps_p, new, law)
        eps_p = new
        path[k, 0], path[k, 1], path[k, 2] = N, eps_p, heat


def follow(lengths, bar=0, logarithmic=False, euler=None):
    """Return forces, plastic strains and dissipation along a path of lengths."""
    path = np.empty((len(lengths), 3))
    follow_lengths(np.array(lengths), element(bar, euler), law_with(logarithmic), path)
    return path.tolist()


def test_a_bar_buckles_before_it_yields():
    """The force is then constant, and equal on the way back; tension is unchanged."""
    path = follow([0.997, 0.98, 0.997, 1.02, 0.995], bar=1, euler=0.6 * YIELD)
    assert np.allclose([N for N, _, _ in path], [-3.0, -6.0, -3.0, 10.0, -6.0])
    assert np.allclose([p for _, p, _ in path], [0.0, 0.0, 0.0, 0.01, 0.01])


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize("bar, euler, last", [(0, None, 1.08), (1, None, 1.08), (1, 0.6 * YIELD, 0.99)])
def test_work_is_stored_or_dissipated(logarithmic, bar, euler, last):
    """The integral of N dL over yield, slack and buckling is stored energy plus heat, for both measures."""
    turning = [1.0, 1.05, 1.0, 1.06, 0.97, last]
    lengths = np.concatenate([np.linspace(a, b, 4001)[1:] for a, b in itertools.pairwise(turning)])
    path = follow(lengths, bar=bar, logarithmic=logarithmic, euler=euler)
    N = np.array([0.0] + [p[0] for p in path])
    work = np.sum(0.5 * (N[1:] + N[:-1]) * np.diff(np.concatenate([[1.0], lengths])))
    bar, law = element(bar, euler), law_with(logarithmic)
    held = energy_at(bar, N[-1], last, path[-1][1], law) + path[-1][2]
    assert math.isclose(work, held, rel_tol=2e-5)  # the kinks of the path, at 4000 points a branch


@pytest.mark.parametrize("measure", ["engineering", "logarithmic"])
def test_cables_without_yield_stress_dissipate_nothing(measure, tmp_path):
    """Two cables yield, two have no yield stress: only the former dissipate; the latter are named."""
    cable = cross()["cable"] | {"strain_measure": measure}
    job = cross(cable=cable, group={"hanging": {"yield_stress": 2.3e8}})
    with netfall.run(job, {"dynamics.safety": 0.02}, output=tmp_path / "r.vtkhdf", quiet=True) as result:
        heat = result.history["plastic_dissipation"]
        eps_p, L0 = result.file["final/plastic_strain"][:], result.elements["unstressed_length"]
        assert eps_p[0] > 1e-4 and eps_p[2] == 0.0
        assert heat[-1] == pytest.approx(
            2.3e8 * 500e-6 * (L0 * eps_p).sum(), rel=1e-12 if measure[0] == "e" else 1e-2
        )
        assert heat[0] == 0.0 and np.abs(result.history["energy_balance_error"]).max() < 1e-3
        (note,) = dynamic_limit_warnings_of(result.file)
        assert note.startswith("warning: dynamics: 2 elements (1, 2): yielded by the end. ")
