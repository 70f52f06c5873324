"""Generators give the paper's nets; faces, areas and normals are those of the plan."""

import numpy as np
import pytest
from conftest import STEEL
from nets import table

from netfall.geometry.areas import find_roof, tributary_areas
from netfall.geometry.build import build_net
from netfall.geometry.faces import find_faces
from netfall.geometry.generators import generate as generators
from netfall.geometry.net import subdivide
from netfall.geometry.shares import share_out_faces
from netfall.job.keys.net import Saddle, Stadium
from netfall.job.read import read_job


def test_stadium_has_the_papers_counts():
    """Paper 4.2: 544 particles, 102 of them fixed, 937 elements; the shortest element has 0.117 m."""
    net = generators.stadium(Stadium())
    assert (net.n, int(net.fixed.all(1).sum()), net.m) == (544, 102, 937)
    assert 0.11 < net.lengths().min() < 0.12


@pytest.mark.parametrize("spacing", [0.7, 1.0, 1.37, 2.2, 3.3, 5.1])
def test_stadium_supports_lie_on_arch_and_ellipse(spacing):
    net = generators.stadium(Stadium(spacing=spacing))
    held = net.fixed.all(1)
    x, y, z = net.x[held].T
    on_arch, on_edge = y == 0, np.abs((x / 44) ** 2 + (y / 33) ** 2 - 1) < 1e-3
    assert (on_arch | on_edge).all()
    assert np.allclose(z[on_arch], 10 * (1 - (x[on_arch] / 44) ** 2))
    assert np.allclose(z[on_edge & ~on_arch], 0)
    assert (np.bincount(net.elements.ravel(), minlength=net.n)[~held] == 4).all()


def test_saddle_boundary_is_the_hypar():
    """Supports on z = 3.66 (x/36.6)^2 - 3.66 (y/36.6)^2, free particles on z = 0."""
    net = generators.saddle(Saddle())
    held = net.fixed.all(1)
    x, y, z = net.x.T
    assert (net.n, int(held.sum()), net.m) == (77, 28, 112)
    assert np.allclose(z[held], (3.66 * (x / 36.6) ** 2 - 3.66 * (y / 36.6) ** 2)[held])
    assert (z[~held] == 0).all()


def test_tributary_areas_cover_the_roof():
    """Each inner particle has the area of a cell, which the slope changes a little. They sum to the roof."""
    net = generators.saddle(Saddle(side=80.0, rise=0.0))
    area = tributary_areas(net.x, net, find_faces(net))[1]
    assert np.allclose(area[~net.fixed.all(1)], 100.0)
    net = generators.saddle(Saddle(side=80.0, rise=4.0))
    area = tributary_areas(net.x, net, find_faces(net))[1]
    # the corners' quarters go straight to the rigid boundary
    assert np.isclose(area.sum(), 6400.0 - 4 * 25.0)
    fine = subdivide(net, 3)
    faces = find_faces(fine)
    fine_area = tributary_areas(fine.x, fine, faces)[1]
    assert np.isclose(
        share_out_faces(np.concatenate([fine.x, fine.corners]), faces).plan_areas().sum(), 6400.0
    )
    assert area.sum() < fine_area.sum() < 6400.0 and (fine_area[net.n :] > 0).all()


def test_stadium_area_is_half_an_ellipse():
    """The chords of the edge lose 0.2 % of pi a b / 2, with the shares of the corners."""
    net = generators.stadium(Stadium())
    assert abs(tributary_areas(net.x, net, find_faces(net))[1].sum() / (np.pi * 44 * 33 / 2) - 1) < 3e-3


def test_subdivision_keeps_lengths_masses_and_force_density():
    """k elements for one: k times the force density, a k-th of the length, the same tension."""
    net = generators.saddle(Saddle(side=80.0, rise=4.0, cells=4))
    net.force_density[:] = 7.0
    fine = subdivide(net, 4)
    assert fine.m == 4 * net.m and fine.n == net.n + 3 * net.m
    assert np.isclose(fine.lengths().sum(), net.lengths().sum())
    assert np.allclose(fine.force_density * fine.lengths(), np.repeat(net.force_density * net.lengths(), 4))


TABLE_SADDLE = STEEL + "[load]\nself_weight = false\ndead = 100.0\n"


def tables_of(net, closed):
    """Return nodes.csv and elements.csv of a net; `closed` adds elements between outline supports."""
    nodes = ((p + 10, *net.x[p], int(net.fixed[p, 0])) for p in range(net.n))
    outline = [pair for pair in net.outline if (pair < net.n).all()] if closed else []
    return table("id,x,y,z,fixed", nodes), table("start,end", np.array([*net.elements, *outline]) + 10)


def test_areas_of_tables_need_a_closed_outline(workshop):
    """Elements between supports close the faces. A message names an open outline."""
    net = generators.saddle(Saddle(side=80.0, rise=4.0, cells=4))
    job = read_job(workshop.job(TABLE_SADDLE, *tables_of(net, closed=True)))
    closed = build_net(job)
    roof = find_roof(job, closed)
    area = tributary_areas(closed.x, closed, roof.faces)[1]
    inner = ~net.fixed.all(1)
    assert roof.notes == [] and np.allclose(area[inner][4], 400.0)
    saddle = generators.saddle(Saddle(side=80.0, rise=4.0, cells=2))
    job = read_job(workshop.job(TABLE_SADDLE, *tables_of(saddle, closed=False)))
    with pytest.raises(Exception, match="no closed face"):
        find_roof(job, build_net(job))
