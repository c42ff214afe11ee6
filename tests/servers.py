"""Servers for tests and benchmarks, in a process of their own or in this one."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.context import ServerContext
from endpoint.rosbridge.services import Engine
from endpoint.settings import Config
from rtask.knowledge_base import KnowledgeBase
from tests.commands import CommandProcess, start_command

RTASK = (sys.executable, "-m", "rtask")
READY_S = 90.0
STOP_S = 60.0


class ServerDidNotStartError(RuntimeError):
    """The server process ended or printed no address in time; the message holds its output."""


@dataclass(frozen=True)
class RunningServer:
    """A server that is up and answering.

    Parameters
    ----------
    url
        ``http://127.0.0.1:<port>``.
    process
        The server process.
    data
        Its data folder; none if it keeps everything in memory.
    """

    url: str
    process: CommandProcess
    data: Path | None

    @property
    def port(self) -> int:
        """The port on which it listens."""
        return int(self.url.rpartition(":")[2])

    @property
    def websocket(self) -> str:
        """The address to which robots connect."""
        return self.url.replace("http", "ws", 1) + "/"

    def stop(self, number: int = signal.SIGTERM) -> int:
        """Send it a signal and return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(STOP_S)


@contextlib.contextmanager
def running_server(
    data: Path | None,
    *options: str,
    command: Sequence[str] = RTASK,
    environment: Mapping[str, str] = os.environ,
) -> Iterator[RunningServer]:
    """Run ``rtask serve`` on a free port for the duration of the block.

    Parameters
    ----------
    data
        Folder of the knowledge base; none to keep everything in memory.
    *options
        Further options of the command.
    command
        How ``rtask`` is run; by default in a fork of a process that has imported it already.
    environment
        Of the process.

    Raises
    ------
    ServerDidNotStartError
        It ended or stayed silent; the message holds its output.
    """
    where = ["--data", str(data)] if data else ["--temp"]
    arguments = ["serve", *where, "-p", "0", *options]
    process: CommandProcess
    if command == RTASK:
        process = start_command(*arguments, environment=environment)
    else:
        process = subprocess.Popen(
            [*command, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**environment, "PYTHONUNBUFFERED": "1"},
        )
    assert process.stdout is not None
    assert process.stderr is not None
    errors: list[str] = []
    drain = threading.Thread(target=errors.extend, args=(process.stderr,), daemon=True)
    drain.start()
    try:
        yield RunningServer(_ready_url(process.stdout, drain, errors), process, data)
    finally:
        if process.poll() is None:
            process.terminate()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        drain.join(5)
        process.stdout.close()
        process.stderr.close()


def _ready_url(output: IO[str], drain: threading.Thread, errors: list[str]) -> str:
    """Wait for the line that names the address and return it."""
    lines: queue.Queue[str] = queue.Queue()

    def read() -> None:
        with contextlib.suppress(ValueError):  # closed at the end
            for line in output:
                lines.put(line)
        lines.put("")

    threading.Thread(target=read, daemon=True).start()
    try:
        line = lines.get(timeout=READY_S)
        if not line:  # it has ended, so what it said of that ends as well
            drain.join(READY_S)
    except queue.Empty:
        line = ""
    if not line.startswith("ready "):
        said = "".join(errors)[-2000:]
        raise ServerDidNotStartError(f"{line.strip() or 'no ready line'}; {said}")
    return line.split()[1]


def bearer(token: str) -> dict[str, str]:
    """Return the header field that sends a token."""
    return {"Authorization": f"Bearer {token}"}


def new_application(
    kb: KnowledgeBase, engine: Engine, tokens: TokenStore, config: Config, **options: Any
) -> Application:
    """Make an application in this process; options as :meth:`ServerContext.create` takes them."""
    return Application(ServerContext.create(kb, engine, tokens, config, **options))
