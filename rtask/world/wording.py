"""Whereabouts in words."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence

from rtask.world.whereabouts import Question, Whereabouts

__all__ = ["answer_text", "sentence", "untried_text"]

_MOST = 5
_UNITS = ((86_400.0, "day"), (3600.0, "hour"), (60.0, "minute"))


def answer_text(
    question: Question,
    places: Sequence[Whereabouts],
    is_called: bool,
    untried: int = 0,
    unresolved: int = 0,
) -> str:
    """Return the answer to a question: a sentence for each thing, at most five.

    Parameters
    ----------
    untried, unresolved
        Things of the name that were not looked at, and those whose frames lead too far to tell
        whether they are near: an answer without them is open.
    """
    answer = [_of_places(question, places, is_called, untried + unresolved > 0)]
    if untried:
        answer.append(untried_text(question, untried))
    if unresolved:
        answer.append(f"too many frames are between it and {unresolved} of them to tell")
    return "; ".join(answer)


def untried_text(question: Question, untried: int) -> str:
    """Return how many things were not looked at, and how to ask for them.

    >>> untried_text(Question("cup", max_things=2), 3)
    '3 more of "cup" were not looked at: ask with max_things 5, or by a name of their own'
    """
    more = f'{untried} more of "{question.name}" were not looked at'
    return f"{more}: ask with max_things {question.max_things + untried}, or by a name of their own"


def _of_places(
    question: Question, places: Sequence[Whereabouts], is_called: bool, is_open: bool
) -> str:
    if not is_called:
        return f'not known: nothing is called "{question.name}"'
    if not places and is_open:
        return f'not decided: none of the "{question.name}" looked at is near "{question.near}"'
    if not places:
        return f'not known: no "{question.name}" near "{question.near}"'
    lines = [place.text for place in places[:_MOST]]
    if len(places) > _MOST:
        lines.append(f"and {len(places) - _MOST} more")
    return "; ".join(lines)


def sentence(place: Whereabouts, time_s: float, is_now: bool = True) -> str:
    """Return where one thing is, since when, who says so, and how sure it is.

    >>> sentence(Whereabouts("urn:t", "urn:p", "cup", "unknown"), 0.0)
    'cup: not known, nobody has seen it'
    >>> sentence(Whereabouts("urn:t", "urn:p", "cup", "unknown"), 0.0, is_now=False)
    'cup: not known, nobody had seen it by then'
    """
    if not place.is_known:
        return f"{place.label}: not known, {_why_unknown(place, time_s, is_now)}"
    by = f" by {place.agent}" if place.agent else ""
    seen = f", seen{by} {_ago(time_s - (place.seen_s or time_s))}"
    sure = f", still there with {place.still_there:.0%}"
    within = ""
    if place.radius90_m is not None:
        within = f", within {100 * place.radius90_m:.0f} cm with 90%"
    return f"{place.label}: {_where(place)}{seen}{sure}{within}{_doubt(place)}"


def _where(place: Whereabouts) -> str:
    words = {"on": "on", "in": "in", "held_by": "held by"}
    parts = []
    if place.relation in words:
        parts.append(f"{words[place.relation]} {place.place_label}")
    if place.frame_from_exemplar is not None:
        x, y, z = place.frame_from_exemplar[:3, 3]
        parts.append(f"at ({x:.3f}, {y:.3f}, {z:.3f}) m in {place.frame_id}")
    if place.frame_reason:
        parts.append(f"(not known in the frame asked for: {place.frame_reason})")
    return " ".join(parts)


def _why_unknown(place: Whereabouts, time_s: float, is_now: bool) -> str:
    # Of an instant in the past, somebody may have seen it since.
    unseen = "nobody has seen it" if is_now else "nobody had seen it by then"
    if place.since_s is None and place.place_label:
        return f"{unseen}; it is stated to be on or in {place.place_label}"
    if place.since_s is None:
        return unseen
    if place.until_s is None:
        return "nobody had seen it by then"
    last = f"on or in {place.place_label} " if place.place_label else ""
    return f"last {last}until {_time(place.until_s)}, {_ago(time_s - place.until_s)}"


def _doubt(place: Whereabouts) -> str:
    if not place.doubts:
        return ""
    return f"; it may be {len(place.doubts)} other, first with {place.doubts[0][1]:.0%}"


def _time(time_s: float) -> str:
    return dt.datetime.fromtimestamp(time_s, dt.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _ago(age_s: float) -> str:
    """Return an age in words.

    >>> _ago(7300.0), _ago(3.0)
    ('2 hours ago', 'just now')
    """
    for size, unit in _UNITS:
        count = int(age_s // size)
        if count:
            return f"{count} {unit}{'s' if count > 1 else ''} ago"
    return "just now"
