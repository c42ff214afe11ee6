"""WHERE parts of updates, tried in a reader first.

An update holds the writers' lock while it evaluates its WHERE parts, and nothing in this process
can be stopped. So each WHERE that does not look quick is evaluated by a reader before, which is
killed when it takes too long; only then is the update carried out.
"""

from __future__ import annotations

import time

from endpoint.http.messages import RefusedError
from endpoint.sparql.quick_queries import is_point
from endpoint.sparql.request import UpdateRequest
from rtask.errors import QueryTimeout, RtaskError
from rtask.knowledge_base import KnowledgeBase
from rtask.sparql.results import Solutions
from rtask.sparql.service import without_services
from rtask.sparql.templates import resolve
from rtask.sparql.update_outline import Operation, Update, read_update

MAX_SOLUTIONS = 1_000_000
_MAX_FRESH_TOKENS = 3_000


def try_where(kb: KnowledgeBase, update: UpdateRequest, text: str, seconds: float) -> None:
    """Evaluate what an update will evaluate, where that can be stopped.

    Parameters
    ----------
    text
        The update, without SERVICE.
    seconds
        For all WHERE parts together.

    Raises
    ------
    RefusedError
        504 if it takes longer; 400 if there are too many solutions, or if a long WHERE would read
        what the same request writes, which no reader can try.
    """
    if "WHERE" not in text.upper() or not kb.readers.possible:
        return
    outline = read_update(text)
    deadline = time.monotonic() + seconds
    fresh = 0
    for operation in outline.operations:
        if operation.kind in ("INSERT DATA", "DELETE DATA"):
            block = operation.insert or operation.delete
            fresh += block.end - block.start if block else 0
        if operation.where is None:
            continue
        where = without_services(outline.source(operation.where))
        if is_point(f"{operation.prologue}SELECT * WHERE {where}"):
            continue
        if fresh > _MAX_FRESH_TOKENS:
            raise RefusedError(
                400,
                "query-too-complex",
                "a long WHERE behind much data in one request; send the data first, then this",
            )
        _try(kb, update, outline, operation, where, deadline - time.monotonic(), seconds)


def _try(
    kb: KnowledgeBase,
    update: UpdateRequest,
    outline: Update,
    operation: Operation,
    where: str,
    left: float,
    seconds: float,
) -> None:
    default = [_iri(name, operation, update) for name in operation.using] or list(update.using)
    named = [_iri(n, operation, update) for n in operation.using_named] or list(update.using_named)
    if not (default or named) and operation.with_graph:
        default = [_iri(operation.with_graph, operation, update)]
    query = f"{operation.prologue}SELECT (COUNT(*) AS ?n) WHERE {where}"
    try:
        found = kb.query(
            query,
            default_graphs=default or None,
            named_graphs=named or None,
            base=update.base or None,
            timeout_s=max(0.001, left),
        )
    except QueryTimeout:
        raise RefusedError(
            504,
            "query-timeout",
            f"the WHERE parts of this update take longer than {seconds:g} s; nothing was stored",
            limit=seconds,
        ) from None
    except RtaskError:
        return  # what is wrong with it is said where it is carried out
    count = found[0].value("n") if isinstance(found, Solutions) and len(found) else 0
    if isinstance(count, int) and count > MAX_SOLUTIONS:
        raise RefusedError(
            400,
            "query-too-complex",
            f"a WHERE with {count} solutions, at most {MAX_SOLUTIONS}; split the update",
            limit=MAX_SOLUTIONS,
        )


def _iri(name: str, operation: Operation, update: UpdateRequest) -> str:
    return resolve(name, operation.prologue, update.base or None).value
