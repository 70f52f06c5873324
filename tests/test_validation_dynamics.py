"""Dynamics against closed forms."""

import numpy as np
from conftest import STEEL

THEME = "Dynamics"
EXACT = "central difference is exact for a constant force; rounding of some hundred steps"


def test_free_fall(both_ways, compare):
    """A slack cable's two particles fall by g t^2 / 2."""
    job = both_ways.job(STEEL.replace("prestress = 100e3\n", "") + "[load]\nself_weight = true\n[dynamics]\nduration = 1.0\n", "id,x,y,z\n1,0,0,0\n2,1,0,0\n", "start,end\n1,2\n")
    f = both_ways.run(job, ranks=2)
    compare(THEME, "free fall for 1 s: way", "g t^2 / 2", -f["final/position"][0, 2], 0.5 * 9.81, 1e-12, EXACT, "m")
