"""The net: nodes and cables as they were given, before anything is computed. Plain arrays, in global order.

At the level of the net one speaks of nodes and cables; the solver's particles and elements are these same
rows, in the same order, after subdivision.
"""

from dataclasses import dataclass, field, replace

import numpy as np

GRAVITY = 9.81  # m/s2, for self weight and for the mass of the dead load
SAME_PLACE = 1e-3  # m, and at most
SAME_SHARE = 0.01  # of the usual length of an element: nodes no farther apart were meant as one


@dataclass
class Net:
    """Particles and elements of a net with their sections.

    x : (n, 3) [m] start geometry; fixed : (n, 3) bool, per axis
    load : (n, 3) [N]; mass : (n,) [kg] carried; area : (n,) [m2] tributary, nan: from the faces
    normal : (n, 3) upward unit normal of the surface, nan: from the faces
    elements : (m, 2) particle numbers; group : (m,) row of group_names
    section : (m,) [m2]; modulus, yield_stress : (m,) [Pa], inf: elastic; density : (m,) [kg/m3]
    fracture_strain : (m,), inf: never breaks; bar : (m,) bool, carries compression
    prestress : (m,) [N]; force_density : (m,) [N/m], nan: none; unstressed_length : (m,) [m], nan: none
    outline : (s, 2) segments of the rigid boundary in plan, which close faces but are no elements; numbers
        from n on are rows of `corners` (k, 3) [m], points of the boundary without a particle
    parts : elements for each one that was given; notes : what is odd in what was given
    """

    x: np.ndarray
    fixed: np.ndarray
    elements: np.ndarray
    group: np.ndarray
    group_names: list[str]
    node_id: np.ndarray = None
    element_id: np.ndarray = None
    load: np.ndarray = None
    mass: np.ndarray = None
    area: np.ndarray = None
    normal: np.ndarray = None
    force_density: np.ndarray = None
    unstressed_length: np.ndarray = None
    section: np.ndarray = None
    modulus: np.ndarray = None
    density: np.ndarray = None
    prestress: np.ndarray = None
    yield_stress: np.ndarray = None
    fracture_strain: np.ndarray = None
    bar: np.ndarray = None
    outline: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    corners: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    parts: int = 1
    notes: list[str] = field(default_factory=list)

    def __post_init__(self):
        n, m = len(self.x), len(self.elements)
        empty = {
            "node_id": np.arange(n),
            "element_id": np.arange(m),
            "load": np.zeros((n, 3)),
            "mass": np.zeros(n),
            "area": np.full(n, np.nan),
            "normal": np.full((n, 3), np.nan),
            "force_density": np.full(m, np.nan),
            "unstressed_length": np.full(m, np.nan),
        }
        for name, value in empty.items():
            if getattr(self, name) is None:
                setattr(self, name, value)

    @property
    def n(self) -> int:
        """Number of particles."""
        return len(self.x)

    @property
    def m(self) -> int:
        """Number of elements."""
        return len(self.elements)

    @property
    def tolerance(self) -> float:
        """Distance [m] below which places are the same."""
        return min(SAME_PLACE, SAME_SHARE * self.parts * float(np.median(self.lengths()))) if self.m else 0.0

    def undivided(self) -> np.ndarray:
        """(m / parts, 2) particles between which the elements were given, before subdivision."""
        return np.column_stack(
            [self.elements[:: self.parts, 0], self.elements[self.parts - 1 :: self.parts, 1]]
        )

    def inner_particles(self) -> np.ndarray:
        """(m / parts, parts - 1) particles that subdivision put into each of these, from start to end."""
        return self.elements[:, 1].reshape(-1, self.parts)[:, :-1]

    def lengths(self) -> np.ndarray:
        """Lengths of the elements (m,) [m] in the start geometry."""
        return np.linalg.norm(self.x[self.elements[:, 1]] - self.x[self.elements[:, 0]], axis=1)


def pair_key(pairs: np.ndarray, count: int) -> np.ndarray:
    """One number for each pair (k, 2) of points 0 to count - 1, the same in either order."""
    return pairs.min(1) * count + pairs.max(1)


def subdivide(net: Net, parts: int) -> Net:
    """The net with each element in `parts` equal ones; new particles follow, without load.

    They are free, but fixed in an element between two fixed nodes: it closes a face or stays where it is, and
    its middle would sag or flap as no cable there does.
    """
    if parts == 1:
        return net
    n, m = net.n, net.m
    inner = n + np.arange(m * (parts - 1)).reshape(m, parts - 1)
    chain = np.column_stack([net.elements[:, :1], inner, net.elements[:, 1:]])
    share = (np.arange(1, parts) / parts)[None, :, None]
    start, end = net.x[net.elements[:, 0], None], net.x[net.elements[:, 1], None]
    new = ((1 - share) * start + share * end).reshape(-1, 3)
    k = len(new)
    held = np.repeat(net.fixed[net.elements].all((1, 2)), parts - 1)
    grow = lambda a, value: np.concatenate([a, np.full((k,) + a.shape[1:], value, a.dtype)])
    each = lambda a: np.repeat(a, parts, axis=0)
    per_element = (
        "group",
        "element_id",
        "force_density",
        "section",
        "modulus",
        "density",
        "prestress",
        "yield_stress",
        "fracture_strain",
        "bar",
    )
    return replace(
        net,
        x=np.concatenate([net.x, new]),
        fixed=np.concatenate([net.fixed, np.repeat(held[:, None], 3, 1)]),
        load=grow(net.load, 0.0),
        mass=grow(net.mass, 0.0),
        area=grow(net.area, np.nan if np.isnan(net.area).any() else 0.0),
        normal=grow(net.normal, np.nan),
        parts=net.parts * parts,
        node_id=np.concatenate([net.node_id, net.node_id.max() + 1 + np.arange(k)]),
        elements=np.stack([chain[:, :-1], chain[:, 1:]], -1).reshape(-1, 2),
        unstressed_length=each(net.unstressed_length) / parts,
        outline=np.where(net.outline >= n, net.outline + k, net.outline),
        **{name: each(getattr(net, name)) for name in per_element if getattr(net, name) is not None}
        | {"force_density": each(net.force_density) * parts},
    )
