"""The words of a goal, with marks between them, and what stretches of them name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from rtask.asking.questions.mentions import (
    MAX_MENTIONS,
    Mention,
    find_mentions,
    tokens_of,
    with_called,
)
from rtask.asking.questions.words import stem
from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import Literal
from rtask.tasks.actions import Select
from rtask.tasks.language.lexicon import CLASSES
from rtask.tasks.language.meaning import Name
from rtask.tasks.language.people import owners, robots_by_kind

__all__ = ["Items", "read_items"]

_ROLES = {
    "object": "rt:ManipulableObject", "thing": "rt:Exemplar", "robot": "cora:Robot",
    "place": "rt:SupportSurface", "use": "rt:ObjectFunction", "colour": "rt:Colour",
    "trait": "rt:ObjectTrait",
}  # fmt: skip
_KINDS = {"kind": "rt:ManipulableObject"}
_MARK = re.compile(r"[,;:.!?](?=\s|$)")
_MADE_OF = {"wooden": "wood", "metallic": "metal", "woollen": "wool", "plastics": "plastic"}


class Items:
    """The words of a goal, in lower case, and the names that begin at each of them."""

    def __init__(self, words: Sequence[str], names: Sequence[Name]) -> None:
        self.words = tuple(words)
        self.names: dict[int, list[Name]] = {}
        for name in names:
            self.names.setdefault(name.mentions[0].start, []).append(name)
        self.named = tuple(names)
        self.furthest = 0
        """The first word that no rule has taken so far, for messages."""
        self.expected: dict[int, set[str]] = {}
        """Words that rules have looked for where they found another one."""

    @property
    def stopped(self) -> int:
        """Number of the word at which reading has stopped."""
        return min(self.furthest, len(self) - 1)

    def __len__(self) -> int:
        return len(self.words)

    def word(self, at: int) -> str:
        """Return a word; "" beyond the end."""
        return self.words[at] if 0 <= at < len(self.words) else ""

    def text(self, start: int, end: int) -> str:
        """Return a stretch as a person wrote it, but for capitals."""
        return " ".join(self.words[start:end])

    def is_verb(self, at: int, verbs: frozenset[str]) -> bool:
        """Return whether a word is a form of one of some verbs."""
        word = self.word(at)
        fits = word in verbs or stem(word) in verbs
        if not fits:
            self.expected.setdefault(at, set()).update(verbs)
        return self._note(at, fits)

    def ends(self, at: int, pattern: str) -> Iterator[int]:
        """Yield where a sequence of words that begins here may end.

        Parameters
        ----------
        pattern
            Words, or names of :data:`~rtask.tasks.language.lexicon.CLASSES`; with ``|`` between
            them any will do, with ``?`` behind they may be missing, with ``*`` be several.
        """
        yield from self._ends(at, pattern.split())

    def _ends(self, at: int, parts: Sequence[str]) -> Iterator[int]:
        if not parts:
            yield at
            return
        part = parts[0].rstrip("?*")
        fits = any(self._fits(at, choice) for choice in part.split("|"))
        if fits:
            yield from self._ends(at + 1, parts if parts[0].endswith("*") else parts[1:])
        if parts[0][-1] in "?*":
            yield from self._ends(at, parts[1:])

    def _fits(self, at: int, choice: str) -> bool:
        word = self.word(at)
        fits = word in CLASSES[choice] if choice in CLASSES else bool(word) and word == choice
        if not fits:
            self.expected.setdefault(at, set()).update(CLASSES.get(choice, (choice,)))
        return self._note(at, fits)

    def _note(self, at: int, fits: bool) -> bool:
        if fits:
            self.furthest = max(self.furthest, at + 1)
        return fits

    def name(self, at: int, *roles: str) -> Name | None:
        """Return the name that begins here and has one of some roles; None for none."""
        matches = next((name for name in self.names.get(at, ()) if name.role(*roles)), None)
        if matches is not None:
            self.furthest = max(self.furthest, matches.mentions[0].end)
        return matches


def read_items(select: Select, text: str, base: str) -> Items:
    """Return the words of a goal and what they name.

    Raises
    ------
    UsageError
        It has too many words, or names too many things.
    """
    tokens: list[str] = []
    at = 0
    for mark in [*_MARK.finditer(text), None]:
        tokens += tokens_of(text[at : mark.start() if mark is not None else len(text)])
        if mark is not None:
            tokens.append(mark[0])
            at = mark.end()
    mentions = find_mentions(select, tokens, base, _ROLES, _KINDS, has_modals=False)
    mentions = _only_called(select, with_called(select, tokens, mentions))
    if any(item.is_cut for item in mentions):
        raise UsageError(
            f"{text.strip()!r} names more than {MAX_MENTIONS} things: give their kind, a full name "
            "in quotes, or an IRI"
        )
    spans: dict[tuple[int, int], list[Mention]] = {}
    mentions += robots_by_kind(select, tokens, mentions)
    for item in [*mentions, *_materials(select, tokens), *owners(select, tokens)]:
        spans.setdefault((item.start, item.end), []).append(item)
    return Items([token.lower() for token in tokens], [Name(tuple(of)) for of in spans.values()])


def _materials(select: Select, tokens: Sequence[str]) -> Iterator[Mention]:
    """Yield the words that are a material of which some object is said to be."""
    words: dict[str, list[int]] = {}
    for at, token in enumerate(tokens):
        if token.isalpha():
            words.setdefault(_MADE_OF.get(token.lower(), token.lower()), []).append(at)
    written = " ".join(str(Literal(word)) for word in words)
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?word ?material WHERE {{ VALUES ?word {{ {written} }} "
        "?object rt:surfaceMaterial ?material FILTER(LCASE(STR(?material)) = ?word) }"
    )
    for row in rows:
        for at in words[str(row.value("word"))]:
            material = row["material"]
            assert material is not None
            yield Mention(at, at + 1, tokens[at], "material", (material,))


def _only_called(select: Select, mentions: Sequence[Mention]) -> list[Mention]:
    """Return mentions without those things that are of the kind as well as called so."""
    result = []
    for item in mentions:
        if item.called:
            kinds, called = (" ".join(map(str, terms)) for terms in (item.terms, item.called))
            rows = select(
                f"SELECT ?s WHERE {{ VALUES ?s {{ {called} }} "
                f"FILTER NOT EXISTS {{ VALUES ?kind {{ {kinds} }} ?s a ?kind }} }}"
            )
            strangers = tuple(term for row in rows if (term := row["s"]) is not None)
            item = replace(item, called=strangers)
        result.append(item)
    return result
