"""Clauses: deeds that share a verb, and what they leave to their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

from rtask.tasks.language.meaning import Deed, Phrase, Place, Quantity

__all__ = ["EVERYTHING", "Clause", "away_from", "clause_of", "deeds_of"]

EVERYTHING = Phrase(is_generic=True, is_plural=True, quantity=Quantity("all"))


@dataclass(frozen=True)
class Clause:
    """Deeds of one verb; open where they have neither a place nor another end yet.

    Parameters
    ----------
    is_open
        It says of things, but not what is to become of them.
    has_verb
        It begins with a verb of its own, so that its place is not that of the clause before.
    order
        "first" or "then" where it says so itself.
    takes
        It only says what to take: "take the can (and put it ...)".
    """

    deeds: tuple[Deed, ...]
    is_open: bool = False
    has_verb: bool = False
    order: str = ""
    takes: bool = False
    is_topic: bool = False


def deeds_of(
    kind: str, phrases: tuple[Phrase, ...], target: Place | None = None
) -> tuple[Deed, ...]:
    """Return a deed of a kind for each of some phrases."""
    return tuple(Deed(kind, phrase, target) for phrase in phrases)


def clause_of(kind: str, phrases: tuple[Phrase, ...], target: Place | None = None) -> Clause:
    """Return a clause with a verb of its own."""
    return Clause(deeds_of(kind, phrases, target), has_verb=True)


def away_from(phrases: tuple[Phrase, ...], source: Place) -> Clause:
    """Return the clause that things are to be anywhere but at a place."""
    return Clause(tuple(Deed("away", phrase, source=source) for phrase in phrases), has_verb=True)
