"""Names for people in place of IRIs, on pages about statements."""

from __future__ import annotations

import re
from collections.abc import Iterable

from endpoint.pages.render import blueprint, short
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import RDF, RDFS, RT
from rtask.rdf.terms import Literal, NamedNode

__all__ = ["names_of"]

MAX_NAMED = 1_000
_VERBS = {RDF.type.value: "is a", RDFS.subClassOf.value: "is a kind of"}
_COUNTED = re.compile(r"(?:kb:|.*/kb/)([a-z_]+)/(\d+)")
_PART = re.compile(
    r"((?:kb:|.*/kb/(?:[0-9a-f]+/)?)(?:[a-z_-]+/(?:\d+|[0-9a-f-]{36})|robot/[^/]+))/(.+)"
)
_DATED = re.compile(r"(?:kb:|.*/kb/(?:[0-9a-f]+/)?)([a-z_-]+)/[0-9a-f-]{30}([0-9a-f]{6})")
"""An IRI that ends in a UUID of version 7: it begins with the time, so its end tells most."""
_ROBOT = re.compile(r"(?:kb:|.*/kb/(?:[0-9a-f]+/)?)robot/([^/]+)")


def names_of(kb: KnowledgeBase, iris: Iterable[str]) -> dict[str, str]:
    """Return what people call some things: their name, else their label; others are left out.

    Examples
    --------
    >>> import rtask
    >>> with rtask.open(":memory:") as kb:
    ...     list(names_of(kb, [RT.Mug.value, RDF.type.value, "urn:unknown"]).values())
    ['mug', 'is a']
    """
    names = {}
    for iri in list(dict.fromkeys(iris))[:MAX_NAMED]:
        term = NamedNode(iri)
        verb = _VERBS.get(iri) or _verb_phrase(kb, term) or _by_relations(kb, term)
        if verb:
            names[iri] = verb
    return names


def _verb_phrase(kb: KnowledgeBase, term: NamedNode) -> str:
    for predicate in (RT.name, RDFS.label):
        texts = [quad.object for quad in kb.match(term, predicate)]
        literals = [text for text in texts if isinstance(text, Literal)]
        if literals:
            english = [text for text in literals if text.language in (None, "", "en")]
            return (english or literals)[0].value
    return ""


def _by_relations(kb: KnowledgeBase, term: NamedNode) -> str:
    """Return what to call something that nobody named, by what it belongs to.

    A page headed by the UUID of an attempt would tell a person nothing.
    """
    robot, grasp = _first(kb, term, RT.performedBy), _first(kb, term, RT.executesGrasp)
    if robot and grasp:
        numbers = [quad.object for quad in kb.match(term, RT.attemptNumber)]
        counted = [f"attempt {number.value}" for number in numbers if isinstance(number, Literal)]
        holders = _holders(kb, RT.hasGrasp, grasp)
        named = [name for holder in holders if (name := _verb_phrase(kb, holder))]
        at = f" at {named[0]}" if named else ""
        which = counted[0] if counted else "an attempt"
        return f"{which} of {_verb_phrase(kb, robot) or 'a robot'}{at}"
    product = _first(kb, term, RT.exemplarOf)
    if product and (name := _verb_phrase(kb, product)):
        return f"one {name}"
    for holder in _holders(kb, RT.hasOutcome, term)[:1]:
        if attempt := _by_relations(kb, holder):
            return f"outcome of {attempt}"
    return ""


def _holders(kb: KnowledgeBase, predicate: NamedNode, object: NamedNode) -> list[NamedNode]:
    subjects = [quad.subject for quad in kb.match(None, predicate, object)]
    return [term for term in subjects if isinstance(term, NamedNode)]


def _first(kb: KnowledgeBase, subject: NamedNode, predicate: NamedNode) -> NamedNode | None:
    found = [quad.object for quad in kb.match(subject, predicate)]
    return next((term for term in found if isinstance(term, NamedNode)), None)


@blueprint.app_template_filter("resource_name")
def resource_name(iri: str) -> str:
    """Shorten an IRI for people; what the graph numbers is called by kind and number.

    Examples
    --------
    >>> resource_name("https://w3id.org/rtask-kg/kb/grasp/12"), resource_name("urn:other")
    ('grasp 12', 'urn:other')
    >>> resource_name("https://w3id.org/rtask-kg/kb/view/01a22b1b-cbef-7f9d-8a09-e7a2d93930bf")
    'view …3930bf'
    >>> resource_name("https://w3id.org/rtask-kg/kb/grasp/12/evaluation/nao-1")
    'evaluation nao-1 of grasp 12'
    """
    text = short(iri)
    if part := _PART.fullmatch(text):
        return f"{part[2].replace('/', ' ')} of {resource_name(part[1])}"
    if robot := _ROBOT.fullmatch(text):
        return robot[1]
    counted, dated = _COUNTED.fullmatch(text), _DATED.fullmatch(text)
    if dated:
        return f"{re.sub('[_-]', ' ', dated[1])} …{dated[2]}"
    return f"{counted[1].replace('_', ' ')} {counted[2]}" if counted else text
