"""Instances of services in this process, one for each worker thread."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import StateChangedError
from rtask.extras import naming_extras
from rtask.kb.commit.access import Access
from rtask.services.definition import Definition
from rtask.services.resources import Resource, WritableFiles
from rtask.services.service import Service
from rtask.services.state import changed, digests
from rtask.services.task import Task
from rtask.wire.message import Answer

__all__ = ["Commit", "InProcess", "Written"]

Written = dict[str, dict[str, bytes]]
"""Contents of files by the names of data resources and by path."""
Commit = Callable[[Written, Access], None]
"""Stores what a call wrote under its caller's rights."""


class InProcess:
    """One instance, made ready.

    Parameters
    ----------
    definition
        Of the service.
    resources
        Data of the instance by the names of its data resources.
    check_every
        How many calls there are to one whose effect on the state is checked; 1 = all.
    commit
        Stores what a call wrote to its data resources; None = it is left to
        :meth:`take_written`.
    is_outdated
        Tells whether its data resources have changed since the instance was made ready.
    """

    def __init__(
        self,
        definition: Definition,
        resources: Mapping[str, Resource],
        check_every: int,
        commit: Commit | None,
        is_outdated: Callable[[], bool] = lambda: False,
    ) -> None:
        self._is_outdated = is_outdated
        self._resources = resources
        self._commit = commit
        self._check_every = check_every
        self._calls = 0
        with naming_extras(definition.name):
            self._instance: Any = definition.make(resources)
            if isinstance(self._instance, Service):
                self._instance.make_ready()

    @property
    def is_spent(self) -> bool:
        """Whether the next call needs a new instance, because the data have changed."""
        return self._is_outdated()

    def carry_out(self, task: Task) -> Answer:
        """Carry out a call.

        Raises
        ------
        StateChangedError
            The state is no longer what start-up made; attributes are named.
        """
        self._calls += 1
        is_own = isinstance(self._instance, Service)
        is_checked = is_own and (self._calls - 1) % self._check_every == 0
        before = digests(self._instance) if is_checked else {}
        try:
            with naming_extras(task.service):
                answer = task.method.carry_out(self._instance, task.request, task.call)
            if is_checked:
                self._check(before, task)
        except BaseException:
            self.take_written()  # a call that fails has written nothing
            raise
        if self._commit is not None:
            self._commit(self.take_written(), task.call.caller)
        return answer

    def take_written(self) -> Written:
        """Return what the call wrote to its data resources, and forget it."""
        every = self._resources.items()
        return {name: one.take() for name, one in every if isinstance(one, WritableFiles)}

    def _check(self, before: Mapping[str, bytes], task: Task) -> None:
        names = changed(before, digests(self._instance))
        if names:
            raise StateChangedError(
                f"{task.service} {task.method.name} changed {', '.join(names)}; what lasts beyond "
                "a call belongs into a writable data resource",
                attributes=names,
            )

    def close(self) -> None:
        """Run the shut-down methods of the service."""
        if isinstance(self._instance, Service):
            self._instance.end()
