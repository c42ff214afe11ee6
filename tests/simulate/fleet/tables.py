"""Tables of attempts that are made up, so that the best grasps are known."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from simulate.study.declaration import Results, Study

__all__ = ["figures_of", "product_with", "table_of"]

Summary = Callable[[Results, Mapping[str, Any]], dict[str, Any]]


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


def figures_of(
    table: Mapping[str, Any], study_of: Callable[[Path], Study], summary: Summary
) -> dict[str, Any]:
    """Run the study of a table here, and return its figures."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "attempts.json"
        path.write_text(json.dumps(table), encoding="utf-8")
        study = study_of(path)
        return summary(study.in_process(), study.settings)
