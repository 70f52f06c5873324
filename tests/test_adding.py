"""The pages on how to add something: the diffs of their examples apply to the code as it is."""

import shutil
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, STEEL

from netfall.geometry.build import build_net
from netfall.geometry.sections import given_cable_keys
from netfall.job.read import read_job
from netfall.model.model import initial_value
from netfall.physics.fields import FIELDS, Features

PAGES = sorted((ROOT / "tests" / "adding").glob("*.md"))
MOST_LINES = 30  # of a page


@pytest.mark.skipif(not shutil.which("git"), reason="needs git")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_diff_of_a_page_applies(page):
    """`git apply --check` accepts it; the page is short."""
    assert len(page.read_text().splitlines()) <= MOST_LINES
    diff = page.with_suffix(".diff").read_text()
    done = subprocess.run(
        ["git", "apply", "--check"], input=diff, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{done.stderr}: make the change anew, and store its diff"


def test_a_field_takes_its_values_from_a_key_of_cable(workshop):
    """The field exists if the job has the key, with the values of the groups, and 0 for others."""
    nodes = "id,x,y,z,fixed\n1,0,0,0,1\n2,1,0,0,0\n3,2,0,0,1\n"
    text = f"{STEEL}[group.soft]\nfracture_strain = 0.1\n"
    job = read_job(workshop.job(text, nodes, "start,end,group\n1,2,soft\n2,3,hard\n"))
    net = build_net(job)
    field = replace(FIELDS[-1], feature="cable.fracture_strain")
    assert Features(cable=given_cable_keys(job)).has(field) and not Features().has(field)
    values = initial_value(job, SimpleNamespace(net=net), field)
    assert np.array_equal(values, [0.1, 0.0])
