"""Declaration of an operation: one decorator on its handler.

The annotations of the handler name the classes of request and answer; everything else about both
follows from these classes.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Generic, TypeVar

from rtask.engine.context import SCOPES, Context
from rtask.engine.curation.merging import followed
from rtask.kb.commit.access import Access
from rtask.wire.effect import EFFECTS, Effect
from rtask.wire.message import Answer, Message, read

__all__ = ["Operation", "operation"]

Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Answer)
Handler = Callable[[Context, Q, Access], A]


@dataclass(frozen=True)
class Operation(Generic[Q, A]):
    """One operation; calling it calls its handler with a request that was checked before.

    Parameters
    ----------
    name
        On the wire, ``/rtask/<name>`` and ``/engine/<name>``.
    scope
        Scope that a caller needs.
    effect
        Its effect on the graph, whatever the request.
    summary
        One line.
    request, answer
        Their declarations.
    handler
        Takes the context, the checked request and the caller's rights.
    repeatable
        Whether a request that arrives twice is stored once; where a field is marked as its id
        (:class:`rtask.wire.request_id.StoredOnce`), provided that the request has one.
    deferrable
        Whether a robot may work on without the answer: its client keeps the request on disk until
        it is answered.
    """

    name: str
    scope: str
    effect: Effect
    summary: str
    request: type[Q]
    answer: type[A]
    handler: Handler[Q, A]
    repeatable: bool = False
    deferrable: bool = False

    def __call__(self, context: Context, request: Q, access: Access) -> A:
        return self.handler(context, request, access)

    def carry_out(self, context: Context, args: Mapping[str, Any], access: Access) -> A:
        """Check a request and answer it; the former IRIs of merged objects are accepted.

        Raises
        ------
        UsageError
            The request does not fit the declaration.
        """
        return self.answer_to(context, read(self.request, dict(args)), access)

    def answer_to(self, context: Context, request: Q, access: Access) -> A:
        """Answer a request that was checked before, as :meth:`carry_out` does."""
        return self.handler(context, followed(context.kb, request), access)


def operation(
    scope: str,
    effect: Effect,
    summary: str,
    *,
    repeatable: bool = False,
    deferrable: bool = False,
) -> Callable[[Handler[Q, A]], Operation[Q, A]]:
    """Declare a handler ``(context, request, access) -> answer`` as an operation of its name.

    Parameters
    ----------
    scope
        Scope that a caller needs: read, write or teach.
    effect
        The strongest effect on the graph that a request may have: reads, records or writes.
    summary
        One line, without a capital or a full stop.
    repeatable
        For what writes: whether a request that arrives twice is stored once.
    deferrable
        Whether a robot may work on without the answer; implies ``repeatable``, because a request
        that is kept for lack of an answer may have arrived.

    Raises
    ------
    TypeError
        The annotations do not name a request and an answer.
    ValueError
        No role holds the scope, or there is no such effect.

    Examples
    --------
    >>> class Greet(Message):
    ...     '''A greeting.'''
    ...     name: str
    >>> class Greeted(Answer):
    ...     '''What was said.'''
    ...     text: str
    >>> @operation("read", "reads", "greet somebody")
    ... def greet(context: Context, request: Greet, access: Access) -> Greeted:
    ...     return Greeted(text=f"hello {request.name}")
    >>> greet.name, greet.request.__name__, greet.answer.__name__
    ('greet', 'Greet', 'Greeted')
    """
    if not any(scope in scopes for scopes in SCOPES.values()):
        raise ValueError(f"no role holds the scope {scope!r}")
    if effect not in EFFECTS:
        raise ValueError(f"effect {effect!r}; expected one of {', '.join(EFFECTS)}")

    def declare(handler: Handler[Q, A]) -> Operation[Q, A]:
        # Handlers import the types of the context and of the caller for type checkers only.
        local_types = {"Context": Context, "Access": Access}
        hints = typing.get_type_hints(handler, localns=local_types)
        parameters = list(inspect.signature(handler).parameters)
        request = hints.get(parameters[1]) if len(parameters) == 3 else None
        answer = hints.get("return")
        for model, kind in ((request, Message), (answer, Answer)):
            if not (isinstance(model, type) and issubclass(model, kind)):
                name = getattr(handler, "__qualname__", repr(handler))
                raise TypeError(
                    f"{name}: expected (context: Context, request: a Message, access: Access) "
                    f"-> an Answer; {model!r} is not a subclass of {kind.__name__}"
                )
        assert isinstance(handler, FunctionType)
        assert isinstance(request, type)
        assert isinstance(answer, type)
        return Operation(
            handler.__name__,
            scope,
            effect,
            summary,
            request,
            answer,
            handler,
            repeatable=repeatable or deferrable or effect != "writes",
            deferrable=deferrable,
        )

    return declare
