"""Memo of what was derived from nothing, for a process that opens many knowledge bases.

A new knowledge base begins with the ontology that others began with. What follows depends on the
facts, the terms behind their ids, the rules and the bounds; all of them are compared, so nothing
can be outdated. Labels of blank nodes are not, as each knowledge base has its own: a derivation in
which a label was read, or could have made a difference, is not remembered. Nor is who owns a name,
which each knowledge base decides by its own base IRI: only facts among names of nobody are
remembered, about which all agree.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field

from pyoxigraph import NamedNode

from reasoner.facts.arrays import Column
from reasoner.facts.relations import Facts
from reasoner.rules.strata import Program
from reasoner.terms.dictionary import Dictionary, Fact, Term

__all__ = ["Memo", "Question"]

Owner = Callable[[str], str | None]
MAX_FACTS = 10_000
"""Larger derivations are not remembered: their memory is worth more than the time."""
_MAX_ENTRIES = 3


def has_owned(terms: Iterable[Term | None], owner: Owner | None) -> bool:
    """Tell whether any of some terms is a name that somebody owns."""
    if owner is None:
        return False
    return any(isinstance(term, NamedNode) and owner(term.value) is not None for term in terms)


@dataclass(frozen=True)
class Question:
    """All that a derivation from nothing depends on.

    Attributes
    ----------
    terms : tuple of Term or None
        By id, resources before literals; None for a blank node.
    resources : int
        How many of them are resources.
    settings : Hashable
        Rules of the user, and bounds.
    owner : callable, optional
        Returns the owner of an IRI, or None; not compared, as none of the terms has an owner.
    """

    facts: frozenset[Fact]
    terms: tuple[Term | None, ...]
    resources: int
    settings: Hashable
    owner: Owner | None = field(default=None, compare=False)

    @classmethod
    def of(
        cls,
        facts: frozenset[Fact],
        terms: Dictionary,
        settings: Hashable,
        owner: Owner | None = None,
    ) -> Question | None:
        """Return the question, or None if its answer would not be remembered."""
        listed = terms.listed() if len(facts) <= MAX_FACTS else None
        if listed is None or has_owned(listed[0], owner):
            return None
        return cls(facts, *listed, (settings, owner is None), owner)


@dataclass(frozen=True)
class Answer:
    """What follows.

    Attributes
    ----------
    new_terms : tuple of Term
        Terms that the rules brought, in the order of their ids.
    """

    columns: dict[int, Column]
    program: Program
    new_terms: tuple[Term, ...]


class Memo:
    """The last derivations of this process.

    Examples
    --------
    >>> terms = Dictionary()
    >>> question = Question.of(frozenset({(0, 1, 2)}), terms, "no rules")
    >>> memo = Memo()
    >>> memo.remember(question, Facts([(0, 1, 2), (0, 1, 3)]), Program(()), terms)
    >>> facts, program = memo.recall(question, Dictionary())
    >>> sorted(facts)
    [(0, 1, 2), (0, 1, 3)]
    """

    def __init__(self) -> None:
        self._entries: tuple[tuple[Question, Answer], ...] = ()

    def recall(self, question: Question, terms: Dictionary) -> tuple[Facts, Program] | None:
        """Return facts of the caller's own and the rules in force, or None if it is not known.

        Parameters
        ----------
        terms : Dictionary
            Receives the terms that the rules bring.
        """
        for earlier, answer in self._entries:
            # In the same order, so that terms get the ids that the facts are made of.
            if earlier == question and not has_owned(answer.new_terms, question.owner):
                for term in answer.new_terms:
                    terms.encode(term)
                return Facts.of(answer.columns), answer.program
        return None

    def remember(
        self, question: Question, facts: Facts, program: Program, terms: Dictionary
    ) -> None:
        """Keep an answer, in place of the oldest if there are too many."""
        listed = terms.listed()
        # The next knowledge base has another label there, which may decide what follows.
        if listed is None or terms.has_read_label:
            return
        now, resources = listed
        literals = len(question.terms) - question.resources
        # Resources are listed before literals: new ones stand in the middle and at the end.
        new = (*now[question.resources : resources], *now[resources + literals :])
        if None in new:
            return  # a blank node: the next one would have to be another
        if has_owned(new, question.owner):
            return
        answer = Answer(facts.columns(), program, tuple(term for term in new if term is not None))
        self._entries = ((question, answer), *self._entries[: _MAX_ENTRIES - 1])
