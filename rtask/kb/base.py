"""The state that reading, writing, reasoning and watching share."""

from __future__ import annotations

from rtask.kb.commit.access import Access
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.commit import Request
from rtask.kb.commit.expiry import Expiry
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile, NoJournal
from rtask.kb.durability.private_copy import PrivateCopy
from rtask.kb.feed.feed import Feed
from rtask.kb.feed.following import Follower
from rtask.kb.feed.live_queries import LiveQueries
from rtask.kb.proposals.register import Proposals
from rtask.kb.readers.pool import Readers
from rtask.kb.search.index import SideIndex
from rtask.kb.search.places import PlaceTable
from rtask.kb.search.text import TextTable
from rtask.kb.store.embedded import embedded_store
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import NamedNode

__all__ = ["GraphBase"]


class GraphBase:
    """Own the store, the writer, the readers, the feed and the side index of one graph.

    The other files of this folder each add methods in a subclass;
    :class:`rtask.kb.core.GraphCore` combines them.

    Attributes
    ----------
    graphs
        Names of the graphs.
    blobs
        Byte strings that the graph refers to.
    folder
        Where the graph is stored; ``None`` in memory.
    store
        The quads; use it for reading only.
    proposals
        Changes that wait for a decision, and those that were decided.
    proposes_axioms
        Whether a change that is refused for lack of the right `schema` is kept as a proposal.
    """

    proposes_axioms = False

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
            files.read_from,
            frozen=files.is_frozen,
        )
        files.store.followers.append(self.readers.stored)
        journal = None if isinstance(files.journal, NoJournal) else files.journal
        last_seq = writer.committer.last_seq
        self.feed = Feed(self.epoch, files.store, catalogue, journal, self.plain, last_seq)
        self.live_queries = LiveQueries(lambda: self.feed.last_seq, self.feed.position)
        writer.listen(self.feed.announce)
        writer.listen(self.live_queries.announce)
        self.texts, self.places = TextTable(), PlaceTable(files.store)
        path = files.folder if files.checkpoints is not None else None
        tables = (self.texts, self.places)
        self.index = SideIndex(files.store, self.feed, path, self._is_indexed, tables)
        writer.listen(self.index.announce)
        self._follower = _follower(files, writer, self.feed)
        access = Access().bind(self.graphs, catalogue.is_ontology, self.plain)
        self.proposals = Proposals(files.folder)
        writer.propose = self._keep_refused
        self.expiry = Expiry(files.store, writer, access, self._is_indexed)
        writer.listen(self.expiry.announce)

    def _is_indexed(self, graph: object) -> bool:
        """Whether the side index covers a graph; derived and record-keeping graphs are left out."""
        if self.plain:
            return True
        return isinstance(graph, NamedNode) and not self.graphs.is_system(graph)

    def _keep_refused(self, overlay: Overlay, request: Request, reason: str) -> int | None:
        """Keep a change as a proposal, where that is so set; return its number."""
        if not self.proposes_axioms:
            return None
        author, seq = request.access.agent or "", self.seq
        return self.proposals.add(overlay.added, overlay.removed, author, seq, reason).number

    @property
    def writer(self) -> Writer:
        """What serialises the commits."""
        return self._writer

    def close(self) -> None:
        """Release what is open; :class:`rtask.kb.core.GraphCore` does it."""
        raise NotImplementedError

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
        """Identifier of the current commit numbering; restoring a backup starts a new one."""
        return self.settings.epoch

    @property
    def refuses_writes(self) -> bool:
        """Whether nothing may be written in its folder, because its disk is full."""
        return self._writer.refusal is not None

    @property
    def reasons(self) -> bool:
        """Whether the reasoner runs on each commit."""
        return self._inference is not None

    @property
    def seq(self) -> int:
        """Number of the last commit."""
        return self._writer.committer.last_seq

    def _look(self) -> None:
        """Take in the commits of a writer in another process, as reads of the store do."""
        if self._follower is not None:
            self._follower.look()


def _follower(files: Files, writer: Writer, feed: Feed) -> Follower | None:
    copy, store, journal = files.held, files.store, files.journal
    if not isinstance(copy, PrivateCopy) or not isinstance(journal, JournalFile):
        return None
    own = embedded_store(store, "following a writer")
    return Follower(copy, own, journal, writer, feed, files.settings.is_merged)
