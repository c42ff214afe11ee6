"""Single facts of an attempt that could have been otherwise, smallest first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from rtask.tasks.diagnosis.attempt import Failure, Try

__all__ = ["FRACTIONS", "Change", "changes_of"]

FRACTIONS = (-0.4, -0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4)
"""Places along a thing, in units of its length, where no grasp is stored."""
_APART_M = 0.005
"""Grasps nearer than this are the same place."""


@dataclass(frozen=True)
class Change:
    """One changed fact.

    Parameters
    ----------
    kind
        again, look, recognise, clear, earlier, ask, grasp or hand.
    size
        How much is changed: smaller ones are preferred.
    text
        In words.
    tried
        The attempt with that fact changed.
    chance
        That it holds, 0..1.
    """

    kind: str
    size: int
    text: str
    tried: Try
    chance: float = 0.0

    def with_chance(self, chance: float) -> Change:
        """Return the change with its chance."""
        return replace(self, chance=chance)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        tried = self.tried
        return {
            "kind": self.kind, "text": self.text, "chance": round(self.chance, 4),
            "robot": tried.hand.robot, "hand": tried.hand.iri, "grasp": tried.grasp,
            "along": tried.along,
        }  # fmt: skip


def changes_of(failure: Failure) -> Iterator[Change]:
    """Yield the changes of a failed attempt that the graph has the means for."""
    own = replace(failure.tried, held=False, reason="")
    yield Change("again", 0, "the same once more", own)
    yield _first("look", 1, "look first where it is, and begin from there", own, "looked")
    yield _first("recognise", 1, "recognise it anew before the grasp", own, "recognised")
    if failure.neighbours:
        beside = ", ".join(failure.neighbours[:3])
        text = f"another order: first move what stands beside it ({beside})"
        yield _first("clear", 2, text, own, "cleared")
    else:
        yield _first("clear", 2, "clear the way to it first", own, "cleared")
    yield _first("earlier", 2, "another order: begin earlier, or allow more time", own, "in_time")
    yield _first("ask", 2, "ask the person first, and plan without what is refused", own, "agreed")
    yield from _other_grasps(failure, own)
    for hand in failure.hands:
        if hand.iri != own.hand.iri:
            is_same = hand.robot == own.hand.robot
            text = f"another hand of {hand.name}" if is_same else f"{hand.name} does it"
            # Another hand is another grasp as well, and looks for itself.
            tried = replace(
                own, hand=hand, grasp="", along=own.along, done_before=frozenset({"looked"})
            )
            yield Change("hand", 3 if is_same else 4, text, tried)


def _first(kind: str, size: int, text: str, own: Try, what: str) -> Change:
    return Change(kind, size, text, replace(own, done_before=frozenset({what})))


def _other_grasps(failure: Failure, own: Try) -> Iterator[Change]:
    """Yield grasps elsewhere on the thing: those that are stored, and places along it."""
    stored = [
        (iri, along) for iri, kind, along in failure.grasps
        if kind == own.hand.kind and _is_apart(own, along)
    ]  # fmt: skip
    for iri, along in stored:
        text = f"another grasp: {_place(along)}, which {_record(failure, iri)}"
        yield Change("grasp", 2, text, replace(own, grasp=iri, along=along))
    if not failure.length or own.along is None:
        text = "another grasp, elsewhere on it"
        yield Change("grasp", 2, text, replace(own, grasp="new", along=None))
    else:
        for fraction in FRACTIONS:
            along = fraction * failure.length
            if _is_apart(own, along) and all(abs(along - at) > _APART_M for _, at in stored):
                text = f"another grasp: {_place(along)}"
                yield Change("grasp", 2, text, replace(own, grasp="new", along=along))


def _record(failure: Failure, grasp: str) -> str:
    held = [other.held for other in failure.others if other.grasp == grasp]
    return f"held in {sum(held)} of {len(held)} attempts" if held else "is stored"


def _place(along: float) -> str:
    return f"at {1000 * along:.0f} mm along it"


def _is_apart(own: Try, along: float) -> bool:
    return own.along is None or abs(along - own.along) > _APART_M
