"""Messages of the package `results`: files that are read and written, doubtful parts of a result."""

from netfall.core.messages import Message

# --- files that are read

MISSING_RESULT = Message("E701", "{path}: no such file. Give a result file of netfall")
FOLDER_AS_RESULT = Message("E702", "{path}: is a folder. Give a result file of netfall")
UNREADABLE_RESULT = Message(
    "E703",
    "{path}: not an HDF5 file ({reason}). Give a result file of netfall",
    "Result files have the suffix .vtkhdf. A run that is killed leaves no result file under this name; "
    "resume it from its last checkpoint.",
)
OTHER_HDF5_FILE = Message(
    "E704",
    "{path}: an HDF5 file, but not a result of netfall: it has no /provenance and /net. Give a result file "
    "of netfall",
)
STUDY_AS_RESULT = Message(
    "E705", "{path}: a study file. Read it with netfall info or plot, or give the result of one run"
)
MISSING_DATASET = Message(
    "E706", "{path}: {name} is not in this file, which another version of netfall wrote. Run the job again"
)
TIME_OUTSIDE_FRAMES = Message(
    "E707", "{path}: time {time:g} s: the frames are from {first:g} to {last:g} s. Give a time in this range"
)

# --- files that are written

CANNOT_WRITE = Message(
    "E708",
    "{path}: cannot be written ({reason}); {space}. {remedy} with -o",
    "The disk is full, a quota is used up, or the folder was removed during the run. A run leaves its "
    "checkpoints, from which --restart resumes it, also with another path.",
)
MISSING_FOLDER = Message(
    "E709", "{path}: the folder {folder} does not exist. Create it, or give another path with -o"
)
NAME_TOO_LONG = Message(
    "E739", "{path}: the name is too long (limit {most} bytes). Give a shorter name with -o"
)
FOLDER_AS_OUTPUT = Message("E710", "{path}: is a folder. Give the name of a file with -o")
READ_ONLY_FOLDER = Message(
    "E711", "{path}: the folder {folder} cannot be written to. Give another path with -o"
)
OTHER_FILE_THERE = Message(
    "E712", "{path}: exists and is not a result of netfall. Move it away, or give another name with -o"
)
OUTPUT_IN_USE = Message(
    "E713",
    "{path}: another run or program is writing this file. Wait for it, or give another name with -o",
    "Two runs would overwrite each other's result. netfall locks the name of a result during a run; the "
    "lock ends with the process, also if it is killed.",
)
FOLDER_NOT_SHARED = Message(
    "E714",
    "{path}: {blind} of {ranks} ranks, rank {first} first, cannot see the files of rank 0 in {folder}. Give "
    "a folder that all ranks share with -o, and start them in the same working directory",
    "All ranks write one result file. On a cluster the folder must be on a file system that all nodes mount.",
)

# --- checkpoints

NO_CHECKPOINT = Message("E715", "{path}: no such checkpoint. Newest complete one in its folder: {newest}")
DAMAGED_CHECKPOINT = Message(
    "E716",
    "{path}: damaged, or not a checkpoint of netfall (its digest does not match). Newest complete one in its "
    "folder: {newest}",
    "A run that is killed while it writes a checkpoint leaves it incomplete. netfall keeps the last two, so "
    "that one of them is complete.",
)
OTHER_JOB = Message(
    "E717",
    "{path}: belongs to another job or net ({name}). Resume it with the job file, tables and --set of the "
    "interrupted run",
    "A resumed run must give the same result as an uninterrupted one. netfall compares a digest of the job, "
    "of its tables and of --set with that in the checkpoint.",
)
MISSING_SEGMENT = Message(
    "E718",
    "{segment}: this part of the interrupted run's result is missing or damaged, and {result} is not its "
    "result. Keep both in the folder of the checkpoint, or start the run again",
    "A checkpoint does not contain the result. That is in segments, hidden files next to the checkpoint, or "
    "in the finished result file.",
)

# --- form finding

CHECK_FORM = "Check supports, prestress and force densities."
KEEP_POSITIONS = (
    "Constant tension moves nodes along cables; to keep their positions, use [form_finding] modulus_factor "
    '= 1e-3, method = "force_density" or method = "given_geometry".'
)
FORM_MOVED = Message(
    "W719",
    "form finding: {count} of {total} nodes moved {view} by more than {limit:.0%} of the span of "
    "{span:.4g} m; node {node} moved most, by {distance:mm}. The form that is loaded is not the given "
    "geometry. {remedy}",
    "Form finding searches for a geometry in which the prestress is in equilibrium. If the given nodes are "
    "far from it, a support, a prestress or a force density is probably not as intended.",
)
FORM_AREA_CHANGED = Message(
    "W720",
    "form finding: the area of the roof changed by {change:+.1%} (limit {limit:.0%}). The form that is "
    "loaded is not the given geometry. {remedy}",
)
BAR_LENGTH_CHANGED = Message(
    "W740",
    "form finding: the length of bar {element} changed from {before:.4g} to {after:.4g} m ({change:+.0%}, "
    "limit {limit:.0%}){others}. Its force does not fit the forces of the cables. Check whether a stay is "
    "missing and the prestresses at its ends, or fix the node and read the force that it needs.",
    "A bar has a length that the structure needs, but form finding moves free nodes until forces balance. A "
    "mast with too small a compression is lifted by its cables.",
)
UNDETERMINED_NODES = Message(
    "N721",
    "form finding at constant tension: {nodes}: nothing holds them along their straight cable. They stay "
    "near their initial positions; [form_finding] modulus_factor = 1e-3 or method = "
    '"force_density" determines these.',
    "At constant tension a node on a straight cable is in equilibrium at every position along the cable. "
    "The unstressed lengths of the adjoining elements depend on that position.",
)

# --- equilibria

PRESTRESS_CHANGED = Message(
    "W741",
    "form finding: the force differs from the prestress of {count:element} by more than {limit:.0%}; most in "
    "element {element}: {found:kN} instead of {given:kN}. {remedy}",
    "A given geometry has the self-stress nearest to the prestress. With fpm, modulus_factor changes forces "
    "as lengths change.",
)
FORCES_OF_GEOMETRY = "Give forces that the geometry can have, or the prestress of one group only."
FORCES_OF_FPM = "Decrease [form_finding] modulus_factor, or give a geometry closer to the form."
FORCES_UNBALANCED = Message(
    "W722",
    "{what}{others}: loads, reactions and residual forces are out of balance by {share:.2g} of the sum of "
    "the reactions, more than the tolerance explains. Reactions and tensions may be wrong. Do not use them, "
    "and report the job as a fault of netfall.",
)
LIMIT_POINT = Message(
    "W723",
    "{what}: limit point at {at}: no stable equilibrium continues the path beyond it. The state found lies "
    "beyond this limit load. Keep the load below it, or brace the compressed members.",
    "netfall follows the path from the unloaded state if members carry compression. At a limit point the "
    "net loses its stiffness. It would reach the state found only in motion, if at all.",
)
SNAP_THROUGH = Message(
    "W724",
    "{what}: the net snaps through at {at}: node {node} jumps by {jump:mm}. The state found lies beyond "
    "this limit load. Keep the load below it, or brace the compressed members.",
    "At the limit load the net loses its stiffness and jumps to another shape. A structure does so in "
    "motion, with larger forces than in the equilibrium afterwards.",
)
TORSION_NOT_MODELLED = Message(
    "W725",
    "{what}: the curved bending chain at node {node} bends out of its plane: its torsion, {share:.0%} of "
    "the largest bending moment{others}, is not modelled. Support the chain across its plane, or compute it "
    "as a frame with torsion.",
    "A bending chain resists bending, but not torsion. Across its plane a curved chain bends as a straight "
    "chain of the same length, so displacements and moments there are wrong.",
)
TOLERANCE_BELOW_ROUNDING = Message(
    "W726",
    "{what}: estimated error {error:.1e} ([load] tolerance = {tolerance:g}; rounded coordinates allow "
    "{least:.1e}). Set tolerance to {possible:.0e} or more.",
)
TOLERANCE_MISSED = Message(
    "W727",
    "{what}: estimated error {error:.1e} ([load] tolerance = {tolerance:g}; rounded coordinates allow "
    "{least:.1e}). Compare with more load steps.",
)
SLIP_AT_END = Message(
    "W728",
    "{what}: cables slipped until {share:.0%} of the free segments with {elements} remained, where the model "
    "stops them. Raise the slip resistance of clamps or the friction of saddles.",
    "A free segment needs a length. netfall stops the slip when a fifth of a segment remains. In the "
    "structure the end of the cable would run over the node.",
)
LARGE_DISPLACEMENT = Message(
    "W729",
    "{what}: node {node} moved by {distance:mm}, more than {limit:.0%} of the largest dimension of the "
    "net, {size:.4g} m{others}. Check its shape, the units of loads, the prestress and the supports.",
)
STRENGTH_EXCEEDED = Message(
    "W730",
    "{what}: {elements}: strength exceeded. No element breaks in this static equilibrium. Lower the load, "
    "or use stronger elements.",
)
BUCKLED = Message(
    "W731",
    "{what}: {elements}: buckled, at the Euler load. A bar that is not quite straight carries less. Use "
    "stiffer or shorter bars.",
)
EULER_LOAD_EXCEEDED = Message(
    "W732",
    "{what}: {elements}: compression above the Euler load, but bars do not buckle without buckling = true. "
    "Set [cable] buckling = true, or use stiffer bars.",
)
YIELDING = Message(
    "W733",
    "{what}: {elements}: at the yield force. Check the load and the yield stress.",
)
YIELDED = Message(
    "W734",
    "{what}: {elements}: yielded by the end. If many yield for long, plastic strains may be wrong by some "
    "per cent. Compare with a quarter of the step (a smaller [dynamics] safety or time_step).",
)

# --- dynamic stage

ENERGY_UNBALANCED = Message(
    "W735",
    "dynamics: the energy balance is off by up to {errors} (limit {limit:g}), from t = {first:.4g} s "
    "{until}. The step is too long for some events. Compare with half the step: a smaller [dynamics] safety "
    "or time_step; after fractures also a smaller fragment_mass.",
    "The energy of the elements must change by the work of the loads minus the work of damping and "
    "yielding. A larger error means that the step does not resolve a fracture, an impact or a cable that "
    "becomes taut.",
)
WORK_IDENTITY_BROKEN = Message(
    "W736",
    "dynamics: the work identity of the time integration is off by {error:.1e} (limit {limit:g}). Forces or "
    "positions are wrong in some step. Do not use the result, and report the job as a fault of netfall.",
    "The work of all forces over a step equals the change of kinetic energy up to rounding, for any step "
    "length. A larger error is a fault of the program or of the machine, not of the model.",
)
DETACHED_TOO_FAST = Message(
    "W737",
    "dynamics: from t = {time:.4g} s a detached part ({mass:.4g} kg, with node {node}) moves at {speed:.4g} "
    "m/s, faster than the largest gust, {gust:.4g} m/s. Detached parts do not move as real ones. Use "
    'only results of attached parts. Set [wind] aerodynamic_damping, and leave after_fracture at "detached".',
    "The speed is that of the centre of mass without the velocity of the fall. Wind cannot move a part "
    "faster than its own speed. Without aerodynamic_damping a torn roof has the full pressure at any speed, "
    'until it is detached; with another after_fracture than "detached", also later.',
)
OVERSHOOT = Message(
    "W738",
    "dynamics: {count} had tensions above the strength; worst: element {element} with {tension:kN} at t "
    "= {time:.4g} s (strength {bound:kN}{fracture}). Do not use these tensions. Compare with a "
    "smaller [dynamics] safety (for example 0.2) or time_step.",
    "An element breaks in the step in which it exceeds its strength. A light fragment end that becomes taut "
    "at high speed raises the tension in this step by more than 5 % of the strength.",
)
RINGING = Message(
    "W739",
    "dynamics: {count} without strength carried more than the adjoining elements can carry; worst: element "
    "{element} with {tension:kN} at t = {time:.4g} s (bound {bound:kN}). Do not use these tensions. "
    "Give the elements a strength.",
    "The element is attached to a light fragment end and rings numerically: only its mass and the time step "
    "limit its force. A smaller [dynamics] safety or time_step shows how much of it is due to the step.",
)
