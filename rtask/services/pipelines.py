"""Pipelines that were saved: services of their own, kept over restarts (Kehoe 2014, 5.5).

What a pipeline takes and answers is fixed when it is saved, from the declarations of its steps, so
that a version means the same later. Whether its steps still fit is checked at each call.

::

    DIR/<namespace>/<name>@<version>.json    owner, steps, output, description
"""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rtask.errors import (
    ConflictError,
    ForbiddenError,
    RtaskError,
    UnknownTermError,
    UsageError,
    nearest,
)
from rtask.kb.commit.access import Access
from rtask.kb.durability.blobs import sync_folder
from rtask.services.call import Call
from rtask.services.definition import Definition, check_name
from rtask.services.outward.announced import announced
from rtask.services.registry import Registry
from rtask.wire.message import Message

__all__ = ["METHOD", "SavedPipelines"]

_log = logging.getLogger(__name__)

METHOD = "run"
"""The only method of a saved pipeline."""
MAX_SAVED = 1000
_WORKERS = 8
Stored = dict[str, Any]
Run = Callable[[Stored, Mapping[str, Any], Mapping[str, Any], Call], Any]
"""Returns the outputs of a stored pipeline; its inputs come as they were read, and as JSON."""


class SavedPipelines:
    """The pipelines of a host, each of them a service.

    Parameters
    ----------
    folder
        Where they are kept; None = in memory.
    registry
        Offers them.
    run
        Carries one out.
    """

    def __init__(self, folder: Path | None, registry: Registry, run: Run) -> None:
        self._folder, self._registry, self._run = folder, registry, run
        self._lock = threading.Lock()
        self._stored: dict[str, Stored] = {}
        for file in sorted(folder.glob("*/*@*.json")) if folder is not None else ():
            try:
                stored = json.loads(file.read_text("utf-8"))
                self._registry.add(self._definition(stored))
                self._stored[_exact(stored)] = stored
            except (OSError, ValueError, KeyError, TypeError, RtaskError) as error:
                _log.warning("the pipeline %s is not offered: %s", file, error)

    def state_digest(self) -> bytes:
        """Return the same always: pipelines are data, and no state of the service that has them."""
        return b""

    def save(self, stored: Stored, access: Access) -> Stored:
        """Keep a pipeline, offer it and return what is kept; saved again as it is, nothing changes.

        Parameters
        ----------
        stored
            ``steps``, ``output``, and the ``description`` of a service with one method.

        Raises
        ------
        UsageError
            Name, version or description cannot be used.
        ConflictError
            The version holds something else, or the name belongs to another service.
        ForbiddenError
            The pipeline of that name belongs to somebody else.
        """
        name, version = stored["description"]["name"], stored["description"]["version"]
        check_name(name, version)
        stored = {"owner": access.agent, **stored}
        definition = self._definition(stored)
        with self._lock:
            existing = self._stored.get(definition.exact)
            if existing is not None and _contents(existing) == _contents(stored):
                return existing
            self._check_owner(name, access)
            if existing is not None:
                raise ConflictError(f"{definition.exact} is saved already; give this a new version")
            if len(self._stored) >= MAX_SAVED:
                raise ConflictError(f"there are {MAX_SAVED} saved pipelines; remove one")
            if not self._versions(name) and self._registry.versions(name):
                raise ConflictError(f"{name} is a service already; give the pipeline another name")
            self._registry.add(definition)
            try:
                if self._folder is not None:
                    _write(self._folder / f"{definition.exact}.json", stored)
            except BaseException:
                self._registry.remove(name, version)
                raise
            self._stored[definition.exact] = stored
        return stored

    def remove(self, name: str, version: str, access: Access) -> None:
        """Forget one version.

        Raises
        ------
        UnknownTermError
            There is none.
        ForbiddenError
            It belongs to somebody else.
        """
        exact = f"{name}@{version}"
        with self._lock:
            if exact not in self._stored:
                hint = nearest(exact, list(self._stored))
                raise UnknownTermError(f"no saved pipeline {exact}{hint}")
            self._check_owner(name, access)
            if self._folder is not None:
                (self._folder / f"{exact}.json").unlink(missing_ok=True)
                sync_folder((self._folder / exact).parent)
            del self._stored[exact]
            self._registry.remove(name, version)

    def listing(self) -> list[Stored]:
        """Return what is stored of each version, sorted by name and version."""
        with self._lock:
            return [self._stored[exact] for exact in sorted(self._stored)]

    def _versions(self, name: str) -> list[Stored]:
        every = self._stored.values()
        return [entry for entry in every if entry["description"]["name"] == name]

    def _check_owner(self, name: str, access: Access) -> None:
        """Refuse callers that would change a pipeline of somebody else."""
        owners = {entry["owner"] for entry in self._versions(name)}
        if access.role not in ("admin", "anonymous") and owners - {access.agent}:
            owner = next(iter(owners)) or "the server"
            raise ForbiddenError(f"the pipeline {name} belongs to {owner}; save yours by another")

    def _definition(self, stored: Stored) -> Definition:
        described = announced(stored["description"])
        if set(described.methods) != {METHOD}:
            raise UsageError(f"a pipeline has one method, {METHOD}")
        method = described.methods[METHOD]

        def invoke(instance: Any, request: Message, call: Call) -> Any:
            given = {name: getattr(request, name) for name in method.request.model_fields}
            return self._run(stored, given, request.model_dump(mode="json"), call)

        made = replace(method, invoke=invoke)
        return replace(
            described, executor="threads", methods={METHOD: made}, make=lambda resources: None,
            max_workers=_WORKERS, source=f"pipeline:{described.exact}",
        )  # fmt: skip


def _exact(stored: Stored) -> str:
    return f"{stored['description']['name']}@{stored['description']['version']}"


def _contents(stored: Stored) -> Stored:
    return {name: value for name, value in stored.items() if name != "owner"}


def _write(file: Path, stored: Stored) -> None:
    """Write a file so that it is there wholly or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_suffix(".tmp")
    with draft.open("w", encoding="utf-8") as out:
        json.dump(stored, out, indent=1)
        out.flush()
        os.fsync(out.fileno())
    draft.replace(file)
    sync_folder(file.parent)
