"""The commands, their options, and the values of each option."""

import argparse
import functools
from pathlib import Path
from typing import Any, NoReturn

from netfall.cli import arguments as take
from netfall.core.errors import InputError
from netfall.core.text_tables import table_rows
from netfall.exchange.formats import endings

VERBS = (
    *("check", "partition", "run", "info", "plot", "view", "report", "scale", "trade", "study"),
    *("import", "export", "init", "schema", "compile"),
)
# Line of a command: its name, its argument JOB (with --set) or RESULT; its help.
# Lines of its options: name, and the attribute if it differs; kind, or choices; value in the help; default;
# help.
COMMANDS = f"""
/init | write a job to start from, with every key in it, and the schema with which editors complete it
job | optional file | JOB | | default: job.toml, or the name of the example
--example | saddle,dome,wheel | | | a short job that runs as it is
/schema | print the JSON schema of a job file, with which editors complete and check keys
/check JOB | validate a job; print sizes, step limits, memory and expected run time; draw its net
-o folder | Path | DIR | | folder for a picture of the net (default: none is drawn)
--json | flag | | | print one JSON object in SI units instead of text
/partition JOB | write partitions/NAME.graph and NAME.graph.part.P
-n parts | int | P | required | number of parts
/run JOB | run a job; on P ranks: mpirun -n P netfall run JOB
-o output | file | FILE | | result file (default: the job's name with .vtkhdf, here)
--restart | Path | CHECKPOINT | | go on from a checkpoint, on any number of ranks
--walltime | duration | HH:MM:SS | | stop with a checkpoint (exit code 4) after this time
--profile | flag | | | time forces, exchange and drift of every step too (some 0.2 microseconds a step)
-q/--quiet | one flag | | | print errors only
-v/--verbose | one flag | | | print residuals and step limits too
/info RESULT | what ran, how it ended and what broke first, of a result or study file
--json | flag | | | print one JSON object in SI units instead of text
/plot RESULT | pictures, or an animation, from a result or study file
-o folder | Path | DIR | | folder of the pictures (default: beside the result file)
--case | str | NAME | | one state at rest on a page of its own: a case, a stage, initial_state, statics, form
--animate | flag | | | animations of the dynamic stage and of the erection in place of the pictures
--format | mp4,gif | | | of the animation (default: mp4)
--fps | count | N | | frames of the animation in a second (default: 15; of stages 1)
--view | view | VIEW | | from where it is seen: space, plan, front, side, or elevation and azimuth in
    degrees: 28,-60
--size | size | WxH | | pixels of the animation (default: 720x600)
--zoom | factor | Z | | how much larger than what fits (default: 1)
--until | time | T | | where the animation of the dynamic stage ends [s]
/view RESULT | a page to turn and to play in any browser, without network, from a result or study file
-o output | file | FILE.html | | the page (default: RESULT's name with .html, beside it)
--sample | number | N | | of a study: the kept sample to show (default: the one that loses most of its roof)
/report RESULT | checks, cases, reactions, shop list: report.html, summary.md, tables, pictures of a result
    file
-o folder | Path | DIR | | folder of the report (default: RESULT-report beside the result file)
--codes | Path | FILE | | checks and their factors, instead of EN 1993-1-11, ASCE 19
--temperature | temperature_change | K | 0 | temperature at which cables are measured, above that of form
    finding (default: 0)
--measuring-load load | tension | N | | tension under which cables are measured (default: the mean tension of
    each in the form)
--deductions | Path | FILE | | table of rigid ends for the shop list: group, type, pin, socket [mm] at each
    end (default: none)
/scale JOB | run a job on several numbers of ranks: strong and weak scaling, times of the phases
--ranks | counts | 1,2,... | | numbers of ranks, for a job
--workers | counts | 1,2,... | | numbers of workers, for a study file: runs a minute
--launcher | str | COMMAND | | what starts the ranks (default: "mpirun -n {{ranks}}")
--repeats | count | N | 3 | runs of each case, of which the best counts (default: 3)
-o folder | Path | DIR | . | folder of the table and the picture (default: here)
/trade JOB | what each saving costs: run time against error over a grid of settings
--vary | several | SECTION.KEY=V1,V2,... | | key and values; several: every combination (default: one key at a
    time)
--reference | several | SECTION.KEY=VALUE | | setting of the reference (default: a tenth of the automatic
    step, or of the job's if that is shorter)
--tolerance | factor | E | 0.05 | largest relative error of the setting that is recommended (default: 0.05)
--repeats | count | N | 2 | runs of each setting, of which the fastest counts (default: 2)
--ranks | count | P | 1 | ranks of each run (default: 1)
--launcher | str | COMMAND | | what starts the ranks (default: "mpirun -n {{ranks}}")
-o folder | Path | DIR | . | folder of the table (HDF5) and the picture (default: here)
/study | many runs of a job: ensembles, fragility, loss of each element; goes on where it was interrupted
study | Path | STUDY | | a study file
-o output | file | FILE | | study file (default: STUDY's name with .study.h5, here)
--workers | count | W | | runs at once (default: as many as there are cores)
--shard | shard | I/N | | the I-th of N parts, for job arrays; without it the parts are joined, and what is
    missing is run
--retry | flag | | | run failed samples again
--launcher | str | COMMAND | | what starts the ranks (default: "mpirun -n {{ranks}}")
-q/--quiet | flag | | | print errors only
/import | a drawing or mesh (.dxf, .json of COMPAS, .vtu) to tables, a picture and a first job
drawing | Path | FILE | |
-o folder | Path | FOLDER | required | folder for the tables, the picture, the report and the job
--unit | m,dm,cm,mm,km,in,ft,yd | | | unit of the drawing (default: what the file says)
--tolerance | length | M | 1e-3 | ends no farther apart are one node [m] (default: 1e-3)
--supports | str | LAYER | | layer that marks supports: its points, circles and blocks, and all nodes on its
    lines; or points, of any layer; or outline (default: what the file says, else the outline)
--springs | springs | LAYER=K[,K,K] | | layer that marks elastic supports, and their stiffness [N/m], along
    all axes or along each
--layers | words | NAME,... | | layers to read, which become groups (default: all)
--split | flag | | | make a joint wherever elements cross, or an end lies on one
/export RESULT | a result for other programs: {", ".join(endings())}
-o output | Path | FILE | required | what to write; the ending names the format (.csv: a folder of tables)
--time | time | T | | the state at this time [s], or end for the last (default: the form)
--case | str | NAME | | the equilibrium of a case or combination (default: the form)
--unit | m,cm,mm | | m | of a drawing (default: m)
/compile | compile what ordinary runs need (a minute); without it a first run does
"""
EXAMPLES = """
netfall init roof.toml
netfall init --example dome
netfall schema
netfall check jobs/stadium.toml -o pictures
netfall check roof.toml --set wind.speed=45 --set cable.prestress=80e3
netfall partition jobs/stadium.toml -n 8
netfall run roof.toml
mpirun -n 2 netfall run jobs/stadium.toml -o results/stadium.vtkhdf
netfall run roof.toml -o gust.vtkhdf --set wind.seed=7 --set output.checkpoint_interval=1
netfall run roof.toml --restart roof.checkpoint-5-00004000.h5 --walltime 02:00:00
netfall info results/stadium.vtkhdf
netfall plot results/stadium.vtkhdf -o pictures
netfall plot results/dome.vtkhdf --case "snow"
netfall plot results/stadium.vtkhdf --animate --fps 25 --view 15,-40 --size 1280x720 --until 5
netfall view results/stadium.vtkhdf
netfall report results/stadium.vtkhdf -o report
netfall scale jobs/stadium.toml --ranks 1,2,4 --launcher "srun -n {ranks}"
netfall scale jobs/studies/stadium.toml --workers 1,2
netfall trade jobs/saddle.toml --vary dynamics.safety=0.8,0.4,0.2
netfall study jobs/studies/stadium.toml
netfall study jobs/studies/stadium.toml --shard 3/8
netfall study roof_study.toml -o results/roof.study.h5 --workers 16
netfall import roof.dxf -o roof
netfall import roof.dxf -o roof --unit mm --supports anchors --layers cables,edge
netfall import plan.dxf -o plan --split --tolerance 5e-3
netfall export roof.vtkhdf -o roof.dxf
netfall export roof.vtkhdf -o collapse.vtu --time 4.2
netfall export roof.vtkhdf -o roof.tcl
netfall compile
"""


# Options that version 0.5 renamed: old name, new name. Version 0.6 refuses the old one.
RENAMED_OPTIONS = {"--member": "--sample"}


def with_new_options(words: list[str]) -> tuple[list[str], list[str]]:
    """Return the words of a command line with new names of options, and a warning for each old name.

    Raises InputError if an option stands there under both names.
    """
    new_words, warnings = list(words), []
    for old, new in RENAMED_OPTIONS.items():
        old_places = [k for k, word in enumerate(words) if word.partition("=")[0] == old]
        if old_places and any(word.partition("=")[0] == new for word in words):
            raise InputError(f"netfall: {old} and {new} are one option; remove {old}")
        for k in old_places:
            new_words[k] = new + words[k].removeprefix(old)
        if old_places:
            warnings.append(f"warning: {old} is {new} since version 0.5. Version 0.6 refuses the old name.")
    return new_words, warnings


class Parser(argparse.ArgumentParser):
    """A parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{self.prog}: {message}; {self.prog} --help shows what it takes")


@functools.cache
def parser() -> Parser:
    """Return the parser of all commands and their options."""
    about = "Form finding, load and collapse analysis of cable roofs on MPI ranks."
    top = Parser(prog="netfall", description=about)
    top.add_argument("--version", action="store_true", help="print the version and the MPI and HDF5 in use")
    verbs = top.add_subparsers(dest="verb", metavar=" | ".join(VERBS))
    for name, *cells in table_rows(COMMANDS):
        if name.startswith("/"):
            name, *argument = name[1:].split()
            verb = verbs.add_parser(name, help=cells[0], description=cells[0])
            verb.epilog, verb.formatter_class = shown(name), argparse.RawDescriptionHelpFormatter
            exclusive = verb.add_mutually_exclusive_group() if name == "run" else None  # for kind "one flag"
            if argument:
                verb.add_argument(argument[0].lower(), type=Path, metavar=argument[0])
            if argument == ["JOB"]:
                text = "override a key of the job file; may be repeated"
                _add(verb, "--set overrides", "several", "SECTION.KEY=VALUE", "", text)
        else:
            _add(exclusive if cells[0] == "one flag" else verb, name, *cells)
    return top


def _add(verb: Any, name: str, kind: str, what: str, default: str, text: str) -> None:
    """Add a word or an option to a command, from the cells of its row.

    A default is converted as if it were typed.
    """
    name, *attribute = name.split()
    settings: dict[str, Any] = {"dest": attribute[0]} if attribute else {}
    if kind.endswith("flag"):
        settings["action"] = "store_true"
    elif kind == "optional file":
        settings |= {"type": take.file, "metavar": what, "nargs": "?"}
    elif kind == "several":
        settings |= {"action": "append", "default": [], "metavar": what}
    elif "," in kind:
        settings |= {"choices": tuple(kind.split(",")), "default": default or None}
    else:
        known: dict[str, Any] = {"Path": Path, "str": str, "int": int, "float": float}
        settings |= {"type": known[kind] if kind in known else getattr(take, kind), "metavar": what}
        if default == "required":
            settings["required"] = True
        elif default:
            settings |= {"default": default} | ({} if name.startswith("-") else {"nargs": "?"})
    verb.add_argument(*name.split("/"), help=text or None, **settings)


def shown(verb: str) -> str:
    """Return the examples of a command, which its help prints below the options."""
    lines = [line for line in EXAMPLES.splitlines() if f"netfall {verb} " in f"{line} "]
    title = "examples:" if len(lines) > 1 else "example:"
    return "\n".join([title, *(f"  {line}" for line in lines)]) if lines else ""
