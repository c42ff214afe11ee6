"""Causes of contradictions: the smallest sets of statements that cannot hold together.

A proof of what clashes names enough statements; from these, a minimal inconsistent subset is found
by trying which can be left out (QuickXplain; Junker 2004, "QUICKXPLAIN: preferred explanations and
relaxations for over-constrained problems"). Further ones are found in a hitting set tree (Reiter
1987, "A theory of diagnosis from first principles"; Kalyanpur et al. 2007, "Finding all
justifications of OWL DL entailments").
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from reasoner.contradictions import Contradiction
from reasoner.decisions import DEFAULT_BUDGET
from reasoner.fixpoint.checks import LISTED, Inconsistency
from reasoner.proofs import Proof
from reasoner.reading import Reading
from reasoner.rules.strata import StratificationError
from reasoner.terms import vocabulary as v
from reasoner.terms.dictionary import Fact, Triple
from reasoner.terms.vocabulary import LITERAL, RESERVED, SAME, TYPE

Clash = Callable[[Iterable[Triple]], Sequence[Contradiction]]
"""Returns what a set of statements contradicts."""

MAX_CAUSES = 10
MAX_KINDS = 24
"""Contradictions whose proofs are followed; those of one axiom differ in data only."""

MAX_TRIED = 2_000
"""Up to so many statements are all tried where the proofs do not name enough of them."""

_DECLARATIONS = (
    v.CLASS, v.OBJECT_PROPERTY, v.DATATYPE_PROPERTY, v.DATATYPE, v.RESTRICTION,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cause:
    """Statements that cannot all be true, none of which can be left out.

    Attributes
    ----------
    statements : tuple of Triple
        The asserted statements to choose from: of a change, those that it adds.
    known : tuple of Triple
        Asserted statements known before, with which they clash; empty where there was no time.
    example : Contradiction
        One contradiction that they lead to.
    rules : tuple of str
        Rules of the user that lead there, as `rule:<label>`.
    is_smallest : bool
        False where time ran out before all that can be left out was.
    """

    statements: tuple[Triple, ...]
    known: tuple[Triple, ...]
    example: Contradiction
    rules: tuple[str, ...] = ()
    is_smallest: bool = True


class OutOfTimeError(Exception):
    """The search took too long."""


@dataclass(frozen=True)
class Search:
    """Search for the causes of findings in one state of a closure.

    Attributes
    ----------
    reading : Reading
    clash : callable
        Returns the contradictions of a set of statements.
    added : frozenset of Fact
        What a change adds; with none, every statement may be to blame.
    deadline : float
        By `time.thread_time`, in s, so that a loaded machine finds as much.
    """

    reading: Reading
    clash: Clash
    added: frozenset[Fact]
    deadline: float

    def run(self, findings: Iterable[Inconsistency], limit: int = MAX_CAUSES) -> list[Cause]:
        """Return up to `limit` causes, in the order found."""
        support = self._support(_kinds(findings))
        new = [fact for fact in support if fact in self.added]
        old = [fact for fact in support if fact not in self.added]
        if not new or self._is_inconsistent(old):
            new, old = [*old, *new], []
        if not self._is_inconsistent([*old, *new]):
            asserted = list(self.reading.asserted)
            if len(asserted) > MAX_TRIED or not self._is_inconsistent(asserted):
                return []
            new = [fact for fact in asserted if fact in self.added] or asserted
            old = [fact for fact in asserted if fact not in self.added] if self.added else []
        causes: list[tuple[list[Fact], bool]] = []
        try:
            for cause in self._minimal_sets(old, new, limit):
                causes.append((cause, True))
        except OutOfTimeError:
            if not causes:
                causes.append((new, False))
        return [self._described(cause, old, smallest) for cause, smallest in causes]

    def _described(self, cause: list[Fact], old: list[Fact], is_smallest: bool) -> Cause:
        prior: list[Fact] = []
        try:
            prior = quickxplain(cause, old, self._tested)
        except OutOfTimeError:
            is_smallest = False
        decode = self.reading.terms.decode_fact
        statements = tuple(map(decode, sorted(cause)))
        prior_triples = tuple(map(decode, sorted(prior)))
        example = self.clash([*statements, *(prior_triples or map(decode, old))])[0]
        rules = sorted({name for proof in example.proofs for name in _rules_of(proof)})
        return Cause(statements, prior_triples, example, tuple(rules), is_smallest)

    def _minimal_sets(
        self, background: list[Fact], candidates: list[Fact], limit: int
    ) -> Iterator[list[Fact]]:
        """Yield minimal subsets of the candidates that clash with the background."""
        minimal_sets: list[list[Fact]] = []
        queue: deque[frozenset[Fact]] = deque([frozenset()])
        seen: set[frozenset[Fact]] = set()
        while queue and len(minimal_sets) < limit:
            without = queue.popleft()
            cause = next((subset for subset in minimal_sets if without.isdisjoint(subset)), None)
            if cause is None:
                rest = [fact for fact in candidates if fact not in without]
                if not self._tested([*background, *rest]):
                    continue
                cause = quickxplain(background, rest, self._tested)
                minimal_sets.append(cause)
                yield cause
            for fact in cause:
                child = without | {fact}
                if child not in seen:
                    seen.add(child)
                    queue.append(child)

    def _tested(self, facts: Iterable[Fact]) -> bool:
        if time.thread_time() > self.deadline:
            raise OutOfTimeError
        return self._is_inconsistent(facts)

    def _is_inconsistent(self, facts: Iterable[Fact]) -> bool:
        try:
            return bool(self.clash(map(self.reading.terms.decode_fact, facts)))
        except StratificationError:
            # Without the declaration that a functional property has literals as values, owl:sameAs
            # depends on it, and through a user's NOT EXISTS on itself: the part shows no clash.
            return False

    # What clashes, and what that rests on.

    def _support(self, findings: Iterable[Inconsistency]) -> list[Fact]:
        """Return asserted facts that lead to the findings, with what they may be mixed up with."""
        leaves: dict[Fact, None] = {}
        for finding in findings:
            for fact in self._goals(finding):
                leaves.update(dict.fromkeys(self._leaves(fact)))
        terms = {x for fact in leaves for x in fact if RESERVED <= x < LITERAL}
        for x in sorted(terms):
            for kind in _DECLARATIONS:
                if (x, TYPE, kind) in self.reading.asserted:
                    leaves[x, TYPE, kind] = None
        schema = {x for fact in leaves if fact in self.added for x in fact if x < LITERAL}
        beside = [f for f in self.added if f[0] in schema and v.is_schema(f[1], f[2])]
        leaves.update(dict.fromkeys(sorted(beside)))
        return list(leaves)

    def _goals(self, finding: Inconsistency) -> Iterator[Fact]:
        premises = [self.reading.asserted_form(fact) for fact in finding.premises]
        if finding.rule in LISTED:
            a, b = premises
            yield a[2], SAME, b[2]
        because = map(self.reading.asserted_form, finding.because)
        equality = self.reading.equality
        for fact in (*premises, *because):
            yield fact
            # The finding speaks of representatives: why these stand for the terms is a part of it.
            yield from ((x, SAME, equality.find(x)) for x in fact if equality.is_merged(x))

    def _leaves(self, goal: Fact) -> Iterator[Fact]:
        """Yield the asserted facts that a fact rests on, through its schema too."""
        find = self.reading.terms.find
        todo, seen = [goal], {goal}
        while todo:
            fact = todo.pop()
            if fact in self.reading.asserted:
                yield fact
                continue
            if time.thread_time() > self.deadline:
                continue
            proof = self.reading.prove(fact, DEFAULT_BUDGET)
            for triple in _rests_on(proof) if isinstance(proof, Proof) else ():
                s, p, o = map(find, triple)
                assert s is not None
                assert p is not None
                assert o is not None
                if (s, p, o) not in seen:
                    seen.add((s, p, o))
                    todo.append((s, p, o))


def _kinds(findings: Iterable[Inconsistency]) -> list[Inconsistency]:
    """Return one finding for each axiom, so that many of one kind do not hide another."""
    kinds: dict[object, Inconsistency] = {}
    for finding in findings:
        kinds.setdefault((finding.rule, finding.because), finding)
    return list(kinds.values())[:MAX_KINDS]


def _rests_on(proof: Proof) -> Iterator[Triple]:
    """Yield the leaves of a proof and the schema statements of its steps."""
    if proof.is_asserted:
        yield proof.triple
    yield from proof.schema
    for premise in proof.premises:
        yield from _rests_on(premise)


def _rules_of(proof: Proof) -> Iterator[str]:
    if proof.rule.startswith("rule:"):
        yield proof.rule
    for premise in proof.premises:
        yield from _rules_of(premise)


def quickxplain(
    background: Sequence[Fact],
    candidates: Sequence[Fact],
    is_inconsistent: Callable[[Iterable[Fact]], bool],
) -> list[Fact]:
    """Return a minimal subset of the candidates that is inconsistent with the background.

    Parameters
    ----------
    background, candidates : sequence of Fact
        Inconsistent together.
    is_inconsistent : callable
        Tests a set of facts.

    Examples
    --------
    >>> has_both = lambda facts: {(1, 1, 1), (4, 4, 4)} <= set(facts)
    >>> quickxplain([], [(n, n, n) for n in range(6)], has_both)
    [(1, 1, 1), (4, 4, 4)]
    """
    if not candidates or is_inconsistent(background):
        return []

    def search(base: list[Fact], has_news: bool, rest: list[Fact]) -> list[Fact]:
        if has_news and is_inconsistent(base):
            return []
        if len(rest) == 1:
            return rest
        half = len(rest) // 2
        first, second = rest[:half], rest[half:]
        of_second = search([*base, *first], True, second)
        of_first = search([*base, *of_second], bool(of_second), first)
        return [*of_first, *of_second]

    return search(list(background), False, list(candidates))
