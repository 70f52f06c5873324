"""Numbers of a page: arrays of two-byte integers in one compressed block."""

import base64
import zlib
from typing import Any

import numpy as np

LARGEST = 32_767  # largest value of a two-byte integer
NONE = -32_768  # code of a missing value


class ArrayBlock:
    """Collector of the arrays of a page; `add` returns the dictionary that refers to an array."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def add(self, values: np.ndarray) -> dict[str, Any]:
        """Add an array of int16, int32 or float32."""
        kind = {"int16": "Int16Array", "int32": "Int32Array", "float32": "Float32Array"}[values.dtype.name]
        data = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
        reference = {"kind": kind, "from": self.size, "length": values.size}
        self.parts.append(data + bytes(-len(data) % 4))
        self.size += len(self.parts[-1])
        return reference

    def add_series(self, values: np.ndarray, largest: float, nonzero: bool = False) -> dict[str, Any]:
        """Add values (k, ...) of k states as shares of the largest; nan and larger values become missing.

        A state holds the differences from the state before, which are small; they wrap around.
        nonzero : values other than zero stay so, however small they are
        """
        unit = largest / LARGEST or 1.0
        with np.errstate(invalid="ignore"):
            rounded = np.round(values / unit)
            rounded = np.where(np.abs(rounded) <= LARGEST, rounded, NONE)
            vanished = (rounded == 0) & (values != 0.0) & nonzero
        rounded = np.where(vanished, np.sign(values), rounded).astype(np.int16)
        return self.add(np.diff(rounded, axis=0, prepend=np.zeros_like(rounded[:1]))) | {"unit": unit}

    def text(self) -> str:
        """Encode all arrays as text."""
        return base64.b64encode(zlib.compress(b"".join(self.parts), 9)).decode()
