"""Rights to a dataset: its owner writes, and its readers read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access

__all__ = ["check_may_write", "may_read"]


def may_read(facts: Mapping[str, Any], access: Access | None) -> bool:
    """Whether a caller may read a dataset with these facts; those without readers are for all."""
    if facts["readers"] is None or access is None or access.role == "admin":
        return True
    return access.agent is not None and access.agent in (*facts["readers"], facts["owner"])


def check_may_write(name: str, facts: Mapping[str, Any], access: Access | None) -> None:
    """Raise ForbiddenError if a caller may not write to a dataset with these facts."""
    owner = facts["owner"]
    if access is None or access.role in ("admin", "anonymous"):
        return
    if access.role == "reader" or access.agent != owner:
        raise ForbiddenError(f"{name} belongs to {owner or 'the server'}; fork it to change it")
