"""What a command prints of outcomes says, in one line, how to see what it rests on."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

import rtask
from rtask.cli import main
from simulate.demo.recorded import unpack

pytestmark = pytest.mark.slow

Run = Callable[..., tuple[int, str, str]]
ROBOTS = ("nao-1", "nao-2", "panda-3")
"""Of the recorded demo: each tried to grasp."""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the store that a demo left."""
    return Path(unpack(tmp_path_factory.mktemp("recorded") / "demo")["store"])


@pytest.fixture
def run(store: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: str) -> tuple[int, str, str]:
        where = () if "--data" in words else ("--data", str(store))
        with pytest.raises(SystemExit) as ended:
            main([*words, *where])
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return call


def why(run: Run, *words: str) -> str:
    """Return what the command prints that a call names as its reason."""
    printed = run(*words)[2]
    (line,) = [line for line in printed.splitlines() if line.startswith("why: ")]
    code, out, _ = run(*shlex.split(line.removeprefix("why: rtask ")))
    assert code == 0, line
    return out


@pytest.mark.parametrize(
    "words",
    [
        ("ask", "how often did each robot succeed in grasping?"),
        ("contributors", "list"),
        ("plan", "carton-105 into the left box", "--assume-reach"),
        ("where", "carton-105"),
    ],
    ids=lambda words: words[0],
)
def test_the_reason_of_a_number_names_robots(run: Run, words: tuple[str, ...]) -> None:
    assert any(name in why(run, *words) for name in ROBOTS)


def test_a_share_leads_to_the_outcomes_and_agrees_with_their_number(run: Run) -> None:
    shown = why(run, "ask", "how often did each robot succeed in grasping?")
    share, *outcomes = shown.splitlines()
    assert share == "2 of 4 held: nao-1 2 of 4"
    assert [line.count("counts: held") for line in outcomes].count(1) == 2
    assert len(outcomes) == 4


def test_the_chances_of_a_plan_lead_to_a_query_for_the_outcomes(run: Run) -> None:
    shown = why(run, "plan", "carton-105 into the left box", "--assume-reach")
    line = next(line for line in shown.splitlines() if line.startswith("   chance "))
    assert "2 of 2 succeeded; of all tasks of this kind 6 of 8" in line
    query = shlex.split(line.rpartition("  (rtask ")[2].removesuffix(")"))
    assert run(*query, "--format", "csv")[1].count("attempt/") == 8


def test_outcomes_are_listed_by_robot_object_and_grasp_in_each_form(run: Run, store: Path) -> None:
    with rtask.open(store, mode="r") as kb:
        rows = kb.select(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> SELECT ?object ?grasp ?robot { "
            "?object rt:name 'carton-105' ; rt:hasGrasp ?grasp . ?grasp rt:triedIn ?attempt . "
            "?attempt rt:performedBy ?robot . ?robot rt:name 'nao-2' }"
        ).to_dicts()
    (row,) = rows
    base = row["object"].removesuffix("object/1")
    options = {"object": "--object", "grasp": "--with-grasp", "robot": "--robot"}
    asked = {role: run("feedback", options[role], row[role])[1] for role in row}
    assert asked["object"].startswith("3 of 3 held: nao-1 1 of 1, nao-2 1 of 1, panda-3 1 of 1\n")
    assert asked["robot"].startswith("2 of 2 held: nao-2 2 of 2\n")
    assert "nao-2 1 of 1" in asked["grasp"]
    assert run("feedback", "--object", "carton-105")[1] == asked["object"]
    assert run("feedback", "--robot", '"nao-2"')[1] == asked["robot"]
    assert run("feedback", "--with-grasp", row["grasp"].replace(base, "kb:"))[1] == asked["grasp"]
    both = run("feedback", "--object", "carton-105", "--robot", "nao-2", "--limit", "1")[1]
    assert both.startswith("1 of 1 held: nao-2 1 of 1\n")


def test_what_nobody_or_two_are_called_is_an_error_and_no_empty_list(
    run: Run, tmp_path: Path
) -> None:
    code, out, err = run("feedback", "--robot", "nao-9")
    assert (code, out) == (1, "")
    assert "no robot is called 'nao-9'" in err
    own = str(unpack(tmp_path / "demo")["store"])
    renamed = (
        "DELETE { GRAPH ?g { ?s rt:name 'carton-105' } } "
        "INSERT { GRAPH ?g { ?s rt:name 'carton-6' } } "
        "WHERE { GRAPH ?g { ?s rt:name 'carton-105' } }"
    )
    assert run("update", renamed, "--data", own)[0] == 0
    assert run("feedback", "--object", "carton-6", "--data", own)[2].count("/object/") == 2
    assert "without TASK_ID" in run("feedback", "urn:task:1", "--confirm", "--robot", "nao-1")[2]


def test_an_answer_without_numbers_has_no_such_line(run: Run) -> None:
    for words in (("feedback",), ("objects", "list"), ("ask", "what is the weather like?")):
        assert "why:" not in run(*words)[2]
