"""Console output of demos and fleets: progress on standard error, results on standard output.

Standard output carries results only, so that ``rtask demo --json | jq`` works.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import IO, Any

from rich.console import Console as RichConsole
from rich.table import Table

from rtask.engine.words import reason_words
from simulate.demo.queries import Answer, with_prefixes
from simulate.demo.report_attempts import GRASP_WORDS

__all__ = ["Console", "FleetConsole", "event_sentence"]

_WIDE = 150
_MAX_UNWRAPPED = 16


class Console:
    """Progress to standard error, results to standard output.

    Parameters
    ----------
    results
        If false, no results are printed; the caller prints its own.
    """

    def __init__(self, results: bool = True) -> None:
        self._progress = RichConsole(stderr=True, highlight=False)
        width = None if sys.stdout.isatty() else 160
        self._results = RichConsole(highlight=False, width=width, quiet=not results)
        self._terminal = self._progress.is_terminal

    def step(self, text: str) -> None:
        """Print the step that begins."""
        self._progress.print(f"[bold]{text}[/bold]" if self._terminal else text, soft_wrap=True)

    def event(self, robot: str, event: dict[str, Any]) -> None:
        """Print what a robot did."""
        line = event_sentence(event)
        if line:
            # What the same robot does without the graph stands between, and steps back.
            style = "dim" if self._terminal and robot.endswith("-alone") else None
            self._progress.print(f"  {robot}: {line}", markup=False, soft_wrap=True, style=style)

    def table(
        self,
        title: str,
        columns: Sequence[str],
        rows: Sequence[Sequence[str]],
        narrow: Sequence[str] | None = None,
    ) -> None:
        """Print a table of results.

        Parameters
        ----------
        narrow
            The columns that are shown on a terminal too narrow for all; None = all.
        """
        shown = list(range(len(columns)))
        if narrow is not None and self._results.width < _WIDE:
            shown = [at for at in shown if columns[at] in narrow]
        table = Table(title=title, title_justify="left")
        for at in shown:
            cells = [columns[at], *(row[at] for row in rows)]
            table.add_column(columns[at], no_wrap=max(map(len, cells)) <= _MAX_UNWRAPPED)
        for row in rows:
            table.add_row(*(row[at] for at in shown))
        self._results.print(table)

    def answer(self, answer: Answer) -> None:
        """Print a question, its SPARQL and the live answer."""
        self._results.print(f"\n[bold]{answer.question.words}[/bold]")
        self._results.print(
            with_prefixes(answer.question.sparql).rstrip(), style="dim", soft_wrap=True
        )
        if answer.rows:
            self.table("", answer.columns, answer.rows)
        else:
            self.line("No rows: the graph has nothing of that.")

    def line(self, text: str = "") -> None:
        """Print a line of results."""
        self._results.print(text, markup=False, soft_wrap=True)


def event_sentence(event: dict[str, Any]) -> str:
    """Return an event in words; empty if it is not reported."""
    name = event["event"]
    if name == "recognised":
        return _recognised_sentence(event)
    if name == "attempt":
        grasp = GRASP_WORDS.get(event["source"], f"grasp from {event['source']}")
        return f"{event['title']}, attempt {event['number']}, {grasp}: {_outcome_words(event)}"
    if name == "push":
        if event["reason"] != "ok":
            return f"could not push {event['title']}, {reason_words(event['reason'])}"
        return f"pushes {event['title']}, which it cannot grasp as it lies"
    if name == "missing":
        x, y = event["last_seen"]
        return f"{event['title']} is gone; it was last seen at {x:.2f}, {y:.2f} m"
    if name == "found":
        return f"{event['title']} is {event['where']}"
    if name == "waiting":
        return "no answer yet; asking again"
    return ""


def _recognised_sentence(event: dict[str, Any]) -> str:
    title, label = event["title"], event["label"] or event["recognised"]
    if not event["recognised"]:
        return f"meets {title}, which its graph does not know"
    known = "recognises" if label == title else "takes"
    other = "" if label == title else f" for {label}"
    return f"{known} {title}{other} ({100 * event['confidence']:.0f} % sure)"


def _outcome_words(event: dict[str, Any]) -> str:
    if not event["physical"]:
        return f"not tried, {reason_words(event['reason'])}"
    if not event["held"]:
        return f"failed, {reason_words(event['reason'])}"
    if event["placed"]:
        return "held and put into its box"
    return f"held, but {reason_words(event['place_reason']) or 'it did not reach its box'}"


class FleetConsole:
    """Prints what the robots of a fleet do; called with a name and an event.

    Parameters
    ----------
    stream
        None = standard error.
    """

    def __init__(self, stream: IO[str] | None = None) -> None:
        self._stream = stream or sys.stderr

    def __call__(self, robot: str, event: dict[str, Any]) -> None:
        """Print an event that is worth a line."""
        sentence = _fleet_sentence(event)
        if sentence:
            self.say(f"  {robot}: {sentence}")

    def say(self, text: str) -> None:
        """Write one line."""
        self._stream.write(text + "\n")
        self._stream.flush()


def _fleet_sentence(event: dict[str, Any]) -> str:
    name = event["event"]
    if name == "table":
        tried = event["encounters"]
        held = sum(bool(encounter["held"]) for encounter in tried)
        return (
            f"table {event['table'] + 1}: held {held} of {len(tried)} in {event['seconds']:.0f} s"
        )
    if name == "waiting":
        return f"no answer to {event['for']}; {event['outbox']} kept"
    if name == "lost":
        return str(event["why"])
    if name == "restart":
        return f"stopped ({event['why']}) and is restarted"
    if name == "done" and event.get("undelivered"):
        return f"{event['undelivered']} outcomes wait in the outbox"
    return ""
