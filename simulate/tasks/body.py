"""A robot as an executor of planned tasks uses it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

__all__ = ["Attempted", "Deed", "Seeing", "TaskBody", "Watching"]


@dataclass(frozen=True)
class Attempted:
    """A grasp that was tried, as it is reported.

    Parameters
    ----------
    grasp
        As the graph offered it.
    outcome
        As :func:`simulate.agent.messages.outcome_message` has it.
    observation
        The view of the thing that it was planned on; None where the graph needs none.
    """

    grasp: Mapping[str, Any]
    outcome: Mapping[str, Any]
    observation: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Deed:
    """How an action ended, by the robot's own senses.

    Parameters
    ----------
    success
        Whether it did what the step asks for.
    reason
        Code of the reason: ok, missed, slip_lift, drop_outside ...
    duration_s
        How long it took, s.
    lifted_m
        How far the thing was lifted, m; None where nothing was lifted.
    attempt
        The grasp and all that was measured; None where the robot knows no more than the above.
    was_tried
        Whether a hand did anything: what was never tried says nothing about grasps.
    """

    success: bool
    reason: str = "ok"
    duration_s: float = 0.0
    lifted_m: float | None = None
    attempt: Attempted | None = None
    was_tried: bool = True


class TaskBody(Protocol):
    """Hands and eyes of a robot; things, places and hands are named by their IRIs."""

    @property
    def hands(self) -> Mapping[str, str]:
        """Gripper id, as outcomes are reported with it, of each hand."""

    @property
    def physics(self) -> Literal["faithful", "fast", "real"]:
        """In what its outcomes come about, as they say in reports."""

    def sees(self, item: str, place: str) -> bool:
        """Look whether a thing is at a place, or in a hand."""

    def find(self, item: str) -> str | None:
        """Look for a thing wherever the robot reaches; return the place or hand, if it is seen."""

    def pick(self, item: str, place: str, hand: str) -> Deed:
        """Pick a thing up."""

    def put(self, item: str, place: str, hand: str) -> Deed:
        """Put a held thing down."""

    def give(self, item: str, hand: str, target: str) -> Deed:
        """Give a held thing into the hand of another robot."""


@runtime_checkable
class Seeing(Protocol):
    """A body with a camera, whose pictures go with what it asks people."""

    def picture(self) -> bytes | None:
        """Return what it sees now as PNG or JPEG; None if it sees nothing."""


@runtime_checkable
class Watching(Protocol):
    """A body that notices what it has moved beside the thing of its step."""

    def displaced(self) -> Mapping[str, str | None]:
        """Return other things that are no longer where they were before the last action.

        Returns
        -------
        Mapping
            By the IRI of the thing: the place where it is seen, or None where that is not known.
        """
