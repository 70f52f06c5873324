"""What runs in one process share: what one has found, the next need not find again.

A key says all that a finding depends on, so that it has the same bits whether it is found or remembered.
"""

import json
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

from netfall.errors import DivergedError, InputError
from netfall.job.read import Job


class Memory:
    """The last findings of each kind. On several ranks all ask for the same in the same order."""

    def __init__(self, most: int = 0):
        """most : findings of each kind that are kept; 0: none"""
        self.most = most
        self._kept: dict[str, OrderedDict[Hashable, Any]] = {}

    def once(self, kind: str, key: Hashable, find: Callable[[], Any]) -> Any:
        """What `find` finds, or found for this key before. That there is none, an error, is kept as well.

        What is returned is shared: nobody may change it.
        """
        found = self.get(kind, key)
        if found is None:
            try:
                found = (find(), None)
            except (InputError, DivergedError) as error:
                found = (None, error)
            self.keep(kind, key, found)
        value, error = found
        if error is not None:
            raise error.with_traceback(None)
        return value

    def get(self, kind: str, key: Hashable) -> Any:
        """What is kept for a key, None if nothing is."""
        kept = self._kept.get(kind, {})
        if key in kept:
            kept.move_to_end(key)
        return kept.get(key)

    def keep(self, kind: str, key: Hashable, value: Any) -> None:
        """Keep a value for a key, and forget the one that was not asked for longest."""
        kept = self._kept.setdefault(kind, OrderedDict())
        kept[key] = value
        while len(kept) > self.most:
            kept.popitem(last=False)


FORGETFUL = Memory()  # for a run on its own


# What makes a job's net and its state before gusts act; and what of its wind does not.
SECTIONS = ("path", "net", "cable", "groups", "form_finding", "roof", "zones", "load", "cases", "dynamics")
OF_GUSTS = ("seed", "ramp")
OF_SPEED = ("speed", "turbulence", "roughness")  # nor makes a net


def key_of(job: Job, without: tuple[str, ...] = ()) -> str:
    """What an initial state and its equilibria depend on, as a key; `without` these keys of [wind] too."""
    wind = vars(job.wind) if job.wind else {}
    asked = {name: getattr(job, name) for name in SECTIONS}
    asked["wind"] = {name: value for name, value in wind.items() if name not in OF_GUSTS + without}
    return json.dumps(asked, default=lambda value: str(value) if isinstance(value, Path) else vars(value))
