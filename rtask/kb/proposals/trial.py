"""Trial of a change: rights, reasoning and shapes as in a commit, and nothing stored."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rtask.kb.commit.commit import Request
from rtask.kb.commit.committer import Committer
from rtask.kb.commit.validation import Validator, Violation
from rtask.kb.store.overlay import Overlay

__all__ = ["Trial", "try_change"]


@dataclass(frozen=True)
class Trial:
    """What a commit would do.

    Parameters
    ----------
    seq
        Number of the commit on which it would rest.
    added, removed
        Numbers of asserted statements that would be added and removed.
    derived, withdrawn
        Numbers of statements that the reasoner would add and remove.
    violations
        Of the shapes that look at what would change, whether or not commits are held to them.
    """

    seq: int
    added: int
    removed: int
    derived: int
    withdrawn: int
    violations: tuple[Violation, ...]


def try_change(committer: Committer, change: Overlay, request: Request) -> Trial:
    """Return what a change would do; the caller holds the writer's lock and discards the change.

    Raises
    ------
    ForbiddenError, TooLargeError, InconsistentError, TooMuchFollowsError, MissingBlobError
        As the commit would; contradictions are refused here also where commits quarantine them.
    """
    shapes = Validator(committer.store, committer.graphs, False)
    derived, staged = committer.rehearse(change, replace(request, strict=True))
    try:
        violations = () if committer.plain else tuple(shapes.check(change, derived))
    finally:
        if staged is not None:
            staged.discard()
    return Trial(
        committer.last_seq,
        len(change.added),
        len(change.removed),
        len(derived.added),
        len(derived.removed),
        violations,
    )
