"""Pictures from a result file (matplotlib, no display needed), without the solver.

The pictures depend on the content of the file: the form (paper Fig. 6, 10), stages of erection, equilibria,
the roof in plan, the load-displacement curve (Fig. 6), stages of the collapse (Fig. 7, 11), energies (Fig. 8,
15), tensions and displacements of the probes (Fig. 13, 14), slip along cables, wind.
"""

import re
from pathlib import Path

from netfall.post.plots import curves
from netfall.post.plots.canvas import save
from netfall.post.plots.collapse import collapse
from netfall.post.plots.modes import modes
from netfall.post.plots.roof import has_roof, roof
from netfall.post.plots.states import (
    find_equilibrium,
    form,
    has_stages,
    has_states,
    one_state,
    stages,
    states,
)
from netfall.post.plots.utilisation import slips
from netfall.results.file import open_checked


def plot_state(result: Path, folder: Path, name: str) -> Path:
    """Write the page of one equilibrium, given by name, and return its path.

    Raises InputError for a wrong file, and for an unknown name.
    """
    with open_checked(result) as f:
        figure = one_state(f, find_equilibrium(f, name))
        folder.mkdir(parents=True, exist_ok=True)
        suffix = re.sub(r"[^\w.-]+", "_", name)
        return save(figure, folder / f"{result.stem}_{suffix}.png")


def plot_all(result: Path, folder: Path) -> list[Path]:
    """Write every picture that the result file has data for, and return their paths.

    Raises InputError for a wrong file.
    """
    with open_checked(result) as f:
        folder.mkdir(parents=True, exist_ok=True)
        has_dynamics = "history" in f
        has_probes = has_dynamics and "probe_displacement" in f["history"]
        has_probes = has_probes and f["history/probe_displacement"].shape[1] > 0
        pictures = [
            ("form", form, "form_finding" in f),
            ("stages", stages, has_stages(f)),
            ("states", states, has_states(f)),
            ("roof", roof, has_roof(f)),
            ("load_displacement", curves.load_displacement, curves.has_load_path(f)),
            ("collapse", collapse, has_dynamics),
            ("modes", modes, "modes" in f and len(f["modes/period"])),
            ("slip", slips, "slide" in f),
            ("energies", curves.energies, has_dynamics and curves.has_energies(f)),
            ("tensions", curves.tensions, has_dynamics),
            ("displacements", curves.displacements, has_probes),
            ("wind", curves.wind, "wind" in f),
        ]
        return [
            save(draw(f), folder / f"{result.stem}_{name}.png") for name, draw, present in pictures if present
        ]
