"""The table of datasets of a result file: what each is of, its unit and its meaning.

A file is labelled from it as it is closed, the page README.md beside and what Python prints are made from it.
Counted are n nodes, m elements, s load steps, t rows of the history, r losses, e fractures and ends, c
control points or taps, p probes, k others; p of /final are all particles, those that split off included.
"""

from fnmatch import fnmatchcase
from typing import NamedTuple

from netfall.record.columns import CELL_FIELDS, CELL_NUMBERS, HISTORY, NONE, POINT_FIELDS, POINT_NUMBERS
from netfall.results.net_datasets import NET, OF_TABLES

ORDER = "order"  # attribute of a group that holds an equilibrium: its place among them


class Dataset(NamedTuple):
    """One dataset: its name in the group, what its axes count, its unit, its meaning."""

    name: str
    shape: str
    unit: str
    meaning: str


class Group(NamedTuple):
    """A group of the file: what it holds, what a job must ask for to have it, and its datasets."""

    name: str
    meaning: str
    lacking: str
    datasets: tuple[Dataset, ...]


row = Dataset


REACTION = "on what holds the nodes: of elements, and what acts on the node itself; 0 where nothing does"


def equilibrium(many: str = "") -> tuple[Dataset, ...]:
    """What is kept of an equilibrium besides its state; many : the axis that counts equilibria."""
    return (
        row("slip", f"{many}, k" if many else "k", "m", "with `[[slide]]`: of the places of /slide"),
        row("residual", many, "N", "largest residual force"),
        row("slack", many, NONE, "cables without tension"),
        row("iterations", many, NONE, "of conjugate gradients, and of the relaxation where there was one"),
        row(
            "displacement_error",
            many,
            NONE,
            "estimated, as a share of the largest displacement from the start; nan: no estimate",
        ),
        row("tension_error", many, NONE, "estimated, as a share of the largest tension"),
        row("relaxed", many, NONE, "whether dynamic relaxation found it, and not Newton's method"),
        row(
            "stable",
            many,
            NONE,
            "whether the tangent stiffness is positive definite; false: compressed bars buckle",
        ),
    )


def moments(many: str = "") -> Dataset:
    """Bending moments of equilibria, or of a state; many : the axis that counts equilibria."""
    meaning = "at both ends of each element; nan: no bending. Where bars bend"
    return row("bending_moment", f"{many}m, 2", "N m", meaning)


GROUPS = (
    Group(
        "VTKHDF",
        "the states over time, for ParaView; single precision",
        "",
        (
            *(
                row(f"PointData/{each.name}", "", each.unit, each.meaning)
                for each in POINT_FIELDS + POINT_NUMBERS
            ),
            *(
                row(f"CellData/{each.name}", "", each.unit, each.meaning)
                for each in CELL_FIELDS + CELL_NUMBERS
            ),
            row("Points", "", "m", "positions of the particles"),
            row("Steps/Values", "", "s", "times of the states"),
        ),
    ),
    Group(
        "form_finding",
        "the form, its tensions and unstressed lengths",
        "[form_finding], [[target]]",
        (
            row("iterations", "", NONE, "of the relaxation"),
            row("residual", "", NONE, "largest residual force, as a share of the largest prestress"),
            row("residual_real_material", "", NONE, "the same with the real modulus and unstressed lengths"),
            row("position", "n, 3", "m", "of the form"),
            row("tension", "m", "N", "of the form"),
            row("unstressed_length", "m", "m", "at the temperature of form finding"),
            row(
                "self_stress", "k, m", NONE, 'with `method = "keep"`: forces of each state, the largest is 1'
            ),
            row("target_change", "k", "m", "with `[[target]]`: of each cable, a row for each target"),
            row("target_influence", "k, k", "N/m", "of these (axis 1) on targets (axis 0); of heights m/m"),
        ),
    ),
    Group(
        "deviation",
        "with `[cable] length_deviation`: scatter by linear influence, in the form",
        "[cable] length_deviation",
        (
            row("tension_deviation", "m", "N", "standard deviation"),
            row("piece_effect", "k", "N", "of a piece of cable_names: most that one deviation changes"),
        ),
    ),
    Group(
        "stages/*",
        "the equilibria of stages of erection, each from the last one",
        "[[stage]]",
        (
            row("displacement", "n, 3", "m", "in the equilibrium, from the form, or the net as given"),
            row("tension", "m", "N", "in the equilibrium; 0 of what is not there"),
            moments(),
            row("active", "m", NONE, "1: there, 0: not"),
            row("held", "n, 3", NONE, "1: an axis that is held in it, 0: free, or no element is there"),
            row("unstressed_length", "m", "m", "at the temperature of form finding"),
            row("reaction", "n, 3", "N", "on the foundation: pull of the elements and load, on held axes"),
            *equilibrium(),
        ),
    ),
    Group(
        "statics",
        "the load path",
        "load steps ([load] steps > 0)",
        (
            row("load_factor", "s", NONE, "0: permanent loads alone; then the share of the rest"),
            row("displacement", "s, n, 3", "m", "in equilibrium"),
            row("tension", "s, m", "N", "in equilibrium"),
            moments("s, "),
            row("reaction", "s, n, 3", "N", REACTION),
            *equilibrium("s"),
        ),
    ),
    Group(
        "cases/*",
        "the equilibria of static cases",
        "[[case]]",
        (
            row("displacement", "n, 3", "m", "in the equilibrium"),
            row("tension", "m", "N", "in the equilibrium"),
            moments(),
            row("reaction", "n, 3", "N", REACTION),
            *equilibrium(),
        ),
    ),
    Group(
        "rest",
        "the rest under all constant loads and the mean wind, where dynamics begins",
        'wind with onset = "static"',
        (
            row("position", "n, 3", "m", "at rest"),
            row("tension", "m", "N", "at rest"),
            moments(),
            row("reaction", "n, 3", "N", REACTION),
            *equilibrium(),
        ),
    ),
    Group(
        "slide",
        "places where a cable may slip over a node, in the order of cables",
        "[[slide]]",
        (
            row("node", "k", NONE, "id in the tables"),
            row("cable", "k", "", "name of its piece of cable, by its first element"),
            row("before", "k", NONE, "number of the element from which it runs to the node"),
            row("after", "k", NONE, "of the one into which it goes on"),
            row("friction", "k", NONE, "coefficient of friction"),
            row("resistance", "k", "N", "of the clamp"),
            row("slip", "t, k", "m", "with `[dynamics]`: at the rows of /history"),
            row("difference", "t, k", "N", "likewise: of the tensions after and before the place"),
            row("stopped", "k", "s", "likewise: when a strand was used up there; nan: not"),
        ),
    ),
    Group(
        "history",
        "energies, audits, counts and probes over time",
        "[dynamics]",
        (
            *(row(each.name, "t", each.unit, each.meaning) for each in HISTORY),
            row(
                "probe_displacement",
                "t, p, 3",
                "m",
                "of the nodes that `[output] probes` names, or of those nearest to its places",
            ),
            row("probe_tension", "t, k", "N", "of the elements that meet there"),
            row("probe_particle", "p", NONE, "their numbers"),
            row("probe_element", "k", NONE, "their numbers"),
            row(
                "element_tension",
                "t, k",
                "N",
                "of `[output] elements`, all parts of those that are subdivided",
            ),
            row("element", "k", NONE, "their numbers"),
            row("element_id", "k", NONE, "their ids in the tables"),
        ),
    ),
    Group(
        "envelope",
        "extremes over rows of the history, at least every 50 steps; of forces all steps if some may break",
        "[dynamics]",
        (
            row("tension_max", "m", "N", "0 once broken off or lost"),
            row("tension_max_time", "m", "s", "of the first row that has it, or after the step that has it"),
            row(
                "tension_min",
                "m",
                "N",
                "of all steps where members are lost, or bars stand in what may break",
            ),
            row("bending_moment_max", "m", "N m", "at either end; nan: no bending. Where bars bend"),
            row(
                "slack_time",
                "m",
                "s",
                "of cables; one that is slack in a row counts as slack since the row before",
            ),
            row("displacement_max", "n", "m", "of the nodes; of what splits off nothing"),
            row("displacement_max_time", "n", "s", "of the first row that has it"),
        ),
    ),
    Group(
        "removal",
        "the loss of members, a row for each entry of `[[remove]]`; nan: its time is after the end",
        "[[remove]]",
        (
            row("time", "r", "s", "of the step at which the elements were lost"),
            row("tension_before", "r, m", "N", "at that step"),
            row(
                "tension_highest",
                "r, m",
                "N",
                "of all steps from there to the next loss or the end, of what breaks up to that; 0: broke "
                "before; nan: lost by then",
            ),
            row("tension_lowest", "r, m", "N", "the same; nan also of what broke"),
            row(
                "tension_peak",
                "r, m",
                "N",
                "of all steps from there to the next loss or the end, the value farthest from "
                "`tension_before` in the direction of `tension_after` (in either, where that is nan), and of "
                "what broke the highest; nan: lost by then",
            ),
            row(
                "tension_after",
                "r, m",
                "N",
                "at rest in the net without what was lost so far, under all constant loads and the mean "
                "wind, also where something breaks in that rest; nan: no rest",
            ),
            row(
                "state",
                "r",
                "",
                "what came of that rest: `equilibrium`; `breaks`: there is one, but elements are beyond "
                "their fracture strain in it; `unstable`; `no_equilibrium`; empty: nothing was lost",
            ),
            row("breaking_element", "k", NONE, "numbers of the elements that are beyond it"),
            row("breaking_entry", "k", NONE, "the entry of each, from 0"),
            row(
                "dynamic_factor",
                "r, m",
                NONE,
                "(peak - before) / (after - before); nan where the loss changes the tension, that at rest or "
                "that of the moment, by less than 1e-3 of the largest, for what was lost or broke, and "
                "without a rest",
            ),
            row("element", "k", NONE, "numbers of the elements that were lost"),
            row("entry", "k", NONE, "the entry of each, from 0"),
        ),
    ),
    Group(
        "events",
        "a row for each fracture and end",
        "[dynamics]",
        (
            row("time", "e", "s", ""),
            row("step", "e", NONE, "number of the step, counted in `shortest_time_step` of /provenance"),
            row("element", "e", NONE, "number of what broke"),
            row("element_id", "e", NONE, "its id in the tables"),
            row("particle", "e", NONE, "number of the one that it left"),
            row("node_id", "e", NONE, "the id of its node"),
            row(
                "new_particle",
                "e",
                NONE,
                "that split off; -1: nothing split, at a loose end that carries nothing or without "
                "`fragments`",
            ),
            row("strain", "e", NONE, "at which it broke"),
            row("mass", "e", "kg", "of the new particle"),
        ),
    ),
    Group(
        "wind",
        "the speeds that were generated or measured, or the pressures at taps",
        "[wind]",
        (
            row("control_point", "c, 3", "m", "where histories are generated, or were measured"),
            row("mean_speed", "c", "m/s", ""),
            row("time", "t", "s", ""),
            row("speed", "t, c", "m/s", "the total speed"),
            row("shape_coefficient", "n", NONE, "of each node, with its zone and the wind's direction"),
            row("mean_pressure", "n", "N/m2", "of the mean wind; positive presses on the roof"),
            row("gust_factor", "c", NONE, "largest of these speeds over the mean"),
            row("negative_share", "c", NONE, "share of the speeds below zero"),
            row("tap", "c, 2", "m", "in place of points and speeds where pressures at taps are given"),
            row("pressure", "t, c", "N/m2", "at the taps"),
            row("turbulence", "", NONE, "of generated gusts: intensity at 10 m that was asked for"),
            row(
                "variance_beyond",
                "",
                NONE,
                "share of the variance that the samples lack: above half of 1 / `wind.time_step`",
            ),
            row(
                "variance_between",
                "",
                NONE,
                "share of the rest that linear interpolation between samples takes",
            ),
            row("spectrum_misfit", "", NONE, "of the model's spectrum, in the half octave farthest off"),
            row("gust_lengths", "", NONE, "how many of the spectrum's length pass in the duration"),
        ),
    ),
    Group(
        "load",
        "the loads of the roof by node; each is there if the job has it",
        "[load]",
        (
            row("snow", "n", "N/m2", "in plan, with the values of zones"),
            row(
                "pressure",
                "n",
                "N/m2",
                "along the normal, positive presses on the roof; nan: given as [x, y, z]",
            ),
            row("temperature", "", "K", "of all elements above that of form finding"),
        ),
    ),
    Group(
        "modes",
        "with `[output] modes`: the lowest modes of the net where the dynamic stage begins",
        "[output] modes > 0",
        (
            row("period", "k", "s", "longest first; inf: no stiffness, nan: not stable"),
            row("shape", "k, n, 3", NONE, "the largest displacement is 1"),
            row("effective_mass", "k, 3", NONE, "share of the mass that moves along x, y, z"),
            row("damping_ratio", "k", NONE, "share of the critical damping that `dynamics.damping` has"),
            row("band_damping_ratio", "k", NONE, "that of `dynamics.damping_ratio`"),
            row("air_damping_ratio", "k", NONE, "that of `wind.air_damping` at the mean wind"),
        ),
    ),
    Group(
        "final",
        "the last state, exactly",
        "",
        (
            row("particle_id", "p", NONE, "numbers, not ids of the tables; of what split off too"),
            row("position", "p, 3", "m", ""),
            row("velocity", "p, 3", "m/s", ""),
            row("element_id", "m", NONE, "numbers, not ids of the tables"),
            row("tension", "m", "N", ""),
            moments(),
            row("plastic_strain", "m", NONE, ""),
        ),
    ),
    Group(
        "net",
        "the net as it was built",
        "",
        tuple(Dataset(*each) for each in NET),
    ),
    Group(
        "provenance/net",
        "what the tables of the same net need besides /net; a column of one value has a single row",
        "",
        tuple(Dataset(*each) for each in OF_TABLES),
    ),
)


def group_of(name: str) -> Group:
    """The row of a group of the file, "cases/snow" for one. Raises KeyError where there is none."""
    for group in GROUPS:
        if fnmatchcase(name, group.name) or name == group.name.partition("/")[0]:
            return group
    raise KeyError(f"no group /{name} in the table of datasets")


def unit_of(path: str) -> str:
    """The unit of a dataset by its path in the file; "" for texts. Raises KeyError where it has no row.

    Numbers by which VTK finds its way through /VTKHDF need no row.
    """
    group, _, name = path.rpartition("/")
    if path.startswith("VTKHDF/"):
        group, name = "VTKHDF", path.removeprefix("VTKHDF/")
    for each in group_of(group).datasets:
        if each.name == name:
            return each.unit
    if group == "VTKHDF":
        return NONE
    raise KeyError(f"/{path} has no row in the table of datasets")


def tables() -> str:
    """The groups and their datasets as a page shows them."""
    parts = []
    for group in GROUPS:
        rows = "".join(
            f"| `{each.name}`{f' ({each.shape})' if each.shape else ''} "
            f"| {'' if each.unit in (NONE, '') else each.unit} | {each.meaning} |\n"
            for each in group.datasets
        )
        title = group.name.replace("*", "NAME")
        meaning = group.meaning[0].upper() + group.meaning[1:]
        parts.append(f"### /{title}\n\n{meaning}.\n\n| dataset | unit | what |\n|---|---|---|\n{rows}")
    return "\n".join(parts)
