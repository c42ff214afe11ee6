"""``rtask dataset``: the datasets of a server, which services take as data."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import (
    announce_final,
    announce_undo,
    confirm_final,
    exit_if_empty,
    json_option,
    listing_option,
    print_json,
    shown_parts,
    shown_rows,
    yes_option,
)
from rtask.cli.services.dataset_undo import Head, digests_of, head_of
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.client.datasets import DatasetClient

__all__ = ["dataset"]

_server = click.option(
    "--server",
    metavar="URL",
    envvar="RTASK_SERVER",
    show_envvar=True,
    default="http://127.0.0.1:8765",
    show_default=True,
    help="Address of the server. Its token is read from RTASK_TOKEN.",
)


@click.group()
def dataset() -> None:
    """Keep the data of services: folders of files with versions, on a server."""


def _connected(server: str) -> DatasetClient:
    from rtask.client.datasets import DatasetClient

    return DatasetClient(server, os.environ.get("RTASK_TOKEN"))


def _tell(as_json: bool, facts: Any, words: str) -> None:
    if as_json:
        print_json(facts)
    else:
        click.echo(words)


@dataset.command("list")
@_server
@listing_option
@json_option
def list_datasets(server: str, limit: int | None, as_json: bool) -> None:
    """List the datasets that may be read."""
    with _connected(server) as client:
        names = shown_rows(client.names(), limit, as_json)
    if names or as_json:
        _tell(as_json, names, "\n".join(names))
    exit_if_empty(names, "no datasets yet; `rtask dataset create` makes one")


@dataset.command("create")
@click.argument("name")
@click.option("--fork", "source", metavar="NAME@VERSION", help="Go on from a version of another.")
@click.option("--private", is_flag=True, help="Only its owner may read it.")
@click.option(
    "--key",
    metavar="FIELD",
    default="",
    help="Its .jsonl files hold records, which this field tells apart when versions are merged.",
)
@_server
@json_option
def create(
    name: str, source: str | None, private: bool, key: str, server: str, as_json: bool
) -> None:
    """Create a dataset NAME, <namespace>/<name>."""
    if source and (private or key):
        raise UsageError(
            "a fork has the readers and the key of what it is a fork of: leave out --private and "
            "--key"
        )
    with _connected(server) as client:
        client.create(name, source, private, key)
    _tell(as_json, {"name": name}, f"created {name}")
    if not as_json:
        announce_final("a dataset stays; `rtask dataset remove` empties it")


@dataset.command("show")
@click.argument("name")
@_server
@listing_option
@json_option
def show(name: str, server: str, limit: int | None, as_json: bool) -> None:
    """List the files of a dataset: NAME, NAME@3 or NAME@head."""
    with _connected(server) as client:
        described = client.describe(name)
    versions = ", ".join(map(str, described["versions"])) or "none"
    rows = [f"{described['name']}  versions: {versions}  {described['message']}".rstrip()]
    files = shown_rows(list(described["files"].items()), limit, as_json)
    rows += [f"{size:12d}  /{path}" for path, (_, size) in files]
    _tell(as_json, {**described, "files": dict(files)}, "\n".join(rows))


@dataset.command("put")
@click.argument("name")
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@click.option("--as", "path", metavar="PATH", help="Its path in the dataset.  [default: its name]")
@_server
@yes_option
@json_option
def put(name: str, source: Path, path: str | None, server: str, yes: bool, as_json: bool) -> None:
    """Write SOURCE, a file or a folder, to the head of a dataset."""
    if source.is_dir():
        start = f"{path.strip('/')}/" if path else ""
        files = sorted(file for file in source.rglob("*") if file.is_file())
        named = {f"{start}{file.relative_to(source).as_posix()}": file for file in files}
    else:
        named = {(path or source.name).removeprefix("/"): source}
    for file in named:
        try:
            file.encode()
        except UnicodeEncodeError:
            raise UsageError(f"{file!r}: the name of a file is not UTF-8; rename it") from None
    with _connected(server) as client:
        head = head_of(client, name)
        changed = head.changed_by(digests_of(named))
        folder = path.strip("/") if path and source.is_dir() else None
        names = [folder] if folder and not head.below(folder) else []
        undo = _opposite(head, changed, names, yes)
        sent = client.put_many(name, named)
    words = f"wrote {sent} {'file' if sent == 1 else 'files'} to {name}"
    if sent < len(named):
        words += f", which has the other {len(named) - sent} already"
    _tell(as_json, {"name": name, "files": list(named), "sent": sent}, words)
    if sent and undo and not as_json:
        announce_undo("dataset", *undo)


@dataset.command("get")
@click.argument("name")
@click.argument("path")
@click.argument("target", type=click.Path(dir_okay=False, path_type=Path))
@_server
@json_option
def get(name: str, path: str, target: Path, server: str, as_json: bool) -> None:
    """Write the file PATH of a dataset to TARGET."""
    with _connected(server) as client:
        data = client.get(name, path)
    target.write_bytes(data)
    _tell(as_json, {"target": str(target), "bytes": len(data)}, f"wrote {target}")


@dataset.command("remove")
@click.argument("name")
@click.argument("paths", metavar="PATH...", nargs=-1, required=True)
@_server
@yes_option
@json_option
def remove(name: str, paths: tuple[str, ...], server: str, yes: bool, as_json: bool) -> None:
    """Remove files or folders from the head; the versions keep them."""
    with _connected(server) as client:
        head = head_of(client, name)
        gone = [file for path in paths for file in head.below(path)]
        undo = _opposite(head, gone, paths, yes)
        for path in paths:
            client.remove(name, path)
    removed = paths[0] if len(paths) == 1 else list(paths)
    _tell(as_json, {"name": name, "removed": removed}, f"removed {', '.join(paths)} from {name}")
    if undo and not as_json:
        announce_undo("dataset", *undo)


@dataset.command("restore")
@click.argument("version", metavar="NAME@VERSION")
@click.argument("paths", metavar="[PATH]...", nargs=-1)
@_server
@yes_option
@json_option
def restore(version: str, paths: tuple[str, ...], server: str, yes: bool, as_json: bool) -> None:
    """Make the head as a version was: all of it, or some files and folders.

    What the version does not have is removed from the head.
    """
    name, at, _ = version.partition("@")
    if not at:
        raise UsageError(f"{version}: name the version to restore, such as {version}@1")
    with _connected(server) as client:
        head = head_of(client, name)
        difference = client.difference(name, "head", version.partition("@")[2])
        kinds = {kind: _below(files, paths) for kind, files in difference.items()}
        changed = [file for files in kinds.values() for file in files]
        undo = _opposite(head, changed, (), yes)
        for file in (*kinds["added"], *kinds["changed"]):
            client.put(name, file, client.get(version, file))
        for file in kinds["removed"]:
            client.remove(name, file)
    written = len(kinds["added"]) + len(kinds["changed"])
    facts = {"name": name, "version": version, "written": written, "removed": kinds["removed"]}
    words = f"the head of {name}: {written} files as in {version}, {len(kinds['removed'])} removed"
    _tell(as_json, facts, words)
    if undo and changed and not as_json:
        announce_undo("dataset", *undo)


def _below(files: list[str], paths: tuple[str, ...]) -> list[str]:
    """Return the files that paths of files or folders name; all of them without paths."""
    starts = [path.strip("/") for path in paths]
    return [
        file
        for file in files
        if not starts or any(file == start or file.startswith(f"{start}/") for start in starts)
    ]


def _opposite(head: Head, changed: list[str], named: Sequence[str], yes: bool) -> list[str]:
    """Return the command that undoes a change of a head; ask before one that nothing undoes."""
    undo = head.opposite(changed, named)
    if undo is not None:
        return undo
    confirm_final(
        f"no version of {head.name} has the present contents of {head.lost(changed)} files; "
        "`rtask dataset snapshot` makes one",
        yes,
    )
    return []


@dataset.command("snapshot")
@click.argument("name")
@click.option("--message", "-m", default="", help="Why.")
@_server
@json_option
def snapshot(name: str, message: str, server: str, as_json: bool) -> None:
    """Make the head of a dataset a version, which never changes."""
    with _connected(server) as client:
        made = client.snapshot(name, message)
    _tell(as_json, made, made["name"])
    if not as_json:
        announce_final("a version stays as it is")


@dataset.command("diff")
@click.argument("name")
@click.argument("before")
@click.argument("after", default="head")
@_server
@listing_option
@json_option
def diff(name: str, before: str, after: str, server: str, limit: int | None, as_json: bool) -> None:
    """List the files that differ between two versions; AFTER is the head by default."""
    with _connected(server) as client:
        difference = client.difference(name, before, after)
    difference = shown_parts(difference, limit, as_json)
    marks = {"added": "+", "removed": "-", "changed": "*"}
    rows = [f"{marks[kind]} /{path}" for kind, paths in difference.items() for path in paths]
    _tell(as_json, difference, "\n".join(rows) or "no difference")


@dataset.command("prune")
@click.argument("name")
@click.argument("paths", metavar="[PATH]...", nargs=-1)
@click.option(
    "--where",
    multiple=True,
    metavar="FIELD=VALUE",
    help="Leave out the records with this value, such as robot=nao-1; repeat for several fields "
    "that must all fit.",
)
@_server
@yes_option
@json_option
def prune(
    name: str,
    paths: tuple[str, ...],
    where: tuple[str, ...],
    server: str,
    yes: bool,
    as_json: bool,
) -> None:
    """Make a version of a dataset without some files, folders or records. Older ones keep them."""
    if not (paths or where):
        raise UsageError("name the files and folders to leave out, or records by --where")
    fields = {}
    for condition in where:
        field, equals, value = condition.partition("=")
        if not (field and equals):
            raise UsageError(f"--where {condition}: expected FIELD=VALUE")
        try:
            fields[field] = json.loads(value)
        except ValueError:
            fields[field] = value
    with _connected(server) as client:
        head = head_of(client, name)
        # Which files hold such records, only the server knows.
        gone = list(head.files) if fields else [f for path in paths for f in head.below(path)]
        undo = _opposite(head, gone, (), yes)
        made = client.prune(name, list(paths), fields)
    _tell(as_json, made, made["name"])
    if undo and not as_json:
        announce_undo("dataset", *undo)


@dataset.command("merge")
@click.argument("name")
@click.argument("source")
@click.option(
    "--rule",
    "rules",
    multiple=True,
    metavar="PATH=ours|theirs",
    help="Decide conflicts below this path, or of one record by PATH#KEY; =ours or =theirs decides "
    "all.",
)
@_server
@json_option
def merge(name: str, source: str, rules: tuple[str, ...], server: str, as_json: bool) -> None:
    """Merge a version, SOURCE, into a dataset. Conflicts that no rule decides change nothing."""
    decided = {}
    for rule in rules:
        path, equals, side = rule.rpartition("=")
        if not equals or side not in ("ours", "theirs"):
            raise UsageError(f"--rule {rule}: expected PATH=ours or PATH=theirs")
        decided[path.removeprefix("/")] = side
    with _connected(server) as client:
        made = client.merge(name, source, decided)
    rows = [made["name"]]
    rows += [
        f"please check {row['path']}#{row['key']}: {row['field']} = {row['value']:g} is far from "
        "all others"
        for row in made["doubts"]
    ]
    _tell(as_json, made, "\n".join(rows))
    if made["parents"] and not as_json:
        announce_undo("dataset", "restore", made["parents"][0])
