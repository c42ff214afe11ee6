"""What attempts at all objects say of what hides in the next one.

Kept in memory and renewed as outcomes are added or taken away, like the honesty of robots
(:mod:`rtask.engine.honesty`): it follows from the attempts in the graph alone.
"""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from grasp.learning.population import Population, ProductEvidence, evidence_of
from rtask.engine.policy import JUDGED, LOST
from rtask.rdf.namespaces import PREFIXES, RT

if TYPE_CHECKING:
    from rtask.engine.grippers import GripperCatalogue
    from rtask.engine.honesty import HonestyCatalogue
    from rtask.kb.commit.commit import Change
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row

__all__ = ["PopulationCatalogue"]

_LATEST = 5_000
"""Attempts that are looked at, so that no decision waits long for it."""
_STALE_SHARE = 0.02
"""It is renewed when outcomes have changed by more than this share of those known."""


class PopulationCatalogue:
    """Evidence of every object that was tried from above.

    Parameters
    ----------
    kb
        The knowledge base.
    grippers
        Hands, for the widths of their fingers.
    honesty
        How far the robots' reports count.
    """

    def __init__(
        self, kb: GraphCore, grippers: GripperCatalogue, honesty: HonestyCatalogue
    ) -> None:
        self._kb, self._grippers, self._honesty = kb, grippers, honesty
        self._lock = threading.Lock()
        self._cached: Population | None = None
        self._total = self._changed = 0

    def forget_if_changed(self, change: Change) -> None:
        """Take note of a commit with outcomes or verdicts."""
        changed = sum(
            quad.predicate in (RT.hasOutcome, RT.judgedSuccess, RT.disputed, RT.verdict)
            for quad in (*change.added, *change.removed)
        )
        if changed:
            with self._lock:
                self._changed += changed

    def now(self) -> Population:
        """Return the population, which may lack a fiftieth of the outcomes."""
        with self._lock:
            if self._cached is None or self._changed > _STALE_SHARE * self._total:
                self._renew()
            assert self._cached is not None
            return self._cached

    def _renew(self) -> None:
        rows = list(self._kb.select(_query()))
        self._total, self._changed = len(rows), 0
        of_object: dict[str, list[Row]] = defaultdict(list)
        for row in rows:
            of_object[str(row.value("object"))].append(row)
        doubts = self._honesty.doubts()
        widths = {
            stored.iri.value: float(stored.gripper.finger_width) for stored in self._grippers.all()
        }
        self._cached = Population([
            _evidence(name, mine, doubts, widths) for name, mine in sorted(of_object.items())
        ])  # fmt: skip


def _query() -> str:
    """Return the query for the latest judged attempts from above, each at its object."""
    return f"""{PREFIXES}
SELECT DISTINCT ?object ?length ?width ?height ?x ?held ?robot ?hand ?attempt WHERE {{
  {{ SELECT ?attempt WHERE {{
    ?attempt rt:hasOutcome ?any ; prov:endedAtTime ?end
  }} ORDER BY DESC(?end) DESC(?attempt) LIMIT {_LATEST} }}
  {JUDGED} {LOST} FILTER(!?lost)
  ?object rt:hasGrasp ?grasp ; rt:extentX ?length ; rt:extentY ?width ; rt:extentZ ?height .
  ?grasp rt:graspPose ?pose . ?pose rt:theta ?theta ; rt:x ?x .
  ?attempt rt:performedBy ?robot
  OPTIONAL {{ ?attempt rt:activates ?hand }}
  FILTER NOT EXISTS {{ ?object a rt:Exemplar }}
}}"""


def _evidence(
    name: str, rows: list[Row], doubts: dict[str, float], widths: dict[str, float]
) -> ProductEvidence:
    size = [min(float(str(row.value(side))) for row in rows) for side in _SIDES]
    # One row an attempt: of several hands, the one with the widest finger.
    tries: dict[str, tuple[float, float, float, float]] = {}
    for row in sorted(rows, key=lambda row: str(row.value("hand") or "")):
        attempt, robot = str(row.value("attempt")), str(row.value("robot"))
        finger = max(
            widths.get(str(row.value("hand")), 0.0), tries.get(attempt, (0.0, 0.0, 0.0, 0.0))[1]
        )
        held = float(str(row.value("held")).lower() == "true")
        tries[attempt] = float(str(row.value("x"))), finger, held, doubts.get(robot, 1.0)
    x, finger_width, held_at, weight = np.array([tries[key] for key in sorted(tries)]).T
    return evidence_of(name, size, x / size[0], finger_width / 2 / size[0], held_at, weight)


_SIDES = ("length", "width", "height")
