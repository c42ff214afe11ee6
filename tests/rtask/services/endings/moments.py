"""Services that write and stop at a moment that a test names, in whatever process they run."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from rtask.services import Service, ServiceHost, data_resource, method

__all__ = ["FarLink", "FarTally", "Gate", "ProcessTally", "RayTally", "Tally"]

LONG_S = 60.0


class Gate:
    """A folder by which a call says that it has come to a moment, and is told to go on.

    Parameters
    ----------
    folder
        Its file ``moment`` names where to stop, ``reached`` says that the call is there, and
        ``open`` lets it go on.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def stop_at(self, moment: str) -> None:
        """Have the next call stop at a moment."""
        for name in ("reached", "open"):
            (self._folder / name).unlink(missing_ok=True)
        (self._folder / "moment").write_text(moment, "utf-8")

    def reach(self, moment: str) -> None:
        """Stop here if this is the moment, once."""
        named = self._folder / "moment"
        if named.exists() and named.read_text("utf-8") == moment:
            named.unlink()
            (self._folder / "reached").touch()
            self._wait_for("open")

    def wait(self) -> None:
        """Wait until a call is at the moment."""
        self._wait_for("reached")

    def open(self) -> None:
        """Let the call go on."""
        (self._folder / "open").touch()

    def _wait_for(self, name: str) -> None:
        until = time.monotonic() + LONG_S
        while not (self._folder / name).exists():
            assert time.monotonic() < until, f"{name}: it never happened"
            time.sleep(0.002)


class Tally(Service):
    """A sum that is kept in a dataset."""

    name = "moments/Tally"
    store = data_resource("binary", writable=True)

    @method(output="total", scope="write", effect="writes")
    def add(self, number: int, gate: str = "") -> int:
        """Add to the sum, stopping at the moments of a gate.

        Parameters
        ----------
        gate
            Its folder; none = do not stop.
        """
        if gate:
            Gate(Path(gate)).reach("in the method")
        there = (self.store.folder / "sum").exists()
        total = number + (int(self.store.read("/sum")) if there else 0)
        self.store.write("/sum", str(total).encode())
        if gate:
            Gate(Path(gate)).reach("after it wrote")
        return total


class ProcessTally(Tally):
    """The same in a process of its own."""

    name = "moments/ProcessTally"
    executor = "processes"


class RayTally(Tally):
    """The same in an actor of a Ray cluster."""

    name = "moments/RayTally"
    executor = "ray"


class FarTally(Tally):
    """The same, offered by a worker that connected."""

    name = "moments/FarTally"
    executor = "outward"


class FarLink:
    """A worker that carries out ``add`` of :class:`FarTally`, without a network.

    Parameters
    ----------
    host
        The host that it works for.
    """

    name = "worker far"

    def __init__(self, host: ServiceHost) -> None:
        self._host = host
        self.threads: list[threading.Thread] = []

    def send(self, message: Mapping[str, Any], args: BaseModel | None) -> None:
        if message["op"] == "call_service":
            given = {} if args is None else dict(args)
            thread = threading.Thread(target=self._answer, args=(message, given), daemon=True)
            self.threads.append(thread)
            thread.start()

    def _answer(self, message: Mapping[str, Any], args: Mapping[str, Any]) -> None:
        gate = Gate(Path(args["gate"])) if args.get("gate") else None
        if gate:
            gate.reach("in the method")
        head = self._host.datasets.find(message["data"]["store"])
        before = self._host.datasets.read(head.name, "sum") if "sum" in head.files else b"0"
        total = int(before) + args["number"]
        if gate:
            gate.reach("after it wrote")
        reply = {"op": "service_response", "id": message["id"], "result": True}
        written = {"store": {"sum": str(total).encode()}}
        self._host.outward.take(self, {**reply, "values": {"total": total}, "written": written})

    def refuse(self, words: str) -> None:
        raise AssertionError(words)
