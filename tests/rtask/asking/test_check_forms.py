"""The check reads what expressions take a variable for, and what is said of statements."""

from __future__ import annotations

import pytest

import ontology
from rtask.asking.check.checker import checker_of
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import prologue

HEAD = prologue(ontology.PREFIXES)


@pytest.mark.parametrize(
    ("body", "rule", "right"),
    [
        ('SELECT ?o { ?o rt:taskDeadline ?n FILTER(?n IN ("mug")) }', "wrong-type", None),
        ('SELECT ?o { ?o rt:success ?n FILTER(sameTerm(?n, "true")) }', "wrong-type", None),
        ('SELECT ?o { ?o rt:mass ?m FILTER(?m > "3") }', "wrong-type", None),
        ("SELECT ?h { ?w rt:hasOutcome ?t } GROUP BY (HOURS(?t) AS ?h)", "wrong-type", None),
        (
            "SELECT ?x ?c { << ?x rt:hasColor rt:colour_red >> rt:confidence ?c }",
            "unknown-term",
            "SELECT ?x ?c { << ?x rt:hasColour rt:colour_red >> rt:confidence ?c }",
        ),
        (
            "SELECT ?o { ?o a <http://w3id.org/rtask-kg/ns#Mug> }",
            "unknown-term",
            "SELECT ?o { ?o a rt:Mug }",
        ),
        (
            "SELECT ?s { ?s sh:targeCtlass ?c }",
            "unknown-term",
            "SELECT ?s { ?s sh:targetClass ?c }",
        ),
    ],
)
def test_a_fault_is_found(kb: KnowledgeBase, body: str, rule: str, right: str | None) -> None:
    found = next(one for one in kb.check(HEAD + body) if one.rule == rule)
    if right is not None:
        assert found.repairs[0].apply(HEAD + body).removeprefix(HEAD) == right


@pytest.mark.parametrize(
    "body",
    [
        "SELECT ?thing ?who { << ?thing rt:locatedOn ?place ~ ?r >> prov:wasAttributedTo ?who . "
        "?r rt:confidence ?sure }",
        "SELECT ?x ?sure { ?x rt:hasColour ?colour {| rt:confidence ?sure |} ; rt:name ?n }",
        "SELECT ?r { ?r rdf:reifies <<( ?thing rt:mass ?m )>> }",
        "SELECT ?shape { ?shape sh:sparql ?rule . ?rule sh:ownKeyOfALab ?key }",
        "SELECT ?other { ?mug rt:locatedOn ?place . ?other rt:locatedOn ?place "
        "FILTER(!sameTerm(?mug, ?other)) }",
        "SELECT ?o { ?o rt:mass ?m FILTER(?m IN (0.5, 1)) }",
        'SELECT ?o { ?o rt:name ?n FILTER(?n = "mug" || ?n IN ("pen", "box")) }',
        'SELECT ?w { ?w prov:endedAtTime ?t FILTER(?t > "2026-01-01T00:00:00Z"^^xsd:dateTime) }',
    ],
)
def test_a_sound_query_is_read_and_raises_no_alarm(kb: KnowledgeBase, body: str) -> None:
    assert kb.check(HEAD + body) == []
    assert checker_of(kb).unread(HEAD + body) == ""
