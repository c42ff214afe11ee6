"""The closure of a knowledge base: built once, staged with every commit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode
from pyoxigraph import Triple as TripleTerm

from . import vocabulary as v
from .checks import Contradiction, Inconsistency, describe
from .dictionary import Dictionary, Fact, Term, Triple
from .export import Asserted, Reading, differences, is_exported
from .glosses import Glossary
from .maintenance import Draft, Maintainer, Settings, State
from .proofs import GraphsOf, Proof, Prover
from .vocabulary import LITERAL, RDF, SAME, TYPE

_REIFIES = NamedNode(RDF + "reifies")
_DATATYPES = frozenset(v.DATATYPES.values())
LISTED_CONTRADICTIONS = 100


class InconsistentError(ValueError):
    """A change contradicts what is known, and the configuration rejects such changes."""

    def __init__(self, contradictions: list[Contradiction]) -> None:
        more = len(contradictions) - 1
        super().__init__(contradictions[0].message + (f" (and {more} more)" if more else ""))
        self.contradictions = contradictions


@dataclass(frozen=True, slots=True)
class Config:
    """Bounds and policies of a closure.

    Attributes
    ----------
    on_contradiction : {"report", "reject"}
        Whether `stage` lists new contradictions or raises `InconsistentError`.
    ill_typed : {"reject", "keep"}
        Whether `"abc"^^xsd:integer` is a contradiction or an opaque value.
    max_inferred : int
        Bound on derived facts, above 50 per asserted one.
    """

    on_contradiction: str = "report"
    ill_typed: str = "reject"
    max_inferred: int = 1_000_000

    def __post_init__(self) -> None:
        if self.on_contradiction not in ("report", "reject"):
            raise ValueError(
                f"on_contradiction is 'report' or 'reject', not {self.on_contradiction!r}"
            )
        if self.ill_typed not in ("reject", "keep"):
            raise ValueError(f"ill_typed is 'reject' or 'keep', not {self.ill_typed!r}")


class Staged:
    """A change that is thought through and not yet in force.

    Attributes
    ----------
    inferred_added, inferred_removed : list of Triple
        What enters and what leaves the graph of inferred triples; never an asserted triple.
    contradictions : list of Contradiction
        What the change newly contradicts.
    """

    def __init__(self, closure: Closure, draft: Draft) -> None:
        self._closure = closure
        self._draft: Draft | None = draft
        self._version = closure._version
        decode = closure._terms.decode_fact
        added, removed = closure._difference(draft)
        self.inferred_added: list[Triple] = [decode(fact) for fact in added]
        self.inferred_removed: list[Triple] = [decode(fact) for fact in removed]
        known = closure._state.clashes
        news = [clash for key, clash in draft.clashes.items() if key not in known]
        self.contradictions = closure._describe(news, draft)

    def apply(self) -> None:
        """Put the change in force.

        Raises
        ------
        RuntimeError
            If it was applied or discarded before, or another one was applied since.
        """
        if self._draft is None:
            raise RuntimeError("this change was already applied or discarded")
        if self._version != self._closure._version:
            raise RuntimeError("another change was applied since this one was staged")
        self._draft.apply_to(self._closure._state)
        self._closure._version += 1
        self._draft = None

    def discard(self) -> None:
        """Forget the change."""
        self._draft = None


class Closure:
    """Everything that follows from a set of triples under OWL 2 RL and rules of the user.

    Examples
    --------
    >>> from pyoxigraph import NamedNode as N
    >>> below, a = N(v.IRIS[v.SUB_CLASS]), N(v.IRIS[TYPE])
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

    def __init__(self, rules: Iterable[str] = (), config: Config | None = None) -> None:
        self._config = config or Config()
        self._rules = tuple(rules)
        self._terms = Dictionary()
        self._state = State()
        self._version = 0
        self._reifiers: set[Term] = set()
        self._skipped = 0

    @classmethod
    def build(
        cls,
        schema: Iterable[Triple],
        data: Iterable[Triple],
        rules: Iterable[str] = (),
        config: Config | None = None,
    ) -> Closure:
        """Derive all that follows.

        Parameters
        ----------
        schema, data : iterable of Triple
            Asserted triples; which of them are schema is seen from their predicates.
        rules : iterable of str
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
        closure._maintainer(len(facts)).rebuild(asserted).apply_to(closure._state)
        return closure

    def stage(self, add: Iterable[Triple] = (), remove: Iterable[Triple] = ()) -> Staged:
        """Think a change of the asserted triples through; nothing visible changes yet.

        Parameters
        ----------
        add, remove : iterable of Triple
            Triples that no graph asserted before, and those that none asserts any more. What is
            there already or was never there is ignored; what is in both is added.

        Raises
        ------
        InconsistentError
            If the change contradicts what is known and `Config.on_contradiction` is "reject".
        """
        plus, minus = set(self._encode(add)), set(self._encode(remove))
        asserted = self._state.asserted
        changed = Asserted(
            asserted, frozenset(plus - asserted), frozenset((minus - plus) & asserted)
        )
        maintainer = self._maintainer(len(asserted) + len(plus))
        staged = Staged(self, maintainer.draft(self._state, changed))
        if staged.contradictions and self._config.on_contradiction == "reject":
            staged.discard()
            raise InconsistentError(staged.contradictions)
        return staged

    def contains(self, triple: Triple) -> bool:
        """Tell whether a triple is asserted, derived, or true of everything."""
        s, p, o = map(self._terms.find_equal, triple)
        if s is None or p is None or o is None:
            return triple[0] == triple[2] and triple[1] == NamedNode(v.IRIS[SAME])
        return any(
            self._is_stored(form) or self._is_virtual(form) for form in self._forms((s, p, o))
        )

    def match(
        self, s: Term | None = None, p: Term | None = None, o: Term | None = None
    ) -> list[Triple]:
        """Return the asserted and derived triples that match a pattern; None matches all."""
        wanted: list[int | None] = []
        for term in (s, p, o):
            number = None if term is None else self._terms.find(term)
            if term is not None and number is None:
                return []
            wanted.append(number)
        reading = self._reading()
        found = {
            form
            for fact in self._candidates(*wanted)
            for form in reading.equality.expand(fact)
            if form in reading.asserted or is_exported(form, self._terms)
        }
        found.update(self._equal_pairs(wanted))
        decode = self._terms.decode_fact
        return [
            decode(form)
            for form in sorted(found)
            if all(want in (None, have) for want, have in zip(wanted, form, strict=True))
        ]

    def explain(
        self, triple: Triple, budget_ms: float = 200, graphs_of: GraphsOf | None = None
    ) -> Proof | None:
        """Return a proof of least height, None if the triple does not hold.

        Parameters
        ----------
        triple : Triple
        budget_ms : float
            Give up, with None, after this many milliseconds.
        graphs_of : callable, optional
            Returns the names of the graphs that assert a triple, for the leaves.
        """
        s, p, o = map(self._terms.find_equal, triple)
        if s is None or p is None or o is None or not self.contains(triple):
            return None
        state = self._state
        held = next((f for f in self._forms((s, p, o)) if self._is_stored(f)), None)
        if held is None:
            gloss = Glossary(state.facts, self._terms).fact((s, p, o))
            return Proof(triple, gloss, _virtual_rule(p))
        prover = Prover(
            state.facts,
            state.equality,
            state.program,
            Asserted(state.asserted),
            self._terms,
            budget_ms,
            graphs_of,
        )
        return prover.prove(held)

    def inferred(self) -> Iterator[Triple]:
        """Yield every derived triple that no graph asserts: the content of the inferred graph."""
        decode = self._terms.decode_fact
        for fact in self._reading().everything():
            yield decode(fact)

    def same_as(self, term: Term) -> list[Term]:
        """Return all terms known to denote the same thing, the term itself included."""
        number = self._terms.find(term)
        if number is None:
            return [term]
        return [self._terms.decode(m) for m in self._state.equality.members(number)]

    def contradictions(self) -> list[Contradiction]:
        """Return what the asserted triples contradict now."""
        return self._describe(self._state.clashes.values(), None)

    def stats(self) -> dict[str, int | list[str]]:
        """Return sizes and what was left out."""
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

    # Inside.

    def _maintainer(self, size: int) -> Maintainer:
        settings = Settings(
            max_facts=51 * size + self._config.max_inferred,
            keep_ill_typed=self._config.ill_typed == "keep",
            user_rules=self._rules,
        )
        return Maintainer(self._terms, settings)

    def _encode(self, triples: Iterable[Triple]) -> list[Fact]:
        """Encode triples, leaving out triple terms and what is said of their reifiers."""
        batch = list(triples)
        self._reifiers |= {s for s, p, _ in batch if p == _REIFIES}
        plain = [
            t
            for t in batch
            if not _is_triple_term(t[2])
            and t[0] not in self._reifiers
            and not isinstance(t[0], Literal)
        ]
        self._skipped += len(batch) - len(plain)
        return self._terms.encode_all(plain)

    def _reading(self, draft: Draft | None = None) -> Reading:
        if draft is not None:
            return Reading(draft.layer, draft.equality, draft.asserted, self._terms)
        state = self._state
        return Reading(state.facts, state.equality, Asserted(state.asserted), self._terms)

    def _difference(self, draft: Draft) -> tuple[set[Fact], set[Fact]]:
        before, after = self._reading(), self._reading(draft)
        if not draft.is_rebuilt:
            return differences(before, after, draft.asserted)
        was, now = set(before.everything()), set(after.everything())
        return now - was, was - now

    def _forms(self, fact: Fact) -> Iterator[Fact]:
        """Yield a fact with each known literal of the same value as object."""
        s, p, o = fact
        return ((s, p, form) for form in (self._terms.variants(o) if o >= LITERAL else (o,)))

    def _is_stored(self, fact: Fact) -> bool:
        """Tell whether a fact is asserted or derived."""
        state = self._state
        if fact in state.asserted:
            return True
        s, p, o = state.equality.rewrite(fact)
        return s == o if p == SAME else state.facts.has(s, p, o)

    def _is_virtual(self, fact: Fact) -> bool:
        """Tell whether a fact is true of everything, or of every class or property."""
        has = self._state.facts.has
        s, p, o = self._state.equality.rewrite(fact)
        if p == TYPE and (o in (v.THING, v.RESOURCE) or (o == v.DATATYPE and s in _DATATYPES)):
            return True
        if p in (v.SUB_CLASS, v.EQUIVALENT_CLASS):
            is_class = s in (v.THING, v.NOTHING) or has(s, TYPE, v.CLASS)
            return is_class and (s == o or (p == v.SUB_CLASS and (o == v.THING or s == v.NOTHING)))
        if p in (v.SUB_PROPERTY, v.EQUIVALENT_PROPERTY) and s == o:
            return has(s, TYPE, v.OBJECT_PROPERTY) or has(s, TYPE, v.DATATYPE_PROPERTY)
        return False

    def _candidates(self, s: int | None, p: int | None, o: int | None) -> Iterator[Fact]:
        """Yield facts on representatives that may expand to a pattern."""
        facts, find = self._state.facts, self._state.equality.find
        for q in facts.predicates() if p is None else (find(p),):
            if s is not None:
                a = find(s)
                yield from ((a, q, x) for x in tuple(facts.objects(q, a)))
            elif o is not None:
                b = find(o)
                yield from ((x, q, b) for x in tuple(facts.subjects(q, b)))
            else:
                yield from ((x, q, y) for x, y in facts.pairs(q))

    def _equal_pairs(self, wanted: list[int | None]) -> Iterator[Fact]:
        equality = self._state.equality
        s, p, o = wanted
        if p not in (None, SAME):
            return
        ends = {equality.find(x) for x in (s, o) if x is not None}
        for number in ends or {representative for representative, _ in equality.classes()}:
            yield from equality.pairs(number)

    def _describe(
        self, findings: Iterable[Inconsistency], draft: Draft | None
    ) -> list[Contradiction]:
        reading = self._reading(draft)

        def asserted_form(fact: Fact) -> Fact:
            forms = [f for f in reading.equality.forms(fact) if f in reading.asserted]
            return min(forms, key=lambda f: str(self._terms.decode_fact(f)), default=fact)

        found = [describe(finding, self._terms, asserted_form) for finding in findings]
        return sorted(found, key=lambda c: c.message)[:LISTED_CONTRADICTIONS]


def _is_triple_term(term: object) -> bool:
    return isinstance(term, TripleTerm)


def _virtual_rule(p: int) -> str:
    """Return the rule behind a triple that is true of everything."""
    if p in (v.SUB_CLASS, v.EQUIVALENT_CLASS):
        return "scm-cls"
    return "scm-op" if p in (v.SUB_PROPERTY, v.EQUIVALENT_PROPERTY) else "cls-thing"
