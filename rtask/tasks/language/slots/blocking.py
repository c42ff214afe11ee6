"""Words beside the slots of a goal that may change it, so that nothing is proposed."""

from __future__ import annotations

from collections.abc import Sequence

from rtask.asking.questions.words import stem
from rtask.tasks.language.lexicon import NUMBERS
from rtask.tasks.language.slots.frames import Frame, is_talk
from rtask.tasks.language.slots.lexicon import (
    BLOCKING,
    DETERMINERS,
    MOVEMENT,
    NOT_YET,
    RELATIVES,
    SILENT,
)
from rtask.tasks.language.slots.spans import Span

__all__ = ["is_blocked"]

_TELLING = ("i", "we", "you", "he", "she", "they")
_TOWARDS = ("to", "into", "onto", "in", "on", "at")
_OF_PLACES = ("on", "in", "off", "from", "of", "into", "onto", "with")


def is_blocked(spans: Sequence[Span], frames: Sequence[Frame], loose: Sequence[Span]) -> bool:
    """Return whether a word that fills no slot may change the goal."""
    before = {span: spans[at - 1] for at, span in enumerate(spans) if at}
    after = {span: spans[at + 1] for at, span in enumerate(spans[:-1])}
    if any(span.kind == "robot" for span in loose):  # who does it, or what it is about
        return True
    if any(_is_further(span, spans, frames) for span in loose):
        return True
    return (
        any(_changes(span, spans, before.get(span), after.get(span)) for span in loose)
        or any(_is_narrowed(frame, spans) for frame in frames)
        or any(_is_state(span, frames, before.get(span), after.get(span)) for span in loose)
    )


def _is_further(span: Span, spans: Sequence[Span], frames: Sequence[Frame]) -> bool:
    """Return whether "it" stands behind all slots, in a deed of its own: "and take it out"."""
    if span.kind != "anaphor" or span.start < max(x.end for f in frames for x in f.spans):
        return False
    clause = [item.text for item in spans if item.clause == span.clause]
    # "... to it" is where to, and "put them back there" the same deed once more.
    is_same = spans[spans.index(span) - 1].text in _TOWARDS or "there" in clause
    return not is_same and not is_talk(spans, span.clause)


def _changes(span: Span, spans: Sequence[Span], before: Span | None, after: Span | None) -> bool:
    """Return whether a word negates, limits, asks, tells, or has a meaning that is not known."""
    was, next_ = (item.text if item is not None else "" for item in (before, after))
    if span.text == "where":
        return was != "is"
    if span.text == "after" and next_ == "that":
        return False
    if span.text.endswith(("'s", "\u2019s", "s'")):  # whose it is
        return True
    if span.text in ("with", "containing", "long", "soon", "full"):  # what is in it, and how long
        return next_ == "as" or (before is not None and before.kind == "thing") or (
            span.text == "full")  # fmt: skip
    if was == "at" and (span.text.isdecimal() or span.text in NUMBERS):  # a time
        return True
    if span.text in BLOCKING:
        return not _is_harmless(span, spans)
    if span.kind == "anaphor":  # "everything off it": which place that is, nobody has said
        return was in _OF_PLACES
    if span.text == "and":  # "the table and the shelf"
        return after is not None and after.kind == "place" and not after.preposition
    return was in _TELLING and span.text.endswith("ed") and span.text != "need"  # "I moved"


def _is_harmless(span: Span, spans: Sequence[Span]) -> bool:
    """Return whether a time has no thing in its clause, as "before the guests come".

    Negations and conditions are never harmless: they may be about the goal all the same.
    """
    clause = [item for item in spans if item.clause == span.clause]
    if span.text in ("keep", "keeps"):  # "I keep tripping over that ball"
        return clause[0].text == "i"
    behind = [item for item in clause if item.start > span.start]
    is_about = any(item.kind in ("thing", "place", "anaphor", "robot") for item in behind)
    return span.text in ("before", "during") and bool(behind) and not is_about


def _is_narrowed(frame: Frame, spans: Sequence[Span]) -> bool:
    """Return whether words that are not understood say which thing: "the small cup"."""
    assert frame.thing is not None
    is_whole = frame.thing.text.split()[0] in DETERMINERS  # "so that the white bottle ..."
    before = [] if is_whole else [item for item in spans if item.end <= frame.thing.start]
    for number, span in enumerate(reversed(before)):
        if span.text in DETERMINERS:
            return True
        is_understood = span.text in SILENT or stem(span.text) in MOVEMENT or span.text in MOVEMENT
        # "the standing cups" has a word that is silent elsewhere.
        if span.kind != "word" or (is_understood and number):
            break
    behind = next((item for item in spans if item.start == frame.thing.end), None)
    return behind is not None and behind.text in RELATIVES


def _is_state(span: Span, frames: Sequence[Frame], before: Span | None, after: Span | None) -> bool:
    """Return whether a word tells what is so: "the cups are in the left box"."""
    if span.text not in NOT_YET:
        return False
    if before is not None and after is not None and (before.kind, after.kind) == ("thing", "place"):
        return True
    return any(before == frame.target and frame.thing is not None and frame.target is not None
               and frame.thing.end <= frame.target.start for frame in frames)  # fmt: skip
