"""Stretches of a sentence that can fill a slot: things and places, with the words between them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rtask.tasks.language.grammar.frames import courtesies
from rtask.tasks.language.grammar.phrases import Phrases
from rtask.tasks.language.items import Items
from rtask.tasks.language.meaning import Phrase

__all__ = ["Span", "read_spans"]

_PREPOSITIONS = (
    ("from", ("away from", "out of", "from off?", "off of?")),
    ("to", ("over to", "across to", "on to", "into", "onto", "to", "towards", "inside of?")),
    ("at", ("on top of", "in", "on", "at", "upon", "within")),
)
_STOPS = frozenset((",", ";", ":", ".", "!", "?", "so", "because"))
_ANAPHORS = frozenset(("it", "them", "they"))


@dataclass(frozen=True)
class Span:
    """A stretch of words.

    Parameters
    ----------
    kind
        thing, place, robot, anaphor, courtesy, stop, or word.
    text
        Its words, without the preposition of a place.
    clause
        Number of the clause, from 0.
    preposition
        Of a place: from, to, at, or empty; near where all that is said is what it is beside.
    """

    kind: str
    start: int
    end: int
    text: str
    clause: int
    preposition: str = ""


def read_spans(items: Items) -> list[Span]:
    """Return the words of a sentence as spans, in order; each word is in exactly one."""
    phrases = Phrases(items)
    spans: list[Span] = []
    at = clause = 0
    while at < len(items):
        span = next(_spans(items, phrases, at, clause))
        spans.append(span)
        clause += span.kind == "stop"
        at = span.end
    return spans


def _spans(items: Items, phrases: Phrases, at: int, clause: int) -> Iterator[Span]:
    """Yield what can stand here, the likeliest first."""
    if items.word(at) in _STOPS:
        yield Span("stop", at, at + 1, items.word(at), clause)
    for preposition, patterns in _PREPOSITIONS:
        for pattern in patterns:
            for start in items.ends(at, pattern):
                end = _place_end(items, phrases, start)
                if end:
                    yield Span("place", at, end, items.text(start, end), clause, preposition)
    for start in (*items.ends(at, "next|close to"), *items.ends(at, "beside|near|alongside")):
        end = _object_end(phrases, start)
        if end:  # no action brings things beside others; where these are is the nearest goal
            yield Span("place", at, end, f"where {items.text(start, end)} is", clause, "near")
    end, object_end = _place_end(items, phrases, at), _object_end(phrases, at)
    if end >= object_end and end:
        yield Span("place", at, end, items.text(at, end), clause)
    # "They can go back", "can the ball ...": a can has a word before it that says which.
    if object_end and items.text(at, object_end) != "can":
        yield Span("thing", at, object_end, items.text(at, object_end), clause)
    robot = items.name(at, "robot")
    if robot is not None:
        yield Span("robot", at, robot.mentions[0].end, robot.text, clause)
    end = max(courtesies(items, at))
    if end > at:
        yield Span("courtesy", at, end, items.text(at, end), clause)
    kind = "anaphor" if items.word(at) in _ANAPHORS else "word"
    yield Span(kind, at, at + 1, items.word(at), clause)


def _place_end(items: Items, phrases: Phrases, at: int) -> int:
    """Return where a place by name ends that begins here; 0 for none."""
    ends = [
        end for place, end in phrases.places(at)
        if place.names and all(name.role("place") for name in place.names)
        and "or" not in items.words[at:end]
    ]  # fmt: skip
    return max(ends, default=0)


def _object_end(phrases: Phrases, at: int) -> int:
    """Return where a phrase about things ends that begins here; 0 for none.

    Places stay out of it where they can: which of two is where from, the slots decide.
    """
    bare, placed = 0, 0
    for listed, end in phrases.lists(at):
        if any(_is_no_slot(phrase) for phrase in listed):
            continue
        if any(phrase.places for phrase in listed):
            placed = max(placed, end)
        else:
            bare = max(bare, end)
    return bare or placed


def _is_no_slot(phrase: Phrase) -> bool:
    """Return whether a phrase says what only the whole sentence tells: "the rest", "no cup"."""
    kind = phrase.quantity.kind if phrase.quantity is not None else ""
    is_counted = kind in ("no", "exactly", "at_most")
    return bool(phrase.anaphor) or phrase.is_elided or phrase.others or is_counted
