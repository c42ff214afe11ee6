"""Questions and answers as commits: a robot asks about a step that it has claimed, people answer.

With its question a robot gives the step back, so that it can do others meanwhile. Nobody gets that
step until it is answered or nobody answered in time; its preconditions are then asked anew.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rtask.errors import ConflictError, UnknownTermError, UsageError
from rtask.rdf.namespaces import PROV, RDF, RDFS, RT, mint
from rtask.rdf.terms import NamedNode, Value, iri
from rtask.tasks.questions.price import Help, Worth, weigh
from rtask.tasks.questions.question import Choice, Question
from rtask.tasks.queue.claiming import live_claim
from rtask.tasks.queue.reading import QueuedPlan, QueuedStep, read_queue

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["MAX_CHOICES", "MAX_PATIENCE_S", "PATIENCE_S", "Asked", "Inquiry", "answer", "ask",
           "is_pending", "past_help"]  # fmt: skip

PATIENCE_S = 600.0
"""How long a robot waits for an answer, unless it says otherwise."""
MAX_PATIENCE_S = 86_400.0
MAX_CHOICES = 20
Statements = list[tuple[NamedNode, NamedNode, Value]]


@dataclass(frozen=True)
class Inquiry:
    """What a robot would ask.

    Parameters
    ----------
    kind
        A code of its own; it asks once about a step in each.
    text
        The question.
    choices
        At least two.
    otherwise
        Number of the choice that it makes where nobody answers, from 1.
    chance
        That the step succeeds if nobody is asked, in [0, 1]; None = as planned.
    retries
        How often the step is tried again where it fails.
    patience_s
        How long it waits.
    """

    kind: str
    text: str
    choices: Sequence[Choice]
    otherwise: int = 1
    chance: float | None = None
    retries: int = 0
    patience_s: float = PATIENCE_S

    def __post_init__(self) -> None:
        if not 2 <= len(self.choices) <= MAX_CHOICES:
            raise UsageError(f"a question has 2 to {MAX_CHOICES} choices, not {len(self.choices)}")
        if not 1 <= self.otherwise <= len(self.choices):
            raise UsageError(f"otherwise: 1 to {len(self.choices)}, not {self.otherwise}")
        if not 0 < self.patience_s <= MAX_PATIENCE_S:
            raise UsageError(f"patience is more than 0 and at most {MAX_PATIENCE_S:g} s")


@dataclass(frozen=True)
class Asked:
    """Whether a question was asked.

    Parameters
    ----------
    question
        IRI; empty if asking was not worth it.
    worth
        Why.
    commit
        None if nothing was asked.
    """

    question: str
    worth: Worth
    commit: Commit | None


def past_help(plans: Sequence[QueuedPlan], now: dt.datetime) -> Help:
    """Return how often questions helped so far; those withdrawn before do not count."""
    ended = [
        question
        for plan in plans for step in plan.steps for question in step.questions
        if question.state(now) in ("answered", "expired")
    ]  # fmt: skip
    return Help(sum(question.helped for question in ended), len(ended))


def ask(
    kb: GraphCore, robot: str, task: str, inquiry: Inquiry, access: Access, *,
    picture: Callable[[NamedNode], Statements] = lambda question: [],
    now: dt.datetime | None = None,
) -> Asked:  # fmt: skip
    """Ask people about a step that a robot has claimed, if that is worth its price.

    A plan without prices is carried out without questions.

    Parameters
    ----------
    picture
        Returns what to state about what the robot sees, for the IRI of the question; called only
        if it is asked.

    Raises
    ------
    ConflictError
        The robot has no claim on the step, or has asked this before.
    """
    time = now or dt.datetime.now(dt.UTC)
    with kb.transaction(access=access, note="ask a person") as tx:
        plans = read_queue(kb)
        plan, step, claim = live_claim(plans, robot, task, time)
        # Asked twice, people stop answering.
        if any(question.kind == inquiry.kind for question in step.questions):
            raise ConflictError(f"{inquiry.kind} was asked about {task} before")
        # Without a price nobody could say whether a question is worth it.
        if plan.prices is None:
            return Asked("", Worth(False, 0.0, "the plan has no prices, so nobody is asked"), None)
        chance = step.chance if inquiry.chance is None else inquiry.chance
        worth = weigh(plan.prices, chance, past_help(plans, time), inquiry.retries)
        if not worth.asks:
            return Asked("", worth, None)
        question = NamedNode(mint(kb.base, "Question"))
        for statement in _question(question, robot, task, inquiry, worth.text, time):
            tx.add(*statement)
        for statement in picture(question):
            tx.add(*statement)
        # A claim must not end before it began, whatever the clock did.
        tx.add(claim.iri, PROV.endedAtTime, max(time, claim.begun))
        tx.add(claim.iri, RT.claimResult, "released")
        tx.add(claim.iri, RT.claimComment, f"a person is asked: {inquiry.text}"[:1000])
    return Asked(question.value, worth, tx.commit)


def _question(
    question: NamedNode, robot: str, task: str, inquiry: Inquiry, reason: str, now: dt.datetime
) -> Statements:
    stated: Statements = [
        (question, RDF.type, RT.Question), (question, RT.asksAbout, iri(task)),
        (question, PROV.wasAttributedTo, NamedNode(robot)),
        (question, RT.questionKind, inquiry.kind), (question, RT.questionText, inquiry.text),
        (question, RT.questionReason, reason), (question, PROV.generatedAtTime, now),
        (question, RT.answerableUntil, now + dt.timedelta(seconds=inquiry.patience_s)),
    ]  # fmt: skip
    for number, choice in enumerate(inquiry.choices, 1):
        node = _choice(question.value, number)
        stated += [
            (question, RT.hasAnswerChoice, node), (node, RDF.type, RT.AnswerChoice),
            (node, RT.answerNumber, number), (node, RT.answerCode, choice.code),
            (node, RDFS.label, choice.text), (node, RT.answerHelps, choice.helps),
        ]  # fmt: skip
        if choice.place:
            stated.append((node, RT.answerPlace, iri(choice.place)))
        if number == inquiry.otherwise:
            # Stored with the question, so that what happens without an answer is known before.
            stated.append((question, RT.choiceOtherwise, node))
    return stated


def _choice(question: str, number: int) -> NamedNode:
    return NamedNode(f"{question}/choice/{number}")


def answer(
    kb: GraphCore, question: str, choice: int, person: str, access: Access | None = None, *,
    remark: str = "", now: dt.datetime | None = None,
) -> Commit | None:  # fmt: skip
    """Answer a question; None if the same person gave the same answer before.

    Parameters
    ----------
    choice
        Its number, from 1.
    person
        IRI.
    access
        Rights of the person; None for the owner of the store.

    Raises
    ------
    UnknownTermError
        There is no such question.
    UsageError
        It has no such choice.
    ConflictError
        Somebody answered it before, its robot went on without an answer, or its plan has ended.
    """
    time = now or dt.datetime.now(dt.UTC)
    with kb.transaction(note="answer a robot", access=access) as tx:
        asked, is_pending = _asked(read_queue(kb), question, time)
        if not 1 <= choice <= len(asked.choices):
            raise UsageError(f"choice: 1 to {len(asked.choices)}, not {choice}", field="choice")
        # A page that is sent twice is no second answer.
        if asked.answer is not None:
            if asked.answer.choice == choice and asked.answer.person == person:
                return None
            raise ConflictError(f"{asked.answer.by} answered before: {asked.outcome.text}")
        state = asked.state(time, is_pending)
        if state == "expired":
            raise ConflictError(f"nobody answered in time: the robot does {asked.outcome.text!r}")
        if state == "withdrawn":
            raise ConflictError("its plan has ended, so that nobody waits for the answer")
        node = NamedNode(mint(kb.base, "HumanAnswer"))
        tx.add(node, RDF.type, RT.HumanAnswer)
        tx.add(node, RT.answersQuestion, iri(question))
        tx.add(node, RT.chosenAnswer, _choice(question, choice))
        tx.add(node, PROV.wasAttributedTo, NamedNode(person))
        tx.add(node, PROV.generatedAtTime, time)
        if remark:
            tx.add(node, RT.answerRemark, remark)
    return tx.commit


def _asked(plans: Sequence[QueuedPlan], question: str, now: dt.datetime) -> tuple[Question, bool]:
    """Return a question, and whether its step may still be carried out."""
    for plan in plans:
        for step in plan.steps:
            for asked in step.questions:
                if asked.iri == question:
                    return asked, is_pending(plan, step, now)
    raise UnknownTermError(f"no robot asked {question}")


def is_pending(plan: QueuedPlan, step: QueuedStep, now: dt.datetime) -> bool:
    """Whether a step may still be carried out, so that answers about it are of use."""
    return plan.state(now) in ("waiting", "running") and not step.is_done
