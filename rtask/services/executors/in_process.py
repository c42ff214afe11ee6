"""Instances of services in this process, one for each worker thread."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rtask.errors import StateChangedError
from rtask.extras import naming_extras
from rtask.services.executors.setup import Carried, InstanceSetup, Written
from rtask.services.resources import GraphResource, WritableFiles
from rtask.services.service import Service
from rtask.services.state import changed, digests
from rtask.services.task import Task

__all__ = ["InProcess"]


FIRST_CALLS = 10
"""How many calls of an instance are all checked for changes of its state; then a sample is."""


class InProcess:
    """One instance, made ready."""

    def __init__(self, setup: InstanceSetup) -> None:
        self._setup = setup
        self._calls = 0
        with naming_extras(setup.definition.name):
            self._instance: Any = setup.definition.make(setup.resources)
            if isinstance(self._instance, Service):
                self._instance.make_ready()

    @property
    def is_spent(self) -> bool:
        """Whether the next call needs a new instance, because the data have changed."""
        return self._setup.is_outdated()

    def carry_out(self, task: Task) -> Carried:
        """Carry out a call.

        Raises
        ------
        StateChangedError
            The state is no longer what start-up made; attributes are named.
        """
        self._calls += 1
        is_own = isinstance(self._instance, Service)
        is_due = self._calls <= FIRST_CALLS or self._calls % self._setup.check_every == 0
        is_checked = is_own and is_due
        before = digests(self._instance) if is_checked else {}
        for resource in self._setup.resources.values():
            if isinstance(resource, GraphResource):
                resource.ending = task.call.ending
        try:
            with naming_extras(task.service):
                answer = task.method.carry_out(self._instance, task.request, task.call)
            if is_checked:
                self._check(before, task)
        except BaseException:
            self._take_written()  # a call that fails has written nothing
            raise
        return Carried(answer, self._take_written())

    def _take_written(self) -> Written:
        """Return what the call wrote to its data resources, and forget it."""
        every = self._setup.resources.items()
        return {
            name: resource.take() for name, resource in every if isinstance(resource, WritableFiles)
        }

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
