"""Trial of an update's WHERE part in a reader process, which can be killed.

Where readers cannot evaluate whole updates (:mod:`rtask.kb.readers.updating`), because the store is
too large to be copied, an update is evaluated in this process, which nothing can stop. So its WHERE
is evaluated by a reader before, which is killed when it takes too long; an update whose WHERE reads
what the same request writes cannot be tried that way and is refused.
"""

from __future__ import annotations

from endpoint.http.messages import RefusedError
from endpoint.served import ServedGraph
from endpoint.sparql.request import UpdateRequest
from rtask.errors import QueryTimeout, RtaskError
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.readers.updating import needs_reader
from rtask.sparql.results import Solutions
from rtask.sparql.service import without_services
from rtask.sparql.templates import resolve
from rtask.sparql.update_outline import Operation, read_update


def try_where(kb: ServedGraph, update: UpdateRequest, text: str, seconds: float) -> None:
    """Evaluate the WHERE part of an update where the evaluation can be stopped.

    Parameters
    ----------
    text
        The update, without SERVICE.
    seconds
        For the WHERE part.

    Raises
    ------
    RefusedError
        504 if it takes longer; 400 if there are too many solutions, or if other operations of the
        same request stand beside an operation that reads the store.
    """
    if not kb.readers.possible or not needs_reader(text):
        return
    outline = read_update(text)
    if len(outline.operations) > 1:
        raise RefusedError(
            400,
            "query-too-complex",
            "on a store of this size an operation that reads the store must stand alone in its "
            "request; send the operations one by one",
        )
    [operation] = outline.operations
    if operation.where is not None:
        where = without_services(outline.source(operation.where))
        _try(kb, update, operation, where, seconds)


def _try(
    kb: ServedGraph, update: UpdateRequest, operation: Operation, where: str, seconds: float
) -> None:
    default = [_iri(name, operation, update) for name in operation.using] or list(update.using)
    named = [_iri(n, operation, update) for n in operation.using_named] or list(update.using_named)
    if not (default or named) and operation.with_graph:
        default = [_iri(operation.with_graph, operation, update)]
    query = f"{operation.prologue}SELECT (COUNT(*) AS ?n) WHERE {where}"
    try:
        result = kb.query(
            query,
            default_graphs=default or None,
            named_graphs=named or None,
            base=update.base or None,
            timeout_s=seconds,
        )
    except QueryTimeout:
        raise RefusedError(
            504,
            "query-timeout",
            f"the WHERE part of this update takes longer than {seconds:g} s; nothing was stored",
            limit=seconds,
        ) from None
    except RtaskError:
        return  # what is wrong with it is said where it is carried out
    count = result[0].value("n") if isinstance(result, Solutions) and len(result) else 0
    allowed = UpdateLimits(seconds).solutions
    if isinstance(count, int) and count > allowed:
        raise RefusedError(
            400,
            "query-too-complex",
            f"a WHERE with {count} solutions, at most {allowed}; split the update",
            limit=allowed,
        )


def _iri(name: str, operation: Operation, update: UpdateRequest) -> str:
    return resolve(name, operation.prologue, update.base or None).value
