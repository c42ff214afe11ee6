"""Goals in words become plans from what the graph knows, or reasons why there is none."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import pytest

import ontology
import rtask
from rtask.cli import main
from rtask.errors import DataError, SearchLimit, UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES, RT, local_name
from rtask.rdf.terms import iri
from rtask.tasks.actions import read_actions
from rtask.tasks.behaviour_tree import behaviour_tree
from rtask.tasks.patterns import parse_pattern
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
    placed,
)

pytestmark = pytest.mark.slow

ODD_CLASSES = ("https://example.org/a#Sleep", "https://example.org/b/Pour.1")


def steps_of(plan):
    return [
        (local_name(s.action), local_name(s.robots[0]), s.arguments["thing"], s.arguments["place"])
        for s in plan.steps
    ]


def test_a_thing_goes_by_the_table_that_both_robots_reach(kb):
    plan = kb.tasks.plan("every cup into the left box")
    assert steps_of(plan) == [
        ("Grasp", "panda-1", CUP, RIGHT), ("Place", "panda-1", CUP, TABLE),
        ("Grasp", "nao-1", CUP, TABLE), ("Place", "nao-1", CUP, LEFT),
    ]  # fmt: skip
    assert (plan.is_complete, plan.refusals, plan.assumptions) == (True, (), ())
    assert plan.steps[1].supports[-1].step in (None, 1)
    assert {item.step for item in plan.steps[2].supports} >= {2}
    assert "panda-1 picks red cup up from right box" in plan.text


def test_hands_that_meet_give_a_thing_on_without_a_place():
    with kb_of(f"<{NAO}> rt:meets <{PANDA}>") as graph:
        plan = graph.tasks.plan("every cup into the left box")
    assert [local_name(step.action) for step in plan.steps] == ["Grasp", "HandOver", "Place"]
    assert plan.steps[1].robots == (NAO, PANDA)
    assert plan.steps[2].start_s == plan.steps[1].start_s + plan.steps[1].duration_s


@pytest.mark.parametrize(
    ("goal", "things"),
    [
        ("something to write with onto the right box", {PEN}),
        ("everything into the right box", {JUG, PEN}),
        ("one pen and the jug into the right box", {JUG, PEN}),
        ("empty the table", {JUG, PEN}),
        ("give the pen to nao-1", {PEN}),
        ("pick up the jug", {JUG}),
        ("the red cup into the right box", set()),
        ("everything from the table onto the right box", {JUG, PEN}),
        ("leave nothing on the table", {JUG, PEN}),
        ("could you please put everything one can write with into the right box", {PEN}),
        ("I want the jug in the right box", {JUG}),
        ("at least one pen into the right box", {PEN}),
        ("everything but the jug into the right box", {PEN}),
        ("everything from the table except the pen into the right box", {JUG}),
    ],
)
def test_goals_are_about_kinds_uses_names_places_and_hands(kb, goal, things):
    plan = kb.tasks.plan(goal)
    assert plan.is_complete
    assert {step.arguments["thing"] for step in plan.steps} == things


def test_what_a_goal_leaves_out_may_be_named_by_what_tells_it_apart():
    with kb_of(
        f"<{BASE}object/9> a rt:Cup ; rt:objectId 'lab/9' ; rt:name 'blue cup' ; "
        f"rt:graspWidth 0.04e0 ; rt:mass 0.1e0 . {placed(9, RIGHT)}"
    ) as graph:
        plan = graph.tasks.plan("all cups except the red one onto the table")
    assert plan.understood == ("all: cups except red cups: at table",)
    assert {step.arguments["thing"] for step in plan.steps} == {f"{BASE}thing/9"}


def test_a_goal_in_words_a_pattern_and_json_give_the_same_plan(kb):
    where = f"?x rt:exemplarOf/a rt:Pen . BIND(<{RIGHT}> AS ?y)"
    pattern = kb.tasks.plan(f"?x rt:locatedOn ?y WHERE {{ {where} }}")
    assert steps_of(pattern) == steps_of(kb.tasks.plan("every pen into the right box"))
    in_json = {"goals": [{"achieve": "?x rt:locatedOn ?y", "where": where, "number": 1}]}
    assert steps_of(kb.tasks.plan(in_json)) == steps_of(pattern)
    assert steps_of(kb.tasks.plan(f"<{PEN}> rt:locatedOn <{RIGHT}>")) == steps_of(pattern)


def test_what_comes_then_waits_for_all_before_it(kb):
    """The cup is the Panda's, the pen the Nao's: they do both at once, unless there is an order."""
    goal = "the pen into the left box{} the red cup onto the table"
    at_once, in_order = (kb.tasks.plan(goal.format(word)) for word in (" and", ", then"))
    first = {
        plan.understood[1]: next(s for s in plan.steps if s.arguments["thing"] == CUP)
        for plan in (at_once, in_order)
    }
    *_, last = (step for step in in_order.steps if step.arguments["thing"] == PEN)
    assert [step.after for step in first.values()] == [(), (last.number,)]
    assert first["then all: red cup: at table"].start_s >= last.start_s + last.duration_s
    part = {"achieve": f"<{CUP}> rt:locatedOn <{TABLE}>", "then": True}
    goals = [{"achieve": f"<{PEN}> rt:locatedOn <{LEFT}>"}, part]
    assert steps_of(kb.tasks.plan({"goals": goals})) == steps_of(in_order)
    with pytest.raises(UsageError, match='"then" of a goal'):
        kb.tasks.plan({"goals": [part | {"then": "yes"}]})


def test_a_goal_that_is_not_understood_says_what_was_and_the_nearest_names(kb):
    with pytest.raises(UnknownTermError, match=r"'jugg' means nothing.*nearest names are jug"):
        kb.tasks.plan("the jugg into the left box")
    with pytest.raises(UsageError, match=r"does not say where to.*; understood: 'pen' \(kind\)"):
        kb.tasks.plan("every pen")
    with pytest.raises(UnknownTermError, match="the graph knows of no mug;"):
        kb.tasks.plan("every mug into the left box")
    with pytest.raises(UsageError, match="'into' after 'everything except'"):
        kb.tasks.plan("everything except into the right box")
    with pytest.raises(UsageError, match=r"by 18:00.*--deadline"):
        kb.tasks.plan("every pen into the left box by 18:00")
    with pytest.raises(UsageError, match="nothing selects"):
        kb.tasks.plan("?x rt:locatedOn ?y")


def test_what_no_hand_can_hold_is_refused_with_the_measures_of_each_robot(kb):
    plan = kb.tasks.plan("the jug into the left box")
    assert (plan.is_complete, plan.steps) == (False, ())
    (refusal,) = plan.refusals
    assert "no hand of nao-1 opens beyond 50 mm" in refusal.by_robot[NAO]
    assert refusal.by_robot[PANDA] == "it is not known that panda-1 reaches left box"
    assert refusal.missing == ((PANDA, RT.reaches.value, LEFT),)
    assert "rtask update 'INSERT DATA" in refusal.text


def test_what_can_be_done_of_a_goal_is_planned_beside_what_cannot(kb):
    plan = kb.tasks.plan("the jug and every cup into the left box")
    assert not plan.is_complete
    assert len(plan.refusals) == 1
    assert {step.arguments["thing"] for step in plan.steps} == {CUP}
    assert plan.text.index("not possible") < plan.text.index("the rest can be done")


def test_a_kind_in_a_goal_means_what_is_called_so_and_says_it():
    with kb_of(
        f"<{BASE}object/9> a rt:ManipulableObject ; rt:name 'cup-9' ; rt:graspWidth 0.04e0 ; "
        f"rt:mass 0.1e0 . {placed(9, LEFT)}"
    ) as graph:
        plan = graph.tasks.plan("every cup onto the table")
    assert plan.understood == ("all: cup (and 1 only called so): at table",)
    assert {step.arguments["thing"] for step in plan.steps} == {CUP, f"{BASE}thing/9"}, plan.text


def test_what_was_not_looked_into_for_a_reason_is_said(kb, monkeypatch):
    monkeypatch.setattr("rtask.tasks.reasons._MAX_ROBOTS", 1)
    (refusal,) = kb.tasks.plan("the jug into the left box").refusals
    assert sorted(refusal.by_robot) == sorted([NAO, PANDA])
    assert sum(text.startswith("not looked at") for text in refusal.by_robot.values()) == 1
    monkeypatch.setattr("rtask.tasks.planner._MAX_REFUSALS", 0)
    (rest,) = kb.tasks.plan("the jug into the left box").refusals
    assert rest.goal == "1 more goals"


def test_reach_that_nobody_stated_is_assumed_on_request_only_and_said(kb):
    plan = kb.tasks.plan("the jug into the left box", assume_reach=True)
    assert plan.is_complete
    assert plan.assumptions == ("panda-1 reaches left box",)
    assert [item.text for item in plan.steps[1].supports if item.is_assumed] == [
        "panda-1 reaches left box"
    ]


def test_a_thing_whose_place_nobody_knows_is_no_reason_for_no(kb):
    with kb_of(f"<{BASE}thing/9> a rt:Exemplar ; rt:exemplarOf <{BASE}object/3>") as lab:
        plan = lab.tasks.plan(f"<{BASE}thing/9> rt:locatedOn <{RIGHT}>")
    assert "not known where it is" in plan.refusals[0].text


def test_a_search_that_is_ended_is_not_known_rather_than_no(kb):
    with pytest.raises(SearchLimit):
        kb.tasks.plan("every cup into the left box", max_states=1)


def kb_of(*more: str):
    graph = rtask.open(":memory:", base=BASE)
    graph.update(LAB)
    for text in more:
        graph.update(f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {text} }} }}")
    return graph


def test_reach_follows_from_what_a_robot_has_put_there_and_chances_from_outcomes():
    def done(number: int, success: str) -> str:
        return f"""
  <{BASE}task/{number}> a rt:Place ; rt:assignedTo <{PANDA}> ; rt:handles <{BASE}object/2> ;
    rt:targetSurface <{LEFT}> ; rt:carriedOutBy <{BASE}attempt/{number}> .
  <{BASE}attempt/{number}> a rt:GraspAttempt ; rt:performedBy <{PANDA}> ;
    rt:activates <{PANDA}/hand> ; rt:hasOutcome <{BASE}outcome/{number}> .
  <{BASE}outcome/{number}> a rt:GraspOutcome ; rt:success {success} ;
    rt:hasReason rt:reason_{"ok" if success == "true" else "slip_lift"} ."""

    with kb_of(done(1, "true"), done(2, "true"), done(3, "false")) as graph:
        plan = graph.tasks.plan("the jug into the left box")
        assert graph.explain(iri(PANDA), RT.reaches, iri(LEFT)).holds
    placing = plan.steps[1]
    assert (placing.successes, placing.attempts) == (2, 3)
    # two attempts' weight of the class, (2 + 1) / (3 + 2), beside two of three
    assert placing.chance == pytest.approx((2 + 2 * 0.6) / 5)


ACTION = f"""
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix rt: <{ontology.NS}> .
<https://example.org/kitchen> a owl:Ontology .
<https://example.org/kitchen#Wipe> a owl:Class ; rdfs:subClassOf rt:Task ;
  rt:actionParameters "?robot a cora:Robot . ?place a rt:SupportSurface" ;
  rt:precondition "?robot rt:reaches ?place", "FILTER NOT EXISTS {{ ?it rt:locatedOn ?place }}" ;
  rt:addition "?place <https://example.org/kitchen#wipedBy> ?robot" ;
  rt:planStatement "?task rt:assignedTo ?robot" ; rt:stepText "?robot wipes ?place" .
"""


def test_an_ontology_adds_an_action_and_a_robot_cannot():
    goal = f"<{LEFT}> <https://example.org/kitchen#wipedBy> <{NAO}>"
    with kb_of() as graph:
        graph.update("INSERT DATA { <urn:Fly> rt:actionParameters '?robot a cora:Robot' }".replace(
            "INSERT", f"{PREFIXES} INSERT"), agent="nao-1")  # fmt: skip
        known = read_actions(graph.select, graph.catalogue.is_ontology)
        assert {local_name(action.iri) for action in known} == {"Grasp", "Place", "HandOver"}
        graph.load(ACTION.encode(), "turtle", graph="https://example.org/kitchen")
        assert [step.text for step in graph.tasks.plan(goal).steps] == ["nao-1 wipes left box"]
        (refusal,) = graph.tasks.plan(goal.replace(LEFT, TABLE)).refusals
        assert "were it not that something is located on table" in refusal.text
        assert refusal.by_robot[NAO] == "something is located on table"
        wrong = ACTION.replace('?robot rt:reaches ?place"', '?it rt:locatedOn ?place . ?it a ?x"')
        graph.update("DROP GRAPH <https://example.org/kitchen>")
        graph.load(wrong.encode(), "turtle", graph="https://example.org/kitchen")
        with pytest.raises(DataError, match=r"Wipe: the precondition .* which actions change"):
            graph.tasks.plan(goal)


def test_patterns_that_differ_in_names_alone_are_one_predicate():
    one = parse_pattern("?a rt:locatedOn ?b", ("a", "b"))
    other = parse_pattern("?thing  rt:locatedOn ?hand .", ("hand", "thing"))
    assert (one.predicate, other.arguments) == (other.predicate, ("thing", "hand"))
    for text in ("?a SERVICE ?b", "?x rt:locatedOn ?y", "?a nope:p ?b"):
        with pytest.raises(DataError):
            parse_pattern(text, ("a", "b"))


def test_a_behaviour_tree_has_one_action_a_step_with_its_parameters(kb):
    plan = kb.tasks.plan("every cup into the left box")
    root = ElementTree.fromstring(behaviour_tree(plan.goal, plan.steps))
    actions = root.findall("BehaviorTree/Sequence/*")
    assert [action.tag for action in actions] == [local_name(s.action) for s in plan.steps]
    assert actions[0].get("thing") == CUP
    assert {a.get("ID") for a in root.findall("TreeNodesModel/Action")} == {"Grasp", "Place"}


def test_a_behaviour_tree_has_no_name_that_its_reader_refuses(kb):
    plan = kb.tasks.plan("every cup into the left box")
    classes = dict(zip(dict.fromkeys(step.action for step in plan.steps), ODD_CLASSES, strict=True))
    ports = {"thing": "name", "place": "_skipIf", "hand": "1st"}
    steps = tuple(
        replace(
            step, action=classes[step.action], text=f"{step.text}\x01",
            arguments={ports.get(name, name): value for name, value in step.arguments.items()},
        )
        for step in plan.steps
    )  # fmt: skip
    root = ElementTree.fromstring(behaviour_tree(plan.goal, steps))
    actions = root.findall("BehaviorTree/Sequence/*")
    # Sleep is a node of every factory; a port may be called neither name nor _..., nor begin
    # with a digit, and no name has a dot.
    assert [action.tag for action in actions] == ["Sleep_2", "Pour_1"] * 2
    assert actions[0].get("name") == f"{plan.steps[0].text} "
    assert actions[0].get("name_2") == CUP
    ports = {"robot", "name_2", "x_skipIf", "x1st"}
    for action in actions:
        assert set(action.attrib) == {"name", *ports}
    for model in root.findall("TreeNodesModel/Action"):
        assert {port.get("name") for port in model} == ports


def test_the_pddl_of_a_graph_declares_each_object_once(kb):
    text = kb.tasks.plan("every cup into the left box").problem
    objects = text.partition("(:objects")[2].partition("(:init")[0]
    names = [line.strip().partition(" - ")[0] for line in objects.strip().splitlines()]
    assert len(set(names)) == len(names) > 10


def test_a_stored_plan_is_a_valid_tree_of_tasks_in_order():
    with kb_of() as graph:
        root = graph.tasks.store(graph.tasks.plan("every cup into the left box"), "ann")
        rows = graph.select(f"""{PREFIXES}SELECT ?kind ?who WHERE {{
  <{root}> rt:hasSubTask ?task . ?task rt:stepNumber ?n ; rt:assignedTo ?who ; a ?kind ;
    rt:handles <{BASE}object/1> ; rt:handlesExemplar <{CUP}> VALUES ?kind {{ rt:Grasp rt:Place }}
}} ORDER BY ?n""")
        assert [local_name(str(row.value("kind"))) for row in rows] == ["Grasp", "Place"] * 2
        assert [row.value("who") for row in rows] == [PANDA, PANDA, NAO, NAO]
        assert graph.query(f"ASK {{ <{root}/1> {RT.precedes} <{root}/4> }}")
        with pytest.raises(UsageError, match="only a plan for the whole goal"):
            graph.tasks.store(graph.tasks.plan("the jug into the left box"))


def test_the_command_prints_steps_reasons_and_formats_and_stores(tmp_path, capsys):
    with rtask.open(tmp_path / "kb", base=BASE) as graph:
        graph.update(LAB)
    data = ("-d", str(tmp_path / "kb"))

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(["plan", *arguments, *data])
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    code, out, _ = run("every", "cup", "into", "the", "left", "box", "--because")
    assert code == 0
    assert "red cup located on table  (after step 2)" in out
    assert "rtask explain" in out
    code, out, _ = run("the jug into the left box")
    assert (code, "panda-1 alone lacks" in out) == (1, True)
    assert run("the jugg into the left box")[0] == 1
    code, out, _ = run("pen into the right box", "--pddl")
    assert "(define (problem rtask-problem)" in out
    code, _, err = run("pen into the right box", "--store", "--agent", "ann")
    assert (code, "stored as " in err) == (0, True)
    assert "undo: rtask undo" in err


def test_more_things_than_a_hand_takes_are_refused_one_by_one_without_a_search(kb):
    plan = kb.tasks.plan("put the pen and the jug to panda-1")
    assert not plan.is_complete
    assert [local_name(step.action) for step in plan.steps] == ["Grasp"]
    (left,) = plan.refusals
    assert left.text.startswith("for panda-1 hand, one such goal can hold at a time")
