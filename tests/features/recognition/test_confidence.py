"""When a look may decide, and when it may only suggest."""

from __future__ import annotations

from dataclasses import replace

import pytest

from features.recognition.confidence import Evidence, confidences

# An object without texture: no inliers, a clear lead, the size of the most similar view.
PLAIN = Evidence(
    inliers=0, rival_inliers=0, appearance=0.95, appearance_lead=0.15,
    size_ok=True, size_gap=0.01, keypoints=20,
)  # fmt: skip


def test_a_measured_look_decides_for_what_carries_no_print() -> None:
    assert confidences([PLAIN])[0] > 0.7


@pytest.mark.parametrize(
    "change",
    [
        {"keypoints": 300},  # a print that geometry did not confirm
        {"size_gap": 0.12},  # a larger one of the same sort
        {"size_gap": None, "size_ok": None},  # no depth
        {"size_gap": None},  # too few objects to compare with
        {"size_ok": False},
        {"appearance_lead": 0.02},  # something else looks like it too
        {"appearance": 0.80},
        {"is_twin": True},
    ],
)
def test_otherwise_a_look_does_not_decide(change: dict[str, object]) -> None:
    assert confidences([replace(PLAIN, **change)])[0] < 0.7  # type: ignore[arg-type]


def test_agreeing_places_decide_without_a_size() -> None:
    bare = Evidence(inliers=14, rival_inliers=0, appearance=0.8, appearance_lead=0.05)
    assert confidences([bare])[0] > 0.7
    assert confidences([replace(bare, inliers=3)])[0] < 0.7
