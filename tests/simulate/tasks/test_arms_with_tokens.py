"""Whole arms, each a program with its own token, its own table and its own physics."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from rtask.cli import main
from rtask.rdf.namespaces import PREFIXES
from tests.commands import start_command
from tests.servers import running_server

pytestmark = pytest.mark.slow

ROBOTS = {"panda-kitchen": "panda", "nao-hall": "nao"}
_PATIENCE_S = 240.0
_SEEN = f"""{PREFIXES} SELECT DISTINCT ?robot WHERE {{
  ?robot rt:reaches ?place . ?thing a rt:Exemplar ; rt:locatedOn ?place }}"""

_BOXES = f"""{PREFIXES} SELECT ?thing ?box WHERE {{
  ?robot rt:reaches ?place, ?box . ?thing a rt:Exemplar ; rt:locatedOn ?place .
  ?place rt:name ?half . ?box rt:name ?name
  FILTER(STRBEFORE(?half, " half") = STRBEFORE(?name, " box") && STRENDS(?name, " box")) }}"""
"""The box on that side of the table on which a thing stands."""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "give a goal"),
        (["everything", "into", "the", "left", "box", "--robot", "panda-7"], "plans nothing"),
        (["--robot", "panda-7"], "one robot: name the kind of its table"),
    ],
)
def test_what_does_not_fit_one_robot_is_refused_before_anything_is_set_up(tmp_path, words, said):
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "crew", *words, "-d", str(tmp_path / "kb")])
    assert ended.value.code == 2
    assert not (tmp_path / "kb").exists(), said


@pytest.mark.deep
def test_one_robot_goes_by_the_name_that_it_is_given(tmp_path, capsys):
    """No arm moves and no plan comes: it looks what is on its table, and leaves."""
    words = ["--robot", "panda-kitchen", "--table", "panda", "--things", "1", "--idle", "0.1"]
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "crew", *words, "--preset", "fast", "--json", "-d", str(tmp_path / "kb")])
    assert ended.value.code == 1, "no plan came"
    printed, told = capsys.readouterr()
    assert json.loads(printed)["turns"] == []
    assert "robot/panda-kitchen sees" in told
    assert " on left half" in told or " on right half" in told


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    with rtask.open(tmp_path / "kb"):
        pass
    with closing(TokenStore(tmp_path / "kb")) as store:
        tokens = {"": store.create("admin")[0]}
        tokens |= {robot: store.create("robot", agent=robot)[0] for robot in ROBOTS}
    with running_server(tmp_path / "kb") as server:
        yield server.url, tokens


@pytest.mark.deep
def test_two_programs_with_an_arm_each_share_the_work_of_one_plan(site):
    """One server, three programs: each arm does what stands on its own table."""
    url, tokens = site
    programs = {
        robot: start_command(
            "simulate", "crew", "--server", url, "--json", "--preset", "fast", "--things", "1",
            "--seed", str(len(robot)), "--table", kind, "--robot", robot,
            "--idle", str(_PATIENCE_S),
            environment={**os.environ, "RTASK_TOKEN": tokens[robot]},
        )
        for robot, kind in ROBOTS.items()
    }  # fmt: skip
    with rtask.connect(url, token=tokens[""]) as person:
        until = time.monotonic() + _PATIENCE_S
        while len(person.query(_SEEN)) < len(ROBOTS) and time.monotonic() < until:
            assert all(program.poll() is None for program in programs.values())
            time.sleep(0.1)
        goals = [
            {"achieve": f"<{row['thing']}> rt:locatedOn <{row['box']}>"}
            for row in person.query(_BOXES)
        ]
        assert len(goals) == len(ROBOTS)
        person.call("store_plan", goal=json.dumps({"goals": goals}))
        printed = {}
        for robot, program in programs.items():
            with program.stdout, program.stderr:
                printed[robot] = program.stdout.read(), program.stderr.read()
            assert program.wait(_PATIENCE_S) == 0, printed[robot]
        [listed] = person.call("list_plans", state="all")["plans"]
        assert {step["state"] for step in listed["steps"]} == {"done"}, listed
        claimed = {step["claimed_by"].rpartition("/")[2] for step in listed["steps"]}
    assert claimed == set(ROBOTS)
    for robot, (out, _) in printed.items():
        told = json.loads(out)
        assert {turn["robot"].rpartition("/")[2] for turn in told["turns"]} == {robot}
        assert all(thing["remembered"] == thing["truly"] for thing in told["things"])
