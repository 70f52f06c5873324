"""Notes on what in a result is doubtful."""

import numpy as np

LARGEST_BALANCE = 0.01  # error of the physical balance above which a result is doubtful


def balance_notes(time: np.ndarray, balance: np.ndarray, broken: np.ndarray) -> list[str]:
    """A note if the physical balance of any row (t,) of the history is off by more than LARGEST_BALANCE."""
    off = np.flatnonzero(np.abs(balance) > LARGEST_BALANCE)
    if not len(off):
        return []
    smaller = "[dynamics] safety or time_step" + (", or fragment_mass" if broken[-1] else "")
    return [
        f"note: the physical balance is off by up to {np.abs(balance).max():.1%} of the energy that took "
        f"part, by more than {LARGEST_BALANCE:.0%} from t = {time[off[0]]:.4g} s on: the step is too long "
        f"for some of what happened; compare with a run of half the step (a smaller {smaller})"
    ]
