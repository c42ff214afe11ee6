"""Words about fields that a class does not have, though classes below it may."""

from __future__ import annotations

import difflib
from typing import Any, NoReturn

__all__ = ["missing_field", "refuse_attribute", "refuse_path", "subclasses_with"]

Class = Any
"""A class bound to an OWL class: this file is below the one that defines them."""


def refuse_attribute(instance: Any, name: str) -> NoReturn:
    """Refuse an attribute that an object does not have, whether or not it was read.

    Raises
    ------
    AttributeError
        Always; names the classes that have such a field, and how to read the object.
    """
    if name.startswith("__"):  # looked up by Python itself, for one by copying
        raise AttributeError(name)
    state = instance.__state__
    origin = None if state.is_read else state.origin
    raise AttributeError(missing_field(type(instance), name, origin))


def refuse_path(model: Class, name: str) -> NoReturn:
    """Refuse the path of a field that a class does not have, as in a condition.

    Raises
    ------
    AttributeError
        Always; names a field that is written alike, or the classes that have it.
    """
    if name.startswith("__"):  # looked up by Python itself, also before the class has fields
        raise AttributeError(name)
    raise AttributeError(missing_field(model, name))


def missing_field(model: Class, name: str, origin: str | None = None) -> str:
    """Return why an object has no such attribute: no such field, or a class that was not read.

    Parameters
    ----------
    model
        Class of the object.
    origin
        Name of the class that was queried, if nothing of the object was read with it.
    """
    narrower = subclasses_with(model, name)
    if not narrower:
        near = difflib.get_close_matches(name, model.__fields__, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return f"{model.__name__} has no field {name!r}{hint}"
    words = f"{model.__name__} has no field {name!r}, but {' and '.join(narrower)} has"
    if origin is None:
        return words
    return (
        f"{words}; the query for {origin} read nothing of this object, not even its class: add "
        f"{_a_path_to(model, origin)} to it"
    )


def subclasses_with(model: Class, name: str) -> list[str]:
    """Return the names of the classes nearest below a class that have a field, at most three."""
    nearest: list[Class] = []
    waiting = list(type.__subclasses__(model))
    while waiting:
        below = waiting.pop(0)
        if name not in below.__fields__:
            waiting += type.__subclasses__(below)
        elif not any(issubclass(below, near) for near in nearest):
            nearest.append(below)
    return sorted({below.__name__ for below in nearest if not below.__combined__})[:3]


def _a_path_to(model: Class, origin: str) -> str:
    """Return the call that prefetches a link of the class that was queried to a class."""
    asked = [other for other in model.__registry__.models.values() if other.__name__ == origin]
    links = [
        f"{origin}.{link.name}"
        for queried in asked[:1]
        for link in queried.__fields__.values()
        if link.is_link and link.target() is model
    ]
    if len(links) == 1:
        return f".prefetch({links[0]})"
    return ".prefetch() of the path to it" + (f", such as {', '.join(links)}," if links else "")
