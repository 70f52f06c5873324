"""Commands that exchange nets and results with other programs."""

from pathlib import Path
from typing import Any

from netfall.cli import values as take
from netfall.cli.options import RESULT, command, flag, option, to_folder
from netfall.core.progress import print_lines
from netfall.exchange.formats import endings

UNITS = ("m", "dm", "cm", "mm", "km", "in", "ft", "yd")


@command(
    option("drawing", "FILE", None, Path),
    to_folder("folder for the tables, the picture, the report and the job", "FOLDER", required=True),
    option("--unit", None, "unit of the drawing (default: what the file says)", choices=UNITS),
    option("--tolerance", "M", "ends no farther apart are one node [m]", take.length, default="1e-3"),
    option(
        "--supports",
        "LAYER",
        "layer that marks supports: its points, circles and blocks, and all nodes on its lines; or points, "
        "of any layer; or outline (default: what the file says, else the outline)",
    ),
    option(
        "--springs",
        "LAYER=K[,K,K]",
        "layer that marks elastic supports, and their stiffness [N/m], along all axes or along each",
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

    import_file(drawing, folder, ImportOptions(**chosen), print_lines)


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
    from netfall.exchange.export import Wanted
    from netfall.exchange.export import export as write

    write(result, output, Wanted(**wanted), print_lines)
