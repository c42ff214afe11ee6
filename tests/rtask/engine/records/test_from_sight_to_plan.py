"""A robot tells what it sees on its table; a goal in words is planned from that."""

from __future__ import annotations

from typing import Any

import pytest

import rtask
from rtask.engine import Engine
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import iri

BASE = "https://example.org/kb/"
ROBOT = f"{BASE}robot/arm-1"
GOAL = "every cup into the bin"
PRODUCTS = f"""{PREFIXES} INSERT DATA {{
  <urn:lab:blue> a rt:Cup ; rt:objectId "lab/1" ; rt:name "blue cup" ; rt:mass 0.2e0 ;
    rt:graspWidth 0.07e0 .
  <urn:lab:red> a rt:Cup ; rt:objectId "lab/2" ; rt:name "red cup" ; rt:mass 0.2e0 ;
    rt:graspWidth 0.07e0 }}"""
BODY = {
    "name": "arm-1", "model": "arm", "frames": ["base_link"],
    "end_effectors": [
        {"name": "hand", "gripper_type": "jaw", "max_opening": 0.085, "max_payload": 2.0}
    ],
}  # fmt: skip


def at(x: float, y: float, z: float) -> dict[str, Any]:
    turned = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    return {"position": {"x": x, "y": y, "z": z}, "orientation": turned}


@pytest.fixture
def lab() -> Any:
    with rtask.open(":memory:", base=BASE) as kb:
        assert isinstance(kb, KnowledgeBase)
        kb.update(PRODUCTS)
        with Engine(kb) as engine:
            table = {"name": "table", "pose": at(0.5, 0, 0), "length": 0.8, "width": 1.0}
            box = {"name": "bin", "pose": at(0, 0.6, 0), "length": 0.3, "width": 0.3}
            places = [table, {**box, "rim_height": 0.1}]
            engine.call("register_robot", {**BODY, "places": places})
            yield kb, engine


def test_what_it_sees_it_takes_from_the_table_to_the_box_once_it_is_known_to_reach_both(
    lab: tuple[KnowledgeBase, Engine],
) -> None:
    kb, engine = lab
    cups = [{"object": "blue cup", "pose": at(0.5, 0.1, 0.05)},
            {"object": "red cup", "pose": at(0.6, -0.2, 0.05)}]  # fmt: skip
    seen = engine.call("report_sightings", {"frame": "arm-1/base_link", "seen": cups})
    where = engine.call("where_is", {"name": "blue cup"})["things"][0]
    assert (where["relation"], where["place_label"]) == ("on", "table")
    unknown = engine.call("plan_goal", {"goal": GOAL})
    assert "it is not known that arm-1 reaches table" in unknown["text"]
    held = {
        "task_id": "t-1", "object": "urn:lab:blue", "thing": seen["things"][0],
        "gripper_id": f"{ROBOT}/hand", "grasp": {"in_object": {"x": 0, "y": 0, "z": 0, "theta": 0}},
        "outcome": {"success": True, "placed": True, "place": "bin"},
    }  # fmt: skip
    engine.call("report_outcome", held)
    for place in ("table", "bin"):
        assert kb.match(iri(ROBOT), RT.reaches, iri(f"{ROBOT}/place/{place}")), place
    plan = engine.call("plan_goal", {"goal": GOAL})
    assert plan["complete"], plan["text"]
    assert len(plan["steps"]) == 2, "the blue cup is there already"
    engine.call("withdraw_contributor", {"contributor": "arm-1"})
    assert not kb.match(iri(ROBOT), RT.reaches), "that was known from what it took and put"
