"""Robots introduce themselves, and messages name their grippers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rtask.engine.names import slug
from rtask.engine.operations.messages import Field
from rtask.engine.triples import Triples
from rtask.errors import ForbiddenError, UsageError
from rtask.rdf.namespaces import CORA, RT
from rtask.rdf.terms import NamedNode, Quad, object_term, stored_quad

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["REGISTER_ROBOT", "register_robot"]

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


def register_robot(context: Context, request: dict[str, Any], access: Access) -> dict[str, Any]:
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
    with context.writing:
        author = context.author(access, name)
        graph = context.kb.graphs.agent(name)
        robot = context.kb.graphs.agent_iri(name)
        triples = _robot_triples(context, robot, request)
        wanted = {stored_quad(Quad(s, p, object_term(v), graph)) for s, p, v in triples}
        present: set[Quad] = set()
        for subject in {quad.subject for quad in wanted}:
            present.update(context.kb.match(subject, graph=graph))
        replaced = {(quad.subject, quad.predicate) for quad in wanted}
        outdated = {q for q in present - wanted if (q.subject, q.predicate) in replaced}
        with context.kb.transaction(access=author, note=f"register {name}") as tx:
            for quad in outdated:
                tx.remove(quad.subject, quad.predicate, quad.object)
            tx.add_quads(wanted - present)
        changed = tx.commit.added or tx.commit.removed
    return {
        "robot": robot.value,
        "graph": graph.value,
        "commit": context.commit_id(tx.commit) if changed else "",
    }


def _is_fit(name: str) -> bool:
    return quote(name, safe="") == name and 0 < len(name) <= 64


def _robot_triples(context: Context, robot: NamedNode, request: dict[str, Any]) -> Triples:
    triples = Triples()
    model = context.names.named("model", slug(request["model"]))
    triples.node(model, [RT.RobotModel], {RT.modelName: request["model"]})
    triples.node(robot, [CORA.Robot], {RT.name: request["name"], RT.hasRobotModel: model})
    for effector in request["end_effectors"]:
        part = _part(robot, effector["name"])
        triples.add(robot, RT.hasEndEffector, part)
        triples.node(
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
    frames = {frame: _frame(triples, robot, frame) for frame in request["frames"]}
    if request["frames"]:
        triples.add(robot, RT.bodyFrame, frames[request["frames"][0]])
    for camera in request["cameras"]:
        part = _part(robot, camera["name"])
        triples.add(robot, RT.hasSensor, part)
        triples.node(
            part,
            [RT.RGBDCamera],
            {
                RT.name: camera["name"],
                RT.bodyFrame: frames.get(camera["frame_id"])
                or _frame(triples, robot, camera["frame_id"]),
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
    return triples


def _part(robot: NamedNode, name: str) -> NamedNode:
    return NamedNode(f"{robot.value}/{quote(name, safe='')}")


def _frame(triples: Triples, robot: NamedNode, frame_id: str) -> NamedNode:
    frame = NamedNode(f"{robot.value}/frame/{quote(frame_id, safe='')}")
    return triples.node(frame, [RT.Frame], {RT.frameId: frame_id})
