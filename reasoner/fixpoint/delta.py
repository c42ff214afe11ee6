"""Small changes: a worklist over single facts, each new fact joined with what is known.

Semi-naive evaluation one fact at a time; nothing but the staged layer changes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

from reasoner.facts.equality import Equality, ranking
from reasoner.facts.layer import Layer
from reasoner.fixpoint.ownership import Ownership
from reasoner.rules.rule import Rule, keys_of, solve
from reasoner.rules.strata import Program, Stratum
from reasoner.rules.work import ClosureTooLargeError
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import LITERAL, REFLEXIVE_PREDICATES, RESERVED, SAME, is_schema

log = logging.getLogger(__name__)


_REWRITTEN_WORK = 10
"""Candidates that moving a fact to another representative counts as."""


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
    max_facts : int
        Bound on the facts of the layer.
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
        is_new: Callable[[Fact], bool],
        allowed: int | None = None,
        ownership: Ownership | None = None,
    ) -> None:
        self.layer = layer
        self.equality = equality
        self.terms = terms
        self.schema_changed = False
        self._is_asserted = is_asserted
        self.max_facts = max_facts
        self._is_new = is_new
        self._allowed = allowed
        self._ownership = ownership or Ownership(None, terms)
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
            if len(self._queue) > self.max_facts:
                raise self.refusal(p)

    def refusal(self, p: int) -> ClosureTooLargeError:
        """Return the error for more facts than may follow, the last of them about a property.

        It names a rule that derives such facts: rather one of an axiom of this change, or one that
        goes on from what it derives.
        """
        rules = self._program.rules if self._program is not None else ()
        makers = [rule for rule in rules if rule.head is not None and rule.head.p == p]

        def rank(rule: Rule) -> tuple[bool, bool]:
            is_new = any(map(self._is_new, rule.because))
            return not is_new, not any(atom.p == p for atom in rule.body)

        if not any(any(map(self._is_new, rule.because)) for rule in makers):
            makers += [rule for rule in rules if any(map(self._is_new, rule.because))]
        maker = min(makers, key=rank, default=None)
        new = [] if maker is None else [*filter(self._is_new, maker.because)]
        axiom = next(iter(new or (maker.because if maker is not None else ())), None)
        allowed = self._allowed
        most = f"{self.max_facts} facts follow"
        message = most if allowed is None else f"{allowed} facts follow from this change"
        message = f"more than {message}; the last ones were about {self.terms.iri(p)}"
        statement = None if axiom is None else self.terms.decode_fact(axiom)
        if maker is not None:
            message += f", derived by the rule {maker.name}"
        if statement is not None:
            message += f" from the statement {' '.join(map(str, statement))}"
        return ClosureTooLargeError(
            message,
            rule=None if maker is None else maker.name,
            statement=statement,
            limit=self.max_facts if allowed is None else allowed,
        )

    def evaluate(self, rules: Iterable[Rule]) -> None:
        """Fire rules on everything that holds, as when they are new."""
        for rule in rules:
            if rule.head is None:
                continue
            env = rule.environment()
            solutions = solve(self.layer, self.terms, rule.steps, env)
            for head in self._permitted(rule, [rule.conclude(env) for _ in solutions]):
                self.insert(head)

    def _permitted(self, rule: Rule, heads: list[Fact]) -> list[Fact]:
        """Return the conclusions of a rule, of a key only those that its values can tell."""
        if not heads or not self._ownership.asks(rule):
            return heads
        equality, may_merge = self.equality, self._ownership.may_merge
        return [(s, p, o) for s, p, o in heads if may_merge(equality, s, o)]

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
        queue, work = self._queue, self.layer.work
        while queue:
            fact = queue.pop()
            if self.equality and not self.layer.has(*fact):
                continue  # rewritten since; the new form is queued
            self._fire(stratum, fact)
            if len(self.layer) > self.max_facts:
                raise self.refusal(fact[1])
            if work is not None:
                work.count(1)
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
                heads = self._permitted(rule, [rule.conclude(env) for env in instances])
                if layer.work is not None:
                    layer.work.count(len(heads))
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
        work = self.layer.work
        if work is not None:
            work.count(len(self.equality.members(a)) + len(self.equality.members(b)))
        if self._ownership.join(self.equality, winner, loser):
            # With more owners, keys may tell more of what was known.
            self._queue += self.layer.about(winner)
        self.equality.union(winner, loser)
        if loser in self._program.constants:
            log.info("%s is now %s: recompiling", self.terms.iri(loser), self.terms.iri(winner))
            self.schema_changed = True
        about = self.layer.about(loser)
        if work is not None:
            work.count(_REWRITTEN_WORK * len(about))
        for fact in about:
            self.layer.discard(*fact)
            # Facts of higher strata rest on absences that the merge may fill: derive them again.
            if self._program.level(fact) == 0 or self._is_asserted(fact):
                self.insert(fact)
