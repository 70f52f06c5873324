"""Datasets of a result file with units and meanings, and the outcomes of a run that a study records.

netfall writes these units into each file when it closes the file. The Python help and the page on the result
file are generated from this table.

A row of the table that starts with "/" is a group: name, meaning, the part of a job that requests it. The
rows below it are its datasets: name, shape, unit, meaning. In shapes, n, m, s, t, c and p count particles,
elements, load steps, times, control points and probes.
"""

import functools
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from netfall.core.text import table_rows
from netfall.explicit.history_columns import COLUMNS

BENDING = """size of the bending moment (>= 0) at start and end of each element; 0 at an end of a chain, nan
    without bending. Only with bending chains"""
FORCE_BALANCE = """sum of reactions less sum of loads, along the axis with the largest difference, as a share
    of
    the sum of absolute reactions or of the largest tension, whichever is larger"""
HISTORY = "\n".join(f"{column.name} | t | {column.unit} | {column.meaning}" for column in COLUMNS)


def equilibrium(steps: str = "") -> str:
    """Return the rows on slip and on the solution of an equilibrium. steps : "s" for load steps"""
    several = f"{steps}, " if steps else ""
    return f"""slip | {several}k | m | with `[[slide]]`: slip at each slip point of `/slide`
slip_force | {several}k | N | with `[[slide]]`: force that the slip resistance holds, the difference of
    tension at the slip point; nan: no equilibrium
residual | {steps} | N | largest residual force
residual_sum | {several}3 | N | sum of the residual forces; the reactions balance the loads together with it
force_balance_error | {steps} | | {FORCE_BALANCE}
slack | {steps} | | number of slack cable elements
iterations | {steps} | | iterations of conjugate gradients, and of dynamic relaxation if it was needed
displacement_error | {steps} | | estimated error, as a share of the largest displacement from the start; nan:
    no estimate
tension_error | {steps} | | estimated error, as a share of the largest tension
relaxed | {steps} | | 1: found by dynamic relaxation, 0: by Newton's method
stable | {steps} | | 1: the tangent stiffness is positive definite; 0: compressed bars buckle"""


SEPARATE_EQUILIBRIUM = f"""displacement | n, 3 | m | displacement in equilibrium
tension | m | N | axial force in equilibrium
bending_moment | m, 2 | N m | {BENDING}
reaction | n, 3 | N | force on supports: pull of the elements and load of the node; 0 at free nodes
load | n, 3 | N | load on each node, also on supports: self weight and all other loads, with the factors of a
    combination
{equilibrium()}"""

DATASETS = f"""
/VTKHDF | States over time for ParaView, in single precision, one after the other. In Python,
    `result.tension(element=17)` returns the history of one element. |
PointData/displacement | | m | displacement from the form or the net as given, or from the last stage of
    erection
PointData/velocity | | m/s | velocity
PointData/node_id | | | id in the tables
PointData/GlobalPointId | | | row of `/net`, the same on any number of ranks
CellData/tension | | N | axial force
CellData/strain | | | axial strain
CellData/plastic_strain | | | plastic part of the strain
CellData/broken | | | 1 after the fracture or the removal; 2: taken out by a stage of erection
CellData/bending_moment | | N m | {BENDING}
CellData/group | | | number of the group, as in `/net/group`
CellData/element_id | | | id in the tables
CellData/GlobalCellId | | | row of `/net`, the same on any number of ranks
Points | | m | positions of the particles
Steps/Values | | s | times of the states
/form_finding | Form-found geometry, its tensions and unstressed lengths. | [form_finding], [[target]]
iterations | | | iterations of conjugate gradients or of the relaxation
residual | | | largest residual force, as a share of the largest prestress
residual_real_material | | | the same with the real modulus and unstressed lengths
position | n, 3 | m | position in the form-found geometry
tension | m | N | axial force in the form-found geometry
unstressed_length | m | m | at the temperature of form finding
held | n, 3 | | 1: an axis that is held rigidly, 0: a free axis
reaction | n, 3 | N | force on the foundation along held axes: pull of the elements and load that the form
    carries
residual_sum | 3 | N | sum of the residual forces; the reactions balance the loads together with it
force_balance_error | | | {FORCE_BALANCE}
self_stress | k, m | | with `method = "given_geometry"`: forces of each state of self-stress, the largest is 1
target_change | k | m | with `[[target]]`: change of length of each cable, one row for each target
target_influence | k, k | N/m | influence of these changes (axis 1) on the targets (axis 0); m/m for heights
/deviation | Linear scatter of forces in the form by errors of length; nan: unknown. | [cable] length_std
tension_deviation | m | N | standard deviation of the tension
piece_effect | k | N | largest change of a tension by one standard deviation of each cable of `cable_names`
/stages/NAME | Equilibria of the stages of erection, each from the one before. | [[stage]]
displacement | n, 3 | m | displacement from the form-found geometry, or from the net as given
tension | m | N | axial force; 0 in elements that are absent
bending_moment | m, 2 | N m | {BENDING}
active | m | | 1: the element is present, 0: absent
held | n, 3 | | 1: a held axis; 0: a free axis, or a node without elements
unstressed_length | m | m | at the temperature of form finding
reaction | n, 3 | N | force on the foundation along held axes: pull of the elements and load of the node
{equilibrium()}
/statics | Equilibria along the load path. | load steps ([load] steps > 0)
load_factor | s | | 0: permanent loads alone; then the share of the other loads
displacement | s, n, 3 | m | displacement in equilibrium
tension | s, m | N | axial force in equilibrium
bending_moment | s, m, 2 | N m | {BENDING}
reaction | s, n, 3 | N | force on supports: pull of the elements and load of the node; 0 at free nodes
{equilibrium("s")}
/permanent | Equilibrium under the permanent loads, in which the static cases begin. | \
[[case]] or [[combination]]
{SEPARATE_EQUILIBRIUM}
/cases/NAME | Equilibria of static cases and combinations. | [[case]] or [[combination]]
{SEPARATE_EQUILIBRIUM}
/initial_state | Equilibrium under all constant loads and the mean wind, where the dynamic stage begins. | \
wind with onset = "static", or [[remove]] without wind
position | n, 3 | m | position in equilibrium
tension | m | N | axial force in equilibrium
bending_moment | m, 2 | N m | {BENDING}
reaction | n, 3 | N | force on supports: pull of the elements and load of the node; 0 at free nodes
{equilibrium()}
/slide | Slip points, where a cable may slip over a node, in the order of cables. | [[slide]]
node | k | | id in the tables
cable | k | | name of the cable
before | k | | row of the element that runs to the node
after | k | | row of the element that continues behind the node
friction | k | | coefficient of friction
resistance | k | N | slip resistance of the clamp
slip | t, k | m | with `[dynamics]`: slip at the rows of `/history`
difference | t, k | N | with `[dynamics]`: tension behind the node less tension before it
stopped | k | s | with `[dynamics]`: time at which a free segment was used up; nan: never
/history | Energies, energy checks, counts and probes over time. | [dynamics]
{HISTORY}
probe_displacement | t, p, 3 | m | displacement, as in `/VTKHDF`, of the nodes that `[output] probes` names,
    or of the nodes nearest to its places
probe_tension | t, k | N | axial force of the elements that meet at the probes
probe_particle | p | | rows of the nodes
probe_element | k | | rows of the elements
element_tension | t, k | N | axial force of `[output] elements`, all parts of subdivided ones
element | k | | rows of these elements
element_id | k | | their ids in the tables
/envelope | Extremes over rows of the history and at least every 50 steps; axial forces and reactions over all
    steps if elements can yield or break, loads act at once or supports move. Rows h apart miss up to 1 -
    cos(pi h / T) of the amplitude of a vibration of the period T: 19 % with 0.01 s and 20 Hz. | [dynamics]
tension_max | m | N | largest axial force; in rows of the history also of the remainder of a broken element
tension_max_time | m | s | time of the first row, or end of the step, with this force
tension_min | m | N | smallest axial force; with bars over the same steps as the largest, and if members are
    removed
bending_moment_max | m | N m | larger moment of the two ends; nan without bending. Only with bending chains
slack_time | m | s | time in which a cable was slack; a cable that is slack in a row counts from the row
    before
displacement_max | n | m | largest displacement of a node, as in `/VTKHDF`; fragments do not count
displacement_max_time | n | s | time of the first row with this displacement
reaction_max | n | N | largest magnitude of the reaction, without inertia of the node, over the same steps as
    the largest axial force
reaction_max_time | n | s | time of the step or row with this reaction
reaction_highest | n, 3 | N | highest components, with sign
reaction_lowest | n, 3 | N | lowest components
/removal | Member removal, one row for each entry of `[[remove]]`; nan: its time is after the end. |
    [[remove]]
time | r | s | time of the step at which the elements were removed
tension_before | r, m | N | axial force at that step
tension_highest | r, m | N | largest axial force of all steps until the next removal or the end, up to a
    fracture; 0: broken before; nan: removed
tension_lowest | r, m | N | smallest axial force of the same steps; nan also for broken elements
tension_peak | r, m | N | axial force of the same steps that is farthest from `tension_before` in the
    direction of `tension_after` (in either direction if that is nan); the largest one of a broken element;
    nan: removed
tension_after | r, m | N | equilibrium of the net without the elements removed so far, under all constant
    loads and the mean wind, even if elements would break in it; nan: no equilibrium
displacement_after | r, n, 3 | m | displacement in that equilibrium, as in `/VTKHDF`; nan: no equilibrium, or
    removed with a cable
state | r | | result of the search for that equilibrium: `equilibrium`; `breaks`: elements exceed their
    fracture strain in it; `beyond_limit_point`; `unstable`; `no_equilibrium`; `undecided`; empty: nothing
    was removed
bending_moment_after | r, m | N m | larger moment of the two ends in that equilibrium; nan without bending.
    Only with bending chains
breaking_element | k | | rows of the elements that exceed their fracture strain
breaking_entry | k | | entry of each, from 0
dynamic_factor | r, m | | (peak - before) / (after - before); nan if the removal changes the tension by less
    than 1e-3 of the largest one, for removed and broken elements, and without an equilibrium
element | k | | rows of the removed elements
entry | k | | entry of each, from 0
/events | One row for each fracture and broken end. | [dynamics]
time | e | s | time of the fracture
step | e | | number of the step, counted in `shortest_time_step` of /provenance
element | e | | row of the broken element
element_id | e | | its id in the tables
particle | e | | row of the particle from which the end separated
node_id | e | | id of its node
new_particle | e | | number of the new particle; -1: none, at a loose end without load or with `fragments =
    false`
strain | e | | strain at the fracture
mass | e | kg | mass of the new particle
/detached | Detached parts of more than 1 % of the moving mass, one row each, every 0.01 s. | \
fractures or removals that detach more than 1 % of the moving mass
time | k | s | time of the row
node_id | k | | id of a node of the part, the first one in the tables
mass | k | kg | mass of the part and of what hangs on it by broken elements
velocity | k, 3 | m/s | velocity of the centre of mass, half a step before the time
largest_gust | | m/s | largest wind speed at any node until then; nan: unknown
/wind | Generated or measured wind speeds, or pressures at taps. | [wind]
control_point | c, 3 | m | points at which speeds are generated or were measured
mean_speed | c | m/s | mean wind speed
time | t | s | times of the speeds
speed | t, c | m/s | total wind speed
shape_coefficient | n | | net pressure coefficient of each node, for its zone and the wind direction
mean_pressure | n | N/m2 | pressure of the mean wind; positive presses on the roof
gust_factor | c | | largest of these speeds over the mean speed
negative_share | c | | share of the speeds below zero
tap | c, 2 | m | positions of pressure taps, in place of points and speeds
pressure | t, c | N/m2 | pressure at the taps
turbulence | | | turbulence intensity of generated gusts at 10 m, as requested
variance_beyond | | | share of the variance above half of 1 / `wind.time_step`, which the samples lack
variance_between | | | share of the remaining variance that linear interpolation between samples removes
spectrum_misfit | | | misfit of the gust model's spectrum in the worst half octave, without the slowest gusts
coherence_error | 2 | | root mean square error of the correlation of two nodes, over pairs that are farther
    apart in plan, and over pairs that are farther apart in height; nan: no such pairs
gust_lengths | | | number of gust lengths that pass during the stage
/load | Loads of the roof by node; each dataset is present if the job has the load. | \
[load] snow, pressure, temperature or ice
snow | n | N/m2 | snow load in plan, with the values of zones
pressure | n | N/m2 | pressure along the normal, positive presses on the roof; nan: given as [x, y, z]
temperature | | K | change of temperature of all elements since form finding
ice | | m | radial thickness of the ice on elements with a diameter
/modes | Lowest natural modes of the net where the dynamic stage begins. | [modes] count > 0
period | k | s | natural period, longest first; inf: no stiffness, nan: unstable
shape | k, n, 3 | | mode shape, its largest displacement is 1
effective_mass | k, 3 | | share of the mass that moves along x, y, z
damping_ratio | k | | damping ratio by `dynamics.mass_damping`
band_damping_ratio | k | | damping ratio by `dynamics.axial_damping_ratio`
air_damping_ratio | k | | damping ratio by `wind.aerodynamic_damping` in the mean wind
/final | Last state, in full precision. |
particle_id | p | | numbers of the particles, fragments included; no ids of the tables
position | p, 3 | m | position
velocity | p, 3 | m/s | velocity
element_id | m | | rows of the elements; no ids of the tables
tension | m | N | axial force
bending_moment | m, 2 | N m | {BENDING}
plastic_strain | m | | plastic part of the strain
/net | Net as it was built. |
particles | n, 3 | m | nodes as given
elements | m, 2 | | rows of the nodes at both ends
fixed | n, 3 | | 1: held along this axis after the last stage; see `held` of each
angle | n | degrees | rotation about z of the axes of `fixed` and `spring`, if the tables give it
node_id | n | | id in the tables
element_id | m | | id in the tables
group | m | | row of `group_names`
group_names | k | | names of the groups
tributary_area | n | m2 | surface area, on which dead load acts
plan_area | n | m2 | area in plan, on which snow acts
vector_area | n, 3 | m2 | area vector, upward, on which pressures along the normal, wind and taps act
zone_share | n, k | | share of each node's area in each zone, if a node is in several
zone | n | | row of `zone_names` with the largest share of the area; -1: none
zone_names | k | | names of the zones
cable | m | | row of `cable_names`
cable_names | k | | names of the cables
unstressed_length | m | m | at the temperature of form finding
unstressed_length_warm | m | m | at the temperature of the loads, if it differs
axial_stiffness | m | N | axial stiffness EA
mass_per_length | m | kg/m | mass per length
expansion | m | 1/K | coefficient of thermal expansion
bar | m | | 1: a bar, which carries compression
spring | n, 3 | N/m | stiffness of elastic supports, if there are any
breaking_load | m | N | breaking force as given; inf: none. Only if elements have one
yield_force | m | N | yield force as given; inf: none. Only if elements have one
fracture_strain | m | | fracture strain as given, or that of the breaking force if it is reached first; inf:
    none. Only if elements have one
strength | m | | random factor on these three strengths, if there is one
diameter | m | m | diameter on which wind and ice act; 0: none. Only if elements have one, as the next
drag_coefficient | m | | drag coefficient of these elements
second_moment | m | m4 | second moment of area of bars; nan: none. Only if elements have one, as the next four
buckling_length | m | m | as given, or the length of the element in the table
euler_load | m | N | Euler load pi^2 E I / L_k^2; nan without a second moment
buckling_curve | m | | row of `buckling_curve_names` (EN 1993-1-1)
buckling_curve_names | k | | names of the buckling curves
bending | m | | 1: part of a bending chain. Only if there are some
buckling | m | | 1: carries at most its Euler load. Only if there are some
type | m | | row of `type_names`; -1: none. Only if elements have one
type_names | k | | names of the types
/provenance/net | Properties of the tables of the net that `/net` lacks; a column of one value has a single
    row. |
load | n, 3 | N | loads of nodes
mass | n | kg | masses of nodes
area | n | m2 | surface area as given; nan: from the faces
normal | n, 3 | | normal as given; nan: from the faces
spring_rest | n, 3 | m | displacement at which elastic supports carry no force
line_load | k, m, 3 | N/m | loads of elements in each table of loads, if there are any
line_load_table | k | | names of these tables
section | m | m2 | cross-sectional area
modulus | m | Pa | Young's modulus
density | m | kg/m3 | mass density
yield_stress | m | Pa | yield stress; inf: elastic
breaking_load | m | N | breaking force; inf: none
fracture_strain | m | | fracture strain; inf: never breaks
ring_start | k | | first corner of each ring of a face; the last entry is the number of corners
ring_corner | k | | nodes at the corners of rings; numbers from n on are rows of `corners`
ring_face | k | | face of each ring
corners | k, 3 | m | points of the rigid boundary without a node
"""


# states of an equilibrium in the file
EQUILIBRIUM, NO_EQUILIBRIUM, UNSTABLE = "equilibrium", "no_equilibrium", "unstable"
UNDECIDED = "undecided"  # the search failed, but an equilibrium may exist
BEYOND_LIMIT_POINT = "beyond_limit_point"
ORDER_ATTRIBUTE = "order"  # attribute of a group with an equilibrium: its number in the order of computation
DIMENSIONLESS = "1"  # unit of dimensionless quantities


class Dataset(NamedTuple):
    """One dataset: name within its group, shape, unit and meaning."""

    name: str
    shape: str
    unit: str
    meaning: str


class Group(NamedTuple):
    """A group of the file: its meaning, the part of a job that requests it, and its datasets."""

    name: str
    meaning: str
    lacking: str
    datasets: tuple[Dataset, ...]


def _groups() -> tuple[Group, ...]:
    groups: list[Group] = []
    for name, *cells in table_rows(DATASETS):
        if name.startswith("/"):
            groups.append(Group(name[1:].replace("NAME", "*"), cells[0], cells[1], ()))
        else:
            rows = (*groups[-1].datasets, Dataset(name, *cells))
            groups[-1] = groups[-1]._replace(datasets=rows)
    return tuple(groups)


GROUPS = _groups()


@functools.cache
def find_group(name: str) -> Group:
    """Return the description of a group of the file, for example "cases/snow". Raises KeyError if unknown."""
    for group in GROUPS:
        if fnmatchcase(name, group.name) or name == group.name.partition("/")[0]:
            return group
    raise KeyError(f"no group /{name} in the table of datasets")


def dataset_unit(path: str) -> str:
    """Return the unit of a numerical dataset from its path in the file.

    Raises KeyError if the table does not list it. Index datasets of /VTKHDF that only VTK reads need no row.
    """
    group, _, name = path.rpartition("/")
    if path.startswith("VTKHDF/"):
        group, name = "VTKHDF", path.removeprefix("VTKHDF/")
    units = {dataset.name: dataset.unit for dataset in find_group(group).datasets}
    if name not in units and group != "VTKHDF":
        raise KeyError(f"/{path} has no row in the table of datasets")
    return units.get(name) or DIMENSIONLESS


NAN = float("nan")


class OutcomeColumn(NamedTuple):
    """A column of /samples of a study file.

    empty : value while the outcome is unknown or does not apply; its type is that of the column
    needs_removal : present if members are removed
    needs_depth : present if a depth is given
    is_outcome : a run returns the value; otherwise the table of the study adds it
    needs_dynamics : needs a dynamic stage; equilibria lack it
    """

    name: str
    empty: float | int | str
    unit: str = ""
    needs_removal: bool = False
    needs_depth: bool = False
    is_outcome: bool = True
    needs_dynamics: bool = False

    @property
    def dtype(self) -> type:
        """Type of the column."""
        return object if self.empty == "" else type(self.empty)

    @property
    def measured(self) -> bool:
        """Whether the value measures damage, so that a failure criterion may refer to it."""
        return self.is_outcome and self.dtype in (int, float) and self.name not in NOT_DAMAGE


NOT_DAMAGE = (
    *("first_element", "first_element_id", "dynamic_factor_element", "dynamic_factor_element_id"),
    *("tension_ratio_element", "tension_ratio_element_id"),
    *("gusts", "seconds"),
)
OUTCOMES = (
    OutcomeColumn("first_fracture", NAN, "s", needs_dynamics=True),
    OutcomeColumn("first_element", -1),
    OutcomeColumn("first_element_id", -1),
    OutcomeColumn("broken", 0, needs_dynamics=True),
    OutcomeColumn("detached_area", NAN, needs_dynamics=True),
    OutcomeColumn("displacement_max", NAN, "m"),
    OutcomeColumn("tension_max", NAN, "N"),
    OutcomeColumn("utilisation_max", NAN),
    OutcomeColumn("utilisation_before_break", NAN),
    OutcomeColumn("sunk_area", NAN, needs_depth=True),
    OutcomeColumn("energy_balance_error", NAN, needs_dynamics=True),
    OutcomeColumn("balance_error_attached", NAN, needs_dynamics=True),
    OutcomeColumn("tension_ratio_max", NAN, needs_removal=True),
    OutcomeColumn("tension_ratio_element", -1, needs_removal=True),
    OutcomeColumn("tension_ratio_element_id", -1, needs_removal=True),
    OutcomeColumn("dynamic_factor_max", NAN, needs_removal=True),
    OutcomeColumn("dynamic_factor_element", -1, needs_removal=True),
    OutcomeColumn("dynamic_factor_element_id", -1, needs_removal=True),
    OutcomeColumn("equilibrium_after_removal", "", needs_removal=True),
    OutcomeColumn("gusts", 0, needs_removal=True),
    OutcomeColumn("duration", NAN, "s", is_outcome=False),
    OutcomeColumn("seconds", NAN, "s"),
    OutcomeColumn("state", ""),
    OutcomeColumn("reason", ""),
)
OUTCOME_BY_NAME = {each.name: each for each in OUTCOMES}
RUN_OUTCOMES = tuple(each for each in OUTCOMES if each.is_outcome)
# Outcomes of a run without any result; times and elements : of its fractures
NO_OUTCOMES: dict[str, Any] = {each.name: each.empty for each in RUN_OUTCOMES} | {"times": [], "elements": []}
