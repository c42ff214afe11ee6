"""What can go wrong with objects; all below the tree in :mod:`rtask.errors`.

::

    DataError
    └── FieldError          a value that a field does not take
    UsageError
    └── LazyLoadError       a loop would send one query an object
    ForbiddenError
    └── OwnershipError      the statement is another agent's
"""

from __future__ import annotations

from typing import ClassVar

from rtask.errors import DataError, ForbiddenError, UsageError

__all__ = ["FieldError", "LazyLoadError", "OwnershipError"]


class FieldError(DataError):
    """A value that a field does not take; ``field``, ``iri`` and ``expected`` say more."""

    slug: ClassVar[str] = "field"


class LazyLoadError(UsageError):
    """A field of one of many results was not loaded; prefetch it with the query."""

    slug: ClassVar[str] = "lazy-load"


class OwnershipError(ForbiddenError):
    """The value to replace was stated by another agent, whose statements stay."""

    slug: ClassVar[str] = "ownership"
