"""A forked copy of this process that answers questions until it is ended."""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import pickle
import select
import signal
import struct
import sys
import threading
import time
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

__all__ = ["CAN_FORK", "EndedError", "LateError", "StoppedError", "TrialProcess"]

CAN_FORK = sys.platform == "linux"
"""Elsewhere a fork of a process with threads is not safe, and all is derived under the lock."""

_LOOK_S = 0.02
_ALONE_S = 1.0
_NICE = 5
_LENGTH = struct.Struct("<Q")

Receive = Callable[[], Any]
Send = Callable[[Any], None]


class EndedError(Exception):
    """The other process is gone."""


class LateError(Exception):
    """There was no answer in time."""


class StoppedError(Exception):
    """The caller was asked to stop waiting."""


class TrialProcess:
    """A copy of this process, at work.

    Parameters
    ----------
    work
        Called in the copy with two functions that receive from and send to this process. The copy
        has no store and no log, and ends when the function returns.
    stop
        Set to end all waiting.
    """

    def __init__(self, work: Callable[[Receive, Send], None], stop: threading.Event) -> None:
        self._stop = stop
        self._answers, answers = os.pipe()
        questions, self._questions = os.pipe()
        server = os.getpid()
        with warnings.catch_warnings():
            # Python 3.12 warns that other threads may hold locks. The copy takes none of theirs:
            # it reads the closure, which is at rest, and uses neither the store nor the log.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._pid = os.fork()
        if self._pid == 0:
            _run(work, questions, answers, server)
        os.close(answers)
        os.close(questions)
        os.set_blocking(self._questions, False)

    def ask(self, question: Any, until: float | None) -> Any:
        """Send a question and return the answer; see :meth:`receive`."""
        self._send(_framed(question), until)
        return self.receive(until)

    def receive(self, until: float | None) -> Any:
        """Return what the copy sends next.

        Parameters
        ----------
        until
            By ``time.monotonic``, in s; ``None`` without a bound.

        Raises
        ------
        EndedError, LateError, StoppedError
            There is no answer.
        """
        (size,) = _LENGTH.unpack(self._read(_LENGTH.size, until))
        return pickle.loads(self._read(size, until))

    def end(self) -> None:
        """End the copy."""
        os.close(self._questions)
        os.close(self._answers)
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self._pid, 0)

    def _read(self, size: int, until: float | None) -> bytearray:
        data = bytearray()
        while len(data) < size:
            self._wait(self._answers, select.POLLIN | select.POLLHUP, until)
            piece = os.read(self._answers, min(1 << 16, size - len(data)))
            if not piece:
                raise EndedError
            data += piece
        return data

    def _send(self, data: bytes, until: float | None) -> None:
        rest = memoryview(data)
        while rest:
            self._wait(self._questions, select.POLLOUT, until)
            try:
                rest = rest[os.write(self._questions, rest) :]
            except BlockingIOError:
                continue
            except BrokenPipeError as error:
                raise EndedError from error

    def _wait(self, handle: int, events: int, until: float | None) -> None:
        poll = select.poll()
        poll.register(handle, events)
        while not poll.poll(_LOOK_S * 1e3):
            if self._stop.is_set():
                raise StoppedError
            if until is not None and time.monotonic() > until:
                raise LateError


def _framed(message: Any) -> bytes:
    data = pickle.dumps(message)
    return _LENGTH.pack(len(data)) + data


def _run(
    work: Callable[[Receive, Send], None], questions: int, answers: int, server: int
) -> NoReturn:
    """Do the work of a copy and end without any clean-up."""

    def read(size: int) -> bytes:
        data = b""
        poll = select.poll()
        poll.register(questions, select.POLLIN | select.POLLHUP)
        while len(data) < size:
            while not poll.poll(_ALONE_S * 1e3):
                # Another copy may hold the other end of the pipe open.
                if os.getppid() != server:
                    os._exit(0)
            piece = os.read(questions, size - len(data))
            if not piece:
                os._exit(0)
            data += piece
        return data

    def receive() -> Any:
        (size,) = _LENGTH.unpack(read(_LENGTH.size))
        return pickle.loads(read(size))

    def send(message: Any) -> None:
        rest = memoryview(_framed(message))
        while rest:
            rest = rest[os.write(answers, rest) :]

    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        # Connections and locks of files belong to the parent, which may end before.
        first, second = sorted((questions, answers))
        os.closerange(3, first)
        os.closerange(first + 1, second)
        os.closerange(second + 1, os.sysconf("SC_OPEN_MAX"))
        logging.disable()
        gc.disable()
        os.nice(_NICE)
        work(receive, send)
    finally:
        os._exit(0)
