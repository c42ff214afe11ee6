"""Evaluation of a query inside a reader process, and the answer that it sends through its pipe.

This file is part of the keeper's script and needs only the standard library and pyoxigraph.
"""

from __future__ import annotations

import json
import math
import os
import time
import zlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import pyoxigraph as ox

from rtask.kb.readers.memory import ResidentBytes
from rtask.kb.readers.messages import HEADER, message
from rtask.kb.store.merged_graphs import MergedCopy, with_merged_graphs
from rtask.rdf.xml_text import serialize

__all__ = ["PIECES", "answer_query", "refuse", "send_all"]

PIECES = (8 << 10, 32 << 10, 128 << 10, 256 << 10)
_SLOW_S = 0.05
_MIN_GZIP = 4 << 10
_ANSWERS = ("application/sparql-results+json", "application/n-triples")


_memory = ResidentBytes()


class _LimitExceeded(Exception):
    """A limit on the size of the answer was exceeded."""

    def __init__(self, limit: str, value: int, allowed: int) -> None:
        super().__init__(limit)
        self.facts = {"limit": limit, "value": value, "allowed": allowed}


class _Answer:
    """File-like writer that sends an answer through a pipe in pieces of growing size.

    A small first piece arrives early; large later pieces give throughput.
    """

    error: _LimitExceeded | None = None
    _total = _sent = _rows = 0
    _mark: bytes | None = None
    _overlap = b""
    _packer: Any = None

    def __init__(
        self, pipe: int, options: _Options, kind: str, media_type: str, started: float
    ) -> None:
        self._pipe = pipe
        self._options = options
        self._kind, self._type = kind, media_type
        self._started = started
        self._parts: list[bytes] = []
        self._size = 0

    def write(self, data: bytes) -> int:
        self._parts.append(data)
        self._size += len(data)
        if self._size >= PIECES[min(self._sent, len(PIECES) - 1)]:
            self._send(last=False)
        return len(data)

    def flush(self) -> None:
        """Do nothing; pieces are sent when they are large enough."""

    def finish(self) -> None:
        """Send the remaining data and the end message."""
        size = self._size
        if self._sent or not 0 < size < _MIN_GZIP or size > self._options.least_limit:
            self._send(last=True)
            return
        head = _head(self._kind, self._type, False) + HEADER.pack(b"C", size)
        send_all(self._pipe, b"".join((head, *self._parts, self._end())))

    def _send(self, last: bool) -> None:
        data = b"".join(self._parts)
        self._parts.clear()
        self._size = 0
        self._total += len(data)
        self._check(data)
        head = tail = b""
        if self._sent == 0:
            packed = self._options.gzip and not (last and len(data) < _MIN_GZIP)
            if packed:
                self._packer = zlib.compressobj(1, zlib.DEFLATED, 31)
            head = _head(self._kind, self._type, packed)
        if self._packer is not None:
            data = self._packer.compress(data)
            mode = zlib.Z_FINISH if last else zlib.Z_SYNC_FLUSH
            if last or self._sent == 0:
                data += self._packer.flush(mode)
        self._sent += 1
        if data:
            head += HEADER.pack(b"C", len(data))
        if last:
            tail = self._end()
        send_all(self._pipe, head + data + tail)

    def _end(self) -> bytes:
        return _end(_memory.recent(), time.thread_time() - self._started > _SLOW_S)

    def _check(self, data: bytes) -> None:
        max_rows, max_bytes = self._options.max_rows, self._options.max_bytes
        if max_bytes is not None and self._total > max_bytes:
            self.error = _LimitExceeded("bytes", self._total, max_bytes)
        if max_rows is not None:
            if self._mark is None:
                self._mark, self._rows = _row_mark(self._type)
            seen = self._overlap + data
            self._rows += seen.count(self._mark)
            self._overlap = seen[len(seen) - len(self._mark) + 1 :] if len(self._mark) > 1 else b""
            if self._rows > max_rows:
                self.error = _LimitExceeded("rows", self._rows, max_rows)
        if self.error is not None:
            raise self.error


@lru_cache(maxsize=64)
def _head(kind: str, media_type: str, packed: bool) -> bytes:
    facts = {"kind": kind, "type": media_type, "gzip": packed}
    return message(b"M", json.dumps(facts).encode())


@lru_cache(maxsize=16)
def _end(resident: int, is_slow: bool) -> bytes:
    return message(b"E", b'{"rss":%d%b}' % (resident, b',"slow":true' if is_slow else b""))


@lru_cache(maxsize=64)
def _row_mark(media_type: str) -> tuple[bytes, int]:
    """Return the byte string that separates rows of a format, and the initial row count.

    Rows are counted in the output; creating an object for each row would halve the throughput.
    """
    if media_type.endswith("results+json"):
        return b'"}},{"', 1
    if media_type.endswith("results+xml"):
        return b"<result>", 0
    return b"\n", -1 if media_type.endswith("values") or media_type == "text/csv" else 0


class _Options(NamedTuple):
    """Options for the evaluation of a query and the form of its answer.

    Attributes
    ----------
    dataset
        Options of ``pyoxigraph.Store.query``.
    media_type
        Of the answer; ``None`` for the type that is fastest to parse.
    least_limit
        Bytes up to which an answer exceeds neither limit: a row has at least one.
    """

    dataset: dict[str, Any]
    media_type: str | None
    gzip: bool
    max_rows: int | None
    max_bytes: int | None
    least_limit: float


@lru_cache(maxsize=256)
def _options(line: bytes) -> _Options:
    """Return what the first line of a query's message says; clients repeat it."""
    given = json.loads(line)
    dataset: dict[str, Any] = {"base_iri": given["base"]}
    if given["default"] is not None:
        dataset["default_graph"] = [ox.NamedNode(name) for name in given["default"]]
    if given["named"] is not None:
        dataset["named_graphs"] = [ox.NamedNode(name) for name in given["named"]]
    if given["union"]:
        dataset["use_default_graph_as_union"] = True
    rows, most = given["rows"], given["bytes"]
    least = min((limit for limit in (rows, most) if limit is not None), default=math.inf)
    return _Options(dataset, given["type"], given["gzip"], rows, most, least)


def answer_query(
    store: ox.Store, payload: bytes, pipe: int, merged: MergedCopy | None = None
) -> None:
    """Evaluate a query; send its answer or an error.

    Parameters
    ----------
    payload
        From :meth:`rtask.kb.readers.request.Question.encode`.
    merged
        Copy for queries that leave derived statements out.
    """
    answer: _Answer | None = None
    started = time.thread_time()  # which does not grow while others have the processor
    try:
        line, _, encoded = payload.partition(b"\n")
        options, text = _options(line), encoded.decode("utf-8", "surrogatepass")
        source, dataset = store, options.dataset
        if "default_graph" in dataset:
            source, dataset = with_merged_graphs(store, text, dataset, merged)
        result: Any = source.query(text, **dataset)
        kind, media_type, form = _form(_kind(result), options.media_type)
        answer = _Answer(pipe, options, kind, media_type, started)
        serialize(result, answer, form)
        del result
        answer.finish()
    except BrokenPipeError:
        raise
    except MemoryError:
        refuse(pipe, "memory", "")
    except SyntaxError as error:
        refuse(pipe, "syntax", str(error))
    except LookupError as error:
        refuse(pipe, "type", str(error.args[0]))
    except Exception as error:  # noqa: BLE001 - whatever it is, the other side must know
        over = answer.error if answer is not None else None
        if over is not None:
            refuse(pipe, "limit", str(over), **over.facts)
        else:
            refuse(pipe, "evaluation", str(error))


def _kind(result: Any) -> str:
    if isinstance(result, ox.QuerySolutions):
        return "rows"
    return "boolean" if isinstance(result, ox.QueryBoolean) else "triples"


@lru_cache(maxsize=64)
def _form(kind: str, media_type: str | None) -> tuple[str, str, Any]:
    """Return the kind and media type of an answer, and its serialization format."""
    from_media_type: Callable[[str], Any]
    if kind == "triples":
        from_media_type, own = ox.RdfFormat.from_media_type, _ANSWERS[1]
    else:
        from_media_type, own = ox.QueryResultsFormat.from_media_type, _ANSWERS[0]
    form = from_media_type(media_type or own)
    if form is None:
        carried = "triples" if kind == "triples" else "rows or a truth value"
        raise LookupError(f"{media_type!r} cannot represent {carried}")
    return kind, media_type or own, form


def refuse(pipe: int, reason: str, text: str, **facts: Any) -> None:
    """Send an error instead of an answer."""
    send_all(pipe, message(b"X", json.dumps({"reason": reason, "text": text, **facts}).encode()))


def send_all(pipe: int, data: bytes) -> None:
    """Write all of ``data``, waiting for the other side to read."""
    sent = os.write(pipe, data)
    if sent < len(data):
        view = memoryview(data)[sent:]
        while view:
            view = view[os.write(pipe, view) :]
