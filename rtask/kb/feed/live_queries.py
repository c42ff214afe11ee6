"""Live queries: SELECT queries whose subscribers are notified of rows that appear or disappear.

A query is evaluated again when a commit touches a predicate that it may read; its subscribers
receive the difference from the previous answer.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from rtask.errors import QuerySyntaxError, RtaskError, TooLargeError
from rtask.kb.commit.commit import Change
from rtask.kb.feed.subscriptions import QUEUE, Subscription
from rtask.rdf.terms import RDF_TYPE, NamedNode, Term
from rtask.sparql.lexer import body_start, tokenise
from rtask.sparql.results import Solutions
from rtask.sparql.templates import resolve

__all__ = ["LiveQueries", "RowChange", "predicates_of"]

_log = logging.getLogger(__name__)
MAX_ROWS = 1_000
_Row = tuple[Term | None, ...]


@dataclass(frozen=True)
class RowChange:
    """Difference between two answers of a live query.

    Parameters
    ----------
    seq
        Number of the last commit taken into account.
    added, removed
        Rows; in the first change, all rows are added ones.
    """

    seq: int
    added: Solutions
    removed: Solutions


def predicates_of(text: str) -> frozenset[NamedNode] | None:
    """Return every IRI that a query names, or ``None`` if it may read any predicate.

    Every IRI is treated as a predicate, since an unnecessary evaluation does no harm. A variable
    predicate, a negated property set or ``DESCRIBE`` may read any predicate.

    >>> sorted(p.value for p in predicates_of("SELECT * { ?s <urn:p>/<urn:q> <urn:o> }"))
    ['urn:o', 'urn:p', 'urn:q']
    >>> predicates_of("SELECT * { ?s ?p 1 }") is None
    True
    """
    tokens = tokenise(text)
    start = body_start(tokens)
    prologue = text[: tokens[start].start]
    named: set[NamedNode] = set()
    place = 0  # position of the next term in its triple: subject, predicate, object
    parens = depth = 0
    for at in range(start, len(tokens)):
        kind, mark, _, _ = tokens[at]
        if kind in ("iri", "name"):
            named.add(resolve(mark, prologue, None))
        elif kind == "word" and mark == "a":
            named.add(RDF_TYPE)
        if kind == "mark":
            if mark == "!" and place == 1:
                return None
            depth += (mark == "{") - (mark == "}")
            parens += (mark == "(") - (mark == ")")
            place = _place_after(mark, place)
        elif kind == "word" and mark != "a":
            if mark.upper() == "FILTER" and tokens[at + 1].kind in ("iri", "name"):
                return None
            place = 0
        elif depth and not parens:
            if kind == "variable" and place == 1:
                return None
            place = min(2, place + 1)
    return frozenset(named)


def _place_after(mark: str, place: int) -> int:
    if mark in ("{", "}", "."):
        return 0
    if mark in (";", "[", "]", "{|", "|}"):
        return 1
    return 2 if mark == ")" and place == 1 else place


class _LiveQuery:
    """A query, its current rows and its subscribers."""

    subscription: Subscription[RowChange]

    def __init__(self, ask: Callable[[], Solutions], reads: frozenset[NamedNode] | None) -> None:
        self.ask = ask
        self.reads = reads
        self.rows: Counter[_Row] = Counter()
        self.is_due = True
        self.is_new = True
        self.asking = threading.Lock()


class LiveQueries:
    """Re-evaluates the live queries of one knowledge base in a thread of its own.

    Parameters
    ----------
    last_seq
        Number of the last commit that was announced.
    """

    def __init__(self, last_seq: Callable[[], int], position: Callable[[int], str]) -> None:
        self._last_seq = last_seq
        self._position = position
        self._changed = threading.Condition()
        self._queries: list[_LiveQuery] = []
        self._thread: threading.Thread | None = None
        self._closed = False

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody follows the rows of a query."""
        return bool(self._queries)

    def announce(self, change: Change) -> None:
        """Mark the queries that a commit may affect."""
        if not self._queries:
            return
        parts = (change.added, change.removed, change.inferred_added, change.inferred_removed)
        touched = {quad.predicate for quads in parts for quad in quads}
        with self._changed:
            for query in self._queries:
                query.is_due |= query.reads is None or not touched.isdisjoint(query.reads)
            self._changed.notify()

    def add(
        self,
        text: str,
        ask: Callable[[], Solutions],
        on_ready: Callable[[], None] | None = None,
        size: int = QUEUE,
    ) -> Subscription[RowChange]:
        """Subscribe to a query; its current rows are the first change.

        Raises
        ------
        TooLargeError
            The answer has more than 1,000 rows.
        """
        query = _LiveQuery(ask, predicates_of(text))
        query.subscription = Subscription(lambda: self._remove(query), size=size, on_ready=on_ready)
        with self._changed:
            self._queries.append(query)
            query.is_due = False
        try:
            self._ask(query)
        except BaseException:
            self._remove(query)
            raise
        with self._changed:
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name="rtask-standing-queries", daemon=True
                )
                self._thread.start()
        return query.subscription

    def _remove(self, query: _LiveQuery) -> None:
        with self._changed:
            if query in self._queries:
                self._queries.remove(query)

    def _run(self) -> None:
        while True:
            with self._changed:
                due = [query for query in self._queries if query.is_due]
                if self._closed:
                    return
                if not due:
                    self._changed.wait()
                    continue
                for query in due:
                    query.is_due = False
            for query in due:
                try:
                    self._ask(query)
                except RtaskError as error:
                    query.subscription.fail(error)
                    self._remove(query)
                except Exception:  # noqa: BLE001 - one query must not end the others
                    _log.exception("a live query failed")
                    query.subscription.fail(RtaskError("the query failed"))
                    self._remove(query)

    def _ask(self, query: _LiveQuery) -> None:
        """Evaluate a query and put the difference from its rows so far."""
        with query.asking:  # the subscriber's thread asks first, and this one's after a commit
            self._put_difference(query)

    def _put_difference(self, query: _LiveQuery) -> None:
        seq = self._last_seq()
        answer = query.ask()
        if len(answer) > MAX_ROWS:
            raise TooLargeError(
                f"the answer of a live query may have {MAX_ROWS} rows; add a LIMIT",
                limit="rows",
                value=len(answer),
                allowed=MAX_ROWS,
            )
        rows: Counter[_Row] = Counter(tuple(row) for row in answer)
        added, removed = rows - query.rows, query.rows - rows
        query.rows = rows
        if added or removed or query.is_new:
            query.is_new = False
            change = RowChange(
                seq,
                Solutions(answer.variables, list(added.elements())),
                Solutions(answer.variables, list(removed.elements())),
            )
            query.subscription.put(change, seq, self._position(seq))

    def close(self) -> None:
        """End the thread and every subscription."""
        with self._changed:
            self._closed = True
            standing = list(self._queries)
            self._changed.notify()
        for query in standing:
            query.subscription.close()
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=10.0)


def require_select(text: str) -> None:
    """Raise unless a text is a SELECT."""
    tokens = tokenise(text)
    if not tokens[body_start(tokens)].is_word("SELECT"):
        raise QuerySyntaxError("a live query must be a SELECT")
