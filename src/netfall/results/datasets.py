"""The table of datasets of a result file: what each is of, its unit and its meaning.

A file is labelled from it as it is closed, the page README.md beside and what Python prints are made from it.
Counted are n nodes, m elements, s load steps, t rows of the history, r losses, e fractures and ends, c
control points or taps, p probes, k others; p of /final are all particles, those that split off included.
"""

from fnmatch import fnmatchcase
from typing import NamedTuple

from netfall.ground.text_tables import rows_of
from netfall.record.columns import CELL_FIELDS, CELL_NUMBERS, HISTORY, NONE, POINT_FIELDS, POINT_NUMBERS

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


MOMENT = (
    "size >= 0, at start and end of each element; 0 at an end of a chain, nan: no bending. Where bars bend"
)
REACTION = "on what holds the nodes: of elements, and what acts on the node itself; 0 where nothing does"


def balance(many: str = "") -> str:
    """Rows of how reactions balance the loads in an equilibrium; many : the axis that counts equilibria."""
    return f"""
residual_sum | {f"{many}, 3" if many else "3"} | N | sum of the residual forces: with it the reactions balance
    the loads
force_balance_error | {many} | 1 | difference of the sums of reactions and loads along the axis where it is
    largest, as a share of the sum of absolute reactions, or of the largest tension if that is more
"""


def equilibrium(many: str = "") -> str:
    """Rows of what is kept of an equilibrium besides its state; many : the axis that counts equilibria."""
    return f"""
slip | {f"{many}, k" if many else "k"} | m | with `[[slide]]`: of the places of /slide
residual | {many} | N | largest residual force
{balance(many)}
slack | {many} | 1 | elements of cables without tension
iterations | {many} | 1 | of conjugate gradients, and of the relaxation where there was one
displacement_error | {many} | 1 | estimated, as a share of the largest displacement from the start; nan: no
    estimate
tension_error | {many} | 1 | estimated, as a share of the largest tension
relaxed | {many} | 1 | whether dynamic relaxation found it, and not Newton's method
stable | {many} | 1 | whether the tangent stiffness is positive definite; false: compressed bars buckle
"""


def columns(place: str, fields: tuple, shape: str = "") -> str:
    """Rows of what `record.columns` has; place : before their names"""
    return "\n".join(f"{place}{each.name} | {shape} | {each.unit} | {each.meaning}" for each in fields)


# A group: /name | what a job must ask for to have it | meaning. A dataset: name | shape | unit | meaning.
TABLE = f"""
/VTKHDF |  | the states over time, for ParaView; single precision
{columns("PointData/", POINT_FIELDS + POINT_NUMBERS)}
{columns("CellData/", CELL_FIELDS + CELL_NUMBERS)}
Points | | m | positions of the particles
Steps/Values | | s | times of the states
/form_finding | [form_finding], [[target]] | the form, its tensions and unstressed lengths
iterations | | 1 | of the relaxation
residual | | 1 | largest residual force, as a share of the largest prestress
residual_real_material | | 1 | the same with the real modulus and unstressed lengths
position | n, 3 | m | of the form
tension | m | N | of the form
unstressed_length | m | m | at the temperature of form finding
held | n, 3 | 1 | 1: an axis that is held in it rigidly, 0: free
reaction | n, 3 | N | on the foundation: pull of the elements and the load that the form carries, on held axes
{balance()}
self_stress | k, m | 1 | with `method = "keep"`: forces of each state, the largest is 1
target_change | k | m | with `[[target]]`: of each cable, a row for each target
target_influence | k, k | N/m | of these (axis 1) on targets (axis 0); of heights m/m
/deviation | [cable] length_deviation | with `[cable] length_deviation`: scatter by linear influence, in the
    form
tension_deviation | m | N | standard deviation
piece_effect | k | N | of a piece of cable_names: most that one deviation changes
/stages/* | [[stage]] | the equilibria of stages of erection, each from the last one
displacement | n, 3 | m | in the equilibrium, from the form, or the net as given
tension | m | N | in the equilibrium; 0 of what is not there
bending_moment | m, 2 | N m | {MOMENT}
active | m | 1 | 1: there, 0: not
held | n, 3 | 1 | 1: an axis that is held in it, 0: free, or no element is there
unstressed_length | m | m | at the temperature of form finding
reaction | n, 3 | N | on the foundation: pull of the elements and load, on held axes
{equilibrium()}
/statics | load steps ([load] steps > 0) | the load path
load_factor | s | 1 | 0: permanent loads alone; then the share of the rest
displacement | s, n, 3 | m | in equilibrium
tension | s, m | N | in equilibrium
bending_moment | s, m, 2 | N m | {MOMENT}
reaction | s, n, 3 | N | {REACTION}
{equilibrium("s")}
/cases/* | [[case]] | the equilibria of static cases
displacement | n, 3 | m | in the equilibrium
tension | m | N | in the equilibrium
bending_moment | m, 2 | N m | {MOMENT}
reaction | n, 3 | N | {REACTION}
{equilibrium()}
/rest | wind with onset = "static" | the rest under all constant loads and the mean wind, where dynamics
    begins
position | n, 3 | m | at rest
tension | m | N | at rest
bending_moment | m, 2 | N m | {MOMENT}
reaction | n, 3 | N | {REACTION}
{equilibrium()}
/slide | [[slide]] | places where a cable may slip over a node, in the order of cables
node | k | 1 | id in the tables
cable | k | | name of its piece of cable, by its first element
before | k | 1 | number of the element from which it runs to the node
after | k | 1 | of the one into which it goes on
friction | k | 1 | coefficient of friction
resistance | k | N | of the clamp
slip | t, k | m | with `[dynamics]`: at the rows of /history
difference | t, k | N | likewise: of the tensions after and before the place
stopped | k | s | likewise: when a strand was used up there; nan: not
/history | [dynamics] | energies, audits, counts and probes over time
{columns("", HISTORY, "t")}
probe_displacement | t, p, 3 | m | of the nodes that `[output] probes` names, or of those nearest to its
    places
probe_tension | t, k | N | of the elements that meet there
probe_particle | p | 1 | their numbers
probe_element | k | 1 | their numbers
element_tension | t, k | N | of `[output] elements`, all parts of those that are subdivided
element | k | 1 | their numbers
element_id | k | 1 | their ids in the tables
/envelope | [dynamics] | extremes over rows of the history, at least every 50 steps; of forces all steps if
    some may break
tension_max | m | N | 0 once broken off or lost
tension_max_time | m | s | of the first row that has it, or after the step that has it
tension_min | m | N | of all steps where members are lost, or bars stand in what may break
bending_moment_max | m | N m | the larger size at either end; nan: no bending. Where bars bend
slack_time | m | s | of cables; one that is slack in a row counts as slack since the row before
displacement_max | n | m | of the nodes; of what splits off nothing
displacement_max_time | n | s | of the first row that has it
/removal | [[remove]] | the loss of members, a row for each entry of `[[remove]]`; nan: its time is after the
    end
time | r | s | of the step at which the elements were lost
tension_before | r, m | N | at that step
tension_highest | r, m | N | of all steps from there to the next loss or the end, of what breaks up to that;
    0: broke before; nan: lost by then
tension_lowest | r, m | N | the same; nan also of what broke
tension_peak | r, m | N | of all steps from there to the next loss or the end, the value farthest from
    `tension_before` in the direction of `tension_after` (in either, where that is nan), and of what broke the
    highest; nan: lost by then
tension_after | r, m | N | at rest in the net without what was lost so far, under all constant loads and the
    mean wind, also where something breaks in that rest; nan: no rest
state | r | | what came of that rest: `equilibrium`; `breaks`: there is one, but elements are beyond their
    fracture strain in it; `unstable`; `no_equilibrium`; `undecided`; empty: nothing was lost
breaking_element | k | 1 | numbers of the elements that are beyond it
breaking_entry | k | 1 | the entry of each, from 0
dynamic_factor | r, m | 1 | (peak - before) / (after - before); nan where the loss changes the tension, that
    at rest or that of the moment, by less than 1e-3 of the largest, for what was lost or broke, and without a
    rest
element | k | 1 | numbers of the elements that were lost
entry | k | 1 | the entry of each, from 0
/events | [dynamics] | a row for each fracture and end
time | e | s |
step | e | 1 | number of the step, counted in `shortest_time_step` of /provenance
element | e | 1 | number of what broke
element_id | e | 1 | its id in the tables
particle | e | 1 | number of the one that it left
node_id | e | 1 | the id of its node
new_particle | e | 1 | that split off; -1: nothing split, at a loose end that carries nothing or without
    `fragments`
strain | e | 1 | at which it broke
mass | e | kg | of the new particle
/detached | fractures or losses that cut free more than 1 % of the moving mass | parts cut free from
    supports, of more than 1 % of the mass that can move: a row each, every 0.01 s
time | k | s |
node_id | k | 1 | id of a node in it, the first of the tables
mass | k | kg | with what hangs on it by broken elements
velocity | k, 3 | m/s | of the centre of mass, half a step before the time
largest_gust | | m/s | at any node until then; nan: not known
/wind | [wind] | the speeds that were generated or measured, or the pressures at taps
control_point | c, 3 | m | where histories are generated, or were measured
mean_speed | c | m/s |
time | t | s |
speed | t, c | m/s | the total speed
shape_coefficient | n | 1 | of each node, with its zone and the wind's direction
mean_pressure | n | N/m2 | of the mean wind; positive presses on the roof
gust_factor | c | 1 | largest of these speeds over the mean
negative_share | c | 1 | share of the speeds below zero
tap | c, 2 | m | in place of points and speeds where pressures at taps are given
pressure | t, c | N/m2 | at the taps
turbulence | | 1 | of generated gusts: intensity at 10 m that was asked for
variance_beyond | | 1 | share of the variance that the samples lack: above half of 1 / `wind.time_step`
variance_between | | 1 | share of the rest that linear interpolation between samples takes
spectrum_misfit | | 1 | of the model's spectrum, in the half octave farthest off (not of the slowest gusts)
coherence_error | 2 | 1 | difference of the correlation of two nodes from that of the coherence, root mean
    square over pairs more apart over the roof, and over pairs more apart in height; nan: there are none
gust_lengths | | 1 | how many of the spectrum's length pass in the duration
/load | [load] | the loads of the roof by node; each is there if the job has it
snow | n | N/m2 | in plan, with the values of zones
pressure | n | N/m2 | along the normal, positive presses on the roof; nan: given as [x, y, z]
temperature | | K | of all elements above that of form finding
/modes | [output] modes > 0 | with `[output] modes`: the lowest modes of the net where the dynamic stage
    begins
period | k | s | longest first; inf: no stiffness, nan: not stable
shape | k, n, 3 | 1 | the largest displacement is 1
effective_mass | k, 3 | 1 | share of the mass that moves along x, y, z
damping_ratio | k | 1 | share of the critical damping that `dynamics.damping` has
band_damping_ratio | k | 1 | that of `dynamics.damping_ratio`
air_damping_ratio | k | 1 | that of `wind.air_damping` at the mean wind
/final |  | the last state, exactly
particle_id | p | 1 | numbers, not ids of the tables; of what split off too
position | p, 3 | m |
velocity | p, 3 | m/s |
element_id | m | 1 | numbers, not ids of the tables
tension | m | N |
bending_moment | m, 2 | N m | {MOMENT}
plastic_strain | m | 1 |
/net |  | the net as it was built
particles | n, 3 | m | nodes as given
elements | m, 2 | 1 | numbers of the nodes at their ends
fixed | n, 3 | 1 | 1: held along this axis
angle | n | degrees | about z, of the axes of `fixed` and `spring`; where the tables give it
node_id | n | 1 | ids of the tables
element_id | m | 1 | ids of the tables
group | m | 1 | row of `group_names`
group_names | k | |
tributary_area | n | m2 | of the surface, by which dead load acts
plan_area | n | m2 | in plan, by which snow acts
vector_area | n, 3 | m2 | upward; pressure along the normal, wind and taps act by it
zone_share | n, k | 1 | of each node's area in each zone, where a zone is cut
zone | n | 1 | row of `zone_names`, that with most of its area; -1: none
zone_names | k | |
cable | m | 1 | row of `cable_names`: the piece of cable
cable_names | k | |
unstressed_length | m | m | at the temperature of form finding
unstressed_length_warm | m | m | at that of the loads, where that differs
axial_stiffness | m | N |
mass_per_length | m | kg/m |
expansion | m | 1/K | coefficient of thermal expansion
bar | m | 1 | 1: carries compression
spring | n, 3 | N/m | of elastic supports, where there are any
breaking_load | m | N | as given; inf: none. Where elements have one
yield_force | m | N | as given; inf: none. Where elements have one
fracture_strain | m | 1 | as given, that of the breaking load if that comes first; inf: none. Where elements
    have one
strength | m | 1 | drawn factor on these three, where there is one
second_moment | m | m4 | of bars; nan: none. Where elements have one, as the next four
buckling_length | m | m | of the table's element where none is given
euler_load | m | N | pi^2 E I / L_k^2; nan: without a second moment
buckling_curve | m | 1 | row of `buckling_curve_names`, of EN 1993-1-1
buckling_curve_names | k | |
bending | m | 1 | 1: part of a chain that resists bending. Where elements are
buckling | m | 1 | 1: carries at most its Euler's load. Where elements do
type | m | 1 | row of `type_names`; -1: none. Where elements have one
type_names | k | |
/provenance/net |  | what the tables of the same net need besides /net; a column of one value has a single row
load | n, 3 | N | of nodes
mass | n | kg | carried by nodes
area | n | m2 | of surface, as given; nan: from the faces
normal | n, 3 | 1 | as given; nan: from the faces
spring_rest | n, 3 | m | displacement at which elastic supports carry nothing
section | m | m2 | area of the cross-section
modulus | m | Pa |
density | m | kg/m3 |
yield_stress | m | Pa | inf: elastic
breaking_load | m | N | inf: none
fracture_strain | m | 1 | inf: never breaks
ring_start | k | 1 | first corner of each ring of a face; the last is their number
ring_corner | k | 1 | nodes at the corners of rings; from n on rows of `corners`
ring_face | k | 1 | the face that each ring is part of
corners | k, 3 | m | points of the rigid boundary without a node
"""


def _groups() -> tuple[Group, ...]:
    found: list[Group] = []
    for name, *cells in rows_of(TABLE):
        if name.startswith("/"):
            found.append(Group(name[1:], cells[1], cells[0], ()))
        else:
            found[-1] = found[-1]._replace(datasets=(*found[-1].datasets, Dataset(name, *cells)))
    return tuple(found)


GROUPS = _groups()


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
