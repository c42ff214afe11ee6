"""Versions that a server answers from: reading one's own writes, and the age of answers."""

from __future__ import annotations

import threading
from collections.abc import Callable

from endpoint.http.following import Following
from endpoint.http.messages import RefusedError, Response
from endpoint.served import ServedGraph
from rtask.errors import UnknownTermError

__all__ = ["lag_words", "minimum_version", "staleness_headers", "unknown_so_far"]

WAIT_S = 2.0


def minimum_version(kb: ServedGraph, text: str) -> Callable[[Callable[[], Response]], Response]:
    """Return a function that runs another one once the graph has a version.

    Parameters
    ----------
    text
        ``EPOCH:NUMBER``, as answers name their version in ``RTASK-Version``.

    Raises
    ------
    RefusedError
        400 for another form, 409 for another epoch; later 503 if the version does not come within
        two seconds.
    """
    epoch, _, number = text.strip().strip('"').partition(":")
    if not number.isdecimal() or len(number) > 17:
        raise RefusedError(400, "usage", "RTASK-Min-Version is EPOCH:NUMBER, as in RTASK-Version")
    if epoch != kb.epoch:
        raise RefusedError(409, "epoch", f"versions were renumbered with epoch {kb.epoch}")
    version = int(number)

    def run(then: Callable[[], Response]) -> Response:
        reached = threading.Event()
        stop = kb.on_commit(lambda change: reached.set() if change.commit.seq >= version else None)
        try:
            if kb.seq < version and not reached.wait(WAIT_S) and kb.seq < version:
                raise RefusedError(
                    503,
                    "behind",
                    f"version {text} has not arrived here yet, {kb.seq} has",
                    headers=(("Retry-After", "1"),),
                )
        finally:
            stop()
        return then()

    return run


def unknown_so_far(
    error: Exception, following: Following | None, version: str
) -> dict[str, object]:
    """Return members for the problem details of what a copy does not know, or not yet.

    What its writer stored since may still be on its way, so that "unknown" is not "there is none".
    """
    if following is None or not isinstance(error, UnknownTermError):
        return {}
    members: dict[str, object] = {
        "as_of": version,
        "commits_behind": following.commits_behind,
        "seconds_behind": round(following.seconds_behind, 3),
    }
    if following.commits_behind or not following.is_connected:
        members["not_yet"] = (
            "this copy lags behind its writer, where it may be known by now; ask again later, or "
            f"ask {following.url}"
        )
    return members


def staleness_headers(following: Following) -> list[tuple[str, str]]:
    """Return the header fields that say how old a follower's answer may be."""
    headers = [("RTASK-Staleness", f"{following.seconds_behind:.3f}")]
    if not following.is_connected:
        headers.append(("RTASK-Stale", "the server that is followed has not been heard of"))
    return headers


def lag_words(following: Following | None) -> str:
    """Return what a page of a copy that lags has to say first; empty where nothing is missing.

    A page shows much that is not there: "nothing tried yet", "no such object", counts. On a copy
    that lags, each may have changed at the writer.
    """
    if following is None:
        return ""
    if not following.is_connected:
        since = f"for {following.seconds_behind:.0f} s"
        return f"This copy has not heard of its writer {since}: what is missing here may be there."
    if (behind := following.commits_behind) > 0:
        commits = "a commit" if behind == 1 else f"{behind} commits"
        return f"This copy is {commits} behind its writer: what is missing here may be there."
    return ""
