"""What is promised of planned grasps, grown from the outcomes in the graph.

A grasp planned on a mesh keeps the scores that it was ranked by (``rt:liftScore``,
``rt:carryScore``, ``rt:loadShare``). Once it was tried, its outcome says whether what was promised
of these scores held, and everything that is promised of the same hand follows; see
:mod:`grasp.spatial.scoring.promises`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from grasp.spatial.gripper import EndEffector, ParallelGripper
from grasp.spatial.scoring.promises import Outcome, Promises
from rtask.engine.policy import JUDGED
from rtask.rdf.namespaces import PREFIXES, RT, reason, values
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.sparql.results import Row

__all__ = ["SCORES", "grown_promises", "hands_of_type", "stored_scores"]

SCORES: Mapping[str, NamedNode] = {
    "lift": RT.liftScore, "carry": RT.carryScore, "load": RT.loadShare,
}  # fmt: skip
"""Property of an evaluation for each score that promises rest on."""

_LOST_ON_THE_WAY = reason("slip_transport")
_TRUSTED = 0.5
"""Reports that count less than this are left out: here an outcome counts in whole or not at all."""

_SCORED = """?grasp rt:hasEvaluation ?evaluation . ?evaluation rt:liftScore ?lift ;
    rt:carryScore ?carry OPTIONAL { ?evaluation rt:loadShare ?load }"""


def grown_promises(
    context: Context, gripper: EndEffector, hands: Sequence[NamedNode]
) -> Promises | None:
    """Return what is promised of grasps by a gripper after all outcomes of hands.

    Parameters
    ----------
    gripper
        A hand; None is returned unless it has two jaws, as promises are about these.
    hands
        IRIs of the hands whose outcomes count: one, or all of its type.
    """
    if not isinstance(gripper, ParallelGripper):
        return None
    return Promises.by(gripper).after(_outcomes(context, hands))


def hands_of_type(context: Context, gripper_type: str) -> list[NamedNode]:
    """Return the IRIs of the registered hands of a type."""
    registered = context.grippers.all()
    return [stored.iri for stored in registered if stored.gripper.gripper_type == gripper_type]


def stored_scores(context: Context, grasps: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return ``lift``, ``carry`` and, if known, ``load`` of those grasps (IRIs) that keep them."""
    if not grasps:
        return {}
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?grasp ?lift ?carry ?load WHERE {{ VALUES ?grasp {{ {values(grasps)} }} {_SCORED} }}""")
    return {str(row.value("grasp")): _scores(row) for row in rows}


def _outcomes(context: Context, hands: Sequence[NamedNode]) -> list[Outcome]:
    if not hands:
        return []
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?attempt ?robot ?lift ?carry ?load ?held ?decided ?reason ?placed ?lost WHERE {{
  VALUES ?hand {{ {values([hand.value for hand in hands])} }}
  ?attempt rt:activates ?hand ; rt:performedBy ?robot .
  {JUDGED}
  {_SCORED}
  OPTIONAL {{ ?outcome rt:placed ?placed }}
  OPTIONAL {{ ?outcome rt:placeReason ?lost }}
}} ORDER BY ?attempt""")
    doubts = context.honesty.doubts()
    return [
        (_scores(row), _held(row))
        for row in rows
        if doubts.get(str(row.value("robot")), 1.0) >= _TRUSTED
    ]


def _scores(row: Row) -> dict[str, float]:
    scores = {name: row.value(name) for name in SCORES}
    return {name: float(str(value)) for name, value in scores.items() if value is not None}


def _held(row: Row) -> dict[str, bool]:
    """Return whether a grasp lifted and, if that is known, carried its object.

    What slipped on the way was lifted. What was not lifted was not carried; what was held and never
    brought anywhere, or whose place was missed for another reason, says nothing about carrying.
    """
    if row.value("held") is not True:
        return {"lift": row["reason"] == _LOST_ON_THE_WAY, "carry": False}
    if row.value("placed") is True:
        return {"lift": True, "carry": True}
    if row["lost"] == _LOST_ON_THE_WAY:
        return {"lift": True, "carry": False}
    return {"lift": True}
