"""Table of all keys of a job file: type, unit, range, default and meaning.

Validation, the messages for wrong input, the page jobs/KEYS.md and the tests read this table and that of
`entries`. A new key is a new row here.
"""

from types import SimpleNamespace

from netfall.job.cases import settable_keys
from netfall.job.keys import Key, parse_keys

GENERATOR_KEYS = {
    "saddle": ("side", "rise", "cells"),
    "stadium": ("length", "width", "arch_rise", "spacing", "halves"),
    "ring": ("length", "width", "rise", "spacing"),
    "wheel": (
        *("diameter", "opening", "ring_height", "ring_depth"),
        *("spokes", "hoops", "spoke_force", "hoop_force", "brace_force", "ring_groups"),
    ),
    "dome": ("diameter", "opening", "dome_height", "strut", "spokes", "hoops", "spoke_force", "ring_groups"),
}
GLOBAL_CABLE_KEYS = (
    "strain",
    "catalogue",
    "strength_seed",
    "length_seed",
)  # keys that groups cannot override
EXCLUSIVE_KEYS = (
    ("modulus", "axial_stiffness"),
    ("density", "mass_per_length"),
)  # exactly one of each pair is given
REQUIRED_ALTERNATIVES = {  # for each required key, the keys of which one must be given, unless a type is
    "modulus": ("modulus", "axial_stiffness"),
    "area": ("area", "axial_stiffness"),
    "density": ("density", "mass_per_length"),
}
SINCE = "0.5"  # version from which the defaults and removals of REMOVED and `geometry.section_defaults` hold
# Removed keys by section: the value that is still accepted with a warning, and the reason for the removal.
REMOVED_KEYS = {"dynamics": {"precision": ("double", "numbers have double precision (jobs/trade/README.md)")}}

KEYS = """
title | text | | "" | what the job is
[net]
generator | choice saddle stadium ring wheel dome | | | a net made from dimensions
nodes | path | | | path of nodes.csv, relative to the job file
elements | path | | | path of elements.csv, relative to the job file
unit | choice m cm mm ft in | | m | unit of the coordinates in nodes.csv; everything else is in SI units
subdivide | integer | 1 to 10000 | 1 | elements for each net segment; new nodes between two fixed ones are
    fixed, and go with them
side [m] | number | 1e-3 to 1e6 | 73.2 | saddle: side of the square in plan
rise [m] | number | -1e6 to 1e6 | 3.66 | saddle, ring: height of the boundary's high points above the middle;
    ring: 0 is flat
cells | integer | 2 to 20000 | 8 | saddle: cells along a side
length [m] | number | 1e-3 to 1e6 | 88.0 | stadium, ring: axis of the ellipse along x
width [m] | number | 1e-3 to 1e6 | 66.0 | stadium, ring: axis of the ellipse along y
arch_rise [m] | number | -1e6 to 1e6 | 10.0 | stadium: rise of the parabolic arch
spacing [m] | number | > 0 to 1e6 | 2.2 | stadium, ring: distance of the cables
halves | integer | 1 to 2 | 1 | stadium: 1, the half on one side of the arch, or 2, the whole
diameter [m] | number | 1e-3 to 1e6 | 120.0 | wheel: of the compression ring; dome: of the supports
opening [m] | number | 1e-3 to 1e6 | 50.0 | wheel: diameter of the tension rings; dome: of the central ring
ring_height [m] | number | 1e-3 to 1e6 | 9.0 | wheel: of the upper tension ring above the lower one
ring_depth [m] | number | 1e-3 to 1e6 | 3.0 | wheel: of the truss that the compression ring is part of
dome_height [m] | number | 1e-3 to 1e6 | 12.0 | dome: of the central ring's upper nodes above the supports
strut [m] | number | 1e-3 to 1e6 | 8.0 | dome: length of the struts
spokes | integer | 4 to 1000000 | 36 | wheel: radial cables of each layer, a multiple of 4; dome: nodes of
    each ring
hoops | integer | 0 to 100000 | 4 | wheel: rings of cables between the rings, in the upper layer; dome: rings
    of struts between the central ring and the supports
spoke_force [N] | number | 1 to 1e12 | 1e6 | wheel: horizontal force of each radial at the tension ring; dome:
    of the two ridge cables at each node of the central ring, along the radius
hoop_force [N] | number | 0 to 1e12 | 0.0 | wheel: tension of the hoops
brace_force [N] | number | 0 to 1e12 | 0.0 | wheel: tension of the crossed diagonals between the tension
    rings; 0: there are none
ring_groups | flag | | false | wheel, dome: whether each ring of a group is a group of its own: hoop1, hoop2,
    ... from the middle
[cable]
kind | choice cable bar | | cable | cable: tension only; bar: tension and compression
modulus [Pa] | number | 1 to 1e15 | | Young's modulus; with area, or axial_stiffness instead
area [m2] | number | 1e-12 to 1e4 | | cross-section
density [kg/m3] | number | 1e-3 to 1e6 | | mass density; with area, or mass_per_length instead
axial_stiffness [N] | number | 1 to 1e15 | | EA, instead of modulus and area
mass_per_length [kg/m] | number | 1e-9 to 1e7 | | mass of a metre of cable, instead of density
catalogue | path | | | path of a table of types, relative to the job file
type | text | | | name of a row of the catalogue, for stiffness, mass and breaking load
prestress [N] | number | -1e12 to 1e12 | 0.0 | axial force to form-find with, tension positive
yield_stress [Pa] | number | > 0 to 1e20 | | yield stress; absent: elastic
fracture_strain | number | > 0 to 1e6 | | total strain at fracture; absent: none breaks by its strain
breaking_load [N] | number | > 0 to 1e20 | | tension at fracture; absent: none breaks by its tension
strength_deviation | number | 0 to 0.5 | 0.0 | scatter of strength from cable to cable, share of its mean
length_deviation [m] | number | 0 to 10 | 0.0 | scatter of the unstressed length of each piece of cable
length_seed | integer | 0 to 9223372036854775807 | 1 | seed of the drawn errors of length: the same seed draws
    the same
strength_seed | integer | 0 to 9223372036854775807 | 1 | seed of the drawn strengths: the same seed draws the
    same strengths
second_moment [m4] | number | > 0 to 1e4 | | of the area of a bar's section, about any axis: Euler's load
buckling_length [m] | number | > 0 to 1e5 | | of a bar between what holds it, for Euler's load; absent: the
    length of the table's element
bending | flag | | false | chains of bars resist bending, by second_moment
buckling | flag | | false | bars carry at most Euler's load in compression, and break by their strength both
    ways
buckling_curve | choice a0 a b c d | | c | of EN 1993-1-1, 6.3.1.2, for the check of a compressed bar
expansion [1/K] | number | -1e-3 to 1e-3 | 12e-6 | coefficient of thermal expansion: strain for each K
strain | choice engineering logarithmic | | engineering | strain measure
[form_finding]
method | choice fpm force_density keep | | fpm | fpm: relaxation of particles; force_density: linear; keep:
    the geometry stays, and carries the self-stress nearest to the prestress, equal within a group
loads | choice none permanent | | none | permanent: the form is in equilibrium with self weight and dead load;
    none: with no load
start | choice given force_density | | given | fpm: start from the given geometry or from the force-density
    one
modulus_factor | number | 0 to 1 | 0.001 | fpm: share of the modulus; 0: constant tension
tolerance | number | 1e-12 to 0.1 | 1e-6 | largest residual force over the largest prestress of the elements
    that can move
max_iterations | integer | >= 1 | 200000 | fpm: iterations after which the run gives up
[load]
self_weight | flag | | true | weight of the elements
dead [N/m2] | number | 0 to 1e9 | 0.0 | weight of the roof's cladding, downward; its mass moves with the
    particles
snow [N/m2] | number | 0 to 1e9 | 0.0 | snow load on the area in plan, downward; its mass moves with the
    particles
pressure [N/m2] | pressure | -1e9 to 1e9 | | static load of the roof: positive presses on it, against the
    upward normal, negative lifts; or [x, y, z]
air_mass [kg/m2] | number | 0 to 1e6 | 0.0 | air that moves with the surface: inertia without weight, on which
    `damping` does not act
temperature [K] | number | -273 to 1000 | 0.0 | change of all elements from that of form finding
breaking | flag | | false | whether a strength that is passed breaks an equilibrium of statics; false: it is
    reported
steps | integer | 0 to 100000 | | load steps of the static analysis; 0: none; absent: 1 if there are neither
    [dynamics] nor cases nor combinations, otherwise 0
ramp [s] | number | 0 to 1e9 | 0.0 | time over which the pressure grows from zero in the dynamic stage,
    without load steps; 0: none
tolerance | number | 1e-12 to 0.1 | 1e-6 | estimated error of an equilibrium, of displacements and tensions,
    as shares of the largest
max_iterations | integer | >= 1 | 500000 | iterations after which the run gives up, where an equilibrium has
    to be relaxed
[roof]
groups | words | | | groups of elements whose faces carry loads and wind; absent: all
openings [m] | points | -1e9 to 1e9 | [] | x, y of a point in each face that is an opening
lines | path | | | path of a table start, end: ids of nodes between which a face has an edge without an
    element
faces | path | | | path of a table of the faces; absent: those of the plan
[wind]
speed [m/s] | number | 0.1 to 200 | | U0, mean wind speed at 10 m above ground
file | path | | | path of a table time, speed, instead of a generated wind
points | path | | | path of a table name, x, y, z: where the speeds of file were measured, a column each by
    name
pressures [N/m2] | path | | | path of a table of pressures in time at taps, instead of a wind
taps | path | | | path of a table name, x, y: where the taps of pressures are
direction [degrees] | number | -360 to 360 | 0.0 | where the wind blows to, counted from x towards y: 30 is a
    wind from 210
roughness | number | 0 to 0.2 | | roughness factor k of the gusts, instead of turbulence: their variance is
    6 k U0^2; 0: no gusts
turbulence | number | 0 to 1 | | turbulence intensity I at 10 m; a generated wind needs it or roughness
    (k = I^2 / 6); 0: no gusts
spectrum | choice davenport kaimal von_karman en1991 | | davenport | spectrum of the gusts along the wind
gust_length [m] | number auto | 0.1 to 1e5 | auto | L of the spectrum at 10 m; auto: 1200 (davenport), 56.7
    (kaimal), 63.2 (von_karman, en1991)
shape_coefficient | number | -1e4 to 1e4 | | u_s, the pressure coefficient: positive presses on the roof,
    against the upward normal; negative is suction, which lifts
sectors | path | | | path of a table direction, shape_coefficient and columns named as zones are, instead of
    shape_coefficient
air_density [kg/m3] | number | > 0 to 1e4 | 1.25 | density of the air
air_damping | number | 0 to 10 | 0.0 | kappa: a surface that moves along its normal at v is pressed on by
    kappa rho U v; half the slope of the normal force coefficient over the angle of attack; 1: attached flow;
    0: no air damping
time_step [s] | number | 1e-4 to 60 | 0.05 | time step of the generated histories
ar_order | integer | 1 to 30 | 14 | largest number of lags of the autoregressive model of the gusts
seed | integer | 0 to 9223372036854775807 | 1 | seed of the gusts: the same seed gives the same gusts
control_points | integer | 1 to 400 | 25 | largest number of points at which histories are generated
gusts | choice points means | | means | of the control points; means: means over the loaded surface around
    them, with which its load is that of the coherence; points: those there, as strong at every node
coherence_decay | vector | 0 to 1e6 | [8.0, 16.0, 10.0] | decay C of Davenport's coherence along the wind,
    across it and vertically
profile_exponent | number | 0 to 1 | 0.16 | exponent of the power law of the mean speed over height
base_height [m] | number | -1e6 to 1e6 | 10.0 | height of z = 0 above ground; it must be given for a generated
    or a static wind with profile_exponent > 0
onset | choice static sudden | | static | static: the roof rests under its loads and the mean wind, then the
    gusts grow in; sudden: all of the wind at t = 0
ramp [s] | number | 0 to 1e9 | 2.0 | time over which the gusts grow in after a static onset; 0: at once
after_fracture | choice detached particle panels all none | | detached | on what the wind no longer acts after
    a fracture; particle: the node where an element broke; detached: as particle, and parts that no unbroken
    elements connect to a support, which the relative wind w drags along instead with rho A w^2 / 2 (not with
    `pressures` and no `speed`); panels: the torn faces, which leave with the weight and mass of their loads;
    all: the whole roof; none: it acts on as before
[dynamics]
duration [s] | number | > 0 to 1e9 | required | simulated time
time_step [s] | number auto | > 0 to 1e9 | auto | time step of the dynamic stage; auto: from the stable step
    of the net as it is
safety | number | > 0 to 1 | 0.8 | share of the stable step that time_step = "auto" takes
damping [1/s] | number | 0 to 1e9 | 0.0 | mass-proportional damping zeta
damping_ratio | number | > 0 to 0.2 | | damping of axial strain, share of the critical
damping_band [Hz] | band | 1e-6 to 1e6 | | over which it has that ratio
fragment_mass | number | 0 to 0.5 | 0.05 | largest share of what a particle carries (dead load, `mass`) that
    one fragment takes along if the step needs it; 0: its half element alone, as in the paper
fragments | flag | | true | whether a particle splits off where an element breaks, as in the paper; false: the
    element is taken out of the net, its mass stays with its ends
mass_scaling | number | 0 to 1 | 0.0 | largest share of the moving mass that is added, as inertia alone, where
    the stiffest elements ask for a short step; with fracture only without fragments
[limits]
displacement [m] | number | > 0 to 1e6 | | of a node, in combinations for service; absent: no limit
slack | integer | 0 to 1000000000 | | cables that may be slack, in combinations for service; absent: no limit
[output]
frames | integer | 1 to 1000000 | 120 | states written over the duration
history [s] | number | > 0 to 1e9 | 0.01 | time between rows of /history
energy | flag | | true | audit of the energies; false saves its cost, and leaves the works and both errors of
    /history nan
probes [m] | places | -1e9 to 1e9 | [] | [x, y], [x, y, z] or ids of nodes whose histories are kept
elements | integers | | | ids of elements whose tensions are kept
checkpoint [s] | number | 0 to 1e9 | 0.0 | simulated time between checkpoints; 0: none
modes | integer | 0 to 1000 | 0 | natural modes and frequencies where dynamics begins: how many, lowest first;
    0: none
"""
SECTIONS = parse_keys(KEYS)


def find_key(section: str, name: str) -> Key:
    """Return the row of a key."""
    return next(key for key in SECTIONS[section] if key.name == name)


CURVES = find_key("cable", "buckling_curve").choices  # of EN 1993-1-1


def may_break(cable: dict) -> bool:
    """Tell whether a key of [cable] or of a group lets elements break."""
    tables = [table for table in (cable, *cable.values()) if isinstance(table, dict)]
    return any(table.get(key) is not None for table in tables for key in ("fracture_strain", "breaking_load"))


def _rows(section: str, *names: str) -> tuple[Key, ...]:
    """Return some rows of a section."""
    return tuple(key for key in SECTIONS[section] if key.name in names)


# Sections with inner tables that override some of their keys: name of the tables, and these keys.
OVERRIDES: dict[str, tuple[str, tuple[Key, ...]]] = {
    "cable": (
        "",
        tuple(key for key in SECTIONS["cable"] if key.name not in GLOBAL_CABLE_KEYS),
    ),  # [cable.GROUP]
    "load": ("zone", _rows("load", "dead", "snow", "pressure", "air_mass")),  # [load.zone.NAME]
    "wind": ("zone", _rows("wind", "shape_coefficient", "air_damping")),  # [wind.zone.NAME]
}

CASE_KEYS = settable_keys(SECTIONS, OVERRIDES)  # keys that a case can set
STAGE_KEYS = {name: row for name, row in CASE_KEYS.items() if name.startswith("load.")}  # the same of a stage


def section_defaults(section: str) -> SimpleNamespace:
    """Return a section with the defaults of its keys."""
    return SimpleNamespace(**{key.name: key.default for key in SECTIONS[section]}, zone={})
