"""Commands on results and on nets of other programs: print, draw, view, report, import, export. No MPI."""

from functools import partial
from pathlib import Path
from typing import Any

from netfall.cli import messages
from netfall.cli import options as take
from netfall.cli.options import JSON, RESULT, command, flag, option, to_file, to_folder
from netfall.core.errors import InputError
from netfall.core.messages import is_warning, say_counted, warning_count
from netfall.core.progress import print_lines
from netfall.exchange.formats import endings


@command(RESULT, JSON)
def info(result: Path, json: bool) -> None:
    """Summarise a result or study file: what ran, how it ended and what broke first.

    example:
      netfall info results/stadium.vtkhdf
    """
    from netfall.results.file import is_study

    if is_study(result):
        if json:
            raise InputError(messages.JSON_OF_STUDY(path=result))
        from netfall.study.answers.info import print_study

        say_counted(partial(print_study, result), print_lines)
    elif json:
        from netfall.post.report.info import print_info_json

        print_info_json(result, print)
    else:
        from netfall.post.report.info import print_info

        print_info(result, print_lines)


@command(
    RESULT,
    to_folder("folder for the pictures (default: that of the result file)"),
    option("--case", "NAME", "draw a single equilibrium: a case, a stage, initial_state, statics, form"),
    flag("--animate", help="animate the dynamic stage instead of drawing pictures"),
    option("--format", None, "format of the animation (default: mp4)", choices=("mp4", "gif")),
    option("--fps", "N", "frames per second of the animation (default: 15)", take.count),
    option(
        "--view",
        "VIEW",
        "view of the animation: space, plan, front, side, or elevation and azimuth in degrees: 28,-60",
        take.view,
    ),
    option("--size", "WxH", "size of the animation in pixels (default: 720x600)", take.size),
    option("--zoom", "Z", "enlarge the animation by this factor (default: 1, all fits)", take.factor),
    option("--until", "T", "end time of the animation [s]", take.time),
)
def plot(result: Path, folder: Path | None, case: str | None, animate: bool, **film: Any) -> None:
    """Draw pictures, or an animation, of a result or study file.

    examples:
      netfall plot results/stadium.vtkhdf -o pictures
      netfall plot results/dome.vtkhdf --case "snow"
      netfall plot results/stadium.vtkhdf --animate --fps 25 --view 15,-40 --size 1280x720 --until 5
    """
    from netfall.results.file import is_study

    given = {name: value for name, value in film.items() if value is not None}
    if given and not animate:
        names = ", ".join(f"--{name}" for name in film)
        raise InputError(messages.ANIMATION_OPTIONS(names=names))
    if animate and case is not None:
        raise InputError(messages.CASE_OF_ANIMATION(case=case))
    if animate and is_study(result):
        raise InputError(messages.STUDY_WITHOUT_FRAMES(path=result))
    folder = take.output_folder(folder or result.parent)
    if animate:
        from netfall.post.plots.canvas import VIEWS
        from netfall.post.plots.film import FilmView
        from netfall.post.plots.film import animate as write_film

        form, fps = given.pop("format", None), given.pop("fps", None)
        if given.get("view") in VIEWS:
            given["view"] = VIEWS[given["view"]]
        path, words = write_film(result, folder, form, fps, FilmView(**given))
        print_lines(f"{path}: {words}")
        return
    from netfall.post.plots.run import plot_all, plot_state
    from netfall.post.plots.study.study import plot_study

    if case is None:
        print_lines(*(plot_study if is_study(result) else plot_all)(result, folder))
    elif is_study(result):
        raise InputError(messages.CASE_OF_STUDY(case=case, path=result))
    else:
        print_lines(plot_state(result, folder, case))


@command(
    RESULT,
    to_file("the page (default: RESULT with .html, in the same folder)", "FILE.html"),
    option("--sample", "N", "kept sample of a study (default: the one with most detached area)", take.number),
)
def view(result: Path, output: Path | None, sample: int | None) -> None:
    """Write an interactive 3-D page of a result or study file, for any browser, without network.

    example:
      netfall view results/stadium.vtkhdf
    """
    from netfall.post.page.page import write_page
    from netfall.post.page.study import write_study_page
    from netfall.results.file import is_study

    page = output or result.parent / f"{result.name.removesuffix('.h5').removesuffix('.vtkhdf')}.html"
    if output and output.suffix.lower() not in (".html", ".htm"):
        raise InputError(messages.NO_PAGE_NAME(path=page))
    take.output_folder(page.parent)
    if is_study(result):
        words = write_study_page(result, page, sample)
    elif sample is not None:
        raise InputError(messages.SAMPLE_OF_RESULT(sample=sample, path=result))
    else:
        words = write_page(result, page)
    print_lines(f"{page}: {words}; open it in a browser")


@command(
    RESULT,
    to_folder("folder for the report (default: RESULT-report next to the result file)"),
    option("--codes", "FILE", "checks and their factors, replacing EN 1993-1-11, ASCE 19", Path),
    option(
        "--temperature",
        "K",
        "temperature at which cables are measured, minus that of form finding",
        take.warming,
        default="0",
    ),
    option(
        "--measuring-load",
        "N",
        "tension at which cables are measured (default: mean of each); bars: 0",
        take.tension,
    ),
    option(
        "--deductions",
        "FILE",
        "table of rigid ends for the shop list: group, type, pin, socket [mm]",
        Path,
    ),
)
def report(
    result: Path,
    folder: Path | None,
    codes: Path | None,
    temperature: float,
    measuring_load: float | None,
    deductions: Path | None,
) -> None:
    """Write checks, cases, reactions and a shop list: report.html, summary.md, tables, pictures.

    example:
      netfall report results/stadium.vtkhdf -o report
    """
    from netfall.post.checks.cables import Cutting
    from netfall.post.report.report import write_report
    from netfall.results.file import open_checked, warnings_of_run

    folder = take.output_folder(folder or result.parent / f"{result.stem}-report")
    cutting, lines = Cutting(temperature, measuring_load), list[str]()
    print_lines(*write_report(result, folder, lines.append, codes, cutting, deductions), *lines)
    with open_checked(result) as f:
        print_lines(warning_count([*warnings_of_run(f), *filter(is_warning, lines)]))


UNITS = ("m", "dm", "cm", "mm", "km", "in", "ft", "yd")


@command(
    option("drawing", "FILE", None, Path),
    to_folder("folder for the tables, the picture, the report and the job", "FOLDER", required=True),
    option("--unit", None, "unit of the drawing (default: as given in the file)", choices=UNITS),
    option("--tolerance", "M", "join ends up to this distance apart [m]", take.length, default="1e-3"),
    option(
        "--supports",
        "LAYER",
        "layer that marks supports: its points, circles and blocks, and all nodes on its lines; or points, "
        "of any layer; or outline (default: as given in the file, otherwise the outline)",
    ),
    option(
        "--springs",
        "LAYER=K[,K,K]",
        "layer that marks elastic supports, and their stiffness [N/m], for all axes or for each",
        take.springs,
    ),
    option("--layers", "NAME,...", "layers to read, which become groups (default: all)", take.words),
    flag("--split", help="make a joint wherever elements cross, or an end lies on one"),
)
def import_(drawing: Path, folder: Path, **chosen: Any) -> None:
    """Convert a drawing or mesh (.dxf, .json of COMPAS, .vtu) to tables, a picture and a first job.

    examples:
      netfall import roof.dxf -o roof
      netfall import roof.dxf -o roof --unit mm --supports anchors --layers cables,edge
      netfall import plan.dxf -o plan --split --tolerance 5e-3
    """
    from netfall.exchange.drawings.importing import import_file
    from netfall.exchange.drawings.reading import ImportOptions

    options = ImportOptions(**chosen)
    say_counted(lambda say: import_file(drawing, folder, options, say), print_lines)


@command(
    RESULT,
    option(
        "-o",
        "FILE",
        f"what to write; the ending names the format: {', '.join(endings())} (.csv: a folder of tables)",
        Path,
        dest="output",
        required=True,
    ),
    option("--time", "T", "the state at this time [s], or end for the last (default: the form)", take.time),
    option("--case", "NAME", "the equilibrium of a case or combination (default: the form)"),
    option("--unit", None, "of a drawing", choices=("m", "cm", "mm"), default="m"),
)
def export(result: Path, output: Path, **wanted: Any) -> None:
    """Write a result in a format of other programs.

    examples:
      netfall export roof.vtkhdf -o roof.dxf
      netfall export roof.vtkhdf -o collapse.vtu --time 4.2
      netfall export roof.vtkhdf -o roof.tcl
    """
    from netfall.exchange.export import export as write

    say_counted(lambda say: write(result, output, say, **wanted), print_lines)
