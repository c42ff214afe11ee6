"""Benchmarks of services: the calls that are made, what is counted, files that are wrong."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from rtask.errors import ServiceError, UsageError
from rtask.services import Service, ServiceHost, data_resource, method
from rtask.services.benchmark import Benchmark, Run, read_benchmark, run_benchmark, summarise
from rtask.wire.message import Answer


class Found(Answer):
    """A number."""

    value: float
    """of the root"""


class Root(Service):
    """Roots of numbers, in the unit of a dataset."""

    name = "lab/Root"
    unit = data_resource("binary")

    @method
    def root(self, number: float) -> Found:
        """Return the root of a number."""
        if number < 0:
            raise ServiceError("a negative number has no root")
        return Found(value=math.sqrt(number) * float(self.unit.read("factor")))


class Guess(Root):
    """The same, badly."""

    name = "lab/Guess"

    @method
    def root(self, number: float) -> Found:
        """Return half of a number."""
        return Found(value=number / 2)


def written(folder: Path, lines: str = "", **fields: Any) -> Path:
    given = {
        "method": "root",
        "services": ["lab/Root", "lab/Guess"],
        "cases": "cases.jsonl",
        "resource": "unit",
        "datasets": ["lab/Metres", "lab/Millimetres"],
        "measures": ["value"],
        "repeat": 2,
    } | fields
    lines = lines or "".join(json.dumps({"number": one}) + "\n" for one in (4, 16, -1))
    (folder / "cases.jsonl").write_text(lines)
    file = folder / "roots.toml"
    file.write_text("".join(f"{name} = {json.dumps(v)}\n" for name, v in given.items() if v))
    return file


def test_each_case_is_called_on_each_service_and_dataset_and_failures_count(tmp_path: Path):
    benchmark = read_benchmark(written(tmp_path))
    with ServiceHost([Root, Guess]) as host:
        for name, factor in (("lab/Metres", b"1"), ("lab/Millimetres", b"1000")):
            host.datasets.create(name)
            host.datasets.put(name, {"factor": factor})

        def call(name: str, own: str, args: Any, data: Any, timeout_s: Any) -> Any:
            return host.call(name, own, args, None, data, timeout_s).as_json()

        told: list[tuple[int, int]] = []
        runs = run_benchmark(benchmark, call, lambda *one: told.append(one))
    assert told == [(n, 24) for n in range(1, 25)]
    assert Counter((run.service, run.dataset, run.case, run.repeat) for run in runs) == Counter(
        (service, dataset, case, repeat)
        for service in benchmark.services
        for dataset in benchmark.datasets
        for case in range(3)
        for repeat in range(2)
    )
    first = [run.service for run in runs[:4]]
    assert first == ["lab/Root", "lab/Guess"] * 2, "in turns, so that a load hurts both"
    rows = {(row.service, row.dataset): row for row in summarise(runs)}
    metres, guess = rows["lab/Root", "lab/Metres"], rows["lab/Guess", "lab/Metres"]
    assert (metres.calls, metres.failed, guess.calls, guess.failed) == (6, 2, 6, 0)
    assert metres.measures["value"] == (3.0, 2.0, 4.0)
    assert rows["lab/Root", "lab/Millimetres"].measures["value"] == (3000.0, 2000.0, 4000.0)
    mean, low, high = guess.measures["value"] or (0.0, 0.0, 0.0)
    assert mean == pytest.approx((2 + 8 - 0.5) / 3)
    assert low < mean < high
    assert metres.errors == {"a negative number has no root": 2}
    assert guess.errors == {}


def test_what_has_no_result_has_no_interval():
    failed = Run("lab/Root@1.0.0", "", 0, 0, 1.0, error="no")
    one = Run("lab/Guess@1.0.0", "", 0, 0, 2.0, measures={"value": 1.0})
    rows = summarise([failed, one])
    assert (rows[0].ms, rows[0].measures) == (None, {})
    assert (rows[1].ms, rows[1].measures["value"]) == ((2.0, 2.0, 2.0), (1.0, 1.0, 1.0))


def test_an_answer_without_the_number_is_a_failure_that_names_it():
    benchmark = Benchmark(
        method="root", services=("lab/Root",), cases=({"number": 1},), measures=("path.length",)
    )
    (run,) = run_benchmark(benchmark, lambda *_: {"path": {"size": 3}})
    assert "no number path.length" in run.error


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"method": ""}, "method is missing"),
        ({"services": []}, "services is missing"),
        ({"servises": ["lab/Root"]}, "unknown field 'servises'; did you mean 'services'"),
        ({"services": "lab/Root"}, "services: expected a list of texts"),
        ({"resource": ""}, "resource and datasets are given together"),
        ({"repeat": 1.5}, "repeat: expected a whole number"),
        ({"repeat": 100_000}, "1200000 calls; at most"),
        ({"timeout_s": -1}, "timeout_s: expected a number above 0"),
        ({"cases": "none.jsonl"}, "none.jsonl"),
        ({"cases": 3}, "cases: expected a text"),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_the_field(tmp_path: Path, fields, words):
    with pytest.raises(UsageError, match=words):
        read_benchmark(written(tmp_path, **fields))


@pytest.mark.parametrize("line", ["[1]", "{", "3"])
def test_a_case_that_is_no_request_is_refused_with_its_line(tmp_path: Path, line: str):
    with pytest.raises(UsageError, match=r"cases.jsonl, line 2: expected a request"):
        read_benchmark(written(tmp_path, lines=f'{{"number": 1}}\n{line}\n'))
