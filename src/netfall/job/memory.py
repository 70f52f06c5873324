"""What runs in one process share: what one has found, the next need not find again.

A key says all that a finding depends on, so that it has the same bits whether it is found or remembered.
"""

import json
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from netfall.ground.errors import DivergedError, InputError
from netfall.job.job import Job


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
        kept = self._kept.setdefault(kind, OrderedDict())
        if key not in kept:
            try:
                kept[key] = (find(), None)
            except (InputError, DivergedError) as error:
                kept[key] = (None, error)
        kept.move_to_end(key)
        value, error = kept[key]
        while len(kept) > self.most:
            kept.popitem(last=False)  # that which was not asked for longest
        if error is not None:
            raise error.with_traceback(None)
        return value


FORGETFUL = Memory()  # for a run on its own


# What of a job does not bear on its net, its form, its equilibria and the model of its gusts, and why not.
# All else does, what is added to the job some day as well.
BESIDE = {
    "title": "a name",
    "text": "its values stand in the sections; comments change nothing",
    "overrides": "their values stand in the sections",
    "output.frames": "when the dynamic stage is written",
    "output.history": "when the dynamic stage is written",
    "output.probes": "what is written of the dynamic stage",
    "output.elements": "what is written of the dynamic stage",
    "output.checkpoint": "when the dynamic stage is saved",
    "output.modes": "found from the last equilibrium, for each run",
    "wind.seed": "gusts begin where the equilibria end",
    "wind.ramp": "over which the gusts then grow in",
}
# Nor do these bear on the net and its form, which no wind blows on.
OF_SPEED = ("wind.speed", "wind.turbulence", "wind.roughness")


def key_of(job: Job, without: tuple[str, ...] = ()) -> str:
    """What an initial state and its equilibria depend on, as a key; `without` these keys of sections too.

    The files that the job reads count by what stands in them. Raises InputError for one that cannot be read.
    """
    asked = {}
    for each in fields(job):
        value = getattr(job, each.name)
        if isinstance(value, SimpleNamespace):  # a section: its keys, as wind.speed
            asked |= {f"{each.name}.{key}": one for key, one in vars(value).items()}
        else:
            asked[each.name] = value
    asked = {name: value for name, value in asked.items() if name not in BESIDE.keys() | {*without}}
    asked["removes"] = bool(job.removes)  # what is lost, and when, comes after the equilibria
    asked["contents"] = [content.hex() for content in job.contents]
    asked["changes_net"] = job.changes_net()  # whether a partition made for its own net applies
    return json.dumps(asked, default=lambda value: str(value) if isinstance(value, Path) else vars(value))
