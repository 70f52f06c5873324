"""Commands that start many runs: scaling, accuracy, studies."""

from pathlib import Path
from typing import Any

from netfall.cli import messages
from netfall.cli import options as take
from netfall.cli.options import JOB, LAUNCHER, QUIET, SET, command, flag, option, to_file, to_folder
from netfall.core.errors import InputError
from netfall.core.progress import Progress, print_lines


@command(
    JOB,
    SET,
    option("--ranks", "1,2,...", "numbers of ranks", take.counts, required=True),
    LAUNCHER,
    option("--repeats", "N", "runs of each case; the fastest counts", take.count, default="3"),
    to_folder("folder of the table and the picture (default: here)"),
)
def scale(
    job: Path,
    overrides: list[str],
    ranks: list[int],
    launcher: str | None,
    repeats: int,
    folder: Path | None,
) -> None:
    """Measure strong and weak scaling of a job over several numbers of ranks, and times of the phases.

    example:
      netfall scale jobs/stadium.toml --ranks 1,2,4 --launcher "srun -n {ranks}"
    """
    from netfall.core.launch import default_launcher
    from netfall.post.accuracy.scale import scale as run_scale

    folder = take.output_folder(folder or Path())
    launcher = launcher or default_launcher()
    print_lines(*run_scale(job, overrides, ranks, launcher, repeats, folder, Progress(True).say))


@command(
    JOB,
    SET,
    option(
        "--vary",
        "SECTION.KEY=V1,V2,...",
        "key and values; if repeated, every combination (default: one key at a time)",
        several=True,
    ),
    option(
        "--reference",
        "SECTION.KEY=VALUE",
        "setting of the reference (default: a tenth of the automatic step, or of the job's step if shorter)",
        several=True,
    ),
    option(
        "--tolerance", "E", "largest relative error of a recommended setting", take.factor, default="0.05"
    ),
    option("--repeats", "N", "runs of each setting; the fastest counts", take.count, default="2"),
    option("--ranks", "P", "ranks of each run", take.count, default="1"),
    LAUNCHER,
    to_folder("folder of the table (HDF5) and the picture (default: here)"),
)
def trade(
    job: Path, overrides: list[str], ranks: int, launcher: str | None, folder: Path | None, **compared: Any
) -> None:
    """Run a job with a grid of settings, and print run time and error of each.

    example:
      netfall trade jobs/saddle.toml --vary dynamics.safety=0.8,0.4,0.2
    """
    from netfall.core.launch import default_launcher
    from netfall.core.timings import StopFlag
    from netfall.post.accuracy.trade import trade as run_trade

    paths = run_trade(
        path=job,
        overrides=overrides,
        **compared,
        ranks=ranks,
        launcher=launcher or default_launcher(),
        folder=take.output_folder(folder or Path()),
        say=Progress(True).say,
        stop=StopFlag(),
    )
    print_lines(*paths)


@command(
    option("study", "STUDY", "a study file", Path),
    to_file("result of the study (default: STUDY with .study.h5, in this folder)"),
    option("--workers", "W", "number of simultaneous runs (default: number of cores)", take.count),
    option(
        "--shard",
        "I/N",
        "run part I of N, for job arrays; without it join all parts, and run what is missing",
        take.shard,
    ),
    flag("--retry", help="run failed samples again"),
    option(
        "--device",
        None,
        "device for the dynamic stage; auto: a GPU if possible (default: [run] device)",
        choices=("cpu", "gpu", "auto"),
    ),
    LAUNCHER,
    QUIET,
)
def study(
    study: Path,
    output: Path | None,
    workers: int | None,
    shard: tuple[int, int] | None,
    retry: bool,
    device: str | None,
    launcher: str | None,
    quiet: bool,
) -> None:
    """Run or resume a study, many runs of a job: ensembles, fragility, removal of each element.

    examples:
      netfall study jobs/studies/stadium.toml
      netfall study jobs/studies/stadium.toml --shard 3/8
      netfall study roof_study.toml -o results/roof.study.h5 --workers 16
    """
    from netfall.core.launch import SIZES, launcher_variables
    from netfall.core.timings import StopFlag
    from netfall.study.study import study as run_study

    if max(launcher_variables(SIZES).values(), default=1) > 1:
        raise InputError(messages.STUDY_UNDER_MPIRUN())
    run_study(study, output, workers, shard, launcher, retry, Progress(not quiet), StopFlag(), device)
