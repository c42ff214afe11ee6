"""The work of a robot, product by product."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["by_product"]


def by_product(encounters: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Join the encounters with the same product, such as one that was lost and found again."""
    joined: list[dict[str, Any]] = []
    first: dict[str, dict[str, Any]] = {}
    for encounter in encounters:
        earlier = first.get(encounter["product"]) if encounter["product"] else None
        if earlier is None:
            joined.append(dict(encounter))
            first[encounter["product"]] = joined[-1]
            continue
        if earlier["tries_to_success"] is None and encounter["tries_to_success"] is not None:
            earlier["tries_to_success"] = earlier["tries"] + encounter["tries_to_success"]
        earlier["tries"] += encounter["tries"]
        earlier["held"] |= encounter["held"]
        earlier["placed"] |= encounter["placed"]
        earlier["attempts"] = [*earlier.get("attempts", ()), *encounter.get("attempts", ())]
        if encounter.get("right") is False:  # trials of single objects know no identities
            earlier["right"] = False
    return joined
