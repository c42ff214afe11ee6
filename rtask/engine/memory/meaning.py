"""Interpretation of the words of a request as classes, functions, colours and traits of objects.

"Bring me something to drink from" names a function, "a bottle" a class, and "a cup to drink from"
both, which must then both hold; so do all parts of "a fragile red carton". Words are compared by
their stems; several words mean the longest name that they contain.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from rtask.engine.networks.printed_words import objects_that_say
from rtask.engine.terms import folded
from rtask.kb.search.text import single_words
from rtask.rdf.namespaces import RT

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = ["Meaning", "Sense", "SenseKind", "meaning", "stems"]

SenseKind = Literal["class", "function", "colour", "trait", "print"]

_FILLERS = frozenset(
    re.findall(
        r"\w+",
        "a an the some something anything somewhat thing things object one ones bring fetch get "
        "give hand pass take grasp pick find show need want would like please me my us i you we "
        "to for with from out of in on at and or which that who is are it its up over here can "
        "say says",
    )
)
_MODAL = re.compile(r"\b(?:i|you|we|one|he|she|they|that|which|people|robot)\s+can\b")
_A_CAN = re.compile(r"\b(?:a|the|some|any|this|that|my|your|of)\s+(?:\w+\s+)?cans?\b|^cans?\b")
_MIN_PRINTED = 3
"""Letters of a word that is looked for on objects."""
_MAX_PRINTED = 300
_WORD = re.compile(r"[^\W_]+")


@dataclass(frozen=True)
class Sense:
    """A condition on the object: a class, a function, a colour, a trait, or a word on its print.

    Parameters
    ----------
    kind
        Which of these.
    terms
        IRIs, any of which fulfils the condition; of print, the objects on which it was read.
    words
        Words of the request.
    """

    kind: SenseKind
    terms: tuple[str, ...]
    words: str


@dataclass(frozen=True)
class Meaning:
    """Interpretation of a request.

    Parameters
    ----------
    senses
        Conditions that must all hold; empty if no word is known.
    ignored
        Words without a meaning.
    suggestions
        Names similar to unknown words.
    """

    senses: tuple[Sense, ...] = ()
    ignored: tuple[str, ...] = ()
    suggestions: tuple[str, ...] = ()

    def terms(self, kind: str) -> list[str]:
        """Return the IRIs of one kind of sense, in the order of the senses."""
        return [term for sense in self.senses if sense.kind == kind for term in sense.terms]


def stems(text: str) -> list[str]:
    """Return the stems of the significant words of a text.

    >>> stems("Bring me something that I can drink from, please"), stems("drinking vessels")
    (['drink'], ['drink', 'vessel'])
    >>> stems("a coke can"), stems("writing"), stems("write with")
    (['cok', 'can'], ['writ'], ['writ'])
    """
    plain = _MODAL.sub(" ", folded(text))
    is_can = _A_CAN.search(plain) is not None
    words: list[str] = _WORD.findall(plain)
    content_words = [
        w for w in words if w not in _FILLERS or (w == "can" and (is_can or len(words) == 1))
    ]
    return [_stem(word) for word in content_words]


def _stem(word: str) -> str:
    if word.endswith("ing") and len(word) > 5:
        word = word[:-3]
        if len(word) > 2 and word[-1] == word[-2] and word[-1] not in "ls":
            word = word[:-1]
    elif word.endswith("es") and len(word) > 4 and word[-3] in "sx":
        word = word[:-2]
    elif word.endswith("s") and not word.endswith("ss") and len(word) > 3:
        word = word[:-1]
    return word[:-1] if word.endswith("e") and len(word) > 3 else word


def meaning(context: Context, wish: str) -> Meaning:
    """Interpret a request: the IRI of a class or function, or words for one.

    Exact names come first, then names whose words begin with those of the request, then the
    results of full-text search in labels and comments.
    """
    classes = {c.iri.value: c.names for c in context.classes.all().values()}
    functions = context.functions.all()
    term = wish.strip().strip("<>")
    if term in classes:
        return Meaning((Sense("class", (term,), context.classes.get(term).label),))
    if term in functions:
        return Meaning((Sense("function", (term,), functions[term][0]),))
    named = [
        *_named("class", classes), *_named("function", functions),
        *_named("colour", context.colours.all()), *_named("trait", context.traits.all()),
    ]  # fmt: skip
    words = stems(wish)
    senses, left = _longest_names(named, words)
    printed, left = _printed(context, wish, left)
    senses += printed
    if not senses:
        senses = _searched(context, words, classes, functions)
        left = [] if senses else words
    if senses:
        return Meaning(tuple(senses), tuple(left))
    names = sorted({folded(name) for _, _, name, _ in named})
    near = difflib.get_close_matches(" ".join(words) or folded(wish), names, n=5, cutoff=0.6)
    return Meaning((), tuple(words), tuple(near))


_Named = tuple[SenseKind, str, str, tuple[str, ...]]


def _named(kind: SenseKind, names: Mapping[str, Iterable[str]]) -> Iterator[_Named]:
    """Yield (kind, IRI, name, its stems); the most general class is left out."""
    for term in sorted(names):
        for name in names[term]:
            name_stems = tuple(stems(name)) or (_stem(folded(name)),)
            if term != RT.ManipulableObject.value:
                yield kind, term, name, name_stems


def _longest_names(named: list[_Named], words: list[str]) -> tuple[list[Sense], list[str]]:
    """Return the senses of the longest names in the words, and the remaining words."""
    left, senses = list(words), []
    fits = [candidate for candidate in named if set(candidate[3]) <= set(words)]
    for length in sorted({len(candidate[3]) for candidate in fits}, reverse=True):
        taken: dict[tuple[SenseKind, frozenset[str]], list[_Named]] = {}
        for candidate in fits:
            if len(candidate[3]) == length and set(candidate[3]) <= set(left):
                taken.setdefault((candidate[0], frozenset(candidate[3])), []).append(candidate)
        for (kind, stems_of_name), same in taken.items():
            terms = tuple(dict.fromkeys(term for _, term, _, _ in same))
            senses.append(Sense(kind, terms, same[0][2]))
            left = [word for word in left if word not in stems_of_name]
    return senses, left


def _printed(context: Context, wish: str, left: list[str]) -> tuple[list[Sense], list[str]]:
    """Return the senses of words that mean nothing else and were read on objects, and the rest.

    What an object's print says is the word of whoever printed it: it names no kind and no use.
    """
    tokens = {token: _stem(token) for token in single_words(wish) if _stem(token) in left}
    long = [token for token in tokens if len(token) >= _MIN_PRINTED]
    objects_of = objects_that_say(context.kb, long, _MAX_PRINTED)
    senses = [Sense("print", objects, token) for token, objects in objects_of.items()]
    said = {tokens[token] for token in objects_of}
    return senses, [word for word in left if word not in said]


def _searched(
    context: Context,
    words: list[str],
    classes: Mapping[str, object],
    functions: Mapping[str, object],
) -> list[Sense]:
    """Return the results of full-text search as one sense."""
    if not words:
        return []
    text, phrase = " ".join(f"{word}*" for word in words), " ".join(words)
    for kind, classes_searched in (("function", functions), ("class", classes)):
        hits = context.kb.search(text, among=classes_searched, limit=len(classes_searched))
        terms = tuple(hit.subject.value for hit in hits)
        if terms:
            return [Sense("class" if kind == "class" else "function", terms, phrase)]
    return []
