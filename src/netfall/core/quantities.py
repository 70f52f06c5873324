"""Text of quantities for people: forces in kN, displacements in mm, pressures in kN/m2. Files keep SI."""


def kN(*forces: float, digits: int = 4) -> str:
    """Return the text of a force [N], or of a range from two: "12.5 to 80 kN"."""
    return f"{_numbers(forces, 1e-3, digits)} kN"


def mm(*lengths: float, digits: int = 4) -> str:
    """Return the text of a displacement [m], or of a range from two."""
    return f"{_numbers(lengths, 1e3, digits)} mm"


def kN_m2(*pressures: float, digits: int = 4) -> str:
    """Return the text of a pressure [Pa], or of a range from two."""
    return f"{_numbers(pressures, 1e-3, digits)} kN/m2"


def _numbers(values: tuple[float, ...], factor: float, digits: int) -> str:
    """Return numbers with significant digits, large ones without an exponent."""
    scaled = [factor * value for value in values]
    return " to ".join(
        f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}" for value in scaled
    )
