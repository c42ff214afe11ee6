"""Sources of ontologies: the bundled files, files and folders, a knowledge base."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import ontology
from rtask.errors import UsageError
from rtask.rdf.terms import Literal, NamedNode, Subject, Term, TripleKey, stored

__all__ = ["Module", "bundled", "loaded", "module_of", "prefixed", "read_source"]

_OWL, _RDF, _RDFS = (ontology.PREFIXES[name] for name in ("owl", "rdf", "rdfs"))
_TYPE = NamedNode(_RDF + "type")
_HEADER = NamedNode(_OWL + "Ontology")
_MORE_PREFIXES = {"shapes": ontology.ONTOLOGY.removesuffix("onto") + "shapes#"}

BUNDLED = "bundled"
"""Stands for the ontology that comes with RTASK where a file name is accepted."""


def prefixed(iri: str) -> str:
    """Return an IRI abbreviated with a prefix of the ontology, if one applies.

    >>> prefixed(ontology.NS + "Mug"), prefixed("urn:mug")
    ('rt:Mug', '<urn:mug>')
    """
    for name, namespace in (*ontology.PREFIXES.items(), *_MORE_PREFIXES.items()):
        if iri.startswith(namespace) and iri != namespace:
            return f"{name}:{iri[len(namespace) :]}"
    return f"<{iri}>"


@dataclass(frozen=True)
class Module:
    """One ontology: a file in ``ontology/``, any other file, or a graph.

    Attributes
    ----------
    name
        The file's path without its extension, or the last part of the IRI.
    iri
        Of the ontology; empty if the file declares none.
    triples
        Its statements, with literals in the store's canonical form.
    """

    name: str
    iri: str
    triples: tuple[TripleKey, ...]

    def header(self, predicate: str) -> str:
        """Return a text of the ontology's header, empty if there is none."""
        labels = (
            o.value
            for s, p, o in self.triples
            if s == NamedNode(self.iri or "urn:none") and p.value == predicate
            if isinstance(o, Literal | NamedNode)
        )
        return min(labels, default="")

    @property
    def title(self) -> str:
        """The title, or the name if there is none."""
        return self.header(ontology.PREFIXES["dcterms"] + "title") or self.name

    @property
    def comment(self) -> str:
        """The description."""
        return self.header(_RDFS + "comment")

    @property
    def version(self) -> str:
        """The version, empty if it states none."""
        return self.header(_OWL + "versionInfo")


def module_of(name: str, triples: Iterable[tuple[Subject, NamedNode, Term]]) -> Module:
    """Return the ontology that statements make up, under a name of the caller's choice."""
    stored_triples = tuple((s, p, stored(o)) for s, p, o in triples)
    headers = [s for s, p, o in stored_triples if p == _TYPE and o == _HEADER]
    iris = [s.value for s in headers if isinstance(s, NamedNode)]
    return Module(name, min(iris, default=""), stored_triples)


def _read(path: Path, name: str) -> Module:
    from rtask.rdf.formats import read_document

    return module_of(name, [(q.subject, q.predicate, q.object) for q in read_document(path)])


def bundled(shapes: bool = False) -> list[Module]:
    """Return the modules that come with RTASK, those that a knowledge base loads first."""
    first = ontology.modules()
    room = ontology.path("catalog.toml").parent
    others = [path for path in sorted(room.rglob("*.ttl")) if path not in first]
    if not shapes:
        others = [path for path in others if "shapes" not in path.parts]
    names = [path.relative_to(room).with_suffix("").as_posix() for path in (*first, *others)]
    return [_read(path, name) for path, name in zip((*first, *others), names, strict=True)]


def loaded(folder: Path) -> list[Module]:
    """Return the ontologies of a knowledge base, one for each graph that holds one."""
    from rtask.opening import open_knowledge_base

    kind = ontology.NS + "OntologyGraph"
    with open_knowledge_base(folder, mode="r") as kb:
        graphs = [q.subject for q in kb.match(predicate=_TYPE, value=NamedNode(kind))]
        named = sorted({g.value for g in graphs if isinstance(g, NamedNode)})
        return [
            module_of(
                re.split(r"[/#:]", iri.rstrip("/#"))[-1],
                [(q.subject, q.predicate, q.object) for q in kb.match(graph=iri)],
            )
            for iri in named
        ]


def read_source(name: str) -> list[Module]:
    """Return the ontologies of ``"bundled"``, a file, a folder, or a knowledge base's folder.

    Files in a folder that declare no ontology are data, and are left out if others declare one.

    Raises
    ------
    UsageError
        If there is no such file or folder, or it holds no ontology.
    """
    if name == BUNDLED:
        return bundled(shapes=True)
    path = Path(name)
    if path.is_file():
        return [_read(path, path.stem)]
    if not path.is_dir():
        raise UsageError(
            f"{name}: no such file or folder; {BUNDLED!r} stands for RTASK's own ontology"
        )
    if (path / "kb.json").is_file():
        return loaded(path)
    from rtask.loader.catalogue import loadable_files

    files = loadable_files(path)
    if not files:
        raise UsageError(f"{name}: no file of a known format in this folder")
    modules = [_read(f, f.relative_to(path).with_suffix("").as_posix()) for f in files]
    return [module for module in modules if module.iri] or modules
