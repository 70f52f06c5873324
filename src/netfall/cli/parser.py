"""The words of the command line: the commands, their options, and what each option takes."""

import argparse
from pathlib import Path

from netfall.cli import arguments as take
from netfall.cli.examples import shown
from netfall.ground.errors import InputError

VERBS = (
    *("check", "partition", "run", "info", "plot", "report", "scale", "trade", "study"),
    *("import", "export", "init"),
)


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message: str):
        raise InputError(f"{self.prog}: {message}; {self.prog} --help shows what it takes")


INIT = "write a job to start from, with every key in it"
STUDY = "many runs of a job: ensembles, fragility, loss of each element; goes on where it was interrupted"
IMPORT = "a drawing or mesh (.dxf, .json of COMPAS, .vtu) to tables, a picture and a first job"


def parser() -> Parser:
    """The commands and their options."""
    about = "Form finding, load and collapse analysis of cable roofs on MPI ranks."
    top = Parser(prog="netfall", description=about)
    top.add_argument("--version", action="store_true", help="print the version and the MPI and HDF5 in use")
    verbs = top.add_subparsers(dest="verb", metavar=" | ".join(VERBS))
    _init(verbs.add_parser("init", help=INIT, description=INIT))
    text = "validate a job; print sizes, step limits, memory and expected run time; draw its net"
    _folder(_of_job(verbs, "check", text), None, "folder for a picture of the net (default: none is drawn)")
    _partition(_of_job(verbs, "partition", "write partitions/NAME.graph and NAME.graph.part.P"))
    _run(_of_job(verbs, "run", "run a job; on P ranks: mpirun -n P netfall run JOB"))
    _of_result(verbs, "info", "what ran, how it ended and what broke first, of a result or study file")
    _plot(_of_result(verbs, "plot", "pictures, or an animation, from a result or study file"))
    _report(
        _of_result(
            verbs,
            "report",
            "utilisation, cutting list, reactions: summary.md, tables and a picture from a result file",
        )
    )
    _scale(
        _of_job(
            verbs,
            "scale",
            "run a job on several numbers of ranks: strong and weak scaling, times of the phases",
        )
    )
    _trade(_of_job(verbs, "trade", "what each saving costs: run time against error over a grid of settings"))
    _study(verbs.add_parser("study", help=STUDY, description=STUDY))
    _import(verbs.add_parser("import", help=IMPORT, description=IMPORT))
    _export(
        _of_result(verbs, "export", "a result for other programs: .dxf, .csv, .tcl (OpenSees), .json, .vtu")
    )
    for name, verb in verbs.choices.items():
        verb.epilog, verb.formatter_class = shown(name), argparse.RawDescriptionHelpFormatter
    return top


def _init(verb: Parser) -> None:
    verb.add_argument(
        "job", type=take.file, nargs="?", default=Path("job.toml"), metavar="JOB", help="default: job.toml"
    )


def _of_job(verbs, name: str, text: str) -> Parser:
    """A command on a job file."""
    verb = verbs.add_parser(name, help=text, description=text)
    verb.add_argument("job", type=Path, metavar="JOB")
    verb.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a key of the job file; may be repeated",
    )
    return verb


def _of_result(verbs, name: str, text: str) -> Parser:
    """A command on a result file."""
    verb = verbs.add_parser(name, help=text, description=text)
    verb.add_argument("result", type=Path, metavar="RESULT")
    return verb


def _partition(verb: Parser) -> None:
    verb.add_argument("-n", type=int, required=True, metavar="P", dest="parts", help="number of parts")


def _run(verb: Parser) -> None:
    verb.add_argument(
        "-o",
        type=take.file,
        metavar="FILE",
        dest="output",
        help="result file (default: the job's name with .vtkhdf, here)",
    )
    verb.add_argument(
        "--restart", type=Path, metavar="CHECKPOINT", help="go on from a checkpoint, on any number of ranks"
    )
    verb.add_argument(
        "--walltime",
        type=take.duration,
        metavar="HH:MM:SS",
        help="stop with a checkpoint (exit code 4) after this time",
    )
    verb.add_argument(
        "--profile",
        action="store_true",
        help="time forces, exchange and drift of every step too (some 0.2 microseconds a step)",
    )
    loud = verb.add_mutually_exclusive_group()
    loud.add_argument("--quiet", action="store_true", help="print errors only")
    loud.add_argument("--verbose", action="store_true", help="print residuals and step limits too")


def _plot(verb: Parser) -> None:
    _folder(verb, None, "folder of the pictures (default: beside the result file)")
    text = "an animation of the dynamic stage in place of the pictures"
    verb.add_argument("--animate", action="store_true", help=text)
    text = "of the animation (default: mp4 where ffmpeg is installed, else gif)"
    verb.add_argument("--format", choices=("mp4", "gif"), help=text)
    text = "frames of the animation in a second (default: 15)"
    verb.add_argument("--fps", type=take.count, metavar="N", help=text)


def _report(verb: Parser) -> None:
    _folder(verb, None, "folder of the report (default: RESULT-report beside the result file)")
    verb.add_argument(
        "--codes",
        type=Path,
        metavar="FILE",
        help="checks and their factors, instead of EN 1993-1-11, ASCE 19",
    )
    verb.add_argument(
        "--temperature",
        type=float,
        default=0.0,
        metavar="K",
        help="temperature at which cables are measured, above that of form finding (default: 0)",
    )
    verb.add_argument(
        "--measuring-load",
        type=float,
        metavar="N",
        dest="load",
        help="tension under which cables are measured (default: the mean tension of each in the form)",
    )


def _scale(verb: Parser) -> None:
    verb.add_argument("--ranks", type=take.counts, metavar="1,2,...", help="numbers of ranks, for a job")
    text = "numbers of workers, for a study file: runs a minute"
    verb.add_argument("--workers", type=take.counts, metavar="1,2,...", help=text)
    _launcher(verb)
    _repeats(verb, 3, "runs of each case, of which the best counts (default: 3)")
    _folder(verb, Path("."), "folder of the table and the picture (default: here)")


def _trade(verb: Parser) -> None:
    verb.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="SECTION.KEY=V1,V2,...",
        help="key and values; several: every combination (default: one key at a time)",
    )
    verb.add_argument(
        "--reference",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        help="setting of the reference "
        "(default: a tenth of the automatic step, or of the job's if that is shorter)",
    )
    verb.add_argument(
        "--tolerance",
        type=float,
        default=0.05,
        metavar="E",
        help="largest relative error of the setting that is recommended (default: 0.05)",
    )
    _repeats(verb, 2, "runs of each setting, of which the fastest counts (default: 2)")
    verb.add_argument(
        "--ranks", type=take.count, default=1, metavar="P", help="ranks of each run (default: 1)"
    )
    _launcher(verb)
    _folder(verb, Path("."), "folder of the table (HDF5) and the picture (default: here)")


def _study(verb: Parser) -> None:
    verb.add_argument("study", type=Path, metavar="STUDY", help="a study file")
    text = "study file (default: STUDY's name with .study.h5, here)"
    verb.add_argument("-o", type=take.file, metavar="FILE", dest="output", help=text)
    text = "runs at once (default: as many as there are cores)"
    verb.add_argument("--workers", type=take.count, metavar="W", help=text)
    text = "the I-th of N parts, for job arrays; without it the parts are joined, and what is missing is run"
    verb.add_argument("--shard", type=take.shard, metavar="I/N", help=text)
    verb.add_argument("--retry", action="store_true", help="run failed members again")
    _launcher(verb)
    verb.add_argument("--quiet", action="store_true", help="print errors only")


def _import(verb: Parser) -> None:
    verb.add_argument("drawing", type=Path, metavar="FILE")
    verb.add_argument(
        "-o",
        type=Path,
        required=True,
        metavar="FOLDER",
        dest="folder",
        help="folder for the tables, the picture, the report and the job",
    )
    units = ("m", "dm", "cm", "mm", "km", "in", "ft", "yd")
    verb.add_argument("--unit", choices=units, help="unit of the drawing (default: what the file says)")
    verb.add_argument(
        "--tolerance",
        type=take.length,
        default=1e-3,
        metavar="M",
        help="ends no farther apart are one node [m] (default: 1e-3)",
    )
    verb.add_argument(
        "--supports",
        metavar="LAYER",
        help="layer that marks supports: its points, circles and blocks, and all nodes on its lines; "
        "or points, of any layer; or outline (default: what the file says, else the outline)",
    )
    verb.add_argument(
        "--layers",
        type=take.words,
        metavar="NAME,...",
        help="layers to read, which become groups (default: all)",
    )
    verb.add_argument(
        "--split", action="store_true", help="make a joint wherever elements cross, or an end lies on one"
    )


def _export(verb: Parser) -> None:
    verb.add_argument(
        "-o",
        type=Path,
        required=True,
        metavar="FILE",
        dest="output",
        help="what to write; the ending names the format (.csv: a folder of tables)",
    )
    verb.add_argument(
        "--time",
        type=take.time,
        metavar="T",
        help="the state at this time [s], or end for the last (default: the form)",
    )


# --- options that several commands have


def _launcher(verb: Parser) -> None:
    text = 'what starts the ranks (default: "mpirun -n {ranks}")'
    verb.add_argument("--launcher", metavar="COMMAND", help=text)


def _repeats(verb: Parser, default: int, text: str) -> None:
    verb.add_argument("--repeats", type=take.count, default=default, metavar="N", help=text)


def _folder(verb: Parser, default: Path | None, text: str) -> None:
    verb.add_argument("-o", type=Path, default=default, metavar="DIR", dest="folder", help=text)


# --- what an option takes
