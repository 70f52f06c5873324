"""Jobs drawn by hypothesis: small nets that yield, go slack and break within a hundred steps.

A scene defines the features of a job. Everything else (topology, tables, loads, wind, removals, output) is
drawn within it. Every key of a job file occurs in some jobs; test_random_nets.py checks this.
"""

from dataclasses import dataclass, field

import hypothesis
import hypothesis.strategies as st
import numpy as np
from random_nets import NETS, SPACING, WITH_FACES, number, some, table, with_tails

from netfall.job.toml_text import toml_text

MODULUS, AREA, DENSITY = 1.0e10, 1.0e-4, 7000.0  # Pa, m2, kg/m3
EA = MODULUS * AREA
SOUND = (MODULUS / DENSITY) ** 0.5
PRESTRESS, YIELD, BREAK, BRITTLE = 1.5e3, 4e3, 0.007, 0.004  # N, N, strains with yield and without
# lateral: loads along x and y; motion: of supports without springs; band: damping over it; air: its damping
# and added mass; rests: stages before dynamics: relaxed form, load steps, cases, a static onset
FLAGS = (
    *("logarithmic", "plastic", "fracture", "bars", "sections", "part_held", "springs", "lateral", "losses"),
    *("fading", "motion", "band", "air", "growing", "energy", "fragments", "rests"),
)
WINDS = (None, "steady", "gusts", "table", "points", "taps")
SCENES = st.fixed_dictionaries({name: st.booleans() for name in FLAGS} | {"wind": st.sampled_from(WINDS)})
QUIET = dict(deadline=None, database=None, suppress_health_check=list(hypothesis.HealthCheck))
RELAXED = {"modulus_factor": 0.01, "tolerance": 0.05, "max_iterations": 3000}
FORMS = st.sampled_from(
    (None, None, {"method": "force_density"}, RELAXED, RELAXED | {"start": "force_density"})
)
LINEAR = st.sampled_from((None, {"method": "force_density"}))
# Nearly everything at once, in two ways that are stepped by different code.
FULL = dict.fromkeys(FLAGS, True) | {"logarithmic": False, "wind": "gusts"}
FULL |= {"rests": False}  # its iterations dominate the time on three ranks
OTHER = dict.fromkeys(FLAGS, True) | {"fragments": False, "wind": "taps"}


@dataclass
class DrawnJob:
    """A job as nested dicts, its tables by file name, its scene; how it is stopped and resumed."""

    job: dict
    tables: dict[str, str]
    scene: dict
    stop: str  # checkpoint | pause
    ranks: tuple[int, int]  # that stop, that go on

    @property
    def text(self) -> str:
        """Return the text of the job file."""
        return toml_text(self.job)


@dataclass
class DrawnNet:
    """Points (n, 3) [m], pairs (m, 2), held (n,); roof : whether its elements bound faces."""

    points: np.ndarray
    pairs: np.ndarray
    held: np.ndarray
    roof: bool
    square: bool = False  # only of the grid
    panels: bool = True  # whether the areas of nodes are those of the faces
    tails: int = 0  # last nodes, which hang outside the grid
    names: list = field(default_factory=list)  # ids of nodes, ids of elements
    ids: list = field(default_factory=list)
    groups: list = field(default_factory=list)


def chance(draw, one_in: int = 2) -> bool:
    """Draw True once in a number of times; the simplest value is False."""
    return draw(st.integers(0, one_in - 1)) == one_in - 1


# --- nets


def draw_net(draw, scene: dict, rng) -> DrawnNet:
    """Draw a net whose table rows are in random order."""
    kind = draw(st.sampled_from(list(NETS)))
    points, pairs, held = NETS[kind](rng)
    net = DrawnNet(points, pairs, held, kind in WITH_FACES, square=kind == "grid")
    if net.roof and not scene["losses"] and chance(draw, 4):
        net.points, net.pairs, net.held = with_tails(rng, points, pairs, held)
        net.tails = len(net.points) - len(points)
    order, m = rng.permutation(len(net.pairs)), len(net.pairs)
    net.pairs = net.pairs[order]
    turned = rng.random(m) < 0.3
    net.pairs[turned] = net.pairs[turned, ::-1]
    net.names = (rng.permutation(len(net.points)) * 3 + 7).tolist()
    net.ids = (rng.permutation(m) * 2 + 100).tolist() if chance(draw) else list(range(m))
    words = ["net" if chance(draw, 4) else ""] + ["strut"] * scene["bars"] + ["thick"] * scene["sections"]
    share = [1.0 - 0.2 * (len(words) - 1)] + [0.2] * (len(words) - 1)
    net.groups = rng.choice(words, m, p=share)
    net.groups[: len(words)] = words
    return net


def node_columns(draw, scene: dict, net: DrawnNet, rng) -> dict:
    """Draw the columns of nodes.csv: supports, springs, loads, masses, areas, normals, zones."""
    n, held = len(net.points), net.held
    each = lambda name, values: {f"{name}_{k}": map(number, c) for k, c in zip("xyz", values.T)}
    columns = {"id": net.names} | {k: map(number, c) for k, c in zip("xyz", net.points.T)}
    fixed = np.repeat(held[:, None], 3, 1)
    if scene["springs"]:
        springs = np.zeros((n, 3))
        sprung = rng.permutation(np.flatnonzero(held))[: 1 + int(held.sum()) // 4]
        springs[sprung] = rng.uniform(1e5, 4e5, (len(sprung), 3))
        fixed[sprung] = False
        columns |= each("spring", springs)
    if scene["part_held"]:
        inner = np.flatnonzero(~held)
        fixed[rng.choice(inner, 1 + len(inner) // 8), rng.integers(0, 3)] = True
    if scene["part_held"] or scene["springs"] or chance(draw):
        columns |= {f"fixed_{k}": c.astype(int) for k, c in zip("xyz", fixed.T)}
    else:
        columns["fixed"] = held.astype(int)
    unlike = scene["part_held"] or scene["springs"]
    if unlike and not (scene["air"] or scene["motion"]) and chance(draw):
        columns["angle"] = map(number, rng.uniform(-180.0, 180.0, n))
    load = rng.uniform(-200.0, 200.0, (n, 3))
    columns |= each("load", load if scene["lateral"] else load * [0.0, 0.0, 1.0])
    columns["mass"] = map(number, rng.uniform(8.0, 25.0, n))
    if not net.roof or chance(draw):
        area = np.where(held, 0.0, rng.uniform(10.0, 18.0, n))
        if net.tails:
            area[-net.tails :] = 0.0
        net.panels = False
        columns["area"] = map(number, area if not net.roof else some(rng, area, 0.6))
    if not net.roof or chance(draw):
        normal = np.column_stack([rng.uniform(-0.2, 0.2, (n, 2)), np.ones(n)])
        columns |= each("normal", normal)
    if chance(draw, 3):
        columns["zone"] = rng.choice(["", "", "own"], n)
        columns["zone"][0] = "own"
    return columns


def element_columns(draw, scene: dict, net: DrawnNet, rng, form: dict | None, types: bool) -> dict:
    """Draw the columns of elements.csv. form : [form_finding], types : whether there is a catalogue"""
    m = len(net.pairs)
    names = np.array(net.names)
    length = np.linalg.norm(net.points[net.pairs[:, 1]] - net.points[net.pairs[:, 0]], axis=1)
    columns = {"start": names[net.pairs[:, 0]], "end": names[net.pairs[:, 1]]}
    if net.ids != list(range(m)):
        columns["id"] = net.ids
    if any(net.groups):
        columns["group"] = net.groups
    if chance(draw):
        columns["prestress"] = map(number, some(rng, PRESTRESS * rng.uniform(0.9, 1.1, m)))
    if form is not None and "force_density" in form.values() and chance(draw):
        columns["force_density"] = map(number, some(rng, PRESTRESS / length * rng.uniform(0.9, 1.1, m)))
    if form is None and chance(draw):
        strain = rng.uniform(-1e-3, 3e-3, m)
        columns["unstressed_length"] = map(number, some(rng, length / (1 + strain)))
    if scene["sections"] and chance(draw):
        net.panels = False
        columns["area"] = map(number, some(rng, AREA * rng.uniform(1.0, 1.5, m), 0.3))
        columns["modulus"] = map(number, some(rng, MODULUS * rng.uniform(0.8, 1.2, m), 0.3))
    if scene["sections"] and scene["plastic"] and chance(draw, 3):
        columns["yield_stress"] = map(number, some(rng, YIELD / AREA * rng.uniform(1.0, 1.3, m), 0.3))
    if scene["fracture"] and chance(draw, 3):
        limit = BREAK if scene["plastic"] else BRITTLE
        columns["fracture_strain"] = map(number, some(rng, limit * rng.uniform(0.9, 1.3, m), 0.5))
    if scene["fracture"] and not scene["plastic"] and chance(draw, 3):
        columns["breaking_load"] = map(number, some(rng, EA * BRITTLE * rng.uniform(0.9, 1.2, m), 0.5))
    if types and scene["sections"]:
        columns["type"] = rng.choice(["", "B"], m)
    if chance(draw):
        columns["cable"] = rng.choice(["", "main", "back"], m)
        columns["cable"][:2] = ["main", "back"]
    return columns


# --- sections of the job


def draw_cables(draw, scene: dict, tables: dict) -> dict:
    """Draw [cable] and its groups, with one of the ways to give a section."""
    kind = draw(st.sampled_from(("modulus", "stiffness", "type")))
    own = {
        "modulus": {"modulus": MODULUS, "area": AREA, "density": DENSITY},
        "stiffness": {"axial_stiffness": EA, "mass_per_length": DENSITY * AREA, "area": AREA},
        "type": {"catalogue": "types.csv", "type": "A"},
    }[kind]
    if kind == "type":
        rows = [[word, *(f * v for v in (DENSITY * AREA, EA, AREA))] for word, f in (("A", 1), ("B", 1.4))]
        head = "name,mass_per_length,axial_stiffness,area,breaking_load\n"
        tables["types.csv"] = head + "".join(f"{','.join(map(str, row))},\n" for row in rows)
    own |= {
        "prestress": PRESTRESS,
        "strain_measure": "logarithmic" if scene["logarithmic"] else "engineering",
    }
    thick = {"modulus": {"area": 1.4 * AREA}, "stiffness": {"axial_stiffness": 1.4 * EA}}.get(kind) or {
        "type": "B"
    }
    if scene["air"]:
        own |= {"diameter": 0.02, "drag_coefficient": 1.1}
    strut = {"kind": "bar"}
    if kind == "modulus":
        strut |= {"second_moment": 1e-8, "buckling_length": 2.0, "buckling_curve": "a"}
    if scene["plastic"]:
        own["yield_stress"] = YIELD / AREA
        thick = thick | {"yield_stress": 1.2 * YIELD / AREA}
    if scene["fracture"]:
        by_load = not scene["plastic"] and chance(draw)
        limit = BREAK if scene["plastic"] else BRITTLE
        own |= {"breaking_load": EA * limit} if by_load else {"fracture_strain": limit}
        if by_load and chance(draw):
            own["fracture_strain"] = 1.5 * limit
        if scene["bars"] and (chance(draw) or scene["sections"]):
            strut["fracture_strain"] = 0.9 * limit
        if scene["plastic"] and not scene["bars"] and chance(draw, 3):
            own["breaking_load"] = 0.98 * YIELD
    if (scene["fracture"] or scene["plastic"]) and chance(draw):
        own |= {"strength_cov": 0.1, "strength_seed": draw(st.integers(0, 99))}
    if chance(draw, 3):
        own["thermal_expansion"] = 1.5e-5
    groups = {"strut": strut if scene["bars"] else None, "thick": thick if scene["sections"] else None}
    return own, {name: keys for name, keys in groups.items() if keys}


def draw_load(draw, scene: dict, rng, zones: list) -> dict:
    """Draw [load]: small loads if there are equilibria."""
    load = {"self_weight": chance(draw), "tolerance": 1e-3, "max_iterations": 3000 if scene["rests"] else 200}
    if chance(draw):
        load["dead"] = float(rng.uniform(2.0, 10.0))
    if chance(draw, 3):
        load["snow"] = float(rng.uniform(2.0, 10.0))
    if chance(draw, 4):
        load["temperature"] = float(rng.uniform(-20.0, 20.0))
    size = float(rng.uniform(-15.0, 15.0))
    if scene["growing"] or chance(draw):
        load["pressure"] = [0.3 * size, -0.2 * size, size] if chance(draw) else size
    if scene["growing"]:
        load["pressure"] = float(rng.uniform(50.0, 200.0)) * (1 if chance(draw) else -1)
    elif scene["rests"] and chance(draw):
        load["steps"] = draw(st.integers(1, 2))
    if zones and chance(draw):
        load["zone"] = {zones[0]: {"dead": 5.0, "snow": 3.0}}
        if scene["growing"]:
            load["zone"][zones[0]]["pressure"] = [5.0, 5.0, -30.0]
        if scene["air"]:
            load["zone"][zones[0]]["added_mass"] = 1.0
    if scene["air"]:
        load |= {"added_mass": 0.3, "ice": 0.002}
    return load


def draw_roof(draw, net: DrawnNet, tables: dict) -> dict | None:
    """Draw [roof]: all groups by name; with an opening, a line across a cell, or a table of faces."""
    roof = {}
    cell = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * SPACING
    nearest = lambda place: int(np.argmin(np.sum((net.points[:, :2] - place) ** 2, axis=1)))
    if net.square and chance(draw):
        corners = [nearest(net.points[0, :2] + by) for by in cell] + [
            nearest(net.points[-1 - net.tails, :2] - by) for by in cell
        ]
        tables["faces.csv"] = table(
            {"face": ["0"] * 4 + ["1"] * 4, "node": [str(net.names[p]) for p in corners]}
        )
        return {"faces": "faces.csv"}
    if net.roof and all(net.groups):
        roof["groups"] = sorted(set(map(str, net.groups)))
    if net.square and chance(draw):
        roof["openings"] = [[float(c) + 0.45 * SPACING for c in net.points[0, :2]]]
    elif net.square and chance(draw):
        across = [nearest(net.points[-1, :2] - cell[k]) for k in (1, 3)]
        tables["lines.csv"] = table({k: [str(net.names[p])] for k, p in zip(("start", "end"), across)})
        roof["lines"] = "lines.csv"
    return roof or None


def draw_wind(draw, scene: dict, net: DrawnNet, rng, duration: float, zones: list, tables: dict) -> dict:
    """Draw [wind]: a storm that acts at once, or a breeze whose mean has an equilibrium."""
    kind, storm = scene["wind"], scene["fracture"] or not scene["rests"] or chance(draw)
    speed = float(rng.uniform(30.0, 50.0) if storm else rng.uniform(4.0, 9.0))
    wind = {"onset": "sudden" if storm else "static"}
    if not storm:
        wind["ramp"] = draw(st.sampled_from((0.0, 0.6 * duration)))
    if scene["fracture"]:
        wind["after_fracture"] = draw(st.sampled_from(("particle", "detached", "panels", "all", "none")))
        if wind["after_fracture"] == "panels" and not net.panels:
            wind["after_fracture"] = "particle"
    time = np.linspace(-0.1 * duration, 1.1 * duration, 9)
    columns = {"time": map(number, time)}
    if kind == "taps":
        place = rng.choice(len(net.points), int(rng.integers(1, 5)), replace=False)
        size = float(rng.choice([-1.0, 1.0])) * (900.0 if storm else 30.0)
        columns |= {f"t{k}": map(number, size * rng.uniform(0.3, 1.2, 9)) for k in range(len(place))}
        tables["pressures.csv"] = table(columns)
        x, y, _ = net.points[place].T
        tables["taps.csv"] = table({"name": [*columns][1:], "x": map(number, x), "y": map(number, y)})
        wind |= {"pressures": "pressures.csv", "taps": "taps.csv"}
        air = {"speed": speed, "base_height": 20.0, "aerodynamic_damping": 0.8}
        return wind | (air if scene["air"] else {})
    wind |= {"profile_exponent": draw(st.sampled_from((0.0, 0.16))), "base_height": 20.0}
    coefficients(draw, wind, rng, zones, tables)
    if scene["air"]:
        wind["aerodynamic_damping"] = 1.0
        if zones:
            wind.setdefault("zone", {}).setdefault(zones[-1], {})["aerodynamic_damping"] = 0.3
    if kind in ("steady", "gusts"):
        wind |= {"speed": speed, "surface_drag": 0.05 if kind == "gusts" else 0.0}
    if kind == "gusts":
        if chance(draw):
            wind["turbulence_intensity"] = float(rng.uniform(0.1, 0.3))
            del wind["surface_drag"]
        wind |= {"time_step": duration / 13.0, "control_points": 6, "ar_order": draw(st.integers(2, 14))}
        wind |= {"seed": draw(st.integers(0, 999)), "air_density": 1.2}
        wind["gust_field"] = ("point", "area_mean")[wind["seed"] % 2]
        wind["spectrum"] = draw(st.sampled_from(("davenport", "kaimal", "von_karman", "en1991")))
        wind["gust_length"] = 60.0  # m; a longer one lasts too many samples
        if chance(draw):
            wind["coherence_decay"] = [6.0, 12.0, 9.0]
    elif kind == "table":
        wind["file"] = "wind.csv"
        tables["wind.csv"] = table(columns | {"speed": map(number, speed * rng.uniform(0.5, 1.3, 9))})
    elif kind == "points":
        wind |= {"file": "wind.csv", "points": "points.csv"}
        place = rng.choice(len(net.points), int(rng.integers(2, 5)), replace=False)
        columns |= {f"p{k}": map(number, speed * rng.uniform(0.5, 1.3, 9)) for k in range(len(place))}
        tables["wind.csv"] = table(columns)
        tables["points.csv"] = table(
            {"name": [f"p{k}" for k in range(len(place))]}
            | {k: map(number, c) for k, c in zip("xyz", net.points[place].T)}
        )
    return wind


def coefficients(draw, wind: dict, rng, zones: list, tables: dict) -> None:
    """Draw pressure coefficients of the roof and of zones, or both by the wind direction."""
    if chance(draw, 3):
        of = ["pressure_coefficient", *zones[:1]]
        rows = [[direction, *rng.uniform(-2.0, -0.5, len(of))] for direction in (0.0, 90.0, 200.0)]
        text = "".join(",".join(map(number, row)) + "\n" for row in rows)
        tables["sectors.csv"] = ",".join(["direction", *of]) + "\n" + text
        wind |= {"sectors": "sectors.csv", "direction": float(rng.uniform(-180, 180))}
        return
    wind["pressure_coefficient"] = float(rng.uniform(-2.0, 2.0))
    if zones and chance(draw):
        wind["zone"] = {zones[-1]: {"pressure_coefficient": float(rng.uniform(-2.0, 2.0))}}


def draw_losses(draw, scene: dict, net: DrawnNet, columns: dict, rng, duration: float) -> list:
    """Draw [[remove]]: elements, and a group or a cable if there is one."""
    chosen = rng.choice(len(net.ids), 2, replace=False)
    when = lambda: float(rng.uniform(0.1, 0.6) * duration)
    fade = lambda: float(rng.uniform(0.05, 0.4) * duration)
    entries = [{"elements": [net.ids[chosen[0]]], "time": when()}]
    if chance(draw) and "thick" in net.groups and net.groups[chosen[0]] != "thick":
        entries.append({"group": "thick", "time": when()})
    elif "cable" in columns and columns["cable"][chosen[0]] != "back":
        entries.append({"cables": ["back"], "time": when()})
    else:
        entries.append({"elements": [net.ids[chosen[1]]], "time": when()})
    if scene["fading"]:
        for entry in entries:
            entry["duration"] = fade()
    return entries


def draw_motion(draw, net: DrawnNet, scene: dict, nodes: dict, rng, duration: float, tables: dict) -> list:
    """Draw [[motion]]: one end settles while one component shakes all supports, at once or as a wave."""
    held = net.held & ~sprung_nodes(net, scene, nodes)
    ids = np.array(net.names)[held].tolist()
    if not ids:
        return []
    time = np.linspace(0.0, 0.7 * duration, 6)
    size = 0.02 * SPACING
    columns = {"time": map(number, time)}
    columns |= {k: map(number, size * c) for k, c in zip("xz", np.outer([0.3, 1.0], time / time[-1]))}
    tables["move.csv"] = table(columns)
    first = {"nodes": ids[:1], "displacement": "move.csv"}
    a = np.append(0.0, rng.uniform(-1.0, 1.0, 5)) * size / duration**2 * 4
    if chance(draw):
        text = "made\nby hand\nIN UNITS OF G\nNPTS= 6, DT= " + number(0.2 * duration) + " SEC\n"
        tables["quake.AT2"] = text + " ".join(number(value / 9.81) for value in a) + "\n"
        second = {"acceleration": "quake.AT2", "baseline": chance(draw)}
    else:
        shape = {"time": map(number, 0.2 * duration * np.arange(6)), "acceleration": map(number, a)}
        tables["quake.csv"] = table(shape)
        second = {"acceleration": "quake.csv"}
    second |= {"direction": [1.0, 1.0, 0.0], "scale": 1.5, "nodes": ids}
    if chance(draw):
        second |= {"speed": 100.0 * SPACING / duration, "travel": [1.0, 0.5, 0.0]}
    return [first, second]


def sprung_nodes(net: DrawnNet, scene: dict, nodes: dict) -> np.ndarray:
    """Return which nodes (n,) the columns of nodes.csv put on springs."""
    if not scene["springs"]:
        return np.zeros(len(net.points), bool)
    nodes |= {f"spring_{k}": list(nodes[f"spring_{k}"]) for k in "xyz"}
    return np.array([value != number(0.0) for value in nodes["spring_x"]])


def draw_zones(draw, net: DrawnNet, nodes: dict) -> tuple[list, list]:
    """Draw [[zone]] entries; return them and the names of all zones."""
    entries, names = [], ["own"] if "zone" in nodes else []
    if chance(draw):
        low, middle, high = net.points[:, :2].min(0), np.median(net.points[:, 0]), net.points[:, :2].max(0)
        corners = [(low[0] - 1, low[1] - 1), (middle, low[1] - 1), (middle, high[1] + 1)]
        corners.append((low[0] - 1, high[1] + 1))
        polygon = [[float(a), float(b)] for a, b in corners]
        entries.append({"name": "west", "polygon": polygon, "cut": chance(draw)})
    if "thick" in net.groups and chance(draw):
        entries.append({"name": "thick", "groups": ["thick"]})
    return entries, [entry["name"] for entry in entries] + names


def draw_output(draw, scene: dict, net: DrawnNet, rng, duration: float) -> dict:
    """Draw [output]: rows and frames that divide the duration, or not."""
    keys = {
        "frames": draw(st.integers(1, 9)),
        "history_interval": duration / draw(st.sampled_from((5.0, 8.3, 20.0))),
        "energy": scene["energy"],
        "checkpoint_interval": duration / draw(st.sampled_from((2.5, 3.3, 6.1))),
    }
    if chance(draw):
        place = net.points[int(rng.integers(len(net.points)))]
        keys["probes"] = [net.names[0], [float(c) for c in place[:2]], [float(c) for c in place]]
        keys["elements"] = [net.ids[0], net.ids[-1]]
    return keys


@st.composite
def jobs(draw, scenes=SCENES) -> DrawnJob:
    """Draw a job of one of the scenes."""
    scene = draw(scenes)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    net, tables = draw_net(draw, scene, rng), {}
    form = draw(FORMS if scene["rests"] else LINEAR)
    cable, groups = draw_cables(draw, scene, tables)
    nodes = node_columns(draw, scene, net, rng)
    elements = element_columns(draw, scene, net, rng, form, "types.csv" in tables)
    zones, names = draw_zones(draw, net, nodes)
    subdivide = 2 if len(net.pairs) < 25 and chance(draw) else 1
    length = np.linalg.norm(net.points[net.pairs[:, 1]] - net.points[net.pairs[:, 0]], axis=1)
    dt = 0.5 * float(length.min()) / subdivide / SOUND
    duration = dt * draw(st.integers(40, 100))
    job = {
        "title": "drawn",
        "net": {"nodes": "nodes.csv", "elements": "elements.csv", "subdivide": subdivide},
        "cable": cable,
        "group": groups or None,
        "form_finding": form,
        "load": draw_load(draw, scene, rng, names),
        "roof": draw_roof(draw, net, tables),
        "zone": zones,
        "wind": draw_wind(draw, scene, net, rng, duration, names, tables) if scene["wind"] else None,
        "output": draw_output(draw, scene, net, rng, duration),
        "modes": {"count": 2} if chance(draw, 6) else None,
        "dynamics": draw_dynamics(draw, scene, dt, duration),
    }
    if scene["rests"] and chance(draw, 5):
        job["case"] = [{"name": "a", "set": {"load.snow": 3.0}}, {"name": "b", "set": {"load.pressure": 4.0}}]
    if scene["losses"]:
        job["remove"] = draw_losses(draw, scene, net, elements, rng, duration)
    if scene["motion"]:
        job["motion"] = draw_motion(draw, net, scene, nodes, rng, duration, tables)
    if scene["growing"] and (scene["wind"] or not scene["losses"]):
        job["load"]["ramp"] = 0.7 * duration
    if chance(draw, 5):
        job["net"]["unit"] = "cm"
        nodes |= {k: map(number, 100.0 * c) for k, c in zip("xyz", net.points.T)}
    tables |= {"nodes.csv": table(nodes), "elements.csv": table(elements)}
    return DrawnJob(
        {name: value for name, value in job.items() if value not in (None, [])},
        tables,
        scene,
        draw(st.sampled_from(("checkpoint", "pause"))),
        draw(st.sampled_from(((1, 3), (3, 1)))),
    )


def draw_dynamics(draw, scene: dict, dt: float, duration: float) -> dict:
    """Draw [dynamics]."""
    keys = {
        "duration": duration,
        "time_step": "auto" if chance(draw, 4) else dt,
        "mass_damping": draw(st.sampled_from((0.0, 0.8))),
        "fragments": scene["fragments"],
        "fragment_mass": draw(st.sampled_from((0.5, 0.05, 0.0))),
    }
    if scene["band"]:
        keys |= {"axial_damping_ratio": 0.005, "axial_damping_band": [1.0 / duration, 30.0 / duration]}
    if chance(draw, 4):
        keys["safety"] = 0.6
    if not (scene["fragments"] and scene["fracture"]) and chance(draw, 3):
        keys["mass_scaling"] = 0.05
    return keys
