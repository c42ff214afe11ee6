"""Objects whose methods are those of a service, wherever it runs (Kehoe 2014, 5.6)."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rtask.errors import UnknownTermError, nearest
from rtask.services.definition import Method
from rtask.wire.message import Answer
from rtask.wire.openapi import type_in_words
from rtask.wire.ros import declared_types

__all__ = ["Offer", "Proxy", "offer_of", "offer_read"]

_POSE = "geometry_msgs/Pose"
_ARRAYS = ("float64[]", "geometry_msgs/Point[]")
_THREADS = 32
_PARALLEL = 8


@dataclass(frozen=True)
class Offer:
    """One method of a proxy.

    Parameters
    ----------
    name, doc
        Of the method.
    signature
        Its parameters.
    result
        Takes an answer and returns what the method returns.
    """

    name: str
    doc: str
    signature: inspect.Signature
    result: Callable[[Any], Any]


class Proxy:
    """The methods of a service, with their signatures and documentation.

    A method whose answer is one value returns that value; others return the answer. Numpy arrays
    and (4, 4) poses are taken and returned as such. A method that is called ``submit`` or ``map``
    takes the place of the attribute of that name.

    Parameters
    ----------
    name
        Exact name of the service.
    offers
        Its methods.
    caller
        Carries out a method with its arguments; may be called from several threads at once.

    Attributes
    ----------
    submit
        The same methods, each of which returns a :class:`concurrent.futures.Future` at once:
        ``proxy.submit.forward([0, 0, 0])``.
    map
        The same methods for many requests: ``proxy.map.forward(requests, parallel=8)``. A request
        is the first argument, or a dict of arguments. Answers have the order of the requests.
    """

    def __init__(
        self, name: str, offers: list[Offer], caller: Callable[[str, dict[str, Any]], Any]
    ) -> None:
        self.service = name
        self._names = [offer.name for offer in offers]
        methods = {offer.name: _bound(offer, caller) for offer in offers}
        self.submit = _Methods(self._unknown, {n: self._later(f) for n, f in methods.items()})
        self.map = _Methods(self._unknown, {n: _for_many(f) for n, f in methods.items()})
        vars(self).update(methods)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise self._unknown(name)

    def __repr__(self) -> str:
        return f"<{self.service}: {', '.join(self._names)}>"

    @cached_property
    def _threads(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(_THREADS, thread_name_prefix=self.service)

    def _later(self, function: Callable[..., Any]) -> Callable[..., Future[Any]]:
        @functools.wraps(function)
        def submit(*args: Any, **kwargs: Any) -> Future[Any]:
            return self._threads.submit(function, *args, **kwargs)

        return submit

    def _unknown(self, name: str) -> UnknownTermError:
        return UnknownTermError(
            f"{self.service} has no method {name!r}{nearest(name, self._names)}"
        )


class _Methods:
    """The methods of a proxy, called in another way."""

    def __init__(
        self, unknown: Callable[[str], UnknownTermError], methods: Mapping[str, Callable[..., Any]]
    ) -> None:
        vars(self).update(methods)
        self._unknown = unknown

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise self._unknown(name)


def _for_many(function: Callable[..., Any]) -> Callable[..., list[Any]]:
    def carry_out(requests: Iterable[Any], *, parallel: int = _PARALLEL) -> list[Any]:
        def carry_out_single(request: Any) -> Any:
            return function(**request) if isinstance(request, Mapping) else function(request)

        with ThreadPoolExecutor(parallel) as threads:
            return list(threads.map(carry_out_single, requests))

    carry_out.__name__ = carry_out.__qualname__ = function.__name__
    carry_out.__doc__ = function.__doc__
    return carry_out


def _bound(offer: Offer, caller: Callable[[str, dict[str, Any]], Any]) -> Callable[..., Any]:
    def carry_out(*args: Any, **kwargs: Any) -> Any:
        given = dict(offer.signature.bind(*args, **kwargs).arguments)
        return offer.result(caller(offer.name, given))

    carry_out.__name__ = carry_out.__qualname__ = offer.name
    carry_out.__doc__ = offer.doc
    carry_out.__dict__["__signature__"] = offer.signature
    return carry_out


def offer_of(method: Method) -> Offer:
    """Return a method of a service of this process as a proxy offers it."""
    types = declared_types(method.request)
    parameters = [
        (name, field.is_required(), field.default, types[name])
        for name, field in method.request.model_fields.items()
    ]

    def result(answer: Answer) -> Any:
        return getattr(answer, method.output) if method.output else answer

    return Offer(
        method.name,
        _doc(method.summary, method.description),
        _signature(parameters),
        result,
    )


def offer_read(name: str, described: Mapping[str, Any]) -> Offer:
    """Return a method as a proxy offers it, from its description in JSON."""
    request = described["request"]
    required = request.get("required", ())
    parameters = [
        (own, own in required, schema.get("default"), type_in_words(schema) or Any)
        for own, schema in request.get("properties", {}).items()
    ]
    output, kind = described["output"], described["output_type"]

    def result(answer: Mapping[str, Any]) -> Any:
        return _value(answer[output], kind) if output else answer

    doc = _doc(described["summary"], described["description"])
    return Offer(name, doc, _signature(parameters), result)


def _doc(summary: str, description: str) -> str:
    return f"{summary}.\n\n{description}".strip()


def _signature(parameters: list[tuple[str, bool, Any, Any]]) -> inspect.Signature:
    # Python wants what may be left out at the end.
    ordered = sorted(parameters, key=lambda parameter: not parameter[1])
    return inspect.Signature(
        [
            inspect.Parameter(
                name,
                inspect.Parameter.POSITIONAL_OR_KEYWORD,
                default=inspect.Parameter.empty if is_required else default,
                annotation=annotation,
            )
            for name, is_required, default, annotation in ordered
        ]
    )


def _value(sent: Any, kind: str) -> Any:
    """Return a value of JSON as the service returned it, by its ROS type."""
    if kind == _POSE:
        from grasp.messages import matrix_from_message

        return matrix_from_message(sent)
    return np.asarray(sent, dtype=np.float64) if kind in _ARRAYS else sent
