"""An attempt as far as its causes are concerned, and what the graph knows around it."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Failure", "Hand", "Try"]


@dataclass(frozen=True)
class Hand:
    """An end effector.

    Parameters
    ----------
    iri, robot, name
        Its IRI, that of its robot, and the robot's name.
    kind
        Its gripper type.
    opening, payload, force
        m, kg, N; None where not known.
    finger_width
        m; 0 where not known.
    """

    iri: str
    robot: str
    name: str = ""
    kind: str = ""
    opening: float | None = None
    payload: float | None = None
    force: float | None = None
    finger_width: float = 0.0


@dataclass(frozen=True)
class Try:
    """An attempt, made or imagined.

    Parameters
    ----------
    hand
        What it was made with.
    product, thing, grasp, place
        IRIs; empty where not known.
    along
        Place of the grasp along the longer side, m from the middle; None where not known.
    held, reason
        How it ended.
    done_before
        What was done before: looked, recognised, cleared, in_time or agreed.
    is_other
        Whether it is of another occasion than the failure that is asked about.
    is_since
        Whether it was made after that failure.
    """

    hand: Hand
    product: str = ""
    thing: str = ""
    grasp: str = ""
    place: str = ""
    along: float | None = None
    held: bool = False
    reason: str = ""
    done_before: frozenset[str] = frozenset()
    is_other: bool = False
    is_since: bool = False


@dataclass(frozen=True)
class Failure:
    """What failed, and what the graph knows around it.

    Parameters
    ----------
    subject
        IRI that was asked about.
    attempt, step
        IRIs of the attempt and of the planned step; empty where there is none.
    text
        What was done, in words.
    tried
        As it was.
    held
        Whether it held after all.
    length, width, mass
        Of the product, m and kg; None where not known.
    age_s
        How old the knowledge of the thing's place was; None where not known.
    is_elsewhere
        Whether the thing was seen elsewhere afterwards, or nowhere.
    origin, seen_at
        IRIs of the place or hand where the thing was believed to be, and of the first place where
        it was afterwards; empty where not known.
    margin
        By how much recognition preferred the best match; None where not known.
    neighbours
        Names of the things at the same place.
    is_late
        Whether it ended after its deadline; None without one.
    others
        Other judged attempts at the product, or with the hand; the latest of them.
    is_cut
        Whether there are earlier ones, which are not taken into account.
    hands
        Hands that can grasp the product and reach the place, as far as the graph knows.
    grasps
        Stored grasps of the product: IRI, kind of hand, place along it, m.
    has_ended
        Whether it has ended; a planned step that has not is no failure.
    assignment
        Why the planned step is its robot's, in words; empty where that is as planned and it ended.
    """

    subject: str
    attempt: str
    step: str
    text: str
    tried: Try
    held: bool = False
    length: float | None = None
    width: float | None = None
    mass: float | None = None
    age_s: float | None = None
    is_elsewhere: bool = False
    margin: float | None = None
    neighbours: tuple[str, ...] = ()
    is_late: bool | None = None
    others: tuple[Try, ...] = ()
    is_cut: bool = False
    hands: tuple[Hand, ...] = ()
    grasps: tuple[tuple[str, str, float], ...] = ()
    origin: str = ""
    seen_at: str = ""
    has_ended: bool = True
    assignment: str = ""
