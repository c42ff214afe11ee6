"""With the reasoner on: shapes, verdicts of people, what follows from what is written."""

from __future__ import annotations

import pytest
from pyoxigraph import RdfFormat, parse

import ontology
import rtask
from reasoner.shacl import validate
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access

pytestmark = pytest.mark.slow

PREFIX = (
    "PREFIX rt: <https://w3id.org/rtask-kg/ns#> PREFIX prov: <http://www.w3.org/ns/prov#> "
    "PREFIX sosa: <http://www.w3.org/ns/sosa/> "
)


@pytest.fixture
def kb():
    with rtask.open(":memory:", base="https://example.org/kb/") as opened:
        yield opened


def tell(bench, robot, thing=None, **outcome):
    seen = bench.sight(thing or bench.BOX)
    answer = robot.recognise(seen)
    stored = robot.insert(
        seen, grasp=answer["grasps"][0], outcome=bench.held(**outcome), task_id=answer["task_id"]
    )
    return answer, stored


def test_a_persons_verdict_outweighs_the_robots(bench, kb, engine, robots):
    robot = robots()
    answer, _ = tell(bench, robot)
    teacher = Access("ann", "teacher")
    told = engine.call(
        "teach_object", {"operation": "reject", "task_id": answer["task_id"]}, teacher
    )
    assert told["statistics"] == {"attempts": 1, "successes": 0, "mean": 0.0, "lower_95": 0.0}
    assert kb.match(graph=kb.graphs.agent("ann"))
    engine.call("teach_object", {"operation": "confirm", "task_id": answer["task_id"]}, teacher)
    again = robot.recognise(bench.sight(bench.BOX))
    assert again["grasps"][0]["statistics"]["successes"] == 1
    with pytest.raises(ForbiddenError, match="teach"):
        robot.call("teach_object", operation="reject", task_id=answer["task_id"])


@pytest.mark.slow
def test_what_the_engine_writes_has_the_shapes_of_the_ontology(bench, kb, engine, robots):

    one, two = robots("nao-1"), robots("nao-2")
    for thing in (bench.BOX, bench.CAN):
        tell(bench, one, thing, images=[{"phase": "lifted", "data": bench.png()}])
        answer = two.recognise(bench.sight(thing))
        two.call(
            "report_outcome", task_id=answer["task_id"], object=answer["object"],
            grasp=answer["grasps"][0], gripper_id="right_hand",
            outcome=bench.missed(reason="slip_lift", confirmed_by="human"),
        )  # fmt: skip
    two.call("recognise_for_grasp", gripper_id="right_hand", **bench.sight(bench.PEN))
    two.insert({**bench.sight(bench.PEN)}, class_description="felt pen", name="my pen")
    engine.call(
        "teach_object", {"operation": "confirm", "grasp": answer["grasps"][0]["id"]},
        Access("ann", "teacher"),
    )  # fmt: skip
    assert kb.contradictions() == []
    data = {(q.subject, q.predicate, q.object) for q in kb.match() if not _is_reified(q)}
    shapes = [
        (q.subject, q.predicate, q.object)
        for path in ontology.shapes()
        for q in parse(path.read_bytes(), format=_turtle())
    ]
    report = validate(data, shapes)
    assert report.findings == ()
    for name in ("nao-1", "nao-2", "ann"):
        own = kb.match(graph=kb.graphs.agent(name))
        single = [
            (q.subject, q.predicate, q.object)
            for path in ontology.graph_shapes()
            for q in parse(path.read_bytes(), format=_turtle())
        ]
        alone = {(q.subject, q.predicate, q.object) for q in own if not _is_reified(q)}
        assert validate(alone, single).findings == ()


def _is_reified(quad):
    """Statements about statements are RDF 1.2, which pySHACL does not read."""
    return str(quad.predicate).endswith("#reifies>")


def _turtle():

    return RdfFormat.TURTLE


def test_the_view_leads_to_its_bytes_camera_and_place(bench, kb, engine, robots):
    robot = robots()
    _, stored = tell(bench, robot)
    rows = kb.select(
        PREFIX
        + """SELECT ?kind ?blob ?sensor ?agent {
        ?view rt:viewContent ?content .
        ?content a ?kind ; rt:hasBlob ?blob ; rt:acquiredBy ?sensor ;
          prov:wasGeneratedBy ?event . ?event sosa:madeBySensor ?sensor ;
          prov:wasAssociatedWith ?agent
        FILTER(?kind IN (rt:ColorImage, rt:CompressedPointCloud, rt:SIFTFeatureSet)) }"""
    )
    kinds = {row["kind"].value.split("#")[1] for row in rows}
    assert kinds == {"ColorImage", "CompressedPointCloud", "SIFTFeatureSet"}
    assert all(kb.blobs.read(row["blob"]) for row in rows)
    assert {str(row.value("sensor")) for row in rows} == {
        "https://example.org/kb/robot/nao-1/depth"
    }
    known = kb.ask if hasattr(kb, "ask") else lambda q: kb.query(q)
    thing = stored["objects"][0]["object"]
    assert known(PREFIX + f"ASK {{ <{thing}> rt:knownBy <https://example.org/kb/robot/nao-1> }}")


def test_after_one_lift_every_robot_with_such_a_hand_can_grasp_it(bench, kb, engine, robots):
    """Nobody weighs anything: the payload of the hand that lifted it bounds its mass."""
    robots("nao-2")
    able = PREFIX + "SELECT DISTINCT ?r { ?r rt:canGrasp ?o . ?o a rt:ManipulableObject }"
    assert len(kb.select(able)) == 0
    tell(bench, robots("nao-1"))
    assert {row.value(0).rsplit("/", 1)[-1] for row in kb.select(able)} == {"nao-1", "nao-2"}
