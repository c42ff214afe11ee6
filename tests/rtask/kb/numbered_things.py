"""A graph of things with a number each."""

from __future__ import annotations

from rtask.knowledge_base import KnowledgeBase

NUMBERED = 2_000


def fill(kb: KnowledgeBase, count: int = NUMBERED) -> None:
    """Add things with a number each."""
    with kb.transaction() as tx:
        for number in range(count):
            tx.add(f"urn:thing:{number}", "urn:number", number)
