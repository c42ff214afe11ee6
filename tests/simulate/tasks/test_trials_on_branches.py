"""What would have mended a failure, tried on branches: the graph itself stays as it is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.errors import ForbiddenError, UnsupportedError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from rtask.services import ServiceHost
from rtask.tasks.diagnosis import diagnose
from rtask.tasks.diagnosis.attempt import Hand, Try
from rtask.tasks.diagnosis.changes import Change
from simulate.services import FailureTrials
from simulate.tasks.trials import ChangeTrial, TrialOptions, TriedChange, try_changes
from simulate.tasks.trials.trial import _by_hand
from tests.rtask.tasks.conftest import BASE, LAB, LEFT, NAO, PANDA, PEN, RIGHT, TABLE
from tests.simulate.tasks.test_hand_alone import HEAVY_LEFT

ANN = Access("ann", "teacher")
MIDDLE = f"{BASE}place/middle"
RELAY = f"""{PREFIXES}
DELETE WHERE {{ GRAPH ?g {{ <{BASE}placement/2> rt:placedOn ?p }} }} ;
INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
  <{BASE}placement/2> rt:placedOn <{LEFT}> .
  <{MIDDLE}> a rt:SupportSurface ; rt:name "middle" .
  <{NAO}> rt:reaches <{MIDDLE}> . <{PANDA}> rt:reaches <{MIDDLE}> }} }}"""
"""A place that both robots reach besides the table."""
STATEMENTS = "SELECT ?g ?s ?p ?o WHERE { GRAPH ?g { ?s ?p ?o } }"


def failed_step(kb, comment: str) -> str:
    """Let the Panda fail to pick the pen up for the right box; return the step."""
    with Engine(kb) as engine:
        kb.update(LAB)
        kb.update(RELAY)
        engine.call("store_plan", {"goal": f"<{PEN}> rt:locatedOn <{RIGHT}>"}, ANN)
        robot = Access("panda-1", "robot")
        claim = engine.call("claim_step", {}, robot)
        engine.call(
            "end_step",
            {"task": claim.task, "result": "failed", "comment": comment, "place": TABLE},
            robot,
        )
        return str(claim.task)


def state_of(folder: Path, kb) -> tuple[object, ...]:
    """Return all that a write would change: the commit, the journal, and each statement."""
    journal = {file.name: file.read_bytes() for file in sorted((folder / "journal").glob("*"))}
    return kb.seq, journal, sorted(map(str, kb.select(STATEMENTS)))


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A lab that failed; each test leaves it as it was."""
    folder = tmp_path_factory.mktemp("lab") / "store"
    with rtask.open(folder, base=BASE) as kb:
        yield kb, failed_step(kb, "ik"), folder


def by_kind(trial):
    return {tried.change.kind: tried for tried in trial.changes}


def test_what_an_arm_cannot_reach_is_brought_to_where_it_can(lab):
    kb, step, folder = lab
    before = state_of(folder, kb)
    diagnosis, trial = try_changes(kb, step, TrialOptions(tries=2))
    assert diagnosis.causes[0].kind == "out_of_reach"
    tried = by_kind(trial)
    assert (tried["place"].verdict, tried["place"].held) == ("held", 2), trial.text
    assert [step.split()[0] for step in tried["place"].steps] == [
        "nao-1", "nao-1", "panda-1", "panda-1",
    ]  # fmt: skip
    # The hand that the answer proposes does not get to the goal: that is no plan, and no failure.
    assert diagnosis.change.kind == "hand"
    assert tried["hand"].verdict == "not_tried"
    assert "there is no plan" in tried["hand"].refusal
    assert trial.ranked[0].verdict == "held"
    assert trial.ranked[-1].verdict == "failed"
    assert "nothing was stored" in trial.text
    assert state_of(folder, kb) == before
    assert kb.branches() == []


@pytest.mark.deep
def test_the_best_change_is_kept_on_a_branch_that_can_be_asked(lab):
    kb, step, folder = lab
    before = state_of(folder, kb)
    _, trial = try_changes(kb, step, TrialOptions(tries=1, keep="mended"))
    assert trial.branch == "mended"
    where = f"{PREFIXES} ASK {{ <{PEN}> rt:locatedOn <{RIGHT}> }}"
    (record,) = kb.branches()
    assert "another place" in record.note
    assert kb.open_branch("mended").graph.query(where)
    assert not kb.query(where)
    kb.drop_branch("mended")
    assert state_of(folder, kb) == before


def test_what_is_not_tried_for_want_of_time_is_not_called_a_failure(lab):
    kb, step, _ = lab
    _, trial = try_changes(kb, step, TrialOptions(budget_s=0.0))
    assert not trial.holds
    untried = [tried for tried in trial.changes if "budget" in tried.refusal]
    assert {tried.verdict for tried in untried} == {"not_tried"}
    assert {"hand", "place"} <= {tried.change.kind for tried in untried}


def test_a_trial_that_is_interrupted_leaves_no_branch(lab):
    kb, step, folder = lab
    before = state_of(folder, kb)

    def stop(part: float, text: str) -> None:
        if part > 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        try_changes(kb, step, TrialOptions(tries=2), stop)
    assert kb.branches() == []
    assert state_of(folder, kb) == before


KILLED = """
import os, sys
import rtask
from simulate.tasks.trials import TrialOptions, branch_run, try_changes, trial

def die(*args):
    os._exit(9)

trial.run_on_branch = die
with rtask.open(sys.argv[1], base=sys.argv[2]) as kb:
    try_changes(kb, sys.argv[3], TrialOptions(tries=1))
"""


@pytest.mark.deep
def test_what_a_killed_trial_left_is_dropped_by_the_next_one_and_no_other_branch(tmp_path):
    folder = tmp_path / "store"
    with rtask.open(folder, base=BASE) as kb:
        step = failed_step(kb, "ik")
        kb.branch("of-somebody").close()
        before = state_of(folder, kb)
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, str(folder), BASE, step], env=os.environ, check=False
    )
    assert killed.returncode == 9
    with rtask.open(folder, base=BASE) as kb:
        assert state_of(folder, kb) == before
        assert len(kb.branches()) == 2
        try_changes(kb, step, TrialOptions(budget_s=0.0))
        assert [record.name for record in kb.branches()] == ["of-somebody"]


def test_a_branch_that_looks_like_that_of_a_trial_but_is_not_is_left_alone(lab):
    kb, step, _ = lab
    kb.branch("why-trial-mine", note="of somebody").close()
    try_changes(kb, step, TrialOptions(budget_s=0.0))
    assert [record.name for record in kb.branches()] == ["why-trial-mine"]
    kb.drop_branch("why-trial-mine")


def test_what_was_not_tried_comes_after_what_held_and_before_what_failed():
    change = Change("grasp", 2, "another grasp", Try(Hand("", "")))
    held, untried = TriedChange(change, 2, 2), TriedChange(change, refusal="budget")
    failed = TriedChange(change, 2, 1)
    trial = ChangeTrial((failed, untried, held))
    assert trial.ranked == (held, untried, failed)
    assert trial.holds
    assert not ChangeTrial((failed, untried)).holds


def test_a_robot_has_it_tried_as_a_service_and_a_reader_does_not(lab):
    kb, step, _ = lab
    with ServiceHost([FailureTrials], kb) as host:
        request = {"subject": step, "tries": 1}
        access = Access("panda-1", "robot")
        answer = host.call("rtask/FailureTrials", "try_changes", request, access).as_json()
        assert answer["holds"], answer["text"]
        assert [change["verdict"] for change in answer["changes"]].index("held") == 0
        with pytest.raises(ForbiddenError):
            host.call("rtask/FailureTrials", "try_changes", request, Access("eve", "reader"))
        with pytest.raises(UsageError, match="those of trials"):
            host.call(
                "rtask/FailureTrials", "keep_change", {**request, "branch": "why-trial-1"}, access
            )
        methods = host.registry.find("rtask/FailureTrials").methods
        assert methods["try_changes"].effect == "reads"
        assert methods["keep_change"].effect == "writes"
    assert kb.branches() == []


def test_without_a_thing_a_hand_alone_takes_it_and_no_plan_is_claimed():
    diagnosis = diagnose(HEAVY_LEFT)
    trial = _by_hand(diagnosis, TrialOptions(tries=1), "no thing")
    assert (trial.holds, trial.changes[0].in_physics) == (True, 1)
    assert trial.assumed[0] == "no thing"


def test_a_graph_in_memory_says_that_it_has_no_branches():
    with rtask.open(":memory:", base=BASE) as kb:
        step = failed_step(kb, "ik")
        with pytest.raises(UnsupportedError):
            try_changes(kb, step, TrialOptions())


@pytest.mark.deep
def test_at_the_command_line_the_branch_is_named(tmp_path, capsys):
    folder = tmp_path / "store"
    with rtask.open(folder, base=BASE) as kb:
        step = failed_step(kb, "ik")
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "why", step, "-n", "1", "--keep-branch", "mended", "-d", str(folder)])
    said = capsys.readouterr().out
    assert ended.value.code == 0
    assert "branch mended is kept" in said
    assert "another place: panda-1 does not take it at table" in said
    with pytest.raises(SystemExit) as ended:
        main(["why", step, "--keep-branch", "mended", "-d", str(folder)])
    assert ended.value.code == 2
