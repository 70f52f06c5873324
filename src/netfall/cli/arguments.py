"""What options take, from the text on the command line."""

import argparse
import os
from pathlib import Path

TINY = 1e-300  # what is > 0


def file(text: str) -> Path:
    """The path of a file to write."""
    if text.endswith(os.sep) or not text:
        raise argparse.ArgumentTypeError(f"{text!r}: is a folder; expected the name of a file")
    return Path(text)


def count(text: str, least: int = 1) -> int:
    """A whole number >= least."""
    if not text.isdigit() or int(text) < least:
        raise argparse.ArgumentTypeError(f"{text}: expected a whole number >= {least}")
    return int(text)


def number(text: str) -> int:
    """A whole number >= 0."""
    return count(text, 0)


def counts(text: str) -> list[int]:
    """Different whole numbers >= 1, in ascending order."""
    return sorted({count(word.strip()) for word in text.split(",")})


def words(text: str) -> list[str]:
    """Names between commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def length(text: str) -> float:
    """Metres > 0."""
    return _between(text, TINY, 1e3, "a length > 0 in m")


def tension(text: str) -> float:
    """Newtons >= 0."""
    return _between(text, 0.0, 1e12, "a tension >= 0 in N")


def warming(text: str) -> float:
    """Kelvins, as `[load] temperature`."""
    return _between(text, -273.0, 1e3, "a change of temperature from -273 to 1000 K")


def _between(text: str, low: float, high: float, what: str) -> float:
    """A number; what : it is, in words"""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text}: expected {what}")
    return value


def time(text: str) -> float:
    """Seconds; inf for "end"."""
    try:
        seconds = float("inf") if text == "end" else float(text)
    except ValueError:
        seconds = -1.0
    if not seconds >= 0.0:
        raise argparse.ArgumentTypeError(f"{text}: expected a time >= 0 in s, or end")
    return seconds


def view(text: str) -> tuple[float, float] | str:
    """Elevation and azimuth [degrees], or a name."""
    if text in ("space", "plan", "front", "side"):
        return text
    try:
        elevation, azimuth = map(float, text.split(","))
        return elevation, azimuth
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text}: expected space, plan, front, side, or elevation and azimuth in degrees: 28,-60"
        ) from None


def size(text: str) -> tuple[int, int]:
    """Width and height [pixels], even."""
    parts = text.split("x")
    if len(parts) != 2 or not all(part.isdigit() and 300 <= int(part) <= 8000 for part in parts):
        raise argparse.ArgumentTypeError(f"{text}: expected WIDTHxHEIGHT, 300 to 8000 pixels each: 1280x720")
    return int(parts[0]) // 2 * 2, int(parts[1]) // 2 * 2


def factor(text: str) -> float:
    """A number > 0."""
    return _between(text, TINY, 1e3, "a number > 0")


def duration(text: str) -> float:
    """Seconds of HH:MM:SS."""
    parts = text.split(":")
    if len(parts) != 3 or not all(part.isdigit() for part in parts):
        raise argparse.ArgumentTypeError(f"{text}: expected HH:MM:SS")
    hours, minutes, seconds = map(int, parts)
    return 3600.0 * hours + 60.0 * minutes + seconds


def shard(text: str) -> tuple[int, int]:
    """I/N."""
    parts = text.split("/")
    whole = len(parts) == 2 and all(part.isdigit() for part in parts)
    if not whole or not 1 <= int(parts[0]) <= int(parts[1]):
        raise argparse.ArgumentTypeError(f"{text}: expected I/N, the I-th of N parts, for example 2/8")
    return int(parts[0]), int(parts[1])


def springs(text: str) -> tuple[str, tuple[float, ...]]:
    """A layer and stiffnesses (3,) [N/m] of LAYER=K or LAYER=KX,KY,KZ."""
    layer, _, values = text.rpartition("=")
    try:
        stiffness = tuple(float(value) for value in values.split(","))
    except ValueError:
        stiffness = ()
    good = len(stiffness) in (1, 3) and all(0.0 <= k < 1e15 for k in stiffness) and any(stiffness)
    if not layer or not good:
        raise argparse.ArgumentTypeError(
            f"{text}: expected LAYER=K or LAYER=KX,KY,KZ, with a stiffness > 0 in N/m"
        )
    return layer.strip(), stiffness * (3 // len(stiffness))
