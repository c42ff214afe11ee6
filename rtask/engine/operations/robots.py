"""Registration of robots with their grippers, cameras and frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal
from urllib.parse import quote

from annotated_types import Ge, Le, MaxLen, MinLen
from pydantic import Field

from rtask.engine.grippers import hand_of
from rtask.engine.names import slug, tail
from rtask.engine.operations.operation import operation
from rtask.engine.records.places import state_frame_of
from rtask.engine.records.workplace import state_places
from rtask.engine.triples import Triples
from rtask.errors import ConflictError, ForbiddenError, UsageError
from rtask.rdf.namespaces import CORA, RDF, RT, local_name
from rtask.rdf.terms import Literal as RdfLiteral
from rtask.rdf.terms import NamedNode, Quad, object_term, stored_quad
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Number, Pose, Text, Texts, Unit, Whole

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = [
    "Camera",
    "EndEffector",
    "PlaceOfWork",
    "RegisterRobot",
    "RegisteredRobot",
    "register_robot",
]


# A robot that describes itself in mm or g is refused here; as m and kg, its numbers would decide
# which hand is sent to what, for every robot.
_LARGEST_M = 1.0
_HEAVIEST_KG = 5000.0
_STRONGEST_N = 1e5
_HIGHEST_PA = 101_325.0
"""Of a vacuum, below the air's own pressure at sea level."""
_FARTHEST_M = 200.0


class EndEffector(Message):
    """One gripper of a robot."""

    name: Text
    """name, unique on the robot"""
    gripper_type: Text
    """grasps carry over between grippers of one type"""
    kind: Literal["Hand", "ParallelJawGripper", "SuctionCup", "ThreeFingerHand"] = "Hand"
    """class of end effector"""
    min_opening: Annotated[Number, Unit("m"), Ge(0), Le(_LARGEST_M)] = 0.0
    """smallest width that it can hold"""
    max_opening: Annotated[Number, Unit("m"), Ge(0), Le(_LARGEST_M)] = 0.0
    """largest width that it can hold; 0 for a suction cup, all others need it"""
    jaw_width: Annotated[Number, Unit("m"), Ge(1e-4), Le(_LARGEST_M)] | None = None
    """width of a jaw face or finger; default: 0.0124"""
    finger_length: Annotated[Number, Unit("m"), Ge(1e-4), Le(_LARGEST_M)] | None = None
    """reach of the fingers, or length of a cup's stem; default: 0.05"""
    lip_radius: Annotated[Number, Unit("m"), Ge(1e-4), Le(_LARGEST_M)] | None = None
    """of the lip of a suction cup, which needs it; default: no lip"""
    lip_compliance: Annotated[Number, Unit("m"), Ge(1e-5), Le(_LARGEST_M)] | None = None
    """difference in depth at which a lip still seals; default: 0.4 of its radius"""
    flange_radius: Annotated[Number, Unit("m"), Ge(0), Le(_LARGEST_M)] = 0.0
    """of the arm's flange behind the stem of a suction cup, kept off what stands around; 0: none"""
    pressure: Annotated[Number, Unit("Pa"), Ge(1), Le(_HIGHEST_PA)] | None = None
    """of a suction cup, below that of the air; default: 60,000"""
    max_force: Annotated[Number, Unit("N"), Ge(0), Le(_STRONGEST_N)] | None = None
    """largest closing force; default: not known"""
    max_payload: Annotated[Number, Unit("kg"), Ge(1e-6), Le(_HEAVIEST_KG)]
    """largest mass that it can lift"""
    parent_link: Text | None = None
    """link that a grasp pose refers to; default: the pose is that of the gripper itself"""
    planning_group: Text | None = None
    """MoveIt group of its arm; default: none"""


class Camera(Message):
    """One camera of a robot."""

    name: Text
    """name, unique on the robot"""
    frame_id: Text
    """optical frame, as in tf"""
    width: Annotated[Whole, Unit("px"), Ge(1)] | None = None
    """image width; default: not known"""
    height: Annotated[Whole, Unit("px"), Ge(1)] | None = None
    """image height; default: not known"""
    fx: Annotated[Number, Unit("px"), Ge(1e-6)] | None = None
    """focal length; default: not known"""
    fy: Annotated[Number, Unit("px"), Ge(1e-6)] | None = None
    """focal length; default: not known"""
    cx: Annotated[Number, Unit("px")] | None = None
    """principal point; default: not known"""
    cy: Annotated[Number, Unit("px")] | None = None
    """principal point; default: not known"""
    min_range: Annotated[Number, Unit("m"), Ge(0), Le(_FARTHEST_M)] | None = None
    """nearest depth; default: not known"""
    max_range: Annotated[Number, Unit("m"), Ge(0), Le(_FARTHEST_M)] | None = None
    """farthest depth; default: not known"""


class PlaceOfWork(Message):
    """A table or box at which a robot works."""

    name: Annotated[Text, MinLen(1), MaxLen(200)]
    """name by which the robot reports that it put something there"""
    pose: Pose
    """geometry_msgs/Pose of the middle of its surface (a box: of its floor), z up, in frame_id"""
    frame_id: Text | None = None
    """frame of the robot, as in tf; default: its base frame"""
    length: Annotated[Number, Unit("m"), Ge(1e-3), Le(100)]
    """size of the surface along x of the pose; of a box, inside the walls"""
    width: Annotated[Number, Unit("m"), Ge(1e-3), Le(100)]
    """size of the surface along y of the pose"""
    rim_height: Annotated[Number, Unit("m"), Ge(0), Le(100)] = 0.0
    """height of the walls of a box above its floor; 0 for a table"""


class RegisterRobot(Message):
    """Description of a robot by itself."""

    name: Text
    """the robot's name; with a token, the token's agent"""
    model: Text
    """make and version, such as nao-h25-v5"""
    simulated: Flag = False
    """whether it is simulated"""
    end_effectors: Annotated[list[EndEffector], MinLen(1), MaxLen(16)]
    """its grippers"""
    cameras: Annotated[list[Camera], MaxLen(16)] = Field(default_factory=list)
    """its cameras"""
    frames: Annotated[Texts, MaxLen(200)] = Field(default_factory=list)
    """names of its frames, the base frame first"""
    places: Annotated[list[PlaceOfWork], MaxLen(100)] = Field(default_factory=list)
    """tables and boxes at which it works, where they are now; what was put there is drawn there"""
    replace: Flag = False
    """whether the body has changed since the last registration; default: another one is refused"""


class RegisteredRobot(Answer):
    """Result of a registration."""

    robot: str
    """IRI of the robot"""
    graph: str
    """IRI of its own named graph"""
    commit: str
    """empty when nothing changed"""


@operation(
    "write", "writes", "register a robot with its grippers, cameras and frames", repeatable=True
)
def register_robot(context: Context, request: RegisterRobot, access: Access) -> RegisteredRobot:
    """Store the description of a robot; repeating it changes nothing.

    Raises
    ------
    ConflictError
        Another body is registered under the name: its attempts were not made by this one.
    """
    name = request.name
    if access.agent is not None and (name != access.agent or access.role != "robot"):
        raise ForbiddenError(
            f"the token belongs to {access.agent!r}: it cannot register {name!r}",
            operation="register_robot",
        )
    if not _is_fit(name):
        raise UsageError(f"name: {name!r}; expected letters, digits, '.', '_' and '-'")
    for k, effector in enumerate(request.end_effectors):
        _check(effector, f"end_effectors[{k}]")
    _check_parts(request)
    with context.writing:
        author = context.author(access, name)
        graph = context.kb.graphs.agent(name)
        robot = context.kb.graphs.agent_iri(name)
        triples = _robot_triples(context, robot, request)
        edit = state_places(context, triples, robot, author, request.places, request.frames)
        stated = {stored_quad(Quad(s, p, object_term(v), graph)) for s, p, v in triples}
        present: set[Quad] = set()
        for subject in {quad.subject for quad in stated}:
            present.update(context.kb.match(subject, graph=graph))
        replaced = {(quad.subject, quad.predicate) for quad in stated}
        outdated = {q for q in present - stated if (q.subject, q.predicate) in replaced}
        changed_parts = sorted(_body_changes(robot, outdated, stated))
        if changed_parts and not request.replace:
            raise ConflictError(
                f"name: another body is registered as {name!r} ({'; '.join(changed_parts)}). Give "
                "this robot a name of its own, or, if its body has changed, register it with "
                "replace",
                field="name",
            )
        with context.kb.transaction(access=author, note=f"register {name}") as tx:
            for quad in outdated:
                tx.remove(quad.subject, quad.predicate, quad.object)
            tx.add_quads(stated - present)
            for statement in edit.statements:
                tx.add(*statement)
        changed = tx.commit.added or tx.commit.removed
    return RegisteredRobot(
        robot=robot.value,
        graph=graph.value,
        commit=context.commit_id(tx.commit) if changed else "",
    )


_BODY = frozenset(
    (
        RT.hasRobotModel, RT.gripperType, RT.minOpening, RT.maxOpening, RT.jawWidth,
        RT.fingerLength, RT.lipRadius, RT.lipCompliance, RT.flangeRadius, RDF.type,
    )
)  # fmt: skip
"""Properties that differ between bodies; loads and frames may be corrected at any time."""


def _body_changes(robot: NamedNode, outdated: set[Quad], stated: set[Quad]) -> Iterator[str]:
    """Yield each property of the robot or of its hands that has another value, with both."""
    now = {(quad.subject, quad.predicate): quad.object for quad in stated}
    for quad in outdated:
        if quad.predicate in _BODY and (quad.subject != robot or quad.predicate != RDF.type):
            part = str(quad.subject)[1:-1].removeprefix(robot.value).strip("/")
            name = " ".join(filter(None, (part, local_name(quad.predicate.value))))
            value = now[quad.subject, quad.predicate]
            yield f"{name} {_shown(quad.object)}, not {_shown(value)}"


def _shown(term: object) -> str:
    if isinstance(term, NamedNode):
        return tail(term)
    return term.value if isinstance(term, RdfLiteral) else str(term)


_STATED = (
    "min_opening", "max_opening", "jaw_width", "finger_length", "lip_radius", "lip_compliance",
    "flange_radius", "pressure", "max_force", "max_payload",
)  # fmt: skip
_MIN_OPENING_M = 1e-3


def _check(effector: EndEffector, path: str) -> None:
    """Refuse an end effector with missing or contradictory dimensions."""
    sizes = {name: value for name in _STATED if (value := getattr(effector, name)) is not None}
    for name in ("max_opening", "flange_radius"):
        if not getattr(effector, name):
            del sizes[name]
    is_cup = effector.kind == "SuctionCup"
    for name in ("lip_radius", "lip_compliance", "flange_radius", "pressure"):
        if name in sizes and not is_cup:
            where = f"{path}.{name}"
            raise UsageError(f"{where} is of suction cups, not of a {effector.kind}", field=where)
    if "max_opening" in sizes and (is_cup or effector.max_opening < _MIN_OPENING_M):
        where = f"{path}.max_opening"
        wrong = "a suction cup opens to no width"
        if not is_cup:
            wrong = f"{effector.max_opening:g} is below {_MIN_OPENING_M:g}"
        raise UsageError(f"{where}: {wrong}", field=where)
    try:
        hand_of(effector.name, effector.gripper_type, effector.kind, sizes)
    except ValueError as error:
        raise UsageError(f"{path}: {error}", field=path) from error


def _check_parts(request: RegisterRobot) -> None:
    """Refuse parts of one name, which the graph would keep as one part, and ranges of nothing."""
    taken: set[str] = set()
    for field in ("end_effectors", "cameras"):
        for k, part in enumerate(getattr(request, field)):
            if part.name in taken:
                where = f"{field}[{k}].name"
                raise UsageError(f"{where}: another part is called {part.name!r}", field=where)
            taken.add(part.name)
    for k, camera in enumerate(request.cameras):
        nearest, farthest = camera.min_range, camera.max_range
        if nearest is not None and farthest is not None and nearest >= farthest:
            where = f"cameras[{k}].min_range"
            raise UsageError(f"{where}: {nearest:g} m is not below max_range", field=where)


def _is_fit(name: str) -> bool:
    return quote(name, safe="") == name and 0 < len(name) <= 64


def _robot_triples(context: Context, robot: NamedNode, request: RegisterRobot) -> Triples:
    triples = Triples()
    model = context.names.named("model", slug(request.model))
    triples.node(model, [RT.RobotModel], {RT.modelName: request.model})
    triples.node(robot, [CORA.Robot], {RT.name: request.name, RT.hasRobotModel: model})
    for effector in request.end_effectors:
        part = _part(robot, effector.name)
        triples.add(robot, RT.hasEndEffector, part)
        triples.node(
            part,
            [getattr(RT, effector.kind)],
            {
                RT.name: effector.name,
                RT.gripperType: effector.gripper_type,
                RT.minOpening: None if effector.kind == "SuctionCup" else effector.min_opening,
                RT.maxOpening: effector.max_opening or None,
                RT.jawWidth: effector.jaw_width,
                RT.fingerLength: effector.finger_length,
                RT.lipRadius: effector.lip_radius,
                RT.lipCompliance: effector.lip_compliance,
                RT.flangeRadius: effector.flange_radius or None,
                RT.vacuumPressure: effector.pressure,
                RT.maxForce: effector.max_force,
                RT.maxPayload: effector.max_payload,
                RT.parentLink: effector.parent_link,
                RT.planningGroup: effector.planning_group,
            },
        )
    frames = {frame: state_frame_of(triples, robot, frame) for frame in request.frames}
    if request.frames:
        triples.add(robot, RT.bodyFrame, frames[request.frames[0]])
    for camera in request.cameras:
        part = _part(robot, camera.name)
        triples.add(robot, RT.hasSensor, part)
        triples.node(
            part,
            [RT.RGBDCamera],
            {
                RT.name: camera.name,
                RT.bodyFrame: frames.get(camera.frame_id)
                or state_frame_of(triples, robot, camera.frame_id),
                RT.imageWidth: camera.width,
                RT.imageHeight: camera.height,
                RT.focalX: camera.fx,
                RT.focalY: camera.fy,
                RT.principalX: camera.cx,
                RT.principalY: camera.cy,
                RT.minRange: camera.min_range,
                RT.maxRange: camera.max_range,
            },
        )
    return triples


def _part(robot: NamedNode, name: str) -> NamedNode:
    return NamedNode(f"{robot.value}/{quote(name, safe='')}")
