"""The ontology's questions: their queries, the words for them, and what can be replaced in them."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from typing import Any

import ontology
from rtask.asking.questions.words import split_name, words_of

__all__ = ["Phrase", "Question", "Slot", "phrase", "questions"]

_SLOT = re.compile(r"(\w+)\s+(VALUES\s+)?(\S+)\s*(\{.*\})?$", re.S)
_MARKED = re.compile(r"\[(\w+) ([^\]:]+?)(?: :(\w+))?\]")


@dataclass(frozen=True)
class Slot:
    """A part of a query that gives way to what a person names.

    Parameters
    ----------
    role
        What it takes: ``object``, ``robot``, ``time`` ...
    term
        The constant or the variable of the query.
    pattern
        Leads to the variable from variables of the query; empty if the query has it.
    is_list
        The term is the variable of a VALUES clause, whose members are replaced.
    """

    role: str
    term: str
    pattern: str = ""
    is_list: bool = False

    @property
    def is_constant(self) -> bool:
        """Whether the query has a term in its place."""
        return not self.term.startswith("?")


@dataclass(frozen=True)
class Phrase:
    """A question in words; a slot is ``@role`` among its words.

    Parameters
    ----------
    text
        As a person writes it.
    words
        Words and slots, in order.
    filled
        Role, words and local name of each slot, for tests.
    """

    text: str
    words: tuple[str, ...]
    filled: tuple[tuple[str, str, str], ...] = ()


@dataclass(frozen=True)
class Question:
    """One of the ontology's questions.

    Parameters
    ----------
    key
        Name of its file: ``cq05``, ``eq01``.
    text
        The question itself.
    sparql
        Its query, without the comments at its head.
    slots
        What can be replaced.
    answer
        How one row reads.
    phrases
        Ways to ask it; the first is the question itself.
    same
        Key of a question that asks the same, or empty.
    """

    key: str
    text: str
    sparql: str
    slots: tuple[Slot, ...]
    answer: str
    phrases: tuple[Phrase, ...]
    same: str = ""

    @property
    def own_words(self) -> frozenset[str]:
        """The words of all its phrases, without slots."""
        result = {word for item in self.phrases for word in item.words}
        return frozenset(word for word in result if not word.startswith("@"))

    @property
    def group(self) -> str:
        """The same key for questions that ask the same."""
        return min(self.key, self.same or self.key)


def phrase(marked: str) -> Phrase:
    """Read a phrase in which slots are marked.

    >>> phrase("Where is the [object mug :mug2]?")
    Phrase(text='Where is the mug?', words=('where', 'be', 'the', '@object'), \
filled=(('object', 'mug', 'mug2'),))
    """
    filled = tuple(
        (role, wording, name or wording) for role, wording, name in _MARKED.findall(marked)
    )
    with_slots = _MARKED.sub(r" @\1 ", marked)
    return Phrase(_MARKED.sub(r"\2", marked), tuple(words_of(with_slots)), filled)


@cache
def questions() -> tuple[Question, ...]:
    """Return the questions of the ontology, those about its terms before those about episodes."""
    described = tomllib.loads(ontology.path("queries/words.toml").read_text("utf-8"))
    files = [*ontology.queries(), *ontology.episode_queries()]
    return tuple(_question(file.stem, file.read_text("utf-8"), described) for file in files)


def _question(key: str, text: str, described: dict[str, Any]) -> Question:
    lines = text.splitlines()
    asked = lines[0].removeprefix("# question: ")
    body = "\n".join(line for line in lines if not line.startswith("#"))
    about = described[key]
    slots = tuple(_slot(item) for item in about["slots"])
    own = phrase(_marked(asked, slots))
    return Question(
        key,
        asked,
        body.strip() + "\n",
        slots,
        about["answer"],
        (own, *(phrase(item) for item in about["phrasings"])),
        about.get("same", ""),
    )


def _slot(text: str) -> Slot:
    match = _SLOT.match(text)
    assert match is not None, text
    role, is_list, term, pattern = match.groups()
    return Slot(role, term, (pattern or "{}")[1:-1].strip(), bool(is_list))


def _marked(asked: str, slots: tuple[Slot, ...]) -> str:
    """Return a question with the names of its query's constants marked as slots."""
    for slot in slots:
        if slot.is_constant:
            name = " ".join(split_name(slot.term.partition(":")[2]))
            asked = re.sub(rf"\b{name}s?\b", f"[{slot.role} {name}]", asked, count=1)
    return asked
