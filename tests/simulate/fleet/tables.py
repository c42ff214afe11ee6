"""Tables of attempts that are made up, so that the best grasps are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = ["product_with", "table_of"]


def product_with(
    number: int, secret: int | None, slides: int = 7, kind: str = "bar"
) -> dict[str, Any]:
    """Return a product that one of several places holds (None = all); the middle looks best."""
    middle = slides // 2
    arms = [
        {
            "x": 0.015 * (k - middle), "y": 0.0, "z": 0.02, "theta": 1.57,
            "quality": 0.95 - 0.03 * abs(k - middle), "held": [secret in (k, None)] * 3,
        }
        for k in range(slides)
    ]  # fmt: skip
    return {
        "product": f"{kind}-{number}", "kind": kind, "size": [0.12, 0.03, 0.03], "arms": arms
    }  # fmt: skip


def table_of(secrets: Sequence[int | None]) -> dict[str, Any]:
    """Return a table with one product for each secret."""
    things = [product_with(k, secret) for k, secret in enumerate(secrets)]
    return {"format": 1, "settings": {"hand": "panda"}, "products": things}
