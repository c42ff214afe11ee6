"""Methods that search: words in texts, and places."""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterator, Sequence
from dataclasses import replace

from rtask.kb.base import GraphBase
from rtask.kb.search.places import Place
from rtask.kb.search.text import TextHit
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import RDF_TYPE, NamedNode, iri
from rtask.sparql.service import with_text_matches

__all__ = ["Searching"]


class Searching(GraphBase):
    """Full-text and spatial search in the side index."""

    def search(
        self,
        text: str,
        *,
        cls: NamedNode | str | None = None,
        lang: str | None = None,
        limit: int = 20,
        among: Container[str] | None = None,
    ) -> list[TextHit]:
        """Return hits whose name, label, comment or description contains all words, best first.

        A line of print that was read on views of an object is a text of that object.

        Parameters
        ----------
        text
            Words; a final ``*`` matches any ending. Case and accents are ignored.
        cls
            Only instances of a class, derived ones included.
        lang
            Only texts in this language; ``en`` includes ``en-GB``.
        among
            Only these IRIs.

        Returns
        -------
        One hit for each subject: its best text.
        """
        class_iri = None if cls is None else iri(cls)
        best: dict[NamedNode, TextHit] = {}
        self._look()
        with self.index.reading() as db:
            hits = self.texts.search(db, text, lang)
            fitting = (
                hit
                for hit in itertools.chain.from_iterable(map(self._described, hits))
                if hit.subject not in best
                and (among is None or hit.subject.value in among)
                and self._is_a(hit.subject, class_iri)
            )
            for hit in fitting:
                best[hit.subject] = hit
                if len(best) >= limit:
                    break
        return list(best.values())

    def _described(self, hit: TextHit) -> Iterator[TextHit]:
        """Yield a hit; of a word that was read on views, one for each object that they show."""
        if hit.predicate != RT.wordText:
            yield hit
            return
        nodes = {hit.subject}
        for predicate in (RT.hasWord, RT.viewContent, RT.hasView):
            nodes = {
                quad.subject
                for node in nodes
                for quad in self.store.quads_for_pattern(None, predicate, node, None)
                if isinstance(quad.subject, NamedNode) and quad.graph_name != self.graphs.quarantine
            }
        for node in sorted(nodes, key=str):
            yield replace(hit, subject=node)

    def _is_a(self, subject: NamedNode, cls: NamedNode | None) -> bool:
        if cls is None:
            return True
        quads = self.store.quads_for_pattern(subject, RDF_TYPE, cls, None)
        return bool(list(itertools.islice(quads, 1)))

    def near(self, frame: NamedNode | str, point: Sequence[float], radius: float) -> list[Place]:
        """Return the poses in a frame within a radius of a point, nearest first.

        Parameters
        ----------
        frame
            IRI of the ``rt:Frame``; poses in other frames are not transformed.
        point
            (3,) x, y, z in metres, in ``frame``.
        radius
            In metres.
        """
        self._look()
        with self.index.reading() as db:
            return self.places.near(db, iri(frame), point, radius)

    def _expand_services(self, text: str) -> str:
        """Replace what this store answers itself in a query or update by the answers."""
        return with_text_matches(text, self.search)
