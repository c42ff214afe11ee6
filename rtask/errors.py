"""Every error that RTASK raises on purpose.

::

    RtaskError
    ├── UsageError                  the call itself is wrong (bad argument, bad option)
    │   └── LazyLoadError           a loop would send one query an object
    ├── StoreError
    │   ├── StoreLockedError        another process has the folder open for writing
    │   ├── StoreFormatError        not a knowledge base, or one of another format
    │   ├── StorageFullError        the disk is full
    │   ├── ClosedError             used after close()
    │   ├── MissingBlobError        a triple names bytes that are not there
    │   ├── UnsupportedError        not possible on this kind of store
    │   ├── BusyError               too many wait already
    │   ├── QueryTimeout            a query reached its deadline
    │   ├── GoneError               older than the history that is kept
    │   ├── EpochChangedError       the order of commits was lost since then
    │   └── Lagged                  a subscriber was too slow
    ├── DataError
    │   ├── ParseError              file, line, column, reason
    │   ├── QuerySyntaxError        SPARQL text that does not parse
    │   ├── ValidationError         SHACL violations, with the report
    │   ├── InconsistentError       a contradiction, with the triples that clash
    │   ├── QueryTooExpensive       a query that its reader did not survive
    │   ├── VersionConflictError    somebody else wrote first
    │   ├── ConflictError           what was built on it since stands in the way
    │   ├── TooLargeError           beyond a stated limit
    │   ├── FieldError              a value that a field of an object does not take
    │   └── UnknownTermError        a name or IRI that the graph does not know
    ├── AccessError
    │   ├── AuthenticationError     no token, or not a valid one
    │   └── ForbiddenError          a valid token without the right
    │       └── OwnershipError      the statement to replace is another agent's
    ├── RemoteError
    │   ├── RemoteUnavailableError  no answer, connection lost
    │   └── CallFailedError         the server answered: no
    ├── MissingExtraError           an optional part of RTASK is not installed
    └── RobotError                  a robot cannot do what was asked

An error says what was wrong, where, what was expected and what to do. The command line prints it
as one line and exits with :attr:`RtaskError.exit_code`; HTTP turns it into RFC 9457 problem
details with :attr:`RtaskError.status` and :attr:`RtaskError.slug`.
"""

from __future__ import annotations

from typing import Any, ClassVar

__all__ = [
    "AccessError",
    "AuthenticationError",
    "BusyError",
    "CallFailedError",
    "ClosedError",
    "ConflictError",
    "DataError",
    "EpochChangedError",
    "FieldError",
    "ForbiddenError",
    "GoneError",
    "InconsistentError",
    "Lagged",
    "LazyLoadError",
    "MissingBlobError",
    "MissingExtraError",
    "OwnershipError",
    "ParseError",
    "QuerySyntaxError",
    "QueryTimeout",
    "QueryTooExpensive",
    "RemoteError",
    "RemoteUnavailableError",
    "RobotError",
    "RtaskError",
    "StorageFullError",
    "StoreError",
    "StoreFormatError",
    "StoreLockedError",
    "TooLargeError",
    "UnknownTermError",
    "UnsupportedError",
    "UsageError",
    "ValidationError",
    "VersionConflictError",
]


class RtaskError(Exception):
    """Base of all errors raised on purpose.

    Parameters
    ----------
    message
        One line: what was wrong, where, what to do.
    **details
        Machine-readable facts (``line``, ``column``, ``graph``, ``did_you_mean`` ...), kept in
        :attr:`details` and sent as members of the problem details.
    """

    status: ClassVar[int] = 500
    slug: ClassVar[str] = "internal"
    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, **details: Any) -> None:
        super().__init__(message)
        self.details = details


class UsageError(RtaskError):
    """The call itself is wrong: a bad argument, option or combination."""

    status, slug, exit_code = 400, "usage", 2


class LazyLoadError(UsageError):
    """A field of one of many results was not loaded; prefetch it with the query."""

    slug = "lazy-load"


class StoreError(RtaskError):
    """The store cannot do it."""

    slug = "store"


class StoreLockedError(StoreError):
    """Another process has the folder open for writing."""

    status, slug = 503, "store-locked"


class StoreFormatError(StoreError):
    """The folder is no knowledge base, or one that another version wrote."""

    slug = "store-format"


class StorageFullError(StoreError):
    """The disk is full; nothing of the write was stored."""

    status, slug = 507, "storage-full"


class ClosedError(StoreError):
    """The knowledge base, session or client was used after it was closed."""

    slug = "closed"


class MissingBlobError(StoreError):
    """A statement names bytes that are not in the blob store."""

    status, slug = 422, "missing-blob"


class UnsupportedError(StoreError):
    """This kind of store cannot do what was asked."""

    status, slug = 501, "unsupported"


class BusyError(StoreError):
    """Too many wait already; trying again later may succeed."""

    status, slug = 503, "busy"


class QueryTimeout(StoreError):
    """A query reached its deadline and was ended; ``timeout_s`` is what it had."""

    status, slug = 504, "query-timeout"


class GoneError(StoreError):
    """Commits that are asked for are no longer kept; ``oldest`` is the first that is."""

    status, slug = 410, "changes-gone"


class EpochChangedError(StoreError):
    """Commits are numbered anew since then (a restored backup); read everything again."""

    status, slug = 410, "epoch-changed"


class Lagged(StoreError):
    """A subscriber was too slow; ``since`` says from where to subscribe again."""

    slug = "lagged"


class DataError(RtaskError):
    """The data given are not acceptable; nothing was stored."""

    status, slug = 422, "data"


class ParseError(DataError):
    """A file or message does not parse; ``line`` and ``column`` where known."""

    status, slug = 400, "rdf-syntax"


class QuerySyntaxError(DataError):
    """SPARQL text that does not parse; ``line`` and ``column`` where known."""

    status, slug = 400, "query-syntax"


class QueryTooExpensive(DataError):
    """A query needs more memory than it may have, or crashed its reader."""

    status, slug = 400, "query-too-expensive"


class ValidationError(DataError):
    """The data violate a SHACL shape; ``results`` lists focus, path, value and message."""

    slug = "validation-failed"


class InconsistentError(DataError):
    """The data contradict the ontology; ``contradictions`` lists the clashing triples."""

    slug = "inconsistent"


class VersionConflictError(DataError):
    """The caller's version is not the current one."""

    status, slug = 412, "version-conflict"


class ConflictError(DataError):
    """What is there now does not allow it; the message says what stands in the way."""

    status, slug = 409, "conflict"


class TooLargeError(DataError):
    """Beyond a stated limit."""

    status, slug = 413, "too-large"


class UnknownTermError(DataError):
    """A name or IRI that the graph does not know; ``did_you_mean`` where something is near."""

    slug = "unknown-term"


class FieldError(DataError):
    """A value that a field does not take; ``field``, ``iri`` and ``expected`` say more."""

    slug = "field"


class AccessError(RtaskError):
    """The caller may not do it."""

    status, slug = 403, "forbidden"


class AuthenticationError(AccessError):
    """No token where one is needed, or one that is wrong, expired or revoked."""

    status, slug = 401, "unauthenticated"


class ForbiddenError(AccessError):
    """A valid caller without the right; ``graph`` names the graph concerned."""

    status, slug = 403, "graph-forbidden"


class OwnershipError(ForbiddenError):
    """The value to replace was stated by another agent, whose statements stay."""

    slug = "ownership"


class RemoteError(RtaskError):
    """Something at the other end of a connection."""

    status, slug = 502, "remote"


class RemoteUnavailableError(RemoteError):
    """No answer, or the connection was lost."""

    status, slug = 503, "remote-unavailable"


class CallFailedError(RemoteError):
    """The server answered that the call failed; the message is the server's."""

    slug = "call-failed"


class MissingExtraError(RtaskError):
    """An optional part of RTASK is not installed; the message has the command that installs it."""

    status, slug = 501, "missing-extra"


class RobotError(RtaskError):
    """A robot cannot do what was asked; ``reason`` is one of the ontology's reason codes."""

    status, slug = 409, "robot"
