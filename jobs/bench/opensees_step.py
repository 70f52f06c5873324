"""The same net in OpenSees: corotational trusses with initial strain, explicit difference.

python opensees_step.py N
"""

import json
import resource
import sys
import time

import net
import numpy as np
import openseespy.opensees as ops

N = int(sys.argv[1])
begin = time.perf_counter()
whole = net.make_net(N)
m = len(whole.elements)
ops.model("basic", "-ndm", 3, "-ndf", 3)
for p, (x, y, z) in enumerate(whole.x.tolist(), 1):
    ops.node(p, x, y, z)
    ops.mass(p, net.MASS, net.MASS, net.MASS)
    if whole.fixed[p - 1]:
        ops.fix(p, 1, 1, 1)
L = np.linalg.norm(whole.x[whole.elements[:, 1]] - whole.x[whole.elements[:, 0]], axis=1)
for e, ((a, b), length, unstressed) in enumerate(
    zip(whole.elements.tolist(), L.tolist(), whole.L0.tolist()), 1
):
    # OpenSees refers strains to the length at the start: its modulus and initial strain follow from that
    ops.uniaxialMaterial("Elastic", 2 * e, net.EA * length / unstressed)
    ops.uniaxialMaterial("InitStrainMaterial", 2 * e + 1, 2 * e, (length - unstressed) / length)
    ops.element("corotTruss", e, a + 1, b + 1, 1.0, 2 * e + 1)
ops.timeSeries("Constant", 1)


def add_half_of_the_load(pattern: int) -> None:
    """In two halves: the first step is one of half a kick, but here takes a whole one."""
    ops.pattern("Plain", pattern, 1)
    for p in np.flatnonzero(~whole.fixed).tolist():
        ops.load(p + 1, 0.0, 0.0, -0.5 * net.LOAD)


add_half_of_the_load(1)
ops.constraints("Plain")
ops.numberer("Plain")
ops.system("Diagonal")
ops.algorithm("Linear", "-factorOnce")
ops.integrator("ExplicitDifference")
ops.analysis("Transient")
set_up = time.perf_counter() - begin
ops.analyze(1, net.DT)
add_half_of_the_load(2)
ops.analyze(net.CHECKED, net.DT)  # it reports a step late
z = ops.nodeDisp(whole.centre + 1, 3)
begin = time.perf_counter()
ops.analyze(3, net.DT)
steps = max(3, int(6.0 / (time.perf_counter() - begin)))
rates = []
for _ in range(3):
    begin = time.perf_counter()
    ops.analyze(steps, net.DT)
    rates.append(m * steps / (time.perf_counter() - begin))
json.dump(
    {
        "program": "OpenSees",
        "N": N,
        "elements": m,
        "ranks": 1,
        "scene": "elastic",
        "rate": max(rates),
        "median": sorted(rates)[1],
        "displacement": z,
        "set_up": set_up,
        "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
    },
    sys.stdout,
)
print()
