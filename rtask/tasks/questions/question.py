"""A question of a robot about a planned step, with its choices and its answer."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Choice", "GivenAnswer", "Question"]


@dataclass(frozen=True)
class Choice:
    """One answer to choose from.

    Parameters
    ----------
    code
        What the robot does with it, in a code of its own.
    text
        For people.
    place
        IRI of the place that it names; empty for none.
    helps
        Whether the step is expected to succeed with it.
    """

    code: str
    text: str
    place: str = ""
    helps: bool = False


@dataclass(frozen=True)
class GivenAnswer:
    """What a person answered.

    Parameters
    ----------
    choice
        Number of the choice, from 1.
    person, by
        IRI and name.
    time
        When.
    remark
        What the person said besides.
    """

    choice: int
    person: str
    by: str
    time: dt.datetime
    remark: str = ""


@dataclass(frozen=True)
class Question:
    """What a robot asks people.

    Parameters
    ----------
    iri, task
        IRIs of the question, and of the step that waits for the answer.
    robot
        IRI of the robot.
    kind
        A code of the robot's own, such as act or where.
    text, reason
        The question, and why it was worth its price.
    asked, until
        When it was asked, and when the robot goes on without an answer.
    choices
        In order.
    otherwise
        Number of the choice that is made where nobody answers, from 1.
    picture
        SHA-256 of the picture; empty for none.
    answer
        None as long as there is none.
    """

    iri: str
    task: str
    robot: str
    kind: str
    text: str
    reason: str
    asked: dt.datetime
    until: dt.datetime
    choices: Sequence[Choice]
    otherwise: int
    picture: str = ""
    answer: GivenAnswer | None = None

    def is_open(self, now: dt.datetime) -> bool:
        """Whether the robot waits for an answer."""
        return self.answer is None and now < self.until

    def state(self, now: dt.datetime, is_pending: bool = True) -> str:
        """Return open, answered, expired or withdrawn.

        Parameters
        ----------
        is_pending
            Whether its step may still be carried out.
        """
        if self.answer is not None:
            return "answered"
        if now >= self.until:
            return "expired"
        return "open" if is_pending else "withdrawn"

    @property
    def outcome(self) -> Choice:
        """The choice that was made: by a person, or by the robot itself."""
        return self.choices[(self.answer.choice if self.answer else self.otherwise) - 1]

    @property
    def helped(self) -> bool:
        """Whether somebody made a choice with which the step is expected to succeed."""
        return self.answer is not None and self.outcome.helps
