"""Entailment of triples: by look-up first, then by refutation.

A triple that is not in the closure is negated with fresh constants and staged; a contradiction
proves it. Always sound, but complete for simple cases only (OWL 2 Profiles 4.3, theorem PR1 covers
assertions; the rest goes beyond it).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import combinations, count

from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner.closure import Closure
from reasoner.decisions import Budget, OutOfBudgetError
from reasoner.proofs import Decision, Proof
from reasoner.terms.datatypes import is_within
from reasoner.terms.dictionary import Term, Triple
from reasoner.terms.vocabulary import OWL, RDF, RDFS, XSD

FRESH = "urn:rtask:fresh:"
STAGING = 2_000
"""Work of one test by contradiction, in rows."""


def _owl(name: str) -> NamedNode:
    return NamedNode(OWL + name)


def _rdfs(name: str) -> NamedNode:
    return NamedNode(RDFS + name)


TYPE, FIRST, REST, NIL = (NamedNode(RDF + name) for name in ("type", "first", "rest", "nil"))
SAME, DIFFERENT, COMPLEMENT = (_owl(n) for n in ("sameAs", "differentFrom", "complementOf"))
ALL_DIFFERENT, ANNOTATION = _owl("AllDifferent"), _owl("AnnotationProperty")
DECLARED = {
    *map(
        _owl,
        ("Ontology", "Class", "ObjectProperty", "DatatypeProperty", "AnnotationProperty",
         "NamedIndividual", "Thing", "Restriction"),
    ),
    _rdfs("Class"),
    NamedNode(RDF + "Property"),
    NamedNode(RDF + "List"),
}  # fmt: skip
HEADERS = {*map(_owl, ("imports", "versionIRI", "versionInfo", "priorVersion"))}
ANNOTATIONS = {*map(_rdfs, ("comment", "label", "seeAlso", "isDefinedBy"))}
DEFINING = {
    FIRST,
    REST,
    *map(
        _owl,
        ("onProperty", "onClass", "someValuesFrom", "allValuesFrom", "hasValue", "minCardinality",
         "maxCardinality", "cardinality", "maxQualifiedCardinality", "intersectionOf", "unionOf",
         "oneOf", "complementOf", "members", "distinctMembers"),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Entailment:
    """Whether a conclusion follows.

    Attributes
    ----------
    answer : bool or None
        None if a part could neither be found nor negated.
    proofs : tuple of Proof
        Of the parts that were found.
    missing : tuple of Triple
        Parts that do not follow.
    undecided : tuple of Triple
        Parts that could neither be found nor negated, or not within the budget.
    is_inconsistent : bool
        Whether the premise contradicts itself, from which everything follows.
    is_spent : bool
        Whether the budget ended the search, so that a larger one may decide more.
    """

    answer: bool | None
    proofs: tuple[Proof, ...] = ()
    missing: tuple[Triple, ...] = ()
    undecided: tuple[Triple, ...] = ()
    is_inconsistent: bool = False
    is_spent: bool = False


@dataclass
class _Conclusion:
    """A conclusion, split into statements and the definitions of the expressions in them."""

    statements: list[Triple] = field(default_factory=list)
    definitions: list[Triple] = field(default_factory=list)

    def values(self, subject: Term, predicate: NamedNode) -> list[Term]:
        return [o for s, p, o in self.definitions if s == subject and p == predicate]

    def members(self, head: Term) -> list[Term]:
        items: list[Term] = []
        while head != NIL and len(items) <= len(self.definitions):
            (item,), (head,) = self.values(head, FIRST), self.values(head, REST)
            items.append(item)
        return items


def entails(
    closure: Closure,
    conclusion: Iterable[Triple],
    semantics: str = "rl",
    *,
    budget: int | None = None,
    explain: Callable[[Triple], Decision] | None = None,
) -> Entailment:
    """Tell whether every triple of a conclusion follows from a closure.

    Parameters
    ----------
    closure : Closure
        Of the premise; not modified.
    conclusion : iterable of Triple
        Blank nodes are existentially quantified.
    semantics : {"rl", "direct"}
        Under "direct", annotations and class expressions that no axiom uses have no meaning (OWL 2
        Direct Semantics).
    budget : int, optional
        Rows to look at, a test by contradiction counting as 2,000; what is not decided within it
        stays undecided.
    explain : callable, optional
        Returns the proof of a triple that holds, instead of `closure.explain`.

    Examples
    --------
    >>> a, b, p = (NamedNode(f"urn:{x}") for x in "abp")
    >>> functional = (p, TYPE, _owl("FunctionalProperty"))
    >>> closure = Closure.build([functional], [(a, p, a), (b, p, b), (a, DIFFERENT, b)])
    >>> entails(closure, [(b, DIFFERENT, a)]).answer
    True
    """
    if semantics not in ("rl", "direct"):
        raise ValueError(f"semantics is 'rl' or 'direct', not {semantics!r}")
    # From a contradiction everything follows, and a test by contradiction would prove anything.
    if closure.contradictions():
        return Entailment(True, is_inconsistent=True)
    work = Budget(sys.maxsize if budget is None else budget)
    prove = explain or closure.explain
    parts = _normalise(closure, list(conclusion), semantics)
    missing = [s for s in parts.statements if not _is_entailed(closure, s)]
    absent = set(missing)
    attempts = [prove(s) for s in parts.statements if s not in absent]
    proofs = tuple(proof for proof in attempts if isinstance(proof, Proof))
    try:
        if missing and _match_all(closure, [*missing, *parts.definitions], {}, work):
            return Entailment(True, proofs)
    except OutOfBudgetError:
        return Entailment(None, proofs, (), tuple(missing), is_spent=True)
    answers = [(s, _refute_within(closure, s, parts, work)) for s in missing]
    wrong = tuple(s for s, answer in answers if answer is False)
    undecided = tuple(s for s, answer in answers if answer is None)
    answer = False if wrong else None if undecided else True
    return Entailment(answer, proofs, wrong, undecided, is_spent=work.is_spent)


def _refute_within(
    closure: Closure, statement: Triple, parts: _Conclusion, work: Budget
) -> bool | None:
    """Return the answer of :func:`_refute`, or None once the budget is spent."""
    try:
        return _refute(closure, statement, parts, work)
    except OutOfBudgetError:
        return None


def _normalise(closure: Closure, triples: list[Triple], semantics: str) -> _Conclusion:
    out = _Conclusion()
    ignored: set[Term] = set(ANNOTATIONS)
    ignored |= {s for s, p, o in triples if p == TYPE and o == ANNOTATION}
    ignored |= {s for s, _, _ in closure.match(None, TYPE, ANNOTATION)}
    for s, p, o in triples:
        if p in HEADERS or (p == TYPE and o in DECLARED):
            continue
        if semantics == "direct" and p in ignored:
            continue
        part = out.definitions if p in DEFINING and isinstance(s, BlankNode) else out.statements
        part.append((s, p, o))
    for axiom in [s for s, p, o in out.statements if p == TYPE and o == ALL_DIFFERENT]:
        out.statements.remove((axiom, TYPE, ALL_DIFFERENT))
        for name in ("members", "distinctMembers"):
            for head in out.values(axiom, _owl(name)):
                pairs = combinations(out.members(head), 2)
                out.statements += [(a, DIFFERENT, b) for a, b in pairs]
    if semantics == "rl":
        used = {o for _, _, o in (*out.statements, *out.definitions)}
        unused = [t for t in out.definitions if t[0] not in used and t[1] != COMPLEMENT]
        out.statements += [t for t in unused if not str(t[1]).endswith("embers>")]
    return out


def _is_entailed(closure: Closure, statement: Triple) -> bool:
    s, p, o = statement
    if isinstance(s, BlankNode) or isinstance(o, BlankNode):
        return False
    if closure.contains(statement):
        return True
    return s == o and _is_reflexive(closure, p)


def _is_reflexive(closure: Closure, p: Term) -> bool:
    """Return whether a property or one of its sub-properties is reflexive."""
    below = _rdfs("subPropertyOf")
    reflexive = [q for q, _, _ in closure.match(None, TYPE, _owl("ReflexiveProperty"))]
    return any(q == p or closure.contains((q, below, p)) for q in reflexive)


def _match_all(
    closure: Closure,
    patterns: list[Triple],
    bound: dict[Term, Term],
    work: Budget,
) -> bool:
    """Tell whether the patterns hold for some value of their blank nodes."""
    if not patterns:
        return True

    def bound_term(term: Term) -> Term | None:
        return bound.get(term) if isinstance(term, BlankNode) else term

    # The pattern with most terms known has the fewest rows, and binds what the others share.
    best = max(patterns, key=lambda t: sum(bound_term(x) is not None for x in t))
    rest = [t for t in patterns if t is not best]
    rows = closure.match(*(bound_term(x) for x in best))
    work.spend(1 + len(rows))
    for triple in rows:
        extended = dict(bound)
        for pattern, value in zip(best, triple, strict=True):
            if isinstance(pattern, BlankNode):
                extended[pattern] = value
        if _match_all(closure, rest, extended, work):
            return True
    return False


Negation = Iterator[list[Triple]]
_fresh = count()


def _new(kind: str = "x") -> NamedNode:
    return NamedNode(f"{FRESH}{kind}{next(_fresh)}")


def _refute(closure: Closure, statement: Triple, parts: _Conclusion, work: Budget) -> bool | None:
    """Tell whether every negation of a statement gives a contradiction; None if it has none."""
    s, p, o = statement
    if p == _rdfs("range") and isinstance(o, NamedNode) and o.value.startswith(XSD):
        ranges = [r.value for _, _, r in closure.match(s, p) if isinstance(r, NamedNode)]
        return is_within(ranges, o.value)
    negations = list(_negations(closure, statement, parts))
    if not negations:
        return None
    for negation in negations:
        work.spend(STAGING)
        staged = closure.stage(add=[*parts.definitions, *negation])
        # One model in which the statement fails is enough: the other negations need no look.
        contradicts = bool(staged.contradictions)
        staged.discard()
        if not contradicts:
            return False
    return True


def _negations(closure: Closure, statement: Triple, parts: _Conclusion) -> Negation:
    """Yield the assumptions each of which must lead to a contradiction to prove the statement."""
    s, p, o = statement
    if p == TYPE and o in _CHARACTERISTICS:
        if not _is_data(closure, s):
            yield from _CHARACTERISTICS[o](s)
    elif p == _owl("propertyChainAxiom"):
        links = parts.members(o)
        nodes = [_new() for _ in range(len(links) + 1)]
        steps: list[Triple] = [(a, q, b) for a, q, b in zip(nodes, links, nodes[1:], strict=False)]
        yield [*steps, *_denied(nodes[0], s, nodes[-1])]
    elif p in _AXIOMS:
        of_properties = p not in (
            _rdfs("subClassOf"),
            *map(_owl, ("equivalentClass", "disjointWith")),
        )
        # The assumptions name new individuals, which are no values of a data property.
        if not (of_properties and _is_data(closure, s)):
            yield from _AXIOMS[p](s, o)
    elif p == TYPE:
        complements = parts.values(o, COMPLEMENT)
        if complements:
            for c in complements:
                yield [(s, TYPE, c)]
        else:
            yield _outside(s, o)
    elif p == SAME:
        yield [(s, DIFFERENT, o)]
    elif p == DIFFERENT:
        yield [(s, SAME, o)]
    elif not isinstance(s, BlankNode) and not isinstance(o, BlankNode):
        yield _denied(s, p, o)


def _is_data(closure: Closure, p: Term) -> bool:
    return closure.contains((p, TYPE, _owl("DatatypeProperty")))


def _outside(x: Term, c: Term) -> list[Triple]:
    """`x` is not in class `c`."""
    complement = _new("not")
    return [(complement, COMPLEMENT, c), (x, TYPE, complement)]


def _denied(x: Term, p: Term, y: Term) -> list[Triple]:
    """`x p y` does not hold."""
    axiom = _new("denial")
    target = _owl("targetValue" if isinstance(y, Literal) else "targetIndividual")
    return [
        (axiom, TYPE, _owl("NegativePropertyAssertion")),
        (axiom, _owl("sourceIndividual"), x),
        (axiom, _owl("assertionProperty"), p),
        (axiom, target, y),
    ]


def _below_class(c: Term, d: Term) -> Negation:
    x = _new()
    yield [(x, TYPE, c), *_outside(x, d)]


def _below_property(p: Term, q: Term) -> Negation:
    x, y = _new(), _new()
    yield [(x, p, y), *_denied(x, q, y)]


def _inverse(p: Term, q: Term) -> Negation:
    for forward, other in ((p, q), (q, p)):
        x, y = _new(), _new()
        yield [(x, forward, y), *_denied(y, other, x)]


def _both(one_sided: Callable[[Term, Term], Negation]) -> Callable[[Term, Term], Negation]:
    def both_ways(a: Term, b: Term) -> Negation:
        yield from one_sided(a, b)
        yield from one_sided(b, a)

    return both_ways


def _disjoint_classes(c: Term, d: Term) -> Negation:
    x = _new()
    yield [(x, TYPE, c), (x, TYPE, d)]


def _disjoint_properties(p: Term, q: Term) -> Negation:
    x, y = _new(), _new()
    yield [(x, p, y), (x, q, y)]


def _domain(p: Term, c: Term) -> Negation:
    x, y = _new(), _new()
    yield [(x, p, y), *_outside(x, c)]


def _range(p: Term, c: Term) -> Negation:
    x, y = _new(), _new()
    yield [(x, p, y), *_outside(y, c)]


def _characteristic(name: str) -> Callable[[Term], Negation]:
    def negation(p: Term) -> Negation:
        x, y, z = _new(), _new(), _new()
        apart = (y, DIFFERENT, z)
        forms: dict[str, list[tuple[Term, Term, Term]]] = {
            "Transitive": [(x, p, y), (y, p, z), *_denied(x, p, z)],
            "Symmetric": [(x, p, y), *_denied(y, p, x)],
            "Asymmetric": [(x, p, y), (y, p, x)],
            "Irreflexive": [(x, p, x)],
            "Reflexive": _denied(x, p, x),
            "Functional": [(x, p, y), (x, p, z), apart],
            "InverseFunctional": [(y, p, x), (z, p, x), apart],
        }
        yield forms[name]

    return negation


_CHARACTERISTICS: dict[Term, Callable[[Term], Negation]] = {
    _owl(f"{name}Property"): _characteristic(name)
    for name in ("Transitive", "Symmetric", "Asymmetric", "Irreflexive", "Reflexive", "Functional",
                 "InverseFunctional")
}  # fmt: skip
_AXIOMS: dict[Term, Callable[[Term, Term], Negation]] = {
    _rdfs("subClassOf"): _below_class,
    _owl("equivalentClass"): _both(_below_class),
    _owl("disjointWith"): _disjoint_classes,
    _rdfs("subPropertyOf"): _below_property,
    _owl("equivalentProperty"): _both(_below_property),
    _owl("propertyDisjointWith"): _disjoint_properties,
    _owl("inverseOf"): _inverse,
    _rdfs("domain"): _domain,
    _rdfs("range"): _range,
}
