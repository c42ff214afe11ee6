"""Short renderings of triples: local names, anonymous classes spelled out."""

from __future__ import annotations

from collections.abc import Callable

from pyoxigraph import BlankNode, Literal

from reasoner.rules.rule import Atom, Bindings, View
from reasoner.rules.schema import BadListError, read_list
from reasoner.terms import vocabulary as v
from reasoner.terms.dictionary import Dictionary, Fact, Term
from reasoner.terms.vocabulary import LITERAL, TYPE

_KINDS = {v.SOME: "some", v.ALL: "only", v.HAS_VALUE: "value", v.MAX: "max"}
_JOINS = {v.INTERSECTION: " and ", v.UNION: " or "}
MAX_DEPTH = 4
Name = Callable[[Term], str]
"""Returns the short name of a term."""


def local_name(term: Term) -> str:
    """Return the last part of an IRI, or a literal in quotes.

    >>> from pyoxigraph import NamedNode
    >>> local_name(NamedNode("urn:x#mug")), local_name(Literal(1))
    ('mug', '"1"')
    """
    if isinstance(term, Literal):
        return f'"{term.value}"'
    if isinstance(term, BlankNode):
        return str(term)
    name = term.value.rstrip("/#")
    return name[max(name.rfind(c) for c in "#/:") + 1 :]


class Glossary:
    """Readable forms of facts in one state of a closure."""

    def __init__(self, view: View, terms: Dictionary, name: Name = local_name) -> None:
        self._view = view
        self._name = name
        self._terms = terms

    def fact(self, fact: Fact) -> str:
        """Return a fact in short, such as `mug a (hasFeature some Handle)`."""
        s, p, o = fact
        return f"{self.term(s)} {self.predicate(p)} {self.term(o)}"

    def predicate(self, p: int) -> str:
        """Return a predicate in short."""
        return "a" if p == TYPE else self.term(p)

    def term(self, number: int, depth: int = 0) -> str:
        """Return a term in short, an anonymous class by its definition."""
        if number < LITERAL and self._terms.is_blank(number) and depth < MAX_DEPTH:
            meaning = self._restriction(number, depth) or self._combination(number, depth)
            if meaning:
                return f"({meaning})"
        return self._name(self._terms.decode(number))

    def pattern(self, atom: Atom, env: Bindings, names: tuple[str, ...]) -> str:
        """Return an atom with its bound variables filled in."""

        def part(x: int) -> str:
            bound = x if x >= 0 else env[~x]
            return f"?{names[~x] if ~x < len(names) else -x}" if bound is None else self.term(bound)

        return f"{part(atom.s)} {self.predicate(atom.p)} {part(atom.o)}"

    def _restriction(self, number: int, depth: int) -> str:
        for p in sorted(self._view.objects(v.ON_PROPERTY, number)):
            for kind, word in _KINDS.items():
                for value in sorted(self._view.objects(kind, number)):
                    return f"{self.term(p)} {word} {self.term(value, depth + 1)}"
        return ""

    def _combination(self, number: int, depth: int) -> str:
        for kind, joint in _JOINS.items():
            for head in sorted(self._view.objects(kind, number)):
                try:
                    members, _ = read_list(self._view, head)
                except BadListError:
                    continue
                return joint.join(self.term(m, depth + 1) for m in members)
        for c in sorted(self._view.objects(v.COMPLEMENT, number)):
            return f"not {self.term(c, depth + 1)}"
        return ""
