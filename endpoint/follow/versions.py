"""Versions that a server answers from: reading one's own writes, and the age of answers."""

from __future__ import annotations

import threading
from collections.abc import Callable

from endpoint.http.following import Following
from endpoint.http.messages import RefusedError, Response
from endpoint.served import ServedGraph

__all__ = ["minimum_version", "staleness_headers"]

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


def staleness_headers(following: Following) -> list[tuple[str, str]]:
    """Return the header fields that say how old a follower's answer may be."""
    headers = [("RTASK-Staleness", f"{following.seconds_behind:.3f}")]
    if not following.is_connected:
        headers.append(("RTASK-Stale", "the server that is followed has not been heard of"))
    return headers
