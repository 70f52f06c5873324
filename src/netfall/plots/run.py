"""Pictures from a result file (matplotlib, no display needed). Reads the file alone, never the solver.

Which pictures come depends on what the file holds: the form (paper Fig. 6, 10), stages of erection, states at
rest, the roof in plan, the load-displacement curve (Fig. 6), stages of the collapse (Fig. 7, 11), energies
(Fig. 8, 15), tensions and displacements of the probes (Fig. 13, 14), slip along cables, wind.
"""

import re
from pathlib import Path

from netfall.plots import curves
from netfall.plots.canvas import save
from netfall.plots.collapse import collapse
from netfall.plots.modes import modes
from netfall.plots.roof import has_roof, roof
from netfall.plots.states import form, has_stages, has_states, named_state, one_state, stages, states
from netfall.plots.utilisation import slips
from netfall.results.file import reading


def plot_state(result: Path, folder: Path, name: str) -> Path:
    """Write the page of one equilibrium, by its name; its path.

    Raises InputError for a wrong file, and for a name that no state has.
    """
    with reading(result) as f:
        figure = one_state(f, named_state(f, name))
        folder.mkdir(parents=True, exist_ok=True)
        words = re.sub(r"[^\w.-]+", "_", name)
        return save(figure, folder / f"{result.stem}_{words}.png")


def plot_all(result: Path, folder: Path) -> list[Path]:
    """Write every picture that the result file has data for; their paths.

    Raises InputError for a wrong file.
    """
    with reading(result) as f:
        folder.mkdir(parents=True, exist_ok=True)
        moves = "history" in f
        probed = moves and "probe_displacement" in f["history"]
        probed = probed and f["history/probe_displacement"].shape[1] > 0
        pictures = [
            ("form", form, "form_finding" in f),
            ("stages", stages, has_stages(f)),
            ("states", states, has_states(f)),
            ("roof", roof, has_roof(f)),
            ("load_displacement", curves.load_displacement, curves.has_load_path(f)),
            ("collapse", collapse, moves),
            ("modes", modes, "modes" in f and len(f["modes/period"])),
            ("slip", slips, "slide" in f),
            ("energies", curves.energies, moves and curves.has_energies(f)),
            ("tensions", curves.tensions, moves),
            ("displacements", curves.displacements, probed),
            ("wind", curves.wind, "wind" in f),
        ]
        return [
            save(draw(f), folder / f"{result.stem}_{name}.png") for name, draw, there in pictures if there
        ]
