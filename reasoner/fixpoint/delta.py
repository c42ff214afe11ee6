"""Small changes: a worklist over single facts, each new fact joined with what is known.

Semi-naive evaluation one fact at a time; nothing but the staged layer changes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

from reasoner.facts.equality import Equality, ranking
from reasoner.facts.layer import Layer
from reasoner.rules.rule import Rule, keys_of, solve
from reasoner.rules.strata import Program, Stratum
from reasoner.rules.work import ClosureTooLargeError
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import LITERAL, REFLEXIVE_PREDICATES, RESERVED, SAME, is_schema

log = logging.getLogger(__name__)


def too_large(most: int, terms: Dictionary, p: int) -> ClosureTooLargeError:
    """Return the error that names the bound and the property that broke it."""
    return ClosureTooLargeError(
        f"more than {most} facts follow; the last ones were about {terms.iri(p)}"
    )


class TooMuchWorkError(Exception):
    """Joining whole relations from nothing is quicker than going on fact by fact."""


class Derivation:
    """The insertion half of a stage: adds facts and all that follows to a layer.

    Attributes
    ----------
    budget : int or None
        Derivations after which `TooMuchWorkError` is raised.
    layer : Layer
        Staged facts, on representatives.
    equality : Equality
        Staged classes of equal terms.
    schema_changed : bool
        A fact arrived that changes the compiled rules.
    """

    def __init__(
        self,
        layer: Layer,
        equality: Equality,
        terms: Dictionary,
        is_asserted: Callable[[Fact], bool],
        max_facts: int,
    ) -> None:
        self.layer = layer
        self.equality = equality
        self.terms = terms
        self.schema_changed = False
        self._is_asserted = is_asserted
        self._max_facts = max_facts
        self.budget: int | None = None
        self._done = 0
        self._queue: list[Fact] = []
        self._program: Program | None = None

    def use(self, program: Program) -> None:
        """Put a program in force."""
        self._program = program
        if self.layer.work is not None:
            self.layer.work.use(program.rules)

    def insert(self, fact: Fact) -> None:
        """Add a fact and queue it; a sameAs fact merges its two ends instead."""
        s, p, o = fact
        if s >= LITERAL:
            return  # valid RDF only: a literal is no subject
        if p == SAME:
            self._merge(s, o)
            return
        if self.equality:
            s, p, o = self.equality.rewrite(fact)
        if s == o and p in REFLEXIVE_PREDICATES:
            return  # true of every class and property
        if self.layer.add(s, p, o):
            self._queue.append((s, p, o))
            if is_schema(p, o):
                self.schema_changed = True

    def evaluate(self, rules: Iterable[Rule]) -> None:
        """Fire rules on everything that holds, as when they are new."""
        for rule in rules:
            if rule.head is None:
                continue
            env = rule.environment()
            solutions = solve(self.layer, self.terms, rule.steps, env)
            for head in [rule.conclude(env) for _ in solutions]:
                self.insert(head)

    def trigger(self, stratum: Stratum, facts: Iterable[Fact]) -> None:
        """Fire a stratum's rules on facts of lower strata that were added."""
        for fact in facts:
            self._fire(stratum, fact)

    def take_queue(self) -> list[Fact]:
        """Return the facts that are queued, for somebody else to derive from."""
        queue, self._queue = self._queue, []
        return queue

    def run(self, stratum: Stratum) -> None:
        """Work the queue off: derive all that follows within a stratum."""
        queue = self._queue
        while queue:
            fact = queue.pop()
            if self.equality and not self.layer.has(*fact):
                continue  # rewritten since; the new form is queued
            self._fire(stratum, fact)
            if len(self.layer) > self._max_facts:
                raise too_large(self._max_facts, self.terms, fact[1])
            if self.budget is not None and self._done > self.budget:
                raise TooMuchWorkError

    def _fire(self, stratum: Stratum, fact: Fact) -> None:
        s, _, o = fact
        layer, queue, equality = self.layer, self._queue, self.equality
        for key in keys_of(fact):
            for a, p, b in stratum.projections.get(key, ()):
                a = s if a == -1 else o if a == -2 else a
                b = s if b == -1 else o if b == -2 else b
                if a >= LITERAL:
                    continue
                if equality:
                    a, p, b = equality.rewrite((a, p, b))
                if a == b and p in REFLEXIVE_PREDICATES:
                    continue
                if layer.add(a, p, b):
                    queue.append((a, p, b))
                    if is_schema(p, b):
                        self.schema_changed = True
            for trigger in stratum.triggers.get(key, ()):
                rule = trigger.rule
                instances = trigger.fire(layer, self.terms, fact)
                heads = [rule.conclude(env) for env in instances]
                self._done += len(heads)
                for head in heads:
                    self.insert(head)

    def _merge(self, left: int, right: int) -> None:
        """Make two terms one: rewrite the facts of the losing representative."""
        if left >= LITERAL or right >= LITERAL:
            return  # equal literals are equal already; others are found by the checks
        a, b = self.equality.find(left), self.equality.find(right)
        if a == b:
            return
        if a < RESERVED and b < RESERVED:
            log.warning("%s and %s are built in and not merged", *map(self.terms.iri, (a, b)))
            return
        assert self._program is not None
        winner, loser = sorted((a, b), key=lambda x: ranking(x, self.terms))
        self.equality.union(winner, loser)
        if loser in self._program.constants:
            log.info("%s is now %s: recompiling", self.terms.iri(loser), self.terms.iri(winner))
            self.schema_changed = True
        for fact in self.layer.about(loser):
            self.layer.discard(*fact)
            # Facts of higher strata rest on absences that the merge may fill: derive them again.
            if self._program.level(fact) == 0 or self._is_asserted(fact):
                self.insert(fact)
