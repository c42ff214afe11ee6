"""What every side of a knowledge base works with."""

from __future__ import annotations

from rtask.kb.catalogue import Catalogue
from rtask.kb.folder import Files
from rtask.kb.inference import Inference
from rtask.kb.readers import Readers
from rtask.kb.writer import Writer

__all__ = ["Parts"]


class Parts:
    """The parts that reading, writing, reasoning and watching share.

    :class:`~rtask.kb.knowledge_base.KnowledgeBase` joins the sides, each of them in a file.
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

    @property
    def base(self) -> str:
        """IRI that starts every instance and graph."""
        return self.settings.base

    @property
    def plain(self) -> bool:
        """Whether this is a bare SPARQL dataset: no union, inference or provenance."""
        return self.settings.plain

    @property
    def seq(self) -> int:
        """Number of the last commit."""
        return self._writer.committer.last_seq
