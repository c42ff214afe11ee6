"""What is said of goals that are not understood, or that nothing in the graph fits."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import replace

from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select
from rtask.tasks.language.aims import aims_of
from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import ADJECTIVES, CLASSES, GRASP, NUMBERS, PUT
from rtask.tasks.language.meaning import Deed
from rtask.tasks.language.patterns import exemplars_of
from rtask.tasks.language.ranking import with_chosen
from rtask.tasks.names import names_of

__all__ = ["names_in", "not_understood", "why_void"]

_MAX_NAMES = 500
_MAX_LISTED = 6
_NEAR = 0.6
"""Below this, a name that is called near has no more than letters in common."""
_AT_PLACES = (
    "a goal brings things to places that have a name, into hands, and away from places: say 'the "
    "pen where the jug is' for the same place, and 'the cup nearest to the jug' for one of several"
)
_BEYOND = {
    **dict.fromkeys(
        ("next to", "beside", "between", "near", "behind", "in front of", "left of", "right of",
         "alongside", "underneath"), _AT_PLACES),
    **dict.fromkeys(
        ("nearest", "closest", "farthest", "furthest"),
        "to what is not said, or not where it is understood: say 'the cup nearest to panda-1 into "
        "the left box', with a thing, robot or place by its name"),
    **dict.fromkeys(
        ("my", "your", "his", "her", "their", "mine", "yours"),
        "whose a thing is the graph does not say: name it, or say what it is like"),
    **dict.fromkeys(
        ("without", "do not", "never", "avoid"),
        "what may not be done is understood of things that are not to be touched and of robots: "
        "say 'without touching the jug', 'don't use nao-1' or 'keep everything else where it is' "
        "beside what is to be done, or how things are to be in the end: 'leave the jug where it "
        "is'"),
    **dict.fromkeys(
        ("until", "till", "as long as", "whenever", "while"),
        "what lasts or comes again is no goal, nor is how full a place is: say how many things, or "
        "how they are to be in the end"),
    **dict.fromkeys(
        ("carefully", "gently", "slowly", "quickly", "fast", "quietly", "straight"),
        "how a robot moves is no part of a goal: leave it out"),
}  # fmt: skip
"""Words that no goal has, with what to say instead."""
_VOCABULARY = frozenset().union(*CLASSES.values(), PUT, GRASP, ADJECTIVES, NUMBERS)


def names_in(select: Select) -> set[str]:
    """Return names of things, places and robots, and of kinds of things."""
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?name WHERE {{ {{ ?x rt:name ?name . "
        "{ ?x a rt:ManipulableObject } UNION { ?x a rt:SupportSurface } UNION { ?x a cora:Robot } "
        "} UNION { ?k rdfs:subClassOf+ rt:ManipulableObject ; rdfs:label ?name } } "
        f"LIMIT {_MAX_NAMES}"
    )
    return {str(row.value("name")) for row in rows}


def not_understood(select: Select, items: Items, names: set[str]) -> UsageError | UnknownTermError:
    """Return an error about the word at which reading has stopped.

    Parameters
    ----------
    names
        Of what there is in the graph.
    """
    at = items.stopped
    word = items.word(at)
    listed = _listed(items)
    spoken = f" {' '.join(items.words)} "
    beyond = next((words for words in _BEYOND if f" {words} " in spoken), "")
    if beyond:
        return UsageError(f"{beyond!r}: {_BEYOND[beyond]}; understood: {listed}")
    if items.furthest >= len(items):
        return UsageError(
            f"{items.text(0, len(items))!r} does not say where to, or not clearly; understood: "
            f"{listed}; a goal is such as 'every cup into the left box'"
        )
    places = _places(select, word) if _is_for_place(items, at) else ""
    covered = {at for name in items.named
               for at in range(name.mentions[0].start, name.mentions[0].end)}  # fmt: skip
    if at in covered or word in _VOCABULARY or not word.isalpha():
        where = f"after {items.text(0, at)!r} " if at else "at the beginning "
        return UsageError(
            f"{word!r} {where}is not understood where it stands{_advice(items, at)}; understood: "
            f"{listed}{places}"
        )
    near = difflib.get_close_matches(word, sorted(names), n=3, cutoff=_NEAR)
    hint = f"; the nearest names are {', '.join(near)}" if near else ""
    return UnknownTermError(
        f"{word!r} means nothing here in a goal and is no name in the graph{hint}; understood: "
        f"{listed}{places}"
    )


def _advice(items: Items, at: int) -> str:
    """Return what to say instead of a word that does not fit."""
    if items.word(at).endswith(("'s", "\u2019s")):
        return f": {_BEYOND['my']}"
    robots = [name for name in items.named if name.role("robot") is not None]
    is_after_robot = any(m.start <= at <= m.end for name in robots for m in name.mentions)
    how = ": who is to do it is said of the whole goal, as in 'nao-1 should put ...', or left out"
    return how if is_after_robot else ""


def _is_for_place(items: Items, at: int) -> bool:
    """Return whether a word stands where a place is named: "into the attic"."""
    before = at - 1
    while items.word(before) in CLASSES["DET"] | {"a", "an"}:
        before -= 1
    return items.word(before) in CLASSES["INTO"] | CLASSES["AT"] | CLASSES["OFF"]


def _places(select: Select, word: str) -> str:
    """Return the names of places, those first that are like a word."""
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?name WHERE {{ ?x a rt:SupportSurface ; rt:name ?name }} "
        f"LIMIT {_MAX_NAMES}"
    )
    names = sorted({str(row.value("name")) for row in rows})
    if not names:
        return "; the graph knows of no place by name"
    near = [
        name
        for name in names
        if difflib.get_close_matches(word, name.lower().split(), n=1, cutoff=_NEAR)
    ]
    order = [*near, *(name for name in names if name not in near)]
    more = f" and {len(order) - _MAX_LISTED} more" if len(order) > _MAX_LISTED else ""
    return f"; places are {', '.join(order[:_MAX_LISTED])}{more}"


def _listed(items: Items) -> str:
    named = [f"{m.text!r} ({m.role})" for name in items.named for m in name.mentions]
    return ", ".join(dict.fromkeys(named)) or "nothing"


def why_void(select: Select, deeds: Sequence[Deed]) -> Iterator[str]:
    """Yield in words what of some deeds the graph does not know: the things, or where to."""
    for deed in deeds:
        if deed.kind == "swap":  # says by itself what is not clear
            continue
        if all(select(f"{PREFIXES}{aim.sparql} LIMIT 1") for aim in aims_of(select, deed)):
            continue
        phrase = replace(deed.phrase, superlative=None)
        if exemplars_of(select, with_chosen(select, phrase)):
            # A place that nobody knows by this name never gets so far: its word is refused.
            yield _endless(deed)
            continue
        elsewhere = exemplars_of(select, with_chosen(select, replace(phrase, places=())))
        at = {
            place.value
            for places in elsewhere.values()
            for place in places
            if isinstance(place, NamedNode)
        }
        names = sorted(names_of(select, at).values())[:_MAX_LISTED] if phrase.places else []
        where = f", only at {' and '.join(names)}" if names else ""
        yield f"the graph knows of no {phrase.text}{where}"


def _endless(deed: Deed) -> str:
    """Return why there is no place where a deed could end."""
    target = deed.target
    if target is not None and target.names and not target.names[0].role("place"):
        owners = " or ".join(name.text for name in target.names)
        return (
            f"no hand of {owners} is stated (rt:hasEndEffector), so that nothing can be given to it"
        )
    if target is not None and target.owner is not None:
        return f"that {target.owner.text} reaches {target.names[0].text} is not known (rt:reaches)"
    if deed.kind == "hold":
        return "no hand of any robot is stated (rt:hasEndEffector)"
    of = deed.source.text if deed.source is not None else deed.phrase.text
    return f"{of}: no place is known where that could go (rt:reaches)"
