"""Declarations of the operations; grasps and outcomes that come back."""

from __future__ import annotations

import pytest

from rtask.engine.operations.table import OPERATIONS
from rtask.engine.records.outcomes import Outcome, OutcomeReport
from rtask.engine.records.received import received
from rtask.errors import UsageError
from rtask.wire.fields import kind_of


def test_every_field_of_every_operation_says_what_it_means():
    def walk(message):
        for name, field in message.model_fields.items():
            assert len(field.description or "") > 2, (message, name)
            part = kind_of(field).message
            if part is not None:
                walk(part)

    for operation in OPERATIONS.values():
        assert operation.summary
        walk(operation.request)


def test_a_grasp_may_come_back_with_whatever_the_robot_added():
    grasp = received(
        {"id": "candidate:3", "x": "0.1", "y": 0, "z": 0.3, "theta": 1.0, "rank": 2, "alpha": 5.0,
         "beta": 1.0, "in_object": {"x": 0, "y": 0, "z": 0.03, "theta": 0.7}},
        "grasp",
    )  # fmt: skip
    assert grasp.iri is None
    assert grasp.in_frame == (0.1, 0.0, 0.3, 1.0)
    assert grasp.in_object == (0.0, 0.0, 0.03, 0.7)
    assert grasp.belief == (5.0, 1.0)


@pytest.mark.parametrize(
    ("grasp", "words"),
    [
        ({}, "expected an id or a pose"),
        ({"x": "here", "y": 0, "z": 0, "theta": 0}, r"grasp\.x: expected a finite number"),
        ({"grasp_pose": {}}, r"grasp\.grasp_pose: expected a geometry_msgs/PoseStamped"),
        ({"grasp_pose": 3}, r"grasp\.grasp_pose: expected a geometry_msgs/PoseStamped"),
        ({"in_object": {"x": 1}}, r"grasp\.in_object\.y is missing"),
    ],
)
def test_a_grasp_without_a_pose_is_refused(grasp, words):
    with pytest.raises(UsageError, match=words):
        received(grasp, "grasp")


def test_outcomes_follow_the_codes_of_the_ontology():
    known = frozenset({"ok", "missed"})

    def outcome(**fields):
        return Outcome.of(OutcomeReport(**fields), known, "outcome")

    assert outcome(success=True).reason == "ok"
    assert outcome(success=False, reason="missed").reason == "missed"
    assert outcome(success=False).reason == "not_judged"
    assert outcome(success=False, reason="odd").comments == ("odd",)
