"""Pictures from a result file (matplotlib, no display needed), without the solver.

The pictures depend on the content of the file: the form (paper Fig. 6, 10), stages of erection, equilibria,
the roof in plan, the load-displacement curve (Fig. 6), stages of the collapse (Fig. 7, 11), energies (Fig. 8,
15), tensions and displacements of the probes (Fig. 13, 14), slip along cables, wind.
"""

import re
from pathlib import Path

import h5py

from netfall.post.plots import curves
from netfall.post.plots.canvas import remove_earlier, save
from netfall.post.plots.collapse import collapse
from netfall.post.plots.roof import roof
from netfall.post.plots.states import find_equilibrium, form, modes, one_state, stages, states
from netfall.results.file import open_checked
from netfall.results.states import equilibrium_groups

MAX_FILE_NAME = 255  # bytes, of the file systems of Linux
PICTURES = {  # group of a result file that a picture needs, and the function that draws it; None: no data
    "form": ("form_finding", form),
    "stages": ("stages", stages),
    "states": ("net", states),
    "roof": ("net", roof),
    "load_displacement": ("statics", curves.load_displacement),
    "collapse": ("history", collapse),
    "modes": ("modes", modes),
    "slip": ("slide", curves.slips),
    "energies": ("history", curves.energies),
    "tensions": ("history", curves.tensions),
    "displacements": ("history", curves.displacements),
    "wind": ("wind", curves.wind),
}


def plot_state(result: Path, folder: Path, name: str) -> Path:
    """Write the page of one equilibrium, given by name, and return its path.

    Raises InputError for a wrong file or an unknown name.
    """
    with open_checked(result) as f:
        state = find_equilibrium(f, name)
        figure = one_state(f, state)
        start, end = f"{result.stem}_", ".png"
        room = MAX_FILE_NAME - len(f"{start}{end}".encode())
        return save(
            figure, folder / f"{start}{file_suffix(name, state.place, equilibrium_groups(f), room)}{end}"
        )


def file_suffix(name: str, place: str, groups: list[str], room: int) -> str:
    """Return the name of an equilibrium for a file name; similar names get numbers.

    place : its group, one of `groups`; room : available length [bytes]
    """

    def plain(name: str, room: int = room) -> str:
        return re.sub(r"[^\w.-]+", "_", name).encode()[:room].decode(errors="ignore")

    alike = [group for group in groups if plain(name) in (plain(group), plain(group.split("/", 1)[-1]))]
    number = f"-{alike.index(place) + 1}" if place in alike[1:] else ""
    return plain(name, room - len(number)) + number


def plot_all(result: Path, folder: Path) -> list[Path]:
    """Write every picture for which the result file has data, and return their paths.

    Pictures of an earlier result of this name for which it has none are removed; those of states remain.

    Raises InputError for a wrong file.
    """
    with open_checked(result) as f:
        drawn = draw_pictures(f, folder, f"{result.stem}_", *PICTURES)
        names = PICTURES.keys() - {group.split("/", 1)[-1] for group in equilibrium_groups(f)}
    remove_earlier({folder / f"{result.stem}_{name}.png" for name in names} - {*drawn})
    return drawn


def draw_pictures(f: h5py.File, folder: Path, prefix: str, *names: str) -> list[Path]:
    """Write those pictures for which the result file has data, and return their paths."""
    wanted = [(name, *PICTURES[name]) for name in names]
    drawn = ((draw(f), folder / f"{prefix}{name}.png") for name, group, draw in wanted if group in f)
    return [save(figure, path) for figure, path in drawn if figure is not None]
