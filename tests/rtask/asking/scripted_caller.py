"""A caller without a language model, which reads the texts of the tools and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rtask.asking.tools.toolbox import Toolbox
from rtask.kb.commit.access import Access

__all__ = ["ScriptedCaller", "Waiting"]


class Waiting:
    """A call that nobody stops."""

    is_stopped = False

    def on_stop(self, stop: Callable[[], None]) -> None:
        """Nobody stops it."""

    def report(self, share: float, words: str) -> None:
        """Nobody asked."""


class ScriptedCaller:
    """A caller that knows the texts of the tools, and nothing of what is behind them."""

    def __init__(self, toolbox: Toolbox, access: Access) -> None:
        self._toolbox, self._access = toolbox, access
        (self._tool,) = (
            tool
            for tool in toolbox.listed(access)
            if "question in words" in tool["description"]
            and "rows" in tool["outputSchema"]["properties"]
        )

    def answer(self, question: str) -> tuple[list[tuple[str, ...]], int]:
        """Return the rows that answer a question, and how many calls that took."""
        (member,) = (n for n in self._tool["inputSchema"]["properties"] if n != "offset")
        rows: list[tuple[str, ...]] = []
        calls, arguments = 0, {member: question}
        while True:
            result = self._toolbox.call(
                self._tool["name"], arguments, self._access, "http://lab.example", Waiting()
            )
            assert not result["isError"], result
            page = result["structuredContent"]
            calls += 1
            rows += [tuple(map(_local, row)) for row in page["rows"]]
            if "more" not in page:
                return rows, calls
            arguments = {member: question, "offset": page["more"]["offset"]}


def _local(value: dict[str, Any] | None) -> str:
    if value is None:
        return "-"
    if value["type"] == "iri":
        short: str = value["value"].strip("<>").rstrip("/#")
        return short.replace("#", "/").rpartition("/")[2].rpartition(":")[2]
    plain = value["value"]
    return str(plain).lower() if isinstance(plain, bool) else str(plain)
