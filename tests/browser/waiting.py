"""Waits for pages to show what a click brings: a click returns before its answer is drawn."""

from __future__ import annotations

from typing import Any

__all__ = ["has_count"]

_WAIT_MS = 60_000


def has_count(locator: Any, count: int) -> None:
    """Wait until a locator finds so many elements."""
    from playwright.sync_api import expect

    expect(locator).to_have_count(count, timeout=_WAIT_MS)
