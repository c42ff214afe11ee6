"""A knowledge base with two robots, a mug and a pen, and grasps of both."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:") as kb:
        yield kb


@pytest.fixture
def lab(kb: KnowledgeBase) -> KnowledgeBase:
    return furnish(kb)


@pytest.fixture(scope="module")
def still_lab() -> Iterator[KnowledgeBase]:
    """The same for tests that only read; opening takes a second."""
    with rtask.open(":memory:") as kb:
        yield furnish(kb)


def furnish(kb: KnowledgeBase) -> KnowledgeBase:
    with kb.session(agent="nao-1") as s:
        nao = RTASK.Robot(iri=kb.base + "robot/nao-1", name="nao-1")
        hand = RTASK.Hand(
            iri=kb.base + "robot/nao-1/hand",
            end_effector_of=nao,
            gripper_type="nao_hand",
            min_opening=0.0,
            max_opening=0.05,
            max_payload=0.15,
        )
        mug = RTASK.Mug(
            iri=kb.base + "object/1", object_id="lab/mug-1", name="mug", mass=0.3, grasp_width=0.07
        )
        pen = RTASK.Pen(iri=kb.base + "object/2", object_id="lab/pen-1", name="pen", mass=0.01)
        frame = RTASK.Frame(iri=kb.base + "frame/table", frame_id="table")
        s.add(hand)
        for n, (thing, quality) in enumerate([(mug, 0.9), (mug, 0.6), (pen, 0.8)], 1):
            s.add(
                RTASK.PlanarGrasp(
                    iri=f"{kb.base}grasp/{n}",
                    grasp_of=thing,
                    gripper_type="nao_hand",
                    grasp_quality=quality,
                    grasp_pose=RTASK.PlanarPose(x=0.1 * n, y=0.0, theta=0.5, in_frame=frame),
                )
            )
    attempt(kb, "nao-1", 1, success=True)
    attempt(kb, "nao-1", 3, success=False)
    return kb


def attempt(kb: KnowledgeBase, agent: str, grasp: int, success: bool) -> str:
    """Write one attempt with its outcome; return its IRI."""
    with kb.session(agent=agent) as s:
        made = RTASK.GraspAttempt(
            executes_grasp=s.get(RTASK.PlanarGrasp, f"{kb.base}grasp/{grasp}"),
            performed_by=s.get(RTASK.Robot, kb.base + "robot/nao-1"),
            activates=s.get(RTASK.Hand, kb.base + "robot/nao-1/hand"),
            has_outcome=RTASK.GraspOutcome(
                success=success,
                has_reason=RTASK.reason_ok if success else RTASK.reason_missed,
                has_feedback=RTASK.PhysicsFeedback(verdict=success),
            ),
        )
        s.add(made)
        return made.iri
