"""The closure of a knowledge base: built once, staged with every commit."""

from __future__ import annotations

import itertools
import sys
import time
import weakref
from collections.abc import Collection, Iterable, Mapping
from typing import Protocol

from pyoxigraph import Literal, NamedNode
from pyoxigraph import Triple as TripleTerm

from reasoner.causes import Cause, Search
from reasoner.config import Config, InconsistentError
from reasoner.contradictions import PROOF_BUDGET, Contradiction, describe
from reasoner.exports import Triples, difference, small_difference
from reasoner.facts.arrays import Keys
from reasoner.facts.changes import FactChange
from reasoner.facts.layer import Asserted
from reasoner.fixpoint.checks import Inconsistency
from reasoner.fixpoint.maintenance import Draft, Maintainer, Settings
from reasoner.handover import Difference, Handover, Reporter
from reasoner.proofs import Proof
from reasoner.rules.user_rules import LabelledRule
from reasoner.rules.work import ChangeBudget
from reasoner.saved.image import Contents, Image, fingerprint
from reasoner.terms.dictionary import Fact, GivenTriple, Term, Triple, is_plain, is_term
from reasoner.terms.vocabulary import RDF
from reasoner.view import ClosureView

_REIFIES = NamedNode(RDF + "reifies")
_NO_SUBJECTS = (TripleTerm, Literal)
_BATCH = 100_000
"""Triples whose terms are held at a time while they are encoded."""
LISTED_CONTRADICTIONS = 100
LISTED_TRIPLES = 5_000
"""More triples of a change are made only when somebody looks at them."""


Rules = tuple[str | LabelledRule, ...]
SomeFacts = set[Fact] | Mapping[int, Keys]
Exported = tuple[set[Fact], set[Fact]] | FactChange
"""What enters and what leaves the graph of inferred triples."""


class Shares(Protocol):
    """What shares the facts of a closure, and is told before they change."""

    def before(self, draft: Draft, has_other_rules: bool) -> None:
        """Stay as it is while the closure is about to take a change."""


class Staged:
    """A change whose consequences are known but which is not yet in force.

    Attributes
    ----------
    inferred_added, inferred_removed : collection of Triple
        Triples that enter and leave the graph of inferred triples; never an asserted triple. Large
        ones are made of ids at each pass.
    remaining_inferred : collection of Triple or None
        Triples that stay in the graph of inferred triples; None where the change is small.
    contradictions : list of Contradiction
        Contradictions that the change introduces.
    """

    def __init__(
        self,
        closure: Closure,
        draft: Draft,
        rules: Rules,
        counts: tuple[int, int],
        exported: FactChange | None = None,
        origin: Handover | None = None,
    ) -> None:
        self._closure = closure
        self._origin = origin
        self._draft: Draft | None = draft
        self._rules = rules
        self._version = closure._version
        self._counts = counts
        self._exported, remaining = (
            (exported, None) if exported is not None else closure._difference(draft)
        )
        self.inferred_added, self.inferred_removed = map(closure._shown, self._parts())
        self.remaining_inferred: Collection[Triple] | None = remaining
        draft.layer.work = None  # its budget was for deriving, not for those who read
        earlier = closure._state.clashes
        self._counts_after = closure._terms.counts()
        self._news = [clash for key, clash in draft.clashes.items() if key not in earlier]
        self.contradictions = closure._describe(self._news, draft)

    def _pending(self) -> Draft:
        if self._draft is None:
            raise RuntimeError("this change was already applied or discarded")
        return self._draft

    def _parts(self) -> tuple[SomeFacts, SomeFacts]:
        both = self._exported
        return (both.added, both.removed) if isinstance(both, FactChange) else both

    def causes(self, budget_ms: float = 1_000) -> list[Cause]:
        """Return the smallest sets of added statements that lead to the contradictions.

        Parameters
        ----------
        budget_ms : float
            Stop looking after this many milliseconds of processor time; what was found by then is
            returned.

        Raises
        ------
        RuntimeError
            If the change was applied or discarded before.
        """
        return self._closure._causes(self._news, self._rules, self._pending(), budget_ms)

    def prove(self, triple: Triple, budget: int = PROOF_BUDGET) -> Proof | None:
        """Return a proof of a triple that holds with the change; ``None`` beyond the budget.

        Raises
        ------
        RuntimeError
            If the change was applied or discarded before.
        """
        proof = self._closure._reading(self._pending()).prove(
            self._closure._terms.encode_all([triple])[0], budget
        )
        return proof if isinstance(proof, Proof) else None

    def apply(self) -> None:
        """Bring the change into force.

        Raises
        ------
        RuntimeError
            If it was applied or discarded before, or another one was applied since.
        """
        draft = self._pending()
        # Its consequences were derived from facts that may be gone by now.
        if self._version != self._closure._version:
            raise RuntimeError("another change was applied since this one was staged")
        self._closure._take(draft, self._exported, self._rules, self._origin)
        self._draft = None

    def difference(self) -> Difference:
        """Return how the closure will differ from what it is now.

        Raises
        ------
        RuntimeError
            If the change was applied or discarded before.
        """
        return self._closure._difference_made(self._pending(), self._exported)

    def is_current(self, closure: Closure) -> bool:
        """Whether a closure is the one that the change was staged on, and has not changed since."""
        return closure is self._closure and closure._version == self._version

    def taken(self) -> Draft | None:
        """Return the successor of the state for somebody else to keep; its terms stay known."""
        draft, self._draft = self._draft, None
        return draft

    def discard(self) -> None:
        """Discard the change, and forget the terms that it brought if nobody met others since."""
        terms = self._closure._terms
        if self._draft is not None and terms.counts() == self._counts_after:
            terms.forget_since(self._counts)
        self._draft = None


class Closure(ClosureView):
    """Everything that follows from a set of triples under OWL 2 RL and user-defined rules.

    Examples
    --------
    >>> from pyoxigraph import NamedNode as N
    >>> from reasoner.terms import vocabulary as v
    >>> below, a = N(v.IRIS[v.SUB_CLASS]), N(v.IRIS[v.TYPE])
    >>> closure = Closure.build([(N("urn:Mug"), below, N("urn:Vessel"))], [])
    >>> staged = closure.stage(add=[(N("urn:m1"), a, N("urn:Mug"))])
    >>> [str(o) for s, p, o in staged.inferred_added]
    ['<urn:Vessel>']
    >>> closure.contains((N("urn:m1"), a, N("urn:Vessel")))
    False
    >>> staged.apply()
    >>> closure.contains((N("urn:m1"), a, N("urn:Vessel")))
    True
    """

    def __init__(
        self, rules: Iterable[str | LabelledRule] = (), config: Config | None = None
    ) -> None:
        super().__init__()
        self._config = config or Config()
        self._rules = tuple(rules)
        self._version = 0
        self._reifiers: set[Term] = set()
        self._skipped = 0
        self._handovers: list[Handover] = []
        self._sharing: weakref.WeakSet[Shares] = weakref.WeakSet()

    @classmethod
    def build(
        cls,
        schema: Iterable[GivenTriple],
        data: Iterable[GivenTriple],
        rules: Iterable[str | LabelledRule] = (),
        config: Config | None = None,
    ) -> Closure:
        """Build the closure of asserted triples.

        Parameters
        ----------
        schema, data : iterable of GivenTriple
            Asserted triples; the predicates determine which of them are schema. Those with triple
            terms are left out.
        rules : iterable of str or LabelledRule
            SPARQL CONSTRUCT texts.
        config : Config, optional

        Raises
        ------
        RuleError, StratificationError
            If a rule cannot be used.
        ClosureTooLargeError
            If more follows than the configuration allows.
        """
        closure = cls(rules, config)
        facts = frozenset(closure._encode(schema)) | frozenset(closure._encode(data))
        asserted = Asserted(closure._state.asserted, facts)
        maintainer = closure._maintainer(len(facts), closure._rules)
        # Each new knowledge base begins with the closure of nothing: 5 ms to read the rules for it.
        draft = maintainer.rebuild(asserted) if facts else maintainer.from_nothing(asserted)
        draft.apply_to(closure._state)
        return closure

    def stage(
        self,
        add: Iterable[GivenTriple] = (),
        remove: Iterable[GivenTriple] = (),
        rules: Iterable[str | LabelledRule] | None = None,
        accepted: bool = False,
        budget: ChangeBudget | None = None,
    ) -> Staged:
        """Compute the consequences of a change of the asserted triples, without applying it.

        Parameters
        ----------
        add, remove : iterable of GivenTriple
            Triples that no graph asserted before, and those that none asserts any more. Existing
            triples to add and absent ones to remove are ignored; triples in both are added.
        rules : iterable of str or LabelledRule, optional
            All user-defined rules from now on. Additional rules are applied to the present closure;
            if a rule is missing, or triples change as well, the closure is rebuilt.
        accepted : bool
            Whether the change was made before, perhaps in many smaller ones, so that
            `Config.max_joins` does not bound the work of rules.
        budget : ChangeBudget, optional
            Closer bounds for this change, on top of those of the configuration.

        Raises
        ------
        RuleError, StratificationError
            If a rule cannot be used.
        ClosureTooLargeError
            If more follows than the budget or the configuration allows, or more work is needed to
            find that out; nothing has changed then.
        InconsistentError
            If the change contradicts known statements and `Config.on_contradiction` is "reject".
        """
        former, now = self._rules, self._rules if rules is None else tuple(rules)
        counts = self._terms.counts()
        try:
            changed = self._changed(add, remove)
            size = len(changed.facts) + len(changed.added)
            maintainer = self._maintainer(size, now, not accepted, budget)
            draft = maintainer.draft(self._state, changed, former if now != former else None)
            staged = Staged(self, draft, now, counts)
        except BaseException:
            # Else each refused change would leave its terms behind, and a robot could fill the
            # memory.
            self._terms.forget_since(counts)
            raise
        if staged.contradictions and self._config.on_contradiction == "reject":
            staged.discard()
            raise InconsistentError(staged.contradictions)
        return staged

    def follow_with(self, other: Shares) -> None:
        """Tell somebody before each change from now on."""
        self._sharing.add(other)

    def hand_over(self) -> Handover:
        """Return what a copy made now needs to hand back later; see :meth:`adopt`."""
        handover = Handover(self._terms, self._state.program)
        self._handovers.append(handover)
        return handover

    def end_handover(self, handover: Handover) -> None:
        """Record changes for a copy no longer."""
        self._handovers.remove(handover)

    def reporter(self) -> Reporter:
        """Return what reports on this closure, the copy, from now on."""
        return Reporter(self._terms, self._state)

    def adopt(
        self,
        handover: Handover,
        add: Iterable[GivenTriple],
        remove: Iterable[GivenTriple],
        rules: Iterable[str | LabelledRule] | None = None,
        derived: int | None = None,
    ) -> Staged | None:
        """Return what a copy derived, as :meth:`stage` would.

        Parameters
        ----------
        add, remove, rules
            The change, as :meth:`stage` takes it.
        derived : int, optional
            Number of facts that may be derived.

        Returns
        -------
        Staged or None
            None if the copy does not hold this very change and all that the closure took
            meanwhile, or if more follows than may.
        """
        now = self._rules if rules is None else tuple(rules)
        counts = self._terms.counts()
        changed = self._changed(add, remove)
        adopted = handover.draft(self._state, changed)
        if adopted is None:
            return None
        draft, exported = adopted
        if derived is not None and draft.net > len(changed.added) + derived:
            return None
        return Staged(self, draft, now, counts, exported, handover)

    @classmethod
    def from_image(
        cls, image: Image, rules: Iterable[str | LabelledRule] = (), config: Config | None = None
    ) -> Closure:
        """Return the closure of an image, which must have the same :meth:`fingerprint`."""
        closure = cls(rules, config)
        contents = image.contents()
        closure._terms, closure._state = contents.terms, contents.state
        closure._reifiers, closure._skipped = contents.reifiers, contents.skipped
        return closure

    def image(self) -> Image:
        """Return all that the closure holds as arrays and data, to be written to a folder."""
        return Image.of(Contents(self._terms, self._state, self._reifiers, self._skipped))

    def fingerprint(self) -> dict[str, str]:
        """Return what the closure depends on besides the asserted triples, as JSON-able data."""
        return fingerprint(self._rules, self._config.ill_typed)

    def contradictions(self) -> list[Contradiction]:
        """Return the present contradictions among the asserted triples."""
        return self._describe(self._state.clashes.values(), None)

    def causes(self, budget_ms: float = 1_000) -> list[Cause]:
        """Return the smallest sets of asserted statements that lead to the contradictions.

        Parameters
        ----------
        budget_ms : float
            Stop looking after this many milliseconds of processor time; what was found by then is
            returned.
        """
        return self._causes(self._state.clashes.values(), self._rules, None, budget_ms)

    def stats(self) -> dict[str, int | list[str]]:
        """Return sizes, and the axioms that could not be read."""
        state = self._state
        problems = [f"{self._terms.iri(p.node)}: {p.message}" for p in state.problems]
        return {
            "asserted": len(state.asserted),
            "facts": len(state.facts),
            "terms": len(self._terms),
            "rules": len(state.program.rules),
            "strata": len(state.program.strata),
            "merged_terms": sum(len(members) for _, members in state.equality.classes()),
            "contradictions": len(state.clashes),
            "skipped": self._skipped,
            "problems": problems,
        }

    def _maintainer(
        self,
        size: int,
        rules: tuple[str | LabelledRule, ...],
        bounded: bool = True,
        budget: ChangeBudget | None = None,
    ) -> Maintainer:
        settings = Settings(
            max_facts=51 * size + self._config.max_inferred,
            max_joins=20 * size + self._config.max_joins if bounded else sys.maxsize,
            bulk_from=self._config.bulk_from,
            keep_ill_typed=self._config.ill_typed == "keep",
            owner=self._config.owner,
            user_rules=rules,
            budget=budget,
        )
        return Maintainer(self._terms, settings)

    def _changed(self, add: Iterable[GivenTriple], remove: Iterable[GivenTriple]) -> Asserted:
        plus = set(self._encode(add))
        minus = set(self._terms.encode_all(filter(is_plain, remove)))
        asserted = self._state.asserted
        return Asserted(
            asserted,
            frozenset(plus - asserted.among(plus)),
            frozenset(asserted.among(minus - plus)),
        )

    def _encode(self, triples: Iterable[GivenTriple]) -> list[Fact]:
        """Encode triples, without triple terms and statements about their reifiers."""
        reifiers, encoded, count = self._reifiers, len(self._reifiers), 0
        facts: list[Fact] = []
        rest = iter(triples)
        while batch := list(itertools.islice(rest, _BATCH)):
            count += len(batch)
            reifiers |= {s for s, p, _ in batch if p == _REIFIES and is_term(s)}
            plain: list[Triple] = [
                (s, p, o)
                for s, p, o in batch
                if not isinstance(s, _NO_SUBJECTS) and is_term(o) and s not in reifiers
            ]
            facts += self._terms.encode_all(plain)
        if len(reifiers) > encoded and count > _BATCH:
            # A batch may be about a reifier that a later one brought.
            skipped = {self._terms.find(term) for term in reifiers}
            facts = [fact for fact in facts if fact[0] not in skipped]
        self._skipped += count - len(facts)
        return facts

    def _difference(self, draft: Draft) -> tuple[Exported, Collection[Triple] | None]:
        before, after = self._reading(), self._reading(draft)
        if not draft.is_rebuilt:
            return small_difference(before, after, draft.asserted), None
        change, unchanged = difference(before, after)
        return change, Triples(unchanged, self._terms)

    def _shown(self, facts: SomeFacts) -> Collection[Triple]:
        if isinstance(facts, set):
            return [*map(self._terms.decode_fact, facts)]
        triples = Triples(facts, self._terms)
        return triples if len(triples) > LISTED_TRIPLES else list(triples)

    def _difference_made(self, draft: Draft, exported: Exported) -> Difference:
        change = exported if isinstance(exported, FactChange) else FactChange.of(*exported)
        return Difference.of(draft, self._state, change)

    def _take(
        self, draft: Draft, exported: Exported, rules: Rules, origin: Handover | None
    ) -> None:
        """Make a draft the state, and record it where that is asked for."""
        # The copy that derived it is done with.
        handovers = [handover for handover in self._handovers if handover is not origin]
        if handovers:
            step = self._difference_made(draft, exported)
            for handover in handovers:
                handover.record(draft, step, None if rules == self._rules else rules)
        for other in tuple(self._sharing):
            other.before(draft, rules != self._rules)
        self._changes += draft.size
        draft.apply_to(self._state)
        self._rules = rules
        self._version += 1

    def _causes(
        self,
        findings: Iterable[Inconsistency],
        rules: tuple[str | LabelledRule, ...],
        draft: Draft | None,
        budget_ms: float,
    ) -> list[Cause]:
        def clash(triples: Iterable[Triple]) -> list[Contradiction]:
            return Closure.build(triples, [], rules, self._config).contradictions()

        # Of this thread: on a busy machine the same search would otherwise find less.
        deadline = time.thread_time() + budget_ms / 1000
        added = draft.asserted.added if draft is not None else frozenset[Fact]()
        search = Search(self._reading(draft), clash, frozenset(added), deadline)
        return search.run(sorted(findings, key=lambda finding: finding.identity[0]))

    def _describe(
        self, findings: Iterable[Inconsistency], draft: Draft | None
    ) -> list[Contradiction]:
        reading = self._reading(draft)
        first = sorted(findings, key=lambda finding: finding.identity[0])[:LISTED_CONTRADICTIONS]
        return sorted((describe(f, reading) for f in first), key=lambda c: c.message)
