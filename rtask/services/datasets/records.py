"""Files of records in datasets: JSON Lines whose records a key tells apart (Kehoe 2014, 5.5).

A dataset with a key merges its ``.jsonl`` files record by record, so that two robots that both
added outcomes to one file have no conflict. Merged files hold their records in the order of their
keys: whichever side is merged into the other, the same bytes come of it.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Callable, Mapping
from typing import Any, Literal

from rtask.errors import UsageError

__all__ = [
    "ENDING", "Records", "merge_records", "outliers", "read_records", "without", "write_records",
]  # fmt: skip

ENDING = ".jsonl"
_MAX_DEVIATIONS = 8.0
_MIN_VALUES = 8

Records = dict[str, dict[str, Any]]
"""Records by the JSON text of their keys."""
Choice = Literal["ours", "theirs"]


def read_records(data: bytes, key: str, path: str) -> Records:
    """Return the records of a file.

    Parameters
    ----------
    key
        Name of the field whose value tells records apart: a text or a whole number.
    path
        Of the file, for errors.

    Raises
    ------
    UsageError
        A line is no JSON object, has no key, or has that of an earlier line; with its number.

    Examples
    --------
    >>> read_records(b'{"id": "t1", "held": true}', "id", "outcomes.jsonl")
    {'"t1"': {'id': 't1', 'held': True}}
    """
    records: Records = {}
    for number, line in enumerate(data.splitlines(), 1):
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        try:
            record = json.loads(line)
        except (ValueError, RecursionError):
            raise UsageError(f"{where}: expected a record in JSON", field=path) from None
        value = record.get(key) if isinstance(record, dict) else None
        if not isinstance(value, str | int) or isinstance(value, bool):
            raise UsageError(
                f"{where}: expected an object whose {key!r} is a text or a whole number", field=path
            )
        name = json.dumps(value, ensure_ascii=False)
        if name in records:
            raise UsageError(f"{where}: another record has the {key} {name} already", field=path)
        records[name] = record
    return records


def write_records(records: Mapping[str, dict[str, Any]]) -> bytes:
    """Return the file of some records, in the order of their keys."""
    lines = [
        json.dumps(record, ensure_ascii=False, sort_keys=True) + "\n"
        for _, record in sorted(records.items())
    ]
    return "".join(lines).encode()


def without(data: bytes, key: str, path: str, where: Mapping[str, Any]) -> bytes | None:
    """Return a file without the records that have all of some values; none if it has none such.

    Examples
    --------
    >>> without(b'{"id": 1, "robot": "nao"}\\n{"id": 2}', "id", "a.jsonl", {"robot": "nao"})
    b'{"id": 2}\\n'
    """
    records = read_records(data, key, path)
    remaining = {
        name: record
        for name, record in records.items()
        if not all(field in record and record[field] == value for field, value in where.items())
    }
    return write_records(remaining) if len(remaining) < len(records) else None


def merge_records(
    base: Records, ours: Records, theirs: Records, choose: Callable[[str, str], Choice | None]
) -> Records:
    """Merge the records of two files with those of their common ancestor.

    Parameters
    ----------
    choose
        Called with the key and the kind of each conflict, ``one_key_two_values`` or
        ``changed_and_deleted``; says whose record counts, or nothing, which leaves ours.

    Examples
    --------
    >>> old, new, other = ({"id": 1, "kg": kg} for kg in (1, 2, 3))
    >>> merge_records({"1": old}, {"1": new}, {"1": old, "2": {"id": 2}}, lambda *_: None)
    {'1': {'id': 1, 'kg': 2}, '2': {'id': 2}}
    >>> merge_records({"1": old}, {"1": new}, {"1": other}, lambda *_: "theirs")
    {'1': {'id': 1, 'kg': 3}}
    """
    merged: Records = {}
    for name in sorted({*base, *ours, *theirs}):
        was, mine, other = base.get(name), ours.get(name), theirs.get(name)
        if mine == other or other == was:
            chosen = mine
        elif mine == was:
            chosen = other
        else:
            is_gone = mine is None or other is None
            kind = "changed_and_deleted" if is_gone else "one_key_two_values"
            chosen = other if choose(name, kind) == "theirs" else mine
        if chosen is not None:
            merged[name] = chosen
    return merged


def outliers(records: Records, new: Records) -> list[tuple[str, str, float]]:
    """Return key, field and value of the numbers among new records that are far from the others.

    They are further than eight median absolute deviations from the median of their field, which
    has a number in at least eight records. A robot that reports in mm among others that report
    in m is found by this; whether it is a mistake is for people to say.

    Parameters
    ----------
    records
        All records.
    new
        Those that are judged.

    Examples
    --------
    >>> many = {str(n): {"id": n, "width_m": 0.05 + 0.001 * n} for n in range(9)}
    >>> outliers({**many, "9": {"id": 9, "width_m": 55.0}}, {"9": {"id": 9, "width_m": 55.0}})
    [('9', 'width_m', 55.0)]
    """
    flagged: list[tuple[str, str, float]] = []
    for field in sorted({field for record in new.values() for field in record}):
        values = [
            number for record in records.values() if (number := _number(record, field)) is not None
        ]
        if len(values) < _MIN_VALUES:
            continue
        median = statistics.median(values)
        deviation = statistics.median(abs(number - median) for number in values)
        if deviation <= 0:
            continue
        for name, record in sorted(new.items()):
            value = _number(record, field)
            if value is not None and abs(value - median) > _MAX_DEVIATIONS * deviation:
                flagged.append((name, field, value))
    return flagged


def _number(record: Mapping[str, Any], field: str) -> float | None:
    value = record.get(field)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)
