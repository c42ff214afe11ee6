"""The services that are known, by name and version, and where they are loaded from."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.metadata
import importlib.util
import logging
import re
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

from rtask.errors import UnknownTermError, UsageError
from rtask.extras import missing_extra
from rtask.services.brass import named_brass
from rtask.services.definition import Definition, define, split_name
from rtask.services.service import Service

__all__ = ["GROUP", "Registry", "imported", "installed", "load", "services_of"]

_log = logging.getLogger(__name__)

GROUP = "rtask.services"
"""Entry points of installed packages: modules whose services are served."""

_VERSION_RANGE = re.compile(r"([0-9]{1,9}\.){0,2}([0-9]{1,9}|\*)")


class Registry:
    """Definitions by name and version.

    Examples
    --------
    >>> from rtask.services import method
    >>> class Echo(Service):
    ...     '''Says it again.'''
    ...     name, version = "example/Echo", "1.2.0"
    ...     @method
    ...     def say(self, text: str) -> str:
    ...         return text
    >>> registry = Registry()
    >>> registry.add(define(Echo))
    >>> registry.find("example/Echo@1.*").exact
    'example/Echo@1.2.0'
    >>> registry.find("example/Ecko")
    Traceback (most recent call last):
    rtask.errors.UnknownTermError: no service example/Ecko; did you mean example/Echo?
    """

    def __init__(self) -> None:
        self._services: dict[str, dict[tuple[int, ...], Definition]] = {}

    def add(self, definition: Definition) -> None:
        """Add a definition.

        Raises
        ------
        UsageError
            The version is taken.
        """
        versions = self._services.setdefault(definition.name, {})
        key = _numbers(definition.version)
        if key in versions and versions[key].source != definition.source:
            raise UsageError(
                f"{definition.exact} is there already, from {versions[key].source}; give the other "
                "a new version"
            )
        versions[key] = definition

    def replace(self, definition: Definition) -> None:
        """Put a definition in the place of the one of its name and version."""
        self._services.setdefault(definition.name, {})[_numbers(definition.version)] = definition

    def exact(self, name: str) -> Definition | None:
        """Return the definition of ``name@1.2.3``; none if there is none."""
        plain, version = split_name(name)
        return self._services.get(plain, {}).get(_numbers(version))

    def forget(self, name: str) -> None:
        """Remove all versions of a service."""
        self._services.pop(name, None)

    def remove(self, name: str, version: str) -> None:
        """Remove one version of a service."""
        gone = _numbers(version)
        # A new one, because calls in other threads may be reading the old one.
        left = {
            key: service for key, service in self._services.get(name, {}).items() if key != gone
        }
        if left:
            self._services[name] = left
        else:
            self._services.pop(name, None)

    def find(self, name: str) -> Definition:
        """Return the newest version that fits ``name@version``; without a version, the newest.

        Raises
        ------
        UnknownTermError
            No such service, or no such version.
        UsageError
            The version is neither ``1.2.3`` nor ``1.2.*`` nor ``1.*``.
        """
        plain, requested = split_name(name)
        versions = self._services.get(plain)
        if not versions:
            near = difflib.get_close_matches(plain, list(self._services), n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise UnknownTermError(f"no service {plain}{hint}")
        if requested and not _VERSION_RANGE.fullmatch(requested):
            raise UsageError(f"version {requested[:40]!r} of {plain}; expected 1.2.3, 1.2.* or 1.*")
        start = _numbers(requested.removesuffix("*").rstrip(".")) if requested else ()
        fitting = [key for key in list(versions) if key[: len(start)] == start]
        if not fitting:
            available = ", ".join(self.versions(plain))
            raise UnknownTermError(f"{plain} has no version {requested}; there are {available}")
        return versions[max(fitting)]

    def versions(self, name: str) -> list[str]:
        """Return the versions of a service, the newest first."""
        keys = sorted(self._services.get(name, ()), reverse=True)
        return [".".join(map(str, key)) for key in keys]

    def __iter__(self) -> Iterator[Definition]:
        """Yield the newest version of each service, sorted by name."""
        for _, versions in sorted(self._services.items()):
            yield versions[max(versions)]

    def __len__(self) -> int:
        return len(self._services)


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".") if part)


def load(source: str) -> list[Definition]:
    """Return the definitions of all services in a module or a file; errors as :func:`imported`."""
    return list(services_of(imported(source)))


def imported(source: str) -> ModuleType:
    """Return a module of services.

    Parameters
    ----------
    source
        Name of a module, or path of a ``.py`` file.

    Raises
    ------
    UsageError
        It cannot be imported, or holds no service.
    """
    module = _from_file(Path(source)) if source.endswith(".py") else _by_name(source)
    if not any(True for _ in services_of(module)):
        raise UsageError(f"{source} defines no service: no subclass of rtask.services.Service")
    return module


def services_of(module: ModuleType) -> Iterable[Definition]:
    """Yield the definitions of the services that a module lists as SERVICES, or else defines."""
    listed: Iterable[type[Service]] | None = getattr(module, "SERVICES", None)
    if listed is not None:
        yield from map(define, listed)
        return
    for value in list(vars(module).values()):
        is_service = isinstance(value, type) and issubclass(value, Service)
        if is_service and value.name and value.__module__ == module.__name__:
            yield define(value)


@cache
def _entries() -> tuple[importlib.metadata.EntryPoint, ...]:
    """Return where installed packages have services; read once, as that takes 20 ms."""
    return tuple(importlib.metadata.entry_points(group=GROUP))


def installed() -> Iterator[ModuleType]:
    """Yield the modules of services of installed packages; the log names what cannot be loaded."""
    for entry in _entries():
        try:
            yield imported(entry.value)
        except ModuleNotFoundError as error:
            lacking = missing_extra(error, f"services of {entry.value}")
            _log.warning("%s", lacking or f"services of {entry.value} cannot be loaded: {error}")
        except Exception:  # noqa: BLE001 - another package's code; the server starts without it
            _log.warning("services of %s cannot be loaded", entry.value, exc_info=True)


def _by_name(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not name.startswith(error.name):
            raise
        raise UsageError(f"no module {name}; a file of services ends in .py") from None


def _from_file(path: Path) -> ModuleType:
    """Import a file under a name of its own, once."""
    if not path.is_file():
        raise UsageError(f"no file {path}")
    # Processes that load the same file call it the same.
    digest = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:12]
    name = f"rtask_service_{path.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    module.__dict__["__rtask_file__"] = str(path.resolve())
    sys.modules[name] = module
    try:
        with named_brass():
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
