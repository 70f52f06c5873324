"""Numbers for a page: arrays as whole numbers of two bytes, one block of them all, compressed."""

import base64
import zlib

import numpy as np

LARGEST = 32_767
NONE = -32_768  # no value


class Numbers:
    """Arrays on their way into a page; each is named in the page by a dictionary that `add` gives."""

    def __init__(self):
        self.parts: list[bytes] = []
        self.size = 0

    def add(self, values: np.ndarray) -> dict:
        """Take an array of whole numbers of two bytes, or of four as int32 or float32."""
        kind = {"int16": "Int16Array", "int32": "Int32Array", "float32": "Float32Array"}[values.dtype.name]
        data = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
        place = {"kind": kind, "from": self.size, "length": values.size}
        self.parts.append(data + bytes(-len(data) % 4))
        self.size += len(self.parts[-1])
        return place

    def add_in_time(self, values: np.ndarray, largest: float, nonzero: bool = False) -> dict:
        """Take values (k, ...) of k states as shares of the largest; nan and what is beyond it have no value.

        A state holds the differences from the one before, which are small; they wrap around.
        nonzero : what is not zero, however small, is not in the page either
        """
        unit = largest / LARGEST or 1.0
        with np.errstate(invalid="ignore"):
            whole = np.round(values / unit)
            whole = np.where(np.abs(whole) <= LARGEST, whole, NONE)
            some = (whole == 0) & (values != 0.0) & nonzero
        whole = np.where(some, np.sign(values), whole).astype(np.int16)
        return self.add(np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1]))) | {"unit": unit}

    def text(self) -> str:
        """All of them, for the page."""
        return base64.b64encode(zlib.compress(b"".join(self.parts), 9)).decode()
