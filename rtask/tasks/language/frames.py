"""Grammar of what people say around a goal: requests, wishes and courtesy."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.tasks.language.items import Items

__all__ = ["courtesies", "requests", "wishes"]

_COURTESY = (
    "please|kindly|thanks|hey|hello|hi|ok|okay|so|well|now|just|robot|dear|pls|plz|yo|oh|alright",
    "mate|sir|cheers|also",
    "thank you", "hey|hello|hi robot", "would|could|will AGENT", "right now", "as well", "at once",
    "if you please", "for me",
    "be a dear and", "if it is not too much trouble", "if you do not mind", "if possible",
)  # fmt: skip
_SURELY = "make sure|certain that?", "ensure that?", "see to it that", "make that", "take care that"
_REQUESTS = (
    "please? to", "let us", "go ahead and", "do", "do the needful and", "be so NICE and",
    "can|could|will|would AGENT POLITE*", "would you mind", "is|would it be? possible to",
    "the robot|robots MUST|can|has|have to?", "it MUST", "AGENT MUST|can|could POLITE*",
    "might|may|can|could I ask you to",
    "would you be so NICE as to", "be so NICE as to", "I would? WANT you? to", "I would WANT you",
    "I would? WANT that you",
    "I would be most|very|so? NICE if you could|would POLITE*",
    "it would be very|so? NICE if you could|would POLITE*",
    "I was|am|were wondering if|whether you could|would|might POLITE*",
    "it is necessary|important|time to", "you are asked|requested|supposed to",
    "you have|need to", "I would ask you to",
)  # fmt: skip
"""What can stand before a verb."""
_WISHES = (
    "I would? WANT that?",
    "I would WANT",
    *_SURELY,
    "I would? WANT to have|see|find",
    "let",
    "have",
    "get",
    "it would be very|so? NICE to have",
    "let us have",
    "is|would it be? possible to have",
)
"""What can stand before a state that is to be."""


def courtesies(items: Items, at: int) -> Iterator[int]:
    """Yield the words where a goal goes on after what is only polite; this one first."""
    pending, seen = [at], {at}
    while pending:
        start = pending.pop(0)
        yield start
        for pattern in _COURTESY:
            begins = (start, *items.ends(start, ","))
            for end in (end for begin in begins for end in items.ends(begin, pattern)):
                for after in (end, *items.ends(end, ",")):
                    if after not in seen and after > start:
                        seen.add(after)
                        pending.append(after)


def requests(items: Items, at: int) -> Iterator[int]:
    """Yield the words where a deed can begin: here, and after a request."""
    seen: set[int] = set()
    for start in courtesies(items, at):
        for begin in (start, *(end for pattern in _REQUESTS for end in items.ends(start, pattern))):
            for end in courtesies(items, begin):
                if end not in seen:
                    seen.add(end)
                    yield end


def wishes(items: Items, at: int) -> Iterator[int]:
    """Yield the words where a state can begin that is wished."""
    seen: set[int] = set()
    for start in courtesies(items, at):
        for pattern in _WISHES:
            for end in items.ends(start, pattern):
                if end not in seen:
                    seen.add(end)
                    yield end
