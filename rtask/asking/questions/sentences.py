"""Rows as a sentence: the template of a question filled in, with names in place of IRIs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

import ontology
from rtask.asking.questions.filling import Filled
from rtask.asking.questions.mentions import Select
from rtask.rdf.terms import Literal, NamedNode, Term, python_value
from rtask.sparql.results import Solutions

__all__ = ["MAX_CLAUSES", "MAX_LISTED", "called_only", "names_of", "sentence", "spoken"]

MAX_CLAUSES = 5
MAX_LISTED = 12
_DIGEST = re.compile(r"[0-9a-f]{40,}")
_TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(?:\.\d+)?(Z|[+-]\d\d:\d\d)?")
_PART = re.compile(r"\[([^\[\]]*)\]|\{(\w+)\?([^|{}]*)\|((?:[^{}]|\{\w+\})*)\}|\{(\w+)(\*?)\}")
_VARIABLE = re.compile(r"\{(\w+)")
_COUNTED = re.compile(r"\{(\w+)\} (attempt|time|view|grasp)s\b")
"""A number and what it counts, of which there may be one."""


def names_of(select: Select, terms: Iterable[Term | None]) -> dict[Term, str]:
    """Return a name for each IRI: its own, its product's, its label, or its end; in one query.

    A single thing is called as its product, with the last characters of its IRI, since there may
    be more of it.
    """
    iris = sorted({term for term in terms if isinstance(term, NamedNode)}, key=str)
    if not iris:
        return {}
    rows = select(
        f"PREFIX rt: <{ontology.NS}> PREFIX rdfs: <{ontology.PREFIXES['rdfs']}>\n"
        "SELECT ?s (MIN(?name) AS ?first) (MIN(?label) AS ?second) (MIN(?kind) AS ?product) "
        "WHERE {\n"
        f"  VALUES ?s {{ {' '.join(map(str, iris))} }}\n"
        "  OPTIONAL { ?s rt:name ?name }\n  OPTIONAL { ?s rt:exemplarOf/rt:name ?kind }\n"
        "  OPTIONAL { ?s rdfs:label ?label\n"
        '    FILTER(LANGMATCHES(LANG(?label), "en") || LANG(?label) = "") }\n'
        "} GROUP BY ?s"
    )
    names: dict[Term, str] = {iri: _end(iri.value) for iri in iris}
    for row in rows:
        name, product, term = row["first"] or row["second"], row["product"], row["s"]
        if term is None:
            continue
        if isinstance(name, Literal):
            names[term] = name.value
        elif isinstance(product, Literal):
            # Two things of one product would have one name; the end of their IRIs tells them apart.
            names[term] = f"{product.value} ({names[term][-4:]})"
    return names


def called_only(select: Select, filled: Iterable[Filled], rows: Solutions) -> str:
    """Return a sentence about things that are called a kind which nobody has stated of them.

    A question for the instances of a class cannot answer with them; saying nothing would deny them.
    """
    answered = {term for row in rows for term in row}
    left = [
        term for item in filled if item.slot.role == "kind" and not item.is_kind
        for term in item.called if term not in answered
    ]  # fmt: skip
    if not left:
        return ""
    names = list(dict.fromkeys(names_of(select, left).values()))
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return f" Called so, but not known to be of that kind: {', '.join(names[:MAX_LISTED])}{more}."


def _end(text: str) -> str:
    for prefix, start in ontology.PREFIXES.items():
        if text.startswith(start) and prefix != "rt":
            return f"{prefix}:{text[len(start) :]}"
    return re.split(r"[#/]", text.rstrip("#/"))[-1] or text


def spoken(term: Term | None, names: Mapping[Term, str]) -> str:
    """Return a term as a person reads it: names, times to the second, short numbers.

    >>> spoken(Literal(0.123456789), {}), spoken(Literal("2026-01-01T10:00:00.5Z"), {})
    ('0.123', '2026-01-01 10:00:00Z')
    """
    if term is None:
        return ""
    if term in names:
        return names[term]
    value = python_value(term)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3g}"
    text = str(value)
    if _DIGEST.fullmatch(text):
        return text[:12] + "…"
    if timed := _TIME.fullmatch(text):
        return timed[1].replace("T", " ") + (timed[2] or "").replace("+00:00", "Z")
    return text


def sentence(
    template: str, rows: Solutions, names: Mapping[Term, str], given: Mapping[str, str]
) -> str:
    """Return the rows of an answer as one sentence.

    Parameters
    ----------
    template
        As in ``ontology/queries/words.toml``.
    given
        Words for roles that are no variables of the rows.
    """
    if "*}" in template:
        return _finished([_listed(template, rows, names, given)])
    # As keys, since rows that differ in columns that are not shown read alike.
    clauses: dict[str, None] = {}
    for row in rows:
        values = dict(zip(rows.variables, row, strict=True))
        clauses.setdefault(_clause(template, values, names, given))
    shown = list(clauses)[:MAX_CLAUSES]
    more = len(clauses) - len(shown)
    return _finished([*shown, f"and {more} more"] if more > 0 else shown)


def _finished(clauses: Sequence[str]) -> str:
    text = "; ".join(clauses)
    return f"{text[:1].upper()}{text[1:]}."


def _clause(
    template: str,
    values: Mapping[str, Term | None],
    names: Mapping[Term, str],
    given: Mapping[str, str],
) -> str:
    def word(name: str) -> str:
        return spoken(values[name], names) if name in values else given.get(name, "")

    return _filled(template, word).strip()


def _filled(template: str, word: Callable[[str], str]) -> str:
    """Return a template with its words.

    >>> _filled("{robot} tried {n} times", {"robot": "nao-1", "n": "1"}.__getitem__)
    'nao-1 tried 1 time'
    """

    def part(match: re.Match[str]) -> str:
        optional, asked, yes, no, name, _ = match.groups()
        if optional is not None:
            bound = all(word(item) for item in _VARIABLE.findall(optional))
            return _filled(optional, word) if bound else ""
        if asked is not None:
            return _filled(yes if word(asked) == "yes" else no, word)
        return word(name) or "?"

    def counted(match: re.Match[str]) -> str:
        name, noun = match.groups()
        return f"{{{name}}} {noun if word(name) == '1' else noun + 's'}"

    return _PART.sub(part, _COUNTED.sub(counted, template))


def _listed(
    template: str, rows: Solutions, names: Mapping[Term, str], given: Mapping[str, str]
) -> str:
    """Return one clause that lists the values of a variable."""

    def word(name: str) -> str:
        if name not in rows.variables:
            return given.get(name, "")
        values = dict.fromkeys(spoken(row[name], names) for row in rows)
        listed = [value for value in values if value]
        more = len(listed) - MAX_LISTED
        return ", ".join(listed[:MAX_LISTED]) + (f" and {more} more" if more > 0 else "")

    return _filled(template, word)
