"""The order in which members are run."""

import json
from collections import deque

from netfall.solve.memory import BESIDE
from netfall.study.plan import Plan


class Queue:
    """Members to run; a worker gets those that share most with its last one."""

    def __init__(self, plan: Plan, numbers: list[int]):
        self.plan, self.groups = plan, {}
        for number in numbers:
            self.groups.setdefault(self._key(number), deque()).append(number)
        self.given: set[str] = set()

    def _key(self, number: int) -> str:
        values = self.plan.member(number).values
        return json.dumps([value for name, value in values.items() if name not in BESIDE])

    def take(self, last: str | None) -> tuple[str, int] | None:
        """The next member and its key; None if there are no more."""
        if not self.groups:
            return None
        fresh = (key for key in self.groups if key not in self.given)
        key = last if last in self.groups else next(fresh, next(iter(self.groups)))
        self.given.add(key)
        number = self.groups[key].popleft()
        if not self.groups[key]:
            del self.groups[key]
        return key, number

    def back(self, number: int) -> None:
        """Take a member back, to be given out again."""
        self.groups.setdefault(self._key(number), deque()).appendleft(number)
