"""The exceptions that RTASK raises on purpose.

::

    RtaskError
    ├── UsageError                  the call is wrong: a bad argument, option or combination
    │   └── LazyLoadError           a loop would send one query for each object
    ├── StoreError                  the store cannot carry out the request
    │   ├── StoreLockedError        another process has the folder open for writing
    │   ├── StoreFormatError        a knowledge base of another format, or a damaged one
    │   │   └── NoStoreError            what was named is no knowledge base
    │   ├── StorageFullError        the disk is full
    │   ├── ClosedError             used after close()
    │   ├── MissingBlobError        a triple names bytes that are missing
    │   ├── UnsupportedError        not possible on this kind of store
    │   ├── BusyError               too many requests are waiting
    │   ├── QueryTimeout            a query reached its deadline
    │   ├── GoneError               older than the history that is kept
    │   ├── EpochChangedError       commits were renumbered, by a restored backup
    │   └── Lagged                  a subscriber was too slow
    ├── DataError                   the data are not acceptable; nothing was stored
    │   ├── ParseError              a file that does not parse: file, line, column, reason
    │   ├── QuerySyntaxError        SPARQL text that does not parse
    │   ├── ValidationError         SHACL violations, with the report
    │   ├── InconsistentError       a contradiction, with the triples that clash
    │   ├── QueryTooExpensive       a query that needs more memory than it may use
    │   ├── VersionConflictError    somebody else wrote first
    │   ├── ConflictError           later data stand in the way
    │   ├── SearchLimit             a search for a plan reached its bound
    │   ├── TooLargeError           beyond a stated limit
    │   │   └── TooMuchFollowsError more follows from a change than it may cause
    │   ├── UnknownTermError        a name or IRI that the graph does not contain
    │   │   └── ForgottenError      an object that somebody has forgotten on purpose
    │   └── FieldError              a value that does not fit a field of an object
    ├── AccessError                 the caller is not allowed to
    │   ├── AuthenticationError     no token, or not a valid one
    │   └── ForbiddenError          a valid token without the right
    │       └── OwnershipError      the statement to replace belongs to another agent
    ├── RemoteError                 the other end of a connection failed
    │   ├── RemoteUnavailableError  no answer, or connection lost
    │   └── CallFailedError         the server reported a failure
    ├── ServiceError                a service says that it cannot do what was asked
    │   ├── ServiceFailedError      a service raised something else, or answered wrongly
    │   ├── StartupFailedError      a service could not be made ready
    │   │   └── UnusableServiceError    nor will it be without a change
    │   ├── StateChangedError       a call left the state of its service changed
    │   ├── WorkerDiedError         the process that carried out a call ended
    │   ├── MissingDataError        a data resource that a service needs was not named
    │   ├── QueueFullError          too many calls of a service are waiting
    │   ├── DeadlineError           a call was not answered in its time
    │   └── CancelledError          a call was cancelled
    ├── MissingExtraError           an optional part of RTASK is not installed
    └── RobotError                  a robot cannot do what was asked
        └── UnknownRobotError       no robot has that name

A message says what was wrong, where, what was expected and what to do. The command line prints it
as one line and exits with its :attr:`RtaskError.exit_code`; HTTP turns it into RFC 9457 problem
details with :attr:`RtaskError.status` and :attr:`RtaskError.slug`. Whether trying again may help is
:attr:`RtaskError.is_transient`, over every protocol the member ``transient``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

__all__ = [
    "TRANSIENT_STATUSES",
    "AccessError",
    "AuthenticationError",
    "BusyError",
    "CallFailedError",
    "CancelledError",
    "ClosedError",
    "ConflictError",
    "DataError",
    "DeadlineError",
    "EpochChangedError",
    "FieldError",
    "ForbiddenError",
    "ForgottenError",
    "GoneError",
    "InconsistentError",
    "Lagged",
    "LazyLoadError",
    "MissingBlobError",
    "MissingDataError",
    "MissingExtraError",
    "NoStoreError",
    "OwnershipError",
    "ParseError",
    "QuerySyntaxError",
    "QueryTimeout",
    "QueryTooExpensive",
    "QueueFullError",
    "RemoteError",
    "RemoteUnavailableError",
    "RobotError",
    "RtaskError",
    "SearchLimit",
    "ServiceError",
    "ServiceFailedError",
    "StartupFailedError",
    "StateChangedError",
    "StorageFullError",
    "StoreError",
    "StoreFormatError",
    "StoreLockedError",
    "TooLargeError",
    "TooMuchFollowsError",
    "UnknownRobotError",
    "UnknownTermError",
    "UnsupportedError",
    "UnusableServiceError",
    "UsageError",
    "ValidationError",
    "VersionConflictError",
    "WorkerDiedError",
    "nearest",
]


TRANSIENT_STATUSES = frozenset((429, 502, 503, 504, 507))
"""HTTP statuses of errors after which the same call may succeed later."""


def nearest(name: str, names: Sequence[str]) -> str:
    """Return the words ``; did you mean 'x'?`` when a known name is near, else nothing.

    Examples
    --------
    >>> nearest("grippr_id", ["gripper_id", "task"])
    "; did you mean 'gripper_id'?"
    """
    import difflib

    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else ""


class RtaskError(Exception):
    """Base class of all errors that RTASK raises on purpose.

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
    exit_code: ClassVar[int] = 3

    @property
    def is_transient(self) -> bool:
        """Whether the same call may succeed later, without any change on the caller's side.

        ``transient`` of the details decides, or else the status.

        Examples
        --------
        >>> QueueFullError("too many calls wait").is_transient, UsageError("no such").is_transient
        (True, False)
        """
        given = self.details.get("transient")
        return self.answer_status in TRANSIENT_STATUSES if given is None else bool(given)

    @property
    def answer_status(self) -> int:
        """HTTP status of the error, or of the answer in which a server reported it.

        So code that works on a graph in the same process and on a server meets one kind of error.

        Examples
        --------
        >>> ConflictError("no").answer_status, CallFailedError("no", http_status=409).answer_status
        (409, 409)
        """
        return int(self.details.get("http_status", self.status))

    def __init__(self, message: str, **details: Any) -> None:
        super().__init__(message)
        self.details = details


class UsageError(RtaskError):
    """The call is wrong: a bad argument, option or combination."""

    status, slug, exit_code = 400, "usage", 2


class LazyLoadError(UsageError):
    """A field of one of many results was not loaded; name it in the query to prefetch it."""

    slug = "lazy-load"


class StoreError(RtaskError):
    """The store cannot carry out the request."""

    slug = "store"


class StoreLockedError(StoreError):
    """Another process has the folder open for writing."""

    status, slug = 503, "store-locked"


class StoreFormatError(StoreError):
    """The knowledge base was written by an incompatible version, or is damaged."""

    slug = "store-format"


class NoStoreError(StoreFormatError):
    """What was named as a knowledge base, or as a backup of one, is none."""

    slug, exit_code = "no-store", 2


class StorageFullError(StoreError):
    """The disk is full; nothing of the write was stored."""

    status, slug = 507, "storage-full"


class ClosedError(StoreError):
    """The knowledge base, session or client was used after it was closed."""

    slug = "closed"


class MissingBlobError(StoreError):
    """A statement names bytes that are missing from the blob store."""

    status, slug = 422, "missing-blob"


class UnsupportedError(StoreError):
    """This kind of store does not support the operation."""

    status, slug = 501, "unsupported"


class BusyError(StoreError):
    """Too many requests are waiting; a later attempt may succeed."""

    status, slug = 503, "busy"


class QueryTimeout(StoreError):
    """A query was stopped at its deadline; ``timeout_s`` is the time it was given."""

    status, slug = 504, "query-timeout"


class GoneError(StoreError):
    """The requested commits are no longer kept; ``oldest`` is the first that is."""

    status, slug = 410, "changes-gone"


class EpochChangedError(StoreError):
    """Commits were renumbered since then, by a restored backup; read everything again."""

    status, slug = 410, "epoch-changed"


class Lagged(StoreError):
    """A subscriber was too slow; subscribe again from ``since``."""

    slug = "lagged"


class DataError(RtaskError):
    """The data are not acceptable; nothing was stored."""

    status, slug = 422, "data"


class ParseError(DataError):
    """A file or message does not parse; ``line`` and ``column`` where known."""

    status, slug = 400, "rdf-syntax"


class QuerySyntaxError(DataError):
    """SPARQL text that does not parse; ``line`` and ``column`` where known."""

    status, slug, exit_code = 400, "query-syntax", 2


class QueryTooExpensive(DataError):
    """A query needs more memory than it may use, or crashed the process that ran it."""

    status, slug = 400, "query-too-expensive"


class SearchLimit(DataError):
    """A search for a plan was ended by its bound: whether there is a plan is not known."""

    slug = "search-limit"


class ValidationError(DataError):
    """The data violate a SHACL shape; ``results`` lists focus, path, value and message."""

    slug = "validation-failed"


class InconsistentError(DataError):
    """The data contradict the ontology; ``contradictions`` lists the clashing triples.

    Attributes
    ----------
    clashes
        The :class:`reasoner.Contradiction` of each, in this process only.
    """

    slug = "inconsistent"
    clashes: Sequence[Any] = ()


class VersionConflictError(DataError):
    """The caller's version is not the current one."""

    status, slug = 412, "version-conflict"


class ConflictError(DataError):
    """The present data do not allow the change; the message names the obstacle."""

    status, slug = 409, "conflict"


class TooLargeError(DataError):
    """The request or the data exceed a stated limit."""

    status, slug = 413, "too-large"


class TooMuchFollowsError(TooLargeError):
    """More follows from a change than one change may cause, or is too much work to find.

    ``rule``, ``statement`` and ``allowed`` name the rule that was at work, the axiom behind it and
    the bound. Nothing was stored.
    """

    status, slug = 422, "too-much-follows"


class UnknownTermError(DataError):
    """A name or IRI that the graph does not contain; ``did_you_mean`` where one is similar."""

    slug, exit_code = "unknown-term", 1


class ForgottenError(UnknownTermError):
    """An object that was forgotten, so that nothing is stored about it any more."""

    status, slug = 404, "forgotten"


class FieldError(DataError):
    """A value does not fit a field; see ``field``, ``iri`` and ``expected``."""

    slug, exit_code = "field", 2


class AccessError(RtaskError):
    """The caller is not allowed to do this."""

    status, slug = 403, "forbidden"


class AuthenticationError(AccessError):
    """A token is required, or the one given is wrong, expired or revoked."""

    status, slug = 401, "unauthenticated"


class ForbiddenError(AccessError):
    """The caller is known but lacks the right; ``graph`` names the graph concerned."""

    status, slug = 403, "graph-forbidden"


class OwnershipError(ForbiddenError):
    """The value to replace was stated by another agent, whose statements stay."""

    slug = "ownership"


class RemoteError(RtaskError):
    """The other end of a connection failed."""

    status, slug = 502, "remote"


class RemoteUnavailableError(RemoteError):
    """The server does not answer, or the connection was lost."""

    status, slug = 503, "remote-unavailable"


class CallFailedError(RemoteError):
    """The server reported that the call failed; the message is the server's."""

    slug = "call-failed"


class ServiceError(RtaskError):
    """A service says that it cannot do what was asked, in words meant for the caller."""

    status, slug = 422, "service"


class ServiceFailedError(ServiceError):
    """A service raised an error that was not meant for the caller, or answered wrongly."""

    status, slug = 500, "service-failed"


class StartupFailedError(ServiceError):
    """A service could not be made ready; ``retry_after_s`` says when that is tried again."""

    status, slug = 503, "startup-failed"


class UnusableServiceError(StartupFailedError):
    """A service cannot be made ready before its code, data or installation has changed."""

    status, slug = 500, "service-unusable"


class StateChangedError(ServiceError):
    """A call changed the state of its service; ``attributes`` names what was changed."""

    status, slug = 500, "state-changed"


class WorkerDiedError(ServiceError):
    """The process that carried out a call ended before it answered."""

    status, slug = 502, "worker-died"


class MissingDataError(ServiceError):
    """A data resource that a service needs was not named, or does not exist."""

    status, slug = 422, "missing-data"


class QueueFullError(ServiceError):
    """Too many calls of a service are waiting; ``retry_after_s`` says when to try again."""

    status, slug = 429, "queue-full"


class DeadlineError(ServiceError):
    """A call was not answered in its time; ``timeout_s`` is the time it was given."""

    status, slug = 504, "deadline"


class CancelledError(ServiceError):
    """A call was cancelled before it was answered."""

    status, slug = 409, "cancelled"


class MissingExtraError(RtaskError):
    """An optional part of RTASK is not installed; the message has the command that installs it."""

    status, slug = 501, "missing-extra"


class RobotError(RtaskError):
    """A robot cannot do what was asked; ``reason`` is one of the ontology's reason codes."""

    status, slug = 409, "robot"


class UnknownRobotError(RobotError):
    """No robot has that name."""

    slug, exit_code = "unknown-robot", 1
