"""Questions of robots: whether one is worth its price, the list that waits, and answers."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Ge, Le, MaxLen, MinLen

from rtask.engine.operations.operation import operation
from rtask.engine.operations.tasks.robot_named import robot_named
from rtask.engine.perception.images import check_picture
from rtask.engine.records.identity import check_agent
from rtask.engine.triples import Triples
from rtask.errors import ForbiddenError, UnknownTermError
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.tasks.names import names_of
from rtask.tasks.questions.question import Choice, Question
from rtask.tasks.queue import asking
from rtask.tasks.queue.reading import QueuedPlan, QueuedStep, read_queue
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Image, Iri, Number, Probability, Text, Unit, Whole

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["AnswerQuestion", "answer_question", "ask_person", "list_questions"]

_MAX_CHARS = 1000


class OfferedChoice(Message):
    """One answer to choose from."""

    code: Annotated[Text, MinLen(1), MaxLen(64)]
    """what the robot does with it, in a code of its own"""
    text: Annotated[Text, MinLen(1), MaxLen(200)]
    """for people"""
    place: Iri | None = None
    """IRI of the place that it names; default: none"""
    helps: Flag = False
    """whether the step is expected to succeed with it"""


class AskPerson(Message):
    """What a robot would ask about a step that it has claimed."""

    task: Iri
    """IRI of the step"""
    kind: Annotated[Text, MinLen(1), MaxLen(64)]
    """code of what is asked, such as act or where; a robot asks once about a step in each"""
    text: Annotated[Text, MinLen(1), MaxLen(_MAX_CHARS)]
    """the question"""
    choices: Annotated[list[OfferedChoice], MinLen(2), MaxLen(asking.MAX_CHOICES)]
    """the answers to choose from"""
    otherwise: Annotated[Whole, Ge(1), Le(asking.MAX_CHOICES)] = 1
    """number of the choice that the robot makes where nobody answers in time, from 1"""
    chance: Probability | None = None
    """that the step succeeds if nobody is asked; default: as planned"""
    retries: Annotated[Whole, Ge(0), Le(100)] = 0
    """how often the step is tried again where it fails"""
    patience: Annotated[Number, Unit("s"), Ge(0.001), Le(asking.MAX_PATIENCE_S)] = asking.PATIENCE_S
    """how long the step waits for an answer"""
    picture: Image | None = None
    """what the robot sees; default: none"""
    robot: Text | None = None
    """name or IRI of the robot; default: the caller"""


class AskedPerson(Answer):
    """Whether the question waits for an answer, and why."""

    asked: bool
    """if so, the claim has ended: the robot asks for another step"""
    question: str
    """IRI; empty if it was not asked"""
    gain: float
    """what asking is expected to save, in the unit of the prices of the plan"""
    reason: str
    commit: str
    """empty if it was not asked"""


class ListQuestions(Message):
    """Which questions to list."""

    state: Literal["open", "all"] = "open"
    """open: those that wait for an answer"""


class ListedChoice(Answer):
    """One answer to choose from."""

    number: int
    """from 1"""
    code: str
    text: str
    place: str
    """IRI; empty for none"""
    helps: bool


class ListedQuestion(Answer):
    """A question of a robot."""

    question: str
    """IRI"""
    task: str
    """IRI of the step that it is about"""
    step: str
    """the step in words"""
    plan: str
    """IRI of the plan"""
    goal: str
    robot: str
    """IRI of the robot that asks"""
    robot_name: str
    thing: str
    """IRI of the thing that the step handles; empty for none"""
    kind: str
    text: str
    reason: str
    """why asking was worth its price"""
    state: str
    """open, answered, expired or withdrawn"""
    asked: float
    """Unix time, s"""
    until: float
    """when the robot goes on without an answer, Unix time, s"""
    choices: list[ListedChoice]
    otherwise: int
    """number of the choice that is made where nobody answers"""
    chosen: int
    """number of the choice of a person; 0 for none"""
    answered_by: str
    remark: str
    picture: str
    """SHA-256 of what the robot saw, at /api/blobs; empty for none"""


class ListedQuestions(Answer):
    """Questions in the order in which they were asked."""

    questions: list[ListedQuestion]
    helped: int
    """of those that ended, how many were answered with a choice that helps"""
    ended: int


class AnswerQuestion(Message):
    """A person's answer."""

    question: Iri
    """IRI of the question"""
    choice: Annotated[Whole, Ge(1), Le(asking.MAX_CHOICES)]
    """number of the choice, from 1"""
    remark: Annotated[Text, MaxLen(_MAX_CHARS)] | None = None
    """what the person says besides; default: nothing"""
    operator: Text | None = None
    """name of the person; default: the caller"""


class AnsweredQuestion(Answer):
    """The commit, which can be undone; empty if the same was answered before."""

    commit: str


@operation("write", "writes", "ask a person about a claimed step, if that is worth its price",
           repeatable=True)  # fmt: skip
def ask_person(context: Context, request: AskPerson, access: Access) -> AskedPerson:
    """Store a question and give the step back until it is answered, or say why not to ask.

    Raises
    ------
    ConflictError
        The robot has no claim on the step, or has asked this before.
    """
    robot, author = robot_named(context, request.robot, access)
    choices = tuple(_choice(context, offered, k) for k, offered in enumerate(request.choices))
    inquiry = asking.Inquiry(
        request.kind,
        request.text,
        choices,
        request.otherwise,
        request.chance,
        request.retries,
        request.patience,
    )
    shown = None if request.picture is None else check_picture(request.picture, "picture")

    def picture(question: NamedNode) -> asking.Statements:
        if request.picture is None or shown is None:
            return []
        media_type, width, height = shown
        triples = Triples()
        blob = triples.blob(context.kb.blobs.put(request.picture, media_type))
        image = triples.node(
            iri(f"{question.value}/picture"), [RT.ColorImage],
            {RT.widthPx: width, RT.heightPx: height, RT.encoding: "rgb8", RT.hasBlob: blob},
        )  # fmt: skip
        triples.add(image, PROV.wasAttributedTo, NamedNode(robot))
        triples.add(question, RT.questionPicture, image)
        return list(triples)

    with context.writing:
        asked = asking.ask(context.kb, robot, str(request.task), inquiry, author, picture=picture)
    return AskedPerson(
        asked=bool(asked.question), question=asked.question, gain=asked.worth.gain,
        reason=asked.worth.text,
        commit="" if asked.commit is None else context.commit_id(asked.commit),
    )  # fmt: skip


@operation("read", "reads", "list what robots ask, with the answers to choose from")
def list_questions(context: Context, request: ListQuestions, access: Access) -> ListedQuestions:
    """Return the questions about stored plans."""
    now = dt.datetime.now(dt.UTC)
    plans = read_queue(context.kb)
    asked = [
        (plan, step, question)
        for plan in plans for step in plan.steps for question in step.questions
    ]  # fmt: skip
    names = names_of(context.kb.select, {question.robot for _, _, question in asked})
    listed = [_listed(plan, step, question, names, now) for plan, step, question in asked]
    past = asking.past_help(plans, now)
    return ListedQuestions(
        questions=[
            question for question in sorted(listed, key=lambda listing: listing.asked)
            if request.state == "all" or question.state == "open"
        ],
        helped=past.helped, ended=past.ended,
    )  # fmt: skip


@operation("teach", "writes", "answer a question of a robot", repeatable=True)
def answer_question(context: Context, request: AnswerQuestion, access: Access) -> AnsweredQuestion:
    """Store a person's choice, with which the robot takes up its step again.

    Raises
    ------
    ForbiddenError
        A robot answers.
    ConflictError
        Somebody answered before, the robot went on without, or the plan has ended.
    """
    check_agent(request.operator, access, "operator")
    author = context.author(access, request.operator or "operator", "teacher")
    if author.role == "robot":
        raise ForbiddenError(f"{author.agent} is a robot: questions are for people")
    person = context.agent_iri(author).value
    with context.writing:
        commit = asking.answer(
            context.kb, str(request.question), request.choice, person, author,
            remark=request.remark or "",
        )  # fmt: skip
    return AnsweredQuestion(commit="" if commit is None else context.commit_id(commit))


def _choice(context: Context, offered: OfferedChoice, number: int) -> Choice:
    place = "" if offered.place is None else str(offered.place)
    if place and not context.kb.match(iri(place)):
        field = f"choices[{number}].place"
        raise UnknownTermError(f"{field}: the graph has no {place}", field=field)
    return Choice(offered.code, offered.text, place, offered.helps)


def _listed(
    plan: QueuedPlan, step: QueuedStep, question: Question, names: dict[str, str], now: dt.datetime
) -> ListedQuestion:
    given = question.answer
    return ListedQuestion(
        question=question.iri, task=step.task, step=step.text, plan=plan.task, goal=plan.goal,
        robot=question.robot, robot_name=names[question.robot], thing=step.thing,
        kind=question.kind, text=question.text, reason=question.reason,
        state=question.state(now, asking.is_pending(plan, step, now)),
        asked=question.asked.timestamp(), until=question.until.timestamp(),
        choices=[
            ListedChoice(
                number=number, code=choice.code, text=choice.text, place=choice.place,
                helps=choice.helps,
            )
            for number, choice in enumerate(question.choices, 1)
        ],
        otherwise=question.otherwise, chosen=0 if given is None else given.choice,
        answered_by="" if given is None else given.by,
        remark="" if given is None else given.remark, picture=question.picture,
    )  # fmt: skip
