"""MoveIt's planning scene as it comes: shapes, operations, frames, who may touch what, and faults.

Needs no ROS: messages have the form that :class:`RosTypes` gives them.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest

from rtask.errors import UsageError
from rtask.interop.ros.convert import fill
from rtask.interop.ros.scene.obstacles import HandRules, SceneObstacles
from rtask.interop.ros.scene.shapes import Solid
from rtask.interop.ros.scene.source import SceneSource
from rtask.interop.ros.scene.state import MAX_OBJECTS, SceneState

pytest.importorskip("rosbags")
BOX, SPHERE, CYLINDER, CONE = 1, 2, 3, 4
ADD, REMOVE, APPEND, MOVE = range(4)
CUP = {"position": {"x": 0.3, "y": 0.0, "z": 0.3}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
CUP_SIZE, SUPPORT = (0.06, 0.06, 0.10), 0.25
HAND = ("l_finger", "r_finger")


@functools.cache
def types() -> Any:
    from rtask.interop.ros.dds.types import RosTypes

    return RosTypes()


def make(type_: str, **fields: Any) -> Any:
    return fill(types().make(type_), fields, types().make)


def pose(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0, 1.0)):
    return {
        "position": {"x": x, "y": y, "z": z},
        "orientation": dict(zip("xyzw", turn, strict=True)),
    }


def thing(name="wall", kind=BOX, sides=(0.02, 0.3, 0.3), at=None, operation=ADD, **fields):
    """Return a CollisionObject of one primitive 5 cm beside the cup, as a mapping."""
    shapes = [{"type": kind, "dimensions": list(sides)}] if kind else []
    return {
        "header": {"frame_id": "world"}, "id": name, "operation": operation,
        "pose": pose(0.38, 0.0, 0.35) if at is None else at,
        "primitives": shapes, "primitive_poses": [pose() for _ in shapes], **fields,
    }  # fmt: skip


def scene(*objects, is_diff=False, attached=(), matrix=None, **fields):
    return make(
        "moveit_msgs/PlanningScene", is_diff=is_diff, world={"collision_objects": objects},
        robot_state={"is_diff": is_diff, "attached_collision_objects": attached},
        allowed_collision_matrix=matrix or {}, **fields,
    )  # fmt: skip


def state(*messages):
    made = SceneState()
    for message in messages:
        made.take(message)
    return made


def world_only(frame):
    if frame == "world":
        return np.eye(4)
    raise UsageError(f"nobody publishes {frame}")


def obstacles(*messages, hand=HandRules(), ours=(), lookup=world_only):  # noqa: B008 - frozen
    return SceneObstacles(state(*messages), lookup, hand, ours)


def points(*messages, most=500, **options):
    found = obstacles(*messages, **options).near(CUP, CUP_SIZE, SUPPORT, most)
    return np.array(found).reshape(-1, 3)


@pytest.mark.parametrize(
    ("kind", "sides"),
    [(BOX, (0.02, 0.3, 0.3)), (SPHERE, (0.04,)), (CYLINDER, (0.2, 0.03)), (CONE, (0.2, 0.03))],
)
def test_cells_are_found_at_the_surface_of_each_primitive(kind, sides):
    found = points(scene(thing(kind=kind, sides=sides)))
    assert len(found)
    name, size = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}[kind], tuple(sides)
    away = Solid(name, size, np.eye(4)).distance(found - [0.38, 0.0, 0.35])
    assert np.abs(away).max() <= 0.012  # the wider cell
    assert found[:, 2].min() > SUPPORT + 0.01


def test_meshes_and_planes_are_obstacles_as_primitives_are():
    corner = [{"x": x, "y": y, "z": z} for x, y, z in ((0, -1, -1), (0, 1, -1), (0, 0, 1))]
    mesh = {"vertices": corner, "triangles": [{"vertex_indices": [0, 1, 2]}]}
    for given in ({"meshes": [mesh]}, {"planes": [{"coef": [2.0, 0.0, 0.0, 0.0]}]}):
        found = points(scene(thing(kind=0, **given)))
        assert len(found)
        assert np.abs(found[:, 0] - 0.38).max() < 0.013


def test_points_are_no_farther_apart_than_a_finger_is_wide_and_the_nearest_are_kept():
    found = points(scene(thing()))
    apart = np.linalg.norm(found[:, None] - found[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    assert apart.min(axis=1).max() < 0.02
    few = points(scene(thing()), most=7)
    assert len(few) == 7
    assert np.abs(few[:, 0] - 0.37).max() < 0.013


def test_the_table_a_far_object_and_the_object_itself_are_no_obstacles():
    table = thing("table", sides=(2.0, 2.0, 0.05), at=pose(0, 0, SUPPORT - 0.025))
    assert not len(points(scene(table)))
    assert not len(points(scene(thing(at=pose(3.0)))))
    # MoveIt knows the cup under another name: it is what is seen, and no obstacle to its grasp.
    assert not len(points(scene(thing("can_1", CYLINDER, (0.12, 0.035), pose(0.305, 0, 0.31)))))
    # A bin around the cup is not the cup.
    assert len(points(scene(thing("bin", sides=(0.25, 0.25, 0.25), at=pose(0.3, 0, 0.35)))))


def test_poses_of_shapes_count_in_the_frame_of_their_object():
    quarter = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    turned = thing(at=pose(0.3, 0.0, 0.35, quarter), primitive_poses=[pose(0.08)])
    found = points(scene(turned))
    assert np.abs(found[:, 1] - 0.08).max() < 0.04  # x of the object is y of the world
    zero = thing(at=pose(0.3, 0.0, 0.35, (0, 0, 0, 0)), primitive_poses=[pose(0.08)])
    assert np.abs(points(scene(zero))[:, 0] - 0.38).max() < 0.04  # no orientation is none


def test_frames_go_by_tf_and_by_the_transforms_of_the_scene():
    move = {"translation": {"x": 0.1, "y": 0.0, "z": 0.0}, "rotation": {"w": 1.0}}
    fixed = [{"header": {"frame_id": "world"}, "child_frame_id": "cell", "transform": move}]
    near = thing(at=pose(0.28, 0, 0.35), header={"frame_id": "cell"})
    assert len(points(scene(near, fixed_frame_transforms=fixed)))
    with pytest.raises(UsageError, match=r"wall: nobody publishes cell"):
        points(scene(near))
    bare = thing(header={"frame_id": ""})
    with pytest.raises(UsageError, match=r"wall: it has no frame"):
        points(scene(bare))
    assert len(points(scene(bare, fixed_frame_transforms=fixed)))  # the frame of planning


def test_changes_add_remove_append_and_move():
    here = scene(thing())
    assert len(state(here, scene(thing("box"), is_diff=True)).objects) == 2
    gone = scene(thing(kind=0, operation=REMOVE), is_diff=True)
    assert not state(here, gone).objects
    everything = scene(thing("", kind=0, operation=REMOVE), is_diff=True)
    assert not state(here, everything).objects
    more = scene(thing(kind=SPHERE, sides=(0.02,), operation=APPEND), is_diff=True)
    assert len(state(here, more).objects["wall"].solids) == 2
    again = scene(thing(), is_diff=True)
    assert len(state(here, more, again).objects["wall"].solids) == 1, "ADD replaces"
    away = scene(thing(kind=0, at=pose(5.0), operation=MOVE), is_diff=True)
    assert not len(points(here, away))
    assert not state(here, scene()).objects, "a full scene replaces everything"


def matrix(names, rows, defaults=()):
    return {
        "entry_names": names, "entry_values": [{"enabled": row} for row in rows],
        "default_entry_names": [name for name, _ in defaults],
        "default_entry_values": [value for _, value in defaults],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("given", "links", "is_obstacle"),
    [
        (None, HAND, True),
        (matrix([], [], [("wall", True)]), (), False),
        (matrix([], [], [("wall", True)]), HAND, False),
        (matrix([], [], [("wall", True), ("l_finger", False)]), HAND, True),
        (matrix(["wall", "l_finger"], [[0, 1], [1, 0]]), HAND, True),
        (matrix(["wall", *HAND], [[0, 1, 1], [1, 0, 0], [1, 0, 0]]), HAND, False),
        (matrix(["wall", *HAND], [[0, 1, 0], [1, 0, 0], [0, 0, 0]], [("wall", True)]), HAND, True),
    ],
)
def test_what_the_matrix_lets_every_link_of_the_hand_touch_is_no_obstacle(
    given, links, is_obstacle
):
    found = points(scene(thing(), matrix=given), hand=HandRules(links))
    assert bool(len(found)) == is_obstacle


def test_a_matrix_in_a_change_replaces_the_former_one_and_none_leaves_it():
    first = scene(thing(), matrix=matrix(["a", "b"], [[0, 1], [1, 0]]))
    assert state(first, scene(is_diff=True)).matrix.allows("a", "b")
    second = scene(is_diff=True, matrix=matrix(["a"], [[0]]))
    assert not state(first, second).matrix.allows("a", "b")


def test_what_the_hand_holds_moves_with_it_and_what_another_link_holds_is_in_the_way():
    held = {"link_name": "l_finger", "object": thing(), "touch_links": ["r_finger"]}
    mine = obstacles(scene(attached=[held]), hand=HandRules(HAND))
    assert (len(mine), mine.notes) == (0, ["the hand holds wall, which moves with it"])
    assert len(points(scene(attached=[{**held, "link_name": "l_gripper", "touch_links": []}])))
    loose = scene(attached=[{"link_name": "", "object": thing(kind=0, operation=REMOVE)}],
                  is_diff=True)  # fmt: skip
    assert not state(scene(attached=[held]), loose).attached


def test_what_the_node_itself_put_into_the_scene_does_not_count():
    assert not len(points(scene(thing("rtask/unknown-1"))))
    assert not len(points(scene(thing(type={"key": "", "db": "rtask"}))))
    assert not len(points(scene(thing()), ours=["wall"]))


def test_an_octomap_and_a_scene_of_changes_only_are_said():
    cells = {"octomap": {"octomap": {"data": [1, 2]}, "header": {}}}
    message = scene()
    fill(message, {"world": cells}, types().make)
    assert obstacles(message).notes == ["the octomap of the scene is not used"]
    [note] = obstacles(scene(is_diff=True)).notes
    assert note.startswith("only changes")


TRIANGLE = {"vertices": [{"x": 0.0}] * 3, "triangles": [{"vertex_indices": [0, 1, 7]}]}


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (thing(at=pose(math.nan)), "wall: it: its pose holds a number that is not finite"),
        (thing(at=pose(turn=(0, 0, 0, 3.0))), "its orientation is no unit quaternion, but 3 long"),
        (thing(primitive_poses=[pose(math.inf)]), "its primitive: its pose holds a number"),
        (thing(primitive_poses=[pose(), pose()]), "2 primitive poses for 1 of them"),
        (thing(sides=(0.0, 0.1, 0.1)), r"a box of \[0.0, 0.1, 0.1\]; expected 3 positive"),
        (thing(sides=(0.1, 0.1)), r"a box of \[0.1, 0.1\]; expected 3"),
        (thing(kind=SPHERE, sides=(math.nan,)), r"a sphere of \[nan\]"),
        (thing(kind=9), "a primitive of type 9; expected box, sphere, cylinder or cone"),
        (thing(kind=0), "wall: it has no shapes"),
        (thing(kind=0, meshes=[{}]), "a mesh without triangles"),
        (thing(kind=0, meshes=[TRIANGLE]), "a mesh whose triangles name vertex 7 of 3"),
        (thing(kind=0, planes=[{"coef": [0.0, 0.0, 0.0, 1.0]}]), "expected a, b, c, d with a norm"),
        (thing(operation=7), "operation 7; expected ADD, REMOVE, APPEND or MOVE"),
        (thing("late", kind=0, operation=MOVE), "late: it was moved and is not in the scene"),
        (thing(""), "it has no id"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_named_and_nothing_is_planned_around_it(bad, words):
    with pytest.raises(UsageError, match=words):
        points(scene(thing("other"), bad))
    if bad["id"]:
        mended = scene(thing(bad["id"]), is_diff=True)
        assert len(points(scene(bad), mended)), "once it is right it counts"


def test_malformed_matrices_attached_objects_and_too_many_objects_are_named():
    with pytest.raises(UsageError, match=r"matrix: allowed collision matrix: 2 names .* square"):
        points(scene(matrix=matrix(["a", "b"], [[0], [0]])))
    with pytest.raises(UsageError, match="wall: it is attached to no link"):
        points(scene(attached=[{"link_name": "", "object": thing()}]))
    many = scene()
    many.world.collision_objects = [make("moveit_msgs/CollisionObject")] * 100_000
    with pytest.raises(UsageError, match=f"100000 objects; at most {MAX_OBJECTS} are read"):
        points(many)


def test_objects_that_come_again_count_once(monkeypatch):
    monkeypatch.setattr("rtask.interop.ros.scene.state.MAX_OBJECTS", 3)
    three = [thing(f"t{number}") for number in range(3)]
    again = scene(*three, is_diff=True)
    assert state(scene(*three), again).faults == {}
    more = state(scene(*three), scene(thing("t3"), is_diff=True))
    assert more.faults == {"the scene": "4 objects; at most 3 are read"}


def test_only_some_of_many_faults_are_told():
    bad = [thing(f"t{number}", kind=0) for number in range(9)]
    with pytest.raises(UsageError, match=r"t0: .*t2: it has no shapes.*; and 6 more"):
        points(scene(*bad))


def test_the_scene_is_asked_for_and_heard_only_where_nobody_offers_it():
    offered: list[Any] = [None]
    source = SceneSource(lambda: offered[0])
    assert source.newest() is None
    source.take(scene(thing("heard")))
    assert list(source.newest().objects) == ["heard"]
    offered[0] = scene(thing("asked"), is_diff=True)
    assert list(source.newest().objects) == ["asked"]
    assert source.newest().is_complete
