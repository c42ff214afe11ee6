"""Plans for "what if": made in a branch, carried out there, and nothing of it in the graph."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import ontology
import rtask
from rtask.cli import cli
from rtask.engine import Engine
from rtask.errors import UnknownTermError
from simulate.tasks.crew import Crew
from simulate.tasks.executor import Executor
from simulate.tasks.lab import read_lab
from tests.rtask.tasks.conftest import BASE, LAB

pytestmark = pytest.mark.slow

GOAL = "every cup into the left box"


def test_a_plan_in_a_branch_is_for_what_holds_there(tmp_path):
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        kb.update(LAB)
        with kb.branch("done") as branch, Engine(branch.graph) as engine:
            planner = rtask.connect(engine)
            planner.call("store_plan", goal=GOAL)
            lab = read_lab(planner.query, np.random.default_rng(3))
            robots = {
                robot: Executor(
                    rtask.connect(engine, agent=robot.rpartition("/")[2]), lab.robot(robot)
                )
                for robot in sorted(lab.hands)
            }
            assert [end.result for end in Crew(planner, robots).work()] == ["reached"]
        with Engine(kb) as engine:
            asked = {"goal": GOAL}
            here = engine.call("plan_goal", asked).as_json()
            there = engine.call("plan_goal", {**asked, "branch": "done"}).as_json()
            assert (len(here["steps"]), len(there["steps"]), there["complete"]) == (4, 0, True)
            with pytest.raises(UnknownTermError, match="no branch 'other'"):
                engine.call("plan_goal", {**asked, "branch": "other"})

    def run(*options):
        words = ["plan", GOAL, "-d", str(tmp_path / "kb"), "--json", *options]
        done = CliRunner().invoke(cli, words, catch_exceptions=False)
        return json.loads(done.stdout)

    assert len(run("--branch", "done")["steps"]) == 0
    with rtask.open(tmp_path / "kb") as kb:
        kb.branch("if").close()
    assert len(run("--branch", "if", "--store")["steps"]) == 4
    with rtask.open(tmp_path / "kb") as kb:
        plans = f"ASK {{ ?plan a <{ontology.NS}TaskPlan> }}"
        assert not kb.query(plans)
        assert kb.open_branch("if").graph.query(plans)
