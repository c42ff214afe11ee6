"""People judge attempts: votes, disputes, counts and beliefs, all in one commit."""

from __future__ import annotations

import shutil

import pytest

import ontology
import rtask
from grasp.learning.bandit import Policy as Bandit
from rtask.engine import Engine
from rtask.engine.memory.confidence import posterior
from rtask.engine.memory.statistics import rebuild
from rtask.engine.policy import Policy
from rtask.errors import ConflictError, ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access

pytestmark = pytest.mark.slow


class Trial:
    """A reasoning store with one robot, one object and one attempt that held."""

    def __init__(self, bench, kb, engine):
        self.kb, self.engine = kb, engine
        self.robot = bench.Robot("nao-1", engine)
        self.robot.register()
        self.seen = bench.sight(bench.BOX)
        answer = self.robot.recognise(self.seen)
        self.task = answer["task_id"]
        told = self.robot.insert(
            self.seen, grasp=answer["grasps"][0], outcome=bench.held(), task_id=self.task,
            name="tea box",
        )  # fmt: skip
        self.grasp = told["objects"][0]["grasp"]
        self.object = told["objects"][0]["object"]

    def say(self, person, verdict, **more):
        request = {"task_id": self.task, "verdict": verdict, **more}
        return self.engine.call("give_feedback", request, Access(person, "teacher"))

    def recalled(self):
        return self.robot.call("recall_grasps", object="tea box")["grasps"][0]

    def counted(self):
        """Return (successes, attempts) as the robot's own graph keeps them."""
        node = self.engine.names.named("statistics", f"{self.grasp.rsplit('/')[-1]}-nao-1")
        graph = self.kb.graphs.agent("nao-1")
        said = {
            quad.predicate.value.rpartition("#")[2]: quad.object.value
            for quad in self.kb.match(node, graph=graph)
        }
        return int(said["successes"]), int(said["attempts"])


@pytest.fixture(scope="module")
def folder(bench, tmp_path_factory):
    """The trial's store, made once."""
    folder = tmp_path_factory.mktemp("feedback") / "kb"
    with rtask.open(folder, base="https://example.org/kb/") as kb, Engine(kb) as engine:
        trial = Trial(bench, kb, engine)
        names = trial.task, trial.grasp, trial.object
    return folder, names


@pytest.fixture
def trial(bench, folder, tmp_path):
    copied = tmp_path / "kb"
    shutil.copytree(folder[0], copied)
    with rtask.open(copied) as kb, Engine(kb) as engine:
        made = object.__new__(Trial)
        made.kb, made.engine = kb, engine
        made.robot, made.seen = bench.Robot("nao-1", engine), bench.sight(bench.BOX)
        made.task, made.grasp, made.object = folder[1]
        yield made


def test_a_refused_success_counts_as_a_failure_everywhere_at_once(trial):
    before = trial.recalled()["confidence"]["mean"]
    seq = trial.kb.seq
    told = trial.say("ann", "refuse", reason="slip_lift", comment="I saw it slide")
    assert trial.kb.seq == seq + 1
    assert (told["decided"], told["held"], told["disputed"]) == (True, False, False)
    assert told["verdicts"][0]["reason"] == "slip_lift"
    assert trial.counted() == (0, 1)
    recalled = trial.recalled()
    assert (recalled["statistics"]["successes"], recalled["statistics"]["attempts"]) == (0, 1)
    assert recalled["confidence"]["mean"] < before
    offered = trial.robot.recognise(trial.seen, propose=False)["grasps"][0]
    assert offered["explanation"]["graph"][0] == 0.0


def test_two_who_disagree_leave_it_undecided_until_a_third_speaks(trial):
    trial.say("ann", "refuse")
    tie = trial.say("bob", "confirm")
    assert (tie["held"], tie["disputed"]) == (None, True)
    assert (tie["held_votes"], tie["lost_votes"]) == (1, 1)
    assert "disputed, so it counts nowhere" in tie["text"]
    assert trial.counted() == (0, 0)
    assert trial.recalled()["statistics"]["attempts"] == 0
    assert trial.robot.recognise(trial.seen)["grasps"][0]["explanation"]["graph"] == [0.0, 0.0]
    third = trial.say("cleo", "confirm")
    assert (third["held"], third["disputed"]) == (True, False)
    assert [v["by"] for v in third["verdicts"]] == ["ann", "bob", "cleo"]
    assert trial.counted() == (1, 1)


def test_everybody_has_one_vote_the_latest(trial):
    trial.say("ann", "refuse")
    told = trial.say("ann", "confirm")
    assert (told["held_votes"], told["lost_votes"]) == (1, 0)
    assert len(told["verdicts"]) == 2  # what was said before is kept
    assert trial.counted() == (1, 1)


def test_the_same_word_again_stores_nothing(trial):
    trial.say("ann", "refuse")
    seq = trial.kb.seq
    assert trial.say("ann", "refuse")["stored"] == 0
    assert trial.kb.seq == seq


def test_counts_made_again_from_the_attempts_are_the_same(trial):
    trial.say("ann", "refuse")
    assert trial.counted() == (0, 1)
    rebuild(trial.engine.context)
    assert trial.counted() == (0, 1)
    trial.say("bob", "confirm")
    trial.say("cleo", "confirm")
    rebuild(trial.engine.context)
    assert trial.counted() == (1, 1)


def test_each_speaks_in_a_graph_of_their_own_and_the_robots_word_stays(trial):
    trial.say("ann", "refuse")
    rt = ontology.NS
    rows = trial.kb.select(
        f"SELECT ?g ?v {{ GRAPH ?g {{ ?f a <{rt}HumanFeedback> ; <{rt}verdict> ?v }} }}"
    ).to_dicts()
    assert rows == [{"g": trial.kb.graphs.agent("ann").value, "v": False}]
    assert trial.kb.query(f"ASK {{ ?o <{rt}success> true }}")
    assert list(trial.kb.validate()) == []


def test_a_verdict_gives_no_right_to_another_graph(trial):
    """The commit corrects the robot's count; the person may still not write there."""
    trial.say("ann", "refuse")
    graph = trial.kb.graphs.agent("nao-1")
    with pytest.raises(ForbiddenError), trial.kb.transaction(access=Access("ann", "teacher")) as tx:
        tx.add("urn:x", "urn:p", 1, graph)


def test_the_stored_confidence_is_prior_plus_outcomes_and_the_prior_stays(bench, trial):
    policy = Policy()
    quality = trial.recalled()["grasp_quality"]
    belief = posterior(policy, quality, [(True, False, 1)])
    kept = trial.recalled()["confidence"]
    assert (kept["alpha"], kept["beta"]) == pytest.approx((belief.alpha, belief.beta), abs=1e-5)
    assert kept["prior"] == quality
    for k in range(3):
        trial.robot.call(
            "report_outcome", task_id=f"urn:more:{k}", object=trial.object, grasp=trial.grasp,
            gripper_id="right_hand", outcome=bench.missed(),
        )  # fmt: skip
    floor, kappa, rho = Bandit().floor, Bandit().kappa, Bandit().rho
    kept = trial.recalled()["confidence"]
    assert kept["alpha"] == pytest.approx(floor + kappa * quality + 1, abs=1e-5)
    assert kept["beta"] == pytest.approx(floor + kappa * (1 - quality) + 3 * rho, abs=1e-5)
    assert kept["updated"]


def test_a_planned_grasp_keeps_its_evaluation_and_gets_a_posterior(bench, trial):
    from rtask.engine.operations.planned import PlannedGrasp, store_planned

    plan = PlannedGrasp(0.0, 0.0, 0.02, 0.3, 0.03, 0.045, 0.8, 100, 0.001)
    (grasp,) = store_planned(trial.engine.context, trial.object, [plan], "nao_hand")["grasps"]
    before = {g["id"]: g for g in trial.robot.call("recall_grasps", object="tea box")["grasps"]}
    assert before[grasp]["confidence"]["evaluation"] == grasp + "/evaluation"
    assert before[grasp]["confidence"]["prior"] == 0.8
    told = trial.robot.call(
        "report_outcome", task_id="urn:planned", object=trial.object, grasp=grasp,
        gripper_id="right_hand", outcome=bench.missed(),
    )  # fmt: skip
    assert told["stored"] == 1
    after = {g["id"]: g for g in trial.robot.call("recall_grasps", object="tea box")["grasps"]}
    kept = after[grasp]["confidence"]
    assert kept["prior"] == 0.8
    assert kept["evaluation"] == grasp + "/evaluation"
    assert kept["mean"] == pytest.approx(
        posterior(Policy(), 0.8, [(False, False, 1)]).mean, abs=1e-5
    )
    assert list(trial.kb.validate()) == []


def test_a_correction_says_what_is_right(trial):
    told = trial.say("ann", "correct", held=False, reason="missed")
    assert (told["held"], told["reason"]) == (False, "ok")  # the robot's reason stays
    assert told["verdicts"][0]["reason"] == "missed"


def test_an_arm_that_could_not_reach_still_counts_nowhere_when_confirmed(bench, trial):
    outcome = bench.missed(reason="ik")
    trial.robot.call(
        "report_outcome", task_id="urn:reach", object=trial.object, grasp=trial.grasp,
        gripper_id="right_hand", outcome=outcome,
    )  # fmt: skip
    assert trial.say("ann", "confirm", task_id="urn:reach")["held"] is None
    assert trial.counted() == (1, 1)
    assert trial.say("ann", "refuse", task_id="urn:reach")["held"] is True
    assert trial.counted() == (2, 2)


@pytest.mark.parametrize("name", ["task", "grasp"])
def test_an_unknown_task_or_grasp_is_met_with_the_nearest(trial, name):
    known = getattr(trial, name)
    field = {"task": "task_id", "grasp": "grasp"}[name]
    wrong = known[:-1] + ("x" if known[-1] != "x" else "y")
    with pytest.raises(UnknownTermError, match=f"unknown {field} .*did you mean '{known}'"):
        trial.engine.call("give_feedback", {"verdict": "confirm", field: wrong})


def test_nobody_speaks_for_another_person_and_robots_do_not_judge(trial):
    with pytest.raises(ForbiddenError, match="cannot act for 'bob'"):
        trial.say("ann", "confirm", operator="bob")
    with pytest.raises(ForbiddenError, match="scope teach"):
        trial.robot.call("give_feedback", task_id=trial.task, verdict="confirm")


def test_words_that_contradict_each_other_are_refused(trial):
    with pytest.raises(UsageError, match="slip_lift does not fit a grasp that held"):
        trial.say("ann", "confirm", reason="slip_lift")
    with pytest.raises(UsageError, match="only a correction takes it"):
        trial.say("ann", "confirm", held=True)
    with pytest.raises(UsageError, match="held is missing"):
        trial.say("ann", "correct")
    with pytest.raises(UnknownTermError, match="unknown reason 'slip_lit'; did you mean 'slip_li"):
        trial.say("ann", "refuse", reason="slip_lit")


def test_feedback_that_nobody_counted_is_taken_by_its_latest_word(trial):
    """As other programs write it, without votes."""
    rt = ontology.NS
    (row,) = trial.kb.select(f"SELECT ?o {{ ?o a <{rt}GraspOutcome> }}").to_dicts()
    trial.kb.update(
        f"""PREFIX rt: <{rt}> PREFIX prov: <http://www.w3.org/ns/prov#>
        INSERT DATA {{ <{row["o"]}> rt:hasFeedback <urn:said> .
          <urn:said> a rt:HumanFeedback ; rt:verdict false ; prov:wasAttributedTo <urn:dora> ;
            rt:atTime "2026-01-01T00:00:00Z"^^<http://www.w3.org/2001/XMLSchema#dateTimeStamp> .
          <urn:dora> a rt:Human ; rt:name "dora" }}""",
        agent="dora",
    )
    assert trial.kb.query(f"ASK {{ <{row['o']}> <{rt}judgedSuccess> false }}")
    told = trial.say("ann", "confirm")
    assert told["disputed"] is True


def test_a_verdict_is_undone_with_what_it_counted_for(trial):
    before = trial.recalled()
    mine = trial.say("ann", "refuse")["commit"]
    other = trial.say("bob", "confirm")["commit"]
    undo = {"operation": "undo", "commit": mine}
    with pytest.raises(ConflictError, match=other):
        trial.engine.call("curate_object", undo, Access("ann", "teacher"))
    with pytest.raises(ForbiddenError, match="verdict of bob"):
        trial.engine.call("curate_object", {**undo, "commit": other}, Access("ann", "teacher"))
    trial.engine.call("curate_object", {**undo, "commit": other}, Access("bob", "teacher"))
    assert trial.counted() == (0, 1)
    trial.engine.call("curate_object", undo, Access("ann", "teacher"))
    assert trial.counted() == (1, 1)
    assert trial.recalled()["confidence"]["mean"] == pytest.approx(before["confidence"]["mean"])
    assert not trial.kb.query(f"ASK {{ ?f a <{ontology.NS}HumanFeedback> }}")
    assert list(trial.kb.validate()) == []


def test_a_verdict_is_undone_though_robots_have_restated_the_counts_since(bench, trial):
    mine = trial.say("ann", "refuse")["commit"]
    trial.robot.call(
        "report_outcome", task_id="urn:more", object=trial.object, grasp=trial.grasp,
        gripper_id="right_hand", outcome=bench.held(),
    )  # fmt: skip
    assert trial.counted() == (1, 2)
    undo = {"operation": "undo", "commit": mine}
    trial.engine.call("curate_object", undo, Access("ann", "teacher"))
    assert trial.counted() == (2, 2)
    assert list(trial.kb.validate()) == []
