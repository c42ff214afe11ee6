"""``rtask rules`` and ``rtask load`` of files with rules."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import rtask
from rtask.cli import cli
from tests.servers import RunningServer, running_server

TEXT = (
    "# What is on something is above it.\nCONSTRUCT { ?a <urn:above> ?b } WHERE { ?a <urn:on> ?b }"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with rtask.open(tmp_path / "kb", ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:on> <urn:b> }")
    (tmp_path / "on-above.rq").write_text(TEXT)
    return tmp_path


def run(folder: Path, *arguments: str, text: str | None = None) -> Result:
    given = [*arguments, "--data", str(folder / "kb")]
    return CliRunner().invoke(cli, given, input=text, env={"RTASK_DATA": ""})


@pytest.mark.slow
def test_rules_are_added_listed_shown_and_removed(folder: Path) -> None:
    done = run(folder, "rules", "add", str(folder / "on-above.rq"))
    assert done.stdout == "1 rule added, 1 statements derived\n", done.output
    other = "CONSTRUCT { ?b <urn:below> ?a } WHERE { ?a <urn:on> ?b }"
    (folder / "both.rq").write_text(f"# rule: on-above\n{TEXT}\n# rule: below\n{other}")
    done = run(folder, "rules", "add", str(folder / "both.rq"))
    assert done.stdout == "1 rule added, 1 statements derived\n", done.output
    assert run(folder, "rules", "remove", "below").exit_code == 0
    assert run(folder, "rules", "list").output.startswith("on-above  ")
    (listed,) = json.loads(run(folder, "rules", "list", "--json").output)
    assert listed["comment"] == "What is on something is above it."
    assert TEXT in run(folder, "rules", "show", "on-above").output
    assert run(folder, "explain", "<urn:a>", "<urn:above>", "<urn:b>").output.startswith(
        "<urn:a> <urn:above> <urn:b> "
    )
    removed = json.loads(run(folder, "rules", "remove", "on-above", "--json").output)
    assert (removed["removed"], removed["withdrawn"]) == (["on-above"], 1)
    assert run(folder, "rules", "list").exit_code == 1


@pytest.mark.slow
def test_load_takes_a_file_of_rules(folder: Path) -> None:
    (report,) = json.loads(run(folder, "load", str(folder / "on-above.rq"), "--json").output)
    assert (report["files"][0]["format"], report["files"][0]["derived"]) == ("rules", 1)
    dry = run(folder, "load", str(folder / "on-above.rq"), "--dry-run")
    assert dry.exit_code == 0


@pytest.mark.slow
def test_a_rule_comes_from_standard_input_with_a_label(folder: Path) -> None:
    assert "needs --label" in str(run(folder, "rules", "add", "-", text=TEXT).exception)
    done = run(folder, "rules", "add", "-", "--label", "stacking", "--json", text=TEXT)
    assert done.exception is None, done.exception
    assert json.loads(done.output)["rules"] == ["stacking"]


@pytest.mark.slow
def test_a_robot_may_not_add_rules(folder: Path) -> None:
    done = run(folder, "rules", "add", str(folder / "on-above.rq"), "--agent", "nao-1")
    assert "right of its own" in str(done.exception)
    assert run(folder, "rules", "list").exit_code == 1


@pytest.mark.slow
def test_a_faulty_file_is_told_with_its_line(folder: Path) -> None:
    (folder / "bad.rq").write_text(TEXT.replace("WHERE", "\nWERE"))
    done = run(folder, "rules", "add", str(folder / "bad.rq"))
    assert "rule 'bad' 3:1: unknown word 'WERE'; did you mean 'WHERE'?" in str(done.exception)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    data = tmp_path_factory.mktemp("served") / "kb"
    with rtask.open(data, ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:on> <urn:b> }")
    with running_server(data) as running:
        yield running


def make_token(server: RunningServer, *options: str) -> str:
    given = ["token", "create", "--data", str(server.data), "--json", *options]
    done = CliRunner().invoke(cli, given)
    assert done.exception is None, done.output
    return str(json.loads(done.output)["token"])


@pytest.mark.slow
def test_rules_of_a_server_are_handled_in_the_same_words(
    folder: Path, server: RunningServer
) -> None:
    """Every command is run on a folder and on a server; only numbers of commits differ."""
    (folder / "on-under.rq").write_text(TEXT.replace("?a <urn:above> ?b", "?b <urn:under> ?a"))
    files = [str(folder / name) for name in ("on-above.rq", "on-under.rq")]
    token = make_token(server, "--role", "admin")
    made = ("commit", "time", "author", "iri")

    def both(*arguments: str) -> Result:
        here = run(folder, *arguments)
        given = [*arguments, "--server", server.url]
        there = CliRunner().invoke(cli, given, env={"RTASK_TOKEN": token})
        assert here.exit_code == there.exit_code, there.exception
        assert str(here.exception) == str(there.exception)
        if "--json" in arguments:
            told = [
                [
                    {key: value for key, value in one.items() if key not in made}
                    for one in (found if isinstance(found, list) else [found])
                ]
                for found in (json.loads(here.output), json.loads(there.output))
            ]
            assert told[0] == told[1]
        elif arguments[1] in ("add", "remove"):
            assert here.stdout == there.stdout
        return there

    added = json.loads(both("rules", "add", *files, "--json").output)
    assert (added["rules"], added["derived"]) == (["on-above", "on-under"], 2)
    assert both("rules", "add", *files).output.startswith("nothing new")
    assert len(json.loads(both("rules", "list", "--json").output)) == 2
    assert TEXT in both("rules", "show", "on-above").output
    shown = json.loads(both("rules", "show", "on-above", "--json").output)
    assert shown["comment"] == "What is on something is above it."
    assert "did you mean" in str(both("rules", "show", "on-abov").exception)
    (folder / "on-above.rq").write_text(TEXT.replace("urn:above", "urn:over"))
    assert "there is another rule" in str(both("rules", "add", files[0]).exception)
    assert both("rules", "add", files[0], "--replace").stdout.endswith("1 statements derived\n")
    (folder / "bad.rq").write_text(TEXT.replace("WHERE", "\nWERE"))
    assert "3:1: unknown word" in str(both("rules", "add", str(folder / "bad.rq")).exception)
    assert "no rule 'none'" in str(both("rules", "remove", "on-above", "none").exception)
    assert len(json.loads(both("rules", "list", "--json").output)) == 2  # all or nothing
    removed = json.loads(both("rules", "remove", "on-above", "on-under", "--json").output)
    assert removed["withdrawn"] == 2
    assert both("rules", "list").exit_code == 1


@pytest.mark.slow
def test_a_server_takes_rules_from_those_who_may_add_them(
    folder: Path, server: RunningServer
) -> None:
    given = ["rules", "add", str(folder / "on-above.rq"), "--server", server.url]
    robot = make_token(server, "--robot", "nao-1")
    refused = CliRunner().invoke(cli, given, env={"RTASK_TOKEN": robot})
    assert "right of its own" in str(refused.exception)
    named = CliRunner().invoke(cli, [*given, "--agent", "nao-1"])
    assert "by RTASK_TOKEN" in str(named.exception)
    nowhere = CliRunner().invoke(cli, ["rules", "list", "--server", "http://127.0.0.1:9"])
    assert "cannot be reached" in str(nowhere.exception)
