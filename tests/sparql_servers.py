"""SPARQL servers that others wrote, in processes of their own, to be killed and started again."""

from __future__ import annotations

import contextlib
import shutil
import signal
import socket
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from pathlib import Path

import httpx

_READY_S = 60.0

OXIGRAPH = shutil.which("oxigraph", path=str(Path(sys.executable).parent)) or shutil.which(
    "oxigraph"
)
VIRTUOSO = shutil.which("virtuoso-t")
_ISQL = shutil.which("isql-vt")


def free_port() -> int:
    """Return a port on which nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


class SparqlServer(ABC):
    """A server on a free port with its data in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.port = free_port()
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """Address at which it listens."""
        return f"http://127.0.0.1:{self.port}"

    @property
    @abstractmethod
    def address(self) -> str:
        """Address as :func:`rtask.open` takes it."""

    @abstractmethod
    def _command(self) -> list[str]: ...

    def start(self) -> None:
        """Start it and wait until it answers."""
        self.process = subprocess.Popen(
            self._command(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=self._folder
        )
        end = time.monotonic() + _READY_S
        while True:
            with contextlib.suppress(httpx.TransportError):
                httpx.get(self.url, timeout=5)
                return
            assert self.process.poll() is None, f"{self._command()[0]} has ended"
            assert time.monotonic() < end, f"{self._command()[0]} does not answer"
            time.sleep(0.05)

    def kill(self) -> None:
        """End it at once."""
        if self.process is not None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()
            self.process = None


class Oxigraph(SparqlServer):
    """``oxigraph serve`` on disk; its default graph may show all others."""

    def __init__(self, folder: Path, union: bool = False) -> None:
        super().__init__(folder)
        self._union = union

    @property
    def address(self) -> str:
        """Address as :func:`rtask.open` takes it."""
        return f"sparql+{self.url}/?query=/query&update=/update"

    def _command(self) -> list[str]:
        assert OXIGRAPH is not None
        bind = f"127.0.0.1:{self.port}"
        command = [OXIGRAPH, "serve", "-l", str(self._folder / "data"), "-b", bind]
        return [*command, "--union-default-graph"] if self._union else command


_INI = """
[Database]
DatabaseFile = {folder}/v.db
ErrorLogFile = {folder}/v.log
LockFile = {folder}/v.lck
TransactionFile = {folder}/v.trx
xa_persistent_file = {folder}/v.pxa
[TempDatabase]
DatabaseFile = {folder}/t.db
TransactionFile = {folder}/t.trx
[Parameters]
ServerPort = 127.0.0.1:{sql}
DisableUnixSocket = 1
ServerThreads = 10
CheckpointInterval = 60
NumberOfBuffers = 10000
MaxDirtyBuffers = 6000
CaseMode = 2
[HTTPServer]
ServerPort = 127.0.0.1:{http}
ServerRoot = {folder}
ServerThreads = 6
[SPARQL]
ResultSetMaxRows = 1000000
"""


class Virtuoso(SparqlServer):
    """Debian's Virtuoso, with updates allowed to everybody."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._sql = free_port()
        text = _INI.format(folder=folder, sql=self._sql, http=self.port)
        (folder / "virtuoso.ini").write_text(text, "utf-8")
        self._is_new = True

    @property
    def address(self) -> str:
        """Address as :func:`rtask.open` takes it."""
        return f"{self.url}/sparql"

    def _command(self) -> list[str]:
        assert VIRTUOSO is not None
        return [VIRTUOSO, "+foreground", "+configfile", str(self._folder / "virtuoso.ini")]

    def start(self) -> None:
        """Start it and wait until it answers."""
        for left in self._folder.glob("*.lck"):  # a killed server leaves its lock
            left.unlink()
        super().start()
        if self._is_new:
            assert _ISQL is not None
            grant = 'exec=GRANT SPARQL_UPDATE TO "SPARQL";'
            login = [f"127.0.0.1:{self._sql}", "dba", "dba"]
            subprocess.run([_ISQL, *login, grant], check=True, stdout=subprocess.DEVNULL)
            self._is_new = False
