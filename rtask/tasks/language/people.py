"""Names of people and robots in a goal: whose things are, and robots by part of a name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import ontology
from rtask.asking.questions.mentions import Mention
from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES, local_name
from rtask.rdf.terms import Literal, Term
from rtask.tasks.actions import Select

__all__ = ["owners", "robots_by_kind"]

_POSSESSIVE = re.compile(r"(?:['\u2019]s|(?<=s)['\u2019])$")
_OWNING = re.compile(r"own|belong|possess|proprietor", re.I)
_MAX_WORDS = 3
_MAX_ROWS = 2000
_NAMES = ("rt:name", "rdfs:label", "skos:prefLabel", "<http://xmlns.com/foaf/0.1/name>",
          "<https://schema.org/name>", "<http://schema.org/name>")  # fmt: skip
_OURS = tuple(iri for name, iri in ontology.PREFIXES.items() if name != "dcterms")
"""Vocabularies none of whose properties says whose a thing is."""
_NUMBER = re.compile(r"-\d+$")


def owners(select: Select, tokens: Sequence[str]) -> Iterator[Mention]:
    """Yield the names of those whose things are, with what is theirs: things and products.

    The ontology has no property for this, so that any property will do by which the graph links a
    thing, or its product, to somebody of this name; the text of the mention says which one.

    Raises
    ------
    UsageError
        Several properties do, and none of them alone speaks of owning.
    """
    spans: dict[str, list[tuple[int, int]]] = {}
    for start in range(len(tokens)):
        for end in range(start + 1, min(start + _MAX_WORDS, len(tokens)) + 1):
            words = [*tokens[start : end - 1], _POSSESSIVE.sub("", tokens[end - 1])]
            if all(word[:1].isalpha() for word in words) and _may_own(tokens, start, end):
                spans.setdefault(" ".join(words).lower(), []).append((start, end))
    links = _links(select, spans) if spans else {}
    for name, of_property in links.items():
        for start, end in spans[name]:
            wording = " ".join(tokens[start:end])
            prop = _owning_property(of_property, wording, bool(_POSSESSIVE.search(tokens[end - 1])))
            if prop:
                text = f"{wording} ({local_name(prop)})"
                yield Mention(start, end, text, "owner", tuple(of_property[prop]))


def _may_own(tokens: Sequence[str], start: int, end: int) -> bool:
    """Return whether a stretch stands where somebody can whose things are meant.

    A kind has a name as well, and all things are linked to theirs: not every word is looked up.
    """
    before = tokens[start - 1].lower() if start else ""
    after = tokens[end].lower() if end < len(tokens) else ""
    is_possessive = bool(_POSSESSIVE.search(tokens[end - 1]))
    return is_possessive or before in ("to", "by", "of") or after in ("owns", "has", "possesses")


def _links(select: Select, names: Mapping[str, object]) -> dict[str, dict[str, dict[Term, None]]]:
    """Return what is linked to somebody of a name, by property."""
    forms = {form: name for name in names for form in (name, name.title(), name.upper())}
    written = " ".join(f"{Literal(form)} {Literal(form)}@en" for form in sorted(forms))
    ours = " && ".join(f'!STRSTARTS(STR(?p), "{iri}")' for iri in _OURS)
    # A literal is looked up in the index of values; comparing the case of all names would not be.
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?n ?p ?x WHERE {{ VALUES ?n {{ {written} }} "
        f"?who {'|'.join(_NAMES)} ?n . {{ ?x ?p ?who }} UNION {{ ?who ?p ?x }} "
        "VALUES ?kind { rt:Exemplar rt:ManipulableObject } ?x a ?kind "
        f"FILTER({ours}) FILTER(?x != ?who) }} ORDER BY ?x LIMIT {_MAX_ROWS}"
    )
    links: dict[str, dict[str, dict[Term, None]]] = {}
    for row in rows:
        name, thing = forms[str(row.value("n"))], row["x"]
        assert thing is not None
        links.setdefault(name, {}).setdefault(str(row.value("p")), {})[thing] = None
    return links


def _owning_property(of_property: Mapping[str, object], wording: str, is_asked: bool) -> str:
    """Return the property that says whose things are; "" where none clearly does."""
    owning = [prop for prop in of_property if _OWNING.search(local_name(prop))]
    props = owning or list(of_property)
    if len(props) > 1 and is_asked:
        listed = " and ".join(sorted(local_name(prop) for prop in props))
        raise UsageError(f"{wording!r}: the graph links things to them by {listed}: name the thing")
    return props[0] if len(props) == 1 else ""


def robots_by_kind(
    select: Select, tokens: Sequence[str], mentions: Sequence[Mention]
) -> Iterator[Mention]:
    """Yield "nao" where one robot alone is called nao and a number."""
    covered = {at for item in mentions for at in range(item.start, item.end)}
    free = [at for at, token in enumerate(tokens) if at not in covered and token.isalpha()]
    if not free:
        return
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?x ?name WHERE {{ ?x a cora:Robot ; rt:name ?name }} "
        f"LIMIT {_MAX_ROWS}"
    )
    of_kind: dict[str, list[Term]] = {}
    for row in rows:
        name, robot = str(row.value("name")).lower(), row["x"]
        if _NUMBER.search(name) and robot is not None:
            of_kind.setdefault(_NUMBER.sub("", name), []).append(robot)
    for at in free:
        robots = of_kind.get(tokens[at].lower(), [])
        if len(robots) == 1:
            yield Mention(at, at + 1, tokens[at], "robot", tuple(robots))
