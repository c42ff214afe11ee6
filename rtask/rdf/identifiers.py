"""New identifiers: time-ordered UUIDs and IRIs made from them."""

from __future__ import annotations

import os
import re
import time
import uuid

__all__ = ["mint", "uuid7"]


def uuid7() -> uuid.UUID:
    """Return a UUID that sorts by creation time (RFC 9562, 5.7).

    >>> uuid7().version
    7
    """
    number = (time.time_ns() // 1_000_000) << 80 | int.from_bytes(os.urandom(10), "big")
    number = number & ~(0xF << 76) | 7 << 76
    number = number & ~(0x3 << 62) | 2 << 62
    return uuid.UUID(int=number)


def mint(base: str, name: str) -> str:
    """Return a new IRI whose local name begins with ``name``.

    >>> mint("urn:lab/", "GraspAttempt").startswith("urn:lab/grasp-attempt/")
    True
    """
    kind = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name).lower()
    return f"{base}{kind}/{uuid7()}"
