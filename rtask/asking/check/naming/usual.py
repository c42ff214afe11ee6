"""What is usual in the questions that come with the ontology: a prior where much would fit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from math import log1p
from pathlib import Path
from types import MappingProxyType

import ontology
from rtask.asking.check.naming.names import PREPOSITIONS, words_of
from rtask.asking.check.syntax.outline import Outline
from rtask.asking.check.syntax.reading import read_outline
from rtask.asking.check.types import Demands, contexts, family
from rtask.asking.check.vocabulary import Vocabulary, local

__all__ = ["heads", "kinds_by_name", "nouns", "usual_kinds", "usual_literals", "usual_properties"]


@lru_cache(maxsize=1)
def _questions() -> tuple[Outline, ...]:
    files = sorted((Path(ontology.__file__).parent / "queries").rglob("*.rq"))
    return tuple(read_outline(file.read_text("utf-8")) for file in files)


@lru_cache(maxsize=4)
def nouns(vocabulary: Vocabulary) -> frozenset[str]:
    """Return the words in the names of classes."""
    return frozenset(
        word for iri in vocabulary.bit for word in words_of(local(iri)) if len(word) > 2
    )


@lru_cache(maxsize=4)
def heads(vocabulary: Vocabulary) -> Mapping[str, int]:
    """Return the bits of the classes whose names end in a word: ``plan`` of a task plan.

    Only the last word says what something is; ``next`` and ``seen`` in the names of classes do not.
    Relations that the upper ontology turned into classes, with an underscore, name no things.
    """
    bits: dict[str, int] = {}
    for iri, below in vocabulary.below.items():
        words = () if local(iri).startswith("_") else words_of(local(iri))
        if words and len(words[-1]) > 2:
            bits[words[-1]] = bits.get(words[-1], 0) | below
    return MappingProxyType(bits)


@lru_cache(maxsize=4)
def usual_kinds(vocabulary: Vocabulary) -> Mapping[str, int]:
    """Return the bits of the classes that variables of a name stand for in the questions.

    What people call ``?attempt`` is an attempt: where a pattern makes it something else, it is
    likely another pattern that was meant.
    """
    demands = Demands(vocabulary)
    usual: dict[str, int] = {}
    known = heads(vocabulary)
    for outline in _questions():
        for context in contexts(outline.body):
            for edge in context.own:
                for demand in demands.of(edge, context) or ():
                    name = demand.node.value
                    is_named = demand.node.kind == "variable" and name in known
                    is_named = is_named and not demand.is_of_terms
                    if is_named and demand.bits is not None:
                        usual[name] = usual.get(name, 0) | demand.bits
    return MappingProxyType(usual)


@lru_cache(maxsize=4)
def kinds_by_name(vocabulary: Vocabulary) -> Mapping[str, int]:
    """Return the bits of the classes that are called like a variable, in lower case."""
    usual: dict[str, int] = {}
    for iri, bits in vocabulary.below.items():
        for name in {local(iri).lower(), *vocabulary.labels.get(iri, ())}:
            key = name.replace(" ", "")
            usual[key] = usual.get(key, 0) | bits
    return MappingProxyType(usual)


@lru_cache(maxsize=4)
def usual_literals(vocabulary: Vocabulary) -> Mapping[str, frozenset[str]]:
    """Return the families of the literals that variables of a name stand for in the questions.

    Only names that never stand for a thing there, that are in the name of no class, and with
    which the name of a property ends: what ``?seen`` stands for depends on who writes it.
    """
    demands = Demands(vocabulary)
    named = {words[-1] for iri in vocabulary.properties if (words := words_of(local(iri)))}
    usual: dict[str, set[str]] = {}
    things = set(nouns(vocabulary))
    for outline in _questions():
        for context in contexts(outline.body):
            for edge in context.own:
                for demand in demands.of(edge, context) or ():
                    name = demand.node.value
                    if demand.node.kind != "variable" or len(name) < 3 or name.startswith(" "):
                        continue
                    if demand.is_thing:
                        things.add(name)
                    elif demand.is_thing is False:
                        kinds = {family(kind) for kind in demand.datatypes} or {""}
                        usual.setdefault(name, set()).update(kinds)
    return MappingProxyType(
        {
            name: frozenset(kinds)
            for name, kinds in usual.items()
            if name not in things | PREPOSITIONS and named.intersection(words_of(name))
        }
    )


@lru_cache(maxsize=1)
def usual_properties() -> Mapping[str, float]:
    """Return the weight of each property of the ontology's questions, from 0 to 1."""
    counts: Counter[str] = Counter()
    for outline in _questions():
        for group in outline.body.walk():
            counts.update(step.node.value for edge in group.edges for step in edge.steps)
    most = log1p(max(counts.values(), default=1))
    return MappingProxyType({iri: log1p(count) / most for iri, count in counts.items()})
