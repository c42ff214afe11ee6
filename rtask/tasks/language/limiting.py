"""Limits that words set, as the robots and things that they are about now."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rtask.errors import TooLargeError, UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode, Term
from rtask.tasks.actions import Select
from rtask.tasks.goals import Aim
from rtask.tasks.language.meaning import Deed, Name, Phrase, Quantity
from rtask.tasks.language.patterns import exemplars_of, places_of
from rtask.tasks.language.ranking import with_chosen
from rtask.tasks.limits import MAX_LIMITED, Limits

__all__ = ["OnlyUnclear", "limits_of", "only_limits"]


class OnlyUnclear(UsageError):
    """Whether what is there already is to stay, "only" does not say."""


def limits_of(select: Select, deeds: Sequence[Deed], aims: Sequence[Aim]) -> Limits:
    """Return the limits of a goal.

    Parameters
    ----------
    deeds
        Those that are limits.
    aims
        The goal itself: "nothing else" is what it is not about.

    Raises
    ------
    UnknownTermError
        What may not be touched is not known, so that nobody could keep to it.
    TooLargeError
        It is more than a goal can say.
    """
    limits = Limits()
    for deed in deeds:
        if deed.kind == "alone":
            limits |= Limits(by=_iris(deed.robots))
        elif deed.kind == "barred":
            limits |= Limits(not_by=_iris(deed.robots))
        elif deed.kind == "untouched":
            limits |= Limits(untouched=_untouched(select, deed))
        else:
            limits |= Limits(only_touch=tuple(sorted(_subjects(select, aims))))
    return limits


def only_limits(select: Select, deed: Deed, aims: Sequence[Aim]) -> Limits:
    """Return what "only the red cups" forbids: to do it with other cups.

    Parameters
    ----------
    aims
        The goals of the deed.

    Raises
    ------
    OnlyUnclear
        Others are there already: "only the cups in the box" may ask to take them out.
    """
    phrase = deed.phrase
    if not phrase.is_only:
        return Limits()
    meant = exemplars_of(select, with_chosen(select, replace(phrase, quantity=None)))
    is_of_kind = bool(phrase.heads) and (phrase.is_described or bool(phrase.places))
    # "Only the red cups" tells them from other cups, "only the cups" from everything else.
    kind = Phrase(heads=phrase.heads if is_of_kind else (), is_generic=True)
    others = {thing: at for thing, at in exemplars_of(select, with_chosen(select, kind)).items()
              if thing not in meant}  # fmt: skip
    if deed.kind == "put" and deed.target is not None and deed.target.names:
        _require_none_there(deed, others)
    if not is_of_kind:
        return Limits(only_touch=tuple(sorted(_subjects(select, aims))))
    return Limits(untouched=tuple(sorted(
        thing.value for thing in others if isinstance(thing, NamedNode)
    )))  # fmt: skip


def _require_none_there(deed: Deed, others: Mapping[Term, frozenset[Term]]) -> None:
    assert deed.target is not None
    if not all(name.role("place") for name in deed.target.names):
        return
    there = [thing for thing, at in others.items() if at.intersection(places_of(deed.target))]
    if there:
        place = deed.target.text
        about = replace(deed.phrase, is_only=False, quantity=Quantity("all")).text
        raise OnlyUnclear(
            f"{len(there)} other thing{'s are' if len(there) > 1 else ' is'} at {place} already: "
            f"say 'nothing but {about} may be left in {place}' if that is to go, or leave out "
            "'only' if it may stay"
        )


def _iris(robots: Sequence[Name]) -> tuple[str, ...]:
    mentions = [name.role("robot") for name in robots]
    return tuple(sorted(
        {term.value for mention in mentions if mention is not None for term in mention.terms
         if isinstance(term, NamedNode)}
    ))  # fmt: skip


def _untouched(select: Select, deed: Deed) -> tuple[str, ...]:
    phrase = replace(deed.phrase, quantity=None) if not deed.phrase.superlative else deed.phrase
    things = exemplars_of(select, with_chosen(select, phrase))
    if not things:
        raise UnknownTermError(
            f"the graph knows of no {phrase.text}, so that nothing could keep clear of it"
        )
    if len(things) > MAX_LIMITED:
        raise TooLargeError(f"at most {MAX_LIMITED} things can be kept untouched: say of fewer")
    return tuple(sorted(thing.value for thing in things if isinstance(thing, NamedNode)))


def _subjects(select: Select, aims: Sequence[Aim]) -> set[str]:
    """Return what goals are about."""
    subjects: set[str] = set()
    for aim in aims:
        for row in select(f"{PREFIXES}{aim.sparql} LIMIT {MAX_LIMITED + 1}"):
            subjects.add(str(row.value(aim.variables[0])))
    if len(subjects) > MAX_LIMITED:
        raise TooLargeError(f"at most {MAX_LIMITED} things can be named as the only ones")
    return subjects
