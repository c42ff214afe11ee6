"""A process that has imported what ``rtask`` needs and forks for each command that is to be run.

Importing takes most of a command's time. Run as a module, this file imports and waits; in a test's
process, :class:`Prewarmed` asks it for processes. Tests call it through ``tests/commands.py``.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NoReturn

_IMPORTED = (
    "endpoint.commands",
    "endpoint.context",
    "endpoint.follow.follower",
    "endpoint.monitoring.log",
    "endpoint.server",
    "endpoint.sparql.remote_store",
    "rtask.cli.people",
    "rtask.engine",
    "rtask.kb.maintenance.replica",
    "rtask.services.offered",
    "simulate.services",
)
_MESSAGE_BYTES = 1 << 20

spent = {"cpu_s": 0.0}
"""What processes that have ended took; they are not children of the process of tests."""


class ForkedProcess:
    """A child of the prewarmed process, with the methods of :class:`subprocess.Popen` in use.

    Parameters
    ----------
    owner
        The prewarmed process.
    pid
        Of the child.
    stdin, stdout, stderr
        What it reads and prints; none for those that are no pipes.
    """

    def __init__(
        self,
        owner: Prewarmed,
        pid: int,
        stdin: IO[str] | None,
        stdout: IO[str] | None,
        stderr: IO[str] | None,
    ) -> None:
        self.pid, self.stdin, self.stdout, self.stderr = pid, stdin, stdout, stderr
        self.returncode: int | None = None
        self._owner = owner
        # The child stays a zombie until it is asked for, so that this cannot be another process.
        self._descriptor = os.pidfd_open(pid)

    def poll(self) -> int | None:
        """Return its exit code, or none while it runs."""
        if self.returncode is None:
            answer = self._owner.ask({"code of": self.pid})
            self.returncode = answer["code"]
            if self.returncode is not None:
                spent["cpu_s"] += answer["cpu_s"]
                os.close(self._descriptor)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return its exit code."""
        if self.returncode is None:
            end = select.poll()
            end.register(self._descriptor, select.POLLIN)
            if not end.poll(None if timeout is None else timeout * 1e3):
                raise subprocess.TimeoutExpired(["rtask"], timeout or 0.0)
        code = self.poll()
        assert code is not None
        return code

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            signal.pidfd_send_signal(self._descriptor, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)


class Prewarmed:
    """The prewarmed process, as seen by a process of tests; it ends when that one does."""

    def __init__(self) -> None:
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.prewarmed", str(other.fileno())],
                pass_fds=[other.fileno()],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )

    @staticmethod
    def is_possible() -> bool:
        """Whether this system has what is needed: descriptors of processes."""
        return hasattr(os, "pidfd_open") and hasattr(signal, "pidfd_send_signal")

    def start(
        self,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        *,
        module: str = "rtask",
        folder: Path | None = None,
        stdin: int = subprocess.DEVNULL,
        stdout: int = subprocess.PIPE,
        stderr: int = subprocess.PIPE,
    ) -> ForkedProcess:
        """Run ``python -m module`` with these arguments in a process of its own.

        Parameters
        ----------
        arguments
            Of the command.
        environment
            Of the process.
        module
            What is run.
        folder
            Where it is run; none for the current folder.
        stdin, stdout, stderr
            As :class:`subprocess.Popen` takes them.
        """
        order = {
            "arguments": list(arguments),
            "environment": dict(environment),
            "module": module,
            "in": str(folder or Path.cwd()),
        }
        with contextlib.ExitStack() as opened:
            child_in, ours_in = _end_of(stdin, opened, is_read=True)
            child_out, ours_out = _end_of(stdout, opened, is_read=False)
            if stderr == subprocess.STDOUT:
                child_err, ours_err = child_out, None
            else:
                child_err, ours_err = _end_of(stderr, opened, is_read=False)
            pid = self.ask(order, [child_in, child_out, child_err])["pid"]
        return ForkedProcess(self, pid, ours_in, ours_out, ours_err)

    def ask(self, order: Mapping[str, Any], descriptors: Sequence[int] = ()) -> dict[str, Any]:
        """Send an order and return the answer to it."""
        socket.send_fds(self._socket, [json.dumps(order).encode()], descriptors)
        answer: dict[str, Any] = json.loads(self._socket.recv(_MESSAGE_BYTES))
        return answer

    def close(self) -> None:
        """End it; processes that it has started and that still run are ended too."""
        self._socket.close()
        self.process.wait()


def _end_of(
    kind: int, opened: contextlib.ExitStack, *, is_read: bool
) -> tuple[int, IO[str] | None]:
    """Return the child's descriptor, which is closed with ``opened``, and our end if it is a pipe.

    Parameters
    ----------
    kind
        A descriptor, or a constant of :mod:`subprocess`.
    opened
        What closes the descriptor.
    is_read
        Whether the child reads from it.
    """
    if kind == subprocess.PIPE:
        read, write = os.pipe()
        child, ours = (read, write) if is_read else (write, read)
        opened.callback(os.close, child)
        return child, os.fdopen(ours, "w" if is_read else "r")
    if kind == subprocess.DEVNULL:
        kind = os.open(os.devnull, os.O_RDWR)
        opened.callback(os.close, kind)
    return kind, None


def _serve(connection: socket.socket) -> dict[str, Any] | None:
    """Fork for each order; return the order in a child, and none here at the end of orders."""
    running: set[int] = set()
    while True:
        data, descriptors, _, _ = socket.recv_fds(connection, _MESSAGE_BYTES, 3)
        if not data:
            break
        order: dict[str, Any] = json.loads(data)
        if "code of" in order:
            pid, status, used = os.wait4(order["code of"], os.WNOHANG)
            running.discard(pid)
            code = os.waitstatus_to_exitcode(status) if pid else None
            answer = {"code": code, "cpu_s": used.ru_utime + used.ru_stime}
        else:
            pid = os.fork()
            if pid == 0:
                connection.close()
                for place, descriptor in enumerate(descriptors):
                    os.dup2(descriptor, place)
                    os.close(descriptor)
                return order
            running.add(pid)
            for descriptor in descriptors:
                os.close(descriptor)
            answer = {"pid": pid}
        connection.sendall(json.dumps(answer).encode())
    for pid in running:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)
    for pid in running:
        os.waitpid(pid, 0)
    return None


def _main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group
    for name in _IMPORTED:
        importlib.import_module(name)
    import click

    from rtask.cli import cli
    from rtask.services.offered import open_host
    from tests.opened import open_by_copying, prepare_original

    prepare_original()  # compiles the rules and reads the ontology
    open_by_copying()
    cli.list_commands(click.Context(cli))  # reads what is installed
    open_host().close()  # makes the messages of all services
    gc.collect()
    gc.freeze()
    order = _serve(socket.socket(fileno=int(sys.argv[1])))
    if order is None:
        return
    import runpy

    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(order["in"])
    os.environ.clear()
    os.environ.update(order["environment"], PYTHONUNBUFFERED="1")
    sys.argv[1:] = order["arguments"]
    command = ["-m", order["module"], *order["arguments"]]
    sys.orig_argv[:] = [sys.executable, *command]  # to start over with
    code = 1
    try:
        runpy.run_module(order["module"], run_name="__main__", alter_sys=True)
        code = 0
    except SystemExit as ended:
        if ended.code is None or isinstance(ended.code, int):
            code = ended.code or 0
        else:
            sys.stderr.write(f"{ended.code}\n")
    except KeyboardInterrupt:
        raise  # the interpreter ends itself by the signal
    except BaseException:  # noqa: BLE001 - as the interpreter does
        traceback.print_exc()
    _end(code)


def _end(code: int) -> NoReturn:
    """End as the interpreter does, but leave its memory to the system.

    Objects that are freed one by one would first be copied, as the parent has them too: that takes
    .1 s of processor time, as much as the command itself.
    """
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            code = code or 120  # as the interpreter says it
    os._exit(code)


if __name__ == "__main__":
    _main()
