"""Differences between two versions of an ontology, and whether they are breaking changes.

Versions are semantic: a patch changes wording; a minor version adds terms or weakens axioms; a
major version removes a term, or adds an axiom that may make valid data invalid.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ontology
from rtask.ontology_docs.axioms import ABOVE, Axiom
from rtask.ontology_docs.renames import renames
from rtask.ontology_docs.source import BUNDLED, Module, bundled, prefixed
from rtask.ontology_docs.terms import KINDS, Vocabulary

__all__ = ["Change", "Difference", "comparable", "compare"]

_OWL, _RDF, _RDFS = (ontology.PREFIXES[name] for name in ("owl", "rdf", "rdfs"))
_TYPE = _RDF + "type"
_WORDING = {
    *(_RDFS + name for name in ("label", "comment", "seeAlso", "isDefinedBy")),
    *(ontology.PREFIXES["skos"] + name for name in ("altLabel", "definition", "example", "note")),
    *(ontology.PREFIXES["dcterms"] + name for name in ("source", "created", "isReplacedBy")),
    _OWL + "deprecated",
    ontology.NS + "shortId",
}
_HEADER = {_OWL + name for name in ("versionIRI", "versionInfo", "imports", "priorVersion")}
_WEAK = {
    ABOVE,
    *(_OWL + name for name in ("inverseOf", "propertyChainAxiom", "NamedIndividual")),
    *(_OWL + name for name in ("Class", "ObjectProperty", "DatatypeProperty")),
    *(_OWL + name for name in ("TransitiveProperty", "SymmetricProperty")),
}
"""Axioms that allow more inferences and forbid nothing by themselves."""

LEVELS = ("none", "patch", "minor", "major")


@dataclass(frozen=True, order=True)
class Change:
    """One axiom that was added or removed.

    Attributes
    ----------
    sign
        ``"+"`` or ``"-"``.
    level
        One of ``patch``, ``minor``, ``major``.
    """

    axiom: Axiom
    sign: str
    level: str


@dataclass
class Difference:
    """Terms and axioms that only the newer or only the older version has.

    Attributes
    ----------
    added, removed, deprecated
        IRIs of terms.
    changes
        Axioms that were added or removed, about terms that both versions have.
    versions
        Module IRI to the old and new version, where they differ or one is missing.
    renamed
        Terms of the older version with the terms by which the newer one replaces them.
    """

    added: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    deprecated: list[str] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    versions: dict[str, tuple[str, str]] = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)

    @property
    def level(self) -> str:
        """The part of the version number to increase: none, patch, minor or major."""
        levels = [change.level for change in self.changes]
        levels += ["major"] * bool(self.removed) + ["minor"] * bool(self.added or self.deprecated)
        return max(levels, key=LEVELS.index, default="none")

    @property
    def is_breaking(self) -> bool:
        """Whether a term was removed, or valid data may now be invalid."""
        return self.level == "major"

    def lines(self) -> list[str]:
        """Return the difference for people to read."""
        lines = [
            f"  module {iri}: {a or '-'} -> {b or '-'}" for iri, (a, b) in self.versions.items()
        ]
        lines += [f"- term {prefixed(iri)}  (breaking)" for iri in self.removed]
        lines += [f"~ term {prefixed(iri)} is deprecated" for iri in self.deprecated]
        lines += [
            f"~ term {prefixed(old)} is replaced by {prefixed(new)}"
            for old, new in self.renamed.items()
        ]
        lines += [f"+ term {prefixed(iri)}" for iri in self.added]
        for change in self.changes:
            mark = "  (breaking)" if change.level == "major" else ""
            lines.append(f"{change.sign} {change.axiom}{mark}")
        return [*lines, f"level: {self.level}"]

    def to_dict(self) -> dict[str, Any]:
        """Return the difference as JSON-able values."""
        return {
            "level": self.level,
            "breaking": self.is_breaking,
            "versions": {iri: list(pair) for iri, pair in self.versions.items()},
            "added": self.added,
            "removed": self.removed,
            "deprecated": self.deprecated,
            "renamed": self.renamed,
            "axioms": [
                {"sign": c.sign, "level": c.level, "term": c.axiom.subject, "axiom": str(c.axiom)}
                for c in self.changes
            ],
        }


def compare(old: Iterable[Module], new: Iterable[Module]) -> Difference:
    """Compare two versions of some ontologies.

    Examples
    --------
    >>> from rtask.ontology_docs import bundled
    >>> modules = bundled()
    >>> compare(modules, modules).level
    'none'
    """
    old, new = list(old), list(new)
    before, after = Vocabulary(old), Vocabulary(new)
    gone = before.terms.keys() - after.terms.keys()
    shared = before.terms.keys() & after.terms.keys()
    fallen = [iri for iri in shared if after.terms[iri].deprecated > before.terms[iri].deprecated]
    return Difference(
        added=sorted(after.terms.keys() - before.terms.keys()),
        removed=sorted(gone),
        deprecated=sorted(fallen),
        changes=_changes(before, after, shared),
        versions=_versions(before.modules, after.modules),
        renamed=_renamed(old, new, before),
    )


def _renamed(old: list[Module], new: list[Module], before: Vocabulary) -> dict[str, str]:
    """Return the terms whose replacement only the newer version states."""
    renames_before = renames(old)
    renames_after = renames(new)
    return {
        a: b
        for a, b in sorted(renames_after.items())
        if a in before.terms and renames_before.get(a) != b
    }


def comparable(
    old: list[Module], new: list[Module], names: tuple[str, str]
) -> tuple[list[Module], list[Module]]:
    """Return both sides without modules that one of them never contains.

    A knowledge base loads neither shapes nor modules that are read on request, so these are left
    out of the bundled ones when they are compared with it.

    Parameters
    ----------
    names
        The sources of the two sides.
    """
    if BUNDLED not in names or not any((Path(name) / "kb.json").is_file() for name in names):
        return old, new
    ours = {module.iri for module in bundled()}

    def selected(name: str, modules: list[Module]) -> list[Module]:
        if name == BUNDLED:
            return modules[: len(ontology.modules())]
        return [m for m in modules if m.iri in ours or m.iri.startswith(ontology.ONTOLOGY)]

    return selected(names[0], old), selected(names[1], new)


def _versions(old: list[Module], new: list[Module]) -> dict[str, tuple[str, str]]:
    before = {module.iri: module.version for module in old if module.iri}
    after = {module.iri: module.version for module in new if module.iri}
    return {
        iri: (before.get(iri, ""), after.get(iri, ""))
        for iri in sorted(before.keys() | after.keys())
        if before.get(iri) != after.get(iri)
    }


def _changes(before: Vocabulary, after: Vocabulary, shared: set[str]) -> list[Change]:
    old = {axiom for axioms in before.axioms.values() for axiom in axioms}
    new = {axiom for axioms in after.axioms.values() for axiom in axioms}
    headers = {module.iri for module in (*before.modules, *after.modules)}
    changes = [Change(axiom, "-", _lost(axiom)) for axiom in old - new if _concerns(axiom, shared)]
    changes += [
        Change(axiom, "+", _gained(axiom, before))
        for axiom in new - old
        if _concerns(axiom, shared)
    ]
    return sorted(c for c in changes if c.axiom.subject not in headers)


def _concerns(axiom: Axiom, shared: set[str]) -> bool:
    """Whether an axiom is about terms that both versions have."""
    return axiom.subject in shared if axiom.subject else bool(shared & {*axiom.mentions})


def _lost(axiom: Axiom) -> str:
    """Return the level of a removed axiom: less follows, and nothing more is forbidden."""
    is_kind = axiom.predicate == _TYPE and any(kind in KINDS for kind in axiom.mentions)
    if is_kind:
        return "major"  # a class that became a property
    return "patch" if axiom.predicate in _WORDING else "minor"


def _gained(axiom: Axiom, before: Vocabulary) -> str:
    """Return the level of a new axiom; one about a new term cannot invalidate existing data."""
    if axiom.predicate in _WORDING or (axiom.literal and axiom.predicate in _HEADER):
        return "patch"
    traits = set(axiom.mentions) if axiom.predicate == _TYPE else {axiom.predicate}
    if traits <= _WEAK:
        return "minor"
    if axiom.subject == "":
        seen = [iri for iri in axiom.mentions if iri in before.terms]
        return "major" if len(seen) > 1 else "minor"
    return "major"
