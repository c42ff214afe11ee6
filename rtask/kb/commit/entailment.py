"""Answers to the question whether statements follow from the graph."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from pyoxigraph import Triple

from rtask.errors import TooLargeError, UsageError
from rtask.rdf.terms import Subject, Term, TripleKey, stored, written

__all__ = ["MAX_STATEMENTS", "Entailment", "as_triples"]

MAX_STATEMENTS = 200_000


@dataclass(frozen=True)
class Entailment:
    """Whether statements follow, and why or what is missing.

    Parameters
    ----------
    answer
        ``None`` if the reasoner cannot decide it.
    proofs
        :class:`reasoner.Proof` of each statement that was found.
    missing, undecided
        Statements that do not follow, and those that could not be decided.
    contradictory
        Whether the graph contradicts itself, so that everything follows.
    name
        Returns the short name of a term.
    budget
        Steps that the reasoner was given.
    is_spent
        Whether they did not suffice, so that a larger budget may decide more.
    """

    answer: bool | None
    proofs: tuple[Any, ...]
    missing: tuple[TripleKey, ...]
    undecided: tuple[TripleKey, ...]
    contradictory: bool
    name: Callable[[Term], str]
    budget: int
    is_spent: bool

    @classmethod
    def of(cls, decision: Any, name: Callable[[Term], str], budget: int) -> Entailment:
        """Return the answer of :func:`reasoner.entails` with names for its terms."""
        return cls(
            decision.answer,
            decision.proofs,
            decision.missing,
            decision.undecided,
            decision.is_inconsistent,
            name,
            budget,
            decision.is_spent,
        )

    def words(self, triple: TripleKey) -> str:
        """Return a statement with short names."""
        return " ".join(map(self.name, triple))

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as JSON-able values, with terms in N-Triples syntax."""
        return {
            "entailed": self.answer,
            "contradictory": self.contradictory,
            "proofs": [proof.to_dict() for proof in self.proofs],
            "missing": [[written(term) for term in triple] for triple in self.missing],
            "undecided": [[written(term) for term in triple] for triple in self.undecided],
            "budget": self.budget,
            "is_spent": self.is_spent,
        }


def as_triples(conclusion: Iterable[tuple[Subject, Any, Term]]) -> list[TripleKey]:
    """Return statements in the form in which the store keeps them.

    Raises
    ------
    UsageError
        A statement contains a triple term, which the reasoner does not read.
    TooLargeError
        There are too many statements.
    """
    triples: list[TripleKey] = []
    for subject, predicate, value in conclusion:
        if isinstance(subject, Triple) or isinstance(value, Triple):
            raise UsageError("a triple term does not follow from anything; ask for its parts")
        triples.append((subject, predicate, stored(value)))
    if len(triples) > MAX_STATEMENTS:
        raise TooLargeError(
            f"{len(triples)} statements, at most {MAX_STATEMENTS} are allowed",
            limit="statements",
            value=len(triples),
            allowed=MAX_STATEMENTS,
        )
    return triples
