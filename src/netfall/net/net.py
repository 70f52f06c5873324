"""The net: nodes and cables as they were given, before anything is computed. Plain arrays, in global order.

At the level of the net one speaks of nodes and cables; the solver's particles and elements are these same
rows, in the same order, after subdivision.
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from netfall.job.values import nearest, shown
from netfall.numerics.functions import lengths

GRAVITY = 9.81  # m/s2, for self weight and for the mass of the dead load
SAME_PLACE = 1e-3  # m, and at most
SAME_SHARE = 0.01  # of the usual length of an element: nodes no farther apart were meant as one


def _node(empty=None, inner=None):
    """A column of the nodes; empty : a row where none is given; inner : a row of a node from subdivision."""
    return field(default=None, metadata={"entity": "node", "empty": empty, "inner": inner})


def _element(divided: str = "each", empty=None, key: str = "", absent: float | None = None):
    """A column of the elements; divided : what a part of an element has: "each", "split" or "multiplied".

    key : of [cable] that it is filled from; absent : its value where the job has no such key
    """
    row = {"entity": "element", "empty": empty, "divided": divided, "key": key, "absent": absent}
    return field(default=None, metadata=row)


NOTHING, UNKNOWN = (0.0, 0.0, 0.0), (np.nan, np.nan, np.nan)


@dataclass
class Net:
    """Particles and elements of a net with their sections.

    The table of columns: what is not given is filled in, subdivision continues it, and the digest of a run
    covers it, all from its row here.

    x : (n, 3) [m] start geometry; fixed : (n, 3) bool, per axis
    load : (n, 3) [N]; mass : (n,) [kg] carried; area : (n,) [m2] of surface, tributary, nan: from the faces
    normal : (n, 3) upward unit normal of the surface, nan: from the faces
    spring : (n, 3) [N/m] of an elastic support, 0: none; spring_rest : (n, 3) [m], displacement at which it
        carries nothing, of a net without form finding
    angle : (n,) [degrees] about z, of the axes in which `fixed` and `spring` stand; None: x and y
    zone : (n,) row of zone_names that the table gives, -1: none; of a node in several one of them
    zone_share : (n, z) of each node's area in each of zone_names, where the table gives shares; None: whole
    elements : (m, 2) particle numbers; group : (m,) row of group_names
    section : (m,) [m2]; nominal : (m,) bool, no area was given, the section is that of steel
    modulus, yield_stress : (m,) [Pa], inf: elastic; density : (m,) [kg/m3]; expansion : (m,) [1/K]
    fracture_strain : (m,), inf: never breaks; breaking_load : (m,) [N], inf: none
    strength_deviation : (m,) scatter; strength : (m,) what was drawn, a factor on all of the above, in them
    length_deviation : (m,) [m] scatter of the length of its piece of cable; length_error : (m,) [m], drawn
    type : (m,) row of type_names, of the catalogue, -1: none; bar : (m,) bool, carries compression
    second_moment : (m,) [m4] of the area of bars, nan: none, None: of no element; for these as given
    buckling_length : (m,) [m], nan: that of the element of the table; buckling_curve : (m,) row of CURVES
    bending, buckling : (m,) bool, bars of chains that resist bending, that buckle; None: none does
    tier : (m,) ring of a generated net, from the middle, that the element of its group is in; else 0
    prestress : (m,) [N]; force_density : (m,) [N/m], nan: none; unstressed_length : (m,) [m], nan: none
    outline : (s, 2) segments of the rigid boundary in plan, which close faces but are no elements; numbers
        from n on are rows of `corners` (k, 3) [m], points of the boundary without a particle
    cable : (m,) row of cable_names, the piece of cable that the element is part of (`net.cables`)
    cable_given : name of the piece of each element of the table, "": none
    parts : elements for each one that was given; notes : what is odd in what was given
    """

    x: np.ndarray
    fixed: np.ndarray
    elements: np.ndarray
    group: np.ndarray
    group_names: list[str]
    node_id: np.ndarray = None
    element_id: np.ndarray = _element()
    load: np.ndarray = _node(NOTHING, NOTHING)
    mass: np.ndarray = _node(0.0, 0.0)
    area: np.ndarray = _node(np.nan)
    normal: np.ndarray = _node(UNKNOWN, UNKNOWN)
    spring: np.ndarray = _node(NOTHING, NOTHING)
    spring_rest: np.ndarray = _node(NOTHING, NOTHING)
    angle: np.ndarray | None = _node(inner=0.0)
    zone: np.ndarray = _node(-1)
    zone_share: np.ndarray = _node()
    zone_names: list[str] = field(default_factory=list)
    force_density: np.ndarray = _element("multiplied", np.nan)
    unstressed_length: np.ndarray = _element("split", np.nan)
    section: np.ndarray = _element()
    modulus: np.ndarray = _element()
    density: np.ndarray = _element()
    expansion: np.ndarray = _element(key="expansion")
    prestress: np.ndarray = _element(key="prestress")
    yield_stress: np.ndarray = _element(key="yield_stress", absent=np.inf)
    fracture_strain: np.ndarray = _element(key="fracture_strain", absent=np.inf)
    nominal: np.ndarray = _element()
    breaking_load: np.ndarray = _element()
    strength_deviation: np.ndarray = _element(key="strength_deviation")
    strength: np.ndarray = _element(empty=1.0)
    length_deviation: np.ndarray = _element(key="length_deviation")
    length_error: np.ndarray = _element(empty=0.0)
    type: np.ndarray = _element(empty=-1)
    type_names: list[str] = field(default_factory=list)
    bar: np.ndarray = _element()
    second_moment: np.ndarray | None = _element()
    buckling_length: np.ndarray | None = _element()
    buckling_curve: np.ndarray | None = _element()
    bending: np.ndarray | None = _element()
    buckling: np.ndarray | None = _element()
    tier: np.ndarray = _element(empty=0)
    cable: np.ndarray = None
    cable_names: list[str] = field(default_factory=list)
    cable_given: list[str] = field(default_factory=list)
    outline: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    corners: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    parts: int = 1
    notes: list[str] = field(default_factory=list)

    def __post_init__(self):
        if self.node_id is None:
            self.node_id = np.arange(self.n)
        if self.element_id is None:
            self.element_id = np.arange(self.m)
        for column in fields(self):
            empty = column.metadata.get("empty")
            if getattr(self, column.name) is None and empty is not None:
                rows = self.n if column.metadata["entity"] == "node" else self.m
                setattr(self, column.name, np.full((rows, *np.shape(empty)), empty))

    @property
    def held(self) -> np.ndarray:
        """(n, 3) bool, axes with a support of either kind, rigid or elastic."""
        return self.fixed | (self.spring > 0)

    @property
    def moves(self) -> np.ndarray:
        """(n,) bool, whether any axis can move."""
        return ~self.fixed.all(1)

    @property
    def valence(self) -> np.ndarray:
        """(n,) elements attached, that are there."""
        return np.bincount(self.elements[self.is_there].ravel(), minlength=self.n)

    @property
    def support(self) -> np.ndarray:
        """(n,) [N/m] of elastic supports, the stiffest axis."""
        return self.spring.max(1)

    @property
    def n(self) -> int:
        """Number of particles."""
        return len(self.x)

    @property
    def given(self) -> int:
        """Number of nodes that were given; the particles of subdivision follow."""
        return self.n - self.inner_particles().size

    @property
    def m(self) -> int:
        """Number of elements."""
        return len(self.elements)

    @property
    def tolerance(self) -> float:
        """Distance [m] below which places are the same."""
        return min(SAME_PLACE, SAME_SHARE * self.parts * float(np.median(self.lengths()))) if self.m else 0.0

    @property
    def is_there(self) -> np.ndarray:
        """(m,) bool, elements but those that a stage of erection took out, which have no density."""
        return self.density > 0.0

    @property
    def EA(self) -> np.ndarray:
        """(m,) [N], axial stiffness."""
        return self.modulus * self.section

    @property
    def yield_force(self) -> np.ndarray:
        """(m,) [N], axial force at yield; inf: elastic."""
        return self.yield_stress * self.section

    @property
    def own_weight(self) -> np.ndarray:
        """(m,) [N/m], weight of the elements themselves."""
        return GRAVITY * self.density * self.section

    def undivided(self) -> np.ndarray:
        """(m / parts, 2) particles between which the elements were given, before subdivision."""
        first, last = self.elements[:: self.parts], self.elements[self.parts - 1 :: self.parts]
        return np.column_stack([first[:, 0], last[:, 1]])

    def inner_particles(self) -> np.ndarray:
        """(m / parts, parts - 1) particles that subdivision put into each of these, from start to end."""
        return self.elements[:, 1].reshape(-1, self.parts)[:, :-1]

    def lengths(self) -> np.ndarray:
        """Lengths of the elements (m,) [m] in the start geometry."""
        return lengths(self.x[self.elements[:, 1]] - self.x[self.elements[:, 0]])


def pair_key(pairs: np.ndarray, count: int) -> np.ndarray:
    """One number for each pair (k, 2) of points 0 to count - 1, the same in either order."""
    return pairs.min(1) * count + pairs.max(1)


def nearest_group(net: Net, name: str) -> str:
    """Advice on a name that no group of the net has."""
    known = [group for group in net.group_names if group]
    return nearest(name, known) if known else "the net has no groups"


def elements_of_group(net: Net, name: str) -> tuple[np.ndarray, list[str]]:
    """The elements (k,) of a group, and what is wrong with its name."""
    rows = np.flatnonzero(np.isin(net.group, [g for g, group in enumerate(net.group_names) if group == name]))
    return rows, [] if len(rows) else [f"no such group of elements; {nearest_group(net, name)}"]


def elements_of_cables(net: Net, names: list[str]) -> tuple[np.ndarray, list[str]]:
    """The elements (k,) of pieces of cable, and what is wrong with their names."""
    unknown = sorted(set(names) - set(net.cable_names))
    numbers = [net.cable_names.index(name) for name in names if name not in unknown]
    wrong = [f"no cable {shown(name)}; {nearest(name, net.cable_names)}" for name in unknown]
    return np.flatnonzero(np.isin(net.cable, numbers)), wrong


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
    new = _evenly(net.x[net.elements], parts)
    k = len(new)
    held = np.repeat(net.fixed[net.elements].all((1, 2)), parts - 1)
    columns = {column.name: _continued(net, column, k, parts) for column in fields(net) if column.metadata}
    return replace(
        net,
        x=np.concatenate([net.x, new]),
        fixed=np.concatenate([net.fixed, np.repeat(held[:, None], 3, 1)]),
        parts=net.parts * parts,
        node_id=np.concatenate([net.node_id, net.node_id.max() + 1 + np.arange(k)]),
        elements=np.stack([chain[:, :-1], chain[:, 1:]], -1).reshape(-1, 2),
        group=np.repeat(net.group, parts),
        outline=np.where(net.outline >= n, net.outline + k, net.outline),
        **columns,
    )


def joined(net: Net) -> Net:
    """The net before `subdivide`, from its result; places in the middle of elements are forgotten."""
    if net.parts == 1:
        return net
    n = net.given
    columns, whole = {}, {"split": np.multiply, "multiplied": np.divide}
    for column in fields(net):
        values, row = getattr(net, column.name), column.metadata
        if row and values is not None:
            columns[column.name] = values[:n] if row["entity"] == "node" else values[:: net.parts]
            if row.get("divided") in whole:
                columns[column.name] = whole[row["divided"]](columns[column.name], net.parts)
    return replace(
        net,
        x=net.x[:n],
        fixed=net.fixed[:n],
        parts=1,
        node_id=net.node_id[:n],
        elements=net.undivided(),
        group=net.group[:: net.parts],
        outline=np.where(net.outline >= net.n, net.outline - (net.n - n), net.outline),
        cable=None if net.cable is None else net.cable[:: net.parts],
        **columns,
    )


def spaced(net: Net, x: np.ndarray) -> np.ndarray:
    """Places (n, 3) [m] of all particles where those that were given are at x; the others evenly between."""
    return np.concatenate([x, _evenly(x[net.undivided()], net.parts)])


def _evenly(ends: np.ndarray, parts: int) -> np.ndarray:
    """Places (m (parts - 1), 3) that part the ways between ends (m, 2, 3) evenly."""
    share = (np.arange(1, parts) / parts)[None, :, None]
    return ((1 - share) * ends[:, :1] + share * ends[:, 1:]).reshape(-1, 3)


def ends_of_inner(net: Net) -> np.ndarray:
    """Nodes (n, 2) at the ends of the element that `subdivide` put each particle into; of others itself."""
    ends = np.column_stack([np.arange(net.n)] * 2)
    if net.parts > 1:
        ends[net.inner_particles()] = net.undivided()[:, None]
    return ends


def with_inner(net: Net, moved: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Displacements (n, 3) of supports, and of the fixed particles that `subdivide` put between two of them.

    These stay evenly between their ends. fixed : (n, 3) bool
    """
    if net.parts == 1:
        return moved
    between = spaced(net, moved[: net.given])
    inner = (ends_of_inner(net)[:, 0] != np.arange(net.n)) & fixed.all(1)
    return np.where((inner & ~moved.any(1))[:, None], between, moved)


def _continued(net: Net, column, k: int, parts: int) -> np.ndarray | None:
    """A column of a net with k more nodes, whose elements are each in `parts`; as its row in `Net` says."""
    values, row = getattr(net, column.name), column.metadata
    if values is None:
        return None
    if row["entity"] == "node":
        inner = row["inner"]
        if column.name == "area":  # where all areas are given, what lies between has none
            inner = np.nan if np.isnan(values).any() else 0.0
        if column.name == "zone":  # what lies between is in a zone if both ends are
            start, end = values[net.elements].T
            inner = np.repeat(np.where(start == end, start, -1), parts - 1)
        if column.name == "zone_share":
            inner = np.repeat(values[net.elements].min(axis=1), parts - 1, axis=0)
        return np.concatenate([values, np.broadcast_to(inner, (k, *values.shape[1:]))])
    each = np.repeat(values, parts, axis=0)
    if row["divided"] == "each":
        return each
    return each / parts if row["divided"] == "split" else each * parts
