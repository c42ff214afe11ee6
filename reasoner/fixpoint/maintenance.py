"""Keep a closure current: stratum by stratum, deletions before insertions; or all from scratch."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from reasoner.facts.equality import Equality
from reasoner.facts.layer import Asserted, Layer
from reasoner.facts.relations import Facts
from reasoner.fixpoint.bulk import Bulk
from reasoner.fixpoint.checks import (
    LISTED,
    Inconsistency,
    find_all,
    find_equal,
    find_ill_typed,
    find_new,
)
from reasoner.fixpoint.deletion import CannotRetractError, Retraction, candidates
from reasoner.fixpoint.delta import Derivation, TooMuchWorkError
from reasoner.fixpoint.memo import Memo, Question
from reasoner.fixpoint.ownership import Ownership
from reasoner.rules.compile import compile_lists, compile_schema
from reasoner.rules.rule import Rule, solve
from reasoner.rules.schema import CLOSING_RULES, SchemaProblem
from reasoner.rules.strata import Program, Stratum
from reasoner.rules.user_rules import LabelledRule, compile_rule
from reasoner.rules.work import ChangeBudget, Work
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import SAME, is_schema

log = logging.getLogger(__name__)

REDUCED = frozenset({"cax-sco", "prp-spo1", "prp-dom", "prp-rng"})
"""Rules that may vanish when the schema grows, because others then imply them."""

WORTH_A_REBUILD = 100_000
"""Derivations of one change, above one for each asserted fact, after which a rebuild is quicker."""

REBUILD_RATIO = 10
"""From nothing, whole relations are joined from so many times fewer facts on than for a change."""

BULK_RATIO = 8
"""A change of more than one part in so many is quicker derived from nothing, by whole relations."""

_MEMO = Memo()


@dataclass(frozen=True)
class Settings:
    """Configuration of maintenance."""

    max_facts: int
    max_joins: int
    bulk_from: int
    keep_ill_typed: bool
    user_rules: tuple[str | LabelledRule, ...]
    budget: ChangeBudget | None = None
    owner: Callable[[str], str | None] | None = None


@dataclass
class State:
    """Everything that a commit may change."""

    asserted: Facts = field(default_factory=Facts)
    facts: Facts = field(default_factory=Facts)
    equality: Equality = field(default_factory=Equality)
    program: Program = field(default_factory=lambda: Program(CLOSING_RULES))
    problems: tuple[SchemaProblem, ...] = ()
    clashes: dict[object, Inconsistency] = field(default_factory=dict)


@dataclass
class Draft:
    """A staged successor of a state.

    Attributes
    ----------
    asserted : Asserted
        With the staged changes.
    layer : Layer
        Over the facts of the state, or over nothing after a rebuild.
    """

    asserted: Asserted
    layer: Layer
    equality: Equality
    program: Program
    problems: tuple[SchemaProblem, ...]
    clashes: dict[object, Inconsistency] = field(default_factory=dict)
    is_rebuilt: bool = False

    @property
    def size(self) -> int:
        """Number of facts, asserted and derived, that come or go."""
        asserted, layer = self.asserted, self.layer
        return sum(
            len(facts) for facts in (asserted.added, asserted.removed, layer.added, layer.removed)
        )

    @property
    def net(self) -> int:
        """How many facts more there are; of what was not derived from nothing."""
        return len(self.layer.added) - len(self.layer.removed)

    def apply_to(self, state: State) -> None:
        """Make the draft the state."""
        self.asserted.apply()
        self.layer.apply()
        state.facts = self.layer.base
        state.equality, state.program = self.equality, self.program
        state.problems, state.clashes = self.problems, self.clashes


class Maintainer:
    """Drafts successors of a state."""

    def __init__(self, terms: Dictionary, settings: Settings) -> None:
        self.terms = terms
        self.settings = settings
        self.ownership = Ownership(settings.owner, terms)

    def draft(
        self,
        state: State,
        asserted: Asserted,
        former_rules: tuple[str | LabelledRule, ...] | None = None,
    ) -> Draft:
        """Return the state after a change of what is asserted; the state itself stays.

        Parameters
        ----------
        former_rules : tuple, optional
            The users' rules behind the state, where the settings hold others.
        """
        size = len(asserted.added) + len(asserted.removed)
        if former_rules is not None and (size or set(former_rules) - set(self.settings.user_rules)):
            return self.rebuild(asserted, len(state.facts))
        if size >= self.settings.bulk_from and size * BULK_RATIO > len(state.asserted):
            if len(state.asserted) or len(state.facts):
                return self.rebuild(asserted, len(state.facts))
            return self.from_nothing(asserted)
        try:
            # Rules are compiled from the schema, and derived facts do not name their rule: what one
            # that goes has derived cannot be told from the rest.
            if any(is_schema(p, o) for _, p, o in asserted.removed):
                raise CannotRetractError("schema is retracted")
            return _Revision(self, state, asserted).run(former_rules is not None)
        except CannotRetractError as reason:
            log.info("deriving everything again: %s", reason)
            return self.rebuild(asserted, len(state.facts))
        except TooMuchWorkError:
            log.info("deriving everything again: too much follows to go fact by fact")
            return self.rebuild(asserted, len(state.facts), in_bulk=True)

    def max_facts(self, before: int, asserted: Asserted) -> int:
        """Return the number of facts that may hold after a change.

        Parameters
        ----------
        before : int
            Number of facts before it.
        """
        budget = self.settings.budget
        if budget is None:
            return self.settings.max_facts
        return min(self.settings.max_facts, before + len(asserted.added) + budget.derived)

    def work(self, asserted: int | None = None) -> Work:
        """Return the counter for a change, or for deriving everything again from so many facts."""
        joins, budget = self.settings.max_joins, self.settings.budget
        if budget is None:
            return Work(joins)
        firings = budget.firings
        if asserted is not None:
            firings = budget.firings_to_rebuild(asserted, joins)
        return Work(joins, firings, budget.watch, self.terms.decode_fact)

    def rebuild(self, asserted: Asserted, before: int = 0, in_bulk: bool = False) -> Draft:
        """Return the state that follows from what is asserted alone.

        Parameters
        ----------
        before : int
            Number of facts that held before the change.

        Raises
        ------
        NeedsRebuildError
            If the budget of the change does not include it.
        """
        layer = Layer(Facts())
        layer.work = self.work(len(asserted.facts) + len(asserted.added))
        equality = Equality()
        self.ownership.forget()
        derivation = self._derivation(layer, equality, asserted, self.max_facts(before, asserted))
        # Before the schema is closed, its axioms would compile to rules that lack what follows.
        program = Program(CLOSING_RULES)
        derivation.use(program)
        draft = Draft(asserted, layer, equality, program, (), is_rebuilt=True)
        facts = tuple(asserted)
        bulk = None
        if in_bulk or len(facts) * REBUILD_RATIO >= self.settings.bulk_from:
            bulk = self._derive_in_bulk(draft, derivation, facts)
        else:
            for fact in facts:
                derivation.insert(fact)
            derivation.run(program.strata[0])
            self.grow(draft, derivation)
        # Each stratum asks what is absent below it, so the one below must be complete.
        for stratum in draft.program.strata[1:]:
            if bulk is None or not self._join_stratum(draft, derivation, stratum):
                derivation.evaluate(stratum.rules)
                derivation.run(stratum)
        # Constraints derive nothing, so they are tried once, when all that holds is known.
        checks = list(draft.program.checks.rules)
        if bulk is not None:
            checks = bulk.suspects(checks, draft.program)
        findings = [
            *find_all(layer, self.terms, checks),
            *find_equal(draft.program, equality),
            *self.ill_typed(facts),
        ]
        draft.clashes = {finding.identity: finding for finding in findings}
        return draft

    def from_nothing(self, asserted: Asserted) -> Draft:
        """Return the first state of a closure, from memory if another one began with the same."""
        settings, budget = self.settings, self.settings.budget
        bounds = (None,) if budget is None else (budget.derived, budget.firings)
        # The watch of a budget belongs to one change, the owners of names to one knowledge base:
        # compared, they would make each question a new one.
        key = (replace(settings, budget=None, owner=None), *bounds)
        question = Question.of(asserted.added, self.terms, key, settings.owner)
        known = None if question is None else _MEMO.recall(question, self.terms)
        if known is not None:
            facts, program = known
            layer = Layer(Facts())
            layer.added = facts
            return Draft(asserted, layer, Equality(), program, (), is_rebuilt=True)
        draft = self.rebuild(asserted)
        # Labels choose the representatives of equal terms, and occur in reports of faults.
        needs_labels = draft.equality or draft.problems or draft.clashes
        if question is not None and not needs_labels:
            _MEMO.remember(question, draft.layer.added, draft.program, self.terms)
        return draft

    def _derive_in_bulk(
        self, draft: Draft, derivation: Derivation, facts: tuple[Fact, ...]
    ) -> Bulk:
        """Derive the lowest stratum by joining columns: first the schema, then all."""
        # Rules are compiled from the schema: were it not complete before the data is joined, each
        # axiom that came late would join whole relations again.
        for fact in facts:
            if fact[1] == SAME or is_schema(fact[1], fact[2]):
                derivation.insert(fact)
        derivation.evaluate(compile_lists(draft.layer, self.terms))
        self._join_columns(draft, derivation, derivation.take_queue())
        draft.program, draft.problems = self.compile(draft.layer, draft.equality)
        derivation.use(draft.program)
        derivation.schema_changed = False
        bulk = self._join_columns(draft, derivation, facts)
        if bulk.touched_schema or derivation.schema_changed:
            self.grow(draft, derivation)
        return bulk

    def _join_columns(self, draft: Draft, derivation: Derivation, facts: Iterable[Fact]) -> Bulk:
        """Derive what follows from facts and the layer within the lowest stratum."""
        bulk = self._bulk(draft, derivation, draft.equality)
        bulk.load((*facts, *draft.layer.added))
        stratum = draft.program.strata[0]
        left = bulk.run(stratum.rules, draft.program.constants)
        draft.layer.added = Facts.of(bulk.columns)
        derivation.evaluate(left)
        derivation.run(stratum)
        return bulk

    def _join_stratum(self, draft: Draft, derivation: Derivation, stratum: Stratum) -> bool:
        """Derive a higher stratum by joining columns.

        Returns
        -------
        bool
            False, with nothing changed, where terms are or become equal: what rests on absences is
            then to be derived fact by fact.
        """
        if draft.equality:
            return False
        merged = Equality()
        bulk = self._bulk(draft, derivation, merged)
        bulk.adopt(draft.layer.added.columns())
        left = bulk.run(stratum.rules, draft.program.constants)
        if merged:
            return False
        draft.layer.added = Facts.of(bulk.columns)
        derivation.evaluate(left)
        derivation.run(stratum)
        return True

    def grow(self, draft: Draft, derivation: Derivation) -> frozenset[Rule]:
        """Recompile until the schema is quiet, deriving the lowest stratum on the way.

        Returns
        -------
        frozenset of Rule
            The rules that are new.
        """
        before = frozenset(draft.program.rules)
        # New axioms give new rules, which may derive axioms in turn, as below a restriction.
        while True:
            derivation.schema_changed = False
            program, problems = self.compile(draft.layer, draft.equality)
            earlier_rules = frozenset(draft.program.rules)
            draft.program, draft.problems = program, problems
            derivation.use(program)
            fresh = [rule for rule in program.strata[0].rules if rule not in earlier_rules]
            derivation.evaluate(fresh)
            derivation.run(program.strata[0])
            if not derivation.schema_changed:
                return frozenset(program.rules) - before

    def compile(
        self, layer: Layer, equality: Equality
    ) -> tuple[Program, tuple[SchemaProblem, ...]]:
        """Compile the schema that a layer holds, together with the users' rules."""
        compiled = compile_schema(layer, self.terms)

        def encode(term: object) -> int:
            return equality.find(self.terms.encode(term))  # type: ignore[arg-type]

        own = [rule for text in self.settings.user_rules for rule in compile_rule(text, encode)]
        rules = (*CLOSING_RULES, *compiled.rules, *own)
        return Program(rules, compiled.distinct, self.terms), tuple(compiled.problems)

    def ill_typed(self, facts: Iterable[Fact]) -> list[Inconsistency]:
        """Return the contradictions of ill-typed literals, if the configuration minds them."""
        return [] if self.settings.keep_ill_typed else list(find_ill_typed(facts, self.terms))

    def _bulk(self, draft: Draft, derivation: Derivation, equality: Equality) -> Bulk:
        most, work = derivation.max_facts, draft.layer.work
        ownership = self.ownership
        if equality is not draft.equality:
            ownership = Ownership(self.settings.owner, self.terms)
        return Bulk(self.terms, equality, most, derivation.refusal, work, ownership)

    def _derivation(
        self, layer: Layer, equality: Equality, asserted: Asserted, max_facts: int
    ) -> Derivation:
        def is_asserted(fact: Fact) -> bool:
            if not equality:
                return fact in asserted
            return any(form in asserted for form in equality.forms(fact))

        budget = self.settings.budget
        allowed = None if budget is None or max_facts >= self.settings.max_facts else budget.derived
        is_new = asserted.added.__contains__
        return Derivation(
            layer,
            equality,
            self.terms,
            is_asserted,
            max_facts,
            is_new,
            allowed,
            self.ownership,
        )


class _Revision:
    """One incremental change."""

    def __init__(self, maintainer: Maintainer, state: State, asserted: Asserted) -> None:
        self.maintainer = maintainer
        self.terms = maintainer.terms
        self.state = state
        self.asserted = asserted
        self.layer = Layer(state.facts)
        self.layer.work = maintainer.work()
        self.equality = state.equality.copy()
        self.draft = Draft(asserted, self.layer, self.equality, state.program, state.problems)
        max_facts = maintainer.max_facts(len(state.facts), asserted)
        self.derivation = maintainer._derivation(self.layer, self.equality, asserted, max_facts)
        self.derivation.use(state.program)
        self.derivation.budget = WORTH_A_REBUILD + len(state.asserted)
        self.restored: dict[int, list[Fact]] = defaultdict(list)
        self.was_split = False

    def run(self, has_new_rules: bool = False) -> Draft:
        level, new_rules = 0, frozenset[Rule]()
        while level < len(self.draft.program.strata):
            self.retract(level)
            self.insert(level, new_rules)
            if level == 0 and (has_new_rules or self.derivation.schema_changed):
                new_rules = self.grow()
            level += 1
        self.check(new_rules)
        return self.draft

    def retract(self, level: int) -> None:
        program = self.draft.program
        before = self.state.equality
        # Facts are stored with representatives of equal terms; what is retracted names any of them.
        gone = [before.rewrite(fact) for fact in self.asserted.removed]
        gone = [fact for fact in gone if program.level(fact) == level]
        if not (gone or level):
            return
        retraction = Retraction(
            self.layer, before, self.terms, program, self.is_still_asserted, level == 0
        )
        deleted = retraction.over_delete(program.strata[level], gone)
        if retraction.split:
            self.take_apart(retraction.split)
        for fact in deleted:
            self.restored[program.level(fact)].append(fact)
        for fact in self.restored.pop(level, ()):
            for form in before.forms(fact) if self.was_split else (fact,):
                form = self.equality.rewrite(form)
                if not self.layer.has(*form) and retraction.is_derivable(form):
                    self.derivation.insert(form)

    def take_apart(self, representatives: Iterable[int]) -> None:
        """Dissolve classes and bring back what is asserted of each member."""
        self.was_split = True
        members = {m for r in representatives for m in self.equality.dissolve(r)}
        self.maintainer.ownership.forget()
        for fact in self.asserted:
            if not members.isdisjoint(fact):
                self.derivation.insert(fact)
        # A rule that names the terms it merges needs no fact about them.
        self.derivation.evaluate(
            rule
            for rule in self.draft.program.by_head.get(SAME, ())
            if rule.head is not None and max(rule.head.s, rule.head.o) >= 0
        )

    def insert(self, level: int, new_rules: frozenset[Rule]) -> None:
        program = self.draft.program
        stratum = program.strata[level]
        below = tuple(self.layer.added) if level else ()
        for fact in self.asserted.added:
            if program.level(fact) == level:
                self.derivation.insert(fact)
        if not level:
            self.derivation.run(stratum)
            return
        # NOT EXISTS looks at lower strata only, and those are finished: one look is enough.
        self.layer.absences = {}
        self.derivation.trigger(stratum, below)
        for env, rule in list(candidates(stratum, self.layer, self.terms)):
            for bindings in list(solve(self.layer, self.terms, rule.steps, env)):
                self.derivation.insert(rule.conclude(bindings))
        if new_rules:  # rules are slow to hash, and most changes bring none
            self.derivation.evaluate(rule for rule in stratum.rules if rule in new_rules)
        self.derivation.run(stratum)
        self.layer.absences = None

    def grow(self) -> frozenset[Rule]:
        old = self.draft.program
        new = self.maintainer.grow(self.draft, self.derivation)
        vanished = set(old.rules) - set(self.draft.program.rules)
        if any(rule.name not in REDUCED for rule in vanished):
            raise CannotRetractError("the schema lost a rule")
        return new

    def check(self, new_rules: frozenset[Rule]) -> None:
        """Find new clashes, and keep the old ones whose premises still hold."""
        program, terms = self.draft.program, self.terms
        findings = [
            *find_new(self.layer, terms, program),
            *find_all(self.layer, terms, (rule for rule in new_rules if rule.head is None)),
            *find_equal(program, self.equality),
            *self.maintainer.ill_typed(self.asserted.added),
        ]
        for old in self.state.clashes.values():
            premises = tuple(dict.fromkeys(map(self.equality.rewrite, old.premises)))
            if old.rule not in LISTED and all(self.stands(old, fact) for fact in premises):
                findings.append(Inconsistency(old.rule, premises, old.because))
        self.draft.clashes = {finding.identity: finding for finding in findings}

    def stands(self, old: Inconsistency, premise: Fact) -> bool:
        """Tell whether a premise of an old clash still holds; ill-typed ones must be asserted."""
        is_ill_typed = old.rule == "dt-not-type" and not old.because
        return self.layer.has(*premise) and (not is_ill_typed or self.is_still_asserted(premise))

    def is_still_asserted(self, fact: Fact) -> bool:
        before = self.state.equality
        if not before:
            return fact in self.asserted
        return any(form in self.asserted for form in before.forms(fact))
