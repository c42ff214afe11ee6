"""Experience lives in the graph: a learner restarted anywhere goes on from it, nothing is mixed."""

from __future__ import annotations

import io
import json
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

import rtask
from grasp.learning.agents import QLearning
from grasp.learning.bandit import Policy as Bandit
from grasp.learning.environments.discretise import Bins
from rtask.client.outbox import Outbox
from rtask.engine import Engine, Policy
from rtask.engine.memory.learners import (
    Training,
    adopt_policy,
    experience,
    keep_learner,
    resume_learner,
)
from rtask.errors import UnknownTermError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from tests.commands import run_program

pytestmark = pytest.mark.slow

ELSEWHERE = """
import json, sys
import rtask
from rtask.engine import Engine
from rtask.kb.commit.access import Access
folder, request = sys.argv[1], json.loads(sys.stdin.read())
with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
    answer = engine.call("recognise_for_grasp", request, Access("nao-2", "robot"))
told = [(g["id"], g["alpha"], g["beta"], g["explanation"]["score"]) for g in answer["grasps"]]
print(json.dumps(told))
"""


KILLED = """
import json, os, signal, sys
import rtask
folder, outbox, when = sys.argv[1:]
request, report = json.loads(sys.stdin.read())

def die(*args):
    os.kill(os.getpid(), signal.SIGKILL)

kb = rtask.open(folder, reason=False)
robot = rtask.connect(kb, agent="nao-2", outbox=outbox)
answer = robot.call("recognise_for_grasp", **request)
if when == "before it is told":
    die()
robot._call = die  # what is told is on the disk by then
item = {**report, "grasp": answer["grasps"][0], "task_id": answer["task_id"]}
robot.call("insert_object", objects=[item])
"""


@pytest.fixture(scope="module")
def made(bench, tmp_path_factory):
    """A store in which one robot tried a box and a can several times."""
    folder = tmp_path_factory.mktemp("continuing") / "kb"
    with (
        rtask.open(folder, base="https://example.org/kb/", reason=False) as kb,
        Engine(kb) as engine,
    ):
        robot = bench.Robot("nao-1", engine)
        robot.register()
        bench.Robot("nao-2", engine, "left_hand").register()
        for thing in (bench.BOX, bench.CAN):
            seen = bench.sight(thing)
            grasps = robot.recognise(seen)["grasps"]
            for k, outcome in enumerate((bench.held(), bench.missed(), bench.held())):
                robot.insert(
                    seen, grasp=grasps[3 * k], outcome={**outcome, "attempt_number": k + 1},
                    name=f"thing {len(thing.size)}",
                )  # fmt: skip
    return folder


@pytest.fixture
def folder(made, tmp_path):
    shutil.copytree(made, tmp_path / "kb")
    return tmp_path / "kb"


def request(bench):
    seen = bench.sight(bench.BOX)
    return {"task": "pick", "gripper_id": "left_hand", "propose": True, "max_grasps": 50,
            "seed": 7, **seen}  # fmt: skip


def test_another_process_makes_the_identical_choice(bench, folder):
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        answer = engine.call("recognise_for_grasp", request(bench), Access("nao-2", "robot"))
    assert any(g["statistics"]["attempts"] for g in answer["grasps"])
    here = [[g["id"], g["alpha"], g["beta"], g["explanation"]["score"]] for g in answer["grasps"]]
    done = run_program(ELSEWHERE, str(folder), given=json.dumps(request(bench)), check=True)
    assert json.loads(done.stdout) == here


@pytest.mark.deep
def test_a_learner_killed_between_an_attempt_and_its_report_goes_on_as_if_it_had_not_been(
    bench, folder, tmp_path
):
    """Killed outright, with nothing told and with the report on the disk but not sent."""
    seen, outbox = bench.sight(bench.BOX), tmp_path / "outbox.jsonl"
    report = {**seen, "gripper_id": "left_hand", "outcome": bench.missed()}

    def killed(when):
        done = subprocess.run(
            [sys.executable, "-c", KILLED, str(folder), str(outbox), when],
            input=json.dumps([request(bench), report]), capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert done.returncode == -signal.SIGKILL, done.stderr

    def choices(robot):
        grasps = robot.call("recognise_for_grasp", **request(bench))["grasps"]
        return [(g["id"], g["alpha"], g["beta"], g["explanation"]) for g in grasps]

    shutil.copytree(folder, tmp_path / "never killed")
    with (
        rtask.open(tmp_path / "never killed", reason=False) as kb,
        rtask.connect(kb, agent="nao-2") as robot,
    ):
        before = choices(robot)
        answer = robot.call("recognise_for_grasp", **request(bench))
        item = {**report, "grasp": answer["grasps"][0], "task_id": answer["task_id"]}
        robot.call("insert_object", objects=[item])
        after = choices(robot)
    assert before != after

    killed("before it is told")
    with (
        rtask.open(folder, reason=False) as kb,
        rtask.connect(kb, agent="nao-2", outbox=outbox) as robot,
    ):
        assert choices(robot) == before
    killed("before it is sent")
    assert len(Outbox(outbox).pending()) == 1
    with (
        rtask.open(folder, reason=False) as kb,
        rtask.connect(kb, agent="nao-2", outbox=outbox) as robot,
    ):
        assert choices(robot) == after  # connecting delivered it
    with (
        rtask.open(folder, reason=False) as kb,
        rtask.connect(kb, agent="nao-2", outbox=outbox) as robot,
    ):
        assert choices(robot) == after  # once


def test_a_belief_of_other_rules_is_computed_anew_and_says_so(folder):
    with rtask.open(folder, reason=False) as kb:
        with Engine(kb) as engine:
            name = engine.call("recall_grasps", {"object": kb.base + "object/1"})
        other = Policy(bandit=Bandit(kappa=6.0))
        with Engine(kb, policy=other) as engine:
            anew = engine.call("recall_grasps", {"object": kb.base + "object/1"})
    first, second = name["grasps"][0]["confidence"], anew["grasps"][0]["confidence"]
    assert (first["note"], first["policy"]) == ("", Policy().version)
    assert second["policy"] == other.version
    assert second["note"] == f"recomputed: stored by the rules {Policy().version}"
    prior = first["prior"]
    assert second["alpha"] == pytest.approx(0.3 + 6 * prior + 1)
    assert first["alpha"] == pytest.approx(0.3 + 2 * prior + 1, abs=1e-5)


def test_a_belief_computed_anew_is_the_one_that_was_stored(folder):
    """Failures weigh alike when they are stored, recalled and chosen by."""
    real = Policy(fast_physics=Policy().fast_physics / 2)  # another version, same weights here
    beliefs = []
    for policy in (Policy(), real):
        with rtask.open(folder, reason=False) as kb, Engine(kb, policy=policy) as engine:
            told = [
                engine.call("recall_grasps", {"object": f"{kb.base}object/{n}"})["grasps"]
                for n in (1, 2)
            ]
        beliefs.append([(g["id"], g["confidence"], g["statistics"]) for one in told for g in one])
    assert any(told["attempts"] > told["successes"] for _, _, told in beliefs[0])
    for (grasp, stored, _), (same, anew, _) in zip(*beliefs, strict=True):
        assert grasp == same
        assert (stored["note"] == "") != (anew["note"] == "")
        assert (anew["alpha"], anew["beta"]) == pytest.approx(
            (stored["alpha"], stored["beta"]), abs=1e-5
        )


def test_what_robots_did_is_experience_for_the_learners_of_the_thesis(folder):
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        steps = experience(engine.context)
        again = experience(engine.context)
    assert sorted(step.reward for step in steps) == [-1.0, -1.0, 1.0, 1.0, 1.0, 1.0]
    assert len({tuple(step.state) for step in steps}) == 2  # one for each object
    assert [tuple(s.state) for s in steps] == [tuple(s.state) for s in again]
    assert all(step.terminated and step.state.shape == (5,) for step in steps)


def test_views_of_an_older_extractor_are_left_out(folder):
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        before = experience(engine.context)
        from rtask.engine.memory import learners

        one = learners.stored_views(kb)[0].object
        spoiled = [view for view in learners.stored_views(kb) if view.object == one]
        for view in spoiled:
            kb.blobs.path(view.blob).write_bytes(b"another format")
        left = experience(engine.context)
    assert len(before) == 6
    assert len(left) == 3


def learner(seed=1):
    return QLearning(Bins((-1,) * 5, (2,) * 5, (3,) * 5), actions=4, seed=seed)


def test_a_learner_goes_on_from_its_state_in_the_graph(folder):
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        first = learner()
        steps = experience(engine.context)
        first.learn_examples(steps)
        node = keep_learner(engine.context, first, "quadrants", "nao-1", len(steps))
        acts = [first.act(step.state) for step in steps]
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        assert kb.match(rtask.rdf.terms.iri(node), graph=kb.graphs.agent("nao-1"))
        second = learner(seed=99)
        told = resume_learner(engine.context, second, "quadrants")
        assert told.done
        assert np.array_equal(second.values, first.values)
        assert [second.act(step.state) for step in experience(engine.context)] == acts
        keep_learner(engine.context, second, "quadrants", "nao-1")
        assert len(kb.match(rtask.rdf.terms.iri(node), rtask.rdf.namespaces.RT.algorithm)) == 1


def test_another_robot_adopts_the_best_policy_for_its_environment():
    with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
        for number, (robot, place, reached) in enumerate(
            (("nao-1", "lab", -30.0), ("nao-2", "lab", -20.0), ("nao-3", "hall", -1.0))
        ):
            taught = learner()
            taught.values = np.full_like(taught.values, 1.0 + number)
            keep_learner(engine.context, taught, "p", robot, 9, Training(place, 3, reached))
        second = learner(seed=5)
        told = adopt_policy(engine.context, second, "lab")
        assert told.done
        assert told.snapshot.endswith("nao-2-p")
        assert (second.values == 2.0).all()
        withdrawn = {"contributor": "nao-2", "operator": "keeper"}
        engine.call("withdraw_contributor", withdrawn, Access("keeper", "teacher"))
        assert adopt_policy(engine.context, second, "lab").snapshot.endswith("nao-1-p")
        told = adopt_policy(engine.context, second, "street")
        assert (told.done, told.note) == (False, "no policy for 'street' is stored")


def test_a_state_of_an_older_version_is_left_alone_with_a_note(folder):
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        first = learner()
        first.learn_examples(experience(engine.context))
        keep_learner(engine.context, Older(first), "quadrants")
        fresh = learner()
        told = resume_learner(engine.context, fresh, "quadrants")
        assert not told.done
        assert "version 1" in told.note
        assert "relearn from the outcomes" in told.note
        assert not fresh.values.any()
        assert (
            resume_learner(engine.context, fresh, "nothing").note
            == "no learner 'nothing' is stored"
        )


class Older:
    """Saves as an older release did."""

    def __init__(self, learner):
        self.learner = learner

    def save(self, path):
        self.learner.save(path)
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(str(arrays["header"]))
        header["format"] = 1
        arrays["header"] = np.array(json.dumps(header))
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        path.write_bytes(buffer.getvalue())


Older.__name__ = "QLearning"


def test_a_grasp_named_by_its_id_alone_is_stored_also_by_a_server_that_was_restarted(bench, folder):
    """The robot goes on; the server that offered the grasp was stopped in between."""
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        answer = engine.call("recognise_for_grasp", request(bench), Access("nao-2", "robot"))
    offered = next(g for g in answer["grasps"] if g["id"].startswith("candidate:"))
    report = {"grasp": offered["id"], "gripper_id": "left_hand", "success": True}
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        named = {"object": answer["object"], **report}
        with pytest.raises(UnknownTermError, match="its pose is missing"):
            engine.call("report_outcome", named, Access("nao-2", "robot"))
        named = {"task_id": answer["task_id"], **report}
        stored = engine.call("report_outcome", named, Access("nao-2", "robot"))
        rows = kb.query(f"""{PREFIXES} SELECT ?x ?y ?z ?width ?opening WHERE {{
            <{stored["grasp"]}> rt:graspPose ?pose .
            <{stored["grasp"]}> rt:contactWidth ?width ; rt:jawOpening ?opening .
            ?pose rt:x ?x ; rt:y ?y ; rt:z ?z }}""")
        [row] = [row.to_dict() for row in rows]
    expected = {name: offered["in_object"][name] for name in "xyz"}
    expected |= {name: offered[name] for name in ("width", "opening")}
    assert stored["stored"] == 1
    assert {name: float(value) for name, value in row.items()} == pytest.approx(expected, abs=1e-6)
