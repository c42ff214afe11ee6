"""Processes that evaluate queries: a keeper, and the readers that it forks.

This file runs as a script. It and the files that it imports need only the standard library and
pyoxigraph, except for those that evaluate updates. The keeper holds a copy of the store in memory,
has one thread and evaluates nothing, so that it can be forked at any time. A reader is such a fork
(or opens a snapshot) and answers one query after another until its sockets close or it is killed. A
query can therefore be stopped at its deadline, run out of memory or crash without affecting other
queries. The messages: :mod:`rtask.kb.readers.messages`.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import signal
import socket
import sys
from typing import Any, NoReturn

import pyoxigraph as ox

from rtask.kb.readers.answering import answer_query
from rtask.kb.readers.memory import limit_memory, resident_bytes
from rtask.kb.readers.messages import Incoming, Questions, decode_change, message
from rtask.kb.readers.scheduling import in_long_turns
from rtask.kb.store.merged_graphs import MergedCopy

_PARENT_CHECK_S = 2.0
_PR_SET_PDEATHSIG = 1


def apply_change(store: ox.Store, payload: bytes, merged: MergedCopy | None = None) -> None:
    """Apply a change to a store in memory, and its merged copy; twice does no harm."""
    change = decode_change(payload)
    if merged is not None and merged.is_made:
        removed, added = list(change.removed), list(change.added)
        merged.follow(removed, added, change.created, change.dropped)
        change = change._replace(removed=removed, added=added)
    for quad in change.removed:
        store.remove(quad)
    store.extend(change.added)
    for graph in change.created:
        store.add_graph(graph)
    for graph in change.dropped:
        store.remove_graph(graph)


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
        for pid in self._readers:
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)

    def _handle(self, kind: bytes, payload: bytes, descriptors: list[int]) -> None:
        if kind == b"F":
            apply_change(self._store, payload)
        elif kind == b"K":
            self._fork(json.loads(payload), *descriptors)
        elif kind == b"L":
            for name in json.loads(payload):
                self._store.add_graph(ox.NamedNode(name))
            dump: Any = _Dump(self._incoming)
            self._store.bulk_extend(ox.parse(dump, format=ox.RdfFormat.N_QUADS))
            gc.freeze()
            self._connection.sendall(message(b"R"))

    def _fork(self, order: dict[str, Any], hello: int, questions: int, answers: int) -> None:
        if order["updates"]:
            _prepare_updates()
        keeper = os.getpid()
        pid = os.fork()
        if pid == 0:
            with contextlib.suppress(BaseException):
                self._connection.close()
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                _die_with(keeper)
                store = _started(self._store, order, socket.socket(fileno=hello))
                # A reader of a snapshot has one state only, and a large one.
                merged = None if order["snapshot"] else MergedCopy()
                _read(store, questions, answers, merged)
            os._exit(0)
        self._readers[pid] = order["number"]
        for descriptor in (hello, questions, answers):
            os.close(descriptor)

    def _reap(self) -> None:
        while self._readers:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            ended = {"number": self._readers.pop(pid), "code": os.waitstatus_to_exitcode(status)}
            self._connection.sendall(message(b"E", json.dumps(ended).encode()))


def _started(store: ox.Store, order: dict[str, Any], hello: socket.socket) -> ox.Store:
    """Prepare this process to be a reader, and announce it; return the store that it reads."""
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 2)
    if order["snapshot"]:
        store = ox.Store.read_only(order["snapshot"])
    limit_memory(order["memory"])
    with hello:
        _send_hello(hello)
    return store


def _read(store: ox.Store, questions: int, answers: int, merged: MergedCopy | None) -> NoReturn:
    """Apply commits and answer queries."""
    incoming = Questions(questions)
    while True:
        kind, payload = incoming.next()
        if kind == b"F":
            apply_change(store, payload, merged)
        elif kind == b"U":
            from rtask.kb.readers.update_answering import answer_update

            with in_long_turns():
                is_reusable = answer_update(store, json.loads(payload), answers)
            if not is_reusable:
                os._exit(0)  # a new reader costs less than restoring this copy
        elif kind == b"S":
            with in_long_turns():
                answer_query(store, payload, answers, merged)
        else:
            answer_query(store, payload, answers, merged)


def _prepare_updates() -> None:
    """Import the modules for updates before forking, to spare each reader the import."""
    with contextlib.suppress(ImportError):
        import rtask.kb.readers.update_answering  # noqa: F401

        gc.freeze()


def _die_with(keeper: int) -> None:
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != keeper:
        os._exit(0)


def _send_hello(hello: socket.socket) -> None:
    """Send a pidfd, so that the other side cannot kill an unrelated process with the same pid."""
    facts = {"pid": os.getpid(), "rss": resident_bytes()}
    data = message(b"H", json.dumps(facts).encode())
    if not hasattr(os, "pidfd_open"):
        hello.sendall(data)
        return
    own = os.pidfd_open(os.getpid())
    socket.send_fds(hello, [data], [own])
    os.close(own)


if __name__ == "__main__":
    Keeper(socket.socket(fileno=int(sys.argv[1]))).run()
    os._exit(0)  # to free the copy term by term would keep the knowledge base waiting
