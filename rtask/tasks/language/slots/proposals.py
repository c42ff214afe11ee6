"""What a sentence can have meant that the grammar refuses, in words that the grammar reads.

Nothing is carried out on a guess: what is left out is named, and a person says the sentence again.
Where each word is accounted for, there is nothing to guess, and the sentence counts as understood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rtask.asking.questions.words import stem
from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import CLASSES
from rtask.tasks.language.slots.blocking import is_blocked
from rtask.tasks.language.slots.frames import Frame, filled, is_talk
from rtask.tasks.language.slots.lexicon import MOVEMENT, NOT_YET, SILENT
from rtask.tasks.language.slots.spans import Span, read_spans

__all__ = ["Proposal", "propose"]

_QUESTIONS = frozenset(
    ("is", "are", "am", "do", "has", "where", "should", "shall", "must", "may", "ought")
)  # fmt: skip


_PEOPLE = frozenset(("someone", "somebody", "anyone", "anybody", "everyone", "people"))


@dataclass(frozen=True)
class Proposal:
    """A sentence that the grammar may read.

    Parameters
    ----------
    sentence
        The goal in plain words.
    left_out
        Stretches of the sentence that it does not say.
    guessed
        Stretches from which it was guessed where to.
    """

    sentence: str
    left_out: tuple[str, ...] = ()
    guessed: tuple[str, ...] = ()

    @property
    def is_certain(self) -> bool:
        """Whether each word is accounted for."""
        return not self.left_out and not self.guessed

    @property
    def text(self) -> str:
        """The proposal for people."""
        notes = [
            f"{verb} {', '.join(map(repr, words))}"
            for verb, words in (("leaves out", self.left_out), ("goes by", self.guessed)) if words
        ]  # fmt: skip
        return repr(self.sentence) + (f" (which {' and '.join(notes)})" if notes else "")


def propose(items: Items) -> Proposal | None:
    """Return what a sentence seems to ask for; None where a word could change that."""
    if items.word(0) in _QUESTIONS or _is_report(items):
        return None
    spans = read_spans(items)
    frames = filled(spans)
    used = {span for frame in frames for span in frame.spans}
    loose = [span for span in spans if span not in used and span.kind not in ("stop", "courtesy")]
    if not frames or is_blocked(spans, frames, loose):
        return None
    talk = {span.clause for span in spans if is_talk(spans, span.clause)}
    if any(_is_narrated(frame, talk) for frame in frames):
        return None
    left_out = [text for run in _runs(loose) if (text := _left_out(items, run, talk))]
    targets = [frame.target for frame in frames if frame.target is not None]
    guessed = [items.text(t.start, t.end) for t in targets if t.preposition in ("", "near")]
    return Proposal(_sentence(frames), tuple(left_out), tuple(guessed))


def _is_report(items: Items) -> bool:
    """Return whether it is told what people did: "someone put the cups away"."""
    return items.word(0) in _PEOPLE and items.word(1) not in (*CLASSES["MODAL"], "please", ",")


def _sentence(frames: Sequence[Frame]) -> str:
    later = [", then " if frame.is_later else "; " for frame in frames[1:]]
    return frames[0].sentence + "".join(
        mark + frame.sentence for mark, frame in zip(later, frames[1:], strict=True)
    )


def _is_narrated(frame: Frame, talk: set[int]) -> bool:
    return all(span.clause in talk for span in (frame.thing, frame.target) if span is not None)


def _runs(loose: Sequence[Span]) -> list[list[Span]]:
    """Return words that stand beside each other."""
    runs: list[list[Span]] = []
    for span in loose:
        if runs and runs[-1][-1].end == span.start:
            runs[-1].append(span)
        else:
            runs.append([span])
    return runs


def _left_out(items: Items, run: Sequence[Span], talk: set[int]) -> str:
    """Return a run of words if one of them says something; "" if none does."""
    if not all(_is_silent(span) for span in run) or run[0].clause in talk:
        return items.text(run[0].start, run[-1].end)
    return ""


def _is_silent(span: Span) -> bool:
    word = span.text
    if span.kind in ("thing", "place", "robot") or word in NOT_YET:
        return False
    return word in SILENT or word in MOVEMENT or stem(word) in MOVEMENT or (
        word in ("after", "afterwards", "next", "first")
    )  # fmt: skip
