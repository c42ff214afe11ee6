"""Answers to queries, streamed from the reader processes of the knowledge base.

A reader is a process that is killed at the query's deadline, when its client leaves, or when
somebody stops the query. Some readers are reserved for quick queries
(:class:`rtask.kb.readers.request.ReaderLimits`), so that a robot's look-up never waits for a long
report.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from endpoint.http.messages import Response
from endpoint.http.plan import RunningQuery
from endpoint.served import ServedGraph
from endpoint.settings import Config
from endpoint.sparql import negotiation
from endpoint.sparql.request import QueryRequest
from rtask.errors import ClosedError, QueryTimeout
from rtask.kb.readers.keeper import ReaderGone
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream, Stream
from rtask.knowledge_base import KnowledgeBase

# A reader is killed at its deadline; whoever waits for it allows so much more.
GRACE_S = 5.0
QUICK_S = 1.0  # until a query that looks quick has answered, or its answer has turned out long
MAX_QUICK_BYTES = 256 << 10
_FILE_PIECE = 256 << 10
LAST_PIECE = 8 << 10  # a reader's first piece is smaller only if it is all there is


class SlowerThanItLooksError(Exception):
    """A query that looked quick is not; it is to be run again among the long ones."""


@dataclass(frozen=True)
class Question:
    """A query and the form of its answer.

    Parameters
    ----------
    query
        The query as sent.
    media_type
        Media type of the answer.
    gzip
        Whether a large answer is to be compressed.
    headers
        Header fields of the answer.
    running
        Registration of the running query, by which it is listed and stopped.
    deadline
        On the monotonic clock.
    """

    query: QueryRequest
    media_type: str
    gzip: bool
    headers: tuple[tuple[str, str], ...]
    running: RunningQuery
    deadline: float


class Answers:
    """Opens answers, and limits how many long ones run at once.

    Parameters
    ----------
    kb
        The knowledge base.
    config
        Limits of one answer.
    """

    def __init__(self, kb: ServedGraph, config: Config) -> None:
        self._kb = kb
        self._config = config
        self._slow = threading.BoundedSemaphore(kb.readers.limits.long)

    def open(self, question: Question, *, point: bool) -> Response:
        """Open an answer; its first piece is available on return.

        Raises
        ------
        SlowerThanItLooksError
            It was taken for a point query by mistake.
        QueryTimeout
            The time limit is exceeded, waiting included.
        RtaskError
            The query failed.
        """
        left = question.deadline - time.monotonic()
        if point:
            try:
                return self._open_quick(question, min(QUICK_S, left))
            except QueryTimeout:
                if question.deadline - time.monotonic() > 0.0 and not question.running.stopped:
                    raise SlowerThanItLooksError from None
                raise
        if left <= 0 or not self._slow.acquire(timeout=left):
            raise QueryTimeout("the query waited for others until its time was over")
        try:
            return self._open_long(question, question.deadline - time.monotonic())
        except BaseException:
            self._slow.release()
            raise

    def _open_quick(self, question: Question, timeout_s: float) -> Response:
        """Answer at once if the answer is short; else continue as a long one, with its time.

        The guess that a query is quick says nothing about how long its answer is, nor how fast its
        client reads. It bounds the time until the size is known, never the sending.
        """
        return self._read_quick(question, *self._begin(question, timeout_s, None))

    def encode(self, question: Question) -> bytes | None:
        """Return a point query as it is sent to a reader; none if a thread is to do the work."""
        query = question.query
        if not isinstance(self._kb, KnowledgeBase) or question.running.stopped:
            return None
        return self._kb.encode_query(
            query.text,
            question.media_type,
            inferred=query.inferred,
            default_graphs=query.default_graphs or None,
            named_graphs=query.named_graphs or None,
            base_iri=query.base or None,
            gzip=question.gzip,
            max_rows=self._config.max_rows,
            max_bytes=self._config.max_result_bytes,
        )

    @staticmethod
    def whole(question: Question, answer: Answer) -> Response:
        """Return the response for an answer that came as a whole."""
        return _response(question, answer.body, None, answer.gzip)

    def resume(self, question: Question, stream: ReaderStream) -> Response:
        """Return a long answer from a stream that has begun to arrive.

        Raises
        ------
        SlowerThanItLooksError, QueryTimeout, RtaskError
            As :meth:`open`.
        """
        pieces = Pieces(stream, None)
        question.running.on_stop(stream.close)
        left = question.deadline - time.monotonic()
        try:
            if not stream.extend(max(0.001, min(QUICK_S, left))):
                raise SlowerThanItLooksError
            stream.start()
        except ReaderGone:  # killed from outside, or by this query: another reader will tell
            return self._open_quick(question, max(0.001, min(QUICK_S, left)))
        except QueryTimeout:
            if left > 0.0 and not question.running.stopped:
                raise SlowerThanItLooksError from None
            raise
        except BaseException:
            pieces.close()
            raise
        return self._read_quick(question, stream, pieces)

    def _read_quick(self, question: Question, stream: Stream, pieces: Pieces) -> Response:
        try:
            first = b""
            for piece in pieces:
                first += piece
                if len(first) >= MAX_QUICK_BYTES:
                    break
            else:
                pieces.close()
                return _response(question, first, None, stream.gzip)
            if not self._slow.acquire(blocking=False):
                raise SlowerThanItLooksError
            pieces.take_slot(self._slow)
            if not stream.extend(max(0.001, question.deadline - time.monotonic())):
                raise SlowerThanItLooksError
            return _response(question, first, pieces, stream.gzip)
        except BaseException:
            pieces.close()
            raise

    def _open_long(self, question: Question, timeout_s: float) -> Response:
        """Open an answer in a slot that the caller took, and releases if this fails."""
        stream, pieces = self._begin(question, timeout_s, self._slow)
        try:
            first = next(pieces, b"")
            if len(first) < LAST_PIECE and not stream.gzip:
                first += b"".join(pieces)
                pieces.close()
                return _response(question, first, None, stream.gzip)
        except BaseException:
            pieces.close(keep_slot=True)
            raise
        return _response(question, first, pieces, stream.gzip)

    def _begin(
        self, question: Question, timeout_s: float, slot: threading.BoundedSemaphore | None
    ) -> tuple[Stream, Pieces]:
        query, running = question.query, question.running
        if running.stopped:
            raise ClosedError("the query was stopped")
        stream = self._kb.stream(
            query.text,
            question.media_type,
            timeout_s=max(0.001, timeout_s),
            inferred=query.inferred,
            default_graphs=query.default_graphs or None,
            named_graphs=query.named_graphs or None,
            base_iri=query.base or None,
            gzip=question.gzip,
            max_rows=self._config.max_rows,
            max_bytes=self._config.max_result_bytes,
            on_start=lambda started: running.on_stop(started.close),
            quick=slot is None,
        )
        return stream, Pieces(stream, slot)


def _response(question: Question, body: bytes, chunks: Pieces | None, gzip: bool) -> Response:
    headers = question.headers
    if gzip:
        headers = (*headers, ("Content-Encoding", "gzip"))
    content_type = negotiation.content_type(question.media_type)
    return Response(200, body, content_type, headers, chunks)


class FilePieces(Iterator[bytes]):
    """Pieces of an answer that was written to a file.

    Parameters
    ----------
    file
        File at its beginning; closed at the end.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def __iter__(self) -> FilePieces:
        return self

    def __next__(self) -> bytes:
        piece = self._file.read(_FILE_PIECE)
        if not piece:
            raise StopIteration
        return piece

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Pieces(Iterator[bytes]):
    """Pieces of one answer.

    Parameters
    ----------
    stream
        Source of the pieces.
    slot
        Slot to release at the end.
    """

    def __init__(self, stream: Stream, slot: threading.BoundedSemaphore | None) -> None:
        self._stream = stream
        self._slot = slot
        self._lock = threading.Lock()

    def __iter__(self) -> Pieces:
        return self

    def __next__(self) -> bytes:
        return next(self._stream)

    def take_slot(self, slot: threading.BoundedSemaphore) -> None:
        """Take over a slot, to be released at the end."""
        with self._lock:
            self._slot = slot

    def close(self, *, keep_slot: bool = False) -> None:
        """Stop the query if it is running, and release its slot."""
        self._stream.close()
        with self._lock:
            slot, self._slot = self._slot, None
        if slot is not None and not keep_slot:
            slot.release()
