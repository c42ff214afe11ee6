"""Load documents, each as one commit.

A document that cannot be parsed, or that contradicts the stored data, changes nothing.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import IO, TYPE_CHECKING

from pyoxigraph import NamedNode, Quad, RdfFormat

from rtask.errors import DataError, UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import MAX_QUADS, Request
from rtask.kb.durability.blobs import digest_of
from rtask.kb.rules.rule import is_rule_file, read_rules
from rtask.kb.store.collector import collector_paused
from rtask.loader.bulk import load_bulk, load_text, readable_by_the_store
from rtask.loader.catalogue import OntologyCatalogue, loadable_files
from rtask.loader.headers import Header, Terms, header_of, peek, version_of
from rtask.loader.patches import mend
from rtask.loader.preparing import prepared
from rtask.loader.report import Counts, FileReport, LoadReport
from rtask.rdf.documents import Document
from rtask.rdf.formats import Format, detect, find_format, statements
from rtask.rdf.guards import undefined_json_terms
from rtask.rdf.terms import DEFAULT, DefaultGraph, GraphName, iri, stored_quad

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["FileReport", "LoadReport", "load"]

_log = logging.getLogger(__name__)
_MISSING = ("error", "warn", "ignore")
_MAX_SOURCE_BYTES = 64 << 20
_UNLIMITED = 1 << 62
_CAUSE_MS = 10_000.0


@dataclass(frozen=True)
class Options:
    """The options of loading documents; see :func:`load`."""

    format: Format | None
    graph: NamedNode | None
    base: str | None
    replace: bool
    dry_run: bool
    missing_imports: str
    access: Access
    on_read: Callable[[str, int, int], None] | None = None
    patches: bool = True


def load(
    kb: GraphCore,
    source: Path | str | bytes | IO[bytes],
    *,
    format: RdfFormat | str | None = None,
    graph: NamedNode | str | None = None,
    base: str | None = None,
    replace: bool = False,
    dry_run: bool = False,
    catalogs: Iterable[Path | str] = (),
    missing_imports: str = "error",
    agent: str | None = None,
    access: Access | None = None,
    on_read: Callable[[str, int, int], None] | None = None,
    patches: bool = True,
) -> LoadReport:
    """Load a file, a folder, ``-`` (standard input), bytes, or the IRI of a known ontology.

    Parameters
    ----------
    format
        Name, extension or media type; detected from the extension or the first bytes if not given.
    graph
        Target graph. By default an ontology goes to the graph with its own IRI, and data go to
        ``{base}graph/import/<file>``.
    base
        IRI against which relative IRIs are resolved; the file's own address if not given.
    replace
        Whether to withdraw the previous content of the graph.
    dry_run
        Whether to read, resolve and count everything but store nothing.
    catalogs
        Folders and catalogue files that are searched first for ``owl:imports``.
    missing_imports
        ``error``, ``warn`` or ``ignore``.
    on_read
        Called with the name of the document, the number of bytes read and its size; the number
        restarts from zero if a document is read again.
    patches
        Whether to leave out known faults of published ontologies.

    Raises
    ------
    ParseError
        ``FILE:LINE:COLUMN: reason``.
    DataError
        An import was not found; the error lists the places searched.
    """
    if missing_imports not in _MISSING:
        raise UsageError(f"missing_imports={missing_imports!r}; one of {', '.join(_MISSING)}")
    options = Options(
        find_format(format) if format else None,
        None if graph is None else iri(graph),
        base,
        replace,
        dry_run,
        missing_imports,
        kb.access(agent, access),
        on_read,
        patches,
    )
    loader = _Loader(kb, options, OntologyCatalogue(Path(place) for place in catalogs))
    for document in loader.documents(source):
        loader.load(document)
    if dry_run:
        loader.report.undeclared = loader.terms.undeclared(kb)
    return loader.report


@dataclass(frozen=True)
class Item:
    """A document with its header and target graph.

    Parameters
    ----------
    graph
        Graph of the statements that name none.
    loose
        Whether there are such statements.
    """

    document: Document
    header: Header
    graph: GraphName
    loose: bool


class _Loader:
    def __init__(self, kb: GraphCore, options: Options, catalogue: OntologyCatalogue) -> None:
        self.kb = kb
        self.options = options
        self.catalogue = catalogue
        self.report = LoadReport(dry_run=options.dry_run)
        self.terms = Terms()
        self._done: set[Path] = set()

    def documents(self, source: Path | str | bytes | IO[bytes]) -> list[Document]:
        """Return the documents of a source, ontologies before data."""
        if isinstance(source, str) and "\n" in source:
            raise UsageError(
                f"a source of {len(source)} characters in several lines is no path; pass "
                "statements as bytes, text.encode(), with their format"
            )
        if isinstance(source, str) and ":" in source and not Path(source).exists():
            paths = self.catalogue.find(source)
            if paths is None:
                raise DataError(
                    f"{source} is neither a file nor a known ontology; {self._searched(source)}"
                )
            return [Document.of(paths)]
        if isinstance(source, str | Path) and Path(source).is_dir():
            files = [Document.of(path) for path in loadable_files(Path(source))]
            if not files:
                raise DataError(f"{source} contains no file in a known format")
            return sorted(files, key=lambda document: peek(document).iri is None)
        return [Document.of(source)]

    def _searched(self, name: str, beside: Path | None = None) -> str:
        """Say where an ontology was looked for, and which file there may be meant."""
        text = "searched " + ", ".join(map(str, self.catalogue.searched(beside)))
        alike = self.catalogue.resembling(name, beside)
        return f"{text}, where {alike[0]} calls itself {alike[1]}" if alike else text

    def load_rules(self, document: Document) -> None:
        """Load a file of rules as one commit."""
        started = time.perf_counter()
        if self.options.graph is not None:
            raise UsageError(f"{document.name}: rules have a graph of their own; leave out --graph")
        assert document.path is not None
        rules = read_rules(document.path)
        commit = None
        if not self.options.dry_run:
            commit = self.kb.add_rules(
                rules,
                access=self.options.access,
                replace=self.options.replace,
                note=f"load {document.name}",
            )
        counts = (commit.added, commit.removed, commit.derived) if commit else (0, 0, 0)
        where = self.kb.graphs.rules.value
        elapsed = round(time.perf_counter() - started, 3)
        self.report.files.append(
            FileReport(document.name, "rules", where, len(rules), *counts, elapsed)
        )

    def load(self, document: Document) -> None:
        """Load one document after its imports."""
        if document.path is not None and is_rule_file(document.path):
            self.load_rules(document)
            return
        if document.path is not None:
            if document.path.resolve() in self._done:
                return
            self._done.add(document.path.resolve())
        with collector_paused():
            self._load(self._watched(document))

    def _load(self, document: Document) -> None:
        started = time.perf_counter()
        form = self.options.format or detect(document)
        base = self.options.base or (document.path.resolve().as_uri() if document.path else None)
        if self._is_text(document, form):
            item = Item(document, Header(), self._target(document, Header()), True)
            counts, remark = load_text(
                self.kb,
                document,
                form,
                item.graph,
                self._request(item),
                base=base,
                replace=self.options.replace,
            )
            self._tell(item, remark)
            self._report(item, form, counts, started)
            return
        quads = statements(document, form, base)
        first = list(islice(quads, MAX_QUADS))
        header = header_of(first)
        if self.options.dry_run:
            self.terms.read(first)
        for name in header.imports:
            self._import(name, document)
        loose = any(isinstance(quad.graph_name, DefaultGraph) for quad in first)
        rest = next(quads, None)
        if rest is not None and not self.options.dry_run and self.kb.needs_exact_changes:
            first, rest = [*first, rest, *quads], None
        if rest is None:
            first, header = self._mended(document, first, header)
        item = Item(document, header, self._target(document, header), loose)
        self._warn_of_merge(item, first)
        if self._is_unchanged(item):
            counts = Counts(len(first), 0, 0, 0)
        elif rest is None:
            counts = self._commit(item, first)
        else:
            counts = self._stream(item, chain(first, [rest], quads))
        self._report(item, form, counts, started)

    def _report(self, item: Item, form: Format, counts: Counts, started: float) -> None:
        if form.rdf == RdfFormat.JSON_LD:
            self._warn_of_undefined_terms(item.document)
        elapsed = round(time.perf_counter() - started, 3)
        where = item.graph.value if item.loose and isinstance(item.graph, NamedNode) else ""
        self.report.files.append(
            FileReport(item.document.name, form.name, where, *counts, elapsed, item.header.patches)
        )

    def _warn_of_undefined_terms(self, document: Document) -> None:
        with document.open() as stream:
            undefined = undefined_json_terms(stream.read())
        if undefined:
            names = ", ".join(undefined[:10]) + (", ..." if len(undefined) > 10 else "")
            self.report.warnings.append(
                f"{document.name}: no context defines {names}; the values of "
                f"{'this key' if len(undefined) == 1 else 'these keys'} were left out (JSON-LD 1.1)"
            )

    def _warn_of_merge(self, item: Item, quads: Iterable[Quad]) -> None:
        """Say which version of an ontology this one is merged with."""
        name = item.header.iri
        if name is None or item.graph != name or self.options.replace or self._is_unchanged(item):
            return
        count = self.kb.catalogue.triple_count(name)
        if count and self.kb.catalogue.is_ontology(name):
            stored = self.kb.store.quads_for_pattern(name, None, None, name)
            old, new = version_of(stored, name), version_of(quads, name)
            self.report.warnings.append(
                f"{item.document.name}: {new} of {name} is merged with {old}, which is loaded "
                f"({count} statements); `rtask ontology upgrade` replaces it"
            )

    def _mended(
        self, document: Document, quads: list[Quad], header: Header
    ) -> tuple[list[Quad], Header]:
        """Leave the known faults of an ontology out."""
        if not self.options.patches or self.kb.plain:
            return quads, header
        left, applied, stale = mend(quads, header.iri)
        for patch in stale:
            self.report.warnings.append(
                f"{document.name}: the patch {patch.name} is for {patch.edition}; this edition "
                "does not have its statements"
            )
        return left, replace(header, patches=tuple(patch.name for patch in applied))

    def _is_text(self, document: Document, form: Format) -> bool:
        if self.options.dry_run or self.kb.plain or self.kb.needs_exact_changes:
            return False
        return readable_by_the_store(document, form)

    def _watched(self, document: Document) -> Document:
        on_read = self.options.on_read
        if on_read is None:
            return document
        size = document.size
        return replace(document, on_read=lambda read: on_read(document.name, read, size))

    def _import(self, name: NamedNode, importer: Document) -> None:
        if self.kb.catalogue.is_ontology(name):
            return
        paths = self.catalogue.find(name.value, importer.path)
        if paths is not None:
            inside = name.value.removeprefix("package://")
            if inside != name.value and not paths.as_posix().endswith(f"/{inside}"):
                self.report.warnings.append(
                    f"{importer.name} imports {name.value}, a package that is not here; {paths} "
                    "was read, which has its name"
                )
            nested = _Loader(self.kb, _for_imports(self.options), self.catalogue)
            nested.report, nested._done = self.report, self._done
            nested.terms = self.terms
            nested.load(Document.of(paths))
            return
        self.report.missing_imports.append(name.value)
        message = (
            f"{importer.name} imports {name.value}; {self._searched(name.value, importer.path)}"
        )
        if self.options.missing_imports == "error":
            raise DataError(
                f"{message}; name the folder that has it (--catalog, catalogs=), or load without "
                "it (--missing-imports warn, missing_imports='warn')",
                missing=name.value,
            )
        if self.options.missing_imports == "warn":
            _log.warning("%s", message)

    def _target(self, document: Document, header: Header) -> GraphName:
        if self.options.graph is not None:
            return self.options.graph
        if self.kb.plain:
            return DEFAULT
        return header.iri or self.kb.graphs.imported(document.stem)

    def _is_unchanged(self, item: Item) -> bool:
        """Whether an ontology's graph was loaded from exactly these bytes.

        Loading it again would rename its blank nodes and so duplicate its class expressions.
        """
        if self.options.replace or item.header.iri is None or item.graph != item.header.iri:
            return False
        source = self.kb.catalogue.source(item.header.iri)
        return source is not None and digest_of(source) == item.document.sha256()

    def _tell(self, item: Item, remark: str | None) -> None:
        """Pass on what the commit says of identities: a load has no answer but its report."""
        if remark is not None:
            self.report.warnings.append(f"{item.document.name}: {remark}")

    def _commit(self, item: Item, quads: list[Quad]) -> Counts:
        transaction = self.kb.commit_block(self._request(item))
        named = list(map(stored_quad, self._prepared(quads, item)))  # before others wait for it
        try:
            with transaction as tx:
                if self.options.replace:
                    for name in _graphs(quads, item.graph):
                        tx.clear(name)
                tx.add_quads(named, as_read=True)
                added, removed = tx.counts()
                if self.options.dry_run:
                    raise _DryRun
        except _DryRun:
            return Counts(len(quads), added, removed, 0)
        self.report.warnings += map(str, transaction.commit.warnings)
        self._tell(item, transaction.commit.remark)
        return Counts(len(quads), added, removed, transaction.commit.derived)

    def _stream(self, item: Item, quads: Iterator[Quad]) -> Counts:
        """Store more statements than a commit may hold."""
        if self.options.dry_run:
            read = sum(1 for _ in quads)
            return Counts(read, read, 0, 0)
        request, replace = self._request(item), self.options.replace
        named = self._prepared(quads, item)
        counts, remark = load_bulk(self.kb, named, item.graph, request, replace=replace)
        self._tell(item, remark)
        return counts

    def _prepared(self, quads: Iterable[Quad], item: Item) -> Iterator[Quad]:
        keep_blank = self.kb.plain or item.header.iri is not None
        return prepared(quads, item.graph, self.kb.base, keep_blank)

    def _request(self, item: Item) -> Request:
        """Return the request of the commit that stores a document."""
        is_ontology = item.header.iri is not None
        kinds: dict[GraphName, str] = {item.graph: "OntologyGraph"} if is_ontology else {}
        sources = {}
        if self._keeps_source(item):
            document = item.document
            data = document.path if document.path else document.data
            sources[item.graph] = self.kb.blobs.put(data, "application/octet-stream")
        return Request(
            self.options.access,
            note=f"load {item.document.name}" + _mending(item.header),
            kinds=kinds,
            check_blobs=False,
            sources=sources,
            max_quads=_UNLIMITED,
            cause_ms=_CAUSE_MS,
        )

    def _keeps_source(self, item: Item) -> bool:
        if self.kb.plain or self.options.dry_run or not item.loose:
            return False
        return item.document.size <= _MAX_SOURCE_BYTES and isinstance(item.graph, NamedNode)


def _mending(header: Header) -> str:
    return f", mended by {', '.join(header.patches)}" if header.patches else ""


class _DryRun(Exception):
    """Raised to leave a transaction without a commit."""


def _for_imports(options: Options) -> Options:
    """Return the options for an imported ontology, with its own graph, format and address."""
    return replace(options, format=None, graph=None, base=None)


def _graphs(quads: Iterable[Quad], graph: GraphName) -> set[GraphName]:
    named = {q.graph_name for q in quads if not isinstance(q.graph_name, DefaultGraph)}
    return {graph, *named}
