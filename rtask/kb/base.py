"""What every side of a knowledge base works with."""

from __future__ import annotations

from rtask.kb.commit.access import Access
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.expiry import Expiry
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile
from rtask.kb.feed.feed import Feed
from rtask.kb.feed.live_queries import StandingQueries
from rtask.kb.readers.pool import Readers
from rtask.kb.search.index import SideIndex
from rtask.kb.search.places import PlaceTable
from rtask.kb.search.text import TextTable
from rtask.rdf.terms import NamedNode

__all__ = ["Parts"]


class Parts:
    """The parts that reading, writing, reasoning and watching share.

    :class:`~rtask.knowledge_base.KnowledgeBase` joins the sides, each of them in a file.
    """

    def __init__(
        self,
        files: Files,
        catalogue: Catalogue,
        inference: Inference | None,
        writer: Writer,
    ) -> None:
        self.settings = files.settings
        self.graphs = catalogue.graphs
        self.store = files.store
        self.blobs = files.blobs
        self.folder = files.folder
        self.catalogue = catalogue
        self._files = files
        self._inference = inference
        self._writer = writer
        self.readers = Readers(
            files.store,
            lambda: writer.committer.last_seq,
            files.folder,
            frozen=files.checkpoints is None,
        )
        files.store.followers.append(self.readers.stored)
        journal = files.journal if isinstance(files.journal, JournalFile) else None
        last_seq = writer.committer.last_seq
        self.feed = Feed(self.epoch, files.store, catalogue, journal, self.plain, last_seq)
        self.standing = StandingQueries(lambda: self.feed.last_seq, self.feed.position)
        writer.listen(self.feed.announce)
        writer.listen(self.standing.announce)
        self.texts, self.places = TextTable(), PlaceTable(files.store)
        path = files.folder if files.checkpoints is not None else None
        tables = (self.texts, self.places)
        self.index = SideIndex(files.store, self.feed, path, self._is_indexed, tables)
        writer.listen(self.index.announce)
        access = Access().bind(self.graphs, catalogue.is_ontology, self.plain)
        self.expiry = Expiry(files.store, writer, access, self._is_indexed)
        writer.listen(self.expiry.announce)

    def _is_indexed(self, graph: object) -> bool:
        """Whether a graph's words and places are found; the others repeat or derive."""
        if self.plain:
            return True
        return isinstance(graph, NamedNode) and not self.graphs.is_kept_by_commits(graph)

    @property
    def base(self) -> str:
        """IRI that starts every instance and graph."""
        return self.settings.base

    @property
    def plain(self) -> bool:
        """Whether this is a bare SPARQL dataset: no union, inference or provenance."""
        return self.settings.plain

    @property
    def epoch(self) -> str:
        """Under which the commits are numbered; another one after a backup was restored."""
        return self.settings.epoch

    @property
    def seq(self) -> int:
        """Number of the last commit."""
        return self._writer.committer.last_seq
