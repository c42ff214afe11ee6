"""Limits that words set, as the robots and things that they are about now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rtask.errors import TooLargeError, UnknownTermError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select
from rtask.tasks.goals import Aim
from rtask.tasks.language.meaning import Deed, Name
from rtask.tasks.language.patterns import exemplars_of
from rtask.tasks.language.ranking import with_chosen
from rtask.tasks.limits import MAX_LIMITED, Limits

__all__ = ["limits_of"]


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
    found: set[str] = set()
    for aim in aims:
        for row in select(f"{PREFIXES}{aim.sparql} LIMIT {MAX_LIMITED + 1}"):
            found.add(str(row.value(aim.variables[0])))
    if len(found) > MAX_LIMITED:
        raise TooLargeError(f"at most {MAX_LIMITED} things can be named as the only ones")
    return found
