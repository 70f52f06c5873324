"""The words of the command line: the commands, their options, and what each option takes."""

import argparse
from collections.abc import Callable
from pathlib import Path

from netfall.cli import arguments as take
from netfall.cli.examples import shown
from netfall.exchange.formats import endings
from netfall.ground.errors import InputError

VERBS = (
    *("check", "partition", "run", "info", "plot", "view", "report", "scale", "trade", "study"),
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
    text = "a page to turn and to play in any browser, without network, from a result or study file"
    _view(_of_result(verbs, "view", text))
    text = "checks, cases, reactions, shop list: report.html, summary.md, tables, pictures of a result file"
    _report(_of_result(verbs, "report", text))
    text = "run a job on several numbers of ranks: strong and weak scaling, times of the phases"
    _scale(_of_job(verbs, "scale", text))
    _trade(_of_job(verbs, "trade", "what each saving costs: run time against error over a grid of settings"))
    _study(verbs.add_parser("study", help=STUDY, description=STUDY))
    _import(verbs.add_parser("import", help=IMPORT, description=IMPORT))
    text = f"a result for other programs: {', '.join(endings())}"
    _export(_of_result(verbs, "export", text))
    for name, verb in verbs.choices.items():
        verb.epilog, verb.formatter_class = shown(name), argparse.RawDescriptionHelpFormatter
    return top


def _init(verb: Parser) -> None:
    _value(verb, "job", take.file, "JOB", "default: job.toml", nargs="?", default=Path("job.toml"))


def _of_job(verbs, name: str, text: str) -> Parser:
    """A command on a job file."""
    verb = verbs.add_parser(name, help=text, description=text)
    _value(verb, "job", Path, "JOB", None)
    text = "override a key of the job file; may be repeated"
    _values(verb, "--set", "SECTION.KEY=VALUE", text, dest="overrides")
    return verb


def _of_result(verbs, name: str, text: str) -> Parser:
    """A command on a result file."""
    verb = verbs.add_parser(name, help=text, description=text)
    _value(verb, "result", Path, "RESULT", None)
    return verb


def _partition(verb: Parser) -> None:
    _value(verb, "-n", int, "P", "number of parts", required=True, dest="parts")


def _run(verb: Parser) -> None:
    text = "result file (default: the job's name with .vtkhdf, here)"
    _value(verb, "-o", take.file, "FILE", text, dest="output")
    _value(verb, "--restart", Path, "CHECKPOINT", "go on from a checkpoint, on any number of ranks")
    text = "stop with a checkpoint (exit code 4) after this time"
    _value(verb, "--walltime", take.duration, "HH:MM:SS", text)
    text = "time forces, exchange and drift of every step too (some 0.2 microseconds a step)"
    _flag(verb, "--profile", text)
    loud = verb.add_mutually_exclusive_group()
    _flag(loud, "--quiet", "print errors only")
    _flag(loud, "--verbose", "print residuals and step limits too")


def _plot(verb: Parser) -> None:
    _folder(verb, None, "folder of the pictures (default: beside the result file)")
    text = "one state at rest on a page of its own: a case, a stage, rest, statics, form"
    _value(verb, "--case", str, "NAME", text)
    _flag(verb, "--animate", "animations of the dynamic stage and of the erection in place of the pictures")
    text = "of the animation (default: mp4 where there is ffmpeg, else gif)"
    verb.add_argument("--format", choices=("mp4", "gif"), help=text)
    _value(verb, "--fps", take.count, "N", "frames of the animation in a second (default: 15; of stages 1)")
    text = "from where it is seen: space, plan, front, side, or elevation and azimuth in degrees: 28,-60"
    _value(verb, "--view", take.view, "VIEW", text)
    _value(verb, "--size", take.size, "WxH", "pixels of the animation (default: 720x600)")
    _value(verb, "--zoom", take.factor, "Z", "how much larger than what fits (default: 1)")
    _value(verb, "--until", take.time, "T", "where the animation of the dynamic stage ends [s]")


def _view(verb: Parser) -> None:
    text = "the page (default: RESULT's name with .html, beside it)"
    _value(verb, "-o", take.file, "FILE.html", text, dest="output")
    text = "of a study: the kept member to show (default: the one that loses most of its roof)"
    _value(verb, "--member", take.number, "N", text)


def _report(verb: Parser) -> None:
    _folder(verb, None, "folder of the report (default: RESULT-report beside the result file)")
    _value(verb, "--codes", Path, "FILE", "checks and their factors, instead of EN 1993-1-11, ASCE 19")
    text = "temperature at which cables are measured, above that of form finding (default: 0)"
    _value(verb, "--temperature", float, "K", text, default=0.0)
    text = "tension under which cables are measured (default: the mean tension of each in the form)"
    _value(verb, "--measuring-load", float, "N", text, dest="load")
    text = "table of rigid ends for the shop list: group, type, pin, socket [mm] at each end (default: none)"
    _value(verb, "--deductions", Path, "FILE", text)


def _scale(verb: Parser) -> None:
    _value(verb, "--ranks", take.counts, "1,2,...", "numbers of ranks, for a job")
    text = "numbers of workers, for a study file: runs a minute"
    _value(verb, "--workers", take.counts, "1,2,...", text)
    _launcher(verb)
    _repeats(verb, 3, "runs of each case, of which the best counts (default: 3)")
    _folder(verb, Path("."), "folder of the table and the picture (default: here)")


def _trade(verb: Parser) -> None:
    text = "key and values; several: every combination (default: one key at a time)"
    _values(verb, "--vary", "SECTION.KEY=V1,V2,...", text)
    text = "(default: a tenth of the automatic step, or of the job's if that is shorter)"
    _values(verb, "--reference", "SECTION.KEY=VALUE", f"setting of the reference {text}")
    text = "largest relative error of the setting that is recommended (default: 0.05)"
    _value(verb, "--tolerance", float, "E", text, default=0.05)
    _repeats(verb, 2, "runs of each setting, of which the fastest counts (default: 2)")
    _value(verb, "--ranks", take.count, "P", "ranks of each run (default: 1)", default=1)
    _launcher(verb)
    _folder(verb, Path("."), "folder of the table (HDF5) and the picture (default: here)")


def _study(verb: Parser) -> None:
    _value(verb, "study", Path, "STUDY", "a study file")
    text = "study file (default: STUDY's name with .study.h5, here)"
    _value(verb, "-o", take.file, "FILE", text, dest="output")
    _value(verb, "--workers", take.count, "W", "runs at once (default: as many as there are cores)")
    text = "the I-th of N parts, for job arrays; without it the parts are joined, and what is missing is run"
    _value(verb, "--shard", take.shard, "I/N", text)
    _flag(verb, "--retry", "run failed members again")
    _launcher(verb)
    _flag(verb, "--quiet", "print errors only")


def _import(verb: Parser) -> None:
    _value(verb, "drawing", Path, "FILE", None)
    text = "folder for the tables, the picture, the report and the job"
    _value(verb, "-o", Path, "FOLDER", text, required=True, dest="folder")
    units = ("m", "dm", "cm", "mm", "km", "in", "ft", "yd")
    verb.add_argument("--unit", choices=units, help="unit of the drawing (default: what the file says)")
    text = "ends no farther apart are one node [m] (default: 1e-3)"
    _value(verb, "--tolerance", take.length, "M", text, default=1e-3)
    text = (
        "layer that marks supports: its points, circles and blocks, and all nodes on its lines; "
        "or points, of any layer; or outline (default: what the file says, else the outline)"
    )
    _value(verb, "--supports", str, "LAYER", text)
    text = "layer that marks elastic supports, and their stiffness [N/m], along all axes or along each"
    _value(verb, "--springs", take.springs, "LAYER=K[,K,K]", text)
    _value(verb, "--layers", take.words, "NAME,...", "layers to read, which become groups (default: all)")
    _flag(verb, "--split", "make a joint wherever elements cross, or an end lies on one")


def _export(verb: Parser) -> None:
    text = "what to write; the ending names the format (.csv: a folder of tables)"
    _value(verb, "-o", Path, "FILE", text, required=True, dest="output")
    text = "the state at this time [s], or end for the last (default: the form)"
    _value(verb, "--time", take.time, "T", text)
    _value(verb, "--case", str, "NAME", "the equilibrium of a case or combination (default: the form)")
    verb.add_argument("--unit", choices=("m", "cm", "mm"), default="m", help="of a drawing (default: m)")


# --- kinds of options


def _value(verb: Parser, name: str, kind: Callable, what: str, text: str | None, **more) -> None:
    """A word or option with a value; what : the value in the help; more : as of `add_argument`"""
    verb.add_argument(name, type=kind, metavar=what, help=text, **more)


def _values(verb: Parser, name: str, what: str, text: str, **more) -> None:
    """An option that may be repeated."""
    verb.add_argument(name, action="append", default=[], metavar=what, help=text, **more)


def _flag(verb, name: str, text: str) -> None:
    verb.add_argument(name, action="store_true", help=text)


def _launcher(verb: Parser) -> None:
    _value(verb, "--launcher", str, "COMMAND", 'what starts the ranks (default: "mpirun -n {ranks}")')


def _repeats(verb: Parser, default: int, text: str) -> None:
    _value(verb, "--repeats", take.count, "N", text, default=default)


def _folder(verb: Parser, default: Path | None, text: str) -> None:
    _value(verb, "-o", Path, "DIR", text, default=default, dest="folder")
