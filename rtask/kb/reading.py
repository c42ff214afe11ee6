"""The reading side of a knowledge base: queries and patterns."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pyoxigraph import Quad

from rtask.errors import UnsupportedError
from rtask.kb import query as queries
from rtask.kb.parts import Parts
from rtask.kb.query import Bindings, QueryDataset
from rtask.kb.results import Solutions, Triples
from rtask.kb.terms import Graph, NamedNode, Subject, Value, iri, object_term, subject_term

__all__ = ["Reading"]


class Reading(Parts):
    """Queries and patterns; from any thread."""

    def query(
        self,
        text: str,
        *,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        bindings: Bindings | None = None,
        base: str | None = None,
    ) -> Solutions | bool | Triples:
        """Evaluate a SPARQL query.

        Parameters
        ----------
        inferred
            Whether derived statements are seen.
        default_graphs, named_graphs
            The dataset; both together replace what ``FROM`` in the text says. Without either,
            triple patterns see the union of all graphs.
        bindings
            Values of variables: a term or Python value, or a list of them.
        base
            IRI against which relative IRIs are resolved.

        Raises
        ------
        QuerySyntaxError
            With line and column.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base)
        text = queries.bind(text, bindings or {})
        return queries.run(self.store, self.graphs, self.plain, text, dataset)

    def select(self, text: str, **options: Any) -> Solutions:
        """Evaluate a SELECT; the same as :meth:`query`, typed for rows."""
        answer = self.query(text, **options)
        if not isinstance(answer, Solutions):
            raise UnsupportedError("select() is for SELECT queries")
        return answer

    def serialize(
        self,
        text: str,
        media_type: str,
        *,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        bindings: Bindings | None = None,
        base: str | None = None,
    ) -> bytes:
        """Evaluate a query and return its answer in a media type; arguments as in :meth:`query`.

        Raises
        ------
        UsageError
            If the media type does not fit the kind of query.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base)
        text = queries.bind(text, bindings or {})
        return queries.serialize(self.store, self.graphs, self.plain, text, media_type, dataset)

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: Graph | str | None = None,
    ) -> list[Quad]:
        """Return the statements that fit a pattern; ``None`` fits everything.

        Without a graph every named graph is searched, so a triple that two graphs hold comes
        twice.
        """
        where = iri(graph) if isinstance(graph, str) else graph
        pattern = (
            None if subject is None else subject_term(subject),
            None if predicate is None else iri(predicate),
            None if value is None else object_term(value),
        )
        found = list(self.store.quads_for_pattern(*pattern, where))
        if where is not None or self.plain:
            return found
        return [quad for quad in found if isinstance(quad.graph_name, NamedNode)]
