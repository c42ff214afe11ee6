"""Tools that say why a statement holds, and when it came to hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Le
from pydantic import Field

from rtask.asking.decisions import explain as decide
from rtask.asking.tools.declaration import Asked, Paged, PagedAnswer, rest, tool
from rtask.asking.tools.values import Fact, Value
from rtask.errors import UsageError
from rtask.rdf.terms import NamedNode, TripleKey, triple_key
from rtask.wire.message import Answer
from rtask.wire.types import Text, Whole

if TYPE_CHECKING:
    from collections.abc import Iterator

    from reasoner import Proof
    from rtask.kb.feed.history import HistoryEntry

__all__ = ["explain", "history"]

BUDGET, MAX_BUDGET = 20_000, 200_000
MAX_COMMITS = 100
MAX_SHOWN = 4
_REASONER = ["the reasoner, quoting the graph"]


class Explain(Paged):
    """A statement in question."""

    s: Text
    """subject"""
    p: Text
    """property, or a"""
    o: Text
    """a term, a name in quotes or a literal"""
    budget: Annotated[Whole, Ge(1), Le(MAX_BUDGET)] = BUDGET
    """steps of the reasoner"""


class Step(Answer):
    """A statement in a proof; deeper ones are what it rests on."""

    depth: int
    rule: str
    fact: Fact


class Need(Answer):
    """What one rule lacks to derive the statement."""

    rule: str
    missing: list[Value]


class Explanation(PagedAnswer):
    """Why a statement holds or does not, or that the budget did not decide it."""

    verdict: str
    """holds, does not hold, or not decided"""
    proof: str
    steps: list[Step] = Field(default_factory=list)
    needs: list[Need] = Field(default_factory=list)
    unknown: list[str] = Field(default_factory=list)
    """terms that nothing mentions"""
    try_budget: int = 0


class History(Paged):
    """A term whose past is asked for."""

    term: Text
    at: Whole | None = None
    """number of a commit: what was stated then"""


class CommitEntry(Answer):
    """One commit: who changed how much, with the first statements added and removed."""

    commit: int
    time: str
    by: str
    note: Value | None
    added: int
    removed: int
    plus: list[Fact]
    minus: list[Fact]


class Past(PagedAnswer):
    """Commits about a term, newest first; or the statements about it after one."""

    term: str
    kept_from: int
    """commits before this one are not kept: what they changed is not known"""
    commits: list[CommitEntry] = Field(default_factory=list)
    facts: list[Fact] = Field(default_factory=list)


@tool(
    "Say why a statement holds or what it lacks; not decided is not no.",
    {"s": "kb:object/7", "p": "a", "o": "rt:Mug"},
    {"s": "kb:robot/nao", "p": "rt:canGrasp", "o": '"mug"'},
    entries=("steps", "needs"),
    source="reasoner",
)
def explain(asked: Asked, request: Explain) -> Explanation:
    """Return a proof step by step, or what is missing."""
    from reasoner import Proof, Undecided

    asked.work.report(0.1, "looking for a proof")
    triple = asked.statement(request.s, request.p, request.o)
    explanation = decide(asked.kb, triple, request.budget)
    members: dict[str, Any] = {}
    decision = explanation.decision
    if isinstance(decision, Proof):
        members["steps"] = list(_steps(asked, decision, 0))[request.offset :]
    elif isinstance(decision, Undecided):
        members["try_budget"] = min(decision.more, MAX_BUDGET)
    else:
        members["unknown"] = list(decision.unknown)
        members["needs"] = [_need(asked, need) for need in decision.needs][request.offset :]
    return Explanation(
        commit=explanation.commit,
        verdict=explanation.verdict,
        proof=asked.terms.proof(triple),
        **members,
    )


def _steps(asked: Asked, proof: Proof, depth: int) -> Iterator[Step]:
    triple: Any = proof.triple
    yield Step(depth=depth, rule=proof.rule, fact=asked.terms.fact(triple))
    for premise in proof.premises:
        yield from _steps(asked, premise, depth + 1)


def _need(asked: Asked, need: Any) -> Need:
    texts = need.missing or (need.condition,)
    return Need(rule=need.rule, missing=[asked.terms.text(text, _REASONER) for text in texts])


@tool(
    "List the commits about a term, newest first, or what was stated about it after one.",
    {"term": "kb:object/7"},
    {"term": "red mug", "at": 12},
    entries=("commits", "facts"),
)
def history(asked: Asked, request: History) -> Past:
    """Return who stated or withdrew what about a term, and when."""
    kb, term = asked.kb, asked.resource(request.term)
    commit = kb.seq
    end = request.offset + MAX_COMMITS
    name, kept_from = asked.terms.short(term), kb.feed.oldest_retained()
    if request.at is not None:
        triples = _stated_at(asked, term, request.at, commit)
        facts = [asked.terms.fact(item, about=term) for item in triples[request.offset : end]]
        more = rest(end, len(triples) - end)
        return Past(commit=commit, term=name, kept_from=kept_from, facts=facts, **more)
    entries = kb.history(term)[::-1]
    commits = [_entry(asked, term, entry) for entry in entries[request.offset : end]]
    more = rest(end, len(entries) - end)
    return Past(commit=commit, term=name, kept_from=kept_from, commits=commits, **more)


def _entry(asked: Asked, term: NamedNode, entry: HistoryEntry) -> CommitEntry:
    by = entry.agent or "the program"
    facts = asked.terms.fact
    return CommitEntry(
        commit=entry.seq,
        time=entry.time,
        by=by,
        note=asked.terms.text(entry.note, [by]) if entry.note else None,
        added=len(entry.added),
        removed=len(entry.removed),
        plus=[facts(triple_key(item), item.graph_name, term) for item in entry.added[:MAX_SHOWN]],
        minus=[
            facts(triple_key(item), item.graph_name, term) for item in entry.removed[:MAX_SHOWN]
        ],
    )


def _stated_at(asked: Asked, term: NamedNode, at: int, now: int) -> list[TripleKey]:
    """Return what was asserted about a term after a commit: later commits are undone.

    Raises
    ------
    UsageError
        There is no such commit.
    GoneError
        The commits after it are not kept.
    """
    kb = asked.kb
    if not 0 < at <= now:
        raise UsageError(f"at: expected the number of a commit from 1 to {now}, got {at}")
    kb.feed.require_retained(at)
    graphs = kb.graphs
    left_out = (graphs.inferred, graphs.meta, graphs.provenance, graphs.quarantine)
    quads = {quad for quad in kb.match(term) if quad.graph_name not in left_out}
    for entry in kb.history(term, since=at)[::-1]:
        quads = (quads - set(entry.added)) | set(entry.removed)
    return sorted({triple_key(quad) for quad in quads}, key=str)
