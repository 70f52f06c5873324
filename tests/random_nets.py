"""Random jobs from a seed that together use all features: the nets of `same_bits.py`.

Every job is a row of choices, one of each factor. Rows are chosen such that as many pairs of choices as
possible stand in some row. The choices that make numba compile the steps anew (KERNEL) come in few
combinations only, each of which serves several jobs.
"""

import itertools
import random
from dataclasses import dataclass, field

import numpy as np

KERNEL = {
    "strain": ("engineering", "logarithmic"),
    "wind": (True, False),
    "bars": (False, True),
    "sections": (False, True),
    "part_held": (False, True),
    "energy": (True, False),
    "fragments": (True, False),
    "lateral": (True, False),  # static loads along x and y
}
RUN = {
    "source": ("grid", "triangles", "web", "crossed", "saddle", "stadium"),
    "start": ("given", "fpm", "constant tension", "from force density", "force density"),
    "subdivide": (1, 2, 3),
    "wind_source": ("gusts", "steady", "table"),
    "after_fracture": ("particle", "all", "none"),
    "self_weight": (True, False),
    "dead": (0.0, 150.0),
    "pressure": ("none", "vector", "normal"),
    "steps": (0, 3),
    "fragment_mass": (0.05, 0.0, 0.3),
    "damping": (0.0, 0.8),
    "mass_scaling": (0.0, 0.05),
    "time_step": ("auto", "fixed"),
    "stop": ("never", "checkpoint", "walltime"),
    "probes": (0, 3),
    "tails": (False, True),  # chains that hang beside the net
    "prestresses": (False, True),  # columns of the tables from here on
    "densities": (False, True),
    "lengths": (False, True),
    "loads": (False, True),
    "masses": (False, True),
    "areas": (False, True),
    "element_ids": (False, True),
}
MATERIALS = ("ductile", "brittle", "plastic") * 4 + (
    "ductile",
    "ductile",
    "elastic",
)  # of the combinations of KERNEL
EARLY = {5: "statics", 11: "form finding"}  # where some of 18 jobs end, with a message: too few iterations
TRIES = 200  # rows of which the one with most new pairs is taken
AREA, MODULUS, DENSITY, PRESTRESS = 400e-6, 1.6e11, 7850.0, 50e3
YIELD = 2.4 * PRESTRESS / AREA
SOUND = (2.1e11 / DENSITY) ** 0.5  # m/s, of the stiffest elements


@dataclass
class RandomJob:
    """A job file's text, its tables by file name, and how a run of it is to be interrupted."""

    name: str
    choice: dict
    text: str
    tables: dict[str, str] = field(default_factory=dict)

    @property
    def variant(self) -> str:
        """The choices for which the steps are compiled."""
        return " ".join(str(self.choice[name]) for name in ("material", *KERNEL))


def random_jobs(count: int, seed: int) -> list[RandomJob]:
    """`count` jobs, functions of the seed, as far as possible the same for a larger count."""
    rng = random.Random(seed)
    pairs: set = set()
    variants = [covering_row(KERNEL, {"material": word}, pairs, rng, lambda row: row) for word in MATERIALS]
    jobs = []
    for k in range(count):
        given = variants[k % len(variants)] | {"early": EARLY.get(k % 18, "no")}
        row = covering_row(RUN, given, pairs, rng, settled)
        jobs.append(make_job(f"net-{k:02d}", row, np.random.default_rng([seed, k])))
    return jobs


def pairs_of(row: dict) -> set:
    """All pairs of choices in a row."""
    return set(itertools.combinations(sorted((name, str(value)) for name, value in row.items()), 2))


def covering_row(factors: dict, given: dict, pairs: set, rng: random.Random, settle) -> dict:
    """A row that begins with `given` and brings most pairs that are new; these are added to `pairs`."""
    rows = [
        settle(given | {name: rng.choice(values) for name, values in factors.items()}) for _ in range(TRIES)
    ]
    best = max(rows, key=lambda row: len(pairs_of(row) - pairs))
    pairs |= pairs_of(best)
    return best


def settled(row: dict) -> dict:
    """The row without choices that exclude each other; those of KERNEL stay."""
    row = dict(row)
    if row["part_held"] and row["source"] in ("saddle", "stadium"):
        row["source"] = "grid"
    if row["wind"] and row["source"] == "crossed":
        row["source"] = "web"
    if row["source"] in ("saddle", "stadium"):
        for name in ("tails", "prestresses", "densities", "lengths", "loads", "masses", "areas"):
            row[name] = False
    if row["source"] == "web" and row["start"] == "constant tension":
        row["source"] = "grid"  # rings of constant tension have no form
    if not row["wind"] and row["material"] != "elastic":
        row["steps"] = 0  # what statics carry breaks nothing afterwards
        row["pressure"] = "vector" if row["pressure"] == "none" else row["pressure"]
    if row["early"] == "form finding":
        row["source"], row["start"] = "grid", "fpm"
    if row["early"] == "statics":
        row["steps"], row["start"] = 3, "given"
    if row["source"] in ("triangles", "crossed") and row["start"] != "given":
        row["start"] = "force density"  # constant tension would draw triangles together
    if row["start"] != "given":
        row["lengths"] = False
    if row["start"] != "given" or row["steps"]:
        row["tails"] = False
    if not row["lateral"] or row["source"] == "crossed":
        row["pressure"] = "vector" if row["pressure"] == "normal" else row["pressure"]
    if row["lateral"] and row["pressure"] == "none" and not row["loads"]:
        row["pressure"] = "vector"
    if row["fragments"] and row["material"] in ("ductile", "brittle"):
        row["mass_scaling"] = 0.0
    if row["source"] == "stadium":
        row["time_step"] = "auto"  # its shortest elements are very short
    return row


# --- geometry: points (n, 3), pairs (m, 2), held (n,)


def grid(rng, crossed=False, most=8):
    """A jittered grid on a saddle; `crossed`: both diagonals of some cells as well, without a node."""
    a, b = (int(k) for k in rng.integers(4, 6 if crossed else most + 1, 2))
    number = np.arange(a * b).reshape(a, b)
    i, j = np.meshgrid(np.arange(a), np.arange(b), indexing="ij")
    held = ((i == 0) | (i == a - 1) | (j == 0) | (j == b - 1)).ravel()
    plan = 4.0 * np.column_stack([i.ravel(), j.ravel()]) + rng.uniform(-0.3, 0.3, (a * b, 2)) * ~held[:, None]
    middle = plan.mean(0)
    z = 0.02 * (plan[:, 0] - middle[0]) ** 2 - 0.02 * (plan[:, 1] - middle[1]) ** 2
    pairs = [
        *zip(number[:-1].ravel(), number[1:].ravel()),
        *zip(number[:, :-1].ravel(), number[:, 1:].ravel()),
    ]
    if crossed:
        for p, q, r, s in zip(
            *(c.ravel() for c in (number[:-1, :-1], number[1:, 1:], number[1:, :-1], number[:-1, 1:]))
        ):
            if rng.random() < 0.5:
                pairs += [(p, q), (r, s)]
    return np.column_stack([plan, z]), np.array(pairs), held


def triangles(rng):
    """A Delaunay net over jittered points, its hull and some points within held."""
    from scipy.spatial import Delaunay

    rows, columns = (int(k) for k in rng.integers(4, 8, 2))
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    plan = 4.5 * np.column_stack([(i + 0.5 * (j % 2)).ravel(), 0.87 * j.ravel()])
    plan += rng.uniform(-0.6, 0.6, plan.shape)
    mesh = Delaunay(plan)
    corners = mesh.simplices
    edges = np.unique(
        np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), 1), axis=0
    )
    held = np.zeros(len(plan), bool)
    held[mesh.convex_hull.ravel()] = True
    held |= rng.random(len(plan)) < 0.05
    middle = plan.mean(0)
    z = 4.0 - 0.01 * np.sum((plan - middle) ** 2, axis=1) + rng.uniform(-0.2, 0.2, len(plan))
    return np.column_stack([plan, z]), edges, held


def web(rng):
    """Spokes and rings around a hub, held at the outermost ring."""
    spokes, rings = int(rng.integers(6, 13)), int(rng.integers(2, 6))
    angle = 2 * np.pi * np.arange(spokes) / spokes
    points, pairs = [[0.0, 0.0, 1.0]], []
    at = lambda ring, k: 1 + (ring - 1) * spokes + k % spokes
    for ring, k in itertools.product(range(1, rings + 1), range(spokes)):
        r = 3.0 + 3.5 * ring
        points.append([r * np.cos(angle[k]), r * np.sin(angle[k]), 0.3 * ring * (-1) ** k])
        pairs += [(at(ring - 1, k) if ring > 1 else 0, at(ring, k)), (at(ring, k), at(ring, k + 1))]
    held = np.arange(len(points)) > (rings - 1) * spokes
    points = np.array(points)
    return points + rng.uniform(-0.2, 0.2, points.shape) * ~held[:, None], np.array(pairs), held


def with_tails(rng, points, pairs, held):
    """Two chains of three elements more that hang from supports, straight outward at first."""
    points, pairs, held = list(points), list(map(tuple, pairs)), list(held)
    middle = np.mean(points, axis=0)
    far = np.argsort([-np.hypot(*(p - middle)[:2]) if h else 0.0 for p, h in zip(points, held)])
    for support in far[:2]:
        outward = (points[support] - middle) * [1, 1, 0]
        last = support
        for _ in range(3):
            points.append(
                points[last] + 4.0 * outward / np.linalg.norm(outward) + [0, 0, rng.uniform(-0.5, 0)]
            )
            held.append(False)
            pairs.append((last, len(points) - 1))
            last = len(points) - 1
    return np.array(points), np.array(pairs), np.array(held)


# --- tables


def number(value) -> str:
    """A number as it stands in a table; nan gives an empty cell."""
    return "" if np.isnan(value) else repr(float(value))


def some(rng, values, share=0.7):
    """The values, some of them replaced by empty cells."""
    return np.where(rng.random(len(values)) < share, values, np.nan)


def table(columns: dict) -> str:
    """CSV text of columns of words."""
    return "\n".join([",".join(columns), *(",".join(row) for row in zip(*columns.values()))]) + "\n"


def make_tables(row: dict, rng) -> tuple[dict[str, str], float]:
    """nodes.csv and elements.csv of a row of choices, and the least length [m]."""
    kinds = {"grid": grid, "triangles": triangles, "web": web, "crossed": lambda r: grid(r, crossed=True)}
    points, pairs, held = kinds[row["source"]](rng)
    if row["tails"]:
        points, pairs, held = with_tails(rng, points, pairs, held)
    n = len(points)
    order = rng.permutation(len(pairs))
    pairs = pairs[order]
    flip = rng.random(len(pairs)) < 0.3
    pairs[flip] = pairs[flip][:, ::-1]
    ids = rng.permutation(np.arange(n) * 3 + 7)
    lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    nodes = {"id": [str(k) for k in ids]} | {k: map(number, c) for k, c in zip("xyz", points.T)}
    nodes |= node_columns(row, rng, held)
    elements = {"start": map(str, ids[pairs[:, 0]]), "end": map(str, ids[pairs[:, 1]])}
    elements |= element_columns(row, rng, lengths)
    return {"nodes.csv": table(nodes), "elements.csv": table(elements)}, float(lengths.min())


def node_columns(row: dict, rng, held) -> dict:
    """Supports, loads, masses and areas as the row wants them."""
    n = len(held)
    columns = {}
    if row["part_held"]:
        fixed = np.repeat(held[:, None], 3, 1)
        fixed[np.arange(n), rng.integers(0, 3, n)] |= rng.random(n) < 0.15
        inner = np.flatnonzero(~held)[0]
        fixed[inner] = [True, False, False]  # at least this one
        columns |= {f"fixed_{k}": map(str, c.astype(int)) for k, c in zip("xyz", fixed.T)}
    else:
        columns["fixed"] = map(str, held.astype(int))
    if row["loads"]:
        if row["lateral"]:
            columns["load_x"] = map(number, some(rng, rng.uniform(-4e3, 4e3, n)))
            columns["load_y"] = map(number, some(rng, rng.uniform(-2e3, 2e3, n)))
        columns["load_z"] = map(number, some(rng, rng.uniform(-3e3, 6e3, n)))
    if row["masses"] or row["tails"]:
        columns["mass"] = map(number, some(rng, rng.uniform(5.0, 200.0, n)))
    if row["source"] == "crossed":
        columns["area"] = map(number, rng.uniform(8.0, 16.0, n))
    elif row["areas"]:
        roof = ~held
        roof[n - 6 * row["tails"] :] = False  # wind has no normal at the tails
        columns["area"] = map(number, some(rng, np.where(roof, rng.uniform(8.0, 16.0, n), 0.0), 0.3))
    return columns


def element_columns(row: dict, rng, lengths) -> dict:
    """Groups, tensions, lengths and sections as the row wants them."""
    m = len(lengths)
    columns = {}
    if row["element_ids"]:
        columns["id"] = map(str, rng.permutation(m) * 2 + 100)
    groups = [""] + ["strut"] * row["bars"] + ["thick"] * row["sections"]
    share = [1.0 - 0.15 * (len(groups) - 1)] + [0.15] * (len(groups) - 1)
    if len(groups) > 1:
        words = rng.choice(groups, m, p=share)
        words[: len(groups)] = groups
        columns["group"] = words
    if row["prestresses"]:
        columns["prestress"] = map(number, some(rng, PRESTRESS * rng.uniform(0.97, 1.03, m)))
    if row["densities"]:
        columns["force_density"] = map(number, some(rng, PRESTRESS / lengths * rng.uniform(0.9, 1.1, m), 0.5))
    if row["lengths"]:
        columns["unstressed_length"] = map(number, some(rng, lengths / (1 + rng.uniform(-1e-3, 1.5e-3, m))))
    if row["sections"]:
        columns["area"] = map(number, some(rng, AREA * rng.uniform(1.0, 1.5, m), 0.3))
        columns["modulus"] = map(number, some(rng, rng.uniform(1.4e11, 1.9e11, m), 0.3))
    return columns


# --- the job file


def toml(value) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def section(name: str, keys: dict) -> str:
    """A section of a job file; keys that are None are left out."""
    return f"[{name}]\n" + "".join(f"{k} = {toml(v)}\n" for k, v in keys.items() if v is not None)


def make_job(name: str, row: dict, rng) -> RandomJob:
    """The job of a row of choices."""
    tables: dict[str, str] = {}
    if row["source"] == "saddle":
        cells = int(rng.integers(4, 8))
        net, shortest = dict(generator="saddle", side=4.0 * cells, rise=2.0, cells=cells), 4.0
    elif row["source"] == "stadium":
        net, shortest = dict(generator="stadium", length=40.0, width=30.0, arch_rise=5.0, spacing=4.3), 1.0
    else:
        tables, shortest = make_tables(row, rng)
        net = dict(nodes="nodes.csv", elements="elements.csv")
    dt = 0.3 * shortest / row["subdivide"] / SOUND  # s, stable also where form finding shortens elements
    duration = float(dt * (4000 if row["time_step"] == "fixed" else 8000))
    sections = [
        section("net", net | dict(subdivide=row["subdivide"])),
        cables(row, rng),
        form_finding(row),
        load(row, rng),
        wind(row, rng, duration, tables),
        dynamics(row, dt, duration),
        output(row, rng, duration),
    ]
    return RandomJob(name, row, f'title = "{name}"\n' + "".join(sections), tables)


def cables(row: dict, rng) -> str:
    """[cable] and its groups."""
    yields, breaks = row["material"] in ("ductile", "plastic"), row["material"] in ("ductile", "brittle")
    strain = float(YIELD / MODULUS * rng.uniform(1.05, 1.6))
    text = section(
        "cable",
        dict(
            modulus=MODULUS,
            area=AREA,
            density=DENSITY,
            prestress=PRESTRESS,
            yield_stress=YIELD if yields else None,
            fracture_strain=strain if breaks else None,
            strain=row["strain"],
        ),
    )
    generated = row["source"] in ("saddle", "stadium")
    thick = dict(area=1.4 * AREA, yield_stress=1.3 * YIELD if yields else None, modulus=1.5e11)
    if row["bars"]:
        sections = dict(density=7000.0) | (thick if generated and row["sections"] else {})
        text += section("cable.x" if generated else "cable.strut", dict(kind="bar") | sections)
    if row["sections"] and not (generated and row["bars"]):
        text += section("cable.y" if generated else "cable.thick", thick)
    return text


def form_finding(row: dict) -> str:
    """[form_finding], or nothing."""
    keys = {
        "given": None,
        "fpm": dict(modulus_factor=1e-3),
        "constant tension": dict(modulus_factor=0.0),
        "from force density": dict(start="force_density", modulus_factor=1e-3, tolerance=1e-7),
        "force density": dict(method="force_density"),
    }[row["start"]]
    if keys is None:
        return ""
    return section("form_finding", keys | (dict(max_iterations=5) if row["early"] != "no" else {}))


def load(row: dict, rng) -> str:
    """[load]: small where statics carry it, large where it acts at once."""
    size = float(rng.uniform(200.0, 400.0) if row["steps"] else rng.uniform(5000.0, 10000.0))
    pressure = {
        "none": None,
        "vector": [0.3 * size, -0.2 * size, size] if row["lateral"] else [0.0, 0.0, size],
        "normal": size,
    }[row["pressure"]]
    early = dict(max_iterations=5) if row["early"] == "statics" else {}
    keys = dict(self_weight=row["self_weight"], dead=row["dead"], pressure=pressure, steps=row["steps"])
    return section("load", keys | early)


def wind(row: dict, rng, duration: float, tables: dict[str, str]) -> str:
    """[wind], and its table where it comes from one."""
    if not row["wind"]:
        return ""
    speed = float(rng.uniform(80.0, 120.0))
    if row["wind_source"] == "table":
        times = np.linspace(0.0, 1.01 * duration, 12)
        speeds = speed * rng.uniform(0.5, 1.3, 12)
        tables["wind.csv"] = table({"time": map(number, times), "speed": map(number, speeds)})
    generated = row["wind_source"] != "table"
    keys = dict(
        speed=speed if generated else None,
        file=None if generated else "wind.csv",
        roughness=0.05 if row["wind_source"] == "gusts" else 0.0,
        shape_coefficient=float(rng.uniform(-3.0, -1.5)),
        base_height=20.0,
        time_step=duration / 17.0,
        control_points=9,
        seed=int(rng.integers(1000)),
        onset="sudden",  # the storms have no rest
        after_fracture=row["after_fracture"],
    )
    return section("wind", keys)


def dynamics(row: dict, dt: float, duration: float) -> str:
    """[dynamics]."""
    keys = dict(
        duration=duration,
        time_step="auto" if row["time_step"] == "auto" else float(dt),
        damping=row["damping"],
        fragment_mass=row["fragment_mass"],
        fragments=row["fragments"],
        mass_scaling=row["mass_scaling"],
    )
    return section("dynamics", keys)


def output(row: dict, rng, duration: float) -> str:
    """[output]: some rows and frames, which divide the duration and do not."""
    probes = [[float(p) for p in place] for place in rng.uniform(0.0, 16.0, (row["probes"], 2))]
    keys = dict(
        frames=int(rng.integers(3, 12)),
        history=duration / float(rng.choice([20.0, 33.3])),
        energy=row["energy"],
        probes=probes,
        checkpoint=duration / 5.5 if row["stop"] == "checkpoint" else 0.0,
    )
    return section("output", keys)
