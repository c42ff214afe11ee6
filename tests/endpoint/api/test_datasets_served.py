"""Datasets of a running server: large folders, and private ones as strangers see them."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from click.testing import CliRunner

from rtask.cli import cli
from rtask.client.datasets import DatasetClient
from rtask.errors import UsageError
from rtask.services.outward.frames import pack
from tests.commands import run_command
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

SECRET = b"a shape that nobody else may know"


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


def put(server: RunningServer, name: str, folder: Path) -> int:
    words = ["dataset", "put", name, str(folder), "--server", server.url, "--json"]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    return int(json.loads(done.stdout)["sent"])


def test_a_folder_of_many_files_is_stored_and_what_is_there_is_not_sent_again(server, tmp_path):
    for number in range(4_500):
        folder = tmp_path / "parts" / f"{number % 20}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{number}.txt").write_text(f"part {number}")
    httpx.put(f"{server.url}/datasets/lab/Many").raise_for_status()
    assert put(server, "lab/Many", tmp_path / "parts") == 4_500
    with DatasetClient(server.url) as client:
        assert len(client.describe("lab/Many")["files"]) == 4_500
        assert client.get("lab/Many", "7/4207.txt") == b"part 4207"
    assert put(server, "lab/Many", tmp_path / "parts") == 0
    (tmp_path / "parts" / "7" / "4207.txt").write_text("changed")
    assert put(server, "lab/Many", tmp_path / "parts") == 1


def test_every_command_about_datasets_prints_json(server, tmp_path):
    (tmp_path / "a.txt").write_text("1")

    def told(*words: str) -> Any:
        command = ["dataset", *words, "--server", server.url, "--json"]
        done = CliRunner().invoke(cli, command, catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout)

    told("create", "lab/Told")
    told("put", "lab/Told", str(tmp_path / "a.txt"))
    first = told("snapshot", "lab/Told", "-m", "first")
    assert first["version"] == 1
    fork = told("create", "lab/Fork", "--fork", "lab/Told@1")
    assert fork["name"].startswith("lab/Fork")
    told("remove", "lab/Told", "a.txt")
    assert told("diff", "lab/Told", "1", "head")["removed"] == ["a.txt"]
    assert told("get", "lab/Fork", "a.txt", str(tmp_path / "again.txt"))["bytes"] == 1
    assert told("merge", "lab/Fork", "lab/Told@1")
    assert "lab/Told" in json.dumps(told("list"))
    assert told("show", "lab/Told@1")["files"].keys() == {"a.txt"}


def test_changes_of_a_head_are_undone_by_what_they_printed(server, tmp_path):
    def run(*words: str) -> str:
        command = ["dataset", *words, "--server", server.url]
        done = CliRunner().invoke(cli, command, catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return done.stderr

    def undo(said: str) -> None:
        (line,) = (line for line in said.splitlines() if line.startswith("undo: "))
        program, _, *words = shlex.split(line.removeprefix("undo: "))
        assert program == "rtask"
        assert CliRunner().invoke(cli, ["dataset", *words]).exit_code == 0

    def head(name: str = "lab/Undone") -> dict[str, Any]:
        return httpx.get(f"{server.url}/datasets/{name}@head").json()["files"]

    folder = tmp_path / "parts"
    folder.mkdir()
    for name in ("a.txt", "b.txt"):
        (folder / name).write_text(name)
    assert "this cannot be undone: a dataset stays" in run("create", "lab/Undone")
    undo(run("put", "lab/Undone", str(folder), "--as", "raw"))
    assert head() == {}
    run("put", "lab/Undone", str(folder))
    assert "this cannot be undone" in run("snapshot", "lab/Undone")
    first = head()
    (folder / "a.txt").write_text("changed")
    replaced = run("put", "lab/Undone", str(folder))
    second = head()
    assert second != first
    undo(run("remove", "lab/Undone", "b.txt"))
    assert head() == second
    assert "no version of lab/Undone has the present contents of 1 files" in run(
        "remove", "lab/Undone", "a.txt"
    )
    undo(replaced)
    assert head() == first
    undo(run("prune", "lab/Undone", "a.txt"))
    assert head() == first
    run("create", "lab/Other", "--fork", "lab/Undone@1")
    (tmp_path / "c.txt").write_text("c")
    run("put", "lab/Other", str(tmp_path / "c.txt"))
    run("snapshot", "lab/Other")
    undo(run("merge", "lab/Undone", "lab/Other@1"))
    assert head() == first
    command = ["dataset", "restore", "lab/Undone@1", "--server", server.url, "--json"]
    assert json.loads(CliRunner().invoke(cli, command).stdout)["written"] == 0


def test_a_path_that_begins_with_a_slash_is_known_again(server, tmp_path):
    httpx.put(f"{server.url}/datasets/lab/Slash").raise_for_status()
    (tmp_path / "a").write_text("1")
    words = ["dataset", "put", "lab/Slash", str(tmp_path / "a"), "--as", "/x/y"]
    told = [CliRunner().invoke(cli, [*words, "--server", server.url]).stdout for _ in range(2)]
    assert told[0] == "wrote 1 file to lab/Slash\n"
    assert told[1] == "wrote 0 files to lab/Slash, which has the other 1 already\n"


def test_a_file_whose_name_is_not_utf8_is_named_and_nothing_is_stored(server, tmp_path):
    httpx.put(f"{server.url}/datasets/lab/Named").raise_for_status()
    (tmp_path / "a").write_text("1")
    (tmp_path / os.fsdecode(b"b\xff")).write_text("2")
    words = ["dataset", "put", "lab/Named", str(tmp_path), "--server", server.url]
    with pytest.raises(UsageError, match=r"b\\udcff.*: the name of a file is not UTF-8"):
        CliRunner().invoke(cli, words, catch_exceptions=False)
    assert httpx.get(f"{server.url}/datasets/lab/Named").json()["files"] == {}


def test_many_files_are_stored_together_or_not_at_all(server):
    place = f"{server.url}/datasets/lab/Together"
    httpx.put(place).raise_for_status()
    kind = {"Content-Type": "application/cbor"}
    bad = httpx.post(f"{place}/files", content=pack({"a": b"1", "../b": b"2"}), headers=kind)
    assert bad.status_code == 400
    text = httpx.post(f"{place}/files", content=pack({"a": b"1", "b": "2"}), headers=kind)
    assert (text.status_code, text.json()["detail"]) == (400, "b: expected bytes, got str")
    assert httpx.post(f"{place}/files", json={"a": "1"}).status_code == 415
    assert httpx.post(f"{place}@1/files", content=pack({"a": b"1"}), headers=kind).status_code in (
        404,
        405,
    )
    assert httpx.get(place).json()["files"] == {}
    assert httpx.post(f"{place}/files", content=pack({"a": b"1"}), headers=kind).is_success
    assert httpx.get(f"{place}/files/a").content == b"1"


@pytest.fixture(scope="module")
def private(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, dict[str, str]]]:
    """A server with a private dataset of one robot, and the tokens of two."""
    data = tmp_path_factory.mktemp("private") / "data"
    made = ("token", "create", "-d", str(data), "--robot")
    tokens = {
        name: run_command(*made, name, check=True).stdout.strip() for name in ("owner", "stranger")
    }
    with running_server(data) as running:
        with DatasetClient(running.url, tokens["owner"]) as client:
            client.create("lab/Secret", private=True)
            client.put("lab/Secret", "shape", SECRET)
            client.snapshot("lab/Secret")
        yield running.url, tokens


ADDRESSES = [
    ("GET", ""),
    ("GET", "@1"),
    ("GET", "@head"),
    ("GET", "/files/shape"),
    ("GET", "@1/files/shape"),
    ("HEAD", "/files/shape"),
    ("PUT", "/files/shape"),
    ("DELETE", "/files/shape"),
    ("POST", "/files"),
    ("POST", "/snapshot"),
    ("POST", "/merge"),
    ("GET", "/diff?from=1&to=head"),
]


@pytest.mark.parametrize(("method", "rest"), ADDRESSES)
def test_a_private_dataset_is_not_there_for_a_stranger(private, method, rest):
    url, tokens = private
    body = {
        "/files": pack({"shape": b"other"}),
        "/merge": json.dumps({"source": "lab/Secret@1"}).encode(),
    }.get(rest, b"")
    kind = "application/cbor" if rest == "/files" else "application/json"

    def ask(name: str, token: str) -> httpx.Response:
        headers = {"Authorization": f"Bearer {token}", "Content-Type": kind}
        return httpx.request(
            method, f"{url}/datasets/lab/{name}{rest}", content=body, headers=headers
        )

    refused, unknown = ask("Secret", tokens["stranger"]), ask("Sekret", tokens["stranger"])
    assert refused.status_code == unknown.status_code == 404
    shown = f"{refused.text} {dict(refused.headers)}"
    assert hashlib.sha256(SECRET).hexdigest() not in shown
    assert SECRET.decode() not in shown
    assert "etag" not in refused.headers
    with DatasetClient(url, tokens["owner"]) as client:
        assert client.get("lab/Secret", "shape") == SECRET


def test_a_private_dataset_is_in_no_list_of_a_stranger_and_no_call_reads_it(private):
    url, tokens = private
    with DatasetClient(url, tokens["stranger"]) as client:
        assert "lab/Secret" not in client.names()
    with DatasetClient(url, tokens["owner"]) as client:
        assert "lab/Secret" in client.names()
    headers = {"Authorization": f"Bearer {tokens['stranger']}"}
    called = httpx.post(
        f"{url}/services/example/Kinematics/describe?data=robot:lab/Secret",
        json={}, headers=headers, timeout=60,
    )  # fmt: skip
    assert called.status_code == 422
    assert called.json()["type"].endswith("missing-data")
    digest = hashlib.sha256(SECRET).hexdigest()
    for place in (f"/api/blobs/{digest}", f"/api/blobs/sha256:{digest}"):
        assert httpx.get(url + place, headers=headers).status_code in (400, 404)
