"""What the names of variables say by themselves: a literal, a person, a whole or its part.

A name counts by its last word, as in ``?maxForce`` or ``?robot_name``; what comes before qualifies
it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

import ontology
from rtask.asking.check.naming.names import PREPOSITIONS, words_of
from rtask.asking.check.naming.usual import heads
from rtask.asking.check.syntax.outline import Edge
from rtask.asking.check.types import family
from rtask.asking.check.vocabulary import Vocabulary, local

__all__ = [
    "head_of", "is_identifying", "is_of_stacks", "is_process_named", "kinds_of_word",
    "leads_as_named", "literals_by_word", "physical_words", "rank_of", "rank_of_values",
]  # fmt: skip

_OWN = (ontology.NS, ontology.PREFIXES["cora"])
_PERSONS = {"who", "whom", "whose"}
_MOMENTS = {"when", "since", "until", "start", "begin", "end", "time"}
_ADJECTIVES = ("ed", "ing", "able", "ent", "al")
_PARTICIPLES = {"bound", "found", "held", "lost", "known", "seen", "done", "taken", "given",
                "built", "sent", "kept", "left", "made", "met", "put", "set", "won", "read",
                "written", "chosen", "said"}  # fmt: skip
_NO_NOUNS = {"", *_MOMENTS, *_PARTICIPLES}
_LOWER = {"part", "child", "kid", "piece", "inner", "content", "sub", "narrower", "member",
          "descendant", "leaf", "step", "copy", "exemplar", "instance", "load", "cargo", "below",
          "deeper", "subclass", "subtype", "under", "lower", "specific", "derived"}  # fmt: skip
_UPPER = {"whole", "parent", "outer", "super", "broader", "ancestor", "where", "place", "root",
          "base", "floor", "ground", "room", "spot", "location", "original", "prototype", "above",
          "beyond", "top", "anc", "sup", "superclass", "supertype", "upper", "higher", "general",
          "world", "source"}  # fmt: skip
_IN_BETWEEN = {"container", "surface", "holder", "support", "shelf", "table", "tray", "bottom",
               "desk", "bench", "slot", "product"}  # fmt: skip
"""What carries others, and may itself stand on something."""
_VERTICAL = {
    **dict.fromkeys(("top", "above", "upper", "higher"), -1),
    **dict.fromkeys(("bottom", "below", "under", "lower", "beneath", "underneath"), 1),
}
_TO_UPPER = {"parent", "ancestor", "located", "placed", "sub", "container", "exemplar"}
_ENTIRELY_TO_UPPER = {"wasDerivedFrom"}
_COUNTED = {"a", "b", "c"}
"""Letters that tell things of one kind apart; ``x`` and the like are measures of one."""
_OF_PROCESSES = {"action", "activity", "event", "process", "operation"}
_REFERENCES = {"iri", "uri", "node", "ref"}
"""How agents name what they mean to ask on about: ``?robot_iri``."""
_ABBREVIATED = {"bot": "robot", "cam": "camera", "img": "image", "obs": "observation",
                "obj": "object"}  # fmt: skip
_IDENTIFYING = {"name", "label", "id", "identifier", "code", "title", "kind", "type", "text"}


@lru_cache(maxsize=8192)
def head_of(name: str) -> str:
    """Return the word that says what a variable is, in the singular; empty for an abbreviation.

    >>> head_of("theRobots"), head_of("robot2"), head_of("robotA"), head_of("r")
    ('robot', 'robot', 'robot', '')
    >>> head_of("robot_iri"), head_of("depthCam")
    ('robot', 'camera')
    """
    words = [word for word in words_of(name.partition(" ")[0]) if not word.isdigit()]
    if len(words) > 1 and words[-1] in _COUNTED | _REFERENCES:
        words.pop()
    if not words or len(words[-1]) < 3 or words[-1] in PREPOSITIONS:
        return ""
    word = _ABBREVIATED.get(words[-1], words[-1])
    return word[:-1] if len(word) > 4 and word.endswith("s") and word[-2] not in "su" else word


def is_identifying(iri: str) -> bool:
    """Return whether a text of a property stands for the thing itself, as its name does."""
    words = words_of(local(iri))
    return bool(words) and words[-1] in _IDENTIFYING


@lru_cache(maxsize=4)
def literals_by_word(vocabulary: Vocabulary) -> Mapping[str, frozenset[str]]:
    """Return the families of the literals that a word stands for in the names of properties.

    Only words that name no class and end the name of no property between things. An adjective
    may stand for the thing that is so, as in ``?disputed``.
    """
    families: dict[str, set[str]] = {word: {"dateTime", "number", "text"} for word in _MOMENTS}
    others = set(heads(vocabulary))
    for iri, axioms in vocabulary.properties.items():
        word = head_of(local(iri))
        if axioms.relates_things is True:
            others.add(word)
        elif axioms.datatypes and word not in _NO_NOUNS and not word.endswith(_ADJECTIVES):
            kinds = {family(kind) for kind in axioms.datatypes}
            families.setdefault(word, set()).update(
                "dateTime" if kind.startswith("dateTime") else kind for kind in kinds
            )
    return MappingProxyType(
        {word: frozenset(kinds) for word, kinds in families.items() if word not in others}
    )


@lru_cache(maxsize=4)
def physical_words(vocabulary: Vocabulary) -> frozenset[str]:
    """Return the words that name what can be seen or done, and so is no number."""
    words = set()
    for iri in vocabulary.bit:
        if iri.startswith(_OWN) and any(
            local(kind) == "Physical" for kind in vocabulary.above[iri]
        ):
            word = head_of(local(iri))
            if len(word) > 4 or word == local(iri).lower():
                words.add(word)
    return frozenset(words)


@lru_cache(maxsize=4)
def agents(vocabulary: Vocabulary) -> int:
    """Return the bits of the classes of those who do something."""
    bits = 0
    for name in ("Agent", "Robot", "Human"):
        bits |= heads(vocabulary).get(name.lower(), 0)
    return bits


def is_process_named(name: str, bits: int | None, vocabulary: Vocabulary) -> bool:
    """Return whether a variable has a word for whatever goes on, and is in a class of that."""
    return head_of(name) in _OF_PROCESSES and "Process" in vocabulary.sorts(bits or 0)


def kinds_of_word(word: str, vocabulary: Vocabulary) -> int:
    """Return the bits of the classes that a word names by the last word of theirs."""
    if word in _PERSONS:
        return agents(vocabulary)
    return 0 if word in _UPPER | _IN_BETWEEN | _LOWER else heads(vocabulary).get(word, 0)


def rank_of(name: str, *, is_value: bool = True, is_stack: bool = False) -> int:
    """Return 1 for the name of a whole, -1 for that of a part, 0 for any other.

    A table is a whole for what stands on it, the value; as the subject it may be either. What is
    on top of a stack is carried by what is below, while the top of a hierarchy is its whole.

    >>> rank_of("parent"), rank_of("inner_part"), rank_of("robot")
    (1, -1, 0)
    >>> rank_of("top"), rank_of("top", is_stack=True)
    (1, -1)
    """
    word = head_of(name)
    if is_stack and word in _VERTICAL:
        return _VERTICAL[word]
    if word in _UPPER or (is_value and word in _IN_BETWEEN):
        return 1
    return -1 if word in _LOWER else 0


def is_of_stacks(iri: str) -> bool:
    """Return whether a property leads from what stands somewhere to what carries it."""
    return words_of(local(iri))[:1] in (("located",), ("placed",))


def rank_of_values(iri: str) -> int:
    """Return 1 for a property that leads from part to whole, -1 from whole to part, else 0.

    >>> [rank_of_values(ontology.NS + name) for name in ("subTaskOf", "hasSubTask", "mass")]
    [1, -1, 0]
    """
    words = words_of(local(iri))
    if local(iri) in _ENTIRELY_TO_UPPER:
        return 1
    if words[:1] == ("has",):
        return -1 if words[1:2] and words[1] in _TO_UPPER else 0
    return 1 if words and words[0] in _TO_UPPER else 0


def leads_as_named(edge: Edge) -> bool:
    """Return whether the names of a pattern's variables say that it leads the way it does.

    From a part to the whole, or from what stands on something to what carries it.
    """
    (step,) = edge.steps
    about, value = edge.ends[:: -1 if step.is_inverse else 1]
    upwards = rank_of_values(step.node.value)
    ranks = []
    stack = is_of_stacks(step.node.value)
    if about.kind == "variable":
        ranks.append(-upwards * rank_of(about.name, is_value=upwards < 0, is_stack=stack))
    if value.kind == "variable":
        ranks.append(upwards * rank_of(value.name, is_value=upwards > 0, is_stack=stack))
    return max(ranks, default=0) > 0 and min(ranks) >= 0
