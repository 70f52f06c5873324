"""Checks of bars to EN 1993-1-1: buckling; axial force and bending, moments by plane, governing points.

Buckling, 6.3.1:

lambda = sqrt(N_y / N_cr)                         N_cr = pi^2 E I / L_k^2
phi = (1 + alpha (lambda - 0.2) + lambda^2) / 2
chi = 1 / (phi + sqrt(phi^2 - lambda^2)), at most 1

Axial force and bending:

section    N / (A f) + M / (W f) <= 1          6.2.1(7)
member     N / (chi A f) + k M / (W f) <= 1    6.3.3(4), k = 1

f is the smaller of `design_strength` and the yield stress. M is the magnitude of the moment, as for a section
with equal W in all directions. chi is that of 6.3.1 with the yield force, which no partial factor reduces, or
with A f if there is no yield stress. It includes the bow imperfection of the member, 5.3.2(3).

k = 1 because 5.2.2(7) requires second-order effects once, and statics includes them: moments are those of the
deformed chain. For a given N the moments of loads and of an imperfection e0 add, and N / (chi A f) is at
least N / (A f) + N e0 / (1 - N / N_cr) / (W f), which is convex in N and reaches 1 at N = chi A f. The sum is
therefore conservative. A bar outside bending chains has no moment; only chi accounts for its imperfection.
"""

from typing import NamedTuple

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.geometry.bars import resembles_concrete
from netfall.geometry.cables import meeting_pairs
from netfall.job.keys.groups import group_values
from netfall.job.keys.models import Cable
from netfall.job.validate import Validator
from netfall.job.values import counted
from netfall.post import messages
from netfall.results import states
from netfall.results.file import read_job_tables
from netfall.results.states import Envelope, StateView, element_property, form_position

NEGLIGIBLE = 1e-6  # compression over Euler load or largest force [-]; smaller compressions are rounding
NEGLIGIBLE_MOMENT = 1e-9  # share of the largest moment; smaller moments in a plane are rounding
IMPERFECTION = {"a0": 0.13, "a": 0.21, "b": 0.34, "c": 0.49, "d": 0.76}  # alpha [-]; EN 1993-1-1, table 6.1


def slenderness(yield_force: np.ndarray, euler_load: np.ndarray) -> np.ndarray:
    """Compute the relative slenderness (m,) of bars from their yield force and Euler load (m,) [N]."""
    return np.sqrt(yield_force / euler_load)


def buckling_reduction(slender: np.ndarray, imperfection: np.ndarray) -> np.ndarray:
    """Compute the reduction factor chi (m,) of bars from their relative slenderness (m,).

    imperfection : (m,) imperfection factors alpha of the buckling curves
    """
    phi = 0.5 * (1.0 + imperfection * (slender - 0.2) + slender**2)
    return np.minimum(1.0, 1.0 / (phi + np.sqrt(np.maximum(phi**2 - slender**2, 0.0))))


def bar_columns(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the buckling length, Euler load, slenderness and chi (m,) of the elements.

    nan : the element is not a bar with a second moment of area; {} : no element is. Without a yield force
    only the Euler load is known.
    """
    if "second_moment" not in f["net"]:
        return {}
    N_cr = f["net/euler_load"][:]
    N_y = element_property(f, "yield_force", np.inf)
    slender = np.where(np.isfinite(N_y), slenderness(N_y, N_cr), np.nan)
    return {
        "buckling_length": np.where(np.isnan(N_cr), np.nan, f["net/buckling_length"][:]),
        "euler_load": N_cr,
        "slenderness": slender,
        "chi": buckling_reduction(slender, imperfections(f)),
    }


def imperfections(f: h5py.File) -> np.ndarray:
    """Return the imperfection factor alpha (m,) of the buckling curve of each element."""
    curves = f["net/buckling_curve_names"].asstr()[:]
    return np.array([IMPERFECTION[name] for name in curves])[f["net/buckling_curve"][:]]


def bar_strengths(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the compressive strengths (m,) [N] of bars, inf: none, for `Check.resistance`.

    Elements of a bending chain have no strength unless the job gives a buckling_length. The chain buckles as
    a whole, not between its nodes, and statics computes that.
    """
    bars, none = bar_columns(f), np.full(len(f["net/elements"]), np.inf)
    if not bars:
        return {"buckling": none, "euler_load": none}
    N_y = element_property(f, "yield_force", np.inf)
    strengths = {"buckling": bars["chi"] * N_y, "euler_load": bars["euler_load"]}
    is_unknown = is_bending(f) & np.isnan(cable_keys(f, "buckling_length")[0])
    return {name: np.where(np.isnan(N) | is_unknown, np.inf, N) for name, N in strengths.items()}


# sine of the slope above which the planes of bending are along x and y: within 8 degrees of upright
MIN_UPRIGHT_SINE = 0.99
MIN_SIDE_OFFSET = 1e-6  # share of the net's size; a smaller offset from the middle of a group does not count


def recorded(f: h5py.File, name: str) -> np.ndarray:
    """Return a property (m,) of the elements from the tables of the net."""
    return np.broadcast_to(f[f"provenance/net/{name}"][:], len(f["net/elements"]))


def is_concrete(f: h5py.File) -> np.ndarray:
    """Select the bars (m,) of concrete, by modulus and density, except bars with a section_modulus."""
    fits = resembles_concrete(recorded(f, "modulus"), recorded(f, "density"))
    return (f["net/bar"][:] == 1) & fits & np.isnan(cable_keys(f, "section_modulus")[0])


def cable_keys(f: h5py.File, *keys: str) -> list[np.ndarray]:
    """Return keys of [cable] in SI units (m,), as given for the elements; nan: not given."""
    job, names = read_job_tables(f), f["net/group_names"].asstr()[:]
    cable, groups, reader = job.get("cable", {}), job.get("group", {}), Validator("", [])
    tables = [reader.table("", Cable, cable | group_values(groups, name)) for name in names]
    return [np.array([getattr(table, key) for table in tables], float)[f["net/group"][:]] for key in keys]


def is_bending(f: h5py.File) -> np.ndarray:
    """Select the bars (m,) of bending chains."""
    return element_property(f, "bending", 0) == 1


def bending_strengths(f: h5py.File) -> dict[str, np.ndarray]:
    """Return `section`, A f [N], `member`, chi A f [N], and `moment`, W f [N m], (m,) of bars; inf: none.

    Only bars with a section_modulus have them. A bending chain has `member` only if the job gives its
    buckling_length.
    """
    A, (W, strength) = recorded(f, "section"), cable_keys(f, "section_modulus", "design_strength")
    none = np.full(len(A), np.inf)
    has_none = np.isnan(W) | (f["net/bar"][:] == 0)
    if has_none.all():
        return dict.fromkeys(("section", "member", "moment"), none)
    N_y = element_property(f, "yield_force", np.inf)
    N = np.where(has_none, np.inf, np.fmin(A * strength, N_y))
    N_cr = bar_strengths(f)["euler_load"]
    has_length, plastic = np.isfinite(N) & np.isfinite(N_cr), np.where(np.isfinite(N_y), N_y, N)
    chi = buckling_reduction(slenderness(*np.where(has_length, (plastic, N_cr), 1.0)), imperfections(f))
    return {
        "section": N,
        "member": np.where(has_length, chi * N, np.inf),
        "moment": np.where(has_none, np.inf, W * N / A),
    }


def moment_columns(envelope: Envelope) -> dict[str, np.ndarray]:
    """Return the largest bending moment [N m] of each element (m,) and the state in which it occurs.

    An element without a moment has nan. The table is empty without bending.
    """
    largest, of = states.largest_over_stages(envelope.moment)
    if np.isnan(largest).all():
        return {}
    names = np.where(np.isnan(largest), "", np.array(envelope.names, object)[of])
    return {"bending_moment_max": largest, "case_moment": names}


# --- moments by plane


def joint_ends(f: h5py.File, moment: np.ndarray) -> np.ndarray:
    """Find the pairs (k, 2) of element ends with a joint; the ends of element e are 2 e and 2 e + 1.

    moment : (m, 2) [N m] in one state, positive at joints with a moment; nan, 0: no joint

    The rule is that of `geometry.cables.find_bending_chains`: two bars of one cable, otherwise two of one
    group.
    """
    ends, node = np.flatnonzero(np.nan_to_num(moment).ravel() > 0.0), f["net/elements"][:].ravel()
    of_cable = meeting_pairs(ends, node, f["net/cable"][:])
    others = ends[~np.isin(ends, of_cable)]
    return np.concatenate([of_cable, meeting_pairs(others, node, f["net/group"][:])])


class JointMoments(NamedTuple):
    """Moments of the k joints of bending chains in one state: two bars meet at each joint.

    size : (m, 2) [N m] at both ends of each element, nan: it does not bend
    ends : (k, 2), as `joint_ends` returns them
    along : unit vectors (k, 3) along both bars; moments : vectors (k, 3) [N m] at the end of each of them
    """

    size: np.ndarray
    ends: np.ndarray
    along: tuple[np.ndarray, np.ndarray]
    moments: tuple[np.ndarray, np.ndarray]


def joint_moments(f: h5py.File, state: StateView) -> JointMoments:
    """Return the moments of all joints in a state, with directions, from magnitudes and positions."""
    size = state.read("bending_moment")
    if size is None:  # the form has no moments
        size = np.where(is_bending(f), 0.0, np.nan)[:, None] * [1.0, 1.0]
    form, x = form_position(f), state.position()
    pairs, node = joint_ends(f, size), f["net/elements"][:].ravel()
    h, i, j = node[pairs[:, 0] ^ 1], node[pairs[:, 0]], node[pairs[:, 1] ^ 1]
    a, b, a0, b0 = (unit(y[q] - y[p]) for y in (x, form) for p, q in ((h, i), (i, j)))
    w = np.cross(a0, b0)  # of the rotation without moment: its axis times the sine of its angle
    share = 1.0 / (1.0 + dot(a0, b0))
    axis = np.cross(a + np.cross(w, a) + share * np.cross(w, np.cross(w, a)), b)
    moment = size.ravel()[pairs[:, :1]] * unit(axis)
    back = moment - np.cross(w, moment) + share * np.cross(w, np.cross(w, moment))
    return JointMoments(size, pairs, (a, b), (back, moment))


def bending_forces(f: h5py.File, state: StateView) -> np.ndarray:
    """Compute the forces (points, 3) [N] of bending chains on the points of a state, as `physics.bending`."""
    x, joints, node = state.position(), joint_moments(f, state), f["net/elements"][:].ravel()
    force = np.zeros_like(x)
    for end, along, moment in zip(joints.ends.T, joints.along, joints.moments):
        outer, inner = node[end ^ 1], node[end]
        shear = np.cross(along, moment) / lengths(x[outer] - x[inner])[:, None]
        np.add.at(force, outer, shear)
        np.subtract.at(force, inner, shear)
    return force


def plane_moments(f: h5py.File, state: StateView) -> np.ndarray:
    """Return the bending moments (m, 2, 2) [N m] at both ends of each element by plane, with sign.

    nan : the element does not bend. The first plane is vertical and contains the element; the second is
    normal to it and contains the element. A moment is positive if it causes tension at the lower side, or in
    the second plane at the side away from the middle of the element's group. The sum of the squares of both
    is the square of the magnitude.
    """
    size, ends, along, moments = joint_moments(f, state)
    parts = np.repeat(np.where(np.isnan(size), np.nan, 0.0)[..., None], 2, axis=2).reshape(-1, 2)
    for end, direction, vector in zip(ends.T, along, moments):
        for plane, side in enumerate(sides(f, end // 2, direction)):
            parts[end, plane] = dot(vector, np.cross(side, direction))[:, 0]
    return parts.reshape(*size.shape, 2)


def sides(f: h5py.File, elements: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two sides, unit vectors (k, 3), at which a positive moment causes tension.

    elements : (k,) rows; along : (k, 3) unit vectors along them

    The first is the lower side, the second the outer side in plan: away from the middle of the group or, if
    that is on the line of the element, towards y. For an upright element they are x and y.
    """
    form, ends, group = form_position(f), f["net/elements"][:], f["net/group"][:]
    middle, count = form[ends].mean(1), np.bincount(group)
    centre = np.column_stack([np.bincount(group, values) for values in middle.T]) / count[:, None]
    tie = MIN_SIDE_OFFSET * np.ptp(form, axis=0).max() * np.array([1.0, 2.0, 0.0])
    outward = (middle - centre[group])[elements] + tie
    chord = unit(form[ends[elements, 1]] - form[ends[elements, 0]])
    upright = np.abs(chord[:, 2:]) > MIN_UPRIGHT_SINE
    lower = np.where(upright, [1.0, 0.0, 0.0], [0.0, 0.0, -1.0])
    first = unit(lower - dot(lower, along) * along)
    outer = np.cross(lower, chord)  # in the form, so that the side does not rotate with the load
    outer *= np.sign(dot(outer, np.where(upright, [0.0, 1.0, 0.0], outward)))
    second = np.cross(first, along)
    return first, second * np.sign(dot(second, outer))


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar products (k, 1) of vectors (k, 3)."""
    return (a * b).sum(1, keepdims=True)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Divide vectors (k, 3) by their lengths; a vector without length stays zero."""
    return vectors / np.maximum(lengths(vectors), np.finfo(float).tiny)[:, None]


def unchecked_bending(f: h5py.File, envelope: Envelope, unchecked: np.ndarray) -> list[str]:
    """Return a warning for each group with moments that no check includes; concrete has a table instead.

    unchecked : (m,) bool, see `ElementCheck`
    """
    warnings, names = [], f["net/group_names"].asstr()[:]
    group, rows = f["net/group"][:], unchecked & ~is_concrete(f)
    for g in np.unique(group[rows]):
        of_group = rows & (group == g)
        elements = counted("element", f["net/element_id"][:][of_group])
        largest = float(np.nanmax(envelope.moment[:, of_group])) / 1e3
        warnings.append(messages.UNCHECKED_BENDING(group=names[g], elements=elements, moment=largest))
    return warnings


def euler_alone_warnings(f: h5py.File, envelope: Envelope) -> list[str]:
    """Return a warning if compressed bars have an Euler load, but no yield force or strength for chi."""
    strengths = bar_strengths(f) | bending_strengths(f)
    euler_load = strengths["euler_load"]
    missing = np.isfinite(euler_load) & (envelope.least < -NEGLIGIBLE * euler_load) & ~is_concrete(f)
    missing &= np.isinf(strengths["buckling"]) & np.isinf(strengths["member"])
    elements = f["net/element_id"][:][missing]
    return [messages.NO_YIELD_STRESS(elements=counted("element", elements))] * bool(len(elements))


def moment_table(f: h5py.File) -> dict[str, np.ndarray]:
    """Return forces and moments of bars with bending or of concrete, a row for each end and equilibrium."""
    node, blocks = f["net/node_id"][:][f["net/elements"][:]], []
    rows = np.flatnonzero(is_concrete(f) | is_bending(f))
    group = f["net/group_names"].asstr()[:].astype(object)[f["net/group"][:]]
    for state in states.equilibria(f):
        parts = plane_moments(f, state)[rows].reshape(-1, 2)
        blocks.append(
            {
                "element": np.repeat(f["net/element_id"][:][rows], 2),
                "group": np.repeat(group[rows], 2),
                "node": node[rows].ravel(),
                "case": np.full(2 * len(rows), state.name, object),
                "N": np.repeat(state.tension()[rows], 2),
                "moment": np.hypot(*parts.T),
                "moment_vertical": parts[:, 0],
                "moment_plan": parts[:, 1],
            }
        )
    table = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    trace = NEGLIGIBLE_MOMENT * np.nanmax(table["moment"], initial=0.0)
    for name in ("moment_vertical", "moment_plan"):
        table[name][np.abs(table[name]) < trace] = 0.0
    return table
