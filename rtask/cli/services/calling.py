"""``rtask service``: list, describe and call services."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import (
    json_option,
    listing_option,
    print_json,
    server_option,
    shown_rows,
)
from rtask.errors import RtaskError, UsageError, nearest
from rtask.wire.dataset_words import in_words_of

if TYPE_CHECKING:
    from rtask.services.benchmark import Run

__all__ = ["service"]

_SHOWN_REASONS = 3
"""Number of reasons, the most frequent ones, that a benchmark names for each service."""


@dataclass(frozen=True)
class _Services:
    """The services of this installation or of a server."""

    listing: Callable[[], list[dict[str, Any]]]
    description: Callable[[str], dict[str, Any]]
    call: Callable[..., dict[str, Any]]
    dataset: Callable[[str], str]
    """Returns the exact version of a dataset."""


_load_option = click.option(
    "--load",
    "sources",
    multiple=True,
    metavar="MODULE|FILE.py",
    help="Offer the services that this module or file defines, too.",
)


@click.group()
def service() -> None:
    """List, describe and call algorithms that are offered as services."""


@service.command("list")
@server_option
@_load_option
@listing_option
@json_option
def list_services(
    server: str | None, sources: tuple[str, ...], limit: int | None, as_json: bool
) -> None:
    """List the services of this installation, or of a server."""
    with _offered(server, sources) as offered:
        services = shown_rows(offered.listing(), limit, as_json)
    if as_json:
        print_json(services)
        return
    for entry in services:
        state = "" if entry["state"] in ("ready", "untried") else f"  [{entry['state']}]"
        click.echo(f"{entry['name']}@{entry['version']}{state}  {entry['summary']}")
        if entry.get("problem"):
            click.echo(f"    {entry['problem']['detail']}")
        click.echo(f"    {', '.join(entry['methods'])}")


@service.command("show")
@click.argument("name")
@server_option
@_load_option
@json_option
def show_service(name: str, server: str | None, sources: tuple[str, ...], as_json: bool) -> None:
    """Describe a service: its methods with their parameters, its data, its versions.

    NAME is <namespace>/<name>, perhaps with a version: @1.2.0, @1.2.*, @1.*.
    """
    with _offered(server, sources) as offered:
        description = offered.description(name)
    if as_json:
        print_json(description)
        return
    click.echo(f"{description['name']}@{description['version']}: {description['summary']}")
    if description["description"]:
        click.echo(description["description"])
    for own, need in description["resources"].items():
        default = f", default {need['default']}" if need["default"] else ""
        click.echo(f"data {own}: {need['type']}{default}  {need['summary']}")
    for own, method in description["methods"].items():
        click.echo(f"\n{own}: {method['summary']}")
        for line in _field_lines(method["request"], method["request"].get("$defs", {})):
            click.echo(f"    {line}")
        answer = ", ".join(method["answer"].get("properties", {}))
        click.echo(f"    -> {answer or 'nothing'}")


def _field_lines(
    message: dict[str, Any], parts: dict[str, Any], outer: tuple[str, ...] = ()
) -> Iterator[str]:
    """Yield a line for each field of a message; those of a message in it follow, indented."""
    from rtask.wire.openapi import type_in_words

    for field, schema in message.get("properties", {}).items():
        absent = "" if field in message.get("required", ()) else f"  [{schema.get('x-absent', '')}]"
        options = " or ".join(map(str, schema.get("enum", ())))
        meaning = schema.get("description") or schema.get("x-unit", options)
        yield f"{field} : {type_in_words(schema)}{absent}  {meaning}".rstrip()
        for part in _references(schema):
            if part in parts and part not in outer:
                yield from (
                    f"    {line}" for line in _field_lines(parts[part], parts, (*outer, part))
                )


def _references(schema: dict[str, Any]) -> Iterator[str]:
    """Yield the names of the messages that a field holds or lists."""
    for choice in (schema, *schema.get("anyOf", ())):
        for part in (choice, choice.get("items", {})):
            if "$ref" in part:
                yield part["$ref"].rpartition("/")[2]


@service.command("call")
@click.argument("name")
@click.argument("method")
@click.argument("arguments", nargs=-1)
@click.option(
    "--dataset",
    "mapping",
    multiple=True,
    metavar="RESOURCE=NAMESPACE/NAME",
    help="Dataset for a data resource of the service.",
)
@click.option("--timeout", type=float, help="Seconds to wait.  [default: as the service says]")
@server_option
@_load_option
@json_option
def call_service(
    name: str,
    method: str,
    arguments: tuple[str, ...],
    mapping: tuple[str, ...],
    timeout: float | None,
    server: str | None,
    sources: tuple[str, ...],
    as_json: bool,
) -> None:
    """Call a method of a service and print its answer.

    ARGUMENTS are FIELD=VALUE. A value is read as JSON, or else as text; @FILE stands for the
    contents of a file.
    """
    data = dict(_pair(pair, "--dataset") for pair in mapping)
    args = {field: _value(text) for field, text in (_pair(pair, "") for pair in arguments)}
    with _offered(server, sources) as offered:
        answer = _in_words_of_options(lambda: offered.call(name, method, args, data, timeout))
    if as_json:
        print_json(answer)
        return
    for field, value in answer.items():
        click.echo(f"{field}: {value if isinstance(value, str) else json.dumps(value)}")


@service.command("save")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@server_option
@json_option
def save_pipeline(file: Path, server: str | None, as_json: bool) -> None:
    """Save a pipeline on a server, as a service with the method run.

    FILE is JSON with the fields of rtask/Pipeline save: pipeline, steps, output, and perhaps
    version, summary and defaults.
    """
    if not server:
        raise UsageError("a pipeline is saved on a server: name it by --server")
    try:
        args = json.loads(file.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: {error}") from error
    if not isinstance(args, dict):
        raise UsageError(f"{file}: expected an object with pipeline, steps and output")
    with _offered(server, ()) as offered:
        saved = offered.call("rtask/Pipeline", "save", args, {}, None)
    if as_json:
        print_json(saved)
        return
    click.echo(f"{saved['name']}@{saved['version']}: {saved['summary']}")


@service.command("benchmark")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@server_option
@_load_option
@json_option
def benchmark(file: Path, server: str | None, sources: tuple[str, ...], as_json: bool) -> None:
    """Compare services on datasets, by the same cases.

    FILE is TOML: method, services, cases (a file with a request as JSON in each line), and
    perhaps resource and datasets, measures (numbers of the answer), repeat, timeout_s, and results
    (a dataset of the server that keeps every call's result as a version).
    """
    from rtask.cli.progress import Working
    from rtask.services.benchmark import read_benchmark, run_benchmark, summarise

    plan = read_benchmark(file)
    if plan.results and not server:
        raise UsageError("results are kept by a server: name it by --server, or leave results out")
    with _offered(server, sources) as offered:
        described = [offered.description(name) for name in plan.services]
        for entry in described:
            if plan.method not in entry["methods"]:
                hint = nearest(plan.method, list(entry["methods"]))
                raise UsageError(f"{entry['name']} has no method {plan.method!r}{hint}")
        exact = replace(
            plan,
            services=tuple(f"{entry['name']}@{entry['version']}" for entry in described),
            datasets=tuple(offered.dataset(name) for name in plan.datasets),
        )
        with Working("calling services") as working:
            runs = run_benchmark(exact, offered.call, working.tell)
    rows = summarise(runs)
    results_place = _keep(server, plan.results, runs, file) if server and plan.results else ""
    if as_json:
        print_json({"rows": [asdict(row) for row in rows], "results": results_place})
        return
    for row in rows:
        click.echo(f"{row.service}  {row.dataset}".rstrip())
        click.echo(f"    {row.calls} calls, {row.failed} failed; median {_shown(row.ms)} ms")
        for name, measure in row.measures.items():
            click.echo(f"    {name}: mean {_shown(measure)}")
        for reason, number in list(row.errors.items())[:_SHOWN_REASONS]:
            click.echo(f"    failed {number} time{'' if number == 1 else 's'}: {reason}")
    if results_place:
        click.echo(f"results: {results_place}")


@service.command("run", context_settings={"ignore_unknown_options": True})
@click.argument("script", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def run_script(script: Path, arguments: tuple[str, ...]) -> None:
    """Run a Python script that imports brass, the library of Kehoe 2014, 5.7.

    The server is that of RTASK_SERVER, by default http://127.0.0.1:8765.
    """
    import runpy
    import sys

    from rtask.services.brass import named_brass

    sys.argv = [str(script), *arguments]
    with named_brass("rtask.client.brass"):
        runpy.run_path(str(script), run_name="__main__")


def _in_words_of_options(call: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the answer of a call; its errors name options, not members of a request."""
    try:
        return call()
    except RtaskError as error:
        resource = error.details.get("resource")
        if not isinstance(resource, str):
            raise
        words = in_words_of(str(error), resource, "--dataset")
        raise type(error)(words, **error.details) from None


def _pair(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise UsageError(f"{option} {text!r}: expected NAME=VALUE".strip())
    return name, value


def _value(text: str) -> Any:
    """Return an argument of the command line as JSON carries it."""
    if text.startswith("@"):
        import base64

        try:
            return base64.b64encode(Path(text[1:]).read_bytes()).decode("ascii")
        except OSError as error:
            raise UsageError(f"{text[1:]}: {error.strerror}") from error
    try:
        return json.loads(text)
    except ValueError:
        return text


@contextmanager
def _offered(server: str | None, sources: tuple[str, ...]) -> Iterator[_Services]:
    """Yield the services of a server, or of this installation."""
    if server:
        import rtask

        if sources:
            raise UsageError("--load is for services of this machine; a server has its own")
        with rtask.connect(server, token=os.environ.get("RTASK_TOKEN")) as client:
            yield _Services(
                client.services,
                client.describe_service,
                client.call_service,
                lambda name: _exact_dataset(server, name),
            )
        return
    from rtask.services.offered import open_host

    with open_host(sources=sources) as host:

        def call(name: str, method: str, args: Any, data: Any, timeout_s: Any) -> dict[str, Any]:
            return host.call(name, method, args, None, data, timeout_s).as_json()

        def dataset(name: str) -> str:
            return host.datasets.find(name).name

        yield _Services(host.listing, host.description, call, dataset)


def _exact_dataset(server: str, name: str) -> str:
    from rtask.client.datasets import DatasetClient

    with DatasetClient(server, os.environ.get("RTASK_TOKEN")) as client:
        return str(client.describe(name)["name"])


def _keep(server: str, name: str, runs: Sequence[Run], file: Path) -> str:
    """Store results as records of a dataset, and return the version that holds them."""
    from rtask.client.datasets import DatasetClient
    from rtask.services.datasets.records import write_records

    began = datetime.now(UTC).isoformat(timespec="seconds")
    records = {
        f"{number:06d}": {"id": f"{began}-{number}", "benchmark": file.stem, **asdict(run)}
        for number, run in enumerate(runs)
    }
    with DatasetClient(server, os.environ.get("RTASK_TOKEN")) as client:
        if name not in client.names():
            client.create(name, key="id")
        client.put(name, f"{file.stem}/{began}.jsonl", write_records(records))
        return str(client.snapshot(name, f"benchmark {file.stem}")["name"])


def _shown(measure: tuple[float, float, float] | None) -> str:
    if measure is None:
        return "-"
    value, low, high = measure
    return f"{value:.4g} [{low:.4g}, {high:.4g}]"
