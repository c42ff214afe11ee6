"""The tool for questions in words, and the ontology's questions as resources."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from pydantic import Field

import ontology
from rtask.asking.questions import answer
from rtask.asking.shorthand import expand
from rtask.asking.tools.declaration import Asked, Paged, PagedAnswer, tool
from rtask.asking.tools.query import evaluate, rows_of
from rtask.asking.tools.values import Value
from rtask.sparql.results import Solutions, Triples
from rtask.wire.message import Answer
from rtask.wire.types import Text

__all__ = ["ask", "queries"]


class Ask(Paged):
    """A question."""

    text: Text | None = None
    """a question or a key such as cq05; default: list all"""


class Question(Answer):
    """A question that the ontology answers."""

    key: str
    text: str


class Reply(PagedAnswer):
    """The answer to a question, with its query; or the nearest questions, or all that there are."""

    understood: str = ""
    """key of the question; empty if none is near"""
    sentence: Value | None = None
    """the answer in words, or why there is none"""
    count: int | None = None
    """how many there are, if the question counts"""
    ignored: list[str] = Field(default_factory=list)
    """words of the text that the question has no place for"""
    sparql: str = ""
    columns: list[str] = Field(default_factory=list)
    rows: list[list[Value | None]] = Field(default_factory=list)
    why: str = ""
    """page on which each number leads to what it rests on"""
    questions: list[Question] = Field(default_factory=list)


_BY = "the server, quoting the graph"


@cache
def queries() -> dict[str, tuple[str, str]]:
    """Return the ontology's questions by key, each with its words and its query."""
    files = [*ontology.queries(), *ontology.episode_queries()]
    return {file.stem: _read(file) for file in files}


def _read(file: Path) -> tuple[str, str]:
    first, _, rest = file.read_text("utf-8").partition("\n")
    body = "\n".join(line for line in rest.splitlines() if not line.startswith("#"))
    return first.removeprefix("# question: "), body.strip() + "\n"


@tool(
    "Ask a question in words, or list the questions that can be asked.",
    {"text": "Where is the mug?"},
    {},
    entries=("rows", "questions"),
)
def ask(asked: Asked, request: Ask) -> Reply:
    """Answer the question that has these words or this key."""
    commit = asked.kb.seq
    if request.text is None:
        listed = [Question(key=key, text=text) for key, (text, _) in queries().items()]
        return Reply(commit=commit, questions=listed[request.offset :])
    key = _find(request.text)
    if key is None:
        return _nearest(asked, request, commit)
    sparql = queries()[key][1]
    solutions = evaluate(asked, expand(sparql, asked.reader.prefixes).text)
    return _reply(asked, request, commit, key, sparql, solutions)


def _nearest(asked: Asked, request: Ask, commit: int) -> Reply:
    """Answer the nearest question, with what the text names filled in."""

    def select(query: str) -> Solutions:
        solutions = evaluate(asked, query)
        assert isinstance(solutions, Solutions)
        return solutions

    answered = answer(asked.kb, request.text or "", select=select)
    said = asked.terms.text(answered.sentence, [_BY])
    if not answered.is_understood:
        near = [Question(key=item.key, text=item.question) for item in answered.nearest]
        return Reply(commit=commit, sentence=said, ignored=list(answered.ignored), questions=near)
    solutions = select(answered.sparql) if answered.is_cut else answered.rows
    reply = _reply(asked, request, commit, answered.key, answered.sparql, solutions)
    added = {"ignored": list(answered.ignored), "sentence": said, "count": answered.count}
    return reply.model_copy(update=added)


def _reply(
    asked: Asked,
    request: Ask,
    commit: int,
    key: str,
    sparql: str,
    solutions: Solutions | bool | Triples,
) -> Reply:
    rows = rows_of(asked, solutions, commit, request.offset)
    members: dict[str, Any] = {"more": rows.more} if rows.more.left else {}
    return Reply(
        commit=commit, understood=key, sparql=sparql, columns=rows.columns, rows=rows.rows,
        why=f"{asked.site}/ask?{urlencode({'text': request.text or ''})}", **members,
    )  # fmt: skip


def _find(text: str) -> str | None:
    sought = text.strip().lower()
    for key, (words, _) in queries().items():
        if sought in (key, words.lower()):
            return key
    return None
