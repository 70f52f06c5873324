"""Small nets drawn by seed, with every feature that takes part in a balance of forces, and their loads.

The net is a saddle of cables between supports, and next to it a cable over two saddles. The loads follow from
the job: areas times pressures, lengths times weights. netfall computes none of them.
"""

from dataclasses import dataclass, field

import numpy as np
from random_nets import number, table

from netfall.job.toml_text import toml_text

GRAVITY, AIR = 9.81, 1.25  # m/s2, kg/m3
SPACING, FORCE = 4.0, 20e3  # m, N
AREA, DENSITY, MODULUS = 2e-4, 7850.0, 1.6e11  # m2, kg/m3, Pa
BEAM_AREA, BEAM_DENSITY = 1e-2, 2000.0  # m2, kg/m3
FEATURES = (
    *("springs", "turned", "guided", "bars", "bending", "slide", "clamps", "lateral", "weight", "subdivided"),
    *("form", "loaded_form", "targets", "stages", "pulled", "taken_out", "moved", "held"),
    *("dead", "snow", "pressure", "temperature", "zone", "cases", "settlement", "static_wind", "tables"),
    *("combination", "band", "wind", "taps", "yield", "tight", "logarithmic"),
)
SHARE = {"slide": 0.2, "clamps": 0.8, "subdivided": 0.15, "tight": 0.3}  # of the jobs, of slow features


@dataclass
class LoadedNet:
    """Job as nested dicts, tables and features of a net, and the properties from which its loads follow.

    x : (n, 3) [m]; area : (n,) [m2]; normal : (n, 3); load : (n, 3) [N]; own : (n,) bool, in the zone "own"
    ends : (m, 2); group : (m,)
    """

    features: set
    job: dict = field(default_factory=dict)
    tables: dict = field(default_factory=dict)
    x: np.ndarray | None = None
    area: np.ndarray | None = None
    normal: np.ndarray | None = None
    load: np.ndarray | None = None
    own: np.ndarray | None = None
    ends: np.ndarray | None = None
    group: np.ndarray | None = None

    @property
    def text(self) -> str:
        """Return the text of the job file."""
        return toml_text(self.job)

    def weights(self, group: np.ndarray) -> np.ndarray:
        """Return the weight [N/m] of elements of these groups."""
        if "weight" not in self.features:
            return np.zeros(len(group))
        beam = group == "beam"
        section, density = np.where(beam, BEAM_AREA, AREA), np.where(beam, BEAM_DENSITY, DENSITY)
        return GRAVITY * section * density

    def given(self, key: str, changed: dict) -> tuple:
        """Return the value of a key of [load] for the roof, and that of the zone "own"."""
        load = self.job["load"]
        value = changed.get(f"load.{key}", load.get(key, 0.0))
        own = load.get("zone", {}).get("own", {}).get(key, value)
        return value, changed.get(f"load.zone.own.{key}", own)

    def of_roof(self, key: str, changed: dict) -> np.ndarray:
        """Return forces (n, 3) [N] of dead load, snow or pressure, with the values of a case or stage."""
        force, plan = np.zeros_like(self.x), self.area * np.abs(self.normal[:, 2])
        for value, here in zip(self.given(key, changed), (~self.own, self.own)):
            if key == "dead":
                each = [0.0, 0.0, -1.0] * np.outer(self.area, [value] * 3)
            elif key == "snow":
                each = [0.0, 0.0, -1.0] * np.outer(plan, [value] * 3)
            elif isinstance(value, list):
                each = np.outer(self.area, value)
            else:
                each = -value * self.area[:, None] * self.normal
            force += np.where(here[:, None], each, 0.0)
        return force

    def of_wind(self, speed: float, coefficient: float, x: np.ndarray, wind: dict) -> np.ndarray:
        """Return forces (n, 3) [N] of a steady wind on nodes at x (n, 3) [m]."""
        mean = speed * ((x[:, 2] + wind["base_height"]) / 10.0) ** wind["profile_exponent"]
        pressure = coefficient * 0.5 * AIR * mean**2
        return -(pressure * self.area)[:, None] * self.normal

    def of_steady_wind(self, x: np.ndarray) -> np.ndarray:
        """Return forces (n, 3) [N] of [wind], which has no gusts, on nodes at x (n, 3) [m]."""
        wind = self.job["wind"]
        if "taps" in self.features:
            pressure = float(self.tables["pressures.csv"].splitlines()[1].split(",")[1])
            return -pressure * self.area[:, None] * self.normal
        return self.of_wind(wind["speed"], wind["pressure_coefficient"], x, wind)


def loaded_net(seed: int) -> LoadedNet:
    """Return the net of a seed."""
    rng = np.random.default_rng([seed, 64])
    net = LoadedNet({name for name in FEATURES if rng.random() < SHARE.get(name, 0.45)})
    _without_what_excludes(net.features)
    nodes, elements = _geometry(net, rng)
    _supports(net, nodes, rng)
    n = len(net.x)
    load = rng.uniform(-300.0, 300.0, (n, 3)) * ([1, 1, 1] if "lateral" in net.features else [0, 0, 1])
    net.load = load + np.outer(nodes["weight"], [0.0, 0.0, -1.0])
    net.own = np.zeros(n, bool)
    if "zone" in net.features:
        net.own = (rng.random(n) < 0.4) & (net.area > 0.0)
        net.own[np.argmax(net.area)] = True
    _job(net, nodes, rng)
    each = lambda name, rows: {f"{name}_{k}": map(number, column) for k, column in zip("xyz", rows.T)}
    columns = {"id": range(10, 10 + n)} | {k: map(number, c) for k, c in zip("xyz", net.x.T)}
    columns |= {f"fixed_{k}": c.astype(int) for k, c in zip("xyz", nodes["fixed"].T)}
    columns |= each("load", net.load) | each("normal", net.normal) | {"area": map(number, net.area)}
    if nodes["spring"].any():
        columns |= each("spring", nodes["spring"])
    if nodes["angle"].any():
        columns["angle"] = map(number, nodes["angle"])
    if net.own.any():
        columns["zone"] = np.where(net.own, "own", "")
    start, end = (net.ends + 10).T
    net.tables["nodes.csv"] = table(columns)
    net.tables["elements.csv"] = table(
        {"start": start, "end": end, "group": net.group, "prestress": elements}
    )
    return net


def _without_what_excludes(has: set) -> None:
    """Remove features that exclude one another, or have no effect."""
    if "bending" in has:
        has -= {"form", "targets", "taken_out", "yield", "subdivided"}
    if "slide" in has:
        has -= {"yield", "targets", "turned", "subdivided", "band", "logarithmic"}  # refused, or slow
    if "bars" in has:
        has.discard("subdivided")  # a strut with a node in its middle is a mechanism
    if "subdivided" in has:
        has -= {"loaded_form", "held", "springs", "stages"}  # which take long
    if "yield" in has:
        has -= {"stages", "tight", "subdivided"}
    for name, needs in (
        *(("clamps", "slide"), ("loaded_form", "form"), ("guided", "turned"), ("targets", "form")),
        *(("pulled", "stages"), ("taken_out", "stages"), ("moved", "stages"), ("held", "stages")),
        *(("settlement", "cases"), ("static_wind", "cases"), ("tables", "cases"), ("combination", "cases")),
        ("taps", "wind"),
    ):
        if needs not in has:
            has.discard(name)


def _geometry(net: LoadedNet, rng) -> tuple[dict, list[str]]:
    """Make nodes, elements, areas, the properties of nodes for `_supports`, and the prestress of elements."""
    a, b = (int(k) for k in rng.integers(4, 6, 2))
    i, j = (rows.ravel() for rows in np.meshgrid(np.arange(a), np.arange(b), indexing="ij"))
    edge = (i == 0) | (i == a - 1) | (j == 0) | (j == b - 1)
    corner = ((i == 0) | (i == a - 1)) & ((j == 0) | (j == b - 1))
    plan = SPACING * np.column_stack([i, j]) + rng.uniform(-0.2, 0.2, (a * b, 2)) * ~edge[:, None]
    off = plan - plan.mean(0)
    points = [*np.column_stack([plan, 8.0 + 0.02 * (off[:, 0] ** 2 - off[:, 1] ** 2)])]
    at, pairs = np.arange(a * b).reshape(a, b), []
    of_beam = (j == 0) & ("bending" in net.features)
    for name, rows in (
        ("x", zip(at[:-1].ravel(), at[1:].ravel())),
        ("y", zip(at[:, :-1].ravel(), at[:, 1:].ravel())),
    ):
        for p, q in rows:
            beam, along_edge = of_beam[p] and of_beam[q], edge[p] and edge[q]
            pairs.append((p, q, "beam" if beam else "edge" if along_edge else name, 0.0 if beam else FORCE))
    held, weight = edge.copy(), []
    if "bending" in net.features:  # an edge beam, curved in plan and in elevation, in place of supports
        beam = (j == 0) & ~corner
        held &= ~beam
        for p in np.flatnonzero(beam):
            along = i[p] / (a - 1)
            points[p] = points[p] + np.array([0.0, -1.0, 0.6]) * 4.0 * along * (1.0 - along)
    inner = np.flatnonzero(~edge)

    def foot(p: int, by: list) -> int:
        points.append(points[p] + np.array(by))
        return len(points) - 1

    if "bars" in net.features:
        pairs.append((inner[0], foot(inner[0], [0.3, -0.2, -3.0]), "strut", 0.0))
    pairs.append((inner[-1], foot(inner[-1], [-2.0, 1.0, -5.0]), "stay", 0.1 * FORCE))
    ground = list(range(a * b, len(points)))
    held = np.append(held, [True] * len(ground))
    rope = []
    if "slide" in net.features:
        line = [(-12, 0), (0, 9), (9, 6.8), (18, 6.8), (27, 9), (40, 0)]
        rope = list(range(len(points), len(points) + len(line)))
        points += [np.array([x, SPACING * b + 6.0, z]) for x, z in line]
        pairs += [(p, p + 1, "rope", FORCE) for p in rope[:-1]]
        held = np.append(held, [True, True, False, False, True, True])
    net.x = np.array(points)
    n = len(net.x)
    net.ends = np.array([pair[:2] for pair in pairs])
    net.group = np.array([pair[2] for pair in pairs])
    net.area = np.zeros(n)
    net.area[: a * b] = np.where(edge, 0.5, 1.0) * SPACING**2 * rng.uniform(0.8, 1.1, a * b)
    normal = np.column_stack([rng.uniform(-0.3, 0.3, (n, 2)), np.ones(n)])
    net.normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    weight = np.zeros(n)
    weight[rope[2:4]] = rng.uniform(5e3, 15e3, len(rope[2:4]))
    nodes = {
        "held": held,
        "weight": weight,
        "rope": rope,
        "free": inner,
        "edge": np.flatnonzero(edge & ~corner),
    }
    return nodes, [number(pair[3]) for pair in pairs]


def _supports(net: LoadedNet, nodes: dict, rng) -> None:
    """Write fixed axes, springs and angles into the dict of the nodes."""
    n, edge = len(net.x), rng.permutation([p for p in nodes["edge"] if nodes["held"][p]])
    fixed, spring, angle = np.repeat(nodes["held"][:, None], 3, 1), np.zeros((n, 3)), np.zeros(n)
    if "springs" in net.features:
        spring[edge[:2]] = rng.uniform(1e6, 5e6, (2, 3))
        fixed[edge[:2]] = False
        fixed[edge[1], 2], spring[edge[1], 2] = True, 0.0
        if nodes["rope"]:
            last = nodes["rope"][-1]
            spring[last], fixed[last] = [4e6, 2e6, 0.0], [False, False, True]
    if "turned" in net.features:
        angle[edge[:4]] = rng.uniform(-180.0, 180.0, len(edge[:4]))
        if "guided" in net.features:  # held along one own axis, and a spring along the other
            fixed[edge[2], :2], spring[edge[2], :2] = [True, False], [0.0, 3e6]
    nodes |= {"fixed": fixed, "spring": spring, "angle": angle}


def _job(net: LoadedNet, nodes: dict, rng) -> None:
    """Make the sections of the job."""
    has, between = net.features, lambda low, high: float(rng.uniform(low, high))
    cable = {
        "modulus": MODULUS,
        "area": AREA,
        "density": DENSITY,
        "prestress": FORCE,
        "thermal_expansion": 1.2e-5,
    }
    groups: dict = {}
    cable["strain_measure"] = "logarithmic" if "logarithmic" in has else "engineering"
    if "yield" in has:
        cable["yield_stress"] = between(1.2, 2.0) * FORCE / AREA
    if "bars" in has:
        groups["strut"] = {"kind": "bar"} | ({"yield_stress": 1e12} if "yield" in has else {})
    if "bending" in has:
        groups["beam"] = {"kind": "bar", "area": BEAM_AREA, "density": BEAM_DENSITY}
        groups["beam"] |= {"second_moment": between(3e-4, 1e-3), "bending": True}
    load = {
        "self_weight": "weight" in has,
        "steps": int(rng.integers(1, 3)),
        "max_iterations": 200 if "slide" in has else 3000,
    }
    load["tolerance"] = 1e-10 if "tight" in has else 1e-6
    load |= {"dead": between(20.0, 150.0)} if "dead" in has else {}
    load |= {"snow": between(50.0, 300.0)} if "snow" in has else {}
    load |= {"temperature": between(-30.0, 30.0)} if "temperature" in has else {}
    if "pressure" in has:
        size = between(-200.0, 200.0)
        load["pressure"] = size if rng.random() < 0.5 else [0.3 * size, -0.2 * size, size]
    if "zone" in has:
        load["zone"] = {"own": {"snow": between(0.0, 300.0), "dead": between(0.0, 100.0)}}
    net.job = {
        "title": "loaded",
        "net": {"nodes": "nodes.csv", "elements": "elements.csv"},
        "cable": cable,
        "group": groups,
        "load": load,
    }
    if "subdivided" in has:
        net.job["net"]["subdivide"] = 2
    if "form" in has:
        net.job["form_finding"] = {"method": ["fpm", "force_density"][int(rng.integers(2))]}
        if "turned" in has:
            net.job["form_finding"]["method"] = "fpm"
        net.job["form_finding"]["tolerance"] = 1e-8 if "tight" in has else 1e-6
        if net.job["form_finding"]["method"] == "fpm":
            net.job["form_finding"]["modulus_factor"] = 1e-2
        if "loaded_form" in has:
            net.job["form_finding"]["loads"] = "permanent"
    if "targets" in has:
        net.job["target"] = [{"group": "stay", "force": 0.15 * FORCE, "adjust": "stay"}]
    if "slide" in has:
        rope = [p + 10 for p in nodes["rope"]]
        friction = [0.0, 0.1, 0.3][int(rng.integers(3))]
        net.job["slide"] = [{"group": "rope", "nodes": [rope[1], rope[-2]], "friction": friction}]
        if "clamps" in has:
            net.job["slide"].append({"group": "rope", "nodes": rope[2:4], "slip_resistance": 40e3})
    if "stages" in has:
        net.job["stage"] = _stages(net, nodes, rng)
    if "cases" in has:
        _cases(net, nodes, rng)
    if has & {"wind", "band"}:
        net.job["dynamics"] = {"duration": 2e-3, "mass_damping": 0.5}
        net.job["output"] = {"frames": 1}
    if "band" in has:
        net.job["dynamics"] |= {"axial_damping_ratio": between(0.005, 0.08), "axial_damping_band": [0.3, 9.0]}
    if "wind" in has:
        net.job["wind"] = {"onset": "static", "ramp": 0.0, "after_fracture": "particle"}
        if "taps" in has:
            pressure = between(-150.0, 150.0)
            net.tables["pressures.csv"] = table({"time": ["0", "9"], "t": [number(pressure)] * 2})
            net.tables["taps.csv"] = table({"name": ["t"], "x": ["3"], "y": ["4"]})
            net.job["wind"] |= {"pressures": "pressures.csv", "taps": "taps.csv"}
        else:
            net.job["wind"] |= {"speed": between(5.0, 15.0), "surface_drag": 0.0, "gust_field": "point"}
            net.job["wind"] |= {"profile_exponent": [0.0, 0.2][int(rng.integers(2))], "base_height": 6.0}
            net.job["wind"]["pressure_coefficient"] = between(-1.5, 1.5)


def _stages(net: LoadedNet, nodes: dict, rng) -> list[dict]:
    """Make [[stage]]: lengths, forces, active groups, held and moved nodes, loads."""
    has, groups = net.features, sorted(set(net.group))
    first, second, third = ({"name": name} for name in ("one", "two", "three"))
    first["lengths"] = {"x": {"change": float(rng.uniform(-0.004, 0.004))}}
    second["set"] = {"load.snow": float(rng.uniform(0.0, 200.0))}
    if "temperature" in has:
        second["set"]["load.temperature"] = float(rng.uniform(-20.0, 20.0))
    if "taken_out" in has:
        first["active"] = [name for name in groups if name != "stay"]
        second["active"] = groups
    if "pulled" in has:
        second["lengths"] = {"stay": {"force": float(rng.uniform(0.2, 0.5)) * FORCE}}
    if "held" in has:
        first["hold"], third["release"] = [int(nodes["free"][0]) + 10], [int(nodes["free"][0]) + 10]
    if "moved" in has:
        whole = nodes["fixed"].all(1) & (np.arange(len(net.x)) != nodes["edge"][0])
        p = int(rng.choice([p for p in nodes["edge"] if whole[p]]))
        second["move"] = {str(p + 10): rng.uniform(-0.02, 0.02, 3).tolist()}
    if "clamps" in has:
        second["clamps"], third["clamps"] = "open", "closed"
    return [first, second, third]


def _cases(net: LoadedNet, nodes: dict, rng) -> None:
    """Make [[case]] and [[combination]]."""
    has, between = net.features, lambda low, high: float(rng.uniform(low, high))
    cases = [{"name": "snow", "set": {"load.snow": between(50.0, 300.0)}}]
    cases.append({"name": "warm", "set": {"load.temperature": between(-25.0, 25.0)}})
    cases.append({"name": "pressed", "set": {"load.pressure": between(-200.0, 200.0)}})
    if "zone" in has:
        cases[0]["set"]["load.zone.own.snow"] = between(50.0, 300.0)
    if "settlement" in has:
        able = (nodes["fixed"] | (nodes["spring"] > 0.0)).all(1)
        able &= (nodes["angle"] == 0.0) | nodes["fixed"][:, :2].all(1)  # others settle along z only
        p = int(rng.choice([p for p in nodes["edge"] if able[p]]))
        cases.append({"name": "sunk", "settlement": {str(p + 10): rng.uniform(-0.02, 0.02, 3).tolist()}})
    if "static_wind" in has:
        wind = {"speed": between(5.0, 15.0), "pressure_coefficient": between(-1.2, 1.2), "base_height": 6.0}
        wind |= {"profile_exponent": 0.2, "direction": between(-180.0, 180.0), "pressure_factor": 1.5}
        cases.append({"name": "blown", "set": {f"wind.{key}": value for key, value in wind.items()}})
    if "tables" in has:
        pressure = between(-150.0, 150.0)
        columns = {"x": ["0", "9"], "y": ["0", "9"], "pressure": [number(pressure)] * 2}
        net.tables["case.csv"] = table(columns)
        cases.append({"name": "mapped", "pressure_table": "case.csv"})
    if "slide" in has:  # slow in plain Python
        cases = [cases[k] for k in sorted(rng.choice(len(cases), 2, replace=False))]
    net.job["case"] = cases
    if "combination" in has:
        factors = {each["name"]: between(0.3, 1.5) for each in cases}
        factors |= {"permanent": between(0.9, 1.35), "load": between(0.0, 1.2)}
        if "temperature" not in has or "stages" not in has:
            factors["prestress"] = between(0.95, 1.1)
        net.job["combination"] = [{"name": "all", "factors": factors}]


def case_load(net: LoadedNet, case: dict, x: np.ndarray) -> np.ndarray:
    """Return forces (n, 3) [N] of the wind and of the load table of a case."""
    force, changed = np.zeros_like(net.x), case.get("set", {})
    wind = {key.partition(".")[2]: value for key, value in changed.items() if key.startswith("wind.")}
    if wind:
        force += wind["pressure_factor"] * net.of_wind(wind["speed"], wind["pressure_coefficient"], x, wind)
    if "pressure_table" in case:
        pressure = float(net.tables["case.csv"].splitlines()[1].split(",")[2])
        force += -pressure * net.area[:, None] * net.normal
    return force
