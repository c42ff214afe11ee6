"""User-defined rules: SPARQL CONSTRUCT texts that run in the same fixpoint as the ontology.

The text is parsed with rdflib's SPARQL algebra and compiled to the engine's atoms. Anything that a
monotone, terminating rule cannot contain is rejected, with its line and an alternative.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from pyoxigraph import Literal, NamedNode

from reasoner.rules.expressions import Assign, Constant, Expression, Operation, Test, Variable
from reasoner.rules.rule import Absent, Atom, Condition, Rule
from reasoner.terms.dictionary import Term
from reasoner.terms.vocabulary import TYPE

Encode = Callable[[Term], int]

_REFUSED = {
    "LeftJoin": ("OPTIONAL", "write one rule with and one without the optional part"),
    "Graph": ("GRAPH", "rules see the union of all graphs; leave GRAPH out"),
    "ServiceGraphPattern": ("SERVICE", "load the data first"),
    "AggregateJoin": ("aggregates", "run an aggregate as a query"),
    "Group": ("GROUP BY", "run an aggregate as a query"),
    "OrderBy": ("ORDER BY", "rules derive sets; leave it out"),
    "Slice": ("LIMIT", "rules derive sets; leave it out"),
    "ToMultiSet": ("VALUES or a subselect", "write FILTER (?x IN (...)) or one rule per value"),
    "Distinct": ("DISTINCT", "rules derive sets; leave it out"),
}
_KEYWORDS = {
    "LeftJoin": "OPTIONAL", "Graph": "GRAPH", "ServiceGraphPattern": "SERVICE",
    "AggregateJoin": "COUNT|SUM|AVG|MIN|MAX", "Group": r"GROUP\s+BY", "OrderBy": r"ORDER\s+BY",
    "Slice": "LIMIT|OFFSET", "ToMultiSet": "VALUES|SELECT", "Distinct": "DISTINCT",
}  # fmt: skip


class RuleError(ValueError):
    """A rule's text cannot be used.

    Attributes
    ----------
    reason : str
        The problem and its remedy, without the position.
    line, column : int or None
        Position in the text, counted from 1.
    """

    def __init__(self, reason: str, line: int | None = None, column: int | None = None) -> None:
        place = "" if line is None else f"line {line}"
        if line is not None and column is not None:
            place += f", column {column}"
        super().__init__(f"{place}: {reason}" if place else reason)
        self.reason = reason
        self.line = line
        self.column = column


@dataclass(frozen=True, slots=True)
class LabelledRule:
    """A rule's text under the label by which proofs name it.

    Attributes
    ----------
    text : str
        SPARQL CONSTRUCT query.
    label : str
        Without one, proofs name the rule after what it derives.
    """

    text: str
    label: str = ""


@dataclass(frozen=True)
class _Branch:
    """A conjunction: one way to fulfil a pattern."""

    atoms: tuple[Atom, ...] = ()
    conditions: tuple[Condition, ...] = ()

    def and_(self, other: _Branch) -> _Branch:
        return _Branch(self.atoms + other.atoms, self.conditions + other.conditions)


@dataclass
class _Scope:
    """Numbers of variables; names unknown outside a group stay inside it."""

    all_names: list[str]
    numbers: dict[str, int] = field(default_factory=dict)

    def number(self, name: str) -> int:
        if name not in self.numbers:
            self.numbers[name] = self.another(name)
        return self.numbers[name]

    def another(self, name: str = "_") -> int:
        self.all_names.append(name)
        return -len(self.all_names)

    def inner(self) -> _Scope:
        return _Scope(self.all_names, dict(self.numbers))


def compile_rule(rule: str | LabelledRule, encode: Encode) -> list[Rule]:
    """Compile a CONSTRUCT text.

    Parameters
    ----------
    rule : str or LabelledRule
        SPARQL 1.1 CONSTRUCT query.
    encode : callable
        Returns the id of a term.

    Returns
    -------
    list of Rule
        One per template triple and way to fulfil the pattern.

    Raises
    ------
    RuleError
        If the text does not parse or uses an unsupported construct.
    """
    given = LabelledRule(rule) if isinstance(rule, str) else rule
    algebra = _parse(given.text)
    if algebra.name != "ConstructQuery":
        raise RuleError("a rule is a CONSTRUCT query", 1)
    return list(_Translator(given, encode).rules(algebra))


@lru_cache(maxsize=256)
def _parse(text: str) -> Any:
    # rdflib takes 0.2 s to import, so it is imported only where rules are compiled.
    from pyparsing import ParseBaseException
    from rdflib.plugins.sparql.algebra import translateQuery
    from rdflib.plugins.sparql.parser import parseQuery

    try:
        return translateQuery(parseQuery(text)).algebra
    except ParseBaseException as error:
        raise RuleError(f"not a SPARQL query: {error.msg}", error.lineno, error.column) from error
    except Exception as error:
        raise RuleError(f"not a SPARQL query: {error}") from error


class _Translator:
    def __init__(self, rule: LabelledRule, encode: Encode) -> None:
        self.text = rule.text
        self.label = rule.label
        self.encode = encode
        self.names: list[str] = []

    def rules(self, algebra: Any) -> Iterator[Rule]:
        scope = _Scope(self.names)
        branches = self.pattern(algebra.p, scope)
        template = algebra.template or []
        if not template:
            raise RuleError("the template is empty", *self.place("CONSTRUCT"))
        for branch, (s, p, o) in itertools.product(branches, template):
            head = Atom(self.head(s, scope), self.predicate(p), self.head(o, scope))
            bound = {v for atom in branch.atoms for v in atom.variables}
            bound |= {v for c in branch.conditions for v in c.gives}
            if not head.variables <= bound:
                continue  # SPARQL leaves out template triples with an unbound variable
            local_name = re.split(r"[#/:]", str(o if head.p == TYPE else p))[-1]
            name = f"rule:{self.label or local_name}"
            rule = Rule(name, branch.atoms, head, (), branch.conditions, tuple(self.names))
            self.check_termination(rule)
            yield rule

    def check_termination(self, rule: Rule) -> None:
        assert rule.head is not None
        if not rule.body:
            raise RuleError("the pattern has no triples", *self.place("WHERE"))
        minted = {v for c in rule.conditions if isinstance(c, Assign) for v in c.gives}
        if minted & rule.head.variables and any(a.key == rule.head.key for a in rule.body):
            raise RuleError(
                "the rule makes new values from its own results and would not end",
                *self.place("BIND"),
            )

    # Patterns.

    def pattern(self, node: Any, scope: _Scope) -> list[_Branch]:
        name = node.name
        if name == "BGP":
            return self.basic(node.triples, scope)
        if name == "Project":
            return self.pattern(node.p, scope)
        if name == "Join":
            left, right = self.pattern(node.p1, scope), self.pattern(node.p2, scope)
            return [a.and_(b) for a, b in itertools.product(left, right)]
        if name == "Union":
            return self.pattern(node.p1, scope) + self.pattern(node.p2, scope)
        if name == "Filter":
            branches = self.pattern(node.p, scope)
            for part in _conjuncts(node.expr):
                branches = self.filter(part, branches, scope)
            return branches
        if name == "Extend":
            branches = self.pattern(node.p, scope)
            bound = Assign(scope.number(str(node.var)), self.expression(node.expr, scope))
            return [b.and_(_Branch(conditions=(bound,))) for b in branches]
        if name == "Minus":
            return self.minus(node, scope)
        what, instead = _REFUSED.get(name, (name, "rephrase the rule"))
        raise RuleError(
            f"{what} cannot be used in a rule; {instead}", *self.place(_KEYWORDS.get(name))
        )

    def filter(self, part: Any, branches: list[_Branch], scope: _Scope) -> list[_Branch]:
        kind = getattr(part, "name", None)
        if kind == "UnaryNot" and getattr(part.expr, "name", None) == "Builtin_EXISTS":
            kind, part = "Builtin_NOTEXISTS", part.expr
        if kind == "Builtin_EXISTS":
            groups = self.group(part.graph, scope.inner())
            return [a.and_(b) for a, b in itertools.product(branches, groups)]
        if kind == "Builtin_NOTEXISTS":
            groups = self.group(part.graph, scope.inner())
            absent = tuple(_absent(group, scope.numbers.values()) for group in groups)
            return [b.and_(_Branch(conditions=absent)) for b in branches]
        test = Test(self.expression(part, scope))
        return [b.and_(_Branch(conditions=(test,))) for b in branches]

    def group(self, graph: Any, scope: _Scope) -> list[_Branch]:
        if graph.name == "GroupGraphPatternSub":
            from rdflib.plugins.sparql.algebra import translateGroupGraphPattern

            graph = translateGroupGraphPattern(graph)
        return self.pattern(graph, scope)

    def minus(self, node: Any, scope: _Scope) -> list[_Branch]:
        branches = self.pattern(node.p1, scope)
        outer = set(scope.numbers.values())
        groups = self.pattern(node.p2, scope.inner())
        # Without a shared variable MINUS takes nothing away (SPARQL 1.1 Query 8.3.3).
        absent = tuple(a for a in (_absent(group, outer) for group in groups) if a.outer)
        return [b.and_(_Branch(conditions=absent)) for b in branches]

    def basic(self, triples: Iterable[Any], scope: _Scope) -> list[_Branch]:
        branches = [_Branch()]
        for s, p, o in triples:
            ways = self.path(self.node(s, scope), p, self.node(o, scope), scope)
            branches = [a.and_(_Branch(way)) for a, way in itertools.product(branches, ways)]
        return branches

    def path(self, s: int, p: Any, o: int, scope: _Scope) -> list[tuple[Atom, ...]]:
        from rdflib import URIRef, paths

        if isinstance(p, URIRef):
            return [(Atom(s, self.predicate(p), o),)]
        if isinstance(p, paths.InvPath):
            return self.path(o, p.arg, s, scope)
        if isinstance(p, paths.AlternativePath):
            return [way for arg in p.args for way in self.path(s, arg, o, scope)]
        if isinstance(p, paths.SequencePath):
            ends = [s, *(scope.another() for _ in p.args[1:]), o]
            parts = [
                self.path(a, arg, b, scope)
                for a, arg, b in zip(ends, p.args, ends[1:], strict=False)
            ]
            return [tuple(itertools.chain(*way)) for way in itertools.product(*parts)]
        if isinstance(p, paths.MulPath):
            raise RuleError(
                "paths with * + ? cannot be used in a rule; declare the property transitive",
                *self.place(r"[\w)>][*+?]"),
            )
        raise RuleError("a predicate must be an IRI or a path of IRIs", *self.place("WHERE"))

    # Terms and expressions.

    def predicate(self, p: Any) -> int:
        from rdflib import URIRef

        if not isinstance(p, URIRef):
            raise RuleError("a predicate must be an IRI; write one rule per predicate")
        return self.encode(NamedNode(str(p)))

    def head(self, node: Any, scope: _Scope) -> int:
        from rdflib import BNode

        if isinstance(node, BNode):
            raise RuleError("a rule cannot make blank nodes; name what it derives", 1)
        return self.node(node, scope)

    def node(self, node: Any, scope: _Scope) -> int:
        from rdflib import BNode
        from rdflib import Variable as RdflibVariable

        if isinstance(node, RdflibVariable):
            return scope.number(str(node))
        if isinstance(node, BNode):
            return scope.number(f"_:{node}")
        return self.encode(_term(node))

    def expression(self, node: Any, scope: _Scope) -> Expression:
        from rdflib import Variable as RdflibVariable
        from rdflib.term import Identifier

        if isinstance(node, RdflibVariable):
            return Variable(scope.number(str(node)))
        if isinstance(node, Identifier):
            return Constant(self.encode(_term(node)))
        return self.operation(node, scope)

    def operation(self, node: Any, scope: _Scope) -> Expression:
        def of(*nodes: Any) -> tuple[Expression, ...]:
            return tuple(self.expression(n, scope) for n in nodes)

        name = node.name
        if name in ("ConditionalAndExpression", "ConditionalOrExpression"):
            operator = "&&" if "And" in name else "||"
            return Operation(operator, of(node.expr, *node.other))
        if name == "RelationalExpression":
            others = node.other if isinstance(node.other, list) else [node.other]
            return Operation(str(node.op), of(node.expr, *others))
        if name in ("AdditiveExpression", "MultiplicativeExpression"):
            result = self.expression(node.expr, scope)
            for operator, other in zip(node.op, node.other, strict=True):
                if operator == "/":
                    raise RuleError("division cannot be used in a rule", *self.place("/"))
                result = Operation(str(operator), (result, self.expression(other, scope)))
            return result
        if name == "UnaryNot":
            return Operation("!", of(node.expr))
        if name in ("UnaryMinus", "UnaryPlus"):
            return Operation("-" if name == "UnaryMinus" else "+", of(node.expr))
        if name in ("Builtin_STR", "Builtin_DATATYPE", "Builtin_ABS"):
            return Operation(name.removeprefix("Builtin_"), of(node.arg))
        if name == "Builtin_IF":
            return Operation("IF", of(node.arg1, node.arg2, node.arg3))
        function = name.removeprefix("Builtin_")
        raise RuleError(
            f"{function} cannot be used in a rule; allowed are comparisons, && || ! IN, + - *, "
            "ABS, STR, DATATYPE, IF and NOT EXISTS as a whole filter",
            *self.place(function),
        )

    def place(self, pattern: str | None) -> tuple[int, int] | tuple[None, None]:
        """Return line and column of the first match of a keyword, outside IRIs and comments."""
        if pattern is None:
            return None, None
        for number, line in enumerate(self.text.splitlines(), 1):
            code = re.sub(r"<[^>]*>", lambda iri: "<" + " " * (len(iri[0]) - 2) + ">", line)
            match = re.search(pattern, re.sub(r"#.*", "", code), re.IGNORECASE)
            if match:
                return number, match.start() + 1
        return None, None


def _conjuncts(expression: Any) -> Iterator[Any]:
    if getattr(expression, "name", None) == "ConditionalAndExpression":
        yield from _conjuncts(expression.expr)
        for other in expression.other:
            yield from _conjuncts(other)
    else:
        yield expression


def _absent(group: _Branch, outer: Iterable[int]) -> Absent:
    inside = {v for atom in group.atoms for v in atom.variables}
    inside |= {v for c in group.conditions for v in c.needs}
    return Absent(group.atoms, group.conditions, frozenset(inside & set(outer)))


def _term(node: Any) -> Term:
    from rdflib import Literal as RdflibLiteral

    if isinstance(node, RdflibLiteral):
        if node.language:
            return Literal(str(node), language=node.language)
        if node.datatype:
            return Literal(str(node), datatype=NamedNode(str(node.datatype)))
        return Literal(str(node))
    return NamedNode(str(node))
