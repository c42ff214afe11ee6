"""Look-ups answered in this process: the statements about one thing, straight from the store.

From a store in memory that takes less time than asking another process. From a store on disk it
takes more, for the readers have a copy in memory; it is the second choice there, when no reader is
free. Look-ups run on the server's event loop, so they are bounded twice: the form of the query
makes its cost proportional to the statements about one subject, and it is aborted when these are
many.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from typing import Any

from pyoxigraph import QueryResultsFormat

from endpoint.http.messages import Response
from endpoint.served import ServedGraph
from endpoint.sparql import negotiation
from endpoint.sparql.answers import Question
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.xml_text import serialize

BUDGET_S = 0.005
MAX_BYTES = 64 << 10
_MAX_SLOW = 1_000
_FORMATS = {
    media_type: QueryResultsFormat.from_media_type(media_type)
    for media_type in negotiation.SOLUTION_TYPES
}


class _EnoughError(Exception):
    """The answer exceeds what may be answered here."""


class _Sink:
    """Collects an answer while it is small and quick."""

    def __init__(self, until: float) -> None:
        self.pieces: list[bytes] = []
        self._until = until
        self._size = 0

    def write(self, data: bytes) -> int:
        """Add a piece."""
        self._size += len(data)
        if self._size > MAX_BYTES or time.thread_time() > self._until:
            raise _EnoughError
        self.pieces.append(data)
        return len(data)

    def flush(self) -> None:
        """Do nothing: no data is buffered."""


class Lookups:
    """Answers look-ups in one knowledge base.

    Parameters
    ----------
    kb
        The knowledge base.
    """

    def __init__(self, kb: ServedGraph) -> None:
        self._store = kb.store if isinstance(kb, KnowledgeBase) and kb.readers.possible else None
        self.in_memory = kb.folder is None
        self._slow: OrderedDict[str, None] = OrderedDict()

    def try_now(self, question: Question) -> Response | None:
        """Return the answer to a look-up; none if a reader must answer it.

        Parameters
        ----------
        question
            A query accepted by :func:`rtask.sparql.query_cost.is_lookup`.
        """
        text = question.query.text
        form = _FORMATS.get(question.media_type)
        if self._store is None or form is None or text in self._slow:
            return None
        started = time.thread_time()  # of this thread: the work of others does not count
        sink: Any = _Sink(started + BUDGET_S)
        try:
            with self._store.complete_now() as is_complete:
                if not is_complete:
                    return None
                answer: Any = self._store.query(text, base_iri=question.query.base)
            serialize(answer, sink, form)
        except (_EnoughError, SyntaxError, ValueError, RuntimeError, OSError):
            self._remember_slow(text)
            return None
        if time.thread_time() - started > BUDGET_S:
            self._remember_slow(text)
        body = b"".join(sink.pieces)
        content_type = negotiation.content_type(question.media_type)
        return Response(200, body, content_type, question.headers)

    def _remember_slow(self, text: str) -> None:
        self._slow[text] = None
        if len(self._slow) > _MAX_SLOW:
            self._slow.popitem(last=False)
