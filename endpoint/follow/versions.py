"""Versions that a server answers from: reading one's own writes, and the age of answers."""

from __future__ import annotations

import threading
from collections.abc import Callable

from endpoint.http.following import Following
from endpoint.http.messages import RefusedError, Request, Response
from endpoint.rosbridge.services import Engine
from endpoint.served import ServedGraph

__all__ = ["minimum_version", "staleness_headers", "writes"]

WAIT_S = 2.0
_SAFE_METHODS = frozenset(("GET", "HEAD", "OPTIONS"))
_ONLY_READ = ("/query", "/tokens/ticket")
_ENGINE = "/engine/"


def writes(request: Request, address: str, engine: Engine) -> bool:
    """Whether a request may change the graph, so that only the writer can answer it."""
    if request.method in _SAFE_METHODS or address in _ONLY_READ or address.startswith("/queries/"):
        return False
    if address == "/sparql":
        media_type = request.content_type[0]
        if media_type == "application/sparql-query":
            return False
        return media_type == "application/sparql-update" or _has_update(request.body)
    if address.startswith(_ENGINE):
        operation = engine.operations.get(address.removeprefix(_ENGINE))
        return operation is None or operation.effect == "writes"
    return True


def _has_update(body: bytes) -> bool:
    return body.startswith(b"update=") or b"&update=" in body


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
    wanted = int(number)

    def run(then: Callable[[], Response]) -> Response:
        come = threading.Event()
        stop = kb.on_commit(lambda change: come.set() if change.commit.seq >= wanted else None)
        try:
            if kb.seq < wanted and not come.wait(WAIT_S) and kb.seq < wanted:
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
