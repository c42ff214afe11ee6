"""The head of a knowledge base on a SPARQL server, and the request that replaces it.

The graph ``<base>graph/store`` holds the settings of the knowledge base, its head and the record of
each commit. It is not in the catalogue and not part of the union.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC
from functools import partial
from typing import Any

from pyoxigraph import Literal, NamedNode, Quad

from rtask.errors import (
    CallFailedError,
    QuerySyntaxError,
    QueryTimeout,
    RemoteUnavailableError,
    RtaskError,
    StoreFormatError,
    VersionConflictError,
)
from rtask.kb.store.writes import Writes
from rtask.remote.claim import Claim, server_time
from rtask.remote.dialect import Dialect
from rtask.remote.endpoints import Endpoints

__all__ = ["Head", "HeadGraph"]

_log = logging.getLogger(__name__)
_HEAD = "<urn:rtask:store:head>"
_STAGED = "<urn:rtask:store:staged>"
_STALE = "<urn:rtask:store:stale>"
_RECORD = "<urn:rtask:store:record>"
_TOKEN = "<urn:rtask:store:token>"
_PAUSE_S = 0.1
_PAUSES_S = (0.01, 0.03, 0.1, 0.3, 1.0)
_MAX_RECORD = 1 << 18
_RECORDS = 500
_STALE_S = 3_600.0
_PATIENCE_S, _PATIENCE_LARGE_S = 20, 600
_SURE_S = 10.0
"""A claim that is younger has not been taken for one of an ended process."""


@dataclass(frozen=True)
class Head:
    """The last commit: its number, and a token that tells who stored it."""

    seq: int
    token: str

    @classmethod
    def of(cls, term: Any) -> Head:
        """Read a head as it is stored."""
        number, _, token = str(getattr(term, "value", "")).partition(":")
        if not number.isdigit():
            raise StoreFormatError(f"the head of the store is damaged: {term}")
        return cls(int(number), token)

    def next(self, token: str, is_commit: bool = True) -> Head:
        """Return the head after a commit, or after a change without a number."""
        return Head(self.seq + is_commit, token)

    def __str__(self) -> str:
        return f'"{self.seq}:{self.token}"'


class HeadGraph:
    """The graph ``<base>graph/store`` of one knowledge base."""

    def __init__(self, endpoints: Endpoints, dialect: Dialect) -> None:
        self._endpoints = endpoints
        self._dialect = dialect
        self._name = f"<{dialect.base}graph/store>"
        self._claim = Claim(endpoints, self._name)

    def pattern(self, value: str) -> str:
        """Return the pattern that matches the head."""
        return f"GRAPH {self._name} {{ {self._name} {_HEAD} {value} }}"

    def read(self) -> Head:
        """Return the head.

        Raises
        ------
        StoreFormatError
            There is none, or more than one.
        """
        for pause in _PAUSES_S:
            rows = self._endpoints.rows(f"SELECT ?h {{ {self.pattern('?h')} }}")
            if len(rows) == 1 and rows[0][0] is not None:
                break
            time.sleep(pause)  # some servers show a commit of others while it is being stored
        else:
            raise StoreFormatError(
                f"{self._endpoints} holds {len(rows)} heads in {self._name}, one is expected; "
                "was the store emptied or restored while it was in use?"
            )
        return Head.of(rows[0][0])

    # Records

    def records(self, after: int, upto: int) -> Iterator[tuple[int, str]]:
        """Yield the numbers and records of the commits after one, in order.

        The records of very large commits are not kept.
        """
        for start in range(after + 1, upto + 1, _RECORDS):
            numbers = range(start, min(start + _RECORDS, upto + 1))
            values = " ".join(map(self._commit, numbers))
            rows = self._endpoints.rows(
                f"SELECT ?n ?r {{ VALUES ?n {{ {values} }} "
                f"GRAPH {self._name} {{ ?n {_RECORD} ?r }} }}"
            )
            yield from sorted(
                (int(name.value.rpartition("/")[2]), text.value) for name, text in rows
            )

    def token(self, seq: int) -> str | None:
        """Return the token of a commit, by which it differs from another one of its number."""
        rows = self._endpoints.rows(
            f"SELECT ?t {{ GRAPH {self._name} {{ {self._commit(seq)} {_TOKEN} ?t }} }}"
        )
        return rows[0][0].value if len(rows) == 1 else None

    def _commit(self, seq: int) -> str:
        return f"<{self._dialect.base}activity/{seq}>"

    # Commits

    def replace(self, old: Head, new: Head, writes: Writes, record: str | None) -> None:
        """Store changes and replace the head, if it is still the old one.

        Raises
        ------
        VersionConflictError
            It is another one; nothing was stored.
        RemoteUnavailableError
            The server does not answer; see :meth:`rtask.remote.store.RemoteStore.apply`.
        """
        # One request is atomic; what is too large for one is staged first and moved by one.
        size = self._dialect.abilities.statements
        if len(writes.removed) + len(writes.added) <= size:
            self._send(partial(self._whole, old, new, writes, record), old, new)
            return
        staged = _Staged(self._endpoints, self._dialect, self._name, new.token)
        is_settled = True
        try:
            staged.store(writes)
            moving = partial(self._moving, old, new, record, staged)
            self._send(moving, old, new, _PATIENCE_LARGE_S, is_sure=False)
        except RemoteUnavailableError:
            is_settled = False  # the server may still be moving them; a later opening removes them
            raise
        finally:
            if is_settled:
                staged.remove()

    def _whole(self, old: Head, new: Head, writes: Writes, record: str | None) -> str:
        block = self._dialect.block
        return (
            f"DELETE {{ {self._condition(old)} {block(writes.removed)} }}\n"
            f"INSERT {{ {self._new(new, record)} {block(writes.added)} }}\n"
            f"WHERE {{ {self._condition(old)} }}"
        )

    def _condition(self, old: Head) -> str:
        """Return the patterns of the head and of the claim, which end with the commit."""
        return f"{self.pattern(str(old))} {self._claim.pattern}"

    def _new(self, new: Head, record: str | None) -> str:
        commit = self._commit(new.seq)
        text = self.pattern(str(new))
        record_lines = f'{commit} {_TOKEN} "{new.token}" .'
        if record is not None and len(record) <= _MAX_RECORD:
            record_lines += f" {commit} {_RECORD} {Literal(record)} ."
        return f"{text} GRAPH {self._name} {{ {record_lines} }}"

    def _moving(self, old: Head, new: Head, record: str | None, staged: _Staged) -> str:
        deleted, inserted, branches = staged.parts()
        # Without the marks, graphs that somebody has removed meanwhile would just be missing.
        return (
            f"DELETE {{ {self._condition(old)} {deleted} }}\n"
            f"INSERT {{ {self._new(new, record)} {inserted} }}\n"
            f"WHERE {{ {self._condition(old)} {staged.marks()} {{ {branches} }} }}"
        )

    def _send(
        self,
        text: Callable[[], str],
        old: Head,
        new: Head,
        patience_s: int = _PATIENCE_S,
        is_sure: bool = True,
    ) -> None:
        """Send a commit until it is known whether it is stored.

        Parameters
        ----------
        text
            Returns the request once the right to commit has been claimed.
        is_sure
            Whether a request that succeeds has stored the commit.
        """
        self._claim.take(
            self.pattern("?h"), lambda heads: self._require(old, self._only(heads)), patience_s
        )
        try:
            self._send_claimed(text(), old, new, is_sure)
        except RemoteUnavailableError:
            # Only that the claim lasts keeps another from committing on what may be stored yet.
            self._claim.keep()  # the server may still be storing it
            raise
        except BaseException:
            self._claim.release()
            raise

    def _only(self, terms: list[Any]) -> Head:
        """Return the head among the terms of an answer, or read it again."""
        return Head.of(terms[0]) if len(terms) == 1 else self.read()

    @staticmethod
    def _require(old: Head, actual: Head) -> None:
        if actual != old:
            raise VersionConflictError(
                f"somebody else committed: expected version {old.seq}, found {actual.seq}; "
                "read again and retry",
                expected=old.seq,
                found=actual.seq,
            )

    def _send_claimed(self, text: str, old: Head, new: Head, is_sure: bool) -> None:
        end = time.monotonic() + self._endpoints.connection.timeout_s
        while True:
            failure: RtaskError | None = None
            try:
                self._endpoints.update(text)
            except (RemoteUnavailableError, QueryTimeout, CallFailedError) as error:
                failure = error
            except QuerySyntaxError as error:
                # Some servers answer 400 to whatever goes wrong.
                failure = CallFailedError(f"the server refused a commit: {error}", status=400)
            # Others have not had the time to remove the claim, so that it was stored while it held.
            if failure is None and is_sure and self._claim.age_s < _SURE_S:
                return
            try:
                actual, token = self._after(new)
            except (RemoteUnavailableError, QueryTimeout) as error:
                failure = failure or error
            else:
                # The token shows that this very commit is stored, though its answer was lost.
                if token == new.token:
                    return
                self._require(old, actual)
                if isinstance(failure, CallFailedError):
                    raise failure
                if failure is None and not is_sure:
                    raise CallFailedError(
                        f"what commit {new.seq} brings was removed from {self._endpoints} "
                        "before it was stored; nothing was stored; try again",
                        status=409,
                    )
            if time.monotonic() >= end:
                raise RemoteUnavailableError(
                    f"{self._endpoints} does not answer; whether commit {new.seq} is stored shows "
                    "when it does again"
                ) from failure
            _log.debug("commit %d is sent again: %s", new.seq, failure)
            time.sleep(_PAUSE_S)  # a server that restarts announces nothing

    def _after(self, new: Head) -> tuple[Head, str | None]:
        """Return the head, and the token of the commit with a number."""
        token = f"GRAPH {self._name} {{ {self._commit(new.seq)} {_TOKEN} ?t }}"
        rows = self._endpoints.rows(
            f"SELECT ?h ?t {{ {{ {self.pattern('?h')} }} UNION {{ {token} }} }}"
        )
        tokens = [t.value for _, t in rows if t is not None]
        head = self._only([h for h, _ in rows if h is not None])
        return head, new.token if new.token in tokens else None


class _Staged:
    """Statements of a large commit, stored in graphs of their own before the commit moves them."""

    def __init__(self, endpoints: Endpoints, dialect: Dialect, name: str, token: str) -> None:
        self._endpoints = endpoints
        self._dialect = dialect
        self._name = name
        self._start = f"{dialect.base}graph/staged/{token}/"
        self._targets: list[tuple[bool, str, str]] = []

    def store(self, writes: Writes) -> None:
        """Send the statements in pieces."""
        for adds, quads in ((False, writes.removed), (True, writes.added)):
            by_graph: dict[Any, list[Quad]] = {}
            for quad in quads:
                by_graph.setdefault(quad.graph_name, []).append(quad)
            for graph, group in by_graph.items():
                stage = NamedNode(f"{self._start}{len(self._targets)}")
                self._targets.append((adds, self._dialect.graph(graph), str(stage)))
                # By the server's clock: those of writers may be years apart.
                now = "BIND(STR(NOW()) AS ?when)"
                mark = f"GRAPH {self._name} {{ {stage} {_STAGED} ?when }}"
                self._endpoints.update(f"INSERT {{ {mark} }} WHERE {{ {now} }}")
                size = self._dialect.abilities.statements
                for at in range(0, len(group), size):
                    piece = group[at : at + size]
                    moved = (Quad(q.subject, q.predicate, q.object, stage) for q in piece)
                    self._endpoints.update(f"INSERT DATA {{ {self._dialect.block(moved)} }}")

    def marks(self) -> str:
        """Return the pattern of the notes that all the graphs are there."""
        notes = (f"{s} {_STAGED} ?when{n}" for n, (_, _, s) in enumerate(self._targets))
        return f"GRAPH {self._name} {{ {' . '.join(notes)} }}"

    def parts(self) -> tuple[str, str, str]:
        """Return what to delete and to insert, and the branches that bind their variables."""
        texts: tuple[list[str], list[str]] = ([], [])
        branches = []
        for number, (adds, target, stage) in enumerate(self._targets):
            triple = f"?s{number} ?p{number} ?o{number}"
            texts[adds].append(f"GRAPH {target} {{ {triple} }}" if target else f"{triple} .")
            branches.append(f"{{ GRAPH {stage} {{ {triple} }} }}")
        return " ".join(texts[False]), " ".join(texts[True]), " UNION ".join(branches)

    def remove(self) -> None:
        """Remove the graphs again."""
        remove_staged(self._endpoints, self._name, (stage for _, _, stage in self._targets))


def remove_staged(endpoints: Endpoints, name: str, stages: Iterable[str]) -> None:
    """Remove graphs of commits that have ended."""
    for stage in stages:
        try:
            endpoints.update(f"DROP SILENT GRAPH {stage}")
            endpoints.update(f"DELETE WHERE {{ GRAPH {name} {{ {stage} ?note ?when }} }}")
        except RtaskError as error:
            _log.warning("%s is left behind until the next opening: %s", stage, error)


def remove_left_behind(endpoints: Endpoints, name: str) -> None:
    """Remove the graphs of large commits that never ended.

    One whose time lies an hour ahead was noted before the server's clock was set back.
    """
    noted = f"GRAPH {name} {{ ?g ?p ?when }} FILTER(?p IN ({_STAGED}, {_STALE}))"
    rows = endpoints.rows(f"SELECT ?g ?when (STR(NOW()) AS ?now) {{ {noted} }}")
    old = [str(g) for g, when, now in rows if abs(_age_s(when.value, now.value)) > _STALE_S]
    for stage in old:
        # If the commit is stored all the same, its pattern finds no note and it changes nothing.
        mark = f"GRAPH {name} {{ {stage} {_STAGED} ?when }}"
        over = f"GRAPH {name} {{ {stage} {_STALE} ?when }}"
        endpoints.update(f"DELETE {{ {mark} }} INSERT {{ {over} }} WHERE {{ {mark} }}")
    remove_staged(endpoints, name, old)


def _age_s(noted: str, now: str) -> float:
    """Return how long ago a time was noted, s; earlier versions noted seconds since 1970.

    >>> _age_s("2026-11-30T10:00:00.5Z", "2026-11-30T10:01:00Z")
    59.5
    >>> _age_s("1700000000", "2023-11-14T22:13:30Z")
    10.0
    """
    if noted.isdecimal():
        return server_time(now).replace(tzinfo=UTC).timestamp() - int(noted)
    try:
        return (server_time(now) - server_time(noted)).total_seconds()
    except ValueError:  # written by somebody else
        return 0.0
