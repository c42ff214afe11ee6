"""Robots carry out stored plans: they look, act, report, and what fails is planned again."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.errors import RemoteUnavailableError, UsageError
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import iri
from simulate.tasks.body import Deed
from simulate.tasks.crew import Crew
from simulate.tasks.executor import Executor
from simulate.tasks.lab import read_lab
from tests.rtask.tasks.conftest import (
    BASE,
    CUP,
    JUG,
    LAB,
    LEFT,
    NAO,
    PANDA,
    PEN,
    RIGHT,
    TABLE,
)
from tests.rtask.tasks.test_plans import ACTION

pytestmark = pytest.mark.slow

GOAL = "every cup into the left box"
MOVED = {"moved": TABLE, "moved_out_of_sight": LEFT, "dropped": RIGHT}


class World:
    """A graph, a lab that is as the graph says, and robots that work in it."""

    def __init__(self, kb, engine, slip=0.0):
        self.kb, self.engine = kb, engine
        self.planner = rtask.connect(engine)
        self.lab = read_lab(self.planner.query, np.random.default_rng(3), slip)
        self.refused = set()

    def crew(self, wait=lambda: False):
        robots = {}
        for robot in (NAO, PANDA):
            client = rtask.connect(self.engine, agent=robot.rpartition("/")[2])
            robots[robot] = Executor(client, self.lab.robot(robot), may=self.may)
        return Crew(self.planner, robots, wait=wait)

    def may(self, text):
        return not any(word in text for word in self.refused)

    def store(self, goal=GOAL, **more):
        return self.planner.call("store_plan", goal=goal, **more)["task"]

    def questions(self):
        return self.planner.call("list_questions")["questions"]

    def answer(self, code, place=None):
        """Let ann choose for each open question what has a code, and names a place."""
        for question in self.questions():
            number = next(
                choice["number"] for choice in question["choices"]
                if choice["code"] == code and place in (None, choice["place"])
            )  # fmt: skip
            self.planner.call(
                "answer_question", question=question["question"], choice=number, operator="ann"
            )

    def places(self, thing):
        return {str(quad.object.value) for quad in self.kb.match(iri(thing), RT.locatedOn)}


@pytest.fixture
def world():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        yield World(kb, engine)


def test_a_plan_with_a_handover_is_carried_out_and_linked_to_what_was_done(world):
    task = world.store()
    (ended,) = world.crew().work()
    assert (ended.result, ended.repairs) == ("reached", 0)
    assert world.lab.where[CUP] == LEFT
    assert world.places(CUP) == {LEFT}
    assert [deed[:2] for deed in world.lab.done] == [
        (PANDA, "pick"), (PANDA, "put"), (NAO, "pick"), (NAO, "put"),
    ]  # fmt: skip
    rows = world.kb.select(f"""{PREFIXES}SELECT ?step ?ok WHERE {{
  <{task}> rt:hasSubTask ?step . ?step rt:carriedOutBy ?attempt .
  ?attempt rt:performedBy ?robot ; rt:handlesExemplar <{CUP}> ; rt:hasOutcome/rt:success ?ok }}""")
    assert {(str(row.value("step"))[-1], row.value("ok")) for row in rows} == {
        ("1", True), ("3", True),
    }  # fmt: skip
    again = world.kb.tasks.plan("every cup into the right box")
    assert [step.attempts for step in again.steps if step.action.endswith("Grasp")] == [1, 1]


@pytest.mark.parametrize(
    "event",
    [
        "slips",
        "dropped",
        *(pytest.param(e, marks=pytest.mark.deep) for e in MOVED if e != "dropped"),
    ],
)
def test_what_comes_between_is_seen_and_the_goal_planned_again(world, event):
    happened = []

    def meddle(robot, action, thing):
        if happened or (event == "dropped") != (action == "put"):
            return
        happened.append(event)
        world.lab.where[thing] = MOVED[event]

    if event == "slips":
        world.lab.slip = 0.6
    else:
        world.lab.on_deed = meddle
    world.store("every cup onto the table" if event == "moved_out_of_sight" else GOAL)
    (ended,) = world.crew().work()
    assert ended.result == "reached"
    assert ended.repairs >= 1
    goal = TABLE if event == "moved_out_of_sight" else LEFT
    assert (world.lab.where[CUP], world.places(CUP)) == (goal, {goal})


def test_a_person_says_no_and_that_is_no_failure(world):
    world.refused = {"red cup up from right box"}
    world.store()
    world.store("the pen into the right box")
    ended = {one.goal: one for one in world.crew().work()}
    assert ended[GOAL].result == "declined"
    assert ended["the pen into the right box"].result == "reached"
    assert (world.lab.where[CUP], world.lab.where[PEN]) == (RIGHT, RIGHT)


def test_what_is_nowhere_to_be_seen_is_given_up_and_not_lost_from_the_memory(world):
    world.store()
    world.lab.where[CUP] = "urn:elsewhere"
    (ended,) = world.crew().work()
    assert ended.result == "given_up"
    assert "not known where it is" in ended.comment
    assert not world.places(CUP)
    assert not world.kb.world.where_is(CUP).is_known
    assert len(world.kb.world.where_is(CUP).exemplars) == 1


def test_what_is_possible_of_a_goal_is_done_and_the_rest_once_it_can_be(world):
    goal = f"{GOAL}; every bottle into the left box"
    with pytest.raises(UsageError, match="Allow a part"):
        world.store(goal)
    world.store(goal, allow_part=True)
    crew = world.crew()
    (ended,) = crew.work()
    assert (ended.result, world.lab.where[CUP], world.lab.where[JUG]) == ("partly", LEFT, TABLE)
    (plan,) = world.planner.call("list_plans")["plans"]
    assert plan["state"] == "blocked"
    (left,) = plan["open_goals"]
    assert left.startswith("jug located on left box: ")
    assert left in ended.comment
    assert crew.work() == [ended], "nothing has changed: nothing is done, and nothing said twice"

    world.kb.update(f"{PREFIXES} INSERT DATA {{ <{PANDA}> rt:reaches <{LEFT}> }}")
    world.lab.reach = {**world.lab.reach, PANDA: world.lab.reach[PANDA] | {LEFT}}
    assert [run.result for run in world.crew().work()] == ["reached"]
    assert world.lab.where[JUG] == LEFT
    assert world.planner.call("list_plans")["plans"] == []


def test_what_becomes_impossible_meanwhile_does_not_keep_robots_from_the_rest(world):
    """The cup is gone; the pen is put away all the same, and the cup is left open."""
    world.store("every cup into the left box; every pen into the right box", allow_part=True)
    del world.lab.where[CUP]
    (ended,) = world.crew().work()
    assert (ended.result, world.lab.where[PEN]) == ("partly", RIGHT)
    assert "red cup" in ended.comment
    (plan,) = world.planner.call("list_plans")["plans"]
    assert plan["state"] == "blocked"
    assert [text.partition(" located")[0] for text in plan["open_goals"]] == ["red cup"]
    world.lab.where[CUP] = TABLE
    assert [run.result for run in world.crew().work()] == ["reached"], "robots look for it again"
    assert world.lab.where[CUP] == LEFT


def test_the_command_stores_a_plan_and_lets_robots_carry_it_out(tmp_path, capsys):
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        kb.update(LAB)

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(["simulate", "tasks", *arguments, "-d", str(tmp_path / "kb")])
        return ended.value.code or 0, capsys.readouterr().out

    code, out = run(GOAL, "--agent", "ann")
    assert (code, out.splitlines()[-1]) == (0, f"{GOAL}: reached")
    assert "done: nao-1 picks red cup up from table" in out
    goal = ("every", "cup", "into", "the", "right", "box")
    _, out = run(*goal, "--decline", "right box", "--json", "--agent", "ann")
    (ended,) = json.loads(out)["goals"]
    assert (ended["result"], ended["comment"]) == ("declined", "a person said no")
    with rtask.open(tmp_path / "kb", mode="r") as kb:
        assert kb.world.where_is(CUP).exemplars[0].place in (TABLE, f"{PANDA}/hand")


class Wipe:
    """A user's action: wipe a place that is empty."""

    is_grasp = False

    def target(self, arguments):
        return ""

    def missing(self, body, arguments):
        return ""

    def carry_out(self, body, arguments):
        wiped.append(arguments["place"])
        return Deed(True)


wiped = []


def test_an_ontology_and_one_class_add_an_action_that_robots_carry_out(world):
    world.kb.load(ACTION.encode(), "turtle", graph="https://example.org/kitchen")
    task = world.store(f"<{LEFT}> <https://example.org/kitchen#wipedBy> <{NAO}>")
    without = world.crew()
    assert without.robots[NAO].turn().comment.startswith("no program here carries out")
    world.planner.call("cancel_plan", plan=task, reason="no program")
    world.store(f"<{LEFT}> <https://example.org/kitchen#wipedBy> <{NAO}>")
    crew = world.crew()
    for executor in crew.robots.values():
        executor.actions = {**executor.actions, "https://example.org/kitchen#Wipe": Wipe()}
    (ended,) = crew.work()
    assert (ended.result, wiped) == ("reached", [LEFT])
    assert world.kb.match(iri(LEFT), iri("https://example.org/kitchen#wipedBy"), iri(NAO))


def test_what_comes_about_in_the_lab_is_stored_as_coarse_physics(world):
    world.store()
    world.crew().work()
    presets = [
        str(row.value("preset"))
        for row in world.kb.select(f"{PREFIXES}SELECT ?preset {{ ?a rt:preset ?preset }}")
    ]
    assert presets == ["fast", "fast"]


def test_a_server_out_of_reach_gives_up_no_plan(world):
    world.store()
    crew = world.crew()
    world.lab.slip = 1.0  # so that the goal has to be planned again
    call = crew.planner.call

    def unreachable(operation, *args, **fields):
        if operation == "plan_goal":
            raise RemoteUnavailableError("nobody there")
        return call(operation, *args, **fields)

    crew.planner.call = unreachable
    with pytest.raises(RemoteUnavailableError):
        crew.work()
    assert crew.ended == []
    crew.planner.call, world.lab.slip = call, 0.0
    assert [end.result for end in crew.work()] == ["reached"]


class KilledError(RuntimeError):
    """The program of a robot ends here."""


@pytest.mark.parametrize(
    "after",
    [
        "act",
        "end_step",
        pytest.param("claim_step", marks=pytest.mark.deep),
        pytest.param("report_outcome", marks=pytest.mark.deep),
    ],
)
def test_a_robot_that_is_killed_anywhere_and_started_again_does_nothing_twice(world, after):
    world.store()
    left = {"kills": 6}

    def die(when):
        if when == after and left["kills"]:
            left["kills"] -= 1
            raise KilledError

    for _ in range(40):
        crew = world.crew()
        for executor in crew.robots.values():
            _watch(executor, die)
        try:
            crew.work()
            break
        except KilledError:
            continue
    assert world.lab.where[CUP] == LEFT
    assert left["kills"] < 6
    assert [deed[:2] for deed in world.lab.done] == [
        (PANDA, "pick"), (PANDA, "put"), (NAO, "pick"), (NAO, "put"),
    ]  # fmt: skip
    (count,) = world.kb.select(f"{PREFIXES}SELECT (COUNT(*) AS ?n) {{ ?a a rt:GraspAttempt }}")
    # A grasp between which and its report the program ended was seen by nobody.
    assert int(str(count.value("n"))) == (0 if after == "act" else 2)


def _watch(executor, die):
    """Kill an executor after calls of the graph, and after it has acted."""
    graph, call = executor.graph, executor.graph.call
    body = executor.body

    class Graph:
        query = staticmethod(graph.query)

        def call(self, name, **args):
            answer = call(name, **args)
            if name != "claim_step" or answer["claimed"]:
                die(name)
            return answer

    class Body:
        hands, sees, find = body.hands, staticmethod(body.sees), staticmethod(body.find)
        physics = body.physics

        def pick(self, *args):
            deed = body.pick(*args)
            die("act")
            return deed

        def put(self, *args):
            deed = body.put(*args)
            die("act")
            return deed

    executor.graph, executor.body = Graph(), Body()


PRICES = {"asking_price": 1, "failing_price": 60}


def test_a_stuck_robot_asks_and_does_something_else_until_the_answer_comes(world):
    world.store(**PRICES)
    world.store("the pen into the right box")
    assert [end.goal for end in world.crew().work()] == ["the pen into the right box"]
    (question,) = world.questions()
    assert (question["kind"], question["robot"]) == ("act", PANDA)
    assert world.kb.blobs.read(f"urn:sha256:{question['picture']}").startswith(b"\x89PNG")
    assert CUP not in {deed[2] for deed in world.lab.done}
    asked = []

    def wait():
        asked.extend(question["text"] for question in world.questions())
        world.answer("go_on")
        return True

    (ended,) = world.crew(wait).work()[-1:]
    assert (ended.goal, ended.result, ended.repairs) == (GOAL, "reached", 0)
    assert len(asked) == 4, "each step of which little is known is asked about once"


@pytest.mark.parametrize(("answer", "result"), [("helped", "reached"), ("leave", "declined")])
def test_what_a_person_answers_is_done(world, answer, result):
    world.lab.slip = 1.0
    world.store("the pen into the right box", **PRICES)

    def wait():
        if answer == "helped":
            world.lab.helped.add(PEN)
        world.answer(answer)
        return True

    (ended,) = world.crew(wait).work()
    assert (ended.result, ended.repairs) == (result, 0)
    reported = world.kb.select(f"{PREFIXES}SELECT ?a {{ ?a a rt:GraspAttempt }}")
    assert len(reported) == 0, "a grasp that a person helped with says nothing of grasps alone"


def test_a_person_does_it_and_the_robot_looks_before_it_believes_that(world):
    world.store("the pen into the right box", **PRICES)
    did = []

    def wait():
        did.append(world.lab.where[PEN])
        if len(did) == 2:  # with the first answer nothing was done
            world.lab.where[PEN] = RIGHT
        world.answer("done")
        return True

    (ended,) = world.crew(wait).work()
    assert (ended.result, world.places(PEN)) == ("reached", {RIGHT})
    assert [deed[1] for deed in world.lab.done] == ["pick"]
    assert did == [TABLE, f"{PANDA}/hand"]


def test_where_a_thing_is_that_the_robot_does_not_see_a_person_says(world):
    world.store("every cup onto the table", **PRICES)
    world.lab.where[CUP] = LEFT  # out of sight of panda-1, which is to pick it up
    kinds = []

    def wait():
        (kind,) = {question["kind"] for question in world.questions()}
        kinds.append(kind)
        world.answer(*(("at", LEFT) if kind == "where" else ("go_on",)))
        return True

    (ended,) = world.crew(wait).work()
    assert (ended.result, world.lab.where[CUP]) == ("reached", TABLE)
    assert kinds == ["where", "act", "act"]
    plans = world.planner.call("list_plans", state="all")["plans"]
    assert plans[0]["steps"][0]["comment"] == "ann says that it is at left"
    assert "failed" not in {step["state"] for plan in plans for step in plan["steps"]}
