"""Questions with their answers, as the graph holds them now."""

from __future__ import annotations

import datetime as dt
from collections import defaultdict
from contextlib import suppress
from typing import TYPE_CHECKING
from urllib.parse import unquote

from rtask.rdf.namespaces import CORA, PREFIXES, RDF, local_name
from rtask.rdf.terms import NamedNode
from rtask.tasks.questions.question import Choice, GivenAnswer, Question

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row

__all__ = ["read_questions"]

_QUESTIONS = f"""{PREFIXES}
SELECT ?question ?task ?robot ?kind ?text ?reason ?asked ?until ?otherwise ?sha WHERE {{
  ?question a rt:Question ; rt:asksAbout ?task ; prov:wasAttributedTo ?robot ;
    rt:questionText ?text ; rt:answerableUntil ?until ; prov:generatedAtTime ?asked ;
    rt:choiceOtherwise/rt:answerNumber ?otherwise .
  OPTIONAL {{ ?question rt:questionKind ?kind }}
  OPTIONAL {{ ?question rt:questionReason ?reason }}
  OPTIONAL {{ ?question rt:questionPicture/rt:hasBlob/rt:sha256 ?sha }}
}} ORDER BY ?asked"""
_CHOICES = f"""{PREFIXES}
SELECT ?question ?number ?code ?text ?place ?helps WHERE {{
  ?question a rt:Question ; rt:hasAnswerChoice ?choice .
  ?choice rt:answerNumber ?number ; rt:answerCode ?code ; rdfs:label ?text ; rt:answerHelps ?helps
  OPTIONAL {{ ?choice rt:answerPlace ?place }}
}}"""
_ANSWERS = f"""{PREFIXES}
SELECT ?question ?number ?person ?name ?time ?remark ?graph WHERE {{
  GRAPH ?graph {{ ?answer a rt:HumanAnswer }}
  ?answer rt:answersQuestion ?question ; rt:chosenAnswer/rt:answerNumber ?number ;
    prov:wasAttributedTo ?person ; prov:generatedAtTime ?time .
  OPTIONAL {{ ?person rt:name ?name }}
  OPTIONAL {{ ?answer rt:answerRemark ?remark }}
}} ORDER BY ?time"""


def read_questions(kb: GraphCore) -> dict[str, list[Question]]:
    """Return the questions about each planned step, by its IRI, in the order of asking.

    An answer in the graph of a robot is data of that robot, and answers nobody; of several answers
    the first counts.
    """
    rows = {str(row.value("question")): row for row in kb.select(_QUESTIONS)}
    if not rows:
        return {}
    choices, answers = _choices(kb), _answers(kb)
    questions: dict[str, list[Question]] = defaultdict(list)
    for name, row in rows.items():
        offered = [choices[name][number] for number in sorted(choices[name])]
        with suppress(ValueError):
            question = _question(row, offered, answers.get(name))
            if question is not None:
                questions[question.task].append(question)
    return questions


def _choices(kb: GraphCore) -> dict[str, dict[int, Choice]]:
    choices: dict[str, dict[int, Choice]] = defaultdict(dict)
    for row in kb.select(_CHOICES):
        with suppress(ValueError):  # what robots wrote by themselves must not stop the queue
            choices[str(row.value("question"))][_number(row, "number")] = Choice(
                str(row.value("code")), str(row.value("text")), str(row.value("place") or ""),
                row.value("helps") is True,
            )  # fmt: skip
    return choices


def _question(row: Row, choices: list[Choice], answer: GivenAnswer | None) -> Question | None:
    otherwise = _number(row, "otherwise")
    if not 1 <= otherwise <= len(choices):
        return None
    if answer is not None and not 1 <= answer.choice <= len(choices):
        answer = None
    return Question(
        str(row.value("question")), str(row.value("task")), str(row.value("robot")),
        str(row.value("kind") or ""), str(row.value("text")), str(row.value("reason") or ""),
        _time(row, "asked"), _time(row, "until"), tuple(choices), otherwise,
        str(row.value("sha") or ""), answer,
    )  # fmt: skip


def _answers(kb: GraphCore) -> dict[str, GivenAnswer]:
    answers: dict[str, GivenAnswer] = {}
    for row in kb.select(_ANSWERS):
        if _is_of_robot(kb, str(row.value("graph"))):
            continue
        with suppress(ValueError):
            person = str(row.value("person"))
            by = str(row.value("name") or unquote(local_name(person)))
            answers.setdefault(
                str(row.value("question")),
                GivenAnswer(
                    _number(row, "number"),
                    person,
                    by,
                    _time(row, "time"),
                    str(row.value("remark") or ""),
                ),
            )
    return answers


def _is_of_robot(kb: GraphCore, graph: str) -> bool:
    owner = kb.graphs.owner(NamedNode(graph))
    if owner is None:
        return False
    return bool(kb.match(kb.graphs.agent_iri(owner, "robot"), RDF.type, CORA.Robot))


def _number(row: Row, name: str) -> int:
    return int(str(row.value(name)))


def _time(row: Row, name: str) -> dt.datetime:
    value = row.value(name)
    time = value if isinstance(value, dt.datetime) else dt.datetime.fromisoformat(str(value))
    return time if time.tzinfo else time.replace(tzinfo=dt.UTC)
