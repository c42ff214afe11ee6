"""Handles of the keeper and its readers in the knowledge base's own process.

One thread sends all messages to the keeper, so the dump, the commits and the requests to fork
stay in order, and a reader forked after a commit contains it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import logging
import os
import select
import signal
import socket
import sys
import threading
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyoxigraph as ox
from pyoxigraph import NamedNode, RdfFormat

from rtask.errors import ClosedError
from rtask.kb.readers import main as reader_main
from rtask.kb.readers.frames import CommitFrame, DumpSink
from rtask.kb.readers.messages import Incoming, message
from rtask.kb.store.embedded import embedded_store
from rtask.kb.store.graph_store import GraphStore

if TYPE_CHECKING:
    import subprocess

__all__ = ["KeeperProcess", "ReaderGone", "ReaderProcess", "wait_for"]

_log = logging.getLogger(__name__)
_PIPE_BYTES = 1 << 20
_QUESTIONS_BYTES = 256 << 10
_SEND_TIMEOUT_S = 30.0
_COALESCE_S = 0.005
_FEW = 64
_AT_ONCE = 64 << 10
_END_S = 1.0
# -I: neither the script's folder nor the environment may shadow the standard library. The packages
# that this process uses are searched next, before anything else that is installed.
_START = """
import runpy, sys
places, script = sys.argv.pop().split("\\n"), sys.argv.pop()
installed = [i for i, place in enumerate(sys.path) if place.endswith("site-packages")]
at = installed[0] if installed else len(sys.path)
sys.path[at:at] = places
runpy.run_path(script, None, "__main__")
"""


class ReaderGone(Exception):
    """A reader ended before its answer did."""


class ReaderProcess:
    """Handle of a reader process, which evaluates one query at a time.

    Parameters
    ----------
    snapshot_seq
        Commit number of the snapshot that it reads; ``None`` if it follows the commits.
    """

    def __init__(self, keeper: KeeperProcess, number: int, snapshot_seq: int | None = None) -> None:
        self.keeper = keeper
        self.number = number
        self.snapshot_seq = snapshot_seq
        self.killed = False
        self.waiting_bytes = 0
        self.grown_bytes = 0
        self.exit_code: int | None = None
        self.ended = threading.Event()
        self.busy = False
        self._lock = threading.RLock()
        self._frames: deque[CommitFrame] = deque()
        self._unsent = b""  # the rest of commits of which the pipe took a part
        self._pid = self._pid_handle = -1
        self._closed = False
        # Pipes, for a message through a socket takes twice the time; descriptors need a socket.
        self._hello, theirs = socket.socketpair()
        their_questions, self._questions = os.pipe()
        self.answers, their_answers = os.pipe()
        os.set_blocking(self._questions, False)
        with contextlib.suppress(OSError, AttributeError):
            fcntl.fcntl(self._questions, fcntl.F_SETPIPE_SZ, _QUESTIONS_BYTES)
            fcntl.fcntl(self.answers, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self.given: tuple[int, ...] = (theirs.detach(), their_questions, their_answers)

    @property
    def pid(self) -> int:
        """Process identifier, available after :meth:`say_hello`."""
        return self._pid

    @property
    def is_gone(self) -> bool:
        """Whether the process was killed, here or from outside."""
        return self.killed or self.ended.is_set()

    def add(self, frame: CommitFrame) -> None:
        """Queue a commit to be sent before the next query."""
        self._frames.append(frame)
        self.waiting_bytes += frame.weight

    def say_hello(self, timeout_s: float | None) -> None:
        """Wait until the process is ready.

        Raises
        ------
        ReaderGone
            The process did not become ready within the time.
        """
        if self._pid > 0:
            return
        try:
            self._hello.settimeout(timeout_s)
            _, payload, descriptors = Incoming(self._hello).next()
        except (EOFError, OSError) as error:
            raise ReaderGone from error
        facts = json.loads(payload)
        with self._lock:
            self._pid, self._rss = facts["pid"], facts["rss"]
            self._pid_handle = descriptors[0] if descriptors else -1

    def ask(self, question: bytes, kind: bytes = b"Q", at: float | None = None) -> None:
        """Send the waiting commits, then a query, or a long one or an update as its kind says.

        Parameters
        ----------
        at
            Deadline of the query on the monotonic clock: a reader that has much to catch up with
            may hold it up until then, and no longer.

        Raises
        ------
        ReaderGone
            The process has ended, or did not read in time, and cannot be used any more.
        """
        with self._lock:
            self._flush(message(kind, question), at)

    def ask_now(self, question: bytes) -> bool:
        """Send the waiting commits and a query, if that needs no waiting; tell whether it did."""
        if self.waiting_bytes > _AT_ONCE or not self._lock.acquire(blocking=False):
            return False
        try:
            if self._closed or self._pid < 0 or self._unsent:
                return False
            data = message(b"Q", question)
            if self._frames:
                data = b"".join([*self._waiting(), data])
            if os.write(self._questions, data) == len(data):
                return True
        except OSError:
            pass
        finally:
            self._lock.release()
        self.kill()  # half a message was sent
        return False

    def follow(self) -> None:
        """Send the queued commits now if the reader is idle; a few may stay queued.

        This waits for no reader, since its thread serves the others, too.
        """
        if len(self._frames) < _FEW or not self._lock.acquire(blocking=False):
            return
        try:
            if not self.busy and self._pid > 0 and not self._closed:
                self._flush(b"", may_wait=False)
        except ReaderGone:
            self.killed = True
        finally:
            self._lock.release()

    def _flush(self, last: bytes, at: float | None = None, may_wait: bool = True) -> None:
        if self._closed:
            raise ReaderGone
        data = memoryview(b"".join([self._unsent, *self._waiting(), last]))
        self._unsent = b""
        until = time.monotonic() + _SEND_TIMEOUT_S
        if at is not None:
            until = min(until, at)
        while data:
            try:
                data = data[os.write(self._questions, data) :]
            except BlockingIOError:
                if not may_wait:
                    self._unsent = bytes(data)
                    self.waiting_bytes = len(data)
                    return
                left = until - time.monotonic()
                if not wait_for(self._questions, select.POLLOUT, left):
                    raise ReaderGone from None
            except OSError as error:
                raise ReaderGone from error

    def _waiting(self) -> list[bytes]:
        """Take the queued commits, encoded."""
        parts = []
        while self._frames:
            parts.append(self._frames.popleft().encode())
        self.waiting_bytes = 0
        return parts

    def measured(self, rss: int) -> None:
        """Record the size of the process after a query."""
        self.grown_bytes = rss - self._rss

    def kill(self) -> None:
        """Kill the process at once; a thread that reads its answer gets the end of the pipe."""
        with self._lock:
            self.killed = True
            if self._closed or self._pid < 0:
                # a process that has not announced itself yet exits when its socket is closed
                with contextlib.suppress(OSError):
                    self._hello.shutdown(socket.SHUT_RDWR)
                return
            with contextlib.suppress(ProcessLookupError):
                if self._pid_handle >= 0:
                    signal.pidfd_send_signal(self._pid_handle, signal.SIGKILL)
                elif not self.ended.is_set():
                    os.kill(self._pid, signal.SIGKILL)

    def close(self) -> None:
        """Kill the process and close its descriptors; no thread may be reading its answer."""
        self.kill()
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._hello.close()
            os.close(self._questions)
            os.close(self.answers)
            if self._pid_handle >= 0:
                os.close(self._pid_handle)


class KeeperProcess:
    """Handle of the process that forks readers.

    Parameters
    ----------
    store
        Store to copy and follow; ``None`` if the readers open snapshots.
    memory_bytes
        Memory that a reader may use in addition to the shared copy.
    """

    def __init__(self, store: GraphStore | None, memory_bytes: int, max_waiting: int) -> None:
        self.memory_bytes = memory_bytes
        self.ready = threading.Event()
        self.retired = False
        self.failed = False
        self.follows = store is not None
        self.evaluates_updates = False
        self.waiting_bytes = 0
        self._max_waiting = max_waiting
        self._readers: dict[int, ReaderProcess] = {}
        self._numbers = 0
        self._changed = threading.Condition()
        self._outbox: deque[CommitFrame | ReaderProcess] = deque()
        self._orders: dict[int, dict[str, Any]] = {}
        self._connection, theirs = socket.socketpair()
        with theirs:
            self.process = _start(theirs)
        if store is None:
            self.ready.set()
        self._sender = threading.Thread(
            target=self._send_all, args=(store,), name="rtask-keeper-send", daemon=True
        )
        self._receiver = threading.Thread(
            target=self._receive, name="rtask-keeper-receive", daemon=True
        )

    def start(self) -> None:
        """Start copying the store; from now on every commit must be passed to :meth:`add`."""
        self._sender.start()
        self._receiver.start()

    @property
    def readers(self) -> list[ReaderProcess]:
        """The readers that have not ended."""
        return list(self._readers.values())

    def add(self, frame: CommitFrame) -> None:
        """Send a commit to the replica and all its readers; never waits."""
        with self._changed:
            if self.failed:
                return
            self._outbox.append(frame)
            self.waiting_bytes += frame.weight
            for reader in self._readers.values():
                reader.add(frame)
            if self.waiting_bytes > self._max_waiting:
                _log.info("the replica is too far behind and will be rebuilt")
                self.failed = True
            self._changed.notify()

    def fork(self, snapshot: Path | None = None, snapshot_seq: int | None = None) -> ReaderProcess:
        """Request a reader that contains every commit added before."""
        with self._changed:
            if self.failed:
                raise ReaderGone
            self._numbers += 1
            reader = ReaderProcess(self, self._numbers, snapshot_seq)
            self._readers[reader.number] = reader
            self._orders[reader.number] = {
                "number": reader.number,
                "memory": self.memory_bytes,
                "snapshot": None if snapshot is None else str(snapshot),
                "updates": self.evaluates_updates,
            }
            self._outbox.append(reader)
            self._changed.notify()
        return reader

    def _send_all(self, store: GraphStore | None) -> None:
        try:
            if store is not None:
                self._send_dump(store)
            while True:
                with self._changed:
                    while not self._outbox and not self.failed:
                        self._changed.wait()
                    if self.failed:
                        return
                    batch = list(self._outbox)
                    self._outbox.clear()
                    self.waiting_bytes = 0
                self._send_batch(batch)
                for reader in self.readers:
                    reader.follow()
                with self._changed:  # commits in quick succession are sent together
                    self._changed.wait_for(self._is_urgent, _COALESCE_S)
        except (OSError, ClosedError) as error:
            _log.debug("the keeper cannot be reached: %s", error)
        finally:
            self._fail()

    def _is_urgent(self) -> bool:
        return self.failed or bool(self._orders)

    def _send_dump(self, store: GraphStore) -> None:
        # Commits stored from now on are queued. Some may be in the dump, too; applying them again
        # in order leads to the same state.
        graphs = [g.value for g in store.named_graphs() if isinstance(g, NamedNode)]
        self._connection.sendall(message(b"L", json.dumps(graphs).encode()))
        sink: Any = DumpSink(self._connection)
        embedded_store(store, "a reader").raw.dump(sink, RdfFormat.N_QUADS)
        sink.flush()
        self._connection.sendall(message(b"D"))

    def _send_batch(self, batch: list[CommitFrame | ReaderProcess]) -> None:
        waiting: list[bytes] = []
        for item in batch:
            if isinstance(item, CommitFrame):
                waiting.append(item.encode())
                continue
            if waiting:
                self._connection.sendall(b"".join(waiting))
                waiting.clear()
            order = message(b"K", json.dumps(self._orders.pop(item.number)).encode())
            try:
                sent = socket.send_fds(self._connection, [order], list(item.given))
                self._connection.sendall(order[sent:])
            finally:
                _close_all(item.given)
                item.given = ()
        if waiting:
            self._connection.sendall(b"".join(waiting))

    def _receive(self) -> None:
        incoming = Incoming(self._connection)
        with contextlib.suppress(EOFError, OSError):
            while True:
                kind, payload, _ = incoming.next()
                if kind == b"R":
                    self.ready.set()
                elif kind == b"E":
                    self._note_end(**json.loads(payload))
        self._fail()
        self.process.wait()

    def _note_end(self, number: int, code: int) -> None:
        with self._changed:
            reader = self._readers.pop(number, None)
            last = self.retired and not self._readers
        if reader is not None:
            reader.exit_code = code
            reader.ended.set()
        if last:
            self.close()

    def _fail(self) -> None:
        """Mark the keeper as failed."""
        with self._changed:
            self.failed = True
            unsent = [item for item in self._outbox if isinstance(item, ReaderProcess)]
            for reader in self._readers.values():
                reader.ended.set()
            self._outbox.clear()
            self._changed.notify_all()
        for reader in unsent:
            _close_all(reader.given)
            reader.given = ()
        self.ready.set()

    def retire(self) -> None:
        """End after the running queries, whose readers are children of the keeper."""
        self.retired = True
        if not self.readers:
            self.close()

    def close(self) -> None:
        """End the keeper together with its readers, and wait until the process has exited."""
        import subprocess

        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._fail()
        try:
            self.process.wait(timeout=_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        own = threading.current_thread()
        for thread in (self._sender, self._receiver):
            if thread is not own and thread.ident is not None:
                thread.join(timeout=_END_S)
        self._connection.close()


def _start(connection: socket.socket) -> subprocess.Popen[bytes]:
    import subprocess

    here = Path(reader_main.__file__).parents[3]  # of the package rtask
    places = "\n".join(map(str, (here, Path(ox.__file__).parent.parent)))
    script = str(Path(reader_main.__file__))
    descriptor = connection.fileno()
    return subprocess.Popen(
        [sys.executable, "-I", "-c", _START, str(descriptor), script, places],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        pass_fds=[descriptor],
    )


def _close_all(descriptors: tuple[int, ...]) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def wait_for(descriptor: int, event: int, timeout_s: float | None = None) -> bool:
    """Wait until a descriptor is readable or writable; tell whether it is, or its end has come."""
    poll = select.poll()  # unlike `select.select` it takes descriptors above 1023
    poll.register(descriptor, event)
    return bool(poll.poll(None if timeout_s is None else max(0.0, 1e3 * timeout_s)))
