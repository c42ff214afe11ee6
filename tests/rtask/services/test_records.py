"""Datasets of records: files in which a key tells lines apart, merged record by record."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from rtask.errors import ConflictError, UnknownTermError, UsageError
from rtask.services.datasets.store import Datasets

FILE = "outcomes.jsonl"


@pytest.fixture
def datasets(tmp_path: Path) -> Datasets:
    return Datasets(tmp_path / "datasets")


def lines(*records: dict[str, Any]) -> bytes:
    return "".join(json.dumps(one) + "\n" for one in records).encode()


def outcome(name: str, **more: Any) -> dict[str, Any]:
    return {"id": name, "held": True} | more


def records(datasets: Datasets, name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in datasets.read(name, FILE).splitlines()]


def forked(datasets: Datasets, *robots: str, start: bytes) -> None:
    """Make a dataset of outcomes and a fork of it for each robot."""
    datasets.create("lab/Outcomes", key="id")
    datasets.put("lab/Outcomes", {FILE: start})
    datasets.snapshot("lab/Outcomes")
    for robot in robots:
        datasets.fork(f"{robot}/Outcomes", "lab/Outcomes@1")


def test_what_robots_add_to_one_file_is_merged_in_any_order_to_the_same_bytes(datasets):
    robots = ("nao", "panda", "tiago")
    forked(datasets, *robots, start=lines(outcome("b"), outcome("a")))
    for robot in robots:
        # All add the same record and one of their own; one robot adds a field to an old record.
        added = [outcome("z", held=False), outcome(f"{robot}-1")]
        first = outcome("a", checked_by=robot) if robot == "nao" else outcome("a")
        datasets.put(f"{robot}/Outcomes", {FILE: lines(*added, first, outcome("b"))})
        datasets.snapshot(f"{robot}/Outcomes")
    found = set()
    for number, order in enumerate(itertools.permutations(robots)):
        datasets.fork(f"all/Order{number}", "lab/Outcomes@1")
        for robot in order:
            datasets.merge(f"all/Order{number}", f"{robot}/Outcomes")
        found.add(datasets.read(f"all/Order{number}", FILE))
    assert len(found) == 1
    merged = records(datasets, "all/Order0")
    assert [one["id"] for one in merged] == ["a", "b", "nao-1", "panda-1", "tiago-1", "z"]
    assert merged[0]["checked_by"] == "nao"


@pytest.mark.parametrize(
    ("ours", "theirs", "kind"),
    [
        (outcome("a", kg=1), outcome("a", kg=2), "one_key_two_values"),
        (outcome("a", kg=1), None, "changed_and_deleted"),
        (None, outcome("a", kg=2), "changed_and_deleted"),
    ],
)
def test_each_conflict_of_records_is_named_and_decided_by_a_rule(datasets, ours, theirs, kind):
    forked(datasets, "nao", start=lines(outcome("a"), outcome("b")))
    for name, changed in (("lab/Outcomes", ours), ("nao/Outcomes", theirs)):
        rest = [outcome("b"), outcome(name.partition("/")[0])]
        datasets.put(name, {FILE: lines(*([changed] if changed else []), *rest)})
        datasets.snapshot(name)
    before = datasets.find("lab/Outcomes")
    with pytest.raises(ConflictError, match=rf'{FILE}, record "a": {kind}') as raised:
        datasets.merge("lab/Outcomes", "nao/Outcomes")
    assert raised.value.details["conflicts"] == [{"path": FILE, "kind": kind, "key": "a"}]
    assert datasets.find("lab/Outcomes") == before
    with pytest.raises(ConflictError):
        datasets.merge("lab/Outcomes", "nao/Outcomes", {f"{FILE}#b": "theirs", FILE[:3]: "ours"})
    datasets.merge("lab/Outcomes", "nao/Outcomes", {f"{FILE}#a": "theirs"})
    merged = {one["id"]: one for one in records(datasets, "lab/Outcomes")}
    assert merged.get("a") == theirs
    assert merged.keys() - {"a"} == {"b", "lab", "nao"}


def test_a_number_far_from_all_others_is_kept_and_shown(datasets):
    start = lines(*(outcome(f"o{n}", width_m=0.05 + 0.001 * n) for n in range(10)))
    forked(datasets, "nao", start=start)
    wrong = lines(outcome("in-mm", width_m=55.0), outcome("fine", width_m=0.06))
    datasets.put("nao/Outcomes", {FILE: start + wrong})
    datasets.snapshot("nao/Outcomes")
    made = datasets.merge("lab/Outcomes", "nao/Outcomes")
    doubt = {"path": FILE, "key": "in-mm", "field": "width_m", "value": 55.0}
    assert made.facts()["doubts"] == [doubt]
    assert len(records(datasets, "lab/Outcomes")) == 12
    again = Datasets(datasets._root)
    assert again.find("lab/Outcomes").doubts == (doubt,)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b'{"id": "a"}\n{"id"', "line 2: expected a record in JSON"),
        (b"[1]", "line 1: expected an object whose 'id' is a text or a whole number"),
        (b'{"id": true}', "line 1: expected an object whose 'id'"),
        (b'{"id": 1}\n\n{"id": 1}', "line 3: another record has the id 1 already"),
    ],
)
def test_a_file_that_holds_no_records_is_refused(datasets, data, words):
    datasets.create("lab/Outcomes", key="id")
    with pytest.raises(UsageError, match=words):
        datasets.put("lab/Outcomes", {FILE: data, "notes.txt": b"fine"})
    assert datasets.find("lab/Outcomes").files == {}


def test_files_that_hold_no_records_are_merged_whole(datasets):
    forked(datasets, "nao", start=lines(outcome("a")))
    for name, text in (("lab/Outcomes", b"1"), ("nao/Outcomes", b"2")):
        datasets.put(name, {"notes.txt": text})
        datasets.snapshot(name)
    with pytest.raises(ConflictError) as raised:
        datasets.merge("lab/Outcomes", "nao/Outcomes")
    assert raised.value.details["conflicts"] == [{"path": "notes.txt", "kind": "both_changed"}]


def test_a_version_without_one_robot_leaves_the_older_ones_as_they_were(datasets):
    datasets.create("lab/Outcomes", key="id")
    every = [outcome(f"{robot}-{n}", robot=robot) for robot in ("nao", "panda") for n in range(3)]
    datasets.put("lab/Outcomes", {FILE: lines(*every), "nao/notes.txt": b"x", "only.jsonl": b""})
    datasets.snapshot("lab/Outcomes")
    made = datasets.prune("lab/Outcomes", ["nao"], {"robot": "nao", "held": True})
    assert (made.name, sorted(made.files)) == ("lab/Outcomes@2", ["only.jsonl", FILE])
    assert [one["id"] for one in records(datasets, "lab/Outcomes")] == [
        "panda-0", "panda-1", "panda-2",
    ]  # fmt: skip
    assert len(records(datasets, "lab/Outcomes@1")) == 6
    with pytest.raises(UnknownTermError, match=r"no record with \{'robot': 'nao'\}"):
        datasets.prune("lab/Outcomes", ["only.jsonl"], {"robot": "nao"})
    assert "only.jsonl" in datasets.find("lab/Outcomes@head").files, "all or nothing"
    assert datasets.numbers("lab/Outcomes") == [1, 2]
    datasets.create("lab/Files")
    with pytest.raises(UsageError, match="has no key"):
        datasets.prune("lab/Files", [], {"robot": "nao"})
