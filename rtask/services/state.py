"""The rule that calls leave the state of a service as start-up made it (Kehoe 2014, 5.5).

The state is compared by a digest of each attribute: arrays, containers and plain objects by
content, everything else by identity. An object whose state lies outside Python says it itself by a
method ``state_digest() -> bytes``.
"""

from __future__ import annotations

import hashlib
import types
from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["changed", "digests"]

_DEPTH = 6
_DATA = "data_resources"
_PLAIN = (str, bytes, int, float, complex, bool, type(None))
_SHARED = (type, types.FunctionType, types.BuiltinFunctionType, types.ModuleType)


def digests(instance: object) -> dict[str, bytes]:
    """Return a digest of each attribute of an instance, its data resources left out."""
    return {name: _digest(value) for name, value in vars(instance).items() if name != _DATA}


def changed(before: Mapping[str, bytes], after: Mapping[str, bytes]) -> list[str]:
    """Return the names of the attributes that differ, sorted.

    Examples
    --------
    >>> class Arm: pass
    >>> arm = Arm()
    >>> arm.joints, arm.cache = np.zeros(3), {}
    >>> before = digests(arm)
    >>> arm.joints[1] = 0.5
    >>> arm.cache["key"] = [1]
    >>> changed(before, digests(arm))
    ['cache', 'joints']
    """
    return sorted(name for name in {*before, *after} if before.get(name) != after.get(name))


def _digest(value: Any) -> bytes:
    digest = hashlib.blake2b(digest_size=16)
    _add(value, digest, _DEPTH, set())
    return digest.digest()


def _add(value: Any, digest: Any, depth: int, seen: set[int]) -> None:
    digest.update(type(value).__name__.encode())
    if isinstance(value, _PLAIN):
        digest.update(repr(value).encode())
    elif hasattr(value, "state_digest") and not isinstance(value, type):
        digest.update(value.state_digest())
    elif depth == 0 or id(value) in seen or isinstance(value, _SHARED):
        digest.update(str(id(value)).encode())
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        if value.dtype.hasobject:
            _add(value.tolist(), digest, depth - 1, seen)
        else:
            digest.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data)
    else:
        seen.add(id(value))
        _add_parts(value, digest, depth - 1, seen)


def _add_parts(value: Any, digest: Any, depth: int, seen: set[int]) -> None:
    if isinstance(value, Mapping):
        parts = [part for item in value.items() for part in item]
    elif isinstance(value, list | tuple):
        parts = list(value)
    elif isinstance(value, set | frozenset):
        parts = sorted(value, key=repr)
    else:
        parts = [part for item in getattr(value, "__dict__", {}).items() for part in item]
        if not parts:
            digest.update(str(id(value)).encode())
    for part in parts:
        _add(part, digest, depth, seen)
