"""Page about speed: figures that ship with the release, each beside a peer's."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

from endpoint.pages.render import Model, page

__all__ = ["figures"]

_FILE = Path(__file__).parent / "benchmarks.toml"


@page("/benchmarks", "benchmarks.html")
def benchmarks() -> Model:
    """Return the figures by section, with the machine, the load and the command of each."""
    results = figures()
    sections: dict[str, list[Model]] = {}
    for row in results["row"]:
        shown = {**row, "title": row.get("title", row["what"]), "words": _words(row["ratio"])}
        sections.setdefault(row["section"], []).append(shown)
    return {"machine": results["machine"], "recorded": results["recorded"], "sections": sections}


@cache
def figures() -> Model:
    """Return what the file of figures holds; ``docs/benchmarks/`` says how each was taken."""
    return tomllib.loads(_FILE.read_text(encoding="utf-8"))


def _words(ratio: float) -> str:
    """Say how a figure compares.

    Examples
    --------
    >>> _words(7.6), _words(0.1), _words(0.99), _words(162)
    ('7.6 times as fast', '10 times slower', 'the same within 5 %', '162 times as fast')
    """
    if abs(ratio - 1) < 0.05:
        return "the same within 5 %"
    times = ratio if ratio > 1 else 1 / ratio
    return f"{times:.3g} times " + ("as fast" if ratio > 1 else "slower")
