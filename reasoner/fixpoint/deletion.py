"""Retraction by over-deletion and re-derivation (DRed; Gupta, Mumick and Subrahmanian 1993).

First everything that has a derivation through a retracted fact goes, then what has another
derivation comes back. Strata above the lowest also lose what rests on a filled absence. A class of
equal terms that may have lost a reason is taken apart, all that is known of its members goes, and
what was asserted of each comes back under its own name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from reasoner.facts.equality import Equality
from reasoner.facts.layer import Layer
from reasoner.rules.rule import Bindings, Rule, bind, keys_of, solve
from reasoner.rules.strata import AbsenceTrigger, Program, Stratum
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import LITERAL, SAME, TYPE, is_schema

REBUILD_RATIO, REBUILD_FROM = 10, 20_000
"""Deleting more than so many facts, and one in ten, costs more than deriving everything again."""


class CannotRetractError(Exception):
    """The closure has to be rebuilt: the retraction reaches the schema, or too far."""


class Retraction:
    """The deletion half of a stage.

    Parameters
    ----------
    layer : Layer
        Staged facts; its base is the state before the stage.
    equality : Equality
        Classes of equal terms before the stage.
    is_asserted : callable
        Whether a fact on representatives is still asserted after the stage.
    may_split : bool
        Whether equalities are derived in the strata at hand; above them they are settled.

    Attributes
    ----------
    split : dict of int to None
        Representatives of the classes to be taken apart.
    """

    def __init__(
        self,
        layer: Layer,
        equality: Equality,
        terms: Dictionary,
        program: Program,
        is_asserted: Callable[[Fact], bool],
        may_split: bool,
    ) -> None:
        self._layer = layer
        self._equality = equality
        self._terms = terms
        self._program = program
        self._is_asserted = is_asserted
        self._may_split = may_split
        self.split: dict[int, None] = {}
        self._gone: dict[Fact, None] = {}
        self._queue: list[Fact] = []

    def over_delete(self, stratum: Stratum, retracted: Iterable[Fact]) -> list[Fact]:
        """Remove from the layer what may rest on retracted facts or changes of lower strata.

        Returns
        -------
        list of Fact
            What was removed and may have to come back.

        Raises
        ------
        CannotRetractError
            If a schema fact or too much is among it.
        """
        for fact in retracted:
            if fact[1] == SAME:
                self._split(fact[0])
            else:
                self._delete(fact)
        # Delete first whatever may rest on what goes, then bring back what has another derivation:
        # facts that derive each other in a circle would hold each other up for ever (DRed; Gupta,
        # Mumick and Subrahmanian 1993).
        for fact in tuple(self._layer.removed):
            self._follow(stratum, fact)
        either = _either(self._layer)
        for trigger, fact in list(_touched(stratum, self._layer, against=True)):
            for conclusion in list(trigger.held(either, self._terms, fact)):
                self._delete(conclusion)
        limit = max(REBUILD_FROM, len(self._layer.base) // REBUILD_RATIO)
        while self._queue:
            self._follow(stratum, self._queue.pop())
            self._count(1)
            if len(self._gone) > limit:
                raise CannotRetractError(f"more than {limit} facts may be gone")
        for fact in self._gone:
            self._layer.discard(*fact)
        return list(self._gone)

    def _count(self, candidates: int) -> None:
        if self._layer.work is not None:
            self._layer.work.count(candidates)

    def _delete(self, fact: Fact) -> None:
        s, p, o = fact
        if fact in self._gone or not self._layer.base.has(s, p, o):
            return
        merged = [x for x in fact if self._equality.is_merged(x)] if self._may_split else []
        # What is asserted needs no derivation.
        if not merged and self._is_asserted(fact):
            return
        if is_schema(p, o):
            raise CannotRetractError("a schema fact is retracted")
        self._gone[fact] = None
        self._queue.append(fact)
        # Equal terms may owe their equality to this very form of the fact, even if another is kept.
        for term in merged:
            self._split(term)

    def _split(self, term: int) -> None:
        """Take a class apart: all facts about it go."""
        representative = self._equality.find(term)
        if representative in self.split or not self._equality.is_merged(term):
            return
        self.split[representative] = None
        # Rules were compiled with the representative in the place of each member.
        if not self._program.constants.isdisjoint(self._equality.members(term)):
            raise CannotRetractError("a term of the schema may lose an equal one")
        for fact in self._layer.base.about(representative):
            self._delete(fact)

    def _follow(self, stratum: Stratum, fact: Fact) -> None:
        """Delete the heads of all rule instances that used a fact before the stage."""
        s, _, o = fact
        base = self._layer.base
        for key in keys_of(fact):
            for a, p, b in stratum.projections.get(key, ()):
                a = s if a == -1 else o if a == -2 else a
                b = s if b == -1 else o if b == -2 else b
                # No literal is a subject: the rule concluded nothing there.
                if a < LITERAL:
                    self._delete((a, p, b))
            for trigger in stratum.triggers.get(key, ()):
                rule = trigger.rule
                assert rule.head is not None
                if rule.head.p == SAME:
                    # On representatives the two are one already, so conditions tell nothing.
                    for env in trigger.unconditional(base, self._terms, fact):
                        self._count(1)
                        self._split(rule.conclude(env)[0])
                    continue
                # Of a latest or a best one it is cheaper to ask for the conclusion than to search.
                is_easy = bool(rule.absences) and trigger.is_bound_by_atoms
                fire = trigger.unconditional if is_easy else trigger.fire
                for env in fire(base, self._terms, fact):
                    self._count(1)
                    self._delete(rule.conclude(env))

    def is_derivable(self, fact: Fact) -> bool:
        """Tell whether a rule derives a fact in one step from what the layer holds now."""
        for rule in self._program.rules_for(fact):
            assert rule.head is not None
            env = rule.environment()
            if bind(rule.head, fact, self._terms, env) and any(
                rule.conclude(bindings) == fact
                for bindings in solve(self._layer, self._terms, rule.backward_steps(fact), env)
            ):
                return True
        return False


def candidates(
    stratum: Stratum, layer: Layer, terms: Dictionary
) -> Iterator[tuple[Bindings, Rule]]:
    """Yield bindings of rules for which the layer's changes speak by their NOT EXISTS groups.

    Matched on what held before or holds now, so that no candidate is missed.
    """
    if not stratum.absences:
        return
    either = _either(layer)
    for trigger, fact in list(_touched(stratum, layer, against=False)):
        for env in list(trigger.candidates(either, terms, fact)):
            yield env, trigger.rule


def _either(layer: Layer) -> Layer:
    """Return what held before or holds now."""
    either = Layer(layer.base)
    either.work = layer.work
    either.added = layer.added
    return either


def _touched(
    stratum: Stratum, layer: Layer, against: bool
) -> Iterator[tuple[AbsenceTrigger, Fact]]:
    """Yield changes inside NOT EXISTS groups that speak against, or for, the rule around them."""
    absences = stratum.absences
    if not absences:
        return
    # Few properties occur in such groups: to ask each fact took a twentieth of a small commit.
    has_classes = any(key < 0 for key in absences)
    for facts, is_added in ((layer.added, True), (layer.removed, False)):
        for p in facts.predicates():
            if p not in absences and not (has_classes and p == TYPE):
                continue
            for s, o in facts.pairs(p):
                for key in keys_of((s, p, o)):
                    for trigger in absences.get(key, ()):
                        if (trigger.is_negative is is_added) is against:
                            yield trigger, (s, p, o)
