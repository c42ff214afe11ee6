"""Patterns that followers ask for, and commits as they are sent to them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, cast

from endpoint.routes.addresses import CHANGES
from rtask.asking.terms import Reader, Role, reader_of
from rtask.errors import UnknownTermError, UsageError
from rtask.kb.commit.commit import Change
from rtask.kb.feed.live_queries import RowChange
from rtask.kb.feed.subscriptions import Filter, Subscription
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import RDF_TYPE, NamedNode, stored
from rtask.sparql.results import Solutions

__all__ = [
    "Follower",
    "Pattern",
    "change_data",
    "event",
    "filter_of",
    "read_pattern",
    "rows_data",
    "version_of",
]

JsonObject = dict[str, Any]

MAX_PATTERNS = 100
MAX_QUADS = 1_000
NAMES = ("s", "p", "o", "graph", "class", "inferred")
_ROLES: dict[str, Role] = {
    "s": "subject", "p": "predicate", "o": "object", "graph": "subject", "cls": "subject",
}  # fmt: skip


@dataclass(frozen=True)
class Pattern:
    """One pattern of statements, as sent."""

    s: str = ""
    p: str = ""
    o: str = ""
    graph: str = ""
    cls: str = ""
    inferred: bool = True


def version_of(kb: KnowledgeBase) -> str:
    """Return the version announced last, so that following from it misses nothing."""
    return kb.feed.position(kb.feed.last_seq)


def read_pattern(given: Any) -> Pattern:
    """Parse a pattern; its terms are still texts.

    Raises
    ------
    UsageError
        Naming the field.
    """
    if not isinstance(given, dict):
        raise UsageError("a pattern is an object with s, p, o, graph, class and inferred")
    unknown = sorted(set(given) - set(NAMES))
    if unknown:
        raise UsageError(f"unknown field {unknown[0]!r} of a pattern; known: {', '.join(NAMES)}")
    texts: dict[str, str] = {}
    for name in NAMES[:-1]:
        value = given.get(name) or ""
        if not isinstance(value, str):
            raise UsageError(f"{name}: expected a term, as text")
        texts["cls" if name == "class" else name] = value.strip()
    inferred = given.get("inferred", True)
    if str(inferred).lower() not in ("true", "false", "1", "0"):
        raise UsageError("inferred: expected true or false")
    return Pattern(**texts, inferred=str(inferred).lower() in ("true", "1"))


def filter_of(pattern: Pattern, reader: Reader) -> Filter:
    """Return what the feed is asked for.

    Raises
    ------
    UsageError
        A value is not a term; the error names its field.
    UnknownTermError
        Nothing has the name that a value quotes.
    """
    terms: dict[str, Any] = {}
    for field in fields(Pattern)[:-1]:
        text = getattr(pattern, field.name)
        name = "class" if field.name == "cls" else field.name
        try:
            terms[field.name] = stored(reader.term(text, _ROLES[field.name])) if text else None
        except (UsageError, UnknownTermError) as error:
            raise type(error)(f"{name}: {error}") from None
    for name in ("p", "graph", "cls"):
        if terms[name] is not None and not isinstance(terms[name], NamedNode):
            raise UsageError(f"{'class' if name == 'cls' else name}: expected an IRI")
    return Filter(
        terms["s"], terms["p"], terms["o"], terms["graph"], terms["cls"], pattern.inferred
    )


class Follower:
    """Commits that fit any of some patterns.

    One pattern is looked up by the feed itself; of several, each commit is looked at here.

    Parameters
    ----------
    kb
        Whose commits.
    patterns
        None is every commit.
    since
        Version to begin after; :func:`version_of` gives that of now.

    Raises
    ------
    GoneError, EpochChangedError
        Commits after ``since`` are not kept, or were renumbered.
    """

    def __init__(
        self,
        kb: KnowledgeBase,
        patterns: list[Pattern],
        since: str,
        on_ready: Callable[[], None],
    ) -> None:
        self._kb = kb
        # An IRI may be followed before anything mentions it, whatever it begins with.
        reader = replace(reader_of(kb), is_used=lambda _: True)
        self._filters = [filter_of(pattern, reader) for pattern in patterns]
        if len(self._filters) == 1:
            (only,) = self._filters
            self._subscription: Subscription[Change] = kb.subscribe(
                only.subject, only.predicate, only.value, cast(Any, only.graph), cls=only.cls,
                inferred=only.inferred, since=since, on_ready=on_ready,
            )  # fmt: skip
            self._filters = []
        else:
            self._subscription = kb.subscribe(since=since, on_ready=on_ready)

    def drain(self, limit: int = 100) -> list[Change]:
        """Return what has come; empty only when nothing waits.

        Raises
        ------
        Lagged
            Too many commits were waiting.
        ClosedError
            The knowledge base was closed.
        """
        while True:
            changes = self._subscription.drain(limit)
            if not changes or not self._filters:
                return changes
            parts = [part for change in changes if (part := self._part(change)) is not None]
            if parts:
                return parts

    def _part(self, change: Change) -> Change | None:
        """Return the part of a commit that matches any of the patterns."""
        types = {
            (quad.subject, quad.object)
            for quad in (*change.added, *change.removed, *change.inferred_added)
            if quad.predicate == RDF_TYPE
        }

        def is_instance(subject: Any, cls: NamedNode) -> bool:
            return (subject, cls) in types or bool(self._kb.match(subject, RDF_TYPE, cls))

        applied = [f.applied(change, is_instance) for f in self._filters]
        parts = [part for part in applied if part is not None]
        if len(parts) < 2:
            return parts[0] if parts else None
        merged = {
            name: tuple(dict.fromkeys(quad for part in parts for quad in getattr(part, name)))
            for name in ("added", "removed", "inferred_added", "inferred_removed")
        }
        return Change(change.commit, change.agent, change.note, **merged)

    def close(self) -> None:
        """Stop following."""
        self._subscription.close()


def change_data(change: Change, limit: int | None = MAX_QUADS) -> JsonObject:
    """Return a commit as it is sent to followers, with terms in N-Triples syntax.

    Beyond ``limit`` statements it holds only counts, and an address for the whole commit.
    """
    commit = change.commit
    lists = (change.added, change.removed, change.inferred_added, change.inferred_removed)
    count = sum(map(len, lists))
    data: JsonObject = {
        "seq": commit.seq,
        "time": commit.time.isoformat(),
        "agent": change.agent or "",
        "activity": commit.activity.value if commit.activity else "",
        "note": change.note or "",
    }
    if limit is not None and count > limit:
        return {**data, "truncated": True, "statements": count, "whole": f"{CHANGES}/{commit.seq}"}
    added, removed, inferred_added, inferred_removed = map(_quads, lists)
    return {
        **data,
        "added": added,
        "removed": removed,
        "inferred": {"added": inferred_added, "removed": inferred_removed},
    }


def _quads(quads: Iterable[Any]) -> list[list[str]]:
    return [[str(q.subject), str(q.predicate), str(q.object), _graph(q.graph_name)] for q in quads]


def _graph(graph: Any) -> str:
    return str(graph) if isinstance(graph, NamedNode) else ""


def rows_data(change: RowChange) -> JsonObject:
    """Return how the rows of a live query changed."""
    return {"seq": change.seq, "added": _rows(change.added), "removed": _rows(change.removed)}


def _rows(solutions: Solutions) -> list[JsonObject]:
    return [
        {name: None if term is None else str(term) for name, term in row.items()}
        for row in (dict(zip(solutions.variables, row, strict=True)) for row in solutions)
    ]


def event(name: str, data: JsonObject, id_: str = "") -> bytes:
    """Return one server-sent event (HTML Standard, 9.2.6).

    Examples
    --------
    >>> event("bye", {}, "1:2")
    b'id: 1:2\\nevent: bye\\ndata: {}\\n\\n'
    """
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    start = f"id: {id_}\n" if id_ else ""
    # Half of a surrogate pair becomes what JSON writes for it.
    return f"{start}event: {name}\ndata: {text}\n\n".encode(errors="backslashreplace")
