"""Figures of questions in words: how often the right one is found, with its slots filled right.

The phrasings that the product knows are each tried without themselves; those of
``asking_phrasings.toml`` were frozen before anything was tuned, those of ``asking_fifth.toml`` when
the phrasings of three sets in between, which had been seen, were added to the known ones.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import ontology
from rtask.asking.questions import answering
from rtask.asking.questions.catalogue import Phrase, Question, phrase, questions
from rtask.asking.questions.matching import Matcher
from rtask.knowledge_base import KnowledgeBase

SAMPLE = ontology.BASE + "sample/"
_NAMES = ("t0", "t1", "t2", "r1", "g1", "g2", "g3", "camF", "mugCloud", "mug2",
          "table", "kitchen")  # fmt: skip
NAMED = "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> INSERT DATA {{ {} }}".format(
    " ".join(f'<{SAMPLE}{name}> rdfs:label "{name}" .' for name in _NAMES)
)


@dataclass(frozen=True)
class Tried:
    """A phrasing, and what it was understood as."""

    asked: str
    right: str
    got: str
    is_question: bool
    is_filled: bool


def frozen(file: str) -> list[tuple[Question, Phrase]]:
    """Return the phrasings of a file that was kept away from tuning."""
    text = (Path(__file__).parent / file).read_text("utf-8")
    by_key = {one.key: one for one in questions()}
    return [
        (by_key[key], phrase(words))
        for key, marked in tomllib.loads(text).items()
        if key in by_key  # "counted" has several right questions
        for words in (marked if isinstance(marked, list) else [marked])
    ]


def none_of_them(is_kept: bool) -> dict[str, list[str]]:
    """Return questions that mean none of the ontology's, by kind.

    Every third was kept away when the rules for them were tuned.
    """
    text = (Path(__file__).parent / "asking_none.toml").read_text("utf-8")
    return {
        kind: [words for at, words in enumerate(texts) if (at % 3 == 2) == is_kept]
        for kind, texts in tomllib.loads(text).items()
    }


@dataclass(frozen=True)
class Newcomer:
    """A newcomer's question at a demo: the questions that are right, and what it has to name."""

    words: str
    right: tuple[str, ...]
    names: tuple[str, ...]

    def is_right(self, kb: KnowledgeBase) -> bool | None:
        """Return whether it is answered rightly; None if it is not answered."""
        got = answering.answer(kb, self.words)
        if not got.is_understood:
            return None
        groups = {one.key: one.group for one in questions()}
        right = {groups.get(key, key) for key in self.right}
        named = " ".join(words for words, _ in got.filled.values())
        return groups.get(got.key, got.key) in right and all(name in named for name in self.names)


def newcomers(later: bool) -> tuple[list[Newcomer], list[str]]:
    """Return questions of newcomers at a demo, and such as mean none of the ontology's."""
    told = tomllib.loads((Path(__file__).parent / "asking_newcomers.toml").read_text("utf-8"))
    suffix = "_later" if later else ""
    asked = [Newcomer(words, tuple(right), tuple(names))
             for words, right, names in told[f"asked{suffix}"]]  # fmt: skip
    return asked, told[f"none{suffix}"]


def try_phrase(kb: KnowledgeBase, question: Question, said: Phrase) -> Tried:
    """Ask in a phrasing; the graph has the sample with :data:`NAMED`."""
    got = answering.answer(kb, said.text)
    groups = {one.key: one.group for one in questions()}
    is_question = groups.get(got.key) == question.group
    meant = {(words, name) for _, words, name in said.filled}
    filled = {
        (words, term.strip('<>"').replace("/", "#").rpartition("#")[2] if term else "")
        for words, terms in got.filled.values()
        for term in terms[:1] or ("",)
    }
    is_filled = all(
        any(words in got_words and name.lower() in (term.lower(), words.lower())
            for got_words, term in filled)
        for words, name in meant
    )  # fmt: skip
    return Tried(said.text, question.key, got.key, is_question, is_question and is_filled)


def known(kb: KnowledgeBase) -> Iterator[Tried]:
    """Try each phrasing that the product knows, without that one."""
    for question in questions():
        for said in question.phrases[1:]:
            others = Matcher(
                (one, [other for other in one.phrases if other is not said]) for one in questions()
            )
            with mock.patch.object(answering, "matcher", lambda others=others: others):
                yield try_phrase(kb, question, said)


def unseen(kb: KnowledgeBase, file: str = "asking_phrasings.toml") -> Iterator[Tried]:
    """Try each frozen phrasing of a file."""
    for question, said in frozen(file):
        yield try_phrase(kb, question, said)
