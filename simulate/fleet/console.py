"""How a fleet speaks while it works: one line an event worth telling, on standard error."""

from __future__ import annotations

import sys
from typing import IO, Any

__all__ = ["FleetConsole"]


class FleetConsole:
    """Tells what robots do; call it with a name and an event.

    Parameters
    ----------
    stream
        None = standard error.
    """

    def __init__(self, stream: IO[str] | None = None) -> None:
        self._stream = stream or sys.stderr

    def __call__(self, robot: str, event: dict[str, Any]) -> None:
        """Say what happened, where that is worth a line."""
        said = _sentence(event)
        if said:
            self.say(f"  {robot}: {said}")

    def say(self, text: str) -> None:
        """Write one line."""
        self._stream.write(text + "\n")
        self._stream.flush()


def _sentence(event: dict[str, Any]) -> str:
    name = event["event"]
    if name == "table":
        met = event["encounters"]
        held = sum(bool(one["held"]) for one in met)
        return f"table {event['table'] + 1}: held {held} of {len(met)} in {event['seconds']:.0f} s"
    if name == "waiting":
        return f"nobody answers {event['for']}; {event['outbox']} kept"
    if name == "lost":
        return str(event["why"])
    if name == "restart":
        return f"went away ({event['why']}) and is started again"
    if name == "done" and event.get("undelivered"):
        return f"{event['undelivered']} outcomes wait in the outbox"
    return ""
