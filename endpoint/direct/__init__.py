"""Answers to small requests, written by the server's protocol itself."""

from endpoint.direct.known import KnownQueries
from endpoint.direct.protocol import DirectProtocol

__all__ = ["DirectProtocol", "KnownQueries"]
