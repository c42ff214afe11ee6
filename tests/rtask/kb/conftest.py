"""Graphs that the tests of the knowledge base share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import rtask
from rtask.knowledge_base import KnowledgeBase
from tests.rtask.kb.numbered_things import fill


@pytest.fixture
def memory() -> Iterator[KnowledgeBase]:
    """Return a graph in memory with numbered things."""
    with rtask.open(":memory:", reason=False, ontologies=False) as opened:
        fill(opened)
        yield opened
