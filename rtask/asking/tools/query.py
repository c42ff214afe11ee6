"""Tools that ask by SPARQL: a query is checked before it is believed."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from rtask.asking.check.checker import check, checker_of
from rtask.asking.check.findings import Finding
from rtask.asking.shorthand import Expansion, expand
from rtask.asking.tools.declaration import Asked, Paged, PagedAnswer, tool
from rtask.asking.tools.evidence import with_evidence
from rtask.asking.tools.values import Fact, Value
from rtask.errors import QuerySyntaxError
from rtask.sparql.results import Solutions, Triples, read_answer
from rtask.wire.message import Answer, Message
from rtask.wire.types import Text

__all__ = ["Rows", "ask_sparql", "check_sparql", "evaluate", "rows_of"]

MAX_ROWS = 20_000
MAX_BYTES = 16 << 20
MAX_FINDINGS = 5
PAGE = 200
_EXAMPLE = "SELECT ?o { ?o a rt:Mug }"


class AskSparql(Paged):
    """A query."""

    query: Text
    """of any form; rt:, kb:, prov: and the like are declared"""


class Fault(Answer):
    """A fault of a query, and the query repaired."""

    rule: str
    severity: str
    line: int
    column: int
    detail: Value
    repaired: Value | None = None


class Rows(PagedAnswer):
    """Rows of a SELECT, the answer to an ASK, or statements."""

    columns: list[str] = Field(default_factory=list)
    rows: list[list[Value | None]] = Field(default_factory=list)
    holds: bool = False
    facts: list[Fact] = Field(default_factory=list)
    faults: list[Fault] = Field(default_factory=list)
    faults_left_out: int = 0
    not_checked: str = ""
    """why the query was not checked: no fault is then no proof of none"""


class CheckSparql(Message):
    """A query to check."""

    query: Text


class Checked(Answer):
    """What is wrong with a query."""

    commit: int
    ok: bool
    """no fault was seen; of a query that was not checked, that it can be read"""
    faults: list[Fault]
    faults_left_out: int
    not_checked: str


@tool(
    "Run a SPARQL query on the graph, check it, and get its rows.",
    {"query": _EXAMPLE},
    {"query": "ASK { kb:object/7 rt:name ?n }"},
    entries=("rows", "facts"),
)
def ask_sparql(asked: Asked, request: AskSparql) -> Rows:
    """Evaluate a query within the time of a call, and add what is certainly wrong with it."""
    query = expand(request.query, asked.reader.prefixes)
    commit = asked.kb.seq
    try:
        answer = evaluate(asked, query.text)
        findings = check(asked.kb, query.text)
    except QuerySyntaxError as error:
        raise query.error(error) from None
    is_empty = not answer
    findings = [finding for finding in findings if is_empty or finding.severity == "certain"]
    answered = rows_of(asked, answer, commit, request.offset)
    if isinstance(answer, Solutions):
        terms = [list(row) for row in answer[request.offset : request.offset + PAGE]]
        answered = answered.model_copy(update={"rows": with_evidence(asked, terms, answered.rows)})
    return answered.model_copy(update=_faults(asked, query, findings))


@tool(
    "Check a SPARQL query without running it: unknown terms, what cannot match, with repairs.",
    {"query": _EXAMPLE},
    {"query": "SELECT ?r { kb:object/7 rt:canGrasp ?r }"},
)
def check_sparql(asked: Asked, request: CheckSparql) -> Checked:
    """Return the faults of a query that parses; one that does not is an error with its place."""
    query = expand(request.query, asked.reader.prefixes)
    try:
        findings = check(asked.kb, query.text)
    except QuerySyntaxError as error:
        raise query.error(error) from None
    members: dict[str, Any] = {"faults": [], "faults_left_out": 0, "not_checked": ""}
    members |= _faults(asked, query, findings)
    return Checked(commit=asked.kb.seq, ok=not findings, **members)


def evaluate(asked: Asked, text: str) -> Solutions | bool | Triples:
    """Evaluate a query in a process that ends with the call.

    Raises
    ------
    RtaskError
        The query cannot be read, takes too long, or has too large an answer.
    """
    kb = asked.kb
    asked.work.report(0.1, "running the query")
    if not kb.readers.possible:
        return kb.query(text, timeout_s=asked.timeout_s)
    with kb.stream(
        text,
        timeout_s=asked.timeout_s,
        max_rows=MAX_ROWS,
        max_bytes=MAX_BYTES,
        on_start=lambda stream: asked.work.on_stop(stream.close),
    ) as stream:
        return read_answer(stream.kind, stream.read())


def rows_of(asked: Asked, answer: Solutions | bool | Triples, commit: int, offset: int) -> Rows:
    """Return an answer of the graph from an offset on."""
    terms = asked.terms
    if isinstance(answer, bool):
        return Rows(commit=commit, holds=answer)
    page = answer[offset : offset + PAGE]
    left = max(len(answer) - offset - PAGE, 0)
    more: dict[str, Any] = {"more": {"offset": offset + PAGE, "left": left}} if left else {}
    if isinstance(page, Triples):
        facts = [terms.fact((triple.subject, triple.predicate, triple.object)) for triple in page]
        return Rows(commit=commit, facts=facts, **more)
    assert isinstance(page, Solutions)
    rows = [[None if term is None else terms.value(term) for term in row] for row in page]
    return Rows(commit=commit, columns=list(page.variables), rows=rows, **more)


def _faults(asked: Asked, query: Expansion, findings: list[Finding]) -> dict[str, Any]:
    """Return members for the faults of a query, with places in the text as it was given."""
    members: dict[str, Any] = {}
    if findings:
        members["faults"] = [_fault(asked, query, finding) for finding in findings[:MAX_FINDINGS]]
    if len(findings) > MAX_FINDINGS:
        members["faults_left_out"] = len(findings) - MAX_FINDINGS
    if unread := checker_of(asked.kb).unread(query.text):
        members["not_checked"] = unread
    return members


def _fault(asked: Asked, query: Expansion, finding: Finding) -> Fault:
    line, column = query.place(finding.start)
    fault = Fault(
        rule=finding.rule,
        severity=finding.severity,
        line=line,
        column=column,
        # Its words quote labels of the graph.
        detail=asked.terms.text(finding.words, ["the check, quoting the graph"]),
    )
    if not finding.repairs:
        return fault
    whole = finding.repairs[0].apply(query.text)[query.shifts[0][1] :]
    return fault.model_copy(update={"repaired": asked.terms.text(whole, ["the check"])})
