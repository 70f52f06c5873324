"""Pictures from a result file (matplotlib, no display needed). Reads the file alone, never the solver.

Which pictures come depends on what the file holds: the form (paper Fig. 6, 10), states at rest, the roof in
plan, the load-displacement curve (Fig. 6), stages of the collapse (Fig. 7, 11), energies (Fig. 8, 15),
tensions and displacements of the probes (Fig. 13, 14), wind.
"""

from pathlib import Path

from netfall.plots.canvas import save
from netfall.plots.collapse import collapse
from netfall.plots.curves import displacements, energies, load_displacement, tensions, wind
from netfall.plots.modes import modes
from netfall.plots.roof import has_roof, roof
from netfall.plots.states import form, has_states, states
from netfall.results.file import missing_line, open_result


def _has_probes(history) -> bool:
    return "probe_displacement" in history and history["probe_displacement"].shape[1] > 0


def plot_all(result: Path, folder: Path) -> tuple[list[Path], list[str]]:
    """Write every picture that the result file has data for; their paths, and a line for each that cannot be.

    Raises InputError for a wrong file.
    """
    with open_result(result) as f:
        folder.mkdir(parents=True, exist_ok=True)
        pictures = [
            ("form", form, "form_finding" in f),
            ("states", states, has_states(f)),
            ("roof", roof, has_roof(f)),
            ("load_displacement", load_displacement, "statics" in f),
            ("collapse", collapse, "history" in f),
            ("modes", modes, "modes" in f and len(f["modes/period"])),
            ("energies", energies, "history" in f),
            ("tensions", tensions, "history" in f),
            ("displacements", displacements, "history" in f and _has_probes(f["history"])),
            ("wind", wind, "wind" in f),
        ]
        written, lacking = [], []
        for name, draw, there in pictures:
            if not there:
                continue
            try:
                figure = draw(f)
            except KeyError as error:
                lacking.append(f"{result}: {missing_line(error)}, so there is no picture {name}")
                continue
            written.append(save(figure, folder / f"{result.stem}_{name}.png"))
    return written, lacking
