"""Validation of nodes against SHACL shapes (W3C SHACL, 2017).

A thin wrapper around pySHACL, which takes 0.3 s to import and is imported on first use. Its own
inference is off, because the data already contain the closure.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner.terms.dictionary import Term, Triple

SHACL = "http://www.w3.org/ns/shacl#"
_log = logging.getLogger(__name__)
_CHATTY = ("pyshacl-validate", "rdflib.term")
"""Loggers that print to the standard error, with tracebacks, what the report says or data hold."""


@dataclass(frozen=True)
class Finding:
    """One result of a validation (SHACL 3.6).

    Attributes
    ----------
    focus : Term
        The node that fails.
    shape : Term
        The shape, or its property shape.
    path : str or None
        The property, in N-Triples; None for a constraint on the node itself.
    value : Term or None
        The offending value, if there is one.
    message : str
    severity : {"Violation", "Warning", "Info"}
    """

    focus: Term
    shape: Term
    path: str | None
    value: Term | None
    message: str
    severity: str


@dataclass(frozen=True)
class ShaclReport:
    """Whether the data conform, and where not."""

    conforms: bool
    findings: tuple[Finding, ...] = ()


class ShapesError(ValueError):
    """Shapes break the rules of SHACL, so that they cannot be applied."""


def validate(
    data: Iterable[Triple], shapes: Iterable[Triple], focus: Iterable[Term] | None = None
) -> ShaclReport:
    """Validate triples against shapes.

    Parameters
    ----------
    data : iterable of Triple
        Asserted and inferred; the types of values are looked up here.
    shapes : iterable of Triple
    focus : iterable of Term, optional
        Validate these nodes only; all targets without it.

    Returns
    -------
    ShaclReport
        Findings in a fixed order.

    Raises
    ------
    ShapesError
        The shapes break the rules of SHACL.
    """
    import pyshacl

    focus_nodes = None if focus is None else [_to_rdflib(node) for node in focus]
    if focus_nodes == []:
        return ShaclReport(conforms=True)
    with _quietly():
        graph, shacl_graph = _graph(data, _prepared_queries()), _graph(shapes)
    try:
        with _quietly():
            conforms, report, _ = pyshacl.validate(
                graph,
                shacl_graph=shacl_graph,
                inference="none",
                advanced=True,
                allow_warnings=True,
                inplace=True,
                focus_nodes=focus_nodes,
            )
    except MemoryError:
        raise
    except Exception as error:  # shapes decide what is raised: of re, of rdflib, of pyparsing
        reason = str(getattr(error, "message", "") or error)
        raise ShapesError(reason.partition("\nFor reference")[0]) from error
    if isinstance(report, Exception):
        raise ShapesError(str(getattr(report, "message", "") or report)) from report
    return ShaclReport(bool(conforms), tuple(sorted(_findings(report), key=str)))


@contextlib.contextmanager
def _quietly() -> Iterator[None]:
    """Log what pySHACL and rdflib say in this thread for debugging, instead of printing it."""
    _ignore_warnings()
    here = threading.get_ident()

    def keep(record: logging.LogRecord) -> bool:
        if record.thread != here:
            return True
        _log.debug("%s: %s", record.name, record.getMessage())
        return False

    loggers = [logging.getLogger(name) for name in _CHATTY]
    for logger in loggers:
        logger.addFilter(keep)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeFilter(keep)


@lru_cache(maxsize=1)
def _ignore_warnings() -> None:
    """Ignore the warnings of pySHACL, which are about its own use of rdflib and of memory."""
    warnings.filterwarnings("ignore", module=r"pyshacl(\.|$)")


def _graph(triples: Iterable[Triple], store: Any = "default") -> Any:
    from rdflib import Graph

    graph = Graph(store)
    converted = lru_cache(maxsize=None)(_to_rdflib)
    for triple in triples:
        # Term by term: a parser would rename the blank nodes that focus and findings name.
        graph.add(tuple(map(converted, triple)))
    return graph


def _prepared_queries() -> Any:
    """Return a store in memory that parses each query once.

    pySHACL sends the text of a SPARQL constraint once for each focus node (SHACL 5.3), and rdflib
    would parse it each time, which takes some twenty times as long as the answer.
    """
    from rdflib import Graph
    from rdflib.plugins.sparql import prepareQuery
    from rdflib.plugins.sparql.evaluate import evalQuery
    from rdflib.plugins.sparql.processor import SPARQLResult
    from rdflib.plugins.stores.memory import Memory

    prepared: dict[str, Any] = {}

    class PreparedQueries(Memory):
        def query(
            self,
            query: Any,  # the names are those of rdflib
            initNs: Any,
            initBindings: Any,
            queryGraph: Any,
            **kwargs: Any,
        ) -> Any:
            if query not in prepared:
                prepared[query] = prepareQuery(query, initNs=initNs)
            return SPARQLResult(evalQuery(Graph(self, queryGraph), prepared[query], initBindings))

    return PreparedQueries()


def _findings(report: Any) -> Iterable[Finding]:
    from rdflib import RDF, Namespace

    sh = Namespace(SHACL)
    details = set(report.objects(None, sh.detail))  # of results, not results themselves (3.6.2)
    for result in report.subjects(RDF.type, sh.ValidationResult):
        if result in details:
            continue
        path, value = report.value(result, sh.resultPath), report.value(result, sh.value)
        message = report.value(result, sh.resultMessage)
        severity = str(report.value(result, sh.resultSeverity)).removeprefix(SHACL)
        yield Finding(
            _from_rdflib(report.value(result, sh.focusNode)),
            _from_rdflib(report.value(result, sh.sourceShape)),
            None if path is None else path.n3(),
            None if value is None else _from_rdflib(value),
            "" if message is None else str(message),
            severity,
        )


def _to_rdflib(term: Term) -> Any:
    import rdflib

    if isinstance(term, NamedNode):
        return rdflib.URIRef(term.value)
    if isinstance(term, BlankNode):
        return rdflib.BNode(term.value)
    datatype = None if term.language else rdflib.URIRef(term.datatype.value)
    return rdflib.Literal(term.value, lang=term.language, datatype=datatype, normalize=False)


def _from_rdflib(node: Any) -> Term:
    import rdflib

    if isinstance(node, rdflib.URIRef):
        return NamedNode(str(node))
    if isinstance(node, rdflib.BNode):
        return BlankNode(str(node))
    if node.language:
        return Literal(str(node), language=node.language)
    if node.datatype:
        return Literal(str(node), datatype=NamedNode(str(node.datatype)))
    return Literal(str(node))
