"""Quantities that a page shows by colour: axial force, utilisation, strain; with scales and units."""

from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_hex

from netfall.post.checks.cables import element_resistances
from netfall.post.checks.codes import read_codes
from netfall.post.page.states import DrawnPart, StateSeries
from netfall.post.plots.canvas import BROKEN, GUIDED, NOTHING, SUPPORT_COLOUR, unit_of
from netfall.post.plots.force import COMPRESSION, SLACK, TENSION, TRACE, limits

SHADES = 64  # colours of a scale
MAX_SAMPLES = 2_000_000  # values from which the ends of a scale are computed


@dataclass(frozen=True)
class Quantity:
    """Quantity that the page can show; values in `unit` are those of the file times `factor`.

    tension, compression : ends of the two scales in the file's unit, None: there is none
    at_rest : name of the quantity in static states
    per : (m,) divisor of forces, None: none; values : (m,) of the elements, the same in all states
    """

    name: str
    at_rest: str
    unit: str
    factor: float
    tension: tuple[float, float] | None
    compression: tuple[float, float] | None
    per: np.ndarray | None = None
    values: np.ndarray | None = None


def palette() -> dict:
    """Return the colours of pictures in the form that a page needs."""
    single = {"slack": SLACK, "broken": BROKEN, "none": NOTHING, "support": SUPPORT_COLOUR, "guided": GUIDED}
    return {"tension": _shades(TENSION), "compression": _shades(COMPRESSION)} | single


def _shades(colormap) -> list[str]:
    """Return the colours of a matplotlib colormap as hexadecimal numbers."""
    return [to_hex(colour) for colour in colormap(np.linspace(0.0, 1.0, SHADES))]


def quantities(f, drawn: DrawnPart, shown: list[StateSeries]) -> list[Quantity]:
    """Return the quantities to choose from: force, utilisation if strengths are given, strain."""
    forces = [without_negligible(f, drawn, states.tension) for states in shown]
    check = read_codes()[0]
    resistance = element_resistances(f, [check])[check.name][drawn.rows]
    EA = f["net/axial_stiffness"][:][drawn.rows]
    strains = [
        N / EA if states.strain is None else np.where(np.isnan(N), N, states.strain)
        for states, N in zip(shown, forces)
    ]
    ends = _ends(forces)
    largest = max((end[1] for end in ends if end), default=0.0)
    factor, unit = unit_of(largest, "N")
    choices = [Quantity("axial force", "axial force", unit, factor, *ends)]
    if np.isfinite(resistance).any():
        limits_of_utilisation, _ = _ends([N / resistance for N in forces])
        name = f"utilisation in tension, {check.title.split(':')[0]}"
        choices.append(Quantity(name, name, "-", 1.0, limits_of_utilisation, None, resistance))
    choices.append(Quantity("strain", "elastic strain", "%", 100.0, *_ends(strains), EA))
    return choices


def without_negligible(f, drawn: DrawnPart, N: np.ndarray) -> np.ndarray:
    """Return forces (k, m) [N] with 0 in bars whose force is negligible."""
    bar = f["net/bar"][:].astype(bool)[drawn.rows]
    largest = np.nanmax(np.abs(N), initial=0.0)
    return np.where(bar & (np.abs(N) < TRACE * largest), 0.0, N)


def _ends(values: list[np.ndarray]) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
    """Return the ends of the scales of positive and of negative values, over all states alike."""
    size = sum(array.size for array in values)
    sample = np.concatenate([array.ravel()[:: 1 + size // MAX_SAMPLES] for array in values])
    return limits(sample[sample > 0.0]), limits(-sample[sample < 0.0])
