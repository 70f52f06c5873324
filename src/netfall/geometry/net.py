"""Net: nodes and cables as given, before any computation, in plain arrays in global order.

Nodes and cables of the net are the particles and elements of the solver: the same rows, in the same order,
after subdivision.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any, final

import numpy as np

from netfall.core.arrays import BoolArray, FloatArray, IntArray, is_one_of
from netfall.core.functions import along_axes, lengths
from netfall.geometry import messages
from netfall.job.values import format_value, suggest

GRAVITY = 9.81  # m/s2, for self weight and for the mass of the dead load
# m: largest distance of two nodes that are probably the same; the smaller limit applies
MAX_MERGE_DISTANCE = 1e-3
MAX_MERGE_SHARE = 0.01  # the same as a share of the median length of the elements
# perpendicular directions, of length at most 1, along which few points of a regular net are close together
SORTING_DIRECTIONS = (0.592, 0.731, 0.337), (0.785, -0.431, -0.443), (-0.178, 0.528, -0.829)


def _node(empty: Any = None, inner: Any = None) -> Any:
    """Declare a column of the nodes; empty : default of a row; inner : value of nodes from subdivision."""
    return field(default=None, metadata={"entity": "node", "empty": empty, "inner": inner})


def _element(divided: str = "each", empty: Any = None, key: str = "", absent: Any = None) -> Any:
    """Declare a column of the elements.

    divided : value of each part of a subdivided element: that of the element ("each"), or that value divided
    ("split") or multiplied ("multiplied") by the number of parts
    empty : default of a row; key : key of [cable] that fills the column
    absent : value if the job has no such key
    """
    row = {"entity": "element", "empty": empty, "divided": divided, "key": key, "absent": absent}
    return field(default=None, metadata=row)


NOTHING, UNKNOWN = (0.0, 0.0, 0.0), (np.nan, np.nan, np.nan)


@final
@dataclass
class Net:
    """Particles and elements of a net with their sections.

    This class is the table of columns. Each row gives the default of its column and its values after
    subdivision. The digest of a run covers every column.

    x : (n, 3) [m] start geometry; fixed : (n, 3) bool, per axis
    load : (n, 3) [N]; mass : (n,) [kg] carried; area : (n,) [m2] of surface, tributary, nan: from the faces
    normal : (n, 3) upward unit normal of the surface, nan: from the faces
    spring : (n, 3) [N/m] of an elastic support, 0: none; spring_rest : (n, 3) [m], displacement without
    spring force, of a net without form finding
    angle : (n,) [degrees] about z, of the axes of `fixed` and `spring`; None: x and y
    zone : (n,) row of zone_names that the table gives, -1: none; for a node in several zones, one of them
    zone_share : (n, z) share of each node's area in each of zone_names, if the table gives shares; None:
    whole nodes
    elements : (m, 2) particle numbers; group : (m,) row of group_names
    section : (m,) [m2]; nominal : (m,) bool, no area was given, and the section is that of steel
    modulus, yield_stress : (m,) [Pa], inf: elastic; density : (m,) [kg/m3]; expansion : (m,) [1/K]
    fracture_strain : (m,), inf: never breaks; breaking_load : (m,) [N], breaking force, inf: none
    strength_cov : (m,) coefficient of variation; strength : (m,) random factor, already applied above
    length_std : (m,) [m] standard deviation of the cable's length; length_error : (m,) [m], random draw
    type : (m,) row of type_names, of the catalogue, -1: none; bar : (m,) bool, carries compression
    second_moment : (m,) [m4] of the area of bars, nan: none, None: no element has one; the next two are then
    None
    buckling_length : (m,) [m], nan: length of the element of the table; buckling_curve : (m,) row of CURVES
    bending, buckling : (m,) bool, bars of bending chains, bars that buckle; None: none
    diameter : (m,) [m] on which wind and ice act, 0: none, None: no element has one; drag_coefficient : (m,)
    tier : (m,) number of the element's ring within its group, from the middle, in a generated net; otherwise
    0
    prestress : (m,) [N]; force_density : (m,) [N/m], nan: none; unstressed_length : (m,) [m], nan: none
    horizontal_force : (m,) [N] of the tension in the form, nan: not given; None: no element has one
    outline : (s, 2) segments of the rigid boundary in plan, which close faces but are not elements; numbers
    from n on are rows of `corners` (k, 3) [m], points of the boundary without a particle
    roof_axes : (3, 3) unit vectors of `[roof] normal`, as of `functions.surface_axes`; None: x, y, z
    cable : (m,) row of cable_names, the cable of the element (`geometry.cables`)
    cable_given : name of the cable of each element of the table, "": none
    parts : elements per given element; notes : messages on unusual input
    """

    x: FloatArray
    fixed: BoolArray
    elements: IntArray
    group: IntArray = field(metadata={"entity": "element", "divided": "each"})
    group_names: list[str]
    node_id: IntArray = None  # type: ignore[assignment] # then its own numbers
    element_id: IntArray = _element()
    load: FloatArray = _node(NOTHING, NOTHING)
    mass: FloatArray = _node(0.0, 0.0)
    area: FloatArray = _node(np.nan)
    normal: FloatArray = _node(UNKNOWN, UNKNOWN)
    spring: FloatArray = _node(NOTHING, NOTHING)
    spring_rest: FloatArray = _node(NOTHING, NOTHING)
    angle: FloatArray | None = _node(inner=0.0)
    zone: IntArray = _node(-1)
    zone_share: FloatArray = _node()
    zone_names: list[str] = field(default_factory=list)
    force_density: FloatArray = _element("multiplied", np.nan)
    horizontal_force: FloatArray | None = _element()
    unstressed_length: FloatArray = _element("split", np.nan)
    section: FloatArray = _element()
    modulus: FloatArray = _element()
    density: FloatArray = _element()
    expansion: FloatArray = _element(key="thermal_expansion")
    prestress: FloatArray = _element(key="prestress")
    yield_stress: FloatArray = _element(key="yield_stress", absent=np.inf)
    fracture_strain: FloatArray = _element(key="fracture_strain", absent=np.inf)
    nominal: BoolArray = _element()
    breaking_load: FloatArray = _element()
    strength_cov: FloatArray = _element(key="strength_cov")
    strength: FloatArray = _element(empty=1.0)
    length_std: FloatArray = _element(key="length_std")
    length_error: FloatArray = _element(empty=0.0)
    type: IntArray = _element(empty=-1)
    type_names: list[str] = field(default_factory=list)
    bar: BoolArray = _element()
    second_moment: FloatArray | None = _element()
    buckling_length: FloatArray | None = _element()
    buckling_curve: IntArray | None = _element()
    bending: BoolArray | None = _element()
    buckling: BoolArray | None = _element()
    diameter: FloatArray | None = _element()
    drag_coefficient: FloatArray | None = _element()
    tier: IntArray = _element(empty=0)
    cable: IntArray = _element()
    cable_names: list[str] = field(default_factory=list)
    cable_given: list[str] = field(default_factory=list)
    outline: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    corners: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    roof_axes: FloatArray | None = None
    parts: int = 1
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
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
        """(n, 3) bool, axes with a rigid or elastic support."""
        return self.fixed | (self.spring > 0)

    @property
    def moves(self) -> np.ndarray:
        """(n,) bool, nodes that can move along at least one axis."""
        return np.asarray(~self.fixed.all(1))

    @property
    def valence(self) -> np.ndarray:
        """(n,) number of attached elements that exist."""
        return np.bincount(self.elements[self.is_there].ravel(), minlength=self.n)

    @property
    def support(self) -> np.ndarray:
        """(n,) [N/m], stiffness of the elastic supports along their stiffest axis."""
        return self.spring.max(1)

    @property
    def n(self) -> int:
        """Number of particles."""
        return len(self.x)

    @property
    def given(self) -> int:
        """Number of given nodes; the particles of subdivision follow them."""
        return self.n - self.inner_particles().size

    @property
    def m(self) -> int:
        """Number of elements."""
        return len(self.elements)

    @property
    def tolerance(self) -> float:
        """Distance [m] below which two points are the same."""
        if not self.m:
            return 0.0
        return min(MAX_MERGE_DISTANCE, MAX_MERGE_SHARE * self.parts * float(np.median(self.lengths())))

    @property
    def is_there(self) -> np.ndarray:
        """(m,) bool, elements that exist; elements removed in an erection stage have no density."""
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
        """(m,) [N/m], self weight of the elements."""
        return GRAVITY * self.density * self.section

    def undivided(self) -> np.ndarray:
        """Return the two particles (m / parts, 2) of each given element, before subdivision."""
        first, last = self.elements[:: self.parts], self.elements[self.parts - 1 :: self.parts]
        return np.column_stack([first[:, 0], last[:, 1]])

    def inner_particles(self) -> np.ndarray:
        """Return the inner particles (m / parts, parts - 1) of each given element, from start to end."""
        return self.elements[:, 1].reshape(-1, self.parts)[:, :-1]

    def is_in_groups(self, names: Collection[str]) -> np.ndarray:
        """Return which elements (m,) belong to one of some groups."""
        return np.isin(self.group, [g for g, name in enumerate(self.group_names) if name in names])

    def ids_by_group(self, rows: BoolArray) -> Iterator[tuple[str, IntArray]]:
        """Yield the name of each group with elements among some, rows (m,) bool, and the ids of these."""
        for g in np.unique(self.group[rows]):
            yield self.group_names[g], self.element_id[rows & (self.group == g)]

    def in_plan(self, points: np.ndarray) -> np.ndarray:
        """Return points (k, 3) [m] in axes for a view of the roof from above: x, y, z, or `roof_axes`."""
        return along_axes(points, self.roof_axes)

    def lengths(self) -> np.ndarray:
        """Compute the lengths of the elements (m,) [m] in the start geometry."""
        return lengths(self.x[self.elements[:, 1]] - self.x[self.elements[:, 0]])

    def plan_lengths(self, x: np.ndarray) -> np.ndarray:
        """Compute the lengths of the elements in plan (m,) [m], with the nodes at x (n, 3) [m]."""
        return lengths((x[self.elements[:, 1]] - x[self.elements[:, 0]]) * [1.0, 1.0, 0.0])


def pair_key(pairs: np.ndarray, count: int) -> np.ndarray:
    """Return one number for each pair (k, 2) of points 0 to count - 1, the same in either order."""
    return pairs.min(1) * count + pairs.max(1)


def nearest_group(net: Net, name: str) -> str:
    """Suggest a group for a name that no group of the net has."""
    known = [group for group in net.group_names if group]
    return suggest(name, known) if known else "the net has no groups"


def elements_of_group(net: Net, name: str) -> tuple[np.ndarray, list[str]]:
    """Return the elements (k,) of a group, and the errors in its name."""
    rows = np.flatnonzero(net.is_in_groups([name]))
    return rows, [] if len(rows) else [messages.UNKNOWN_GROUP(suggestion=nearest_group(net, name))]


def elements_of_cables(net: Net, names: list[str]) -> tuple[np.ndarray, list[str]]:
    """Return the elements (k,) of cables, and the errors in their names."""
    unknown = sorted(set(names) - set(net.cable_names))
    numbers = [net.cable_names.index(name) for name in names if name not in unknown]
    errors = [
        messages.UNKNOWN_CABLE(name=format_value(name), suggestion=suggest(name, net.cable_names))
        for name in unknown
    ]
    return np.flatnonzero(np.isin(net.cable, numbers)), errors


def subdivide(net: Net, parts: int) -> Net:
    """Divide each element of a net into `parts` equal ones; new particles follow the nodes, without load.

    New particles are free, except in an element between two fixed nodes, where they are fixed. Such an
    element closes a face or does not move. A free middle would sag or flap, unlike a real cable in this
    position.
    """
    if parts == 1:
        return net
    n, m = net.n, net.m
    inner = n + np.arange(m * (parts - 1)).reshape(m, parts - 1)
    chain = np.column_stack([net.elements[:, :1], inner, net.elements[:, 1:]])
    new = _evenly_spaced(net.x[net.elements], parts)
    k = len(new)
    held = np.repeat(net.fixed[net.elements].all((1, 2)), parts - 1)
    columns: dict[str, Any] = {
        column.name: _subdivided_column(net, column, k, parts) for column in fields(net) if column.metadata
    }
    return replace(
        net,
        x=np.concatenate([net.x, new]),
        fixed=np.concatenate([net.fixed, np.repeat(held[:, None], 3, 1)]),
        parts=net.parts * parts,
        node_id=np.concatenate([net.node_id, net.node_id.max() + 1 + np.arange(k)]),
        elements=np.stack([chain[:, :-1], chain[:, 1:]], -1).reshape(-1, 2),
        outline=np.where(net.outline >= n, net.outline + k, net.outline),
        **columns,
    )


def undo_subdivision(net: Net) -> Net:
    """Undo `subdivide`; the positions of inner particles are lost. A net without parts is returned itself."""
    if net.parts == 1:
        return net
    n = net.given
    columns: dict[str, Any] = {name: getattr(net, name)[:n] for name in ("x", "fixed", "node_id")}
    columns["outline"] = np.where(net.outline >= net.n, net.outline - (net.n - n), net.outline)
    undo = {"split": np.multiply, "multiplied": np.divide}
    for column in fields(net):
        values, row = getattr(net, column.name), column.metadata
        if row and values is not None:
            columns[column.name] = values[:n] if row["entity"] == "node" else values[:: net.parts]
            if row.get("divided") in undo:
                columns[column.name] = undo[row["divided"]](columns[column.name], net.parts)
    return replace(net, parts=1, elements=net.undivided(), **columns)


def space_inner_particles(net: Net, x: np.ndarray) -> np.ndarray:
    """Return positions (n, 3) [m] of all particles: given nodes at x, the others evenly spaced in between."""
    return np.concatenate([x, _evenly_spaced(x[net.undivided()], net.parts)])


def undivide_bars(net: Net) -> Net:
    """Make the first part of each subdivided bar the whole bar, for form finding.

    The other parts get neither force nor stiffness, and the particles between the ends are fixed.
    `straighten_bars` returns them to the bar.
    """
    bars = net.bar[:: net.parts]
    if net.parts == 1 or not bars.any():
        return net
    elements, fixed, first = net.elements.copy(), net.fixed.copy(), np.flatnonzero(bars) * net.parts
    elements[first], fixed[net.inner_particles()[bars]] = net.undivided()[bars], True
    share = np.where(net.bar, 0.0, 1.0)
    share[first] = 1.0
    q = net.force_density * np.where(net.bar, share / net.parts, 1.0)
    prestress, section = share * net.prestress, share * net.section
    return replace(net, elements=elements, fixed=fixed, prestress=prestress, section=section, force_density=q)


def straighten_bars(net: Net, x: FloatArray, N: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give the parts of a bar the force N (m,) [N] of the first; space its particles x (n, 3) [m] evenly."""
    inner = net.inner_particles()[net.bar[:: net.parts]]
    x[inner] = space_inner_particles(net, x[: net.given])[inner]
    return x, np.where(net.bar, np.repeat(N[:: net.parts], net.parts), N)


def _evenly_spaced(ends: np.ndarray, parts: int) -> np.ndarray:
    """Return points (m (parts - 1), 3) that divide the lines between ends (m, 2, 3) evenly."""
    share = (np.arange(1, parts) / parts)[None, :, None]
    return ((1 - share) * ends[:, :1] + share * ends[:, 1:]).reshape(-1, 3)


def parent_ends(net: Net) -> np.ndarray:
    """Return the two end nodes (n, 2) of the given element around each particle; a given node twice."""
    ends = np.column_stack([np.arange(net.n)] * 2)
    ends[net.inner_particles()] = net.undivided()[:, None]
    return ends


def extend_to_inner_particles(net: Net, moved: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Extend displacements (n, 3) of supports to the fixed inner particles between two supports.

    These particles remain evenly spaced between their ends. fixed : (n, 3) bool
    """
    spaced_evenly = space_inner_particles(net, moved[: net.given])
    inner = (parent_ends(net)[:, 0] != np.arange(net.n)) & fixed.all(1)
    return np.where((inner & ~moved.any(1))[:, None], spaced_evenly, moved)


def _subdivided_column(net: Net, column: Any, k: int, parts: int) -> np.ndarray | None:
    """Return a column of a net with k more nodes and each element in `parts`, by its row in `Net`."""
    values, row = getattr(net, column.name), column.metadata
    if values is None:
        return None
    if row["entity"] == "node":
        inner = row["inner"]
        if column.name == "area":  # given areas cover the roof up to the middles of the elements
            start, end = np.isfinite(values)[net.elements].T[:, :, None]
            side = np.sign(2 * np.arange(1, parts) - parts)
            inner = np.where((start | (side > 0)) & (end | (side < 0)), 0.0, np.nan).ravel()
        if column.name == "zone":  # stages hold an inner node of a zone if both ends are in it
            start, end = values[net.elements].T
            inner = np.repeat(np.where(start == end, start, -1), parts - 1)
        if column.name == "zone_share":
            inner = np.repeat(values[net.elements].min(axis=1), parts - 1, axis=0)
        return np.concatenate([values, np.broadcast_to(inner, (k, *values.shape[1:]))])
    repeated = np.repeat(values, parts, axis=0)
    if row["divided"] == "each":
        return repeated
    return repeated / parts if row["divided"] == "split" else repeated * parts


def connected_parts(pairs: np.ndarray, count: int) -> np.ndarray:
    """Return for each of `count` vertices the lowest vertex of its connected part; pairs (k, 2) are edges."""
    from scipy.sparse import coo_array  # imported here: it takes 0.2 s to load
    from scipy.sparse.csgraph import connected_components

    joined = coo_array((np.ones(len(pairs)), tuple(pairs.T)), (count, count))
    _, part = connected_components(joined, directed=False)
    return np.unique(part, return_index=True)[1][part]


def part_contains(label: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Return whether each vertex's part, label (n,) of `connected_parts`, contains one of some (n,) bool."""
    has = np.zeros(len(label), bool)
    has[label[some]] = True
    return has[label]


def part_is_supported(net: Net, label: np.ndarray) -> np.ndarray:
    """Return whether each particle's part, label (n,), has a vertical support, or any if the net has none."""
    vertical = net.held[:, 2]
    return part_contains(label, vertical if vertical.any() else np.asarray(net.held.any(1)))


def unconnected_pairs(x: np.ndarray, elements: np.ndarray, distance: float) -> np.ndarray:
    """Return the pairs of `close_pairs` that no element of elements (m, 2) joins."""
    pairs = close_pairs(x, distance)
    return pairs[~is_one_of(pair_key(pairs, len(x)), pair_key(elements, len(x)))]


def close_pairs(x: np.ndarray, distance: float) -> np.ndarray:
    """Return the pairs (k, 2) of points x (n, 3) within `distance` of each other, lower number first."""
    choices = [(x * direction).sum(1) for direction in SORTING_DIRECTIONS]
    along = max(choices, key=np.ptp) if len(x) else choices[0]  # a flat net may be normal to one direction
    order = np.argsort(along, kind="stable")
    first, along, step, close = np.arange(len(x)), along[order], 0, [np.empty((0, 2), np.int64)]
    while len(first):
        step += 1
        first = first[first + step < len(x)]
        first = first[along[first + step] - along[first] <= distance * 1.001]  # with a margin for rounding
        pairs = np.sort(np.stack([order[first], order[first + step]], 1), axis=1)
        close.append(pairs[((x[pairs[:, 0]] - x[pairs[:, 1]]) ** 2).sum(1) <= distance**2])
    pairs = np.concatenate(close)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
