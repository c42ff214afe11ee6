"""Cards of classes and properties: what they mean, how they are used, and a query with them.

People, agents and the editor read the same card (:func:`card_of`); :func:`list_terms` finds terms
by words. Both ask in SPARQL alone, so that any client, embedded or remote, can serve them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import ontology
from rtask.asking.terms import Reader
from rtask.errors import UnknownTermError, UsageError, nearest
from rtask.rdf.terms import NamedNode, iri, prologue

if TYPE_CHECKING:  # questions in words show cards, too
    from rtask.asking.questions.mentions import Select

__all__ = ["Card", "TermLine", "Use", "card_of", "find_term", "list_terms", "shortened"]

_SAMPLE = 1_000
_USES = 12
_TERMS = 2_000
_IN_EXAMPLE = 2
_NS = ontology.PREFIXES
_PROLOGUE = "".join(
    f"PREFIX {prefix}: <{_NS[prefix]}>\n" for prefix in ("owl", "rdf", "rdfs", "rt", "skos")
)
_CLASS_TYPES = {_NS["owl"] + "Class", _NS["rdfs"] + "Class"}
_PROPERTY_TYPES = {
    *(_NS["owl"] + name for name in ("ObjectProperty", "DatatypeProperty", "AnnotationProperty")),
    _NS["rdf"] + "Property",
}
_TOP = {_NS["owl"] + "Thing", _NS["rdfs"] + "Resource"}
_BOOKKEEPING = (_NS["rdf"], _NS["owl"], _NS["prov"])
_NOT_A_WORD = re.compile(r"[^a-z0-9]+")
_IN_SEARCH = {
    "rt:matches": "",
    "rt:score": " ;\n      rt:score ?score",
    "rt:text": " ;\n      rt:text ?text",
    "rt:limit": " ;\n      rt:limit 5",
    "rt:lang": ' ;\n      rt:lang "en"',
}
"""Properties that only a search for words knows, and how they stand in its pattern."""


@dataclass(frozen=True)
class Use:
    """A property that members of a class have, or a class whose members a property relates.

    Parameters
    ----------
    term
        Prefixed name.
    count
        Number of statements among those looked at.
    """

    term: str
    count: int


@dataclass(frozen=True)
class TermLine:
    """A class or property in a list."""

    term: str
    kind: str
    label: str
    comment: str


@dataclass(frozen=True)
class Card:
    """What a class or property means and how a graph uses it.

    Parameters
    ----------
    term, iri
        Prefixed name and IRI.
    kind
        ``class`` or ``property``.
    label, comment
        Name and definition; empty where none is stated.
    count
        Members of the class, or statements with the property, with all that follows.
    above, below
        Nearest super- and subterms.
    domain, range
        Of a property: classes that are stated for its subjects and values.
    uses
        Of a class: the properties of its members; of a property: the classes of its subjects. The
        first thousand members or statements are looked at.
    on_statements
        Of a property: how many of its subjects are reifiers (RDF 1.2), so that it says something
        about another statement, as a confidence does.
    annotates
        Of such a property: the properties of the statements that it is about, among the first
        thousand.
    replaced_by
        Terms to use instead of a deprecated one.
    is_deprecated
        Whether it is deprecated.
    example
        A SPARQL query with it.
    questions
        The ontology's questions whose queries name it.
    parameters, preconditions, additions, removals
        Of a class of actions: graph patterns that say what its tasks are about, what must match
        before one, and what matches after it or no longer does.
    """

    term: str
    iri: str
    kind: str
    label: str = ""
    comment: str = ""
    count: int = 0
    above: tuple[str, ...] = ()
    below: tuple[str, ...] = ()
    domain: tuple[str, ...] = ()
    range: tuple[str, ...] = ()
    uses: tuple[Use, ...] = ()
    on_statements: int = 0
    annotates: tuple[Use, ...] = ()
    replaced_by: tuple[str, ...] = ()
    is_deprecated: bool = False
    example: str = ""
    questions: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    preconditions: tuple[str, ...] = ()
    additions: tuple[str, ...] = ()
    removals: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the card as JSON data."""
        return asdict(self)

    def lines(self) -> list[str]:
        """Return the card as text, a line each."""
        noun = "member" if self.kind == "class" else "statement"
        lines = [f"{self.term}  {self.label!r}  {self.kind}"]
        lines += [self.comment] if self.comment else []
        if self.is_deprecated:
            instead = f"; use {', '.join(self.replaced_by)}" if self.replaced_by else ""
            lines.append(f"deprecated{instead}")
        counted = f"{self.count} {noun}{'' if self.count == 1 else 's'}"
        about = f", {self.on_statements} of them about other statements"
        lines.append(counted + (about if self.on_statements else ""))
        for heading, terms in (
            ("above", self.above), ("below", self.below),
            ("domain", self.domain), ("range", self.range),
        ):  # fmt: skip
            lines += [f"{heading}: {', '.join(terms)}"] if terms else []
        if self.uses:
            heading = "properties" if self.kind == "class" else "of"
            uses = ", ".join(f"{use.term} ({use.count})" for use in self.uses)
            lines.append(f"{heading}: {uses}")
        if self.annotates:
            about = ", ".join(f"{use.term} ({use.count})" for use in self.annotates)
            lines.append(f"about statements with: {about}")
        for heading, patterns in (
            ("about", self.parameters), ("before", self.preconditions),
            ("after", self.additions), ("no longer after", self.removals),
        ):  # fmt: skip
            lines += [f"{heading}: {pattern}" for pattern in patterns]
        lines += ["", *self.example.splitlines()]
        if self.questions:
            lines += ["", *(f"question: {text}" for text in self.questions)]
        return lines


def card_of(select: Select, term: NamedNode) -> Card:
    """Return the card of a class or property.

    Raises
    ------
    UnknownTermError
        The graph has no class or property of this IRI.
    """
    name = shortened(term.value)
    stated = _stated(select, term)
    types = set(stated.get(_NS["rdf"] + "type", ()))
    if types & _CLASS_TYPES:
        kind, above = "class", _NS["rdfs"] + "subClassOf"
    elif types & _PROPERTY_TYPES:
        kind, above = "property", _NS["rdfs"] + "subPropertyOf"
    else:
        raise UnknownTermError(f"the graph has no class or property {name}")
    uses = _uses(select, term, kind)
    on_statements = _on_statements(select, term) if kind == "property" else 0
    domain, value_range = (_ends(select, term, end) for end in ("domain", "range"))
    if on_statements and not uses:
        example = _example_about_statements(name)
    else:
        example = _example(name, kind, uses, _met(select, term, uses, domain))
    definitions = [*stated.get(_NS["skos"] + "definition", ()),
                   *stated.get(_NS["rdfs"] + "comment", ())]  # fmt: skip
    replaced = stated.get(_NS["dcterms"] + "isReplacedBy", ())
    return Card(
        term=name,
        iri=term.value,
        kind=kind,
        label=next(iter(stated.get(_NS["rdfs"] + "label", ())), ""),
        comment=next(iter(definitions), ""),
        count=_count(select, term, kind),
        above=_nearest(select, term, above, upwards=True),
        below=_nearest(select, term, above, upwards=False),
        domain=domain,
        range=value_range,
        uses=uses,
        on_statements=on_statements,
        annotates=_annotates(select, term) if on_statements else (),
        replaced_by=_shortened(replaced),
        is_deprecated="True" in stated.get(_NS["owl"] + "deprecated", ()),
        example=example,
        questions=_questions_with(name),
        parameters=tuple(stated.get(_NS["rt"] + "actionParameters", ())),
        preconditions=tuple(stated.get(_NS["rt"] + "precondition", ())),
        additions=tuple(stated.get(_NS["rt"] + "addition", ())),
        removals=tuple(stated.get(_NS["rt"] + "removal", ())),
    )


def find_term(select: Select, text: str, base: str = "") -> NamedNode:
    """Return the IRI of a class or property from how people write it.

    Parameters
    ----------
    text
        An IRI, a prefixed name, or the name or label of a term: ``Mug``, ``grasp width``.
    base
        What ``kb:`` stands for.

    Raises
    ------
    UnknownTermError
        No term has the name; it suggests the nearest one.
    UsageError
        Several terms have the name, or the text is no term.
    """
    text = text.strip()
    if ":" in text or text.startswith("<"):
        term = Reader(base).term(text, "subject")
        if isinstance(term, NamedNode):
            return term
    spoken = " ".join(text.strip('"').lower().split())
    lines = list_terms(select)
    names = {line.term: {line.label.lower(), line.term.split(":")[-1].lower()} for line in lines}
    called = [term for term, own in names.items() if spoken in own]
    own_terms = [term for term in called if term.startswith("rt:")]
    called = own_terms if len(own_terms) == 1 else called
    if len(called) > 1:
        raise UsageError(f"{len(called)} terms are called {text!r}: {', '.join(called)}")
    if not called:
        known = sorted({name for own in names.values() for name in own if name})
        hint = nearest(spoken, known)
        raise UnknownTermError(f"the graph has no class or property {text!r}{hint}")
    return iri(Reader().term(called[0], "subject").value)  # type: ignore[union-attr]


def list_terms(select: Select, words: str = "") -> list[TermLine]:
    """Return classes and properties, sorted by name.

    Parameters
    ----------
    words
        All must occur in the name, label or comment; empty for all terms.
    """
    rows = _rows(
        select,
        f"""{_PROLOGUE}SELECT ?term ?kind (MIN(STR(?said)) AS ?label) (MIN(STR(?means)) AS ?comment)
WHERE {{
  VALUES (?type ?kind) {{
    (owl:Class "class") (owl:ObjectProperty "property") (owl:DatatypeProperty "property")
    (owl:AnnotationProperty "property")
  }}
  ?term a ?type FILTER(isIRI(?term))
  OPTIONAL {{ ?term rdfs:label ?said }}
  OPTIONAL {{ ?term skos:definition|rdfs:comment ?means }}
}} GROUP BY ?term ?kind ORDER BY ?term LIMIT {_TERMS}""",
    )
    lines = [
        TermLine(
            shortened(str(row["term"])), _text(row["kind"]), _text(row["label"]),
            _text(row["comment"]),
        )
        for row in rows
    ]  # fmt: skip
    wanted = _words(words)
    return [
        line
        for line in lines
        if all(
            any(part.startswith(word) for part in _words(f"{line.term} {line.label}"))
            or word in _words(line.comment)
            for word in wanted
        )
    ]


def shortened(iri: str) -> str:
    """Return an IRI by the longest prefix of the ontology, or in angle brackets."""
    spaces = sorted(_NS.items(), key=lambda item: -len(item[1]))
    for prefix, space in spaces:
        local = iri[len(space) :]
        if iri.startswith(space) and re.fullmatch(r"[A-Za-z_][\w-]*", local):
            return f"{prefix}:{local}"
    return f"<{iri}>"


def _shortened(iris: Iterable[str]) -> tuple[str, ...]:
    """Return prefixed names, without blank nodes and what everything is."""
    names = {shortened(iri) for iri in iris if ":" in iri and iri not in _TOP}
    return tuple(sorted(names))


def _words(text: str) -> set[str]:
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return {word for word in _NOT_A_WORD.split(parted.lower()) if word}


def _rows(select: Select, query: str) -> list[dict[str, Any]]:
    return select(query).to_dicts()


def _text(value: Any) -> str:
    return "" if value is None else str(value)


def _stated(select: Select, term: NamedNode) -> dict[str, list[str]]:
    """Return the values of the properties that a card shows, by property."""
    properties = (
        "rdf:type rdfs:label rdfs:comment skos:definition owl:deprecated"
        f" <{_NS['dcterms']}isReplacedBy>"
        " rt:actionParameters rt:precondition rt:addition rt:removal"
    )
    stated: dict[str, list[str]] = {}
    for row in _rows(
        select,
        f"{_PROLOGUE}SELECT DISTINCT ?p ?o {{ VALUES ?p {{ {properties} }} {term} ?p ?o "
        "FILTER(!isBlank(?o)) } ORDER BY ?p ?o",
    ):
        stated.setdefault(str(_text(row["p"])), []).append(_text(row["o"]))
    return stated


def _count(select: Select, term: NamedNode, kind: str) -> int:
    pattern = f"?s a {term}" if kind == "class" else f"?s {term} ?o"
    counted = "DISTINCT ?s" if kind == "class" else "*"
    (row,) = _rows(select, f"SELECT (COUNT({counted}) AS ?n) {{ {pattern} }}")
    return int(_text(row["n"]))


def _nearest(select: Select, term: NamedNode, relation: str, *, upwards: bool) -> tuple[str, ...]:
    """Return the terms next to one in the hierarchy, although what follows is stored as well."""
    link = f"<{relation}>"
    near = f"{term} {link} ?x" if upwards else f"?x {link} {term}"
    between = f"{term} {link} ?y . ?y {link} ?x" if upwards else f"?x {link} ?y . ?y {link} {term}"
    rows = _rows(
        select,
        f"SELECT DISTINCT ?x {{ {near} FILTER(isIRI(?x) && ?x != {term}) FILTER NOT EXISTS {{ "
        f"{between} FILTER(isIRI(?y) && ?y != ?x && ?y != {term}) "
        f"FILTER NOT EXISTS {{ ?x {link} ?y . ?y {link} ?x }} }} }}",
    )
    nothing = _NS["owl"] + "Nothing"
    return _shortened(iri for row in rows if (iri := _text(row["x"])) != nothing)


def _ends(select: Select, term: NamedNode, end: str) -> tuple[str, ...]:
    """Return the most specific classes of the subjects or values of a property, as stated."""
    rows = _rows(
        select,
        f"{_PROLOGUE}SELECT DISTINCT ?x {{ {term} rdfs:{end} ?x FILTER(isIRI(?x)) "
        f"FILTER NOT EXISTS {{ {term} rdfs:{end} ?y . ?y rdfs:subClassOf ?x FILTER(?y != ?x) "
        "FILTER NOT EXISTS { ?x rdfs:subClassOf ?y } } }",
    )
    return _shortened(_text(row["x"]) for row in rows)


def _uses(select: Select, term: NamedNode, kind: str) -> tuple[Use, ...]:
    """Return what members of a class have, or what the subjects of a property are."""
    if kind == "class":
        inner, counted = f"?s a {term}", "?s ?x ?o"
    else:
        inner = f"?s {term} ?o"
        counted = (
            "?s a ?x FILTER NOT EXISTS { ?s a ?y . ?y rdfs:subClassOf ?x FILTER(?y != ?x) "
            "FILTER NOT EXISTS { ?x rdfs:subClassOf ?y } }"
        )
    rows = _rows(
        select,
        f"{_PROLOGUE}SELECT ?x (COUNT(*) AS ?n) {{ {{ SELECT DISTINCT ?s {{ {inner} }} "
        f"LIMIT {_SAMPLE} }} {counted} FILTER(isIRI(?x)) }} "
        f"GROUP BY ?x ORDER BY DESC(?n) ?x LIMIT {4 * _USES}",
    )
    uses = [
        Use(shortened(iri), int(_text(row["n"])))
        for row in rows
        if not (iri := _text(row["x"])).startswith(_BOOKKEEPING) and iri not in _TOP
    ]
    return tuple(uses[:_USES])


def _on_statements(select: Select, term: NamedNode) -> int:
    """Return how many reifiers have a property; no class tells that they are reifiers."""
    pattern = f"?s {term} ?o . ?s <{_NS['rdf']}reifies> ?t"
    (row,) = _rows(select, f"SELECT (COUNT(DISTINCT ?s) AS ?n) {{ {pattern} }}")
    return int(_text(row["n"]))


def _annotates(select: Select, term: NamedNode) -> tuple[Use, ...]:
    """Return the properties of the statements that a property is about.

    Asked only where there are reifiers: a server without RDF 1.2 has no ``PREDICATE``.
    """
    rows = _rows(
        select,
        f"{_PROLOGUE}SELECT ?x (COUNT(DISTINCT ?s) AS ?n) {{ {{ SELECT DISTINCT ?s ?t {{ "
        f"?s {term} ?o ; rdf:reifies ?t }} LIMIT {_SAMPLE} }} BIND(PREDICATE(?t) AS ?x) "
        f"FILTER(BOUND(?x)) }} GROUP BY ?x ORDER BY DESC(?n) ?x LIMIT {_USES}",
    )
    return tuple(Use(shortened(_text(row["x"])), int(_text(row["n"]))) for row in rows)


def _met(
    select: Select, term: NamedNode, uses: tuple[Use, ...], domain: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the classes of the subjects of a property, if a subject in the graph has them.

    Graphs of records are not reasoned about: what follows from a domain is not stated there.
    """
    if not uses or len(domain) != 1:
        return domain
    rows = _rows(
        select,
        f"{prologue(ontology.PREFIXES)}SELECT ?s {{ ?s a {domain[0]} ; {term} ?o }} LIMIT 1",
    )
    return domain if rows else ()


def _example(name: str, kind: str, uses: tuple[Use, ...], domain: tuple[str, ...]) -> str:
    """Return a query that a person can change: ten members, or ten statements."""
    if name in _IN_SEARCH:
        return (
            "SELECT * WHERE {\n  SERVICE <urn:rtask:text> {\n"
            f'    ?thing rt:matches "mug"{_IN_SEARCH[name]}\n  }}\n}} LIMIT 10'
        )
    if kind == "property":
        of_class = f"?thing a {domain[0]} .\n  " if len(domain) == 1 else ""
        return f"SELECT ?thing ?what WHERE {{\n  {of_class}?thing {name} ?what\n}} LIMIT 10"
    own = [use.term for use in uses if use.term.startswith("rt:")]
    shown = sorted(own, key=lambda term: term != "rt:name")[:_IN_EXAMPLE]
    variables = [local[0].lower() + local[1:] for local in (use.split(":")[1] for use in shown)]
    optional = "".join(
        f"\n  OPTIONAL {{ ?thing {term} ?{variable} }}"
        for term, variable in zip(shown, variables, strict=True)
    )
    head = " ".join(["?thing", *(f"?{variable}" for variable in variables)])
    return f"SELECT {head} WHERE {{\n  ?thing a {name}{optional}\n}} LIMIT 10"


def _example_about_statements(name: str) -> str:
    """Return a query for ten statements with what a property says about them."""
    return (
        "SELECT ?thing ?property ?value ?what WHERE {\n"
        f"  ?statement rdf:reifies <<( ?thing ?property ?value )>> ; {name} ?what\n}} LIMIT 10"
    )


@cache
def _questions_with(name: str) -> tuple[str, ...]:
    """Return the ontology's questions whose queries name a term."""
    from rtask.asking.questions.catalogue import questions

    used = re.compile(rf"(?<![\w:-]){re.escape(name)}(?![\w-])")
    return tuple(question.text for question in questions() if used.search(question.sparql))
