"""Compares two result files: python same_bits.py FIRST SECOND. Exit code 1 if a dataset differs."""

import sys

import h5py
import numpy as np


def datasets(path: str) -> dict[str, np.ndarray]:
    """Every dataset by name."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None
        )
    return found


def bits(value: object) -> bytes:
    """The bits of a dataset."""
    return (
        np.asarray(value).astype("S").tobytes()
        if np.asarray(value).dtype == object
        else np.asarray(value).tobytes()
    )


first, second = (datasets(path) for path in sys.argv[1:])
differ = sorted(
    name
    for name in first.keys() | second.keys()
    if name not in first or name not in second or bits(first[name]) != bits(second[name])
)
print(
    f"{len(first)} datasets, " + (f"different: {', '.join(differ)}" if differ else "all with the same bits")
)
sys.exit(bool(differ))
