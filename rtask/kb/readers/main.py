"""Processes that evaluate queries: a keeper, and the readers that it forks.

This file runs as a script and needs only the standard library and pyoxigraph. The keeper holds a
copy of the store in memory, has one thread and evaluates nothing, so that it can be forked at any
time. A reader is such a fork (or opens a snapshot) and answers one query after another until its
sockets close or it is killed. A query can therefore be stopped at its deadline, run out of memory
or crash without affecting other queries.

A message consists of a type byte, a length and a payload. To the keeper: ``L`` a dump of the store
follows in ``D`` pieces, the last one empty; ``F`` a commit; ``K`` fork a reader on the descriptors
sent along. From the keeper: ``R`` the dump is loaded; ``E`` a reader has ended. To a reader: ``F``
a commit; ``Q`` a query; ``U`` an update, answered with its exact change. From a reader, through a
pipe: ``M`` the kind and media type of the answer; ``C`` a piece of it; ``E`` its end; ``X`` an
error.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import signal
import socket
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

import pyoxigraph as ox

HEADER = struct.Struct("<cI")
PIECES = (8 << 10, 32 << 10, 128 << 10, 256 << 10)
_MIN_GZIP = 1 << 10
_PARENT_CHECK_S = 2.0
_PR_SET_PDEATHSIG = 1
_ANSWERS = ("application/sparql-results+json", "application/n-triples")


def message(kind: bytes, payload: bytes = b"") -> bytes:
    """Encode a message."""
    return HEADER.pack(kind, len(payload)) + payload


class Incoming:
    """Messages from a socket, with the file descriptors sent along."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def next(self) -> tuple[bytes, bytes, list[int]]:
        """Return type, payload and descriptors of the next message.

        Raises
        ------
        EOFError
            When the other side has closed.
        """
        # descriptors arrive with the first byte of a message, so its header is read by itself
        header, descriptors = b"", []
        while len(header) < HEADER.size:
            part, found, _, _ = socket.recv_fds(self._connection, HEADER.size - len(header), 4)
            if not part:
                raise EOFError
            header += part
            descriptors += found
        kind, length = HEADER.unpack(header)
        return kind, self._exactly(length), descriptors

    def _exactly(self, length: int) -> bytes:
        data = bytearray(length)
        view = memoryview(data)
        while view:
            count = self._connection.recv_into(view)
            if not count:
                raise EOFError
            view = view[count:]
        return bytes(data)


def encode_commit(removed: bytes, added: bytes, created: list[str], dropped: list[str]) -> bytes:
    """Return a commit's payload; ``removed`` and ``added`` are N-Quads."""
    head = {"removed": len(removed), "created": created, "dropped": dropped}
    return json.dumps(head).encode() + b"\n" + removed + added


def apply_commit(store: ox.Store, payload: bytes) -> None:
    """Apply a commit to a store in memory; applying it twice does no harm."""
    line, _, body = payload.partition(b"\n")
    head = json.loads(line)
    cut = head["removed"]
    for quad in ox.parse(body[:cut], format=ox.RdfFormat.N_QUADS):
        store.remove(quad)
    store.extend(ox.parse(body[cut:], format=ox.RdfFormat.N_QUADS))
    for name in head["created"]:
        store.add_graph(ox.NamedNode(name))
    for name in head["dropped"]:
        store.remove_graph(ox.NamedNode(name))


class _Dump:
    """File-like reader over the ``D`` messages of a dump."""

    def __init__(self, incoming: Incoming) -> None:
        self._incoming = incoming
        self._left = b""
        self._ended = False

    def read(self, size: int = -1) -> bytes:
        if not self._left and not self._ended:
            _, self._left, _ = self._incoming.next()
            self._ended = not self._left
        size = len(self._left) if size < 0 else size
        data, self._left = self._left[:size], self._left[size:]
        return data


class Keeper:
    """Holds the replica, forks readers and reports how they ended."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._incoming = Incoming(connection)
        self._store = ox.Store()
        self._readers: dict[int, int] = {}

    def run(self) -> None:
        """Serve until the other side closes the connection or disappears."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        woken, wake = os.pipe()
        for end in (woken, wake):
            os.set_blocking(end, False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        parent = os.getppid()
        gc.freeze()
        with contextlib.suppress(EOFError, OSError):
            while os.getppid() == parent:
                watched: list[Any] = [self._connection, woken]
                ready, _, _ = select.select(watched, [], [], _PARENT_CHECK_S)
                if woken in ready:
                    os.read(woken, 4096)
                    self._reap()
                if self._connection in ready:
                    self._handle(*self._incoming.next())
        for pid in self._readers:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)

    def _handle(self, kind: bytes, payload: bytes, descriptors: list[int]) -> None:
        if kind == b"F":
            apply_commit(self._store, payload)
        elif kind == b"K":
            self._fork(json.loads(payload), *descriptors)
        elif kind == b"L":
            for name in json.loads(payload):
                self._store.add_graph(ox.NamedNode(name))
            dump: Any = _Dump(self._incoming)
            self._store.bulk_extend(ox.parse(dump, format=ox.RdfFormat.N_QUADS))
            gc.freeze()
            self._connection.sendall(message(b"R"))

    def _fork(self, order: dict[str, Any], control: int, answers: int) -> None:
        if order["updates"]:
            _prepare_updates()
        keeper = os.getpid()
        pid = os.fork()
        if pid == 0:
            with contextlib.suppress(BaseException):
                self._connection.close()
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                _read(self._store, order, socket.socket(fileno=control), answers, keeper)
            os._exit(0)
        self._readers[pid] = order["number"]
        os.close(control)
        os.close(answers)

    def _reap(self) -> None:
        while self._readers:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            ended = {"number": self._readers.pop(pid), "code": os.waitstatus_to_exitcode(status)}
            self._connection.sendall(message(b"E", json.dumps(ended).encode()))


def _read(
    store: ox.Store, order: dict[str, Any], control: socket.socket, answers: int, keeper: int
) -> NoReturn:
    """Run as a reader: announce the process, then apply commits and answer queries."""
    _die_with(keeper)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 2)
    if order["snapshot"]:
        store = ox.Store.read_only(order["snapshot"])
    _limit_memory(order["memory"])
    _send_hello(control)
    incoming = Incoming(control)
    while True:
        kind, payload, _ = incoming.next()
        if kind == b"F":
            apply_commit(store, payload)
        elif kind == b"U":
            _update(store, json.loads(payload), answers)
        else:
            _answer(store, json.loads(payload), answers)


def _prepare_updates() -> None:
    """Import the modules for updates before forking, to spare each reader the import."""
    with contextlib.suppress(ImportError):
        import rtask.kb.readers.update_main  # noqa: F401

        gc.freeze()


def _die_with(keeper: int) -> None:
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != keeper:
        os._exit(0)


def _limit_memory(allowed: int) -> None:
    """Limit this process to ``allowed`` bytes more than it uses now."""
    import resource

    used = _data_bytes()
    resource.setrlimit(resource.RLIMIT_DATA, (used + allowed, used + allowed))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _data_bytes() -> int:
    with contextlib.suppress(OSError, ValueError, StopIteration), open("/proc/self/status") as file:  # noqa: PTH123 - no pathlib in a process that must be small
        line = next(line for line in file if line.startswith("VmData:"))
        return int(line.split()[1]) << 10
    return 0


def _send_hello(control: socket.socket) -> None:
    """Send a pidfd, so that the other side cannot kill an unrelated process with the same pid."""
    facts = {"pid": os.getpid(), "rss": _resident()}
    hello = message(b"H", json.dumps(facts).encode())
    if not hasattr(os, "pidfd_open"):
        control.sendall(hello)
        return
    own = os.pidfd_open(os.getpid())
    socket.send_fds(control, [hello], [own])
    os.close(own)


class _LimitExceeded(Exception):
    """A limit on the size of the answer was exceeded."""

    def __init__(self, limit: str, value: int, allowed: int) -> None:
        super().__init__(limit)
        self.facts = {"limit": limit, "value": value, "allowed": allowed}


class _Answer:
    """File-like writer that sends an answer through a pipe in pieces of growing size.

    A small first piece arrives early; large later pieces give throughput.
    """

    def __init__(self, pipe: int, question: dict[str, Any], facts: dict[str, Any]) -> None:
        self._pipe = pipe
        self._facts = facts
        self._parts: list[bytes] = []
        self._size = self._total = self._sent = 0
        self._max_rows, self._max_bytes = question["rows"], question["bytes"]
        self._mark, self._rows = b"", 0
        if self._max_rows is not None:
            self._mark, self._rows = _row_mark(facts["type"])
        self._overlap = b""
        self._packer: Any = None
        self._wants_gzip = question["gzip"]
        self.error: _LimitExceeded | None = None

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
        self._send(last=True)

    def _send(self, last: bool) -> None:
        data = b"".join(self._parts)
        self._parts.clear()
        self._size = 0
        self._total += len(data)
        self._check(data)
        head = tail = b""
        if self._sent == 0:
            packed = self._wants_gzip and not (last and len(data) < _MIN_GZIP)
            if packed:
                self._packer = zlib.compressobj(1, zlib.DEFLATED, 31)
            head = message(b"M", json.dumps({**self._facts, "gzip": packed}).encode())
        if self._packer is not None:
            data = self._packer.compress(data)
            mode = zlib.Z_FINISH if last else zlib.Z_SYNC_FLUSH
            if last or self._sent == 0:
                data += self._packer.flush(mode)
        self._sent += 1
        if data:
            head += HEADER.pack(b"C", len(data))
        if last:
            facts = {"bytes": self._total, "rss": _resident()}
            tail = message(b"E", json.dumps(facts).encode())
        _send_all(self._pipe, b"".join((head, data, tail)))

    def _check(self, data: bytes) -> None:
        if self._max_bytes is not None and self._total > self._max_bytes:
            self.error = _LimitExceeded("bytes", self._total, self._max_bytes)
        if self._mark:
            seen = self._overlap + data
            self._rows += seen.count(self._mark)
            self._overlap = seen[len(seen) - len(self._mark) + 1 :] if len(self._mark) > 1 else b""
            if self._rows > self._max_rows:
                self.error = _LimitExceeded("rows", self._rows, self._max_rows)
        if self.error is not None:
            raise self.error


def _row_mark(media_type: str) -> tuple[bytes, int]:
    """Return the byte string that separates rows of a format, and the initial row count.

    Rows are counted in the output; creating an object for each row would halve the throughput.
    """
    if media_type.endswith("results+json"):
        return b'"}},{"', 1
    if media_type.endswith("results+xml"):
        return b"<result>", 0
    return b"\n", -1 if media_type.endswith("values") or media_type == "text/csv" else 0


def _answer(store: ox.Store, question: dict[str, Any], pipe: int) -> None:
    """Evaluate a query; send its answer or an error."""
    answer: _Answer | None = None
    try:
        result: Any = store.query(question["text"], **_dataset(question))
        facts, form = _form(result, question["type"])
        answer = _Answer(pipe, question, facts)
        sink: Any = answer
        result.serialize(sink, form)
        del result
        answer.finish()
    except BrokenPipeError:
        raise
    except MemoryError:
        _refuse(pipe, "memory", "")
    except SyntaxError as error:
        _refuse(pipe, "syntax", str(error))
    except LookupError as error:
        _refuse(pipe, "type", str(error.args[0]))
    except Exception as error:  # noqa: BLE001 - whatever it is, the other side must know
        over = answer.error if answer is not None else None
        if over is not None:
            _refuse(pipe, "limit", str(over), **over.facts)
        else:
            _refuse(pipe, "evaluation", str(error))


def _update(store: ox.Store, order: dict[str, Any], pipe: int) -> None:
    """Evaluate an update on the copy, send its exact change, then undo it or exit."""
    undone = False
    try:
        from rtask.kb.readers.update_main import evaluate

        with _memory_limit(order["memory"]):
            payload, undone = evaluate(store, order)
    except MemoryError:
        _refuse(pipe, "memory", "")
    except Exception as error:  # noqa: BLE001 - whatever it is, the other side must know
        undone = getattr(error, "undone", False)
        facts = {"error": type(error).__name__, "details": getattr(error, "details", {})}
        _refuse(pipe, "update", str(error), reusable=undone, **facts)
    else:
        facts = {"kind": "update", "type": "application/n-quads", "gzip": False}
        end = {"bytes": len(payload), "rss": _resident(), "reusable": undone}
        parts = [message(b"M", json.dumps(facts).encode()), message(b"C", payload)]
        _send_all(pipe, b"".join([*parts, message(b"E", json.dumps(end).encode())]))
    if not undone:
        os._exit(0)


@contextlib.contextmanager
def _memory_limit(allowed: int) -> Iterator[None]:
    """Limit this process to ``allowed`` bytes more than it uses now, inside the block."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = _data_bytes() + allowed
    resource.setrlimit(resource.RLIMIT_DATA, (limit if soft < 0 else min(limit, soft), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _dataset(question: dict[str, Any]) -> dict[str, Any]:
    options: dict[str, Any] = {"base_iri": question["base"]}
    if question["default"] is not None:
        options["default_graph"] = [ox.NamedNode(name) for name in question["default"]]
    if question["named"] is not None:
        options["named_graphs"] = [ox.NamedNode(name) for name in question["named"]]
    if question["union"]:
        options["use_default_graph_as_union"] = True
    return options


def _form(result: Any, media_type: str | None) -> tuple[dict[str, Any], Any]:
    """Return the kind and media type of the answer, and its serialization format."""
    known: Callable[[str], Any]
    if isinstance(result, ox.QueryTriples):
        kind, known, own = "triples", ox.RdfFormat.from_media_type, _ANSWERS[1]
    else:
        kind = "boolean" if isinstance(result, ox.QueryBoolean) else "rows"
        known, own = ox.QueryResultsFormat.from_media_type, _ANSWERS[0]
    form = known(media_type or own)
    if form is None:
        carried = "triples" if kind == "triples" else "rows or a truth value"
        raise LookupError(f"{media_type!r} cannot represent {carried}")
    return {"kind": kind, "type": media_type or own}, form


def _refuse(pipe: int, reason: str, text: str, **facts: Any) -> None:
    _send_all(pipe, message(b"X", json.dumps({"reason": reason, "text": text, **facts}).encode()))


def _send_all(pipe: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(pipe, view) :]


def _resident() -> int:
    """Return the resident memory of this process that is not shared, in bytes."""
    try:
        with open("/proc/self/statm") as file:  # noqa: PTH123 - as above
            _, resident, shared, *_ = map(int, file.read().split())
    except OSError:
        return 0
    return (resident - shared) * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    Keeper(socket.socket(fileno=int(sys.argv[1]))).run()
