"""The tasks of a graph, as users plan them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rtask.tasks.bounds import TIMEOUT_S, Bounds
from rtask.tasks.plan import TaskPlan
from rtask.tasks.planner import plan_goal
from rtask.tasks.storing import Order, store_plan

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore
    from rtask.tasks.diagnosis import Diagnosis

__all__ = ["Tasks"]


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
        timeout_s: float = TIMEOUT_S,
        access: Access | None = None,
    ) -> TaskPlan:
        """Return a plan for a goal, or the reasons why there is none; nothing is stored.

        Parameters
        ----------
        goal
            Words such as ``every cup into the left box``, ``PATTERN WHERE { SPARQL }``, or an
            object with ``achieve``, ``where`` and ``number``.
        assume_reach
            Plan as if robots reached places of which that is not known, and say so.
        max_states, timeout_s
            Bounds of the search, and of all of it, s.
        access
            Rights of the caller, who sees what it may read; None = those of the owner.

        Raises
        ------
        UsageError, UnknownTermError
            The goal is not understood; the message says what was, and the nearest names.
        SearchLimit
            A bound was reached: whether there is a plan is not known.
        """
        bounds = Bounds(self._kb, timeout_s, access.reads if access is not None else None)
        return plan_goal(
            bounds.select, self._kb.catalogue.is_ontology, goal, base=self._kb.base,
            assume_reach=assume_reach, max_states=max_states, require_time=bounds.require_time,
        )  # fmt: skip

    def why(
        self, subject: str, *, timeout_s: float = TIMEOUT_S, access: Access | None = None
    ) -> Diagnosis:
        """Return why an attempt, a task, a step or a plan failed, and what would have mended it.

        Parameters
        ----------
        subject
            Its IRI.
        timeout_s
            Time for all queries, s.
        access
            Rights of the caller, who sees what it may read; None = those of the owner.

        Raises
        ------
        UnknownTermError
            Nothing under this IRI was attempted or ended.
        SearchLimit
            The time is up.
        """
        from rtask.tasks.diagnosis import diagnose
        from rtask.tasks.diagnosis.reading import read_failure

        bounds = Bounds(self._kb, timeout_s, access.reads if access is not None else None)
        return diagnose(read_failure(bounds.select, subject))

    def store(self, plan: TaskPlan, agent: str | None = None, order: Order | None = None) -> str:
        """Store a plan as a tree of tasks in one commit; return its IRI.

        Parameters
        ----------
        agent
            In whose name; None for the owner of the store.
        order
            How urgent it is.

        Raises
        ------
        UsageError
            There is no plan, or it has no step.
        """
        return store_plan(self._kb, plan, agent, order=order)[0]
