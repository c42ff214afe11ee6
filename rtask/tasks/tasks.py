"""The tasks of a graph, as users plan them."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rtask.kb.commit.access import Access
from rtask.tasks.bounds import TIMEOUT_S, Bounds
from rtask.tasks.examples import example_goals
from rtask.tasks.plan import TaskPlan
from rtask.tasks.planner import plan_goal
from rtask.tasks.queue.asking import answer, is_pending
from rtask.tasks.queue.reading import read_queue
from rtask.tasks.storing import Order, store_plan

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.tasks.diagnosis import Diagnosis
    from rtask.tasks.questions.question import Question

__all__ = ["Tasks"]


class Tasks:
    """Tasks of a knowledge base.

    Examples
    --------
    >>> import rtask
    >>> with rtask.open(":memory:") as kb:
    ...     kb.tasks.plan("every cup")
    Traceback (most recent call last):
    rtask.errors.UsageError: 'every cup' does not say where to, or not clearly; understood: \
'cup' (kind); a goal is such as 'every cup into the left box'
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

    def examples(self, access: Access | None = None) -> list[str]:
        """Return goals in words about what stands where now; none if nothing has two places."""
        bounds = Bounds(self._kb, TIMEOUT_S, access.reads if access is not None else None)
        return example_goals(bounds.select, self._kb.base)

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

    def questions(self, *, everything: bool = False) -> list[Question]:
        """Return what robots ask people, in the order of asking.

        Parameters
        ----------
        everything
            Also those that nobody waits for any more.
        """
        now = dt.datetime.now(dt.UTC)
        asked = [
            (plan, step, question)
            for plan in read_queue(self._kb) for step in plan.steps for question in step.questions
        ]  # fmt: skip
        chosen = [
            question for plan, step, question in asked
            if everything or question.state(now, is_pending(plan, step, now)) == "open"
        ]  # fmt: skip
        return sorted(chosen, key=lambda question: question.asked)

    def answer(self, question: str, choice: int, agent: str = "operator", remark: str = "") -> None:
        """Answer a question, so that the robot takes up its step again.

        Parameters
        ----------
        question
            Its IRI.
        choice
            Number of the choice, from 1.
        agent
            Name of the person.
        remark
            What the person says besides.

        Raises
        ------
        UnknownTermError
            No robot asked that.
        UsageError
            It has no such choice.
        ConflictError
            Somebody answered before, the robot went on without, or the plan has ended.
        """
        person = self._kb.graphs.agent_iri(agent, "teacher").value
        answer(self._kb, question, choice, person, access=Access(agent, "teacher"), remark=remark)
