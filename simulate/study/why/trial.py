"""One injected failure after some history, the question why, and the change carried out."""

from __future__ import annotations

import datetime as dt
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from simulate.study.tasks.trial import lab_update
from simulate.study.why.truth import KINDS, OPEN_KINDS, Deed, Truth, replaced
from simulate.world.seeds import stream

__all__ = ["run_trial"]

_BASE = "https://example.org/kb/"
_STREAM = 73
_TABLE = f"{_BASE}place/table-1"
_ROBOTS = ("nao-1", "panda-1")
_PRODUCT, _THING = f"{_BASE}object/0", f"{_BASE}thing/0"
_OTHERS = tuple(f"{_BASE}object/{number}" for number in range(1, 4))
_HISTORY_S = 4 * 3600.0
"""How long ago the attempts were that came before."""
_AS_STEP = ("late", "dropped", "stale_place")
"""Kinds that may end a step without an attempt."""

_DRAWS = 20
"""How often each change is carried out in truth."""
_NO_BUDGET_S = 600.0


def _folder(settings: Mapping[str, Any]) -> AbstractContextManager[str]:
    """Return where the graph is: only a folder has branches."""
    return TemporaryDirectory() if settings.get("tries") else nullcontext(":memory:")


@dataclass
class _Lab:
    """The graph of a trial, what is true in it, and what was reported so far."""

    engine: Engine
    truth: Truth
    rng: np.random.Generator
    length: float
    reported: int = 0

    def client(self, robot: str) -> Any:
        return rtask.connect(self.engine, agent=robot)

    def place_along(self) -> float:
        return float(self.rng.uniform(-0.42, 0.42))

    def report(self, deed: Deed, product: str, ended: tuple[bool, str], ago_s: float = 0.0) -> str:
        """Report an outcome of some time ago; return the id of its report."""
        ended_s = time.time() - ago_s
        self.reported += 1
        held, reason = ended
        name = f"why-{self.reported}"
        thing = {"thing": _THING} if product == _PRODUCT else {}
        self.client(deed.robot).call(
            "report_outcome", task_id=name, object=product, **thing,
            grasp={"id": "", "in_object": {
                "x": deed.along * self.length, "y": 0.0, "z": 0.0, "theta": 0.0}},
            # What was lifted is put down again, or hands would be full.
            outcome={"success": held, "reason": reason, **({"placed": True} if held else {})},
            stamp=ended_s,
        )  # fmt: skip
        return name


def run_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return what was answered about one failure, and what came of the change."""
    rng = stream(settings["seed"], _STREAM, number)
    kinds = OPEN_KINDS if settings.get("is_open") else KINDS
    kind = kinds[number % len(kinds)]
    right = "unknown" if kind in OPEN_KINDS else kind
    robot = "nao-1" if kind == "too_heavy" else str(rng.choice(_ROBOTS))
    truth = Truth(kind, robot, rng)
    with (
        _folder(settings) as where,
        cast(KnowledgeBase, rtask.open(where, base=_BASE)) as kb,
        Engine(kb) as engine,
    ):
        lab = _Lab(engine, truth, rng, float(rng.uniform(0.12, 0.25)))
        kb.update(lab_update(rng, 6))
        kb.update(_details(lab))
        _history(lab)
        deed = _failing(lab)
        subject = _fail(lab, deed)
        began = time.process_time()
        answer = rtask.connect(engine).call("explain_failure", subject=subject)
        asked_s = time.process_time() - began
        tried = _tried(kb, lab, deed, subject, number) if settings.get("tries") else {}
        return {
            "kind": kind, "says": answer["causes"][0]["kind"], "reason": answer["reason"],
            "chance": answer["causes"][0]["chance"],
            "is_right": answer["causes"][0]["kind"] == right,
            "is_among_three": right in [cause["kind"] for cause in answer["causes"][:3]],
            "change": answer["change"]["kind"], "expected": answer["change"]["chance"],
            "mends": answer["mends"], "again_holds": _holds(lab, deed, {"kind": "again"}),
            "holds": _holds(lab, deed, answer["change"]), "asked_s": asked_s,
            **tried,
        }  # fmt: skip


def _tried(kb: KnowledgeBase, lab: _Lab, deed: Deed, subject: str, number: int) -> dict[str, Any]:
    """Return what comes of the changes on branches, and of the one that held there in truth."""
    # The physics engine is imported only where something is tried.
    from simulate.tasks.trials import TrialOptions, try_changes

    began = time.process_time()
    options = TrialOptions(seed=number, budget_s=_NO_BUDGET_S)
    diagnosis, trial = try_changes(kb, subject, options)
    tried_s = time.process_time() - began
    first = diagnosis.change
    assert first is not None
    # The truth knows no places, so that it cannot judge a change of that.
    judged = [tried for tried in trial.ranked if tried.change.kind != "place"]
    best = next((tried.change for tried in judged if tried.verdict == "held"), first)
    verdict = next((t.verdict for t in judged if t.change == first), "not_tried")
    return {
        "tried_s": tried_s, "verdict": verdict, "best": best.kind, "is_other": best != first,
        "in_physics": sum(tried.in_physics for tried in judged),
        "first_holds": _share_held(lab, deed, first.to_dict(), number),
        "best_holds": _share_held(lab, deed, best.to_dict(), number),
    }  # fmt: skip


def _share_held(lab: _Lab, deed: Deed, change: Mapping[str, Any], number: int) -> float:
    """Return how often a change holds in truth, with the same draws for each change."""
    held = []
    for k in range(_DRAWS):
        rng = stream(number, _STREAM + 1, k)
        held.append(_holds(replace(lab, truth=replaced(lab.truth, rng), rng=rng), deed, change))
    return float(np.mean(held))


def _details(lab: _Lab) -> str:
    """Return the update that states lengths, payloads, the place of the thing, and neighbours."""
    rng, graph = lab.rng, f"<{_BASE}graph/shared>"
    mass = 0.1
    if lab.truth.kind == "too_heavy" and rng.random() < 0.5:
        mass = 0.45  # near the payload; else the graph believes that it is light
    neighbours = (
        int(rng.integers(1, 3)) if lab.truth.kind == "collision" else int(rng.integers(0, 3))
    )
    rows = [f"<{product}> rt:extentX {lab.length}e0 ." for product in (_PRODUCT, *_OTHERS)]
    moved, gone = [(0, "table-1")], ""
    moved += [(k, "table-1" if k <= neighbours else "shelf") for k in range(1, 6)]
    for k, place in moved:
        gone += f" DELETE WHERE {{ GRAPH {graph} {{ <{_BASE}placement/{k}> rt:placedOn ?o }} }} ;"
        rows.append(f"<{_BASE}placement/{k}> rt:placedOn <{_BASE}place/{place}> .")
    gone += f" DELETE WHERE {{ GRAPH {graph} {{ <{_PRODUCT}> rt:mass ?m }} }} ;"
    rows.append(f"<{_PRODUCT}> rt:mass {mass}e0 .")
    gone += (
        f" DELETE WHERE {{ GRAPH {graph} {{ <{_BASE}robot/panda-1/hand> rt:maxPayload ?l }} }} ;"
    )
    rows.append(f"<{_BASE}robot/panda-1/hand> rt:maxPayload 3.0e0 .")
    return f"{PREFIXES}{gone} INSERT DATA {{ GRAPH {graph} {{ {' '.join(rows)} }} }}"


def _history(lab: _Lab) -> None:
    """Let both robots try the product, and others, before the failure."""
    for _ in range(int(lab.rng.integers(3, 9))):
        deed = Deed(str(lab.rng.choice(_ROBOTS)), lab.place_along())
        lab.report(deed, _PRODUCT, lab.truth.outcome(deed), _HISTORY_S)
    for robot in _ROBOTS:
        for _ in range(int(lab.rng.integers(2, 6))):
            deed = Deed(robot, lab.place_along(), is_product=False)
            lab.report(deed, str(lab.rng.choice(_OTHERS)), lab.truth.outcome(deed), _HISTORY_S)
    is_fresh = lab.rng.random() < (0.3 if lab.truth.kind == "stale_place" else 0.7)
    since_s = time.time() - (0.0 if is_fresh else _HISTORY_S / 2)
    lab.client(lab.truth.robot).call("state_place", thing=_THING, place=_TABLE, stamp=since_s)


def _failing(lab: _Lab) -> Deed:
    """Return an attempt that fails because of the cause."""
    while True:
        deed = Deed(lab.truth.robot, lab.place_along())
        if lab.truth.fails(deed, is_occasion=True):
            return deed


def _fail(lab: _Lab, deed: Deed) -> str:
    """Let it fail, in some kinds as a step of a plan; return what is asked about."""
    kind, rng = lab.truth.kind, lab.rng
    if kind in _AS_STEP and (kind != "stale_place" or rng.random() < 0.5):
        return _fail_step(lab)
    name = lab.report(deed, _PRODUCT, (False, lab.truth.report()))
    rows = rtask.connect(lab.engine).query(
        f'{PREFIXES} SELECT ?event WHERE {{ ?event rt:requestId "{name}" ; rt:hasOutcome ?o }}'
    )
    attempt = str(rows[0]["event"])
    # Recognition is close between two products mostly where it was wrong.
    if kind == "wrong_identity" or rng.random() < 0.5:
        is_close = rng.random() < (0.7 if kind == "wrong_identity" else 0.15)
        best, following = 0.5, 0.47 if is_close else 0.2
        node, graph = f"{_BASE}recognition/{name}", f"<{_BASE}graph/shared>"
        lab.engine.kb.update(
            f"{PREFIXES} INSERT DATA {{ GRAPH {graph} {{ <{attempt}> rt:usedRecognition <{node}> . "
            f"<{node}> a rt:RecognitionResult ; rt:bestMatch <{node}/1> ; rt:hasMatch <{node}/1>, "
            f"<{node}/2> . <{node}/1> a rt:Match ; rt:rank 1 ; rt:matchScore {best}e0 . "
            f"<{node}/2> a rt:Match ; rt:rank 2 ; rt:matchScore {following}e0 }} }}"
        )
    if kind == "stale_place" and rng.random() < 0.8:
        shelf = f"{_BASE}place/shelf"
        lab.client(lab.truth.robot).call("state_place", thing=_THING, place=shelf)
    return attempt


def _fail_step(lab: _Lab) -> str:
    """Let a step of a stored plan fail without an attempt of a grasp."""
    kind, robot = lab.truth.kind, lab.client(lab.truth.robot)
    box = "left-box-1" if lab.truth.robot == "nao-1" else "right-box-1"
    stored = robot.call("store_plan", goal=_goal(box))
    claim = robot.call("claim_step")
    if kind == "dropped":
        hand = claim["arguments"]["hand"]
        robot.call("end_step", task=claim["task"], result="done", place=hand)
        claim = robot.call("claim_step")
    if kind == "late":
        now = dt.datetime.now(dt.UTC).isoformat()
        lab.engine.kb.update(
            f"{PREFIXES} INSERT DATA {{ GRAPH <{_BASE}graph/shared> {{ <{stored['task']}> "
            f"rt:taskDeadline '{now}'^^xsd:dateTime }} }}"
        )
    comment = "it is not seen there" if kind == "stale_place" else lab.truth.report()
    is_seen = kind == "late" or lab.rng.random() < 0.8
    where: dict[str, Any] = {"lost": True}
    if is_seen:
        where = {"place": _TABLE if kind in ("late", "dropped") else f"{_BASE}place/{box}"}
    robot.call("end_step", task=claim["task"], result="failed", comment=comment, **where)
    return str(claim["task"])


def _goal(box: str) -> str:
    return f"<{_THING}> rt:locatedOn <{_BASE}place/{box}>"


def _holds(lab: _Lab, deed: Deed, change: Mapping[str, Any]) -> bool:
    """Carry the change out in truth."""
    robot, along = deed.robot, deed.along
    if change["kind"] == "hand":
        robot = str(change["robot"]).rpartition("/")[2]
    if change["kind"] == "grasp":
        at = change["along"]
        along = lab.place_along() if at is None else float(at) / lab.length
    changed = Deed(robot, along, before=str(change["kind"]))
    return lab.truth.outcome(changed, is_occasion=True)[0]
