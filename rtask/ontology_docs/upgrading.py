"""Upgrade of an ontology to another version, together with the data that use its terms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyoxigraph import NamedNode, Quad

from rtask.errors import DataError, UnknownTermError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.core import GraphCore
from rtask.loader.headers import header_of
from rtask.loader.patches import mend
from rtask.ontology_docs.difference import Difference, compare
from rtask.ontology_docs.renames import renames
from rtask.ontology_docs.source import module_of, prefixed
from rtask.ontology_docs.usage import (
    data_graphs,
    mentions,
    refuse_bundled,
    require_loaded,
    stored_module,
    uses,
)
from rtask.rdf.documents import Document
from rtask.rdf.formats import read_document
from rtask.rdf.terms import Term, iri

__all__ = ["Upgrade", "undo_upgrade", "upgrade"]

_UNLIMITED = 1 << 62
_CAUSE_MS = 10_000.0
_NOTE = "upgrade <{iri}> from {old} to {new}"
_UNDONE = "undo the upgrade of <{iri}> in commit {seq}"


@dataclass(frozen=True)
class Upgrade:
    """Result of an upgrade.

    Parameters
    ----------
    ontology
        Its IRI.
    difference
        Between the version that was loaded and the new one.
    renamed
        Replaced terms with their replacements.
    rewritten
        Numbers of statements of data rewritten, by replaced term.
    left
        Numbers of statements that use terms which the new version has no longer, by term.
    rules
        Labels of the users' rules that mention replaced or removed terms; these are not rewritten.
    patches
        Names of the patches applied to faults of the new version.
    commit
        ``None`` for a dry run.
    """

    ontology: str
    difference: Difference
    renamed: dict[str, str]
    rewritten: dict[str, int]
    left: dict[str, int]
    rules: tuple[str, ...] = ()
    patches: tuple[str, ...] = ()
    commit: Commit | None = field(default=None, compare=False)

    def lines(self) -> list[str]:
        """Return the result for people to read."""
        lines = self.difference.lines()
        for old, new in sorted(self.renamed.items()):
            count = self.rewritten.get(old, 0)
            lines.append(f"renamed {prefixed(old)} -> {prefixed(new)}: {count} statements")
        for term, count in sorted(self.left.items()):
            lines.append(f"left: {count} statements use {prefixed(term)}, which has no replacement")
        lines += [f"mended by the patch {name}" for name in self.patches]
        lines += [
            f"rule {label!r} mentions a term that changed; look at it" for label in self.rules
        ]
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-able values."""
        return {
            "ontology": self.ontology,
            "difference": self.difference.to_dict(),
            "renamed": self.renamed,
            "rewritten": self.rewritten,
            "left": self.left,
            "rules": list(self.rules),
            "patches": list(self.patches),
            "commit": self.commit.seq if self.commit else None,
        }


def upgrade(
    kb: GraphCore,
    source: Path | str,
    *,
    migrate: bool = True,
    dry_run: bool = False,
    patches: bool = True,
    access: Access | None = None,
) -> Upgrade:
    """Replace a loaded ontology by another version, and rewrite the data to its terms.

    All is one commit, so that no reader sees the new ontology with old data, and
    :func:`undo_upgrade` can take it back.

    Parameters
    ----------
    source
        File with the new version.
    migrate
        Whether to rewrite replaced terms in data.
    dry_run
        Whether to tell what would be done, and do nothing.
    patches
        Whether to leave out known faults of published ontologies.

    Raises
    ------
    UnknownTermError
        The ontology is not loaded.
    UsageError
        It comes with RTASK, which upgrades it itself.
    InconsistentError
        The new version contradicts the data; nothing changes.
    """
    document = Document.of(source)
    quads: list[Quad] = read_document(Path(source))
    name = header_of(quads).iri
    if name is None:
        raise DataError(f"{document.name} declares no ontology; load data with `rtask load`")
    require_loaded(kb, name)
    refuse_bundled(name)
    applied: list[Any] = []
    if patches:
        quads, applied, stale = mend(quads, name)
        del stale
    new = module_of(document.stem, [(q.subject, q.predicate, q.object) for q in quads])
    old = stored_module(kb, name)
    difference = compare([old], [new])
    renamed = {
        before: after
        for before, after in renames([new]).items()
        if migrate and before not in (name.value, after)
    }
    moved = list(_rewritten(kb, renamed, name))
    left = uses(kb, set(difference.removed) - set(renamed), name)
    changed = {*renamed, *difference.removed}
    upgraded = Upgrade(
        name.value,
        difference,
        renamed,
        dict(Counter(term for terms, _, _ in moved for term in terms)),
        left,
        tuple(rule.label for rule in kb.rules() if any(term in rule.text for term in changed)),
        tuple(patch.name for patch in applied),
    )
    if dry_run:
        return upgraded
    note = _NOTE.format(iri=name.value, old=old.version or "-", new=new.version or "-")
    request = Request(
        kb.access(access=access),
        note=note,
        kinds={name: "OntologyGraph"},
        sources={name: kb.blobs.put(Path(source), "application/octet-stream")},
        max_quads=_UNLIMITED,
        cause_ms=_CAUSE_MS,
        check_blobs=False,
    )
    with kb.commit_block(request) as tx:
        tx.clear(name)
        tx.add_quads(quads, name)
        for _, before, after in moved:
            tx.remove_quads([before])
            tx.add_quads([after])
    return Upgrade(**{**vars(upgraded), "commit": tx.commit})


def undo_upgrade(kb: GraphCore, name: str, *, access: Access | None = None) -> Commit:
    """Take the last upgrade of an ontology back: its statements, and the data that it rewrote.

    Raises
    ------
    UnknownTermError
        There is no upgrade of this ontology that is not taken back already.
    ConflictError
        What it wrote was changed since.
    """
    seq = _last_upgrade(kb, name)
    return kb.revert(seq, access=access, note=_UNDONE.format(iri=name, seq=seq))


def _last_upgrade(kb: GraphCore, name: str) -> int:
    """Return the number of the last upgrade of an ontology that stands."""
    stands: list[int] = []
    for entry in kb.history(graph=name):
        note = entry.note or ""
        if note.startswith(f"upgrade <{name}> from "):
            stands.append(entry.seq)
        for seq in list(stands):
            if note == _UNDONE.format(iri=name, seq=seq):
                stands.remove(seq)
    if not stands:
        raise UnknownTermError(f"there is no upgrade of <{name}> to undo")
    return stands[-1]


def _rewritten(
    kb: GraphCore, renamed: dict[str, str], but: NamedNode
) -> Iterator[tuple[tuple[str, ...], Quad, Quad]]:
    """Yield each statement of data that uses replaced terms: the terms, as it is, as it will be."""

    def now(term: Term) -> Any:
        if isinstance(term, NamedNode) and term.value in renamed:
            return iri(renamed[term.value])
        return term

    for graph in data_graphs(kb):
        if graph == but:
            continue
        seen: dict[Quad, None] = dict.fromkeys(q for _, q in mentions(kb, renamed, graph))
        for quad in seen:
            parts: tuple[Term, ...] = (quad.subject, quad.predicate, quad.object)
            terms = tuple(p.value for p in parts if isinstance(p, NamedNode) and p.value in renamed)
            subject, predicate, value = map(now, parts)
            yield terms, quad, Quad(subject, predicate, value, graph)
