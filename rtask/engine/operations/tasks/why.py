"""Why an attempt or a step failed, and what would have mended it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.operations.operation import operation
from rtask.tasks import Tasks
from rtask.wire.message import Answer, Message

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["ExplainFailure", "FailureExplained", "explain_failure"]


class ExplainFailure(Message):
    """Something that failed."""

    subject: str
    """IRI of an attempt, a task, a step of a plan or a stored plan, or an object's IRI or name: its
    latest attempt that failed"""


class FailureCause(Answer):
    """What may have made it fail."""

    kind: str
    """code, such as centre_of_mass, slippery or stale_place"""
    chance: float
    text: str
    evidence: list[str]
    """what the graph knows that speaks for or against it, in words"""


class FailureChange(Answer):
    """A single fact that could have been otherwise."""

    kind: str
    """again, look, recognise, clear, earlier, ask, grasp or hand"""
    text: str
    chance: float
    """that it would have held"""
    robot: str
    """IRI of the robot that would do it"""
    hand: str
    grasp: str
    """IRI of a stored grasp; new for one that is not stored; empty for any"""
    along: float | None
    """place of the grasp along the longer side from its middle, m"""


class FailureExplained(Answer):
    """Causes with their chances, and the smallest change under which it would have held."""

    subject: str
    attempt: str
    """IRI of the attempt; empty for a step that failed without one"""
    step: str
    """IRI of the planned step; empty if there was no plan"""
    ended: bool
    """whether it has ended"""
    assignment: str
    """why the step is its robot's; empty if it has ended and that was as planned"""
    held: bool
    """whether it held after all; then there is no cause"""
    reason: str
    """code that the robot, or a person, gave"""
    causes: list[FailureCause]
    """likeliest first"""
    change: FailureChange | None
    """the smallest that suffices, else the surest"""
    mends: bool
    """whether the change is expected to suffice"""
    others: list[FailureChange]
    text: str
    """all of it in words"""


@operation("read", "reads", "say why an attempt or a step failed, and what would have mended it")
def explain_failure(context: Context, request: ExplainFailure, access: Access) -> FailureExplained:
    """Return the causes of a failure and the smallest change that mends it."""
    answer = Tasks(context.kb).why(str(request.subject), access=access).to_dict()
    change = answer["change"]
    return FailureExplained(
        **{
            **answer,
            "causes": [FailureCause(**cause) for cause in answer["causes"]],
            "change": None if change is None else FailureChange(**change),
            "others": [FailureChange(**other) for other in answer["others"]],
        }
    )
