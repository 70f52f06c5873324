"""Sets of integers by sorting; numpy's own use hashing, which takes ten times as long for a million."""

import numpy as np


def distinct(values: np.ndarray) -> np.ndarray:
    """Return the distinct values in ascending order."""
    ordered = np.sort(values, axis=None)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])[: len(ordered)]]


def first_largest(values: np.ndarray, number: np.ndarray) -> int:
    """Return the row of the largest of values (n,), n > 0; among equal ones, that of the least number (n,).

    With global numbers the choice does not depend on how a net is distributed.
    """
    row = int(np.argmax(values))
    equal = np.flatnonzero(values == values[row])
    return int(equal[np.argmin(number[equal])]) if len(equal) else row  # none equals nan


def is_one_of(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return whether each value is one of others (k,)."""
    if not len(others):
        return np.zeros(np.shape(values), bool)
    ordered = np.sort(others)
    return ordered[np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)] == values
