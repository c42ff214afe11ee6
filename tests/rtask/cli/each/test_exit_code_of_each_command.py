"""Exit codes: 0 done, 1 "no" or nothing found, 2 a wrong call, 3 failed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click
import pytest

import rtask
from rtask.cli import main
from rtask.cli.changing.new_folder import NewFolder
from rtask.client import failures
from tests.clocks import PassedBySleeping
from tests.rtask.cli.each.tree import walk_commands
from tests.servers import running_server

pytestmark = pytest.mark.slow

_CALLS = {
    "ask": "a mug", "backup": "copy", "branch compare": "x", "branch drop": "x",
    "branch make": "x", "branch merge": "x", "contributors withdraw": "nao-1",
    "dataset create": "lab/x",
    "dataset diff": "lab/x 1", "dataset get": "lab/x a out", "dataset merge": "lab/x lab/y",
    "dataset prune": "lab/x a", "dataset put": "lab/x f.ttl", "dataset remove": "lab/x a",
    "dataset restore": "lab/x@1", "dataset show": "lab/x", "dataset snapshot": "lab/x",
    "entails": "urn:a urn:p 1", "episodes ask": "1", "episodes export": "out.mcap",
    "explain": "urn:a urn:p 1", "objects forget": "x", "objects merge": "x y",
    "objects mesh": "x",
    "objects name": "x --as y", "objects show": "x", "objects split": "x v",
    "objects undo": "c-1", "ontology show": "Mug", "ontology unload": "urn:o",
    "ontology upgrade": "f.ttl", "plan": "every cup into the box", "proposals adopt": "1",
    "proposals refuse": "1", "proposals show": "1", "query": "ASK{}",
    "questions answer": "urn:q 1", "recognise": "p.png",
    "rules add": "r.rq", "rules remove": "x", "rules show": "x", "search": "x",
    "service benchmark": "b.toml", "service call": "a/b c", "service save": "f.json",
    "service show": "a/b", "simulate crew": "every cup into the left box",
    "tasks cancel": "urn:t --reason x", "tasks tree": "urn:t", "teach": "x p.png",
    "token expire": "x 1d", "token revoke": "x", "undo": "1", "update": "INSERT{}WHERE{}",
    "where": "mug", "simulate why": "urn:t", "why": "urn:t", "world export": "scene.glb",
}  # fmt: skip
"""Arguments of a call that is right where there is a graph."""
_RUNNING = {
    "demo", "serve", "simulate act-serve", "simulate fetch", "ros node", "ros2 dds serve", "mcp",
    "worker", "doctor", "ros doctor", "ros2 doctor",
}  # fmt: skip
"""Commands that wait for others, or whose report is about what cannot be reached."""
_MAKING = {
    "load", "rules add", "simulate crew", "teach", "token create", "update", "episodes import",
}  # fmt: skip
"""Commands that make a knowledge base where there is none."""
_OF_FILES = {"grasp push", "grasp space", "grasp batch"}
"""Commands whose argument is a file first, so that a wrong one is a wrong call."""
_ROBOT_CALLS = {
    "robot reach": ".4 0 .2",
    "simulate film": "out.mp4",
    "simulate ros-reach": ".4 0 .2",
}
Run = Callable[..., int]


def _with(option: str) -> dict[str, click.Command]:
    return {
        name: command
        for name, command in walk_commands()
        if any(option in parameter.opts for parameter in command.params)
    }


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    monkeypatch.chdir(tmp_path)
    for variable in ("RTASK_DATA", "RTASK_SERVER"):
        monkeypatch.delenv(variable, raising=False)

    def call(*arguments: str) -> int:
        with pytest.raises(SystemExit) as caught:
            main(list(arguments))
        assert "Traceback" not in capsys.readouterr().err
        return int(caught.value.code or 0)

    return call


def _write_files(folder: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    import numpy as np

    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    cv2.imwrite(str(folder / "p.png"), noise)
    (folder / "f.ttl").write_text("<urn:a> <urn:p> 1 .")
    (folder / "f.json").write_text("{}")
    (folder / "c.jsonl").write_text("{}\n")
    (folder / "b.toml").write_text('method = "run"\nservices = ["a/b"]\ncases = "c.jsonl"\n')
    (folder / "r.rq").write_text("CONSTRUCT { ?a <urn:q> ?b } WHERE { ?a <urn:p> ?b }")


def test_a_wrong_call_of_any_command_ends_with_2(run: Run) -> None:
    codes = {name: run(*name.split(), "--no-such-option") for name, _ in walk_commands()}
    assert {name: code for name, code in codes.items() if code != 2} == {}
    needing = {
        name
        for name, command in walk_commands()
        if any(parameter.required for parameter in command.params)
    }
    codes = {name: run(*name.split()) for name in sorted(needing)}
    assert {name: code for name, code in codes.items() if code != 2} == {}


def test_where_the_folder_is_no_graph_each_command_ends_with_2(run: Run, tmp_path: Path) -> None:
    _write_files(tmp_path)
    names = sorted(_with("--data").keys() - _RUNNING - _MAKING - _OF_FILES)
    codes = {
        name: run(*name.split(), *_CALLS.get(name, "").split(), "--data", "nowhere")
        for name in names
    }
    assert {name: code for name, code in codes.items() if code != 2} == {}
    assert not (tmp_path / "nowhere").exists()


def test_a_file_or_folder_that_is_not_what_a_command_takes_ends_with_2(
    run: Run, tmp_path: Path
) -> None:
    _write_files(tmp_path)
    (tmp_path / "folder").mkdir()
    with rtask.open(tmp_path / "kb", ontologies=False):
        pass
    calls = (
        "camera folder", "episodes import folder --data kb", "grasp scene folder",
        "ontology upgrade folder --data kb", "query --file folder --data kb",
        "query ASK{} --data f.ttl", "recognise folder", "restore folder new",
        "update --file folder --data kb", "validate --shapes folder --data kb",
    )  # fmt: skip
    codes = {call: run(*call.split()) for call in calls}
    assert {call: code for call, code in codes.items() if code != 2} == {}


def test_a_graph_that_is_damaged_ends_with_3(run: Run, tmp_path: Path) -> None:
    (tmp_path / "kb").mkdir()
    (tmp_path / "kb" / "kb.json").write_text("{}")
    assert run("stats", "--data", "kb") == 3


def test_the_name_of_a_robot_that_is_not_there_ends_every_command_with_1(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    of_kinds = _with("--robot").keys() - _with("--data").keys() - _with("--server").keys()
    calls = [f"{name} {_ROBOT_CALLS.get(name, '')} --robot xyzzy" for name in sorted(of_kinds)]
    named = ("robot check", "robot remove", "robot restore", "robot srdf", "simulate urdf")
    calls += [*(f"{name} xyzzy" for name in named), "study tasks --arms xyzzy"]
    codes = {call: run(*call.split()) for call in calls}
    assert {call: code for call, code in codes.items() if code != 1} == {}


_FAILING = {
    "episodes import": ("none.mcap", "f.ttl"),
    "load": ("none.ttl", "f.ttl --graph xyzzy"),
    "rules add": ("none.rq",),
    "simulate crew": ("every cup into the left box --table xyzzy",),
    "teach": ("cup f.ttl", "urn://x p.png"),
    "token create": ("--robot a/b", "--role reader --right read:xyzzy"),
    "update": ("INSERT",),
}
"""Calls that fail, of the commands that make a knowledge base where there is none."""


def test_a_command_that_fails_makes_no_graph(run: Run, tmp_path: Path) -> None:
    _write_files(tmp_path)
    assert _FAILING.keys() == _MAKING
    (tmp_path / "empty").mkdir()
    before = {path: path.is_dir() for path in tmp_path.rglob("*")}
    calls = [
        f"{name} {call} --data {data}"
        for name, (first, *others) in _FAILING.items()
        for call, data in ((first, "empty"), *((other, "deep/new") for other in others))
    ]
    codes = {call: run(*call.split()) for call in calls}
    assert {call: code for call, code in codes.items() if code not in (1, 2, 3)} == {}
    assert {path: path.is_dir() for path in tmp_path.rglob("*")} == before


def test_a_dry_run_makes_no_graph(run: Run, tmp_path: Path) -> None:
    _write_files(tmp_path)
    assert run("load", "f.ttl", "--dry-run", "--data", "new") == 0
    assert not (tmp_path / "new").exists()


def test_what_was_loaded_before_a_failure_stays_and_can_be_undone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f.ttl").write_text("<urn:a> <urn:p> 1 .")
    with pytest.raises(SystemExit) as caught:
        main(["load", "f.ttl", "none.ttl", "--data", "new"])
    assert caught.value.code in (2, 3)
    assert "undo: rtask " in capsys.readouterr().err
    with rtask.open(tmp_path / "new", mode="r") as kb:
        assert kb.query("ASK { <urn:a> <urn:p> 1 }")


def test_a_folder_that_another_process_has_begun_to_use_is_not_removed(tmp_path: Path) -> None:
    with NewFolder(tmp_path / "new"):
        kb = rtask.open(tmp_path / "new", ontologies=False)
    kb.close()
    rtask.open(tmp_path / "new", mode="r").close()


def test_where_no_server_answers_each_command_ends_with_3(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _write_files(tmp_path)
    monkeypatch.setattr(failures, "time", PassedBySleeping())  # half a minute of tries
    names = sorted(_with("--server").keys() - _RUNNING - _OF_FILES)
    codes = {
        name: run(*name.split(), *_CALLS.get(name, "").split(), "--server", "http://127.0.0.1:1")
        for name in names
    }
    assert {name: code for name, code in codes.items() if code != 3} == {}


def test_commands_that_find_nothing_end_with_1(run: Run, tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", base="urn:lab/") as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", "nao-1")
    calls = (
        "ask which robot fails at cartons", "contributors list", "entails urn:a urn:p 2",
        "episodes ask 1", "episodes ask 1 --json", "episodes list", "explain urn:a urn:p 2",
        "feedback", "history urn:b", "objects list", "objects show x", "proposals list",
        "query ASK{<urn:a><urn:p>2}", "rules list", "rules show x", "search xyzzy", "tasks list",
        "token list", "where mug", "objects show urn:b", "ontology unload urn:b",
    )  # fmt: skip
    codes = {call: run(*call.split(), "--data", "kb") for call in calls}
    assert {call: code for call, code in codes.items() if code != 1} == {}


def test_what_a_server_does_not_find_ends_with_1_as_in_a_folder(run: Run, tmp_path: Path) -> None:
    calls = (
        "contributors withdraw nao-1", "dataset show lab/x", "feedback", "objects show x",
        "questions answer urn:q 1", "rules show x", "service show a/b",
        "tasks cancel urn:t --reason x", "tasks tree urn:t", "why urn:t",
    )  # fmt: skip
    with running_server(tmp_path / "kb") as server:
        codes = {call: run(*call.split(), "--server", server.url) for call in calls}
        assert run("undo", "1", "--server", server.url) == 2
    assert {call: code for call, code in codes.items() if code != 1} == {}
