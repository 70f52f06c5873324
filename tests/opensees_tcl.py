"""Run a model that `netfall export` wrote as Tcl, by a Python that has openseespy:

    python opensees_tcl.py MODEL.tcl ANSWER.npz

openseespy has the commands of OpenSees, but no Tcl. Each line of the model, up to its results, is one command
whose words become arguments. The answer: element, tension [N]; node, displacement [m].
"""

import sys

import numpy as np
import openseespy.opensees as ops


def number(word: str):
    """Return a word of Tcl as openseespy needs it."""
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            pass
    return word


model, answer = sys.argv[1:]
elements = []  # the trusses
for line in open(model).read().split("# --- the equilibrium")[0].splitlines():
    words = line.split("#")[0].split()
    if words and words[0] != "}":
        elements += [int(words[2])] if words[:2] == ["element", "corotTruss"] else []
        getattr(ops, words[0])(*[number(word) for word in words[1:] if word != "{"])
assert ops.analyze(10) == 0
nodes = ops.getNodeTags()
np.savez(
    answer,
    element=elements,
    tension=[ops.basicForce(e)[0] for e in elements],
    node=nodes,
    displacement=[ops.nodeDisp(p) for p in nodes],
)
