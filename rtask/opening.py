"""Open a knowledge base: a folder, memory or a server."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rtask.errors import UsageError
from rtask.graph import Graph
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.committer import Committer
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.validation import Validator, policy, shape_files
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import (
    Files,
    find,
    make,
    open_for_reading,
    open_for_writing,
    open_in_memory,
)
from rtask.kb.durability.recovery import fill_gap
from rtask.kb.durability.settings import Settings
from rtask.kb.maintenance.statistics import closure_state
from rtask.kb.rules.rule import Rule, Source, read_rules
from rtask.kb.shapes.reading import read_shapes
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.late_notes import LateNotes
from rtask.kb.store.overlay import Overlay
from rtask.knowledge_base import KnowledgeBase
from rtask.loader.bundled import refresh
from rtask.rdf.terms import LONG_AGO
from rtask.remote.discovery import connect
from rtask.remote.journal import RemoteJournal
from rtask.remote.knowledge_base import open_remote
from rtask.remote.opening import Place, open_on_server
from rtask.remote.pending import PendingChange
from rtask.remote.served import open_served
from rtask.remote.store import RemoteStore
from rtask.remote.sync import Sync

__all__ = ["open_knowledge_base"]

_log = logging.getLogger(__name__)
_MODES = ("rw", "r", "new")
_HOST_AND_PORT = re.compile(r"[\w.-]+:\d{2,5}(?:/.*)?")


@dataclass(frozen=True)
class _Options:
    mode: str
    durable: bool
    reason: bool
    ontologies: bool
    quarantines: bool
    validate: str
    shapes: tuple[Path, ...]
    rules: Sequence[Rule]


def open_knowledge_base(
    target: str | Path,
    *,
    mode: str = "rw",
    base: str | None = None,
    flush: str = "commit",
    plain: bool = False,
    union: str | None = None,
    reason: bool = True,
    validate: bool | str = False,
    shapes: Path | str | Iterable[Path | str] = (),
    on_inconsistency: str = "error",
    ontologies: bool = True,
    rules: Source | Iterable[Source] = (),
    token: str | None = None,
    timeout_s: float = 30.0,
    folder: str | Path | None = None,
) -> Graph:
    """Open a knowledge base.

    Parameters
    ----------
    target
        A folder, ``":memory:"`` or the address of a SPARQL 1.1 server. The usual places at and
        below an address are tried for queries and updates; ``sparql+https://host/?query=/q&update=/u``
        names them. The statements are then on that server, and everything else works as for a
        folder; what the server cannot do is logged once. A server of RTASK itself keeps rights and
        records, and gives a client.
    mode
        ``"rw"`` makes the folder if it does not exist, ``"new"`` refuses one that does, ``"r"``
        reads beside other readers, and follows a writer in another process.
    base
        IRI that starts every instance; random where it is not given. Fixed when the folder is
        made.
    flush
        When a commit is acknowledged: ``"commit"`` after it survives a power cut, ``"os"`` after
        it survives the end of the process.
    plain
        A bare SPARQL 1.1 dataset: no union default graph, inference or provenance.
    union
        What triple patterns outside ``GRAPH`` see: ``"merged"`` (default) keeps one copy of each
        distinct triple; ``"view"`` loads faster and takes less room, but a triple that two graphs
        hold comes twice. Fixed when the folder is made.
    reason
        Derive what follows within each commit.
    validate
        Hold what a commit touches against the SHACL shapes: ``True`` or ``"refuse"`` refuses
        violations, ``"warn"`` reports them in the commit. A millisecond for each shape concerned.
        The shapes are those of the ontology that comes with RTASK and those of loaded graphs.
    shapes
        Files of further shapes for ``validate``.
    on_inconsistency
        What becomes of a commit that contradicts the ontology or what is known: ``"error"``
        refuses it, ``"quarantine"`` keeps the statements to blame aside and stores the rest.
    ontologies
        Load the ontology that comes with RTASK into a new knowledge base, and its newer version
        into an old one.
    rules
        Rules of the user to add: :class:`rtask.Rule` objects, files or folders of rules, or text.
        They are stored and stay in force when the folder is opened without them; one of the same
        label and another text is replaced.
    token, timeout_s
        Of a remote server: who asks (a bearer token, or ``name:password``), and how long to wait
        for an answer.
    folder
        Of a remote server: where this machine keeps byte strings, tokens and the audit trail; one
        for each address and user by default. The folder can be opened in the place of the address.

    Returns
    -------
    A :class:`~rtask.knowledge_base.KnowledgeBase`. A server of RTASK gives a
    :class:`~rtask.remote.served.ServedKnowledgeBase`, which has sessions as well, and any server
    with ``plain=True`` a :class:`~rtask.remote.knowledge_base.RemoteKnowledgeBase`. All are a
    :class:`~rtask.graph.Graph`.

    Raises
    ------
    StoreLockedError
        Another process has the folder open; says which.
    StoreFormatError
        The folder is not a knowledge base, or has another format.
    """
    if mode not in _MODES:
        raise UsageError(f"unknown mode {mode!r}; one of {', '.join(_MODES)}")
    if flush not in ("commit", "os"):
        raise UsageError(f"unknown flush policy {flush!r}; one of commit, os")
    if on_inconsistency not in ("error", "quarantine"):
        raise UsageError(
            f"unknown policy on_inconsistency={on_inconsistency!r}; one of error, quarantine"
        )
    if shapes and policy(validate) == "off":
        raise UsageError(
            "shapes= takes effect with validate=True or 'warn'; kb.validate(shapes) checks once"
        )
    text = str(target)
    quarantines = on_inconsistency == "quarantine"
    parsed = read_rules(rules)
    if parsed and (plain or mode == "r"):
        raise UsageError(
            f"rules cannot be added to {'a plain dataset' if plain else 'what is open for reading'}"
        )
    options = _Options(
        mode,
        flush == "commit",
        reason,
        ontologies,
        quarantines,
        policy(validate),
        shape_files(shapes),
        parsed,
    )
    if text.startswith(("http://", "https://", "sparql+http")):
        place = Place(text, None if folder is None else Path(folder))
        return _open_address(place, token, timeout_s, base, union, plain, options)
    if "://" in text:
        raise UsageError(
            f"{text!r} is no address of a SPARQL server; one begins with http://, https://, "
            "sparql+http:// or sparql+https://"
        )
    if text == ":memory:":
        return _assemble(open_in_memory(Settings.new(base, plain, union)), options)
    path = Path(text)
    if _HOST_AND_PORT.fullmatch(text) and not path.exists():
        raise UsageError(
            f"{text!r} looks like an address; open http://{text}, or for a new folder of that name "
            f"./{text}"
        )
    settings = find(path, mode)
    if settings is None:
        settings = Settings.new(base, plain, union)
        make(path, settings)
    settings.require(path, base, plain, union)
    if settings.store is not None:
        token = token or os.environ.get("RTASK_STORE_TOKEN")
        place = Place(settings.store, path)
        return _open_address(place, token, timeout_s, settings.base, union, plain, options)
    if mode == "r":
        return _assemble(open_for_reading(path, settings), options)
    return _assemble(open_for_writing(path, settings, options.durable), options)


def _open_address(
    place: Place,
    token: str | None,
    timeout_s: float,
    base: str | None,
    union: str | None,
    plain: bool,
    options: _Options,
) -> Graph:
    """Open what is at an address: a knowledge base on any server, or a server of RTASK."""
    if plain:
        return open_remote(place.address, token, timeout_s)
    endpoints = connect(place.address, token, timeout_s)
    try:
        is_rtask = endpoints.is_rtask()
    except BaseException:
        endpoints.connection.close()
        raise
    if not is_rtask:
        files = open_on_server(endpoints, place, options.mode, base, union)
        return _assemble(files, options)
    endpoints.connection.close()
    if options.rules:
        raise UsageError("rules belong to the server; add them there: POST /reasoner/rules")
    return open_served(endpoints, token, timeout_s)


def _assemble(files: Files, options: _Options) -> KnowledgeBase:
    try:
        kb = _connect(files, options)
        if options.mode == "r":
            if kb.is_outdated:
                _log.warning(
                    "what is derived here was derived by other rules or another version of the "
                    "reasoner; open it once for writing to derive it again"
                )
        else:
            _bring_up_to_date(kb, files, options)
            kb.expiry.start()
    except BaseException:
        files.abandon()
        raise
    return kb


def _connect(files: Files, options: _Options) -> KnowledgeBase:
    files.store.is_view = files.settings.is_view
    graphs = Graphs(files.settings.base)
    catalogue = Catalogue(files.store, graphs)
    inference = None
    if options.reason and not files.settings.plain:
        inference = Inference(files.store, graphs, catalogue, files.saved_closures())
    committer = Committer(
        files.store,
        graphs,
        files.settings.plain,
        files.blobs,
        catalogue,
        inference,
        files.journal,
        _validator(files, graphs, options),
        last_seq=max(catalogue.seq, files.last_seq),
        last_time=catalogue.last_time() or LONG_AGO,
        quarantines=options.quarantines,
        late=_late_notes(files, graphs, options),
    )
    if inference is not None:
        inference.follow(lambda: committer.last_seq)
    changes = PendingChange if isinstance(files.store, RemoteStore) else Overlay
    writer = Writer(committer, files.checkpoints, changes)
    if options.mode == "r":
        writer.close()
    kb = KnowledgeBase(files, catalogue, inference, writer)
    if isinstance(files.store, RemoteStore) and isinstance(files.journal, RemoteJournal):
        Sync(files.store, files.journal, writer, kb.feed).start()
    return kb


def _late_notes(files: Files, graphs: Graphs, options: _Options) -> LateNotes | None:
    if files.settings.plain or options.mode == "r" or isinstance(files.store, RemoteStore):
        return None
    return LateNotes(files.store, graphs.meta, graphs.provenance)


def _validator(files: Files, graphs: Graphs, options: _Options) -> Validator | None:
    if options.validate == "off" or files.settings.plain:
        return None
    given = read_shapes(options.shapes, bundled=False) if options.shapes else None
    if given is not None and (whole := [s.name for s in given.shapes if not s.is_local]):
        _log.warning(
            "commits are not checked against %s: shapes with SPARQL may look at any statement; "
            "kb.validate() applies them",
            ", ".join(whole),
        )
    return Validator(files.store, graphs, options.validate == "refuse", options.shapes)


def _bring_up_to_date(kb: KnowledgeBase, files: Files, options: _Options) -> None:
    """Number what a power cut left, mark the folder as open, renew what is derived."""
    if files.checkpoints is not None:
        fill_gap(files.checkpoints.journal, files.last_seq, kb.seq)
        files.checkpoints.make(kb.seq)
    if kb.complete_interrupted():
        _log.warning("completed a load that was interrupted")
    if kb.take_in_lost():
        _log.warning("the store held statements of commits that the journal lost; they are kept")
    if kb.plain:
        return
    # Asked before anything is written, which would state that what is derived is up to date.
    is_outdated = kb.is_outdated
    if is_outdated:
        _log.warning(
            "the closure is rebuilt: it was made by other rules or another version of the reasoner"
        )
    if options.ontologies:
        refresh(kb)
    if is_outdated or closure_state(kb) == "behind":
        commit = kb.rebuild("inferred")
        _log.info("derived again: +%d -%d", commit.added, commit.removed)
    if options.rules:
        kb.add_rules(options.rules, replace=True)
