"""The SPARQL queries at the end of the demo, sent to the live endpoint over HTTP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import httpx

from ontology import PREFIXES
from rtask.errors import RemoteUnavailableError

__all__ = ["QUESTIONS", "Answer", "Question", "ask", "with_prefixes"]

_TIMEOUT_S = 30.0


@dataclass(frozen=True)
class Question:
    """A query in words and in SPARQL (prefixes are added by :func:`with_prefixes`)."""

    words: str
    sparql: str


@dataclass(frozen=True)
class Answer:
    """The result table of a query, with values shortened for reading."""

    question: Question
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


QUESTIONS = (
    Question(
        "Which products are known, and who grasped them how?",
        """
SELECT ?product ?robot ?hand ?grasp (COUNT(DISTINCT ?attempt) AS ?attempts)
       (COUNT(DISTINCT ?won) AS ?held) {
  ?object rt:objectId ?id ; rt:name ?product ; rt:hasGrasp ?grasp .
  ?attempt rt:executesGrasp ?grasp ; rt:performedBy/rt:name ?robot ; rt:hasOutcome ?outcome ;
           rt:activates/rt:gripperType ?hand .
  OPTIONAL { ?outcome rt:judgedSuccess true BIND(?outcome AS ?won) }
} GROUP BY ?product ?robot ?hand ?grasp ORDER BY ?product ?robot ?grasp""",
    ),
    Question(
        "How often does each kind of product stay in the hand of each kind of robot?",
        """
SELECT ?kind ?hand (COUNT(DISTINCT ?outcome) AS ?attempts)
       (ROUND(100 * SUM(IF(?held, 1, 0)) / COUNT(?held)) AS ?percentHeld) {
  { SELECT DISTINCT ?kind ?hand ?outcome ?held {
      ?object rt:objectId ?id ; rt:hasGrasp/rt:triedIn ?attempt ; a ?type .
      ?attempt rt:activates/rt:gripperType ?hand ; rt:hasOutcome ?outcome .
      ?outcome rt:judgedSuccess ?held .
      ?type rdfs:subClassOf rt:ManipulableObject ; rdfs:label ?kind
      FILTER(?type != rt:ManipulableObject)
  } }
} GROUP BY ?kind ?hand ORDER BY ?kind ?hand""",
    ),
    Question(
        "What is known about the robots that nobody ever asserted?",
        """
SELECT DISTINCT ?robot ?property ?value {
  ?who a cora:Robot ; rt:name ?robot . ?inferred a rt:InferredGraph .
  { GRAPH ?inferred { ?who a ?value } BIND("is a" AS ?property)
    VALUES ?value { rt:ManipulatorRobot sumo:Agent prov:Agent } }
  UNION
  { GRAPH ?inferred { ?who rt:hasCapability ?value } BIND("is capable of" AS ?property) }
  UNION
  { { SELECT ?who (COUNT(DISTINCT ?object) AS ?value) {
        ?g a rt:InferredGraph . GRAPH ?g { ?who rt:canGrasp ?object } ?object rt:objectId ?id
      } GROUP BY ?who } BIND("number of products that fit its hand" AS ?property) }
} ORDER BY ?robot ?property ?value""",
    ),
    Question(
        "Why did a robot not grasp, and what did it do then?",
        """
SELECT ?robot ?product ?lacking (ROUND(100 * ?confidence) / 100 AS ?found) ?required ?then {
  ?refusal a rt:GraspRefusal ; prov:wasAssociatedWith/rt:name ?robot ; rt:atTime ?time ;
    rt:lackingConfidence ?lacking ; rt:foundConfidence ?confidence ;
    rt:requiredConfidence ?required .
  OPTIONAL { ?refusal rt:refusedObject/rt:name ?product }
  OPTIONAL { ?refusal rt:refusalResponse ?then }
} ORDER BY ?robot ?time""",
    ),
)


def with_prefixes(sparql: str) -> str:
    """Return the query with declarations of the prefixes it uses."""
    used = [(name, iri) for name, iri in PREFIXES.items() if f"{name}:" in sparql]
    return "".join(f"PREFIX {name}: <{iri}>\n" for name, iri in used) + sparql.strip() + "\n"


def ask(url: str, question: Question) -> Answer:
    """Ask a live endpoint by SPARQL 1.1 Protocol.

    Raises
    ------
    RemoteUnavailableError
        When it does not answer with 200.
    """
    try:
        response = httpx.post(
            f"{url}/sparql",
            content=with_prefixes(question.sparql).encode(),
            headers={
                "Content-Type": "application/sparql-query",
                "Accept": "application/sparql-results+json",
            },
            timeout=_TIMEOUT_S,
        )
        response.raise_for_status()
    except httpx.HTTPError as error:
        raise RemoteUnavailableError(f"{url}/sparql did not answer: {error}") from error
    data = response.json()
    columns = tuple(data["head"]["vars"])
    rows = tuple(
        tuple(_shorten(binding.get(column)) for column in columns)
        for binding in data["results"]["bindings"]
    )
    return Answer(question, columns, rows)


def _shorten(term: dict[str, Any] | None) -> str:
    """Return a term for people: prefixed names, numbers without datatypes."""
    if term is None:
        return ""
    value = str(term["value"])
    if term["type"] != "uri":
        return value
    for name, iri in PREFIXES.items():
        if value.startswith(iri):
            return f"{name}:{value[len(iri) :]}"
    return "/".join(value.split("/")[-2:])
