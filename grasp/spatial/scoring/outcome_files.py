"""Files of a hand's own outcomes, one JSON object a line, from which its promises grow."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from grasp.spatial.scoring.promises import FACTORY, Outcome

__all__ = ["read_outcomes"]

_OUTCOMES = {"lifted": "lift", "carried": "carry"}
_SCORES = (*FACTORY, "load", "taper")
_MAX_BYTES = 64 * 2**20


def read_outcomes(path: Path) -> list[Outcome]:
    """Return the outcomes of a file, for :meth:`grasp.spatial.scoring.promises.Promises.after`.

    Each line has the scores of a grasp that was carried out, ``lift``, ``carry``, ``load`` and
    ``taper``, as ``rtask grasp space --json`` prints them, and whether it ``lifted`` and
    ``carried`` the object: true or false, or left out where that is not known. Anything else on a
    line is left alone.

    Raises
    ------
    ValueError
        Names the line, and what is wrong with it.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "own.jsonl")
    ...     _ = path.write_text('{"lift": 0.8, "load": 0.3, "lifted": true}\\n')
    ...     read_outcomes(path)
    [({'lift': 0.8, 'load': 0.3}, {'lift': True})]
    """
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path} is larger than {_MAX_BYTES // 2**20} MiB")
    outcomes = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if line.strip():
            try:
                outcomes.append(_outcome(json.loads(line)))
            except (ValueError, RecursionError) as error:
                raise ValueError(f"{path}, line {number}: {error}") from error
    if not outcomes:
        raise ValueError(f"{path} has no outcome")
    return outcomes


def _outcome(row: Any) -> Outcome:
    if not isinstance(row, Mapping):
        raise ValueError("expected an object with lift, carry, load, lifted, carried")
    scores = {name: _share(name, row[name]) for name in _SCORES if row.get(name) is not None}
    held = {}
    for word, score in _OUTCOMES.items():
        value = row.get(word)
        if value is None:
            continue
        if not isinstance(value, bool):
            raise ValueError(f"{word}: expected true or false, got {value!r}")
        if score not in scores:
            raise ValueError(f"{word} is told, but not the score {score} of the grasp")
        held[score] = value
    if not held:
        raise ValueError("neither lifted nor carried is told")
    return scores, held


def _share(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name}: expected a number, got {value!r}")
    most = 1.0 if name in FACTORY else float("inf")
    if not 0 <= value <= most or value == float("inf"):
        raise ValueError(f"{name}: expected 0 to {most:g}, got {value!r}")
    return float(value)
