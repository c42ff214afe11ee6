"""A second robot goes through everything that the first does, and nothing asks for its name."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from features.perception import perceive
from rtask.errors import RobotError
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.grasping.executor import GraspRequest, Workcell
from simulate.motion.collision import link_poses
from simulate.motion.kinematics import Chain, Goal, follow_line, solve_ik
from simulate.robots import ROBOTS, describe, urdf_text
from simulate.robots.mesh_cover import cover_mesh, cover_surface, read_vertices
from simulate.robots.mesh_files import load_mesh
from simulate.robots.urdf_reader import read_urdf
from simulate.world.objects import product, sample_objects
from simulate.world.scene import arrange

ROOT = Path(__file__).resolve().parents[3]
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def panda():
    return describe("panda")


@pytest.fixture(scope="module")
def cell():
    with Workcell("panda") as made:
        yield made


def test_the_file_is_the_users_own_and_copied_nowhere(panda):
    shapes = [s for link in panda.links for s in link.shapes if s.kind == "mesh"]
    assert shapes
    assert all("pybullet_data" in shape.path for shape in shapes)
    assert not [p for p in (ROOT / "simulate").rglob("*") if p.suffix in (".obj", ".urdf", ".stl")]


def test_published_limits_arrive(panda):
    chain = Chain.of(panda, "panda_arm")
    assert chain.dof == 7
    assert chain.velocity == pytest.approx([2.175] * 4 + [2.61] * 3)
    assert chain.lower[3] == pytest.approx(-3.1416)
    assert chain.upper[5] == pytest.approx(3.8223)


def test_forward_kinematics_agree_with_the_physics_engine(cell):
    chain, robot = cell.robot.chains["panda_arm"], cell.robot
    rng = np.random.default_rng(1)
    index = robot.link_index["panda_link7"]
    for _ in range(10):
        q = chain.lower + rng.random(7) * (chain.upper - chain.lower)
        robot.reset_arm("panda_arm", q)
        state = cell.world.client.getLinkState(robot.body, index, computeForwardKinematics=True)
        _, positions = chain.link_frames(q[None])
        np.testing.assert_allclose(state[4], positions[0, -1], atol=2e-6)
    robot.reset_arm("panda_arm", robot.home("panda_arm"))


def test_a_leaning_nao_stands_on_flat_feet_and_is_where_physics_has_it():
    robot = describe("nao_leaning")
    with Workcell(robot, preset="fast") as leaning:
        body = leaning.robot
        chain, index = body.chains["left_arm"], body.link_index["l_wrist"]
        for q in np.random.default_rng(2).uniform(chain.lower, chain.upper, (5, chain.dof)):
            body.reset_arm("left_arm", q)
            state = body.world.client.getLinkState(body.body, index, computeForwardKinematics=True)
            _, positions = chain.link_frames(q[None])
            np.testing.assert_allclose(state[4], positions[0, -1], atol=2e-6)
    poses = link_poses(robot.root, robot.joints, {})
    foot = robot.base_from_root.matrix @ poses["l_ankle"]
    upright = describe("nao")
    stood = upright.base_from_root.matrix @ link_poses("torso", upright.joints, {})["l_ankle"]
    np.testing.assert_allclose(foot, stood, atol=1e-9)
    with pytest.raises(RobotError, match="the hips allow"):
        describe("nao", lean=2.0)


def test_seven_joints_meet_the_whole_pose(panda):
    chain = Chain.of(panda, "panda_arm")
    rng = np.random.default_rng(0)
    for angle in (0.0, 0.7, 1.5, 2.6):
        closing = np.array([math.cos(angle), math.sin(angle), 0.0])
        goal = Goal(np.array([0.48, 0.1, 0.25]), closing, DOWN, approach_must=True)
        found = solve_ik(chain, goal, rng)
        assert len(found)
        rotation, position = chain.tool_poses(found)
        assert np.linalg.norm(position - goal.position, axis=1).max() <= 0.0015
        assert (rotation[:, :, 2] @ DOWN).min() > math.cos(0.15)
        assert np.abs(rotation[:, :, 0] @ closing).min() > math.cos(0.15)
        line = follow_line(chain, found[0], np.array([0.0, 0.0, 0.06]))
        assert line is not None
        rotation, _ = chain.tool_poses(line)
        assert (rotation[:, :, 2] @ DOWN).min() > math.cos(0.16)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "side", "scale"), [("can", -1, 1.6), ("box", 1, 1.0), ("pen", -1, 1.0)]
)
def test_objects_are_grasped_held_and_placed(cell, kind, side, scale):
    spec = product(kind, 145).scaled(scale)
    assert scale == 1 or spec.dims[0] > describe("nao").arm("left").mouth  # too wide for that hand
    place = cell.world.workplace
    x, y = sum(place.area_x) / 2, side * 0.1
    body = cell.world.spawn(spec, (x, y))
    cell.world.step(0.2)
    across = math.pi / 2 if spec.extent[0] > spec.extent[1] else 0.0
    sizes = sorted(spec.extent[:2])
    request = GraspRequest(
        x, y, across, width=sizes[0], length=sizes[1], height=spec.extent[2],
        table_height=cell.world.table_height, round=kind == "can",
    )  # fmt: skip
    plan = cell.executor.plan(request, seed=1)
    assert not isinstance(plan, str)
    assert plan.tilt < 0.2
    record = cell.executor.execute(plan)
    cell.world.remove(body)
    assert (record.reason, record.held, record.placed) == ("ok", True, True)
    assert record.end_effector == "panda_hand"


def test_too_wide_and_too_heavy_depend_on_the_hand(cell):
    nao = describe("nao")
    wide = GraspRequest(0.47, -0.1, 0.0, width=0.07, height=0.06, table_height=0.2)
    assert wide.width > nao.arm("left").mouth
    assert not isinstance(cell.executor.plan(wide), str)
    assert cell.executor.plan(GraspRequest(0.47, -0.1, 0.0, width=0.09)) == "too_wide"
    heavy = GraspRequest(0.47, -0.1, 0.0, width=0.05, mass=4.0, table_height=0.2)
    assert cell.executor.plan(heavy) == "too_heavy"


def test_the_agents_body_sees_and_introduces_itself(tmp_path):
    place = describe("panda").workplace
    rng = np.random.default_rng(3)
    products = sample_objects(rng, 2)
    laid = arrange(products, rng, workplace=place)
    body = SimulatedBody(laid, tmp_path, Conditions(robot="panda"))
    try:
        assert body.gripper_ids == {"right": "panda_hand", "left": "panda_hand"}
        frame, base_from_camera = body.look("right")
        view = perceive(frame, base_from_camera, body.ignored)
        assert view.table_height == pytest.approx(place.table_height, abs=0.01)
        for one in laid:
            nearest = min(np.linalg.norm(s.position - [one.x, one.y]) for s in view.objects)
            assert nearest < 0.02
        told = body.robot.describe("panda-1")
    finally:
        body.close()
    assert told["model"] == "Franka Emika Panda"
    (hand,) = told["end_effectors"]
    assert (hand["kind"], hand["gripper_type"]) == ("ParallelJawGripper", "panda_hand")
    assert hand["max_opening"] == 0.08
    assert told["frames"][0] == "panda_link0"


def test_a_cover_of_spheres_holds_all_of_a_mesh(panda):
    shape = next(s for link in panda.links for s in link.shapes if s.kind == "mesh")
    centres, radii = cover_mesh(shape.path, shape.size)
    points = read_vertices(shape.path)
    away = np.linalg.norm(points[:, None] - centres[None], axis=2) - radii
    assert away.min(axis=1).max() < 1e-9


def test_small_spheres_hold_the_surface_of_a_mesh_and_stand_out_little(panda):
    (shape, *_) = panda.link("panda_link7").shapes
    centres, radii = cover_surface(shape.path, shape.size)
    mesh = load_mesh(Path(shape.path))
    points, _ = trimesh.sample.sample_surface(mesh, 5000, seed=0)
    away = (np.linalg.norm(points[:, None] - centres[None], axis=2) - radii).min(axis=1)
    # Between points 5 mm apart that spheres do hold, a place may lie half of that outside them.
    assert away.max() < 0.0025
    assert radii.max() <= 0.02 * np.sqrt(3) / 2
    assert (centres[:, 2] + radii).max() - mesh.bounds[1, 2] < 0.0174


def test_no_robot_by_that_name():
    with pytest.raises(RobotError, match="did you mean 'panda'"):
        describe("pandas")
    with pytest.raises(RobotError, match="no option legs"):
        describe("panda", legs="fixed")


URDF = """<robot name="r"><link name="base"/><link name="arm">{inertial}</link>
<joint name="j" type="{kind}"><parent link="base"/><child link="{child}"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
NO_TENSOR = '<inertial><mass value="1"/></inertial>'
GOOD = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1"/></inertial>'


@pytest.mark.parametrize(
    ("inertial", "kind", "child", "words"),
    [
        ("", "revolute", "arm", "link 'arm' moves and has no <inertial>"),
        ('<inertial><mass value="0"/></inertial>', "revolute", "arm", "weighs 0 kg"),
        (NO_TENSOR, "revolute", "arm", "has a mass and no <inertia>"),
        (GOOD.replace('izz=".1"', 'izz=".5"'), "revolute", "arm", "no body has the principal"),
        (GOOD, "spherical", "arm", "joint 'j' is 'spherical'"),
        (GOOD, "revolute", "leg", "names no link: 'leg'"),
    ],
)
def test_a_description_that_makes_no_sense_is_refused(tmp_path, inertial, kind, child, words):
    file = tmp_path / "r.urdf"
    file.write_text(URDF.format(inertial=inertial, kind=kind, child=child))
    with pytest.raises(RobotError, match=words):
        read_urdf(file)


def test_a_file_that_is_missing_or_no_robot_is_refused(tmp_path):
    with pytest.raises(RobotError, match="No such file"):
        read_urdf(tmp_path / "none.urdf")
    (tmp_path / "bad.urdf").write_text("<robot")
    with pytest.raises(RobotError, match="not XML"):
        read_urdf(tmp_path / "bad.urdf")
    with pytest.raises(RobotError, match=r"none\.obj"):
        read_vertices(str(tmp_path / "none.obj"))


def test_what_is_written_reads_back(tmp_path):
    for name in ROBOTS:
        robot = describe(name)
        file = tmp_path / f"{name}.urdf"
        file.write_text(urdf_text(robot))
        read = read_urdf(file)
        assert [j.name for j in read.joints] == [j.name for j in robot.joints]
        masses = sum(link.inertial.mass for link in read.links)
        assert masses == pytest.approx(sum(link.inertial.mass for link in robot.links))


def _names() -> set[str]:
    """Return everything by which code could tell one robot from another."""
    names = set(ROBOTS)
    for robot in ROBOTS:
        described = describe(robot)
        for arm in described.arms.values():
            names |= {arm.end_effector, arm.gripper_type, *arm.aliases}
    return names


def _constants(tree: ast.AST) -> set[str]:
    constants = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return {value for value in constants if isinstance(value, str)}


def test_nothing_branches_on_a_robots_name():
    """Catalogues, defaults and examples may name robots; no decision may."""
    names = _names()
    found = []
    for room in ("simulate", "rtask", "endpoint", "reasoner", "features", "grasp", "ontology"):
        for file in (ROOT / room).rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            if not any(name in text for name in names):
                continue
            tree = ast.parse(text)
            branches = [n for n in ast.walk(tree) if isinstance(n, ast.Compare | ast.match_case)]
            found += [str(file) for node in branches if _constants(node) & names]
    assert not found
