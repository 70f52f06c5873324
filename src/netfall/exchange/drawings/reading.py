"""Conversion of a drawing to a net: joining, supports, splitting, omissions, and the report on them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from netfall.core.errors import InputError
from netfall.core.messages import count_of
from netfall.exchange import messages
from netfall.exchange.drawings import join
from netfall.exchange.drawings.compas import read_compas
from netfall.exchange.drawings.drawing import MAX_COORDINATE, METRES, Drawing, cut_curves, rows_with_name
from netfall.exchange.drawings.dxf import read_dxf
from netfall.exchange.vtu import read_vtu
from netfall.job.values import suggest

# By ending: the reader, and the name of its files in messages. A reader raises OSError for a missing file,
# ValueError for a damaged file.
READERS = {
    ".dxf": (read_dxf, "a DXF file", "a DXF file"),
    ".json": (read_compas, "a JSON file of COMPAS", "a JSON file"),
    ".vtu": (read_vtu, "a VTU file", "a VTU file"),
}
AT_POINTS, OUTLINE = "points", "outline"  # values of --supports that are not layers
MAX_LISTED_PLACES = 5  # number of places listed for one type of fault
ROOF_SHARE = 0.1  # share of the elements of the largest part; a larger part is another roof
MAX_FACE_ELEMENTS = 3  # number of elements; smaller faces have all nodes on the outline
MAX_ROUNDING_GAP = 1e-6  # m; smaller gaps are rounding of the drawing
MAX_CHAIN = 3.0  # number of tolerances over which ends are joined; the sum of gaps at one node is less
LONG, SHORT = 1e3, 0.5  # m; extents outside these bounds make the unit doubtful; roofs span up to 400 m


@dataclass
class ImportOptions:
    """Options of the command line.

    unit : None: the unit of the file; tolerance : [m]
    supports : a layer, "points" or "outline"; None: the supports of the file, or the outline
    layers : layers to read, None: all; split : add a joint wherever elements cross or touch
    springs : a layer that marks elastic supports, and their stiffness (3,) [N/m], or None
    """

    unit: str | None = None
    tolerance: float = 1e-3
    supports: str | None = None
    layers: list[str] | None = None
    split: bool = False
    springs: tuple[str, tuple[float, ...]] | None = None


@dataclass
class NetImport:
    """Drawing that is being converted to a net, with the report on it.

    fixed : (n, 3) bool; lines : report; marks : places [m] of faults in the picture
    spring : (n, 3) [N/m] of elastic supports, None: none were requested
    """

    path: Path
    options: ImportOptions
    drawing: Drawing
    net: join.JoinedNet
    fixed: np.ndarray
    lines: list[str]
    marks: list[np.ndarray]
    spring: np.ndarray | None = None

    @property
    def held(self) -> np.ndarray:
        """Nodes (n,) bool with a support, elastic or not."""
        return np.asarray((self.fixed if self.spring is None else self.fixed | (self.spring > 0.0)).any(1))

    def place(self, x: np.ndarray) -> str:
        """Format a point in metres, and in the unit of the drawing."""
        metres = ", ".join(f"{value:.4f}".rstrip("0").rstrip(".") for value in x.tolist())
        if self.drawing.unit is None or self.drawing.unit == "m":
            return f"({metres})"
        factor = METRES[self.drawing.unit]
        as_drawn = ", ".join(f"{value / factor:.6g}" for value in x.tolist())
        return f"({metres}) m, ({as_drawn}) {self.drawing.unit} as drawn"

    def tell(self, kind: str, meaning: str, x: np.ndarray, places: Iterable[str] | None = None) -> None:
        """Add a fault, if there is any, to the report and the marks: its count, meaning and first places.

        x : (k, 3) [m], marks for the picture; places : in words, None: by their coordinates
        """
        marks = np.reshape(x, (-1, 3))
        if not len(marks):
            return
        texts = (f"at {self.place(mark)}" for mark in marks) if places is None else places
        remainder = [f"and {len(marks) - MAX_LISTED_PLACES} more"] if len(marks) > MAX_LISTED_PLACES else []
        self.lines.append(f"{kind} ({len(marks)}): {meaning}")
        self.lines += [f"    {text}" for text in (*islice(texts, MAX_LISTED_PLACES), *remainder)]
        self.marks += list(marks)

    def layer_of(self, line: int) -> str:
        """Return the layer of a line, in words."""
        return f'layer "{self.drawing.layers[self.drawing.layer[line]]}"'


def read_net(path: Path, options: ImportOptions) -> NetImport:
    """Read the net of a drawing, and report on it."""
    drawing = _read(path, options)
    lines = [f"{path}: {'; '.join(drawing.read)}"]
    lines += [_unit_line(drawing, options), *_extent_remarks(drawing)]
    lines += [f"left out: {omission}" for omission in drawing.left_out]
    net = join.join(drawing.lines, options.tolerance)
    if not len(net.ends):
        raise InputError(messages.ONLY_SHORT_LINES(path=path, tolerance=options.tolerance))
    reading = NetImport(path, options, drawing, net, np.zeros((len(net.x), 3), bool), lines, [])
    _report_joining(reading)
    _split_elements(reading)
    _set_springs(reading)
    reading.fixed = _supports(reading)
    _report_near_misses(reading)
    _remove_unsupported_parts(reading)
    _report_loose_ends(reading)
    return reading


def _read(path: Path, options: ImportOptions) -> Drawing:
    """Read a drawing in metres. Raises InputError."""
    if path.suffix.lower() not in READERS:
        raise InputError(messages.UNKNOWN_DRAWING(path=path, endings=", ".join(READERS)))
    read, kind, damaged_kind = READERS[path.suffix.lower()]
    support_layer = options.supports if options.supports not in (None, AT_POINTS, OUTLINE) else None
    marking = [name for name in (support_layer, options.springs and options.springs[0]) if name]
    try:
        drawing = read(path, marking)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(messages.UNREADABLE_DRAWING(path=path, reason=reason, kind=kind)) from None
    except (ValueError, RecursionError) as error:
        raise InputError(messages.DAMAGED_DRAWING(path=path, kind=damaged_kind, error=error)) from None
    if not (np.abs(drawing.lines) <= MAX_COORDINATE).all():
        raise InputError(messages.WRONG_COORDINATE(path=path, limit=MAX_COORDINATE))
    for name in [*(options.layers or []), *marking]:
        if drawing.layers and not rows_with_name(name, drawing.layers):
            alternatives = f"{AT_POINTS}, {OUTLINE}, or " if name == support_layer else ""
            option = "--supports" if name == support_layer else "--springs" if name in marking else "--layers"
            advice = suggest(name, drawing.layers)
            raise InputError(
                messages.UNKNOWN_LAYER(option=option, name=name, alternatives=alternatives, advice=advice)
            )
    if options.layers is not None:
        drawing.select([*options.layers, *marking])
    cut_curves(drawing, options.tolerance / METRES[options.unit or drawing.unit or "m"])
    if not len(drawing.lines):
        omissions = f" (left out: {'; '.join(drawing.left_out)})" if drawing.left_out else ""
        raise InputError(messages.NO_LINES(path=path, omissions=omissions))
    if drawing.unit is None and options.unit is None and drawing.unit_from:
        units, extent = ", ".join(METRES), _extent(drawing.lines)
        raise InputError(messages.NO_UNIT(path=path, source=drawing.unit_from, units=units, extent=extent))
    drawing.file_unit = drawing.unit
    drawing.unit = options.unit or drawing.unit or "m"
    drawing.scaled(drawing.unit)
    return drawing


def _extent(lines: np.ndarray) -> str:
    """Format the extent of lines along each axis."""
    return " x ".join(f"{size:.4g}" for size in np.ptp(lines.reshape(-1, 3), axis=0))


def _unit_line(drawing: Drawing, options: ImportOptions) -> str:
    """Return the line on the unit and its source."""
    source = "the file gives none: metres assumed, --unit sets another"
    if drawing.file_unit:
        source = f"from {drawing.unit_from}"
    if options.unit:
        differs = drawing.file_unit not in (None, options.unit)
        source = "from --unit" + f"; the file has {drawing.file_unit}" * differs
    return f"unit: {drawing.unit} ({source}); extent {_extent(drawing.lines)} m"


def _extent_remarks(drawing: Drawing) -> list[str]:
    """Return lines on an unusual extent, on a drawing far from the origin and on a flat drawing."""
    x = drawing.lines.reshape(-1, 3)
    size, lines = np.ptp(x, axis=0), []
    if not SHORT <= size.max() <= LONG:
        lines.append(messages.UNUSUAL_EXTENT(extent=size.max(), low=SHORT, high=LONG, unit=drawing.unit))
    if np.abs(x).max() > 100.0 * size.max():
        lines.append(
            f"position: the drawing is {np.abs(x).max():.4g} m from the origin, its extent {size.max():.4g} m"
        )
    if size[2] == 0.0:
        lines.append(f"flat: all lines lie at z = {x[0, 2]:g} m; form finding keeps them there")
    return lines


def _report_joining(reading: NetImport) -> None:
    """Report joined gaps, lines without length and duplicates."""
    net, lines = reading.net, reading.drawing.lines
    layer = reading.layer_of

    def point(line: int, end: int = 0) -> str:
        return reading.place(lines[line, end])

    gaps = np.argwhere(net.moved > MAX_ROUNDING_GAP)
    gaps = gaps[np.argsort(-net.moved[tuple(gaps.T)], kind="stable")]
    places = (f"{1e3 * net.moved[k, e]:.3g} mm at {point(k, e)}, {layer(k)}" for k, e in gaps)
    largest, tolerance = net.moved.max(), reading.options.tolerance
    meaning = f"ends of lines up to {1e3 * largest:.3g} mm from a node were joined to it"
    reading.tell("gap", meaning, lines[tuple(gaps.T)], places)
    if largest > MAX_CHAIN * tolerance:
        reading.lines.append(messages.CHAIN_OF_ENDS(moved=largest, tolerance=tolerance))
    places = (f"at {point(k)}, {layer(k)}" for k in net.short)
    meaning = "lines no longer than the tolerance were left out"
    reading.tell("no length", meaning, lines[net.short, 0], places)
    places = (f"at {point(k)} to {point(k, 1)}, {layer(k)}, as on {layer(j)}" for k, j in net.twice)
    meaning = "lines that lie on another one were left out"
    reading.tell("duplicate", meaning, lines[net.twice[:, 0]].mean(1), places)


def _split_elements(reading: NetImport) -> None:
    """Split elements at joints: on lines of the layer of supports, and with --split everywhere.

    Touches and crossings that are not split are reported.
    """
    net, options = reading.net, reading.options
    on_edge = _on_support_layer(reading)
    node, element, _ = join.find_touches(net.x, net.ends, options.tolerance)
    pairs, crossing, _ = join.find_crossings(net.x, net.ends, options.tolerance)

    def layer(element: int) -> str:
        return reading.layer_of(net.line[element])

    cut = np.ones(len(element), bool) if options.split else on_edge[element]
    places = (f"at {reading.place(x)}, {layer(e)}" for x, e in zip(net.x[node[~cut]], element[~cut]))
    meaning = "nodes lie on an element between its ends, without a joint; --split makes joints"
    reading.tell("touch", meaning, net.x[node[~cut]], places)
    if not options.split:
        places = (f"at {reading.place(x)}, {layer(a)} and {layer(b)}" for (a, b), x in zip(pairs, crossing))
        meaning = "elements cross without a joint; --split makes joints"
        reading.tell("crossing", meaning, crossing, places)
        pairs, crossing = pairs[:0], crossing[:0]
    if cut.any() or len(pairs):
        elements = np.concatenate([element[cut], *pairs.T])
        # a touching node stays in place; a crossing is placed on the first of its two elements
        x = np.concatenate([net.x[node[cut]], crossing, crossing])
        reading.net = join.split(net, elements, x, options.tolerance)
        reading.lines.append(f"split: joints at {int(cut.sum())} touches and {len(pairs)} crossings")
        net = reading.net
        marks = net.x[net.ends[net.parts[:, 1]]].mean(1)
        places = (
            f"at {reading.place(x)}, {reading.layer_of(k)}, as on {layer(e)}"
            for (k, e), x in zip(net.parts, marks)
        )
        reading.tell("duplicate", "parts of lines lie on other lines; left out", marks, places)


def _on_support_layer(reading: NetImport, layer: str | None = None) -> np.ndarray:
    """Select the elements (m,) that are drawn on a layer, or repeat a line on it or a part of one.

    layer : None: the layers of supports and springs
    """
    drawing, net = reading.drawing, reading.net
    options = reading.options
    names = [options.supports, options.springs and options.springs[0]] if layer is None else [layer]
    on = np.isin(drawing.layer, [row for name in names for row in rows_with_name(name, drawing.layers)])
    replacing = net.twice[on[net.twice[:, 0]], 1]  # these elements replace left-out lines of the layer
    selected = on[net.line] | np.isin(net.line, replacing)
    selected[net.parts[on[net.parts[:, 0]], 1]] = True
    return selected


def _supports(reading: NetImport) -> np.ndarray:
    """Select the axes (n, 3) of the nodes with a rigid support, and report their source."""
    drawing, net, option = reading.drawing, reading.net, reading.options.supports
    fixed = np.zeros((len(net.x), 3), bool)
    if option == OUTLINE or (option is None and not len(drawing.held)):
        outline, roofs = _outline(net)
        fixed[outline] = True
        of_parts = f" of each of {roofs} parts" if roofs > 1 else ""
        source = f"nodes on the outline{of_parts}, and ends of single elements"
        advice = "" if option else "; --supports names a layer, points or outline"
    else:
        marks = drawing.held if option is None else drawing.points
        if option not in (None, AT_POINTS):
            marks = marks[np.isin(drawing.point_layer, rows_with_name(option, drawing.layers))]
            fixed[net.ends[_on_support_layer(reading, option)]] = True
        source = {None: "as given in the file", AT_POINTS: "at points"}.get(option, f'layer "{option}"')
        advice = ""
        axes = drawing.held_axes if option is None else np.ones((len(marks), 3), bool)
        _mark_supports(reading, marks, axes, fixed)
    if reading.spring is not None:
        sprung, from_file = reading.spring > 0.0, option is None and len(drawing.held) > 0
        fixed &= ~(sprung if from_file else sprung.any(1, keepdims=True))  # a file may hold other axes
    count, in_part = int(fixed.any(1).sum()), int((fixed.any(1) & ~fixed.all(1)).sum())
    source += f"; {in_part} along some axes only" * (in_part > 0)
    reading.lines.append(f"supports: {count} of {len(fixed)} nodes are held ({source}){advice}")
    return fixed


def _mark_supports(reading: NetImport, marks: np.ndarray, axes: np.ndarray, held: np.ndarray) -> None:
    """Set held (n, 3) bool at nodes with marks (k, 3) [m] of supports with these axes; report other marks."""
    from scipy.spatial import cKDTree

    distance, node = cKDTree(reading.net.x).query(marks)
    at_node = distance <= reading.options.tolerance
    np.logical_or.at(held, node[at_node], axes[at_node])
    missed, distance = marks[~at_node], distance[~at_node]
    places = [
        f"{1e3 * d:.4g} mm from the nearest node, at {reading.place(x)}" for d, x in zip(distance, missed)
    ]
    reading.tell("support", "points of supports are not at a node", missed, places)


def _set_springs(reading: NetImport) -> None:
    """Set elastic supports at the points and lines of their layer; they replace other supports there."""
    if reading.options.springs is None:
        return
    drawing, net, (layer, stiffness) = reading.drawing, reading.net, reading.options.springs
    sprung = np.zeros((len(net.x), 3), bool)
    sprung[net.ends[_on_support_layer(reading, layer)]] = True
    marks = drawing.points[np.isin(drawing.point_layer, rows_with_name(layer, drawing.layers))]
    _mark_supports(reading, marks, np.ones((len(marks), 3), bool), sprung)
    reading.spring = np.where(sprung, np.array(stiffness), 0.0)
    text = " x ".join(f"{k:g}" for k in stiffness)
    reading.lines.append(
        f'springs: {count_of(int(sprung.all(1).sum()), "node")} of layer "{layer}" on {text} N/m'
    )


def _outline(net: join.JoinedNet) -> tuple[np.ndarray, int]:
    """Select the nodes (n,) on the outline of each part of the net that is a roof; count these parts.

    The largest part is a roof. Another part is a roof if its outline contains free nodes, and it has closed
    faces or a certain size. This excludes the frame of a title block and stray lines.
    """
    of_element = join.parts_by_size(net.ends, len(net.x))[net.ends[:, 0]]
    order = np.argsort(of_element, kind="stable")
    parts = np.split(net.ends[order], np.cumsum(np.bincount(of_element))[:-1])
    fixed, roofs = np.zeros(len(net.x), bool), 0
    for ends in parts:
        large = len(ends) >= ROOF_SHARE * len(parts[0])
        if not large and len(ends) <= MAX_FACE_ELEMENTS:
            continue
        held, faces = join.outline(net.x, ends)
        if ends is parts[0] or (~held[ends].all() and (faces or large)):
            fixed |= held
            roofs += 1
    return fixed, roofs


def _report_near_misses(reading: NetImport) -> None:
    """Report nodes that nearly meet other nodes or elements, and elements that nearly cross."""
    net, tolerance = reading.net, reading.options.tolerance
    reach = join.near_miss_distance(net.x, net.ends, tolerance)
    pairs, of_pairs = join.near_nodes(net.x, net.ends, reach)
    node, _, of_touches = join.find_touches(net.x, net.ends, reach)
    _, crossing, of_crossings = join.find_crossings(net.x, net.ends, reach)
    closer = f"closer than {1e3 * reach:.3g} mm"
    advice = "unjoined; a larger --tolerance joins them"
    split_advice = "without a joint; --split with a larger --tolerance makes joints"
    for meaning, marks, distance in (
        (f"pairs of nodes lie {closer}, {advice}", net.x[pairs[:, 0]], of_pairs),
        (f"nodes lie {closer} to an element", net.x[node], of_touches),
        (f"pairs of elements cross {closer}, {split_advice}", crossing, of_crossings),
    ):
        missed = distance > tolerance
        gaps = zip(distance[missed], marks[missed])
        places = [f"{1e3 * gap:.4g} mm at {reading.place(x)}" for gap, x in gaps]
        reading.tell("near miss", meaning, marks[missed], places)


def _remove_unsupported_parts(reading: NetImport) -> None:
    """Report and remove the parts of the net without support, because they are mechanisms."""
    net, drawing = reading.net, reading.drawing
    part = join.parts_by_size(net.ends, len(net.x))
    has_support = np.zeros(part.max() + 1, bool)
    has_support[part[reading.held]] = True
    if not has_support.any():
        raise InputError(messages.NO_NODE_HELD(path=reading.path, layers=", ".join(drawing.layers)))
    of_element = part[net.ends[:, 0]]
    if not has_support[0]:  # the remaining part is probably not the intended roof
        is_part = of_element == 0
        reading.lines.append(messages.LARGEST_PART_LEFT_OUT(count=int(is_part.sum()), total=len(is_part)))
        reading.lines.append(f"    {_where(reading, is_part)}")
    others = np.unique(of_element[of_element > 0])
    for numbers, remark in (
        (others[~has_support[others]], "and without a support: LEFT OUT"),
        (others[has_support[others]], "and have their own supports"),
    ):
        of_parts = [of_element == number for number in numbers.tolist()]
        count = int(np.isin(of_element, numbers).sum())
        meaning = (
            f"parts ({count} of {len(of_element)} elements) are not joined to the rest of the net, {remark}"
        )
        marks = np.array([net.x[net.ends[is_part][0, 0]] for is_part in of_parts])
        texts = (
            f"{count_of(int(is_part.sum()), 'element')} {_where(reading, is_part)}" for is_part in of_parts
        )
        reading.tell("loose part", meaning, marks, texts)
    supported, nodes = has_support[of_element], has_support[part]
    row = np.cumsum(nodes) - 1
    reading.net = replace(net, x=net.x[nodes], ends=row[net.ends[supported]], line=net.line[supported])
    reading.fixed = reading.fixed[nodes]
    if reading.spring is not None:
        reading.spring = reading.spring[nodes]


def _where(reading: NetImport, elements: np.ndarray) -> str:
    """Describe the place and the layers of elements; elements : (m,) bool."""
    net, drawing = reading.net, reading.drawing
    layers = sorted({drawing.layers[k] for k in drawing.layer[net.line[elements]].tolist()})
    return f"at {reading.place(net.x[net.ends[elements][0, 0]])}, layer {', '.join(layers)}"


def _report_loose_ends(reading: NetImport) -> None:
    """Report nodes with one element and no support."""
    net = reading.net
    single = np.bincount(net.ends.ravel(), minlength=len(net.x)) == 1
    loose = np.flatnonzero(single & ~reading.held)
    reading.tell("loose end", "nodes have one element and no support", net.x[loose])
