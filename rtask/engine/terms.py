"""Terms of the graph for words: classes, functions, tasks, reasons."""

from __future__ import annotations

import re
import threading
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import ontology
from rtask.errors import UnknownTermError, nearest
from rtask.rdf.namespaces import PREFIXES, RDFS, RT, local_name
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Change
    from rtask.kb.core import GraphCore

__all__ = [
    "ClassCatalogue",
    "ObjectClass",
    "TermCatalogue",
    "failure_reasons",
    "find_function",
    "find_task",
    "folded",
]

_TASKS = {
    "pick": RT.Grasp,
    "grasp": RT.Grasp,
    "place": RT.Place,
    "push": RT.Push,
    "pick_and_place": RT.PickAndPlace,
}


def folded(text: str) -> str:
    """Return words normalised for comparison: NFKC, case-folded, white space collapsed.

    >>> folded("  Coke   CAN ")
    'coke can'
    """
    return " ".join(unicodedata.normalize("NFKC", text).casefold().split())


def find_task(name: str) -> tuple[NamedNode, str]:
    """Return class and name of a manipulation task, given by name or IRI.

    Raises
    ------
    UnknownTermError
        The message lists the known ones.
    """
    plain = re.sub(r"[\s-]+", "_", folded(name))
    if plain in _TASKS:
        return _TASKS[plain], plain
    for task_name, kind in _TASKS.items():
        if name == kind.value:
            return kind, task_name
    hint = nearest(plain, list(_TASKS))
    raise UnknownTermError(
        f"unknown task {name!r}{hint}; known: {', '.join(_TASKS)}", did_you_mean=list(_TASKS)
    )


def find_function(kb: GraphCore, text: str) -> NamedNode:
    """Return the function with a name, label or IRI: ``write``, ``contain liquid``."""
    rows = kb.select(
        f"{PREFIXES} SELECT DISTINCT ?f ?label "
        "{ ?f a rt:ObjectFunction OPTIONAL { ?f rdfs:label ?label } } ORDER BY ?f ?label"
    )
    names: dict[str, NamedNode] = {}
    for row in rows:
        term = row["f"]
        if isinstance(term, NamedNode):
            for name in (term.value, local_name(term), str(row.value("label") or "")):
                names.setdefault(folded(name), term)
    functions = names.get(folded(text))
    if functions is None:
        labels = sorted(n for n in names if n and "/" not in n)
        raise UnknownTermError(f"unknown function {text!r}{nearest(folded(text), labels)}")
    return functions


def failure_reasons(kb: GraphCore) -> frozenset[str]:
    """Return the codes of all outcome reasons of the ontology."""
    rows = kb.select(f"{PREFIXES} SELECT ?code {{ ?r a rt:OutcomeReason ; rt:code ?code }}")
    return frozenset(str(row.value("code")) for row in rows)


@dataclass(frozen=True)
class ObjectClass:
    """A class of objects."""

    iri: NamedNode
    names: tuple[str, ...]
    short_id: str = ""

    @property
    def label(self) -> str:
        """Preferred name."""
        return self.names[0] if self.names else local_name(self.iri)


class ClassCatalogue:
    """Cache of the classes of objects, refreshed when one is added."""

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._lock = threading.Lock()
        self._cached: Mapping[str, ObjectClass] | None = None

    def forget_if_changed(self, change: Change) -> None:
        """Drop the cache after a commit about classes or their names."""
        telling = {RDFS.subClassOf, RDFS.label, RT.shortId}
        if any(quad.predicate in telling for quad in (*change.added, *change.removed)):
            with self._lock:
                self._cached = None

    def all(self) -> Mapping[str, ObjectClass]:
        """Return every class of objects by IRI."""
        with self._lock:
            if self._cached is None:
                self._cached = _read_classes(self._kb)
            return self._cached

    def get(self, iri: str) -> ObjectClass:
        """Return a class of objects, without names if the IRI is unknown."""
        return self.all().get(iri) or ObjectClass(NamedNode(iri), ())

    def find(self, description: str) -> list[ObjectClass]:
        """Return the classes that words mean: by exact name, else by prefix, else by all words."""
        phrase = folded(description)
        classes = [self.all()[iri] for iri in sorted(self.all())]
        words = phrase.split()
        for fits in (
            lambda name: name == phrase,
            lambda name: name.startswith(phrase),
            lambda name: all(word in name.split() for word in words),
        ):
            matches = [c for c in classes if any(fits(folded(name)) for name in c.names)]
            if matches and phrase:
                return matches
        return []

    def suggestions(self, description: str) -> list[str]:
        """Return names similar to unknown words."""
        import difflib

        labels = sorted({folded(name) for c in self.all().values() for name in c.names})
        return difflib.get_close_matches(folded(description), labels, n=5, cutoff=0.5)

    def next_short_id(self) -> str:
        """Return the next short id of a class in messages."""
        used = [int(c.short_id) for c in self.all().values() if c.short_id.isdecimal()]
        return str(max(used, default=0) + 1)


def _read_classes(kb: GraphCore) -> dict[str, ObjectClass]:
    """Read the kinds of products; that something is a single exemplar says nothing of its kind."""
    rows = kb.select(f"""{PREFIXES}
SELECT DISTINCT ?class ?name ?short {{
  ?class rdfs:subClassOf* rt:ManipulableObject FILTER(isIRI(?class) && ?class != rt:Exemplar)
  OPTIONAL {{ ?class rdfs:label|skos:altLabel ?name }} OPTIONAL {{ ?class rt:shortId ?short }}
}} ORDER BY ?class ?name ?short""")
    names: dict[str, list[str]] = {}
    shorts: dict[str, str] = {}
    for row in rows:
        if not isinstance(row["class"], NamedNode):
            continue  # other stores keep blank nodes as IRIs, which isIRI lets pass
        iri = str(row.value("class"))
        names_of_class = names.setdefault(iri, [])
        if row["name"] is not None and str(row.value("name")) not in names_of_class:
            names_of_class.append(str(row.value("name")))
        if row["short"] is not None:
            shorts.setdefault(iri, str(row.value("short")))
    for iri, names_of_class in names.items():
        plain = " ".join(re.findall(r"[A-Z]?[a-z]+|[A-Z]+|\d+", local_name(iri))).lower()
        if iri.startswith(ontology.NS) and plain and plain not in names_of_class:
            names_of_class.append(plain)
    return {
        iri: ObjectClass(NamedNode(iri), tuple(n), shorts.get(iri, "")) for iri, n in names.items()
    }


class TermCatalogue:
    """Cache of the coded values of a class by name, such as functions of objects or colours.

    Parameters
    ----------
    kind
        The class; values of its subclasses count.
    """

    def __init__(self, kb: GraphCore, kind: NamedNode) -> None:
        self._kb = kb
        self._kind = kind
        self._lock = threading.Lock()
        self._cached: Mapping[str, tuple[str, ...]] | None = None

    def forget_if_changed(self, change: Change) -> None:
        """Drop the cache after a commit about values of the class or names."""
        for quad in (*change.added, *change.removed):
            if quad.object == self._kind or quad.predicate == RDFS.label:
                with self._lock:
                    self._cached = None
                return

    def all(self) -> Mapping[str, tuple[str, ...]]:
        """Return the names of every value by IRI, the label first."""
        with self._lock:
            if self._cached is None:
                self._cached = _read_terms(self._kb, self._kind)
            return self._cached


def _read_terms(kb: GraphCore, kind: NamedNode) -> dict[str, tuple[str, ...]]:
    rows = kb.select(f"""{PREFIXES}
SELECT DISTINCT ?term ?name ?other {{ ?term a/rdfs:subClassOf* {kind}
  OPTIONAL {{ ?term rdfs:label ?name }} OPTIONAL {{ ?term skos:altLabel ?other }}
}} ORDER BY ?term ?name ?other""")
    names: dict[str, dict[str, None]] = {}
    for row in rows:
        labels = names.setdefault(str(row.value("term")), {})
        for variable in ("name", "other"):
            if row[variable] is not None:
                labels.setdefault(str(row.value(variable)))
    return {term: tuple(labels) or (local_name(term),) for term, labels in names.items()}
