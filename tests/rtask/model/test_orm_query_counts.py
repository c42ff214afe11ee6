"""How many queries a typical loop over objects sends, near and far: not one for each object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from rtask.errors import LazyLoadError
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK
from rtask.model.view import View

G = RTASK.PlanarGrasp


@pytest.fixture
def queries(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The queries that sessions send, and the look-ups of single objects."""
    sent: list[str] = []

    def noted(name: str) -> Callable[..., Any]:
        original = getattr(View, name)

        def call(view: View, text: str) -> Any:
            sent.append(text)
            return original(view, text)

        return call

    for name in ("select", "rows"):
        monkeypatch.setattr(View, name, noted(name))
    return sent


@pytest.fixture(scope="module")
def shelf(still_lab: KnowledgeBase) -> KnowledgeBase:
    """Forty more grasps, each with a pose of its own, of the mug."""
    with still_lab.session(agent="nao-1") as s:
        mug = s.query(RTASK.Mug).one()
        frame = s.query(RTASK.Frame).one()
        for n in range(40):
            pose = RTASK.PlanarPose(x=0.01 * n, y=0.0, theta=0.0, in_frame=frame)
            s.add(G(grasp_of=mug, gripper_type="nao_hand", grasp_quality=0.1, grasp_pose=pose))
    return still_lab


def test_a_loop_over_values_is_one_query(shelf: KnowledgeBase, queries: list[str]) -> None:
    with shelf.session() as s:
        assert len([(g.grasp_quality, g.gripper_type) for g in s.query(G)]) == 43
    assert len(queries) == 1


def test_a_loop_over_prefetched_links_is_one_query_whatever_their_number(
    shelf: KnowledgeBase, queries: list[str]
) -> None:
    for limit in (3, 43):
        queries.clear()
        with shelf.session() as s:
            grasps = s.query(G).prefetch(G.grasp_of, G.grasp_pose.in_frame).limit(limit).all()
            seen = [
                (thing.name, g.grasp_pose.in_frame.frame_id) for g in grasps for thing in g.grasp_of
            ]
        assert len(seen) == limit
        assert len(queries) == 1, queries


def test_a_loop_that_would_ask_for_each_object_is_refused_unless_it_is_allowed(
    shelf: KnowledgeBase, queries: list[str]
) -> None:
    with shelf.session() as s, pytest.raises(LazyLoadError, match="prefetch"):
        [g.grasp_pose.in_frame for g in s.query(G)]
    queries.clear()
    with shelf.session(lazy="allow") as s:
        assert len([g.grasp_pose.in_frame for g in s.query(G)]) == 43
    assert len(queries) > 40


def test_writing_many_objects_asks_once(shelf: KnowledgeBase, queries: list[str]) -> None:
    with shelf.session(agent="nao-1") as s:
        grasps = s.query(G).where(G.grasp_quality == 0.1).all()
        queries.clear()
        for grasp in grasps:
            grasp.grasp_quality = 0.2
        s.flush()
        assert len(queries) <= 1, queries
