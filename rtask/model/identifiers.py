"""IRIs for new objects."""

from __future__ import annotations

import os
import re
import time

__all__ = ["mint"]


def mint(base: str, name: str) -> str:
    """Return a fresh IRI that says of which class the object is.

    >>> mint("urn:lab/", "GraspAttempt").startswith("urn:lab/grasp-attempt/")
    True
    """
    return f"{base}{_kind(name)}/{_uuid7()}"


def _kind(name: str) -> str:
    """Return the part of an IRI that names a kind: ``GraspAttempt`` is ``grasp-attempt``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name).lower()


def _uuid7() -> str:
    """Return a random identifier that sorts by time (RFC 9562, 5.7)."""
    number = (time.time_ns() // 1_000_000) << 80 | int.from_bytes(os.urandom(10), "big")
    number = number & ~(0xF << 76) | 7 << 76
    number = number & ~(0x3 << 62) | 2 << 62
    text = f"{number:032x}"
    return "-".join((text[:8], text[8:12], text[12:16], text[16:20], text[20:]))
