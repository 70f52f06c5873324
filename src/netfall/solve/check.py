"""What `netfall check` tells of a job before it is run: sizes, step limits, memory, expected run time."""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from netfall.job.read import Job
from netfall.mechanics.state import FIELDS
from netfall.net.build import build_net
from netfall.solve.dynamics import Schedule, probe_remarks
from netfall.solve.roof import Phases, Roof, prepare, scene_of
from netfall.solve.run import limit_line, schedule_of, step_remarks

STEP_NS, STEP_US = (
    8.0,
    2.0,
)  # for an element and step, and for a step, on one core with all features on (README, "How fast")
LARGEST_FORM = 50_000  # elements up to which check also finds the form
FRAME_BYTES = {"particle": 24 + 12 + 12, "element": 4 + 4 + 4 + 1}  # of the result file, for each state
SETUP_BYTES = 500  # per element on rank 0, while the net is read, cut and sent


def check_job(job: Job, say: Callable[[str], None]) -> None:
    """Validate a job and describe it. Raises InputError for what is wrong in it."""
    comm = MPI.COMM_SELF
    short = job
    if job.form_finding and not _small(job):
        say(
            f"note: more than {LARGEST_FORM} elements: the form is not found here; figures are those of the start geometry"
        )
        short = Job(**{**vars(job), "form_finding": None})
    roof = prepare(comm, short, Phases())
    net, whole = roof.whole.net, roof.whole
    if job.dynamics:
        schedule = schedule_of(job, roof)
    say(f"{job.path}: {job.title or job.name}: valid")
    say(
        f"net: {net.n} particles ({int(net.fixed.all(1).sum())} fixed), {net.m} elements in groups "
        + ", ".join(
            f"{name or '(none)'} {int((net.group == g).sum())}" for g, name in enumerate(net.group_names)
        )
    )
    L = whole.L0
    say(
        f"elements: unstressed length {L.min():.4g} to {L.max():.4g} m, {L.sum():.1f} m in all; tension {whole.N.min():.4g} to {whole.N.max():.4g} N"
    )
    say(
        f"masses: elements {float((net.density * net.section * L).sum()):.4g} kg, all particles {whole.mass.sum():.4g} kg; roof {whole.area.sum():.1f} m2 in plan"
    )
    if whole.remark:
        say(f"note: {whole.remark}")
    if roof.form:
        say(
            f"form finding: {roof.form.iterations} iterations to {roof.form.residual / max(roof.form.reference, 1e-300):.2g} of the prestress, "
            f"with the real material {roof.residual / max(roof.form.reference, 1e-300):.2g}"
        )
    elif roof.residual > 1e-6 * max(roof.reference, 1e-300):
        say(f"note: the start is not in equilibrium: largest residual {roof.residual:.3g} N")
    say("stages: " + ", ".join(stages(job)))
    say(f"the scene has: {features(job, roof)}")
    if job.dynamics:
        _describe_steps(job, roof, schedule, say)
    _describe_memory(job, roof, say)


def _small(job: Job) -> bool:
    return build_net(job).m <= LARGEST_FORM


def stages(job: Job) -> list[str]:
    """The stages that the job has, in order."""
    found = []
    if job.form_finding:
        found.append(f"form finding ({job.form_finding.method})")
    if job.load and job.load.steps:
        found.append(f"statics ({job.load.steps} load steps)")
    if job.dynamics:
        found.append(f"dynamics ({job.dynamics.duration:g} s)")
    return found or ["none: the net alone"]


def features(job: Job, roof: Roof) -> str:
    """What the scene has, in words."""
    scene = scene_of(job, roof.whole.net)
    words = [
        ("plastic flow", scene.plastic),
        ("fracture", scene.fracture),
        ("wind", scene.wind),
        ("damping", bool(job.dynamics and job.dynamics.damping)),
        ("self weight", bool(job.load and job.load.self_weight)),
        ("dead load", bool(job.load and job.load.dead)),
        ("static pressure", bool(job.load and job.load.pressure is not None)),
        ("logarithmic strain", scene.logarithmic),
        ("broken elements taken out", scene.fracture and not scene.fragments),
        (f"{scene.precision} precision", scene.displaced),
    ]
    return ", ".join(word for word, there in words if there) or "elastic elements alone"


def _describe_steps(job: Job, roof: Roof, schedule: Schedule, say) -> None:
    m = roof.whole.net.m
    for limit in roof.limits.values():
        say(limit_line(limit, roof.whole))
    seconds = schedule.steps * (m * STEP_NS * 1e-9 + STEP_US * 1e-6)
    say(
        f"steps: {schedule.steps} of {schedule.dt:.4g} s"
        + (" (auto)" if job.dynamics.time_step == "auto" else "")
        + f"; expected run time about {seconds:.2g} s on one core"
    )
    for remark in probe_remarks(roof.whole.net, roof.whole.x, job.output.probes):
        say(remark)
    for remark in step_remarks(job, roof, schedule.dt):
        say(remark)


def _describe_memory(job: Job, roof: Roof, say) -> None:
    net, state = roof.whole.net, roof.state
    n, m = net.n, net.m
    held = sum(getattr(state, f.name).nbytes for f in FIELDS if getattr(state, f.name) is not None)
    frames = job.output.frames + 1 if job.dynamics else 1
    file = frames * (n * FRAME_BYTES["particle"] + m * FRAME_BYTES["element"]) + (
        job.load.steps * (24 * n + 8 * m) if job.load else 0
    )
    say(
        f"memory: {held / 1e6:.3g} MB for the state ({held / m:.0f} bytes an element) and {SETUP_BYTES * m / 1e6:.3g} MB on rank 0 at set-up, beside "
        f"some 250 MB for Python on each rank; result file about {max(file, 1e5) / 1e6:.3g} MB"
    )
    if (
        np.isfinite(net.fracture_strain).any()
        and job.wind is None
        and job.dynamics
        and not (job.load and (job.load.dead or job.load.pressure is not None))
    ):
        say("note: elements can break, but neither wind nor load acts on the roof")
