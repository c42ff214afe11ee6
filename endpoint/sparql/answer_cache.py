"""Cache of small answers to queries, each valid until the next commit.

A request is looked up by everything of it on which the answer depends, as it was sent: address,
query string, body, Accept, Accept-Encoding and Host (relative IRIs), and by the graphs to which its
caller is limited: all other callers see the same statements. An answer is kept when its question
comes for the second time, because most questions come only once.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from endpoint.http.conditional import is_current, is_unsteady
from endpoint.http.encoding import encode_fields
from endpoint.http.messages import Request, Response
from endpoint.http.plan import Plan
from endpoint.monitoring.metrics import Metrics
from endpoint.served import ServedGraph
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase

__all__ = ["AnswerCache", "CachedAnswer", "key_part"]

MAX_BYTES = 32 << 20
MAX_ANSWER_BYTES = 64 << 10
_MAX_ASKED = 10_000
_OVERHEAD_BYTES = 1_000
_HEADERS = ("content-type", "accept", "accept-encoding")

Part = tuple[str, ...]
Key = tuple[str, str, bytes, Part]
Version = tuple[int, int]


@dataclass(frozen=True)
class CachedAnswer:
    """One answer, ready to be sent.

    Parameters
    ----------
    fields
        The header fields of the response, as sent.
    """

    plan: Plan
    response: Response
    fields: bytes
    etag: str
    size: int


class AnswerCache:
    """Answers to the queries of one server.

    Parameters
    ----------
    kb
        The graph; a graph stored elsewhere has no version, so its answers are not kept.
    metrics
        Counts how often an answer was found.
    enabled
        Whether to keep anything at all.

    Attributes
    ----------
    bytes
        Size of what is kept.
    """

    def __init__(self, kb: ServedGraph, metrics: Metrics, enabled: bool = True) -> None:
        self._kb = kb if enabled and isinstance(kb, KnowledgeBase) else None
        self._metrics = metrics
        self._lock = threading.Lock()
        self._version: Version = (-1, -1)
        self._entries: OrderedDict[Key, CachedAnswer] = OrderedDict()
        self._asked: OrderedDict[Key, None] = OrderedDict()
        self.bytes = 0

    def _current(self, kb: KnowledgeBase) -> Version:
        """Return the number of the last commit and that of the last change of the store.

        Both grow only after the readers know of a change, so an answer may be newer than the
        numbers it was evaluated under, but never older.
        """
        return kb.seq, kb.readers.changes

    def find(self, request: Request, access: Access) -> Plan | None:
        """Return the plan of a request whose answer is kept for callers of these rights."""
        # HEAD has no body to be kept.
        if self._kb is None or request.method == "HEAD":
            return None
        entry = self.lookup(_key(request, access))
        if entry is None:
            return None
        if is_current(request, entry.etag):
            return Plan.ready(Response(304, headers=(("ETag", entry.etag),)))
        return entry.plan

    def lookup(self, key: Key) -> CachedAnswer | None:
        """Return the answer that is kept for requests of a key."""
        kb = self._kb
        if kb is None:
            return None
        with self._lock:
            # Any commit may change any answer; to find out which is dearer than to ask again.
            if self._version != (version := self._current(kb)):
                self._entries.clear()
                self.bytes = 0
                self._version = version
            entry = self._entries.get(key)
        if entry is not None:
            self._metrics.count("rtask_answer_cache_total", outcome="hit")
        return entry

    def keeper(
        self, request: Request, access: Access, form: str, text: str, etag: str
    ) -> Callable[[Response], None] | None:
        """Return the function to call with the answer to a request; none if it is not to be kept.

        Call it before the query is evaluated.
        """
        if self._kb is None or request.method == "HEAD" or is_unsteady(text):
            return None
        return self.keeper_of(_key(request, access), form, text, etag)

    def keeper_of(
        self, key: Key, form: str, text: str, etag: str
    ) -> Callable[[Response], None] | None:
        """Do what :meth:`keeper` does, for a query whose answer is not different each time."""
        kb = self._kb
        if kb is None:
            return None
        self._metrics.count("rtask_answer_cache_total", outcome="miss")
        with self._lock:
            if key not in self._asked:
                self._asked[key] = None
                if len(self._asked) > _MAX_ASKED:
                    self._asked.popitem(last=False)
                return None
            self._asked.move_to_end(key)
        version = self._current(kb)

        def keep(response: Response) -> None:
            # Sent in pieces, it is in memory at no time as a whole.
            if response.status != 200 or response.chunks is not None:
                return
            # A commit came in between: the answer may be of before or of after it.
            if len(response.body) <= MAX_ANSWER_BYTES and self._current(kb) == version:
                plan = Plan(lambda: response, None, "loop", form, text)
                fields = encode_fields(response.header_list())
                self._keep(
                    key, version, CachedAnswer(plan, response, fields, etag, _size(key, response))
                )

        return keep

    def _keep(self, key: Key, version: Version, entry: CachedAnswer) -> None:
        with self._lock:
            # The same question may have been answered twice at once.
            if self._version != version or key in self._entries:
                return
            self._entries[key] = entry
            self.bytes += entry.size
            while self.bytes > MAX_BYTES:
                _, oldest = self._entries.popitem(last=False)
                self.bytes -= oldest.size

    def __len__(self) -> int:
        return len(self._entries)


def _key(request: Request, access: Access) -> Key:
    return request.raw_path, request.query_string, request.body, key_part(request, access)


def key_part(request: Request, access: Access) -> Part:
    """Return the part of a key that does not depend on the question."""
    headers = request.headers
    given = (headers.get(name, "") for name in _HEADERS)
    # All callers without such limits see the same statements and share their answers.
    if access.reads is None:
        return (request.method, request.site, *given)
    return (request.method, request.site, *given, *sorted(access.reads))


def _size(key: Key, response: Response) -> int:
    return len(response.body) + sum(map(len, key[:3])) + sum(map(len, key[3])) + _OVERHEAD_BYTES
