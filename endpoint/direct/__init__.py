"""Small queries answered by the server's protocol itself, without the ASGI application."""

from endpoint.direct.protocol import DirectProtocol
from endpoint.direct.queries import QuickQueries

__all__ = ["DirectProtocol", "QuickQueries"]
