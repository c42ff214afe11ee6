"""Robots introduce themselves, and messages name their grippers."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from grasp.spatial.gripper import ParallelGripper
from rtask.engine.names import slug
from rtask.engine.operations.messages import Field, nearest
from rtask.engine.records.facts import Facts
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.rdf.namespaces import CORA, PREFIXES, RT, local_name
from rtask.rdf.terms import NamedNode, Quad, object_term, stored_quad

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Change
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["REGISTER_ROBOT", "GripperCatalogue", "KnownGripper", "register_robot"]

_KINDS = ("Hand", "ParallelJawGripper")

_END_EFFECTOR = (
    Field("name", "string", "name, unique on the robot", required=True),
    Field("gripper_type", "string", "grasps carry over between grippers of one type",
          required=True),
    Field("kind", "string", "class of end effector", default="Hand", choices=_KINDS),
    Field("min_opening", "number", "smallest width that it can hold, m", default=0.0, low=0.0),
    Field("max_opening", "number", "largest width that it can hold, m", required=True, low=1e-3),
    Field("jaw_width", "number", "width of a jaw face, m", low=1e-4),
    Field("finger_length", "number", "reach of the fingers, m", low=1e-4),
    Field("max_force", "number", "largest closing force, N", low=0.0),
    Field("max_payload", "number", "largest mass that it can lift, kg", required=True, low=1e-6),
    Field("parent_link", "string", "link that a grasp pose refers to"),
    Field("planning_group", "string", "MoveIt group of its arm"),
)  # fmt: skip

_CAMERA = (
    Field("name", "string", "name, unique on the robot", required=True),
    Field("frame_id", "string", "optical frame, as in tf", required=True),
    Field("width", "integer", "image width, px", low=1),
    Field("height", "integer", "image height, px", low=1),
    Field("fx", "number", "focal length, px", low=1e-6),
    Field("fy", "number", "focal length, px", low=1e-6),
    Field("cx", "number", "principal point, px"),
    Field("cy", "number", "principal point, px"),
    Field("min_range", "number", "nearest depth, m", low=0.0),
    Field("max_range", "number", "farthest depth, m", low=0.0),
)

REGISTER_ROBOT = (
    Field("name", "string", "the robot's name; with a token, the token's agent", required=True),
    Field("model", "string", "make and version, e.g. nao-h25-v5", required=True),
    Field("simulated", "boolean", "whether it lives in a simulator", default=False),
    Field("end_effectors", "records", "its grippers", required=True, low=1, high=16,
          fields=_END_EFFECTOR),
    Field("cameras", "records", "its cameras", default=[], high=16, fields=_CAMERA),
    Field("frames", "strings", "names of its frames, the base frame first", default=[], high=200),
)  # fmt: skip


def register_robot(engine: Engine, request: dict[str, Any], access: Access) -> dict[str, Any]:
    """Write down what a robot is made of; the same message again changes nothing.

    Returns
    -------
    ``robot`` (IRI), ``graph`` (its own), ``commit`` (empty when nothing changed).
    """
    name = request["name"]
    if access.role == "robot" and name != access.agent:
        raise ForbiddenError(
            f"the token belongs to {access.agent!r}: it cannot register {name!r}",
            operation="register_robot",
        )
    if not _is_fit(name):
        raise UsageError(f"name: {name!r}; letters, digits, '.', '_' and '-' are wanted")
    with engine.writing:
        author = engine.author(access, name)
        graph = engine.kb.graphs.agent(name)
        robot = engine.kb.graphs.agent_iri(name)
        facts = _robot_facts(engine, robot, request)
        wanted = {stored_quad(Quad(s, p, object_term(v), graph)) for s, p, v in facts.triples}
        present: set[Quad] = set()
        for subject in {quad.subject for quad in wanted}:
            present.update(engine.kb.match(subject, graph=graph))
        replaced = {(quad.subject, quad.predicate) for quad in wanted}
        outdated = {q for q in present - wanted if (q.subject, q.predicate) in replaced}
        with engine.kb.transaction(access=author, note=f"register {name}") as tx:
            for quad in outdated:
                tx.remove(quad.subject, quad.predicate, quad.object)
            tx.add_quads(wanted - present)
        changed = tx.commit.added or tx.commit.removed
    return {
        "robot": robot.value,
        "graph": graph.value,
        "commit": engine.commit_id(tx.commit) if changed else "",
    }


def _is_fit(name: str) -> bool:
    return quote(name, safe="") == name and 0 < len(name) <= 64


def _robot_facts(engine: Engine, robot: NamedNode, request: dict[str, Any]) -> Facts:
    facts = Facts()
    model = engine.names.named("model", slug(request["model"]))
    facts.node(model, [RT.RobotModel], {RT.modelName: request["model"]})
    facts.node(robot, [CORA.Robot], {RT.name: request["name"], RT.hasRobotModel: model})
    for effector in request["end_effectors"]:
        part = _part(robot, effector["name"])
        facts.add(robot, RT.hasEndEffector, part)
        facts.node(
            part,
            [getattr(RT, effector["kind"])],
            {
                RT.name: effector["name"],
                RT.gripperType: effector["gripper_type"],
                RT.minOpening: effector["min_opening"],
                RT.maxOpening: effector["max_opening"],
                RT.jawWidth: effector["jaw_width"],
                RT.fingerLength: effector["finger_length"],
                RT.maxForce: effector["max_force"],
                RT.maxPayload: effector["max_payload"],
                RT.parentLink: effector["parent_link"],
                RT.planningGroup: effector["planning_group"],
            },
        )
    frames = {frame: _frame(facts, robot, frame) for frame in request["frames"]}
    if request["frames"]:
        facts.add(robot, RT.bodyFrame, frames[request["frames"][0]])
    for camera in request["cameras"]:
        part = _part(robot, camera["name"])
        facts.add(robot, RT.hasSensor, part)
        facts.node(
            part,
            [RT.RGBDCamera],
            {
                RT.name: camera["name"],
                RT.bodyFrame: frames.get(camera["frame_id"])
                or _frame(facts, robot, camera["frame_id"]),
                RT.imageWidth: camera["width"],
                RT.imageHeight: camera["height"],
                RT.focalX: camera["fx"],
                RT.focalY: camera["fy"],
                RT.principalX: camera["cx"],
                RT.principalY: camera["cy"],
                RT.minRange: camera["min_range"],
                RT.maxRange: camera["max_range"],
            },
        )
    return facts


def _part(robot: NamedNode, name: str) -> NamedNode:
    return NamedNode(f"{robot.value}/{quote(name, safe='')}")


def _frame(facts: Facts, robot: NamedNode, frame_id: str) -> NamedNode:
    frame = NamedNode(f"{robot.value}/frame/{quote(frame_id, safe='')}")
    return facts.node(frame, [RT.Frame], {RT.frameId: frame_id})


@dataclass(frozen=True)
class KnownGripper:
    """An end effector in the graph."""

    iri: NamedNode
    robot: NamedNode
    robot_name: str
    gripper: ParallelGripper
    kind: str
    camera: NamedNode | None = None


class GripperCatalogue:
    """End effectors by name, read again when a robot changes.

    A decision asks the graph once; what a gripper is was known before.
    """

    def __init__(self, kb: KnowledgeBase) -> None:
        self._kb = kb
        self._lock = threading.Lock()
        self._known: list[KnownGripper] | None = None

    def forget_if_changed(self, change: Change) -> None:
        """Read again after a commit that touches robots."""
        telling = {RT.hasEndEffector, RT.hasSensor, RT.gripperType, RT.minOpening, RT.maxOpening,
                   RT.jawWidth, RT.fingerLength, RT.maxPayload}  # fmt: skip
        if any(quad.predicate in telling for quad in (*change.added, *change.removed)):
            with self._lock:
                self._known = None

    def all(self) -> list[KnownGripper]:
        """Return every end effector, in the order of their IRIs."""
        with self._lock:
            if self._known is None:
                self._known = _read_grippers(self._kb)
            return self._known

    def find(self, gripper_id: str | None, agent: str | None) -> KnownGripper:
        """Return the end effector that a message names.

        Parameters
        ----------
        gripper_id
            IRI or name; None = the only one of the robot that asks. Nobody is credited with what
            another robot's hand did, so a robot without a gripper must name one.
        agent
            Who asks: its own grippers come first where a name is used by several robots.

        Raises
        ------
        UnknownTermError
            With the nearest name.
        """
        known = self.all()
        own = [g for g in known if g.robot_name == agent]
        if gripper_id is None:
            if len(own) == 1:
                return own[0]
            said = f"{agent} has {len(own)} grippers" if agent else "the caller has no name"
            raise UnknownTermError(f"gripper_id is missing, and {said}")
        for g in (*own, *known):
            if gripper_id in (g.iri.value, g.gripper.name):
                return g
        names = sorted({g.gripper.name for g in known})
        hint = nearest(gripper_id, names) or f"; known: {', '.join(names) or 'none yet'}"
        raise UnknownTermError(f"unknown gripper {gripper_id!r}{hint}", did_you_mean=names[:3])


_GRIPPERS = f"""{PREFIXES}
SELECT ?part ?robot ?robot_name ?name ?type ?kind ?low ?high ?jaw ?finger ?payload
  (MIN(?sensor) AS ?camera) WHERE {{
  ?robot rt:hasEndEffector ?part ; rt:name ?robot_name .
  ?part rt:name ?name ; rt:gripperType ?type ; rt:maxOpening ?high
  OPTIONAL {{ ?part a ?kind FILTER(?kind IN (rt:Hand, rt:ParallelJawGripper)) }}
  OPTIONAL {{ ?part rt:minOpening ?low }} OPTIONAL {{ ?part rt:jawWidth ?jaw }}
  OPTIONAL {{ ?part rt:fingerLength ?finger }} OPTIONAL {{ ?part rt:maxPayload ?payload }}
  OPTIONAL {{ ?robot rt:hasSensor ?sensor }}
}} GROUP BY ?part ?robot ?robot_name ?name ?type ?kind ?low ?high ?jaw ?finger ?payload"""


def _read_grippers(kb: KnowledgeBase) -> list[KnownGripper]:
    found: dict[str, KnownGripper] = {}
    for row in kb.select(_GRIPPERS):
        given = {name: value for name, value in row.to_dict().items() if value is not None}
        part, robot, camera = row["part"], row["robot"], row["camera"]
        if not isinstance(part, NamedNode) or not isinstance(robot, NamedNode):
            continue
        kind = local_name(str(given.get("kind", "Hand")))
        gripper = ParallelGripper(
            name=str(given["name"]),
            gripper_type=str(given["type"]),
            min_opening=float(str(given.get("low", 0.0))),
            max_opening=float(str(given["high"])),
            symmetric=kind != "Hand",
            finger_width=float(str(given.get("jaw", ParallelGripper.finger_width))),
            finger_length=float(str(given.get("finger", ParallelGripper.finger_length))),
            max_payload=float(str(given.get("payload", ParallelGripper.max_payload))),
        )
        known = KnownGripper(
            part, robot, str(given["robot_name"]), gripper, kind,
            camera if isinstance(camera, NamedNode) else None,
        )  # fmt: skip
        found.setdefault(part.value, known)
    return [found[key] for key in sorted(found)]
