"""Deeds as goals: which things, how many of them, and where to."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from rtask.errors import UsageError
from rtask.rdf.terms import Term
from rtask.tasks.actions import Select
from rtask.tasks.goals import LOCATED, Aim
from rtask.tasks.language.meaning import Condition, Deed, Phrase, Place, Quantity
from rtask.tasks.language.patterns import (
    EARLIER,
    HAND,
    destination,
    elsewhere,
    exemplars_of,
    fitting,
    places_of,
)
from rtask.tasks.language.ranking import measured, most, with_chosen

__all__ = ["STAYS", "aims_of", "holds"]

_TIE = 1e-9
STAYS = ": where it is now"
"""How the text of a goal ends whose things are to be where they are."""


def aims_of(select: Select, deed: Deed) -> Iterator[Aim]:
    """Yield the goals of a deed; none where what it says of a number holds already.

    Raises
    ------
    UsageError
        It cannot be said now which things are meant, or how many.
    """
    if deed.kind == "swap":
        yield from _swap(select, deed)
        return
    phrase, quantity = deed.phrase, deed.phrase.quantity
    conditions = with_chosen(select, replace(phrase, superlative=None))
    for left_out in phrase.left_out:
        # A colour that nobody has stated would leave nothing out, in silence.
        is_doubtful = left_out.is_described or len(left_out.heads) > 1
        if is_doubtful and not exemplars_of(select, with_chosen(select, left_out)):
            raise UsageError(f"which {left_out.text} is to be left out is not known")
    if deed.kind == "back":
        _require_earlier(select, phrase, conditions)
    if deed.kind == "away":
        assert deed.source is not None
        conditions += _at(deed.source)
    _require_single(select, deed)
    if phrase.superlative is not None:
        chosen = most(select, phrase, conditions)
        conditions = [f"VALUES ?thing {{ {' '.join(map(str, chosen))} }}"] if chosen else conditions
    where = [*conditions, _end(select, deed)]
    number, is_away = _number(select, deed, conditions)
    if is_away:
        assert deed.target is not None
        where = [*conditions, *_at(deed.target), elsewhere(places_of(deed.target))]
    if number == 0:
        return
    words = (quantity or _usual(phrase)).text
    yield Aim(
        LOCATED, " . ".join(where), number, f"{'then ' * bool(deed.stage)}{words} {_about(deed)}",
        deed.stage, phrase.others, _passing_end(deed, where),
    )  # fmt: skip


def _require_single(select: Select, deed: Deed) -> None:
    """Refuse "all but the one on the table" where two are there.

    Raises
    ------
    UsageError
        Which of several is to be left out is not said.
    """
    whole = replace(deed.phrase, left_out=(), superlative=None)
    for left_out in deed.phrase.left_out:
        is_single = left_out.is_definite and not left_out.is_plural and left_out.quantity is None
        if not is_single or left_out.superlative is not None:
            continue
        of = with_chosen(select, whole) + (_at(deed.source) if deed.source is not None else [])
        number = len(
            exemplars_of(select, of).keys() & exemplars_of(select, with_chosen(select, left_out))
        )
        if number > 1:
            raise UsageError(
                f"which {left_out.text} is to be left out is not said: the graph knows of {number}"
            )


def _passing_end(deed: Deed, where: Sequence[str]) -> str | None:
    """Return the end of a goal whose words mean other things once a part of it is done."""
    phrase = deed.phrase
    if deed.kind in ("back", "stay"):
        return ""
    kind = phrase.quantity.kind if phrase.quantity is not None else ""
    is_passing = phrase.places or phrase.superlative is not None or kind in (
        "share", "definite", "all_but",
    )  # fmt: skip
    left_out = any(item.places or item.superlative for item in phrase.left_out)
    is_there = deed.target is not None and deed.target.holds is not None
    if is_passing or left_out or is_there or deed.kind == "away" or kind in ("exactly", "at_most"):
        return where[-1]
    return None


def _require_earlier(select: Select, phrase: Phrase, conditions: Sequence[str]) -> None:
    """Refuse to put back things of which it is not known where they were.

    Raises
    ------
    UsageError
        Some were at one place alone as far as the graph knows; to pass over them would be silent.
    """
    things = exemplars_of(select, conditions)
    stated = exemplars_of(select, [*conditions, EARLIER])
    if len(stated) < len(things):
        raise UsageError(
            f"of {len(things) - len(stated)} of {len(things)} {phrase.text} it is not known where "
            "they were before"
        )


def _at(place: Place) -> list[str]:
    """Return the conditions that things are at a place now."""
    return list(fitting(Phrase(places=((place, False),)), "at"))


def _end(select: Select, deed: Deed) -> str:
    """Return the condition that a place is where a deed ends."""
    if deed.kind == "hold":
        return HAND
    if deed.kind == "back":
        return EARLIER
    if deed.kind == "stay":
        return "?thing rt:locatedOn ?place"
    if deed.kind == "away":
        assert deed.source is not None
        return elsewhere(places_of(deed.source))
    assert deed.target is not None
    holds_ = deed.target.holds
    held = with_chosen(select, holds_) if holds_ is not None else ()
    return destination(select, deed.target, held)


def _usual(phrase: Phrase) -> Quantity:
    """Return for how many things a phrase is meant that does not say so.

    The name of a product means all things of it.
    """
    is_kind = any(name.role("kind", "use") for name in phrase.heads)
    is_single = (is_kind or phrase.is_generic or phrase.is_elided) and not phrase.is_plural
    return Quantity("some", 1) if is_single else Quantity("all")


def _number(select: Select, deed: Deed, conditions: Sequence[str]) -> tuple[int | None, bool]:
    """Return for how many things a goal is, None for all; and whether they are to go elsewhere.

    Of "exactly two cups in the box" the third one goes elsewhere where three are there.
    """
    quantity = deed.phrase.quantity or _usual(deed.phrase)
    if deed.phrase.superlative is not None:
        return (int(quantity.number) if quantity.number else 1), False
    if quantity.total and len(exemplars_of(select, conditions)) != quantity.total:
        raise UsageError(
            f"the {quantity.total} {deed.phrase.text}: the graph knows of "
            f"{len(exemplars_of(select, conditions))}"
        )
    if quantity.kind == "all":
        return None, False
    if deed.phrase.is_definite and deed.phrase.quantity is None:
        things = exemplars_of(select, conditions)
        if len(things) > 1:
            raise UsageError(
                f"which {deed.phrase.text} is meant is not said: the graph knows of {len(things)}; "
                "name it, or say one, two or all"
            )
    if quantity.kind == "some":
        return int(quantity.number), False
    things = exemplars_of(select, conditions)
    if quantity.kind == "definite":
        if len(things) != quantity.number:
            raise UsageError(
                f"the {quantity.number:g} {deed.phrase.text}: the graph knows of {len(things)}"
            )
        return None, False
    if quantity.kind == "all_but":
        return _but(select, deed, conditions, things.keys()), False
    if quantity.kind == "share":
        number = len(things) * quantity.number
        if abs(number - round(number)) > _TIE:
            raise UsageError(
                f"{quantity.number * 100:.0f} % of {len(things)} {deed.phrase.text} is "
                f"{number:g}: say how many"
            )
        return round(number), False
    if deed.target is None or not all(name.role("place") for name in deed.target.names):
        raise UsageError(f"{deed.phrase.text!r}: exactly or at most how many is said of a place")
    there = len(things.keys() & exemplars_of(select, [*conditions, *_at(deed.target)]).keys())
    surplus = there - int(quantity.number)
    if surplus > 0:
        return surplus, True
    return (0 if quantity.kind == "at_most" else int(quantity.number)), False


def _but(select: Select, deed: Deed, conditions: Sequence[str], things: Collection[Term]) -> int:
    """Return how many "all but two" are.

    Raises
    ------
    UsageError
        There are not so many, or those that are to be left out are there already.
    """
    quantity = deed.phrase.quantity
    assert quantity is not None
    number = len(things) - int(quantity.number)
    if number < 1:
        raise UsageError(
            f"all but {quantity.number:g} {deed.phrase.text}: the graph knows of {len(things)}"
        )
    if deed.target is not None and all(name.role("place") for name in deed.target.names):
        there = exemplars_of(select, [*conditions, *_at(deed.target)]).keys()
        if len(there & set(things)) > number:
            raise UsageError(
                f"all but {quantity.number:g} {deed.phrase.text}: {len(there)} are there already; "
                f"say 'exactly {number}' if the others are to go elsewhere"
            )
    return number


def _swap(select: Select, deed: Deed) -> Iterator[Aim]:
    """Yield the goals that some things are where others are now, and those where these are."""
    assert deed.partner is not None
    sides = [_side(select, phrase) for phrase in (deed.phrase, deed.partner)]
    for (things, _), (_, place), phrase in (
        (sides[0], sides[1], deed.phrase), (sides[1], sides[0], deed.partner),
    ):  # fmt: skip
        rows = " ".join(f"({thing} {place})" for thing in sorted(things, key=str))
        yield Aim(
            LOCATED, f"VALUES (?thing ?place) {{ {rows} }}", None,
            f"{'then ' * bool(deed.stage)}all: {phrase.text}: swapped", deed.stage, end="",
        )  # fmt: skip


def _side(select: Select, phrase: Phrase) -> tuple[list[Term], Term]:
    matches = exemplars_of(select, with_chosen(select, phrase))
    places = {place for of in matches.values() for place in of}
    is_single = (phrase.quantity or _usual(phrase)) == Quantity("some", 1)
    if len(places) != 1 or not all(matches.values()) or (is_single and len(matches) != 1):
        raise UsageError(
            f"to swap {phrase.text!r}, it has to be clear which thing is meant and where it is; "
            f"the graph knows of {len(matches)} at {len(places)} places"
        )
    return list(matches), next(iter(places))


def _about(deed: Deed) -> str:
    """Return what a goal is about, and where that is to be, for people."""
    phrase = deed.phrase
    called = sum(len(kind.called) for head in phrase.heads if (kind := head.role("kind")))
    about = phrase.text if phrase.heads or phrase.is_described else (
        phrase.text.replace("things", "everything that has a place", 1)
    )  # fmt: skip
    about += f" (and {called} only called so)" if called else ""
    if deed.kind == "away":
        assert deed.source is not None
        return f"{about} at {deed.source.text}: elsewhere"
    if deed.kind == "stay":
        return about + STAYS
    ends = {"hold": "held", "back": "where it was before"}
    if deed.kind in ends:
        return f"{about}: {ends[deed.kind]}"
    assert deed.target is not None
    return f"{about}: at {deed.target.text}"


def holds(select: Select, condition: Condition) -> bool:
    """Return whether a condition holds now, as far as the graph knows.

    Raises
    ------
    UsageError
        Nobody has stated what it asks, so that it is not known.
    """
    if condition.is_empty:
        assert condition.place is not None
        return (not exemplars_of(select, _at(condition.place))) != condition.is_not
    assert condition.phrase is not None
    phrase, quality = condition.phrase, condition.quality
    quantity = phrase.quantity or (Quantity("all") if quality else Quantity("some", 1))
    is_no, bare = quantity.kind == "no", replace(phrase, quantity=None)
    fits = with_chosen(select, bare)
    all_ = exemplars_of(select, fits)
    if quality is None:
        return _is_count(len(all_), quantity) != condition.is_not
    those = exemplars_of(select, [*fits, *fitting(measured(select, quality), "quality")])
    if is_no or quantity.kind in ("some", "exactly", "at_most"):
        return _is_count(len(those), quantity) != condition.is_not
    if not all_:
        raise UsageError(f"the graph knows of no {phrase.text}, so that the condition is not known")
    rest = all_.keys() - those.keys()
    stated = exemplars_of(select, [*fits, *_is_stated(quality)]) if rest else {}
    if rest - stated.keys():
        raise UsageError(
            f"whether {phrase.text} is {quality.text} is not known: nobody has stated it"
        )
    if rest and those:
        raise UsageError(f"some of {phrase.text} are {quality.text} and some are not")
    return (not rest) != condition.is_not


def _is_count(number: int, quantity: Quantity) -> bool:
    return {
        "no": number == 0, "exactly": number == quantity.number,
        "at_most": number <= quantity.number, "definite": number == quantity.number,
    }.get(quantity.kind, number >= max(1, quantity.number))  # fmt: skip


def _is_stated(quality: Phrase) -> Iterator[str]:
    """Yield the conditions under which it is known that a thing is not as it should be."""
    if quality.colours:
        yield "?thing rt:exemplarOf/rt:hasColour ?known_colour"
    if quality.materials:
        yield "?thing rt:exemplarOf/rt:surfaceMaterial ?known_material"
    if quality.traits:  # heavy is derived from the mass; nobody states that a thing is not fragile
        heavy = all(name.text.lower() == "heavy" for names, _ in quality.traits for name in names)
        yield "?thing rt:exemplarOf/rt:effectiveMass ?known_mass" if heavy else "FILTER(false)"
    if quality.places:
        yield "?thing rt:locatedOn ?known_place"
