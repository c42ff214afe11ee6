"""A small lab: two robots with a frame each, and products that they know."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode, iri
from rtask.world import WorldEdit
from rtask.world.edit import Seen

BASE = "https://example.org/kb/"
NOON = 1_764_331_200.0

_LAB = f"""{PREFIXES}
INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
  <{BASE}object/1> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue cup" ;
    rt:extentX 0.09e0 ; rt:extentY 0.08e0 .
  <{BASE}object/2> a rt:Box ; rt:objectId "lab/2" ; rt:name "tea box" .
  <{BASE}robot/nao-1> a cora:Robot ; rt:name "nao-1" ; rt:bodyFrame <{BASE}robot/nao-1/frame/base> .
  <{BASE}robot/nao-2> a cora:Robot ; rt:name "nao-2" ; rt:bodyFrame <{BASE}robot/nao-2/frame/base> .
  <{BASE}robot/nao-1/frame/base> a rt:Frame ; rt:frameId "base" .
  <{BASE}robot/nao-2/frame/base> a rt:Frame ; rt:frameId "base" .
  <{BASE}frame/map> a rt:Frame ; rt:frameId "map" .
  <{BASE}frame/table> a rt:Frame ; rt:frameId "table" .
  <{BASE}robot/nao-1/place/left%20box> a rt:SupportSurface ; rt:name "left box" .
}} }}"""


@dataclass
class Lab:
    """A knowledge base, and what robots say in it."""

    kb: KnowledgeBase
    cup: str = f"{BASE}object/1"
    box: str = f"{BASE}object/2"
    map: str = f"{BASE}frame/map"
    table: str = f"{BASE}frame/table"
    left_box: str = f"{BASE}robot/nao-1/place/left%20box"
    noon: float = NOON
    graphs: dict[str, NamedNode] = field(default_factory=dict)

    def frame(self, robot: str = "nao-1") -> str:
        return f"{BASE}robot/{robot}/frame/base"

    def hand(self, robot: str = "nao-1") -> str:
        return f"{BASE}robot/{robot}/hand"

    def edit(self, robot: str = "nao-1") -> WorldEdit:
        return WorldEdit(self.kb.world, self.kb.graphs.agent(robot))

    def seen(self, product: str, x: float, y: float, time_s: float, **more: Any) -> Seen:
        robot = more.pop("robot", "nao-1")
        given = {
            "frame": self.frame(robot), "robot": f"{BASE}robot/{robot}", "sigma_m": 0.003,
            "hands": (self.hand(robot),), "agent": f"{BASE}robot/{robot}",
        }  # fmt: skip
        return Seen(
            product, frame_from_exemplar=pose(x, y), time_s=self.noon + time_s, **{**given, **more}
        )

    def see(self, product: str, x: float, y: float, time_s: float, **more: Any) -> str:
        robot = more.get("robot", "nao-1")
        edit = self.edit(robot)
        exemplar = edit.see(self.seen(product, x, y, time_s, **more))
        self.commit(edit, robot)
        return exemplar

    def put(
        self, exemplar: str, relation: Any, place: str, time_s: float, robot: str = "nao-1"
    ) -> None:
        edit = self.edit(robot)
        edit.put(exemplar, relation, place, self.noon + time_s, f"{BASE}robot/{robot}")
        self.commit(edit, robot)

    def lose(self, exemplar: str, time_s: float, robot: str = "nao-1") -> None:
        edit = self.edit(robot)
        edit.lose(exemplar, self.noon + time_s)
        self.commit(edit, robot)

    def stand(self, frame: str, parent: str, x: float, y: float, time_s: float) -> None:
        edit = self.edit()
        edit.stand(frame, parent, pose(x, y), self.noon + time_s)
        self.commit(edit, "nao-1")

    def commit(self, edit: WorldEdit, robot: str) -> None:
        with self.kb.transaction(robot) as tx:
            for statement in edit.withdrawn:
                tx.remove(*statement)
            for statement in edit.statements:
                tx.add(*statement)

    def ask(self, name: str, time_s: float, **question: Any) -> Any:
        return self.kb.world.where_is(name, at=self.noon + time_s, **question)

    def current(self, exemplar: str) -> int:
        """Return the number of placements of a thing that have not ended."""
        return sum(placement.is_current for placement in self.kb.world.history(exemplar))


def pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> NDArray[np.float64]:
    """Return a pose (4, 4), m."""
    made = np.eye(4)
    made[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    made[:3, 3] = x, y, z
    return made


@pytest.fixture
def lab() -> Iterator[Lab]:
    with rtask.open(":memory:", base=BASE, reason=False) as kb:
        kb.update(_LAB)
        assert kb.match(iri(f"{BASE}object/1"))
        yield Lab(kb)
