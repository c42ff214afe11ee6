"""Check of a query: each rule looks at its outline, and repairs are tried before an offer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from rtask.asking.check.evidence import Evidence
from rtask.asking.check.faults import Faults
from rtask.asking.check.findings import Finding, in_order
from rtask.asking.check.fitting import Fitting
from rtask.asking.check.literals import check_literals
from rtask.asking.check.naming.aliases import name_by_aliases
from rtask.asking.check.syntax.outline import Outline
from rtask.asking.check.syntax.reading import read_outline
from rtask.asking.check.unknown import Unknown
from rtask.asking.check.variables import check_variables
from rtask.asking.check.vocabulary import Vocabulary
from rtask.errors import RtaskError
from rtask.rdf.terms import NamedNode
from rtask.sparql.syntax import check_query

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Checker", "check", "checker_of"]

_SUB_CLASS = "http://www.w3.org/2000/01/rdf-schema#subClassOf"
MAX_FINDINGS = 50


class Checker:
    """Checks queries against one graph, as it is at each check.

    The vocabulary is read again when a commit changes classes; what the data say is forgotten with
    each commit.
    """

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._seq = -1
        self._shape: object = None
        self._vocabulary: Vocabulary | None = None
        self._evidence = Evidence(kb)

    def check(self, text: str) -> list[Finding]:
        """Return the faults of a query that the store's parser accepts, certain ones first."""
        try:
            outline = self._outline(text)
        except RtaskError:
            return []  # a form that is not read: nothing is claimed about it, see :meth:`unread`
        return in_order(list(self._findings(outline)))[:MAX_FINDINGS]

    def unread(self, text: str) -> str:
        """Return why a query cannot be checked, though the store can answer it; empty if it can.

        That nothing was found in such a query says nothing about it.
        """
        try:
            self._outline(text)
        except RtaskError as error:
            return f"not checked: this form of a query is not read ({error.slug})"
        return ""

    def _outline(self, text: str) -> Outline:
        return read_outline(text, "" if self._kb.plain else self._kb.base)

    @property
    def vocabulary(self) -> Vocabulary:
        """The classes and properties of the graph as it is now."""
        kb = self._kb
        if self._vocabulary is None or self._seq != kb.seq:
            shape = self._outline_of_schema()
            if self._vocabulary is None or shape != self._shape:
                self._vocabulary, self._shape = Vocabulary(kb), shape
            self._seq = kb.seq
        return self._vocabulary

    def _outline_of_schema(self) -> object:
        """Return what changes with the classes and properties, and little else does."""
        graphs = self._kb.catalogue.ontologies()
        revisions = tuple(sorted(str(self._kb.catalogue.revision(graph)) for graph in graphs))
        rows = self._kb.store.quads_for_pattern(None, NamedNode(_SUB_CLASS), None, None)
        return revisions, len(graphs), sum(1 for _ in rows)

    def _findings(self, outline: Outline) -> Iterator[Finding]:
        vocabulary = self.vocabulary
        self._evidence.refresh()
        name_by_aliases(outline, vocabulary)
        fitting = Fitting(vocabulary, self._evidence, outline)
        yield from Unknown(self._kb, fitting, outline).findings()
        faults = Faults(fitting, outline)
        yield from check_literals(outline, vocabulary, self._evidence, faults.replacements)
        yield from faults.findings()
        yield from check_variables(outline)


_checkers: WeakKeyDictionary[GraphCore, Checker] = WeakKeyDictionary()


def checker_of(kb: GraphCore) -> Checker:
    """Return the checker of a graph, which remembers what it read."""
    checker = _checkers.get(kb)
    if checker is None:
        checker = _checkers[kb] = Checker(kb)
    return checker


def check(kb: GraphCore, text: str) -> list[Finding]:
    """Return the faults of a query that can be found before its answer is believed.

    Raises
    ------
    QuerySyntaxError
        The text is no query; gives line and column.
    """
    check_query(text, None if kb.plain else kb.base)
    return checker_of(kb).check(text)
