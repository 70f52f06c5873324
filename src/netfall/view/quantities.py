"""What a page shows by colour: axial force, utilisation, strain; with their scales, units and colours."""

from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_hex

from netfall.checks.cables import resistances_of
from netfall.checks.codes import read_codes
from netfall.plots.canvas import BROKEN, GUIDED, NOTHING, SUPPORT, unit_of
from netfall.plots.force import COMPRESSION, SLACK, TENSION, TRACE, limits
from netfall.view.states import Drawn, States

SHADES = 64  # of a scale
MOST_LOOKED_AT = 2_000_000  # values from which the ends of a scale are found


@dataclass(frozen=True)
class Quantity:
    """A choice of the page. Values in `unit` are those of the file times `factor`.

    tension, compression : ends of the two scales in the file's unit, None: there is none
    at_rest : what it is of states at rest
    per : (m,) what forces are divided by, None: they are not; values : (m,) of the elements in all states
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
    """The colours of pictures, as a page takes them."""
    shades = lambda of: [to_hex(colour) for colour in of(np.linspace(0.0, 1.0, SHADES))]
    plain = {"slack": SLACK, "broken": BROKEN, "none": NOTHING, "support": SUPPORT, "guided": GUIDED}
    return {"tension": shades(TENSION), "compression": shades(COMPRESSION)} | plain


def quantities(f, drawn: Drawn, shown: list[States]) -> list[Quantity]:
    """What there is to choose: the force, what it is of a strength where some are given, the strain."""
    forces = [without_traces(f, drawn, states.tension) for states in shown]
    check = read_codes()[0]
    resistance = resistances_of(f, [check])[check.name][drawn.rows]
    EA = f["net/axial_stiffness"][:][drawn.rows]
    strain = lambda s, N: N / EA if s.strain is None else np.where(np.isnan(N), N, s.strain)
    strains = [strain(*each) for each in zip(shown, forces)]
    ends = _ends(forces)
    largest = max((end[1] for end in ends if end), default=0.0)
    factor, unit = unit_of(largest, "N")
    found = [Quantity("axial force", "axial force", unit, factor, *ends)]
    if np.isfinite(resistance).any():
        used, _ = _ends([N / resistance for N in forces])
        name = f"utilisation in tension, {check.title.split(':')[0]}"
        found.append(Quantity(name, name, "-", 1.0, used, None, resistance))
    found.append(Quantity("strain", "elastic strain", "%", 100.0, *_ends(strains), EA))
    return found


def without_traces(f, drawn: Drawn, N: np.ndarray) -> np.ndarray:
    """Forces (k, m) [N] with 0 in bars that carry next to nothing."""
    bar = f["net/bar"][:].astype(bool)[drawn.rows]
    largest = np.nanmax(np.abs(N), initial=0.0)
    return np.where(bar & (np.abs(N) < TRACE * largest), 0.0, N)


def _ends(values: list[np.ndarray]) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
    """Ends of the scales for what is positive and what is negative of some values; all states count alike."""
    size = sum(each.size for each in values)
    some = np.concatenate([each.ravel()[:: 1 + size // MOST_LOOKED_AT] for each in values])
    return limits(some[some > 0.0]), limits(-some[some < 0.0])
