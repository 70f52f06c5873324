"""Messages of the package `post`: plots, films, pages, reports, code checks, accuracy studies."""

from netfall.core.messages import Message

# --- pages, plots, films

NO_COMMON_NET = Message(
    "E801", "{path}: the samples have different nets; view the result file of one sample that was kept"
)
NO_SAMPLE_FILE = Message(
    "E802",
    '--sample {sample}: no file {path}; [run] keep_results = "broken" or "all" in the study file keeps the '
    "result files of samples",
)
OTHER_NET = Message("E803", "{path}: another net than that of the study; view it without the study")
UNTIL_TOO_EARLY = Message("E804", "--until {until:g}: the second frame is at {time:.4g} s; give a later time")
GIF_TOO_FAST = Message(
    "E805", "--fps {fps}: a GIF shows at most {most} frames a second; give fewer, or --format mp4"
)
NOTHING_TO_ANIMATE = Message(
    "E806",
    "{path}: no frames to animate: the job had neither a dynamic stage nor stages of erection. Give the job "
    "[dynamics] duration and [output] frames and run it again, or plot without --animate",
)
UNKNOWN_STATE = Message("E807", "--case {name}: no such state; this result has {names}")

# --- reports and checks

NO_DEDUCTIONS = Message("E821", "--deductions {path}: no such file; give the path of a table")
UNKNOWN_WORD = Message("E822", "{row}: {name} = {word!r}: no such {name} in the result; {advice}")
DEDUCTION_TOO_LONG = Message(
    "E823",
    "--deductions: cable {name} ({group}) of {length:.5g} mm: {start:g} and {end:g} mm at its ends are more "
    "than its end segments; expected less",
)
UNREADABLE_CODES = Message("E824", "{path}: {reason}; expected a file in the form of {shipped}")
NO_CHECKS = Message("E825", "{path}: no [[check]]; expected a file in the form of {shipped}")
CHECK_TWICE = Message("E826", "two checks have the same name; names are unique")
COLUMN_TWICE = Message(
    "E830",
    "[[check]] name = {name!r}: elements.csv has a column {column} already; give the check another name",
)
UNKNOWN_GROUP = Message(
    "E827",
    "{path}: [[check]] {number}: factor {factor}: groups: {group} = {value:g}: no such group of elements in "
    "the result; {advice}",
)
TENSION_AND_COMPRESSION = Message(
    "E828",
    "of = {names}: a check is of tension, compression or axial force with bending; make two checks of it",
)
FOREIGN_TABLE = Message(
    "E829", "{path}: exists and is not a table of a report; move it away, or give another folder with -o"
)
FORM_NOT_REACHED = Message(
    "W841", "form finding did not reach its targets: {reason}. The form shown is the closest that was found"
)
UNCHECKED_BENDING = Message(
    "W843",
    "[group.{group}]: {elements} with bending moments up to {moment:.4g} kN m, which no check includes. Give "
    "the group section_modulus, and design_strength or yield_stress.",
)
EXCESSIVE_MEASURING_LOAD = Message(
    "W844",
    "--measuring-load: {load:kN} is above the strength of {count:cable} ({names}), {strength:kN} for the "
    "first. Lengths under this load are wrong. Check the unit, N.",
)
NO_BREAKING_LOAD = Message(
    "W845",
    "checks: {elements}: cables without breaking_load. Their tension is compared only with the yield force, "
    "or with nothing, so utilisations may be too small or missing. Give breaking_load.",
)
NO_YIELD_STRESS = Message(
    "W846",
    "checks: {elements}: compressed bars without yield_stress. Their compression is compared only with the "
    "Euler load, so utilisations are too small. Give yield_stress too.",
)
UNCHECKED_COMPRESSION = Message(
    "W847",
    "checks: {elements}: compressed bars with unchecked buckling, up to {force:kN} in element {worst} "
    "({state}). Give second_moment and yield_stress.",
)
NO_EQUILIBRIUM = Message("W842", "no equilibrium after erection with errors of length: {reason}")

# --- studies of accuracy and scaling

SAFETY_WITHOUT_EFFECT = Message(
    "N861",
    "--vary dynamics.safety: time_step is fixed, so safety affects at most the mass of fragments. Give --set "
    "dynamics.time_step=auto to let it set the step",
)
REFERENCE_FAILED = Message("E862", "{path}: the reference was {state}: {reason}")
AUTOMATIC_STEP_FAILED = Message("E863", "{path}: the run for the automatic step was {state}: {reason}")
WRONG_VARIATION = Message(
    "E864", "--vary {item}: expected SECTION.KEY=VALUE,VALUE,..., for example dynamics.safety=0.8,0.4"
)
NO_DYNAMICS = Message(
    "E865", "{path}: [dynamics] is missing, but the dynamic stage is measured; add the section"
)
TRADE_INTERRUPTED = Message(
    "N870", "interrupted with {remaining} settings left to measure. Give the same command to continue"
)
NO_WEAK_SCALING = Message(
    "N866",
    "no weak scaling for numbers of ranks that are no multiples of the first: the elements of a table can be "
    "divided only into whole numbers of parts",
)
SCALING_RUN_FAILED = Message("E867", "{path}: a run on {ranks} {state}: {reason}")
