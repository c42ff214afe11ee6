"""The commands as a family: option names, JSON, servers, exit codes, advice."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

import ontology
import rtask
from rtask.cli import main
from tests.commands import run_command
from tests.rtask.cli.each.tree import walk_commands
from tests.servers import running_server

pytestmark = pytest.mark.slow

_ROOT = Path(__file__).resolve().parents[3]
_GRAPH = "urn:lab/graph/agent/nao-1"
Run = Callable[..., tuple[int, str, str]]
_USED_IN_TWO_WAYS = {
    "--limit": "serve: of a rate",
    "--store": "serve: where statements are; grasp push, space: whether to store",
    "--count": "ros2 dds save: -n is a topic's number there",
}
_FORMER = {"--url", "--by", "--operator", "--processes", "--view", "--output", "--endpoint"}
"""Names that other commands gave to what is called --server, --agent, --workers, --gui, --out."""
_OF_FILES = {
    "backup": "copies the folder; a server copies its own by POST /backup",
    "demo": "runs a server of its own",
    "doctor": "looks at this machine",
    "episodes export": "reads pictures and clouds of the folder",
    "episodes list": "as export",
    "episodes import": "writes pictures and clouds into the folder",
    "grasp space": "a server plans by its operation plan_in_space",
    "history": "reads the journal, whose statements no address gives",
    "objects twins": "reads the views of the folder",
    "load": "loads files of this machine; a server takes them by the graph store protocol",
    "ontology unload": "maintenance", "ontology upgrade": "maintenance",
    "migrate": "maintenance", "quarantine": "maintenance", "rebuild": "maintenance",
    "validate": "maintenance",
    "verify": "maintenance", "reason": "builds a closure of its own",
    "serve": "is the server",
    "token create": "an operator's, on the machine of the server", "token expire": "as create",
    "token list": "as create", "token revoke": "as create",
    **dict.fromkeys(
        ("branch list", "branch make", "branch compare", "branch merge", "branch drop"),
        "an operator's, on the machine of the server; robots use the address /branches",
    ),
    "proposals list": "an operator's, on the machine of the server",
    "proposals show": "as list", "proposals adopt": "as list", "proposals refuse": "as list",
}  # fmt: skip
# What prints nothing but a file in a format of its own or the output of a script of the user, or
# talks until it is interrupted.
_WITHOUT_JSON = {
    "help", "serve", "act-serve", "urdf", "changes", "mcp", "node", "ros", "ros2", "run",
    "call",  # of ROS 2: prints JSON anyhow
    "tree",  # of tasks: prints XML; tasks list has it in JSON
}  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("spirit") / "kb"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(
            f"PREFIX rdfs: <{ontology.PREFIXES['rdfs']}> PREFIX rt: <{ontology.NS}> "
            'INSERT DATA { <urn:mug> a rt:Mug ; rdfs:label "blue mug" }',
            "nao-1",
        )
    return folder


@pytest.fixture
def run(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    shutil.copytree(made, tmp_path / "kb")

    def call(*arguments: str, folder: bool = True) -> tuple[int, str, str]:
        where = ["--data", str(tmp_path / "kb")] if folder else []
        with pytest.raises(SystemExit) as caught:
            main([*arguments, *where])
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return call


def test_each_command_can_print_json() -> None:
    without = {
        name
        for name, command in walk_commands()
        if not any("--json" in parameter.opts for parameter in command.params)
    }
    assert {name.split()[-1] for name in without} <= _WITHOUT_JSON


def test_an_address_in_the_place_of_a_folder_is_refused_with_the_option_that_takes_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["query", "-d", "http://127.0.0.1:7878", "ASK {}"])
    assert caught.value.code == 2
    words = " ".join(capsys.readouterr().err.split())
    assert "http://127.0.0.1:7878 is an address" in words
    assert "--server" in words


def test_the_json_of_each_command_is_parsed_by_a_test() -> None:
    files = [path.read_text(encoding="utf-8") for path in (_ROOT / "tests").rglob("test_*.py")]
    parsing = [text for text in files if "--json" in text and "json.loads" in text]

    def is_parsed(name: str) -> bool:
        *groups, last = name.split()
        called = f"invoke({last.replace('-', '_')}, "
        return any(
            called in text or (f'"{last}"' in text and all(group in text for group in groups))
            for text in parsing
        )

    printing = {
        name
        for name, command in walk_commands()
        if any("--json" in parameter.opts for parameter in command.params)
    }
    assert {name for name in printing if not is_parsed(name)} == set()


def _options(command: click.Command) -> list[click.Option]:
    return [one for one in command.params if isinstance(one, click.Option)]


def test_an_option_is_called_and_used_the_same_by_all_commands() -> None:
    uses: dict[str, dict[tuple[bool, tuple[str, ...]], str]] = {}
    meanings: dict[str, set[str]] = {}
    for name, command in walk_commands():
        for one in _options(command):
            long = next(opt for opt in one.opts if opt.startswith("--"))
            short = tuple(opt for opt in one.opts if not opt.startswith("--"))
            uses.setdefault(long, {})[one.is_flag, short] = name
            for letter in short:
                meanings.setdefault(letter, set()).add(long)
    assert {long: found for long, found in uses.items()
            if len(found) > 1 and long not in _USED_IN_TWO_WAYS} == {}  # fmt: skip
    several = {letter: found for letter, found in meanings.items() if len(found) > 1}
    assert several == {"-n": {"--limit", "--trials", "--count", "--demos"}}  # always: how many
    assert _FORMER & uses.keys() == set()


def test_commands_on_a_graph_ask_a_server_too_or_have_a_reason() -> None:
    without = set()
    for name, command in walk_commands():
        opts = {opt for one in _options(command) for opt in one.opts}
        if "--data" in opts and "--server" not in opts:
            without.add(name)
    assert without == _OF_FILES.keys()


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ("query", "SELECT * { <urn:mug> ?p ?o }"),
        ("update", "INSERT DATA { <urn:a> <urn:p> 1 }"),
        ("search", "mug"),
        ("stats",),
        ("history", "urn:mug", "-s"),
        ("explain", "urn:mug", "a", "rt:Container"),
        ("entails", "urn:mug", "a", "rt:Container"),
        ("episodes", "list"),
        ("rules", "list"),
        ("token", "list"),
        ("token", "create", "--robot", "nao-2"),
        ("ontology", "list"),
        ("verify",),
        ("validate",),
        ("quarantine",),
        ("rebuild",),
        ("feedback",),
        ("reason",),
    ],
    ids=lambda arguments: " ".join(arguments[:2])[:20],
)
def test_json_is_json_and_nothing_else(run: Run, arguments: tuple[str, ...]) -> None:
    _, out, _ = run(*arguments, "--json")
    json.loads(out)


@pytest.mark.parametrize(
    "arguments",
    [
        ("ontology", "patches"),
        ("ontology", "show", "rt:Mug", "--source", "bundled"),
        ("robot", "list"),
        ("service", "list"),
        ("service", "show", "example/Kinematics"),
        ("service", "call", "example/Kinematics", "describe"),
        ("service", "call", "example/Kinematics", "describe", "--dataset", "robot=robots/Point"),
    ],
    ids=" ".join,
)
def test_json_of_commands_without_a_graph(run: Run, arguments: tuple[str, ...]) -> None:
    code, out, _ = run(*arguments, "--json", folder=False)
    assert code == 0
    json.loads(out)


def test_json_of_commands_that_change_tokens(run: Run) -> None:
    made = json.loads(run("token", "create", "--robot", "nao-2", "--json")[1])
    ends = json.loads(run("token", "expire", made["id"], "12h", "--json")[1])
    assert ends["id"] == made["id"]
    assert json.loads(run("token", "revoke", made["id"], "--json")[1])["id"] == made["id"]


def test_json_of_commands_about_ontologies(run: Run, tmp_path: Path) -> None:
    def told(*arguments: str) -> Any:
        return json.loads(run("ontology", *arguments, "--json", folder=False)[1])

    assert told("path", ontology.ONTOLOGY)["path"].endswith("rtask.ttl")
    (tmp_path / "old.ttl").write_text("<urn:a> a <http://www.w3.org/2002/07/owl#Class> .")
    (tmp_path / "new.ttl").write_text("<urn:b> a <http://www.w3.org/2002/07/owl#Class> .")
    assert told("diff", str(tmp_path / "old.ttl"), str(tmp_path / "new.ttl"))
    assert told("docs", "--source", str(tmp_path / "old.ttl"), "--out", str(tmp_path / "pages"))


def test_json_of_commands_that_write_files(run: Run, tmp_path: Path) -> None:
    copy, again, dump = (str(tmp_path / name) for name in ("copy", "again", "dump.nt"))
    assert json.loads(run("backup", copy, "--json")[1])["target"] == copy
    assert json.loads(run("restore", copy, again, "--json", folder=False)[1])["target"] == again
    assert json.loads(run("export", dump, "-g", _GRAPH, "--json")[1])["statements"] == 2
    classes = str(tmp_path / "classes.py")
    written = run("model", "generate", "--out", classes, "--json", folder=False)[1]
    assert json.loads(written)["path"] == classes


@pytest.mark.parametrize(
    "arguments",
    [
        ("search", "nonexistent"),
        ("query", "SELECT * { <urn:nobody> ?p ?o }"),
        ("query", "SELECT * { <urn:nobody> ?p ?o }", "--json"),
        ("query", "SELECT * { <urn:nobody> ?p ?o }", "--format", "csv"),
        ("query", "CONSTRUCT { ?s ?p ?o } { <urn:nobody> ?p ?o, ?s }", "--format", "turtle"),
        ("query", "ASK { <urn:nobody> ?p ?o }"),
        ("query", "ASK { <urn:nobody> ?p ?o }", "--format", "xml"),
        ("history", "urn:nobody"),
        ("feedback",),
        ("rules", "list"),
        ("rules", "list", "--json"),
        ("token", "list"),
        ("token", "list", "--json"),
        ("episodes", "list"),
        ("episodes", "list", "--json"),
    ],
    ids=lambda arguments: " ".join(arguments)[:40],
)
def test_exit_code_is_1_where_nothing_is_found(run: Run, arguments: tuple[str, ...]) -> None:
    assert run(*arguments)[0] == 1


@pytest.mark.parametrize("form", ["json", "xml", "csv", "tsv"])
def test_exit_code_is_0_where_something_is_found(run: Run, form: str) -> None:
    assert run("query", "SELECT ?o { <urn:mug> a ?o }", "--format", form)[0] == 0


def test_a_wrong_option_says_what_may_be_meant(run: Run) -> None:
    code, _, err = run("query", "--tiemout", "3", "ASK {}")
    assert code == 2
    assert "Did you mean" in err
    assert "--timeout" in err


def test_where_the_graph_is_not_the_error_says_where_one_is(
    tmp_path: Path, made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(made, tmp_path / "rtask-demo" / "store")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RTASK_DATA", raising=False)
    with pytest.raises(SystemExit):
        main(["stats"])
    assert "there is one here: --data rtask-demo/store" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["restore", "rtask-demo/store", "again"])
    assert capsys.readouterr().err.endswith("is not a complete backup: backup.json is missing\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ("backup", "copy"),
        ("verify", "--repair"),
        ("rebuild", "all"),
        ("quarantine", "--release"),
        ("ontology", "unload", "urn:o"),
        ("ontology", "upgrade", "urn:o", "--undo"),
        ("rules", "remove", "r"),
        ("feedback",),
        ("contributors", "withdraw", "nao-1"),
        ("objects", "undo", "urn:c"),
        ("ask", "a", "mug"),
    ],
    ids=" ".join,
)
def test_a_command_that_needs_a_graph_does_not_make_one(
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main([*arguments, "--data", "mispelt"])
    assert caught.value.code == 2
    assert "mispelt is not a knowledge base" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_completion_knows_commands_and_options() -> None:
    def completed(words: str, at: int) -> str:
        environment = {
            **os.environ,
            "COMP_WORDS": words,
            "COMP_CWORD": str(at),
            "_RTASK_COMPLETE": "bash_complete",
        }
        return run_command(environment=environment).stdout

    assert "plain,export\n" in completed("rtask exp", 1)
    assert "plain,--server\n" in completed("rtask query --s", 2)


@pytest.mark.slow
def test_commands_that_read_ask_a_server(made: Path, tmp_path: Path, run: Run) -> None:
    served = tmp_path / "served"
    shutil.copytree(made, served)
    with running_server(served) as server:
        url = server.url

        def ask(*arguments: str) -> tuple[int, str, str]:
            return run(*arguments, "--server", url, folder=False)

        assert ask("query", "ASK { <urn:mug> a rt:Container }")[1] == "yes\n"
        code, out, _ = ask("query", "SELECT ?o { <urn:mug> a ?o }", "--json")
        assert code == 0
        assert json.loads(out)["results"]["bindings"]
        assert ask("search", "blue", "mug")[1] == "urn:mug  blue mug\n"
        assert ask("search", "blue", "--class", "mug")[1] == "urn:mug  blue mug\n"
        assert ask("search", "nonexistent")[0] == 1
        assert json.loads(ask("stats", "--json")[1])["graphs"][_GRAPH] == 2
        assert ontology.ONTOLOGY in ask("ontology", "list")[1]
        assert ask("export", "-", "--graph", _GRAPH, "--format", "ntriples")[0] == 0
        assert ask("update", "INSERT DATA { <urn:a> <urn:p> 1 }")[1] == "done\n"
        assert ask("query", "ASK { <urn:a> <urn:p> 1 }")[0] == 0
        assert ask("feedback")[0] == 1
        code, out, _ = ask("explain", "urn:mug", "a", "rt:Container", "--json")
        here = json.loads(run("explain", "urn:mug", "a", "rt:Container", "--json")[1])
        there = json.loads(out)
        assert there.pop("commit") == here.pop("commit") + 1  # of the update above
        assert (code, there) == (0, here)
        assert ask("explain", "urn:mug", "a", "rt:Robot")[0] == 1
        code, out, _ = ask("entails", "urn:mug", "a", "rt:Container")
        assert (code, out.splitlines()[0]) == (0, "yes")
        assert "rt:Container" in out  # the proof
        (tmp_path / "more.ttl").write_text("<urn:mug> a <urn:Teapot> .")
        code, out, _ = ask("entails", str(tmp_path / "more.ttl"))
        assert code == 1
        assert "missing: <urn:mug>" in out


_SILENT_WORK = """
import sys, time
import click
from rtask.cli import cli, main

@cli.command()
@click.option("--json", "as_json", is_flag=True)
def brood(as_json):
    sys.stdin.readline()  # until whoever watches saw the line
    click.echo('{"eggs": 3}')

main(["brood"])
"""


def test_every_command_that_is_silent_for_long_tells_that_it_is_at_work() -> None:
    """The line is on the terminal only, goes before the first word, and comes to no pipe."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", _SILENT_WORK]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=theirs, text=True, cwd=_ROOT
    ) as child:
        os.close(theirs)
        shown = b""
        while b"rtask brood is at work ... " not in shown:
            shown += os.read(ours, 1000)  # waits; ends with an error if the child does
        out, _ = child.communicate("\n", timeout=60)
        with contextlib.suppress(OSError):  # Linux: the other end was closed
            while piece := os.read(ours, 1000):
                shown += piece
    os.close(ours)
    assert out == '{"eggs": 3}\n'
    assert shown.endswith(b"\r\x1b[K")
    assert child.returncode == 0
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=_ROOT,
    ) as piped:  # fmt: skip
        assert piped.communicate("\n", timeout=60) == ('{"eggs": 3}\n', "")
