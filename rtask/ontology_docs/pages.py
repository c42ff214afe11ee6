"""One self-contained HTML page for each module: text, diagrams, links; nothing is fetched."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape
from pathlib import Path

import ontology
from rtask.ontology_docs.axioms import ABOVE, Axiom
from rtask.ontology_docs.diagrams import hierarchy, relations
from rtask.ontology_docs.source import Module, prefixed
from rtask.ontology_docs.terms import Term, Vocabulary
from rtask.rdf.terms import NamedNode

__all__ = ["write_pages"]

_OWL, _RDF, _RDFS = (ontology.PREFIXES[name] for name in ("owl", "rdf", "rdfs"))
_NAME = re.compile(r"\b[a-z]+:[A-Za-z_][\w.-]*|<[^<>\s]+>")
_SECTIONS = {
    "class": "Classes",
    "object property": "Object properties",
    "data property": "Data properties",
    "annotation property": "Annotation properties",
    "individual": "Individuals",
    "shape": "Shapes",
}
_WORDINGS = {
    _RDFS + "subClassOf": "is a",
    _RDFS + "subPropertyOf": "below",
    _RDFS + "domain": "domain",
    _RDFS + "range": "range",
    _OWL + "inverseOf": "inverse of",
    _OWL + "propertyChainAxiom": "follows from the chain",
    _OWL + "equivalentClass": "same as",
    _OWL + "disjointWith": "disjoint with",
    _OWL + "AllDisjointClasses": "all disjoint",
    _OWL + "AllDifferent": "all different",
    _OWL + "hasKey": "key",
    _RDF + "type": "type",
    ABOVE: "follows from",
}
_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;margin:0;color:#1b1f24;background:#fff}
header,main{max-width:70rem;margin:0 auto;padding:0 1rem}
header{border-bottom:1px solid #d0d7de}nav a{margin-right:.7rem;white-space:nowrap}
nav a[aria-current]{font-weight:600;color:#1b1f24}a{color:#0b5fad;text-decoration:none}
a:hover{text-decoration:underline}h2{margin-top:2rem}section{border-top:1px solid #eaeef2}
h3{margin:.8rem 0 0}h3 code{font-weight:400;color:#57606a;margin-left:.5rem}
table{border-collapse:collapse;margin:.3rem 0}th{text-align:left;font-weight:400;color:#57606a;
padding-right:1rem;vertical-align:top;white-space:nowrap}td{vertical-align:top;padding-right:1rem}
code{font:13px ui-monospace,monospace;overflow-wrap:anywhere}.drawing{overflow-x:auto}
svg text{font:12px ui-monospace,monospace;fill:#1b1f24}
svg text.edge{text-anchor:middle;fill:#0b5fad}
svg rect{fill:#eef4fb;stroke:#5d8fc4}svg rect.other{fill:#f6f8fa;stroke:#b4bcc6}
svg path{fill:none;stroke:#7d8590}svg path.also{stroke-dasharray:4 3}
.deprecated h3{text-decoration:line-through}
"""


def write_pages(vocabulary: Vocabulary, folder: Path) -> list[Path]:
    """Write an index and one page per module; return the files.

    The same vocabulary always gives the same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    writer = _Writer(vocabulary)
    texts = {"index.html": writer.index()}
    texts |= {page_name(module): writer.page(module) for module in vocabulary.modules}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def page_name(module: Module) -> str:
    """Return the name of a module's file."""
    return re.sub(r"[^\w.-]+", "-", module.name) + ".html"


class _Writer:
    def __init__(self, vocabulary: Vocabulary) -> None:
        self._vocabulary = vocabulary
        self._pages = {module.name: page_name(module) for module in vocabulary.modules}
        self._anchors = _anchors(vocabulary.terms)
        self._iris = {prefixed(iri): iri for iri in vocabulary.terms}

    # Pages

    def index(self) -> str:
        """Return the page that lists the modules."""
        rows = [
            f'<tr><th><a href="{self._pages[m.name]}">{escape(m.title)}</a></th>'
            f"<td>{escape(m.comment)}</td>"
            f"<td>{len(self._vocabulary.members(m))}</td></tr>"
            for m in self._vocabulary.modules
        ]
        letters = sorted(self._vocabulary.terms.values(), key=lambda t: t.name.lower())
        listed = " ".join(self._link(term.iri) for term in letters if "shape" not in term.kinds)
        body = f"<table>{''.join(rows)}</table><h2>All terms</h2><p>{listed}</p>"
        return self._document("Ontology", body, None)

    def page(self, module: Module) -> str:
        """Return the page of a module."""
        link = self._address
        drawings = [
            (name, draw(self._vocabulary, module, link))
            for name, draw in (("Class hierarchy", hierarchy), ("Relations", relations))
        ]
        parts = [f"<p>{escape(module.comment)}</p>", self._header(module)]
        for name, svg in drawings:
            if svg:
                parts.append(f'<h2>{name}</h2><div class="drawing">{svg}</div>')
        members = self._vocabulary.members(module)
        for kind, name in _SECTIONS.items():
            own = [term for term in members if term.kinds[0] == kind]
            if own:
                parts.append(f"<h2>{name}</h2>" + "".join(map(self._term, own)))
        return self._document(module.title, "".join(parts), module)

    def _header(self, module: Module) -> str:
        names = {m.iri: m for m in self._vocabulary.modules if m.iri}
        imports = [
            f'<a href="{self._pages[names[iri].name]}">{escape(names[iri].title)}</a>'
            for iri in _imports(module)
            if iri in names
        ]
        rows = [("IRI", f"<code>{escape(module.iri)}</code>"), ("version", escape(module.version))]
        rows.append(("imports", ", ".join(imports)))
        return _table(rows)

    def _document(self, title: str, body: str, current: Module | None) -> str:
        links = []
        for m in self._vocabulary.modules:
            if not m.name.startswith("shapes/"):
                here = ' aria-current="page"' if m is current else ""
                text = escape(m.name.rsplit("/", 1)[-1])
                links.append(f'<a href="{self._pages[m.name]}"{here}>{text}</a>')
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>"
            f'<header><h1>{escape(title)}</h1><nav><a href="index.html">index</a> {" ".join(links)}'
            f"</nav></header><main>{body}</main></body></html>\n"
        )

    # Terms

    def _term(self, term: Term) -> str:
        name = escape(term.label or term.name)
        rows = [(_wording(axiom), self._value(axiom)) for axiom in term.axioms if _tells(axiom)]
        rows.append(("unit", self._linked(term.unit)))
        rows.append(
            ("directly below", ", ".join(map(self._link, self._vocabulary.below(term.iri))))
        )
        rows += self._users(term)
        examples = [f"<code>{self._linked(x)}</code>" for x in self._vocabulary.examples(term.iri)]
        rows.append(("in the sample", "<br>".join(examples)))
        mark = ' class="deprecated"' if term.deprecated else ""
        return (
            f'<section id="{self._anchors[term.iri]}"{mark}><h3>{name}<code>{escape(term.name)}'
            f"</code></h3><p>{escape(term.comment)}</p>{_table(rows)}</section>"
        )

    def _value(self, axiom: Axiom) -> str:
        if axiom.subject == "" and len(axiom.mentions) > 8:
            return f"{len(axiom.mentions)} terms, from {self._link(axiom.mentions[0])} on"
        return self._linked(axiom.text)

    def _users(self, term: Term) -> list[tuple[str, str]]:
        """Return the properties whose range a term is, and the shapes and conditions with it."""
        users = self._vocabulary.used_by(term.iri)
        exact = [axiom for axiom in users if axiom.text == term.name]
        rows = []
        for side, text in (("domain", "has the properties"), ("range", "is the value of")):
            subjects = sorted({a.subject for a in exact if a.predicate == _RDFS + side})
            rows.append((text, ", ".join(map(self._link, subjects))))
        shapes = {a.subject for a in users if self._is_shape(a.subject)}
        rows.append(("checked by", ", ".join(map(self._link, sorted(shapes)))))
        inside = {a.subject for a in users if a.text != term.name and not self._is_shape(a.subject)}
        rows.append(("named in the axioms of", ", ".join(map(self._link, sorted(inside)))))
        return rows

    def _is_shape(self, iri: str) -> bool:
        return iri in self._vocabulary.terms and "shape" in self._vocabulary.terms[iri].kinds

    # Links

    def _address(self, iri: str) -> str | None:
        term = self._vocabulary.terms.get(iri)
        return f"{self._pages[term.module]}#{self._anchors[iri]}" if term else None

    def _link(self, iri: str) -> str:
        address, name = self._address(iri), escape(prefixed(iri))
        return f'<a href="{address}">{name}</a>' if address else name

    def _linked(self, text: str) -> str:
        """Return a text in which names are links."""
        parts, at = [], 0
        for name in _NAME.finditer(text):
            parts.append(escape(text[at : name.start()]))
            iri = self._iris.get(name.group())
            parts.append(self._link(iri) if iri else escape(name.group()))
            at = name.end()
        return "".join([*parts, escape(text[at:])])


def _imports(module: Module) -> list[str]:
    stated = [o for _, p, o in module.triples if p.value == _OWL + "imports"]
    imported = {term.value for term in stated if isinstance(term, NamedNode)}
    return sorted(imported)


def _tells(axiom: Axiom) -> bool:
    """Whether a statement deserves a row; the kind of term is already in the heading."""
    kinds = {prefixed(_OWL + name) for name in ("Class", "NamedIndividual")}
    kinds |= {prefixed(_OWL + f"{name}Property") for name in ("Object", "Datatype", "Annotation")}
    return not (axiom.predicate == _RDF + "type" and axiom.text in kinds)


def _wording(axiom: Axiom) -> str:
    return _WORDINGS.get(axiom.predicate) or prefixed(axiom.predicate)


def _table(rows: Iterable[tuple[str, str]]) -> str:
    """Return rows of text and HTML, without empty ones and with equal names joined."""
    joined: dict[str, list[str]] = {}
    for name, value in rows:
        if value:
            joined.setdefault(name, []).append(value)
    if not joined:
        return ""
    body = "".join(
        f"<tr><th>{escape(name)}</th><td>{'<br>'.join(values)}</td></tr>"
        for name, values in joined.items()
    )
    return f"<table>{body}</table>"


def _anchors(iris: Iterable[str]) -> dict[str, str]:
    """Give each term an identifier of its own."""
    made: dict[str, str] = {}
    taken: set[str] = set()
    for iri in sorted(iris):
        name = re.sub(r"[^\w.-]+", "-", prefixed(iri)).strip("-") or "term"
        while name in taken:
            name += "-"
        taken.add(name)
        made[iri] = name
    return made
