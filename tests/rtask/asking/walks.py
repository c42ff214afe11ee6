"""Seeded queries made of statements that a graph has: each has an answer, so none is at fault.

Each begins with a statement of a property drawn evenly, walks on to statements of what it mentions,
and calls its variables in one of the ways that people do: by letters, classes, their first letters,
or properties.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Iterator

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.asking.check.syntax.writing import written
from rtask.asking.check.vocabulary import Vocabulary, local
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import RDF_TYPE, Term, prologue

__all__ = ["statements", "walks"]

_OURS = (ontology.NS, ontology.PREFIXES["prov"], ontology.PREFIXES["sosa"])
_LETTERS = {"letters": "abcdefghijk", "last letters": "xyzuvwpqrst"}
_STYLES = (*_LETTERS, "classes", "short", "properties")


def walks(kb: KnowledgeBase, vocabulary: Vocabulary, count: int, seed: int) -> Iterator[str]:
    """Yield queries, each with an answer in the graph."""
    about: dict[Term, list[Quad]] = defaultdict(list)
    by_property: dict[str, list[Quad]] = defaultdict(list)
    for quad in statements(kb, vocabulary):
        by_property[quad.predicate.value].append(quad)
        about[quad.subject].append(quad)
        if isinstance(quad.object, NamedNode):
            about[quad.object].append(quad)
    properties = sorted(by_property)
    for at in range(count):
        draw = random.Random(f"{seed} {at}")
        walk = [draw.choice(by_property[draw.choice(properties)])]
        for _ in range(draw.randrange(3)):
            ends = {t for q in walk for t in (q.subject, q.object) if isinstance(t, NamedNode)}
            walk.append(draw.choice(about[draw.choice(sorted(ends, key=str))]))
        yield _Writer(kb, vocabulary, draw).query(walk)


def statements(kb: KnowledgeBase, vocabulary: Vocabulary) -> list[Quad]:
    """Return the statements about individuals, in an order of their own."""
    terms = vocabulary.bit.keys() | vocabulary.properties.keys()
    rows = (quad for iri in vocabulary.properties if iri.startswith(_OURS)
            for quad in kb.match(None, NamedNode(iri)))  # fmt: skip
    chosen = {
        (str(quad.subject), quad.predicate.value, str(quad.object)): quad
        for quad in rows
        if isinstance(quad.subject, NamedNode) and quad.subject.value not in terms
        if not (isinstance(quad.object, NamedNode) and quad.object.value in terms)
    }
    return [chosen[key] for key in sorted(chosen)]


class _Writer:
    """Writes one query."""

    def __init__(self, kb: KnowledgeBase, vocabulary: Vocabulary, draw: random.Random) -> None:
        self._kb, self._vocabulary, self._draw = kb, vocabulary, draw
        self._style = draw.choice(_STYLES)
        self._names: dict[object, str] = {}

    def query(self, walk: list[Quad]) -> str:
        """Return the text for some statements that hang together."""
        draw = self._draw
        unique = {(str(q.subject), q.predicate.value, str(q.object)): q for q in walk}
        patterns = [self._pattern(quad) for quad in unique.values()]
        things = [key for key in self._names if isinstance(key, NamedNode)]
        for thing in things[:2]:
            kinds = self._kinds(thing)
            if kinds and draw.random() < 0.4:
                patterns.append(f"?{self._names[thing]} a {_short(draw.choice(kinds))} .")
        draw.shuffle(patterns)
        if len(patterns) > 1 and draw.random() < 0.3:
            patterns[-1] = f"OPTIONAL {{ {patterns[-1]} }}"
        names = sorted({f"?{name}" for name in self._names.values()})
        shown = draw.choice(("*", " ".join(draw.sample(names, draw.randrange(1, len(names) + 1)))))
        return f"{prologue(ontology.PREFIXES)}SELECT {shown} WHERE {{ {' '.join(patterns)} }}"

    def _pattern(self, quad: Quad) -> str:
        iri = quad.predicate.value
        subject = self._name(quad.subject, "")
        key = quad.object if isinstance(quad.object, NamedNode) else (str(quad.object), iri)
        value = self._name(key, iri)
        if self._draw.random() < 0.1:
            return f"?{value} ^{_short(iri)} ?{subject} ."
        return f"?{subject} {_short(iri)} ?{value} ."

    def _kinds(self, term: NamedNode) -> list[str]:
        rows = self._kb.match(term, RDF_TYPE)
        return sorted({q.object.value for q in rows if isinstance(q.object, NamedNode)
                       and q.object.value in self._vocabulary.bit})  # fmt: skip

    def _name(self, key: object, via: str) -> str:
        if key not in self._names:
            self._names[key] = self._new_name(key, via)
        return self._names[key]

    def _new_name(self, key: object, via: str) -> str:
        at = len(self._names)
        if self._style in _LETTERS:
            return _LETTERS[self._style][at]
        kinds = self._kinds(key) if isinstance(key, NamedNode) else []
        kinds = self._vocabulary.most_specific(kinds)
        word = local(via).removeprefix("has") or "value"
        if kinds and not (self._style == "properties" and via):
            word = local(self._draw.choice(kinds))
        word = word[0].lower() + word[1:]
        if self._style == "short":
            word = word[:3]
        number = sum(name.rstrip("0123456789") == word for name in self._names.values())
        return f"{word}{number + 1}" if number else word


def _short(iri: str) -> str:
    return written(iri, ontology.PREFIXES)
