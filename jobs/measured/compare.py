"""Measured structures beside netfall's answers: `python jobs/measured/compare.py [CASE ...]`.

Runs the jobs of this folder in each measured state through netfall's Python interface. Writes for each case
a table of all states and a picture to results/measured, and prints the deviations. Nothing is fitted,
but the stiffness of the strings. Takes some twenty minutes on one core; needs netfall[plot].
"""

import argparse
import csv
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import netfall

HERE = Path(__file__).parent
TOP, BOTTOM = slice(3, 6), slice(0, 3)  # joints of the simplex
MEMBERS = ["S1", "S2", "S3", "CB1", "CB2", "CB3", "CT1", "CT2", "CT3", "CV1", "CV2", "CV3"]
START = 0.75e-3  # m, lengthening of the struts at the start, which elements.csv holds
START_6B = 4.70e-3  # m, the same for test 6b
AUTHORS_LIMIT = 1.3  # kN on a joint; above it the joints of test 6a no longer meet in a point
SCALE, MARK, STRETCHED = 0.65, 614.0, 3.0  # m, string; mm, of the mark from the saddle, and its largest way
CHAIN, LINKS, CIRCLE = 33.0, 66, 0.2  # m, elements, m
UPPER_END = np.array([32.554, 3.3])  # m, centre of its circle
TWISTED = 13.5  # mm; the last forces of CV3 in test 5b are false beyond it


class Compared(NamedTuple):
    """One figure of one state: measured, calculated by the authors or by their formula, and netfall's."""

    case: str
    state: str
    quantity: str
    unit: str
    measured: float
    others: float
    ours: float
    counted: bool = True  # whether the authors hold the measurement for sound


def rows_of(name: str) -> list[dict[str, str]]:
    """Return the rows of a table of this folder."""
    with open(HERE / name, newline="") as f:
        return list(csv.DictReader(line for line in f if not line.startswith("#")))


def job_of(name: str) -> dict:
    """Return a job of this folder as a dict, with its tables found from anywhere."""
    job = tomllib.loads((HERE / f"{name}.toml").read_text())
    job["net"] = {key: str(HERE / value) for key, value in job["net"].items()}
    return job


# --- simplex


def lengthening(test: str, step: float) -> np.ndarray:
    """Return the change (12,) [m] of the members' free lengths at a step of a test, from the start."""
    change = dict.fromkeys(MEMBERS, 0.0)
    if test == "6b":
        change |= dict.fromkeys(("S1", "S2", "S3"), START_6B - START)
    elif test == "5g":
        level = step - 1.5  # kN above the start
        for kind, rate in {"S": 0.117, "CB": -0.223, "CT": -0.223, "CV": -0.384}.items():
            change |= {name: 1e-3 * rate * level for name in MEMBERS if name.rstrip("123") == kind}
    elif test != "6a":
        which = {"5a": ["CT3"], "5b": ["CV3"], "5c": ["S1"], "5d": ["CT"], "5e": ["CV"], "5f": ["S"]}[test]
        for name in MEMBERS:
            if name in which or name.rstrip("123") in which:
                change[name] = 1e-3 * step * (1.0 if name.startswith("S") else -1.0)
    return np.array([change[name] for name in MEMBERS])


def simplex_state(change: np.ndarray, load: float = 0.0, modes: int = 0) -> netfall.Result:
    """Run the simplex with changed free lengths (12,) [m] and a load [N] on each top joint."""
    job, nodes, elements = job_of("simplex"), rows_of("simplex/nodes.csv"), rows_of("simplex/elements.csv")
    weight = np.array([float(row["load_z"]) for row in nodes])
    weight[TOP] -= load
    job["net"] = netfall.Net(
        nodes=np.array([[float(row[axis]) for axis in "xyz"] for row in nodes]),
        elements=np.array([[int(row["start"]), int(row["end"])] for row in elements]),
        fixed=np.array([[row[f"fixed_{axis}"] == "1" for axis in "xyz"] for row in nodes]),
        groups=[row["group"] for row in elements],
        node_columns={"load_z": weight, "mass": [float(row["mass"]) for row in nodes]},
        element_columns={
            "unstressed_length": np.array([float(row["unstressed_length"]) for row in elements]) + change
        },
    )
    job["modes"]["count"] = modes
    return netfall.run(job)


def turns(x: np.ndarray) -> np.ndarray:
    """Compute the turn (3,) [degrees] of the top joints against the bottom ones, positions x (6, 3)."""
    arms = np.concatenate([x[k, :2] - x[k, :2].mean(0) for k in (BOTTOM, TOP)])
    angle = np.degrees(np.arctan2(arms[:, 1], arms[:, 0]))
    return (angle[TOP] - angle[BOTTOM]) % 360.0


def simplex_states(every: int = 1) -> Iterator[Compared]:
    """Yield forces, heights and turns of the states, or of each n-th one."""
    calculated = rows_of("simplex/calculated.csv")
    for row, other in list(zip(rows_of("simplex/measured.csv"), calculated))[::every]:
        test, step = row["figure"], float(row["step"])
        with simplex_state(lengthening(test, step), 1e3 * step if test in ("6a", "6b") else 0.0) as result:
            tension, x = 1e-3 * result.tension()[-1], result.frame(0.0).position
        ours = dict(zip([f"{name}_kN" for name in MEMBERS], tension))
        ours |= {f"H{k}_mm": 1e3 * (x[k, 2] - x[BOTTOM, 2].mean()) for k in (3, 4, 5)}
        ours |= dict(zip(("alpha3_deg", "alpha4_deg", "alpha5_deg"), turns(x)))
        sound = not (test == "6a" and step > AUTHORS_LIMIT) and not (test == "5b" and step > TWISTED)
        for name, value in ours.items():
            if not row[name]:  # not read, or not published
                continue
            quantity, _, unit = name.partition("_")
            state = f"{test} {row['step']}"
            yield Compared(
                "simplex", state, quantity, unit, float(row[name]), float(other[name]), value, sound
            )


def simplex_frequencies() -> Iterator[Compared]:
    """Yield the first frequency at each level of self-stress, with the struts as long as the level needs."""
    from scipy.optimize import brentq

    struts = np.array([name.startswith("S") for name in MEMBERS])
    for row in rows_of("simplex/modes.csv"):
        level = float(row["self_stress_kN"])

        def excess(longer: float, level: float = level) -> float:
            with simplex_state(longer * struts) as result:
                return -1e-3 * result.tension()[-1][struts].mean() - level

        longer = brentq(excess, -0.1e-3, 3e-3, xtol=1e-7)
        with simplex_state(longer * struts, modes=1) as result:
            ours = 1.0 / result.modes["period"][0]
        measured, lumped = float(row["measured_first_frequency_Hz"]), float(row["calculated_lumped_Hz"])
        yield Compared("simplex", f"self-stress {level} kN", "f1", "Hz", measured, lumped, ours)


# --- cord and tubes


def line(length: float, stubs: bool = False, segments: int = 100) -> netfall.Net:
    """Return a straight line of segments between held ends; stubs : one more held segment at each end."""
    ends = np.arange(-stubs, segments + 1 + stubs) * length / segments
    held = (ends < 1e-9) | (ends > length - 1e-9)
    number = np.arange(len(ends) - 1)
    x = np.stack([ends, np.zeros_like(ends), np.zeros_like(ends)], axis=1)
    return netfall.Net(nodes=x, elements=np.stack([number, number + 1], axis=1), fixed=held)


def frequencies(name: str, net: netfall.Net, **cable: float | bool | str) -> np.ndarray:
    """Return the frequencies [Hz] in one plane of a job with another net and other cable keys."""
    job = job_of(name) | {"net": net}
    job["cable"] |= cable
    with netfall.run(job) as result:
        return 1.0 / result.modes["period"][::2]


def cord_states(every: int = 1) -> Iterator[Compared]:
    """Yield the resonances of the planar run; the other figure is n / (2 L) sqrt(T / mass)."""
    known: dict[tuple[float, ...], np.ndarray] = {}
    for row in rows_of("cord/measured.csv")[::every]:
        mass, length, tension = (float(row[k]) for k in ("mass_per_length_kg_m", "length_m", "tension_N"))
        key = mass, length, tension
        if key not in known:
            known[key] = frequencies("cord", line(length), mass_per_length=mass, prestress=tension)
        mode = int(row["mode"])
        state = f"{row['cord']}, {length:.3f} m, {tension:.2f} N"
        figures = float(row["measured_planar_Hz"]), float(row["string_formula_Hz"]), known[key][mode - 1]
        yield Compared("cord", state, f"mode {mode}", "Hz", *figures, row["cord"] != "pink")


def straw_states(every: int = 1) -> Iterator[Compared]:
    """Yield first frequencies: without bending with that of a string, with bending with that of a beam."""
    for row in rows_of("straw/measured.csv")[::every]:
        length, tension = float(row["length_m"]), float(row["tension_N"])
        state, measured = f"{length:g} m, {tension:.2f} N", float(row["measured_Hz"])
        sound = length >= 0.473 and tension >= 1.9
        string = frequencies("straw", line(length), kind="cable", bending=False, prestress=tension)[0]
        yield Compared("straw", state, "string", "Hz", measured, float(row["string_Hz"]), string, False)
        beam = frequencies("straw", line(length, stubs=True), prestress=tension)[0]
        yield Compared(
            "straw", state, "with bending", "Hz", measured, float(row["stiff_clamped_Hz"]), beam, sound
        )


# --- strings and chain: with reservations


def fitted_stiffness(first: float, last: float) -> float:
    """Return EA [N] that leads from the tension [N] of the first frequency to that of the last.

    The tensions are those for the mass per length at the first; stretching draws mass over the nut.
    """
    stretch = STRETCHED / MARK
    stiffness = (last - first) / stretch
    for _ in range(50):
        stiffness = (last / (1.0 + stretch / (1.0 + first / stiffness)) - first) / stretch
    return stiffness


def string_states(every: int = 1) -> Iterator[Compared]:
    """Yield first frequencies over the stretch; the other figure is the string with a linear tension."""
    points: dict[str, list[dict[str, str]]] = {}
    for row in rows_of("string/measured.csv"):
        points.setdefault(row["string"], []).append(row)
    for row in rows_of("string/strings.csv")[::every]:
        mass, measured = float(row["mass_per_length_kg_m"]), points[row["string"]]
        first, last = (mass * (2 * SCALE * float(measured[k]["frequency_Hz"])) ** 2 for k in (0, -1))
        stiffness = fitted_stiffness(first, last)
        way = np.array([float(point["displacement_at_614mm_mm"]) for point in measured])
        strains = first / stiffness + way / MARK
        cable = dict(axial_stiffness=stiffness, mass_per_length=mass * (1.0 + first / stiffness))
        job = job_of("string") | {"net": side_by_side(strains), "modes": {"count": 2 * len(way)}}
        job["cable"] |= cable
        with netfall.run(job) as result:
            ours = np.sort(1.0 / result.modes["period"])[::2]  # twice each, below all second modes
        linear = np.sqrt((first + (last - first) * way / STRETCHED) / mass) / (2 * SCALE)
        for k, point in enumerate(measured):
            figures = float(point["frequency_Hz"]), linear[k], ours[k]
            state = f"{row['string']}, {way[k]:g} mm"
            yield Compared("string", state, row["set"], "Hz", *figures, 0.0 < way[k] < STRETCHED)


def side_by_side(strains: np.ndarray) -> netfall.Net:
    """Return a net with one string for each strain, which rises, so that their first frequencies rise."""
    one, count = line(SCALE), len(strains)
    return netfall.Net(
        nodes=np.concatenate([one.nodes + (0.0, 0.01 * k, 0.0) for k in range(count)]),
        elements=np.concatenate([one.elements + len(one.nodes) * k for k in range(count)]),
        fixed=np.tile(one.fixed, count),
        element_columns={
            "unstressed_length": np.repeat(SCALE / len(one.elements) / (1.0 + strains), len(one.elements))
        },
    )


def chain_net(end: np.ndarray, lying: int) -> netfall.Net:
    """Return the chain with its upper end (x, z) [m] and so many nodes, the anchor included, on the floor."""
    step, number = CHAIN / LINKS, np.arange(LINKS + 1)
    share = np.clip((number - lying + 1) / (LINKS + 1 - lying), 0.0, 1.0)
    x = np.where(number < lying, number * step, (lying - 1) * step * (1 - share) + end[0] * share)
    fixed = np.zeros((LINKS + 1, 3), bool)
    fixed[:, 1] = True
    fixed[:lying, 2] = True
    fixed[[0, -1]] = True
    return netfall.Net(
        nodes=np.stack([x, np.zeros_like(x), end[1] * share], axis=1),
        elements=np.stack([number[:-1], number[1:]], axis=1),
        fixed=fixed,
        element_columns={"unstressed_length": step},
    )


def chain_tension(end: np.ndarray, lying: int) -> tuple[float, int]:
    """Return the tension [N] at the upper end in equilibrium, and how many nodes lie on the floor then.

    lying : a guess of these; nodes that sink are laid down, the last one that is pulled up is freed
    """
    job = job_of("chain")
    link_weight = job["cable"]["mass_per_length"] * 9.81 * CHAIN / LINKS
    for _ in range(LINKS):
        with netfall.run(job | {"net": chain_net(end, lying)}) as result:
            tension, x = result.tension()[-1], result.frame(0.0).position
        rise = np.diff(x[:, 2]) / np.linalg.norm(np.diff(x, axis=0), axis=1)
        if x[lying, 2] < 0.0:
            lying += 1
        elif lying > 1 and tension[lying - 1] * rise[lying - 1] > link_weight:
            lying -= 1
        else:
            break
    return float(tension[-1]), lying


def chain_states(every: int = 1) -> Iterator[Compared]:
    """Yield mean and extremes of the equilibria around the circle; the others: a catenary."""
    tensions, lying = [], 20
    for angle in np.radians(np.arange(0.0, 360.0, 22.5 * every)):
        end = UPPER_END + CIRCLE * np.array([np.cos(angle), -np.sin(angle)])
        tension, lying = chain_tension(end, lying)
        tensions.append(tension)
    for row in rows_of("chain/measured.csv"):
        state = f"period {row['period_s']} s"
        for name, other, ours in (
            ("mean", 25.05, np.mean(tensions)),
            ("largest", 41.10, max(tensions)),
            ("smallest", 13.25, min(tensions)),
        ):
            # the motion in water makes the extremes
            yield Compared("chain", state, name, "N", float(row[f"{name}_N"]), other, ours, name == "mean")


CASES: dict[str, list[Callable[..., Iterator[Compared]]]] = {
    "simplex": [simplex_states, simplex_frequencies],
    "cord": [cord_states],
    "straw": [straw_states],
    "string": [string_states],
    "chain": [chain_states],
}


# --- output


def deviations(rows: list[Compared]) -> list[tuple[str, int, float, float, float, str]]:
    """Return for each kind of figure: number, rms and extremes of ours - measured, in % or the unit."""
    kinds: dict[str, list[float]] = {}
    units: dict[str, str] = {}
    for row in rows:
        if not row.counted:
            continue
        relative = row.unit in ("kN", "N", "Hz")
        test = row.state.split()[0] + " " if row.case == "simplex" and row.unit != "Hz" else ""
        what = {"kN": "forces", "mm": "heights", "deg": "turns"}.get(row.unit, row.quantity)
        name = f"{row.case} {test}{what}"
        difference = (row.ours - row.measured) / (0.01 * abs(row.measured) if relative else 1.0)
        kinds.setdefault(name, []).append(difference)
        units[name] = "%" if relative else row.unit
    return [
        (name, len(values), float(np.sqrt(np.mean(np.square(values)))), min(values), max(values), units[name])
        for name, values in kinds.items()
    ]


def draw(rows: list[Compared], path: Path) -> None:
    """Draw measured and computed figures of a case over one another, a panel for each unit."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    units = list(dict.fromkeys(row.unit for row in rows))
    figure, panels = plt.subplots(
        1, len(units), figsize=(4.2 * len(units), 4.2), layout="constrained", squeeze=False
    )
    for axes, unit in zip(panels[0], units):
        for counted, colour in ((True, "C0"), (False, "0.6")):
            chosen = [row for row in rows if row.unit == unit and row.counted == counted]
            label = "netfall" if counted else "netfall, not counted"
            style = dict(ls="", marker="o", ms=3, color=colour, label=label if chosen else None)
            axes.plot([abs(row.measured) for row in chosen], [abs(row.ours) for row in chosen], **style)
        ends = [f([abs(row.measured) for row in rows if row.unit == unit]) for f in (min, max)]
        axes.plot(ends, ends, color="k", lw=0.8, label="measured")
        axes.set(xlabel=f"measured [{unit}]", ylabel=f"netfall [{unit}]", title=f"{rows[0].case}, {unit}")
        axes.legend(fontsize=7)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    """Run the cases, write their tables and pictures, and print the deviations."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", nargs="*", choices=[*CASES, []], help="default: all")
    parser.add_argument("-o", dest="folder", type=Path, default=Path("results/measured"))
    wanted = parser.parse_args()
    wanted.folder.mkdir(parents=True, exist_ok=True)
    for name in wanted.case or CASES:
        rows = [row for states in CASES[name] for row in states()]
        with open(wanted.folder / f"{name}.csv", "w", newline="") as f:
            csv.writer(f).writerows([Compared._fields, *rows])
        draw(rows, wanted.folder / f"{name}.png")
        for what, count, rms, low, high, unit in deviations(rows):
            print(f"{what}: {count} figures, netfall less measured {rms:.2f} {unit} rms,", end=" ")
            print(f"{low:.2f} to {high:.2f} {unit}")


if __name__ == "__main__":
    main()
