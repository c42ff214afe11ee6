"""Benchmarks of services: the same cases on several services and datasets (Kehoe 2014, 5.4, 3.3).

What was measured is named exactly: versions of services and of datasets. A call that fails is a
result like any other, and is counted.
"""

from __future__ import annotations

import dataclasses
import json
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rtask.errors import RtaskError, UsageError, nearest

__all__ = ["Benchmark", "Row", "Run", "read_benchmark", "run_benchmark", "summarise"]

_MAX_CALLS = 100_000
_DRAWS = 1000
Call = Callable[[str, str, dict[str, Any], dict[str, str], float | None], Mapping[str, Any]]


@dataclass(frozen=True)
class Benchmark:
    """Benchmark of services: methods to compare, and a dataset.

    Parameters
    ----------
    method
        Of each service.
    services
        Names, perhaps with versions.
    cases
        A file of requests beside this one, a JSON object in each line.
    resource
        The data resource that takes the datasets; empty for services without.
    datasets
        Names, perhaps with versions.
    measures
        Names of numbers of the answer, to be averaged; ``path.length`` is a member of a member.
    repeat
        How often each case is called.
    timeout_s
        For each call; None = as the services say.
    results
        Name of a dataset that keeps the results; empty = none does.
    """

    method: str
    services: tuple[str, ...]
    cases: tuple[dict[str, Any], ...]
    resource: str = ""
    datasets: tuple[str, ...] = ()
    measures: tuple[str, ...] = ()
    repeat: int = 1
    timeout_s: float | None = None
    results: str = ""


@dataclass(frozen=True)
class Run:
    """One call and what became of it.

    Parameters
    ----------
    service, dataset
        Exact versions; ``dataset`` is empty for services without data.
    case, repeat
        Numbers from 0.
    ms
        From the call to its answer.
    error
        What went wrong; empty where nothing did.
    measures
        Numbers of the answer.
    """

    service: str
    dataset: str
    case: int
    repeat: int
    ms: float
    error: str = ""
    measures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Row:
    """The results of one service on one dataset.

    Parameters
    ----------
    calls, failed
        How many calls were made, and how many of them failed.
    ms
        Median of the time of those that did not, with its interval.
    measures
        Means of the numbers of the answers, with their intervals.
    errors
        How many calls failed for each reason, the most frequent first.
    """

    service: str
    dataset: str
    calls: int
    failed: int
    ms: tuple[float, float, float] | None
    measures: Mapping[str, tuple[float, float, float] | None]
    errors: Mapping[str, int]


def read_benchmark(file: Path) -> Benchmark:
    """Return the benchmark that a TOML file describes, by the fields of :class:`Benchmark`.

    Raises
    ------
    UsageError
        The file, or that of the cases, cannot be read, or a field is wrong; with its name.
    """
    try:
        given = tomllib.loads(file.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: {error}") from None
    names = {field.name for field in dataclasses.fields(Benchmark)}
    for name in given:
        if name not in names:
            raise UsageError(f"{file}: unknown field {name!r}{nearest(name, sorted(names))}")
    texts = {name: _text(file, given, name) for name in ("method", "resource", "results", "cases")}
    lists = {name: _texts(file, given, name) for name in ("services", "datasets", "measures")}
    for name in ("method", "services", "cases"):
        if not given.get(name):
            raise UsageError(f"{file}: {name} is missing")
    if bool(texts["resource"]) != bool(lists["datasets"]):
        raise UsageError(f"{file}: resource and datasets are given together or not at all")
    cases = tuple(_cases(file.parent / texts["cases"]))
    repeat, timeout_s = given.get("repeat", 1), given.get("timeout_s")
    if not isinstance(repeat, int) or isinstance(repeat, bool) or repeat < 1:
        raise UsageError(f"{file}: repeat: expected a whole number from 1")
    if timeout_s is not None and not (isinstance(timeout_s, int | float) and timeout_s > 0):
        raise UsageError(f"{file}: timeout_s: expected a number above 0")
    made = Benchmark(
        method=texts["method"],
        services=lists["services"],
        cases=cases,
        resource=texts["resource"],
        datasets=lists["datasets"],
        measures=lists["measures"],
        repeat=repeat,
        timeout_s=timeout_s,
        results=texts["results"],
    )
    if (calls := len(list(_order(made)))) > _MAX_CALLS:
        raise UsageError(f"{file}: {calls} calls; at most {_MAX_CALLS}")
    return made


def run_benchmark(
    benchmark: Benchmark, call: Call, progress: Callable[[int, int], None] | None = None
) -> list[Run]:
    """Make the calls, one after another, in an order in which a load hurts all sides alike.

    Parameters
    ----------
    benchmark
        With exact versions, so that all its calls meet the same ones.
    call
        Takes service, method, request, datasets by resource, and the time for the answer in s.
    progress
        Is told how many calls have ended, and how many there are.
    """
    todo = list(_order(benchmark))
    runs = []
    for number, (repeat, case, dataset, service) in enumerate(todo, 1):
        data = {benchmark.resource: dataset} if dataset else {}
        error, measures, began = "", {}, time.perf_counter()
        try:
            request = dict(benchmark.cases[case])
            answer = call(service, benchmark.method, request, data, benchmark.timeout_s)
            took = time.perf_counter() - began
            measures = {name: _measure(answer, name) for name in benchmark.measures}
        except RtaskError as raised:
            took, error = time.perf_counter() - began, str(raised)
        runs.append(Run(service, dataset, case, repeat, 1e3 * took, error, measures))
        if progress is not None:
            progress(number, len(todo))
    return runs


def summarise(runs: Sequence[Run]) -> list[Row]:
    """Return a row for each service on each dataset, in the order of the first calls."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.service, run.dataset), []).append(run)
    rows = []
    for (service, dataset), group in groups.items():
        good = [run for run in group if not run.error]
        names = sorted({name for run in good for name in run.measures})
        measures = {
            name: _interval([run.measures[name] for run in good], np.mean) for name in names
        }
        ms = _interval([run.ms for run in good], np.median)
        errors = dict(Counter(run.error for run in group if run.error).most_common())
        failed = len(group) - len(good)
        rows.append(Row(service, dataset, len(group), failed, ms, measures, errors))
    return rows


def _order(benchmark: Benchmark) -> Iterator[tuple[int, int, str, str]]:
    for repeat in range(benchmark.repeat):
        for case in range(len(benchmark.cases)):
            for dataset in benchmark.datasets or ("",):
                for service in benchmark.services:
                    yield repeat, case, dataset, service


def _interval(
    values: Sequence[float], statistic: Callable[..., Any]
) -> tuple[float, float, float] | None:
    """Return a statistic with its 95 % bootstrap interval; none without values."""
    if not values:
        return None
    value = float(statistic(values))
    if len(values) == 1:
        return value, value, value
    from scipy.stats import bootstrap

    interval = bootstrap(
        (np.asarray(values, dtype=np.float64),), statistic, n_resamples=_DRAWS,
        method="percentile", rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return value, float(interval.low), float(interval.high)


def _measure(answer: Mapping[str, Any], name: str) -> float:
    value: Any = answer
    for part in name.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UsageError(f"the answer has no number {name}; it has {', '.join(answer)}")
    return float(value)


def _text(file: Path, given: Mapping[str, Any], name: str) -> str:
    value = given.get(name, "")
    if not isinstance(value, str):
        raise UsageError(f"{file}: {name}: expected a text")
    return value


def _texts(file: Path, given: Mapping[str, Any], name: str) -> tuple[str, ...]:
    value = given.get(name, [])
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        raise UsageError(f"{file}: {name}: expected a list of texts")
    return tuple(value)


def _cases(file: Path) -> Iterator[dict[str, Any]]:
    try:
        lines = file.read_text("utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: {error}") from None
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            case = json.loads(line)
        except ValueError:
            case = None
        if not isinstance(case, dict):
            raise UsageError(f"{file}, line {number}: expected a request as a JSON object")
        yield case
