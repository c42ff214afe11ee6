"""The writer's side of following: its journal as it grows, its tokens, and snapshots.

``GET /replicate/records?since=EPOCH:SEQ`` sends the records of the journal as they are, from the
commit after ``since`` on, until either side ends the connection. Among them are frames of the same
form, a JSON line with the length of what follows it: ``tokens``, whenever a token is created,
changed or revoked, and ``heartbeat``, at least once a second and whenever everything has been sent.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

from endpoint.access.auth import Caller
from endpoint.access.tokens import TokenStore
from endpoint.follow.event_stream import EventStream, Streams
from endpoint.http.messages import RefusedError, Request, Response
from endpoint.http.websocket import Message
from rtask.kb.maintenance.replica import write_snapshot
from rtask.knowledge_base import KnowledgeBase

__all__ = ["RecordStream", "snapshot"]

HEARTBEAT_S = 1.0
_FEW = 4
_LOOK_S = 0.25
_PIECE = 1 << 18
_HOME = "replicate-"
_LEFT_S = 3_600.0


class RecordStream(EventStream):
    """Sends one follower the journal as it grows.

    Parameters
    ----------
    kb, tokens
        What is copied.

    Raises
    ------
    RefusedError
        409 for another epoch, 410 for commits that are no longer kept; a snapshot is needed.
    """

    def __init__(
        self,
        streams: Streams,
        request: Request,
        caller: Caller,
        kb: KnowledgeBase,
        tokens: TokenStore,
    ) -> None:
        super().__init__(streams, request, caller)
        self._kb = kb
        self._tokens = tokens
        self._tail = kb.journal_tail(self._since(request, kb))
        self._ended = False
        self._stop_listening = kb.on_commit(lambda _: self.wake())

    @staticmethod
    def _since(request: Request, kb: KnowledgeBase) -> int:
        epoch, _, number = (request.values("since") or [""])[-1].partition(":")
        if not number.isdecimal() or len(number) > 17:
            raise RefusedError(400, "usage", "since=EPOCH:NUMBER names the last commit you have")
        if epoch != kb.epoch or int(number) > kb.feed.last_seq:
            raise RefusedError(409, "epoch", f"commits were renumbered with epoch {kb.epoch}")
        oldest = kb.feed.oldest_retained()
        if int(number) + 1 < oldest:
            raise RefusedError(410, "gone", f"commits before {oldest} are not kept", oldest=oldest)
        return int(number)

    async def end(self, reason: str, code: int) -> None:
        """End the stream between two frames."""
        self._ended = True
        self.ready.set()

    def close(self) -> None:
        """Stop listening to commits."""
        self._stop_listening()

    async def pieces(self) -> AsyncIterator[bytes]:
        """Yield records and the frames among them until the stream ends."""
        loop = asyncio.get_running_loop()
        graphs: list[list[str | None]] | None = None
        beaten = 0.0
        looked = 0.0
        while not (self._ended or self.reason):
            self.ready.clear()
            now = time.monotonic()
            if now - looked >= _LOOK_S:
                looked = now
                rows = await loop.run_in_executor(None, self._tokens.rows)
                if rows != graphs:
                    graphs = rows
                    yield _frame("tokens", json.dumps(rows).encode())
            upto = self._kb.feed.last_seq
            if self._tail.after < upto:
                if upto - self._tail.after <= _FEW:  # just written, so it is in memory
                    data = self._tail.read(upto)
                else:
                    data = await loop.run_in_executor(None, self._tail.read, upto)
                if not data:
                    return  # pruned meanwhile; the next request is told so
                if self._tail.after == upto:
                    beaten = time.monotonic()
                    data += self._heartbeat()
                yield data
                continue
            if now - beaten >= HEARTBEAT_S:
                beaten = now
                yield self._heartbeat()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_LOOK_S):
                    await self.ready.wait()

    def _heartbeat(self) -> bytes:
        return _frame("heartbeat", b"", seq=self._kb.feed.last_seq)

    def _start(self) -> Message:
        start = super()._start()
        headers = [(n, v) for n, v in start["headers"] if n != b"content-type"]
        start["headers"] = [(b"content-type", b"application/vnd.rtask.journal"), *headers]
        return start


def _frame(kind: str, body: bytes, **members: int) -> bytes:
    return json.dumps({"kind": kind, **members, "bytes": len(body)}).encode() + b"\n" + body


def snapshot(kb: KnowledgeBase) -> Response:
    """Return a copy of the knowledge base as a tar file.

    Raises
    ------
    UnsupportedError
        It is in memory or on another server.
    """
    if kb.folder is not None:
        for left in kb.folder.glob(_HOME + "*"):  # by a process that was killed
            if time.time() - left.stat().st_mtime > _LEFT_S:
                shutil.rmtree(left, ignore_errors=True)
    home = Path(tempfile.mkdtemp(prefix=_HOME, dir=kb.folder))
    try:
        kb.backup(home / "copy", blobs=False)
        version = (("RTASK-Version", kb.feed.position(kb.seq)),)
        return Response(200, b"", "application/x-tar", version, _Sent(home))
    except BaseException:
        shutil.rmtree(home, ignore_errors=True)
        raise


class _Sent:
    """The pieces of a snapshot, which is removed once it has been sent."""

    def __init__(self, home: Path) -> None:
        self._home = home
        self._file = tempfile.TemporaryFile(dir=home)  # noqa: SIM115 - closed by close()
        write_snapshot(home / "copy", self._file)
        self._file.seek(0)
        self._lock = threading.Lock()

    def __iter__(self) -> Iterator[bytes]:
        return self

    def __next__(self) -> bytes:
        with self._lock:
            piece = b"" if self._file.closed else self._file.read(_PIECE)
        if not piece:
            raise StopIteration
        return piece

    def close(self) -> None:
        """Remove the snapshot."""
        with self._lock:
            self._file.close()
        shutil.rmtree(self._home, ignore_errors=True)
