"""Keys of lists of tables: zones, cases, combinations, motions, slides, removals, targets, stages."""

from netfall.job.keys import parse_keys

LIST_KEYS = parse_keys("""
[zone]
name | name | | required | name by which [wind.zone.NAME] and [load.zone.NAME] refer to it
polygon [m] | polygon | -1e9 to 1e9 | | corners in plan of the start geometry, in order around it
groups | words | | | groups of elements whose nodes belong to it
cut | flag | | | true: a polygon takes the part of each node's area that lies inside it; false: it takes the
    whole area of the nodes inside; absent: true
[case]
name | name | | required | name of the static case; not permanent, prestress, temperature, load
set | loads | | {} | what it sets: keys of [load] (snow, pressure, dead, temperature) and of its zones, and of
    a mean [wind] that acts statically (pressure_factor: of its pressure)
pressure_table [N/m2] | path | | | path of a table x, y, z (optional), pressure or coefficient: points in the
    axes of the net
factor [N/m2] | number | -1e9 to 1e9 | | of the table: a pressure for coefficients; a number else
settlement [m] | shifts | | {} | of a held axis or of a spring's foot, from the form or the last stage of
    erection, by ids; z upwards: [0, 0, -0.05] sinks
[combination]
name | name | | required | name of the combination; no case bears it
factors | factors | -1e3 to 1e3 | required | of permanent, prestress (not named: 1), temperature, load,
    and of cases by name (not named: 0)
kind | choice ultimate service | | ultimate | which checks apply
[motion]
nodes | integers | | | ids of the supports that move; absent: all
displacement [m] | path | | | path of a table time, x, y, z, linear between its rows
acceleration [m/s2] | path | | | path of a record (.AT2, in the unit of its head) or of a table time, x, y,
    z or time, acceleration, likewise
direction | vector | -1e9 to 1e9 | | of an acceleration of one component
scale | number | -1e6 to 1e6 | 1.0 | by which it is multiplied
speed [m/s] | number | > 0 to 1e6 | | of a wave that travels; absent: all at once
travel | vector | -1e9 to 1e9 | | direction in which it travels
baseline | flag | | | baseline correction of a record (.AT2); absent: true
[slide]
group | text | | | group whose cables may slip over nodes
cables | words | | | or the names of the pieces of cable that may
nodes | integers | | | ids of the nodes over which they slip; absent: every node inside these cables
friction | number | 0 to 10 | 0.0 | coefficient of friction of a saddle
resistance [N] | number | 0 to 1e12 | 0.0 | resistance of a clamp to slip
[remove]
elements | integers | | | ids of the elements that are lost
group | text | | | or the group of elements that is lost
cables | words | | | or the names of the pieces of cable that are lost
time [s] | number | 0 to 1e9 | required | time in the dynamic stage at which the elements lose their stiffness
duration [s] | number | 0 to 1e9 | 0.0 | time over which their tension then falls to zero; 0: at once
[target]
group | text | | | group, or piece of cable, whose mean force is wanted
force [N] | number | -1e12 to 1e12 | | that force, tension positive
node | integer | -9223372036854775808 to 9223372036854775807 | | or the id of a node whose height is wanted
height [m] | number | -1e6 to 1e6 | | z of that node
by | text | | required | group, or piece of cable, whose unstressed lengths are changed, each cable by one
    amount
[stage]
name | name | | required | name of the stage of erection
lengths | lengths | | | unstressed lengths of groups or pieces of cable: changed, set, or pulled to a force
active | words | | | groups that are there from now on; absent: as before
release | integers | | | ids of nodes that are no longer held
hold | integers | | | ids of nodes that are held from now on, where they are
move [m] | shifts | | | by how much held nodes are moved, from where they are, by ids
clamps | choice open closed | | | clamps of [[slide]] from now on: open, without resistance, or closed;
    absent: as before
set | loads | | {} | what it sets from now on: dead, snow, pressure, temperature, as in a case
""")

REMOVED_MEMBER_KEYS = (
    "elements",
    "group",
    "cables",
)  # keys of [[remove]] of which exactly one is given
