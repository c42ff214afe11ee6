"""Answers to small requests, written by the server's protocol itself."""

from endpoint.direct.head_queries import HeadQueries
from endpoint.direct.protocol import DirectProtocol

__all__ = ["DirectProtocol", "HeadQueries"]
