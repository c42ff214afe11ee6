"""A server that follows another one: it takes in its journal and passes writes on to it."""

from __future__ import annotations

import io
import json
import logging
import os
import queue
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import httpx

from endpoint.access.tokens import TokenStore
from endpoint.follow.record_spool import FILE, RecordSpool
from endpoint.follow.versions import minimum_version
from endpoint.http.messages import RefusedError, Request, Response
from endpoint.routes.addresses import ASKED, BLOBS, HEALTH, RECORDS, SNAPSHOT
from rtask.errors import MissingBlobError, RemoteUnavailableError, RtaskError, UsageError
from rtask.kb.commit.access import Access
from rtask.kb.durability.blobs import PREFIX, digest_of
from rtask.kb.durability.journal import Record
from rtask.kb.feed.outage import Outage
from rtask.kb.maintenance.replica import (
    followed_by,
    install_snapshot,
    is_complete,
    mark_following,
)
from rtask.knowledge_base import KnowledgeBase
from rtask.wire.address import authorization

__all__ = ["Follower", "prepare"]

_log = logging.getLogger(__name__)
LOST_S = 5.0
LEASE_S = 60.0
_RETRY_S = 0.25
_MAX_BATCH = 500
_PASSED_ON = frozenset(
    ("accept", "authorization", "content-type", "idempotency-key", "if-match", "if-none-match",
      "rtask-note", "rtask-request-id", "rtask-min-version")
)  # fmt: skip
_DROPPED = frozenset(("connection", "content-length", "content-encoding", "transfer-encoding",
                      "date", "server", "vary", "rtask-request-id", "content-type"))  # fmt: skip


class _StartOverError(Exception):
    """The copy cannot go on from where it is; a snapshot is needed."""


def prepare(folder: Path, url: str, token: str | None) -> None:
    """Make sure that a folder holds a copy of the knowledge base that is served at an address.

    Raises
    ------
    UsageError
        The folder holds something else.
    RemoteUnavailableError
        The server does not answer.
    """
    theirs = followed_by(folder)
    if theirs is None and (folder / "kb.json").exists():
        raise UsageError(f"{folder} holds a knowledge base of its own; name another folder")
    if theirs is not None and is_complete(folder):
        mark_following(folder, url, complete=True)
        return
    _log.info("fetching a snapshot of %s", url)
    try:
        with _client(url, token) as http, http.stream("GET", SNAPSHOT) as answer:
            if answer.status_code != 200:
                answer.read()
                raise UsageError(f"{url} gives no snapshot: {_detail(answer)}")
            install_snapshot(folder, io.BufferedReader(_Reader(answer.iter_bytes())), url)
    except httpx.HTTPError as error:
        raise RemoteUnavailableError(f"{url}: {error or type(error).__name__}") from error


class _Reader(io.RawIOBase):
    """A file over the pieces of an answer."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._rest = b""

    def readable(self) -> bool:
        """Return true."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read what there is; 0 bytes at the end."""
        target = memoryview(buffer).cast("B")
        self._rest = self._rest or next(self._pieces, b"")
        size = min(len(target), len(self._rest))
        target[:size] = self._rest[:size]
        self._rest = self._rest[size:]
        return size


def _client(url: str, token: str | None, read_s: float = 60.0) -> httpx.Client:
    timeout = httpx.Timeout(read_s, connect=5.0)
    return httpx.Client(base_url=url, headers=authorization(token), timeout=timeout)


def _detail(answer: httpx.Response) -> str:
    try:
        return f"{answer.status_code} {answer.json()['detail']}"
    except (ValueError, KeyError, TypeError):
        return f"{answer.status_code} {answer.text[:200]}"


class Follower:
    """The connection of a follower to its writer, in a thread of its own.

    Parameters
    ----------
    kb, tokens
        The copies that are kept current.
    url, token
        The writer, and a token with the right ``replicate``.
    forwards
        Whether writes are passed on; clients are redirected otherwise.
    start_over
        Called when the copy cannot go on, after it has been marked as incomplete.
    lease_s
        Time without contact after which no token is let in any more, because the writer may have
        revoked it, s; 0 = never.
    clock
        Returns seconds; tests pass their own.
    """

    def __init__(
        self,
        kb: KnowledgeBase,
        tokens: TokenStore,
        url: str,
        token: str | None,
        forwards: bool = True,
        start_over: Callable[[], None] | None = None,
        lease_s: float = LEASE_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.url = url.rstrip("/")
        self._kb = kb
        self._tokens = tokens
        self._token = token
        self.forwards = forwards
        self._start_over = start_over or _start_again
        self._lease_s, self._clock = lease_s, clock
        tokens.is_current = self.has_authority
        self._writer_seq = 0
        self._current_at = self._heard_at = float("-inf")
        self._closed = threading.Event()
        self._outage = Outage(_log, f"{self.url} cannot be followed")
        self._http = _client(self.url, None)
        self._blobs: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._threads = [
            threading.Thread(target=target, name=name, daemon=True)
            for target, name in ((self._run, "rtask-follow"), (self._fetch_all, "rtask-blobs"))
        ]
        assert kb.folder is not None
        self._dropped = 0
        self._records = RecordSpool(kb.folder / FILE, self._send_records, self._count_dropped)
        kb.follow(self.url)
        kb.blobs.fetch = self._fetch

    def start(self) -> None:
        """Start following."""
        for thread in self._threads:
            thread.start()
        self._records.start()

    def close(self) -> None:
        """Stop following."""
        self._closed.set()
        self._blobs.put(None)
        self._records.close()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout=LOST_S + 5.0)
        self._http.close()

    @property
    def seconds_behind(self) -> float:
        """Age of the newest state that is known to be here, s."""
        return min(self._clock() - self._current_at, 1e9)

    @property
    def commits_behind(self) -> int:
        """Number of commits of the writer that are not here yet, as far as is known."""
        return max(0, self._writer_seq - self._kb.seq)

    def has_authority(self) -> bool:
        """Return whether the writer was heard recently enough to trust the copy of its tokens."""
        return not self._lease_s or self._clock() - self._heard_at <= self._lease_s

    @property
    def is_connected(self) -> bool:
        """Whether the writer has been heard of in the last five seconds."""
        return self._clock() - self._heard_at <= LOST_S

    # Taking in

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                self._follow()
            except _StartOverError as error:
                _log.warning("the copy starts over: %s", error)
                assert self._kb.folder is not None
                # Marked first: killed in between, the next start fetches a new copy, too.
                mark_following(self._kb.folder, self.url, complete=False)
                self._start_over()
                return
            except (httpx.HTTPError, RtaskError, OSError, RuntimeError, ValueError) as error:
                # The store raises OSError and RuntimeError, a damaged frame ValueError.
                self._outage.failed(error)
            self._closed.wait(_RETRY_S)

    def _follow(self) -> None:
        since = self._kb.feed.position(self._kb.seq)
        with (
            _client(self.url, self._token, read_s=LOST_S) as http,
            http.stream("GET", RECORDS, params={"since": since}) as answer,
        ):
            if answer.status_code in (409, 410):
                answer.read()
                raise _StartOverError(_detail(answer))
            if answer.status_code != 200:
                answer.read()
                raise UsageError(_detail(answer))
            self._outage.ended()
            _log.info("following %s from commit %d", self.url, self._kb.seq)
            frames = _Frames()
            for piece in answer.iter_raw():
                heard_at = self._clock()
                self._take(frames.feed(piece))
                self._heard_at = heard_at  # the tokens in it were taken over before
                if self._closed.is_set():
                    return

    def _take(self, frames: list[Record]) -> None:
        batch: list[Record] = []
        for frame in frames:
            kind = frame.header.get("kind")
            if kind == "tokens":
                self._tokens.replace(json.loads(frame.body))
            elif kind == "heartbeat":
                # What came before it is what it tells of.
                self._apply(batch)
                batch = []
                self._writer_seq = int(frame.header["seq"])
                if self._kb.seq >= self._writer_seq:
                    self._current_at = self._clock()
            elif frame.header.get("partial"):
                self._apply(batch)
                raise _StartOverError("a bulk load, which the journal does not hold")
            else:
                batch.append(frame)
                if len(batch) >= _MAX_BATCH:
                    self._apply(batch)
                    batch = []
        self._apply(batch)

    def _apply(self, records: list[Record]) -> None:
        if not records:
            return
        self._kb.apply_records(records)
        for record in records:
            # A look at the bytes saves decoding most records, which name no blob.
            if PREFIX.encode() in record.body:
                for quad in record.added():
                    digest = digest_of(str(getattr(quad.object, "value", "")))
                    if digest is not None:
                        self._blobs.put(digest)

    # Byte strings

    def _fetch(self, digest: str) -> bytes:
        """Return a byte string of the writer.

        Raises
        ------
        MissingBlobError
            It has none, or does not answer.
        """
        try:
            answer = self._http.get(f"{BLOBS}/{digest}", headers=authorization(self._token))
        except httpx.HTTPError as error:
            raise MissingBlobError(
                f"the blob {digest} is not here yet, and {self.url} does not answer: {error}",
                blob=digest,
            ) from error
        if answer.status_code != 200:
            raise MissingBlobError(f"{self.url} has no blob {digest}", blob=digest)
        return answer.content

    def _fetch_all(self) -> None:
        while (digest := self._blobs.get()) is not None and not self._closed.is_set():
            try:
                self._kb.blobs.require(PREFIX + digest)
            except RtaskError as error:
                _log.info("%s", error)  # it is asked for again when somebody reads it

    # Passing on

    def record(self, record: dict[str, Any], author: Access) -> None:
        """Keep what a robot asked here until the writer has it."""
        self._records.put(record, author)

    @property
    def records_waiting(self) -> int:
        """Number of records that the writer does not have yet."""
        return self._records.waiting

    @property
    def records_dropped(self) -> int:
        """Number of records that were dropped since the start."""
        return self._dropped

    def deliver_records(self) -> None:
        """Wait, for two seconds at most, until the writer has the records that wait."""
        if self._records.waiting:
            self._records.wait_until_sent(2.0)

    def _count_dropped(self, reason: str, count: int) -> None:
        self._dropped += count
        _log.warning("%d records of what robots asked were dropped: %s", count, reason)

    def _send_records(self, records: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Give records to the writer; return those that it refused."""
        answer = self._http.post(
            ASKED, json={"records": list(records)}, headers=authorization(self._token)
        )
        if answer.status_code != 200:
            raise RemoteUnavailableError(_detail(answer))
        refused: list[dict[str, Any]] = answer.json()["refused"]
        return refused

    def forward(self, request: Request) -> Response:
        """Let the writer answer a request, with the token of the caller.

        Raises
        ------
        RefusedError
            503: the writer does not answer.
        """
        # The writer has to know what a robot asked before it hears how that went.
        self.deliver_records()
        if not self.forwards:
            return self.redirect(request)
        target = _target(request)
        headers = {n: v for n, v in request.headers.items() if n in _PASSED_ON}
        try:
            answer = self._http.request(
                request.method, target, content=request.body, headers=headers
            )
        except httpx.HTTPError as error:
            raise RefusedError(
                503,
                "writer-unreachable",
                f"writes go to {self.url}, which does not answer: {error or type(error).__name__}; "
                "whether it was carried out is not known",
                headers=(("Retry-After", "5"),),
            ) from error
        passed_on = tuple((n, v) for n, v in answer.headers.items() if n.lower() not in _DROPPED)
        media_type = answer.headers.get("content-type", "")
        return Response(answer.status_code, answer.content, media_type, passed_on)

    def redirect(self, request: Request) -> Response:
        """Send a caller to the writer."""
        # 307 keeps method and body, which 302 does not.
        return Response(307, b"", "", (("Location", self.url + _target(request)),))

    def catch_up(self) -> None:
        """Wait, for two seconds at most, for what the writer has committed by now."""
        try:
            now = self._http.get(HEALTH, timeout=2.0).json()
            wait_for = minimum_version(self._kb, f"{now['epoch']}:{now['seq']}")
            wait_for(Response)
        except (httpx.HTTPError, RtaskError, ValueError, KeyError) as error:
            _log.info("an answer may lack what was just written: %s", error)


def _target(request: Request) -> str:
    return request.raw_path + (f"?{request.query_string}" if request.query_string else "")


class _Frames:
    """Cuts a stream into records and the frames among them."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, piece: bytes) -> list[Record]:
        """Return the frames that are whole now."""
        self._rest += piece
        frames = []
        at = 0
        while (end := self._rest.find(b"\n", at)) >= 0:
            header: dict[str, Any] = json.loads(self._rest[at:end])
            stop = end + 1 + int(header["bytes"])
            if stop > len(self._rest):
                break
            body = bytes(self._rest[end + 1 : stop])
            if "crc32" in header and zlib.crc32(body) != header["crc32"]:
                raise RemoteUnavailableError("a record was damaged on its way")
            frames.append(Record(header, body))
            at = stop
        del self._rest[:at]
        return frames


def _start_again() -> None:
    """Replace this process by a new one with the same command, which fetches a snapshot."""
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])
