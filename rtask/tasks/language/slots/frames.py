"""Slots of a goal, filled in the order of the words: what, where from, and where to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rtask.tasks.language.slots.lexicon import WISHES
from rtask.tasks.language.slots.spans import Span

__all__ = ["Frame", "filled", "is_talk"]


@dataclass(frozen=True)
class Frame:
    """One deed: things that are to come to a place.

    Parameters
    ----------
    is_later
        It begins once those before it are reached.
    """

    thing: Span | None = None
    source: Span | None = None
    target: Span | None = None
    is_later: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether it says what, and where to."""
        return self.thing is not None and self.target is not None

    @property
    def spans(self) -> tuple[Span, ...]:
        """What fills it."""
        return tuple(s for s in (self.thing, self.source, self.target) if s is not None)

    @property
    def sentence(self) -> str:
        """The deed in the words that the grammar reads."""
        assert self.thing is not None
        assert self.target is not None
        source = f" from {self.source.text}" if self.source is not None else ""
        return f"{self.thing.text}{source} to {self.target.text}"


def filled(spans: Sequence[Span]) -> tuple[Frame, ...]:
    """Return the deeds of a sentence; empty where a slot could be filled in two ways."""
    frames: list[Frame] = []
    frame = Frame()
    for at, span in enumerate(spans):
        if _is_order(spans, at):
            if frame.is_complete:
                frames.append(frame)
                frame = Frame()
            frame = replace(frame, is_later=bool(frames))
        elif span.kind == "thing":
            if frame.is_complete:
                frames.append(frame)
                frame = Frame(thing=span)
            elif frame.thing is not None and frame.thing.clause == span.clause:
                return ()
            else:
                frame = replace(frame, thing=span, source=None)
        elif span.kind == "place":
            placed = _placed(frame, span)
            if placed is None:
                return ()
            frame = placed
    frames.append(frame)
    # A thing or place behind the last deed that finds no slot may be half of another one.
    return tuple(frames) if all(item.is_complete for item in frames) else ()


def _placed(frame: Frame, span: Span) -> Frame | None:
    """Return a deed with one more place; None where that has no slot left."""
    if span.preposition == "from":
        return replace(frame, source=span) if frame.source is None else None
    target = frame.target
    if target is None:
        return replace(frame, target=span)
    if frame.thing is None or target.start < frame.thing.start:
        # "make room on the shelf by taking the ball to the left box": talk comes first.
        return replace(frame, target=span) if target.clause != span.clause or (
            span.preposition == "to") else None  # fmt: skip
    is_of_object = target.preposition == "at" and target.start == frame.thing.end
    if is_of_object and frame.source is None:  # "the cup on the table should be on the shelf"
        return replace(frame, source=target, target=span)
    return None


def _is_order(spans: Sequence[Span], at: int) -> bool:
    words = [span.text for span in spans[at : at + 2]]
    return words[:1] in (["then"], ["afterwards"], ["next"]) or words == ["after", "that"]


def is_talk(spans: Sequence[Span], clause: int) -> bool:
    """Return whether people say in a clause what they do themselves, or what is so."""
    words = [s.text for s in spans if s.clause == clause and s.kind not in ("stop", "courtesy")]
    if words[:1] == ["and"]:
        words = words[1:]
    return words[:1] in (["i"], ["we"]) and not WISHES.intersection(words[1:3])
