"""What a line of the table of addresses says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from endpoint.routes.messages import Messages
from rtask.wire.effect import Effect, Source

__all__ = ["Declared", "Lane", "Match", "Right", "Route"]

Lane = Literal["stream", "work"]
"""``stream``: by an open connection; ``work``: at once, by a reader, or by a thread."""

Right = Literal[
    "public", "read", "write", "rules", "schema", "replicate", "token", "admin", "monitor"
]
"""What a caller needs. ``public``: nothing, and it is not identified. ``read``, ``write``,
``admin``: scopes of roles. ``rules``, ``schema``, ``replicate``: rights of tokens, which some roles
include. ``token``: any token. ``monitor``: ``admin``, or no token on the server's own machine.
"""

Declared = Literal["declared"]
"""Said by the operation, the method of a service, the tool, the collection or the text that a
request names.
"""


@dataclass(frozen=True)
class Route:
    """One address with some of its methods.

    Parameters
    ----------
    pattern
        As werkzeug reads it.
    methods
        HTTP methods; HEAD comes with GET, and OPTIONS with every address.
    right
        What a caller needs; checked before the handler is asked.
    effect
        What a request does to the graph.
    handler
        The part of the server that answers; a name in the router.
    messages
        What a request and its answers carry; None for addresses that OpenAPI does not describe,
        because they belong to protocols with descriptions of their own, or to operators.
    source
        What the answer is made from; followers pass on what they have not.
    lane
        How it is answered.
    limited
        Whether callers may use it that may read some graphs only; it then reads these alone.
    pages
        Methods by which a browser gets a page at this address instead.
    advice
        What to do instead of another method.
    """

    pattern: str
    methods: tuple[str, ...]
    right: Right | Declared
    effect: Effect | Declared
    handler: str
    messages: Messages | Declared | None = None
    source: Source | Declared = "graph"
    lane: Lane = "work"
    limited: bool = False
    pages: tuple[str, ...] = ()
    advice: str = ""


@dataclass(frozen=True)
class Match:
    """What the table says of an address.

    Parameters
    ----------
    routes
        All routes of its pattern; none where there is nothing.
    """

    routes: tuple[Route, ...]

    @property
    def allow(self) -> tuple[str, ...]:
        """Methods of the address, as ``Allow`` lists them."""
        methods = dict.fromkeys(method for route in self.routes for method in route.methods)
        return (*methods, "OPTIONS")

    def by(self, method: str) -> Route | None:
        """Return the route for a method, or None if the address does not take it."""
        return next((route for route in self.routes if method in route.methods), None)
