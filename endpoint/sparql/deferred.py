"""What is left to do for a request that was understood."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from endpoint.http.messages import Response
from endpoint.sparql.running_queries import RunningQuery


@dataclass(frozen=True)
class Plan:
    """A request that was understood: what is left is the work on the store.

    Parameters
    ----------
    run
        Does the work; may raise any error of :mod:`rtask.errors`.
    timeout_s
        How long it may take; none where it must not be given up half-way.
    lane
        ``loop`` takes no time, ``point`` is a query that looks quick, ``query`` any other,
        ``work`` is everything else.
    form, text
        Of SPARQL requests, for the log.
    running
        What is listed, and can be stopped, while it runs.
    again
        Does the work in the lane ``query`` if it turns out not to be quick.
    """

    run: Callable[[], Response]
    timeout_s: float | None = None
    lane: str = "work"
    form: str = ""
    text: str = ""
    running: RunningQuery | None = None
    again: Callable[[], Response] | None = None

    @staticmethod
    def ready(response: Response) -> Plan:
        """Return a plan without work."""
        return Plan(lambda: response, lane="loop")
