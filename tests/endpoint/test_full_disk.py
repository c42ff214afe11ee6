"""A server whose disk is full starts, answers reads, and says where there is no room."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from shutil import disk_usage
from urllib.parse import urlencode

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.commands import _opened
from endpoint.http.messages import Request
from endpoint.settings import Config
from rtask.engine import Engine
from rtask.kb.commit import committer
from rtask.kb.durability.disk_space import RESERVE_BYTES
from rtask.kb.store import commit_writes, embedded
from rtask.knowledge_base import KnowledgeBase
from tests.servers import new_application

pytestmark = pytest.mark.slow
_LARGE = 10_000


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    if os.geteuid() != 0:
        pytest.skip("mounting a small disk needs root")
    command = ["mount", "-t", "tmpfs", "-o", "size=40m", "tmpfs", str(place)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no file systems can be mounted here")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def _fill(place: Path, leave: int = 0) -> None:
    """Fill a disk but for so many bytes."""
    with (place / "ballast").open("wb", buffering=0) as file:
        try:
            while not leave or disk_usage(place).free > leave:
                file.write(bytes(4096))
        except OSError:
            return


def _make(folder: Path) -> None:
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    TokenStore(folder).close()


def test_a_full_disk_leaves_reading_and_names_the_place(
    small_disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = small_disk / "kb"
    _make(folder)
    _fill(small_disk)
    with ExitStack() as stack:
        kb = _opened("", folder, False, "os", None)
        assert isinstance(kb, KnowledgeBase)
        stack.enter_context(kb)
        assert f"0.0 MB are free at {folder}" in capsys.readouterr().err
        tokens = stack.enter_context(closing(TokenStore(folder)))
        engine = stack.enter_context(Engine(kb))
        application = new_application(kb, engine, tokens, Config(rate=0, write_rate=0))
        stack.callback(application.close)
        kb.publish(url="http://localhost")

        def status(method: str, path: str, **form: str) -> tuple[int, str]:
            headers = {"host": "localhost", "content-type": "application/x-www-form-urlencoded"}
            body = urlencode(form).encode()
            request = Request(method, path, "", headers, body, site="http://localhost")
            answer = application.handle(request)
            return answer.status, answer.body.decode()

        assert status("POST", "/sparql", query="ASK { <urn:a> <urn:p> 1 }")[0] == 200
        for path in ("/update", "/backup"):
            refused, words = status("POST", path, update="CLEAR ALL")
            assert refused == 507
            assert f"0.0 MB are free at {folder}" in words
    (small_disk / "ballast").unlink()
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        assert kb.update("INSERT DATA { <urn:a> <urn:p> 2 }").seq == 2


def test_the_reserve_of_a_killed_process_opens_the_folder_on_a_full_disk(small_disk: Path) -> None:
    folder = small_disk / "kb"
    _make(folder)
    (folder / "reserve").write_bytes(bytes(RESERVE_BYTES))  # as a process leaves that is killed
    _fill(small_disk)
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
        assert not (folder / "reserve").exists()


def test_an_upload_that_fills_the_disk_is_refused_and_leaves_nothing(
    small_disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (committer, commit_writes, embedded):
        monkeypatch.setattr(module, "LARGE", _LARGE)  # stored in steps, of which one finds no room
    folder = small_disk / "kb"
    _make(folder)
    # Room for the journal's record and for a part of what goes into the store.
    _fill(small_disk, leave=22 << 20)
    lines = (f'<urn:s{i}> <urn:p> "{i}{"x" * 1_100}" .\n' for i in range(_LARGE + 1))
    body = "".join(lines).encode()
    count = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o FILTER(STRSTARTS(STR(?s), 'urn:s')) }"
    with ExitStack() as stack:
        kb = stack.enter_context(rtask.open(folder, ontologies=False, reason=False))
        tokens = stack.enter_context(closing(TokenStore(folder)))
        engine = stack.enter_context(Engine(kb))
        application = new_application(kb, engine, tokens, Config(rate=0, write_rate=0))
        stack.callback(application.close)
        for method, free in (("PUT", 0), ("POST", 1)):
            headers = {"host": "localhost", "content-type": "application/n-triples"}
            site = "http://localhost"
            request = Request(method, "/store", "graph=urn:g", headers, body, site=site)
            assert application.handle(request).status == 507
            if free:
                (small_disk / "ballast").unlink()
        assert kb.update("INSERT DATA { <urn:a> <urn:p> 2 }").seq == 2
        assert kb.verify() == []
        assert next(iter(kb.query(count)))["n"].value == "0"
