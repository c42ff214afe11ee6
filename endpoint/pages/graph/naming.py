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
        verb = _VERBS.get(iri) or _verb_phrase(kb, NamedNode(iri))
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


@blueprint.app_template_filter("resource_name")
def resource_name(iri: str) -> str:
    """Shorten an IRI for people; what the graph counts is called by kind and number.

    Examples
    --------
    >>> resource_name("https://w3id.org/rtask-kg/kb/grasp/12"), resource_name("urn:other")
    ('grasp 12', 'urn:other')
    """
    text = short(iri)
    counted = _COUNTED.fullmatch(text)
    return f"{counted[1].replace('_', ' ')} {counted[2]}" if counted else text
