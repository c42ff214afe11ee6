"""The tasks of a graph, as users plan them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode
from rtask.sparql.results import Solutions
from rtask.tasks.actions import Select
from rtask.tasks.plan import TaskPlan
from rtask.tasks.planner import plan_goal
from rtask.tasks.storing import store_plan

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Selectable", "Tasks", "plan_on"]

TIMEOUT_S = 10.0
"""Time limit of each query."""


class Selectable(Protocol):
    """A graph, embedded or on a server."""

    def select(self, text: str, **options: Any) -> Solutions:
        """Evaluate a SELECT."""


class Tasks:
    """Tasks of a knowledge base.

    Examples
    --------
    >>> import rtask
    >>> with rtask.open(":memory:") as kb:
    ...     kb.tasks.plan("every cup")
    Traceback (most recent call last):
    rtask.errors.UsageError: 'every cup' does not say where to; understood: 'cup' (kind); \
a goal is such as 'every cup into the left box'
    """

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb

    def plan(
        self,
        goal: str | Mapping[str, Any],
        *,
        assume_reach: bool = False,
        max_states: int = 200_000,
        select: Select | None = None,
    ) -> TaskPlan:
        """Return a plan for a goal, or the reasons why there is none; nothing is stored.

        Parameters
        ----------
        goal
            Words such as ``every cup into the left box``, ``PATTERN WHERE { SPARQL }``, or an
            object with ``achieve``, ``where`` and ``number``.
        assume_reach
            Plan as if robots reached places of which that is not known, and say so.
        max_states
            Bound of the search.
        select
            Evaluates the queries, with the rights and within the bounds of whoever asks; by
            default the graph itself, for at most :data:`TIMEOUT_S` each.

        Raises
        ------
        UsageError, UnknownTermError
            The goal is not understood; the message says what was, and the nearest names.
        SearchLimit
            The search was ended by its bound: whether there is a plan is not known.
        """
        run = select or _within_bounds(self._kb)
        return plan_goal(
            run, self._kb.catalogue.is_ontology, goal,
            base=self._kb.base, assume_reach=assume_reach, max_states=max_states,
        )  # fmt: skip

    def store(self, plan: TaskPlan, agent: str | None = None) -> str:
        """Store a plan as a tree of tasks in one commit; return its IRI.

        Raises
        ------
        UsageError
            There is no plan, or it has no step.
        """
        return store_plan(self._kb, plan, agent)


def plan_on(
    graph: Selectable, base: str, goal: str | Mapping[str, Any], *, assume_reach: bool = False
) -> TaskPlan:
    """Return a plan from what a graph knows, embedded or on a server; see :meth:`Tasks.plan`.

    Parameters
    ----------
    base
        What its own IRIs begin with.
    """
    run = _within_bounds(graph)
    rows = run(
        f"{PREFIXES}SELECT ?graph WHERE {{ GRAPH <{base}graph/meta> "
        "{ ?graph a rt:OntologyGraph } }"
    )
    ontologies = frozenset(str(row.value("graph")) for row in rows)

    def is_ontology(name: NamedNode) -> bool:
        return name.value in ontologies

    return plan_goal(run, is_ontology, goal, base=base, assume_reach=assume_reach)


def _within_bounds(graph: Selectable) -> Select:
    def run(query: str) -> Solutions:
        return graph.select(query, timeout_s=TIMEOUT_S)

    return run
