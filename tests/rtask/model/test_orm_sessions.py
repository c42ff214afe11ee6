"""Changes of objects become one transaction of one agent, or nothing."""

from __future__ import annotations

import gc

import pytest
from pyoxigraph import NamedNode

import ontology
import rtask
from rtask.errors import (
    DataError,
    InconsistentError,
    UnknownTermError,
    UsageError,
    VersionConflictError,
)
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK, FieldError, OwnershipError, Session

pytestmark = pytest.mark.slow

RT = ontology.NS


def _mass(kb: KnowledgeBase) -> list[tuple[float, str]]:
    quads = kb.match(kb.base + "object/1", RT + "mass")
    return sorted(
        (float(q.object.value), q.graph_name.value.rsplit("/", 1)[-1])  # type: ignore[union-attr]
        for q in quads
    )


def test_asked_twice_the_same_object(lab: KnowledgeBase) -> None:
    with lab.session() as s:
        mug = s.get(RTASK.ManipulableObject, lab.base + "object/1")
        assert s.get(RTASK.Mug, NamedNode(lab.base + "object/1")) is mug
        assert s.query(RTASK.Mug).one() is mug


def test_objects_nobody_holds_are_let_go(lab: KnowledgeBase) -> None:
    with lab.session() as s:
        s.query(RTASK.GraspConfiguration).prefetch(RTASK.GraspConfiguration.grasp_of).all()
        gc.collect()
        assert s.known(lab.base + "grasp/1") is None


def test_unknown_and_misnamed_objects(lab: KnowledgeBase) -> None:
    with lab.session() as s:
        assert s.find(RTASK.Mug, lab.base + "object/99") is None
        with pytest.raises(UnknownTermError, match="knows no Mug"):
            s.get(RTASK.Mug, lab.base + "object/99")
        with pytest.raises(UnknownTermError, match=r"is a .*, not a Frame"):
            s.get(RTASK.Frame, lab.base + "object/1")
        with pytest.raises(DataError, match="not an absolute IRI: 'object 1'"):
            s.get(RTASK.Mug, "object 1")
        with pytest.raises(UsageError, match="Mug has no field 'masss'"):
            s.stated_by(s.get(RTASK.Mug, lab.base + "object/1"), "masss")


def test_a_block_is_one_commit_in_the_agents_graph(kb: KnowledgeBase) -> None:
    before = kb.seq
    with kb.session(agent="nao-1") as s:
        s.add(RTASK.Mug(object_id="lab/mug-1"))
        s.add(RTASK.Pen(object_id="lab/pen-1"))
    assert kb.seq == before + 1
    graphs = {q.graph_name for q in kb.match(predicate=RT + "objectId")}
    assert graphs == {kb.graphs.agent("nao-1")}


def test_without_an_agent_the_shared_graph_is_written(kb: KnowledgeBase) -> None:
    with kb.session() as s:
        s.add(RTASK.Mug(object_id="lab/mug-1"))
    assert kb.match(predicate=RT + "objectId")[0].graph_name == kb.graphs.shared


def test_a_failing_block_writes_nothing(lab: KnowledgeBase) -> None:
    before = lab.seq
    with pytest.raises(RuntimeError), lab.session(agent="nao-1") as s:  # noqa: PT012
        s.get(RTASK.Mug, lab.base + "object/1").mass = 0.5
        raise RuntimeError
    assert (lab.seq, _mass(lab)) == (before, [(0.3, "nao-1")])


def test_reading_writes_nothing(lab: KnowledgeBase) -> None:
    before = lab.seq
    with lab.session(agent="nao-1") as s:
        _ = s.get(RTASK.Mug, lab.base + "object/1").mass
        assert s.flush() is None
    assert lab.seq == before


def test_only_the_difference_is_written(lab: KnowledgeBase) -> None:
    with lab.session(agent="nao-1") as s:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        mug.mass, mug.grasp_width = 0.35, 0.07
        mug.name.add("mug")
        commit = s.flush()
        assert commit is not None
        assert (commit.added, commit.removed) == (1, 1)
        assert mug.mass == 0.35
    assert _mass(lab) == [(0.35, "nao-1")]


def test_new_objects_follow_what_points_to_them(lab: KnowledgeBase) -> None:
    with lab.session(agent="nao-1") as s:
        grasp = s.get(RTASK.PlanarGrasp, lab.base + "grasp/2")
        grasp.tried_in.add(
            RTASK.GraspAttempt(
                performed_by=s.get(RTASK.Robot, lab.base + "robot/nao-1"),
                activates=s.get(RTASK.Hand, lab.base + "robot/nao-1/hand"),
                has_outcome=RTASK.GraspOutcome(
                    success=True,
                    has_reason=RTASK.reason_ok,
                    has_feedback=RTASK.PhysicsFeedback(verdict=True),
                ),
            )
        )
        assert [type(item).__name__ for item in s.new] == [
            "GraspAttempt",
            "GraspOutcome",
            "PhysicsFeedback",
        ]
    with lab.session() as s:
        proven = s.query(RTASK.ProvenGrasp).where(RTASK.ProvenGrasp.grasp_of.name == "mug")
        assert proven.count() == 2
    stored = lab.match(predicate=RT + "executesGrasp", value=NamedNode(lab.base + "grasp/2"))
    assert len(stored) == 1  # the direction that the ontology stores


def test_new_iris_say_what_they_are_and_sort_by_time(kb: KnowledgeBase) -> None:
    with Session(kb, check_required=False) as s:
        made = [RTASK.GraspAttempt() for _ in range(3)]
        for item in made:
            s.add(item)
        assert all(item.iri.startswith(kb.base + "grasp-attempt/") for item in made)
        assert all(item.iri.rsplit("/", 1)[1][14] == "7" for item in made)  # UUID version 7
        assert len({item.iri for item in made}) == 3


def test_a_new_object_must_have_what_its_shape_asks_for(kb: KnowledgeBase) -> None:
    with pytest.raises(FieldError, match="lacks object_id"), kb.session(agent="nao-1") as s:
        s.add(RTASK.Mug(mass=0.3))
    assert kb.match(predicate=RT + "mass") == []


def test_a_measurement_of_another_robot_stays(lab: KnowledgeBase) -> None:
    with lab.session(agent="pr2") as s:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        assert mug.mass == 0.3
        mug.mass = 0.25
    assert _mass(lab) == [(0.25, "pr2"), (0.3, "nao-1")]
    for agent, mass in (("pr2", 0.25), ("nao-1", 0.3)):  # each sees its own first
        with lab.session(agent=agent) as s:
            mug = s.get(RTASK.Mug, lab.base + "object/1")
            assert mug.mass == mass
            assert len(s.stated_by(mug, "mass")) == 2


def test_a_single_truth_of_another_robot_cannot_be_replaced(lab: KnowledgeBase) -> None:
    before = lab.seq
    with pytest.raises(OwnershipError, match="another agent states"), lab.session("pr2") as s:
        s.get(RTASK.Mug, lab.base + "object/1").object_id = "lab/other"
    with pytest.raises(OwnershipError, match="another agent states"), lab.session("pr2") as s:
        s.get(RTASK.Mug, lab.base + "object/1").name.discard("mug")
    assert lab.seq == before


def test_what_others_state_cannot_be_deleted(lab: KnowledgeBase) -> None:
    mug, before = lab.base + "object/1", lab.seq
    with pytest.raises(OwnershipError, match="nao-1"), lab.session("pr2") as s:
        s.delete(s.get(RTASK.Mug, mug))
    assert lab.seq == before


def test_an_object_of_which_others_state_something_stays_and_that_is_said(
    lab: KnowledgeBase,
) -> None:
    mug = lab.base + "object/1"
    with lab.session("pr2") as s:
        s.get(RTASK.Mug, mug).mass = 0.25
    with pytest.warns(UserWarning, match="others state more"), lab.session("pr2") as s:
        s.delete(s.get(RTASK.Mug, mug))
    assert _mass(lab) == [(0.3, "nao-1")]


def test_a_contradiction_is_refused_as_a_whole(lab: KnowledgeBase) -> None:
    before = lab.seq
    with pytest.raises(InconsistentError), lab.session(agent="nao-1") as s:  # noqa: PT012
        s.get(RTASK.Mug, lab.base + "object/1").name.add("cup")
        robot = NamedNode(lab.base + "robot/nao-1")
        s.add(RTASK.Human(iri=robot.value, name="not a robot"))
    assert lab.seq == before


def test_what_others_write_is_seen(lab: KnowledgeBase) -> None:
    with lab.session(agent="nao-1") as s, lab.session(agent="nao-1") as other:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        other.get(RTASK.Mug, lab.base + "object/1").mass = 0.4
        other.flush()
        assert s.get(RTASK.Mug, lab.base + "object/1") is mug
        assert mug.mass == 0.4


def test_what_was_changed_in_between_is_not_overwritten(lab: KnowledgeBase) -> None:
    with lab.session(agent="nao-1") as other:
        s = lab.session(agent="nao-1")
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        mug.mass = 0.5
        other.get(RTASK.Mug, lab.base + "object/1").mass = 0.4
        other.flush()
        with pytest.raises(VersionConflictError, match="changed by somebody else"):
            s.flush()
        s.refresh(mug)
        s.flush()
        s.close()
    assert _mass(lab) == [(0.5, "nao-1")]


def test_a_session_without_inference_can_replace_what_is_also_derived(lab: KnowledgeBase) -> None:
    with Session(lab, "nao-1", inferred=False) as s:
        grasp = s.get(RTASK.PlanarGrasp, lab.base + "grasp/1")
        frame = RTASK.Frame(frame_id="other")
        grasp.grasp_pose = RTASK.PlanarPose(x=1.0, y=0.0, theta=0.0, in_frame=frame)
    with lab.session() as s:
        pose = s.get(RTASK.PlanarGrasp, lab.base + "grasp/1").grasp_pose
        assert isinstance(pose, RTASK.PlanarPose)
        assert pose.in_frame is not None
        assert pose.in_frame.frame_id == "other"


def test_an_object_that_was_not_added_is_not_written_and_keeps_its_values(
    lab: KnowledgeBase,
) -> None:
    with lab.session(agent="nao-1") as s:
        grasp = s.get(RTASK.PlanarGrasp, lab.base + "grasp/1")
        idea = RTASK.GraspAttempt(executes_grasp=grasp, attempt_number=7)
        grasp.grasp_quality = 0.95
        s.flush()
        assert (idea.attempt_number, idea.executes_grasp) == (7, grasp)
    assert lab.match(predicate=RT + "attemptNumber") == []


def test_deleting_takes_back_own_statements_only(lab: KnowledgeBase) -> None:
    mug = lab.base + "object/1"
    lab.update(f"PREFIX rt: <{RT}> INSERT DATA {{ <{mug}> rt:mass 0.2e0 }}", agent="pr2")
    with lab.session(agent="nao-1") as s:
        item = s.get(RTASK.Mug, mug)
        s.delete(item)
        assert s.deleted == [item]
        with pytest.raises(UsageError, match="was deleted"):
            item.mass = 1.0
        with pytest.warns(UserWarning, match="others state more about it"):
            s.flush()
    left = [q for q in lab.match(mug) if q.graph_name != lab.graphs.inferred]
    assert [q.graph_name for q in left] == [lab.graphs.agent("pr2")]
    with lab.session() as s:
        assert (
            s.query(RTASK.GraspConfiguration)
            .where(RTASK.GraspConfiguration.grasp_of.is_none())
            .count()
            == 2
        )


def test_deleting_can_cascade(lab: KnowledgeBase) -> None:
    with lab.session(agent="nao-1") as s:
        s.delete(s.get(RTASK.Mug, lab.base + "object/1"), cascade=["has_grasp"])
    with lab.session() as s:
        assert s.query(RTASK.PlanarGrasp).ids() == [lab.base + "grasp/3"]


def test_an_object_belongs_to_one_session(lab: KnowledgeBase) -> None:
    with lab.session() as s, lab.session() as other:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        with pytest.raises(UsageError, match="another session"):
            other.add(mug)
        with pytest.raises(UsageError, match="does not belong"):
            other.delete(mug)


def test_a_session_on_a_plain_store(tmp_path: object) -> None:
    with rtask.open(":memory:", plain=True) as kb:
        with Session(kb, inferred=False) as s:
            s.add(RTASK.Mug(iri="urn:mug", object_id="lab/mug-1"))
        with Session(kb, inferred=False) as s:
            assert s.get(RTASK.Mug, "urn:mug").object_id == "lab/mug-1"


def test_without_reasoning_subclasses_and_inverses_are_found_all_the_same() -> None:
    with rtask.open(":memory:", reason=False) as kb:
        with kb.session("ann") as s:
            mug = RTASK.Mug(object_id="lab/mug-1")
            s.add(RTASK.PlanarGrasp(grasp_of=mug, gripper_type="nao_hand", grasp_pose=_pose()))
        with kb.session() as s:
            found = s.query(RTASK.Container).one()
            assert isinstance(found, RTASK.Mug)
            (grasp,) = found.has_grasp
            assert list(grasp.grasp_of) == [found]


def _pose() -> RTASK.PlanarPose:
    return RTASK.PlanarPose(x=0.0, y=0.0, theta=0.0, in_frame=RTASK.Frame(frame_id="table"))


def test_an_object_with_very_many_statements_is_read_by_its_fields(kb: KnowledgeBase) -> None:
    with kb.session("ann") as s:
        names = [f"mug {n}" for n in range(700)]
        s.add(RTASK.Mug(iri="urn:hub", object_id="lab/mug-1", name=names, mass=0.3))
    with kb.session() as s:
        mug = s.get(RTASK.Mug, "urn:hub")
        assert (len(mug.name), mug.mass, len(mug.has_grasp)) == (700, 0.3, 0)


def test_of_a_pair_of_inverses_that_was_read_the_former_side_is_left(lab: KnowledgeBase) -> None:
    with lab.session(check_required=False) as s:
        first, second = RTASK.PlanarGrasp(), RTASK.PlanarGrasp()
        attempt = RTASK.GraspAttempt(executes_grasp=first)
        for new in (first, second, attempt):
            s.add(new)
        named = attempt.iri, first.iri, second.iri
    with lab.session() as s:
        attempt, first, second = (
            s.get(kind, name)
            for kind, name in zip(
                (RTASK.GraspAttempt, RTASK.PlanarGrasp, RTASK.PlanarGrasp), named, strict=True
            )
        )
        assert (list(first.tried_in), attempt.executes_grasp) == ([attempt], first)
        second.tried_in.add(attempt)  # nothing of this object waits to be written so far
        assert list(first.tried_in) == []
        assert (list(second.tried_in), attempt.executes_grasp) == ([attempt], second)
