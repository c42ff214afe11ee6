"""Opening: a folder, memory, or a server; every failure says what to do."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import Store

from rtask.errors import StoreError, StoreFormatError, UnsupportedError, UsageError
from rtask.kb.apply import Writes
from rtask.kb.blobs import BlobStore
from rtask.kb.catalogue import Catalogue, CommitRecord
from rtask.kb.commit import Committer
from rtask.kb.graphs import Graphs
from rtask.kb.inference import Inference
from rtask.kb.knowledge_base import KnowledgeBase
from rtask.kb.lock import FolderLock
from rtask.kb.settings import Settings
from rtask.kb.store import GraphStore
from rtask.kb.writer import Writer

__all__ = ["open_knowledge_base"]

_log = logging.getLogger(__name__)
_MODES = ("rw", "r", "new")


@dataclass(frozen=True)
class _Options:
    mode: str
    base: str | None
    flush: str
    plain: bool
    reason: bool
    ontologies: bool


def open_knowledge_base(
    target: str | Path,
    *,
    mode: str = "rw",
    base: str | None = None,
    flush: str = "commit",
    plain: bool = False,
    reason: bool = True,
    validate: bool = False,
    ontologies: bool = True,
) -> KnowledgeBase:
    """Open a knowledge base.

    Parameters
    ----------
    target
        A folder, ``":memory:"`` or the address of a SPARQL 1.1 server.
    mode
        ``"rw"`` makes the folder if it does not exist, ``"new"`` refuses one that does, ``"r"``
        reads beside other readers.
    base
        IRI that starts every instance; random where it is not given. Fixed when the folder is
        made.
    flush
        When a commit is acknowledged: ``"commit"`` after it survives a power cut, ``"os"`` after
        it survives the end of the process.
    plain
        A bare SPARQL 1.1 dataset: no union default graph, inference or provenance.
    reason
        Derive what follows within each commit.
    validate
        Check SHACL shapes on write.
    ontologies
        Load the ontology that comes with RTASK into a new knowledge base, and its newer version
        into an old one.

    Raises
    ------
    StoreLockedError
        Another process has the folder open; says which.
    StoreFormatError
        The folder is no knowledge base, or one of another format.
    """
    if mode not in _MODES:
        raise UsageError(f"unknown mode {mode!r}; one of {', '.join(_MODES)}")
    if flush not in ("commit", "os"):
        raise UsageError(f"unknown flush policy {flush!r}; one of commit, os")
    if validate:
        raise UnsupportedError("validation on write is not available yet")
    text = str(target)
    if text.startswith(("http://", "https://", "sparql+http")):
        raise UnsupportedError(f"{text}: remote stores are not available yet; open a folder")
    options = _Options(mode, base, flush, plain, reason, ontologies)
    if text == ":memory:":
        return _in_memory(options)
    return _in_folder(Path(text), options)


def _in_memory(options: _Options) -> KnowledgeBase:
    settings = Settings.new(options.base, options.plain)
    kb = _assemble(GraphStore(Store()), settings, BlobStore(None), options, None, lambda: None)
    _fill(kb, options)
    return kb


def _in_folder(folder: Path, options: _Options) -> KnowledgeBase:
    settings = _find(folder, options)
    if settings is None:
        settings = _make(folder, options)
    settings.require(folder, options.base, options.plain)
    reading = options.mode == "r"
    lock = FolderLock(folder, shared=reading)
    try:
        store = _open_store(folder, reading)
        blobs = BlobStore(folder / "blobs", writable=not reading)
        kb = _assemble(store, settings, blobs, options, folder, lock.release)
        kb.publish = lock.publish
        if reading:
            kb.forbid_writing()
        else:
            _fill(kb, options)
    except BaseException:
        lock.release()
        raise
    return kb


def _find(folder: Path, options: _Options) -> Settings | None:
    """Return the settings of an existing knowledge base, ``None`` where one may be made."""
    if folder.exists() and not folder.is_dir():
        raise StoreFormatError(f"{folder} is a file; a knowledge base is a folder")
    if (folder / "kb.json").exists():
        if options.mode == "new":
            raise StoreFormatError(f"{folder} is a knowledge base already; open it with mode='rw'")
        return Settings.load(folder)
    if options.mode == "r" or (folder.is_dir() and any(folder.iterdir())):
        return Settings.load(folder)
    return None


def _make(folder: Path, options: _Options) -> Settings:
    settings = Settings.new(options.base, options.plain)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        settings.save(folder)
    except OSError as error:
        raise StoreError(f"cannot make a knowledge base in {folder}: {error.strerror}") from error
    return settings


def _open_store(folder: Path, reading: bool) -> GraphStore:
    path = str(folder / "store")
    try:
        return GraphStore(Store.read_only(path) if reading else Store(path))
    except OSError as error:
        raise StoreError(f"the store in {folder} cannot be opened: {error}") from error


def _assemble(
    store: GraphStore,
    settings: Settings,
    blobs: BlobStore,
    options: _Options,
    folder: Path | None,
    on_close: Callable[[], None],
) -> KnowledgeBase:
    graphs = Graphs(settings.base)
    catalogue = Catalogue(store, graphs)
    inference = None
    import reasoner

    if options.reason and not settings.plain and hasattr(reasoner, "Closure"):
        inference = Inference(store, graphs, catalogue.is_ontology)
    committer = Committer(
        store,
        graphs,
        settings.plain,
        blobs,
        catalogue,
        inference,
        _record_nothing,
        last_seq=catalogue.seq,
    )
    writer = Writer(committer, lambda seq: None)
    return KnowledgeBase(store, settings, blobs, catalogue, inference, writer, folder, on_close)


def _record_nothing(record: CommitRecord, writes: Writes) -> None:
    """Journal of a store in memory."""


def _fill(kb: KnowledgeBase, options: _Options) -> None:
    """Bring the bundled ontology and the inferred graph up to date."""
    if kb.plain:
        return
    if options.ontologies:
        from rtask.loader.bundled import refresh

        refresh(kb)
    if kb.reasons and kb.closure_behind():
        commit = kb.rebuild("inferred")
        _log.info("derived again: +%d", commit.derived)
