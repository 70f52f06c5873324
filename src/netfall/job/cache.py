"""Cache of results that several runs in one process share.

A key contains all inputs of a result, so a cached result has the same bits as a computed one.
"""

import json
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import fields
from pathlib import Path
from typing import Any

from netfall.core.errors import DivergedError, InputError
from netfall.job.job import Job
from netfall.job.keys.fields import Section


class ResultCache:
    """Cache of the latest results of each kind. All ranks must request the same results in the same order."""

    def __init__(self, most: int = 0):
        """most : number of cached results of each kind; 0: none"""
        self.most = most
        self._kept: dict[str, OrderedDict[Hashable, Any]] = {}

    def get_or_compute(self, kind: str, key: Hashable, find: Callable[[], Any]) -> Any:
        """Return the result of `find`, from the cache if this key is known. Errors are cached too.

        The result is shared: callers must not change it, but may append to a list of what follows.
        """
        results = self._kept.setdefault(kind, OrderedDict())
        if key not in results:
            try:
                results[key] = (find(), None)
            except (InputError, DivergedError) as raised:
                results[key] = (None, raised)
        results.move_to_end(key)
        value, error = results[key]
        while len(results) > self.most:
            results.popitem(last=False)  # least recently used
        if error is not None:
            raise error.with_traceback(None)
        return value


NO_CACHE = ResultCache()  # no cache, for a single run


# Ignored keys, with the reason: they do not affect net, form, equilibria or gust model. All other keys count,
# also keys that are added later.
IGNORED_KEYS = {
    "title": "a name",
    "text": "its values stand in the sections; comments change nothing",
    "overrides": "their values stand in the sections",
    "output.frames": "when the dynamic stage is written",
    "output.history_interval": "when the dynamic stage is written",
    "output.probes": "what is written of the dynamic stage",
    "output.elements": "what is written of the dynamic stage",
    "output.checkpoint_interval": "when the dynamic stage is saved",
    "modes": "found from the last equilibrium, for each run",
    "modes.count": "found from the last equilibrium, for each run",
    "zone_rows": "places of values, which stand in the sections",
    "wind.seed": "gusts begin where the equilibria end",
    "wind.ramp": "over which the gusts then grow in",
}
# Keys that do not affect the net and its form either, because no wind acts on them.
WIND_SPEED_KEYS = ("wind.speed", "wind.turbulence_intensity", "wind.surface_drag")


def cache_key(job: Job, without: tuple[str, ...] = ()) -> str:
    """Return a key of all inputs of an initial state and its equilibria.

    without : keys of sections to ignore. Files that the job reads enter by their content. Raises InputError
    for a file that cannot be read.
    """
    inputs: dict[str, Any] = {}
    for field in fields(job):
        value = getattr(job, field.name)
        if isinstance(value, Section):  # its keys, as wind.speed
            inputs |= {f"{field.name}.{key}": item for key, item in value}
        else:
            inputs[field.name] = value
    inputs = {name: value for name, value in inputs.items() if name not in IGNORED_KEYS.keys() | {*without}}
    inputs["removes"] = bool(job.removes)  # removals happen after the equilibria
    inputs["contents"] = [content.hex() for content in job.contents]
    inputs["changes_net"] = job.changes_net()  # decides whether a stored partition applies
    return json.dumps(inputs, default=lambda value: str(value) if isinstance(value, Path) else dict(value))
