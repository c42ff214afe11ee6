"""``rtask ros messages`` and ``rtask ros doctor`` with what Debian has of ROS."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner

from rtask.cli import cli
from rtask.interop.ros.master import Master
from tests.commands import run_command
from tests.rtask.interop.ros.conftest import free_port

PUBLISHED = {
    "moveit_msgs.msg.Grasp": "e26c8fb64f589c33c5d5e54bd7b5e4cb",
    "moveit_msgs.msg.GripperTranslation": "b53bc0ad0f717cdec3b0e42dec300121",
    "moveit_msgs.msg.CollisionObject": "dbba710596087da521c07564160dfccb",
    "moveit_msgs.msg.PlanningScene": "acfc50bcfd6c7b978066bfa7c786002c",
    "moveit_msgs.msg.AttachedCollisionObject": "30199ef516f64c8bc1edb1084ce4584e",
    "moveit_msgs.msg.PlanningSceneComponents": "bc993e784476960b918b6e7ad5bb58ce",
    "shape_msgs.msg.SolidPrimitive": "d8f8cbc74c5ff283fca29569ccefb45d",
    "object_recognition_msgs.msg.ObjectType": "ac757ec5be1998b0167e7efcda79e3cf",
    "control_msgs.msg.FollowJointTrajectoryAction": "bc4f9b743838566551c0390c65f1a248",
}


@pytest.mark.ros
@pytest.mark.slow
def test_the_python_packages_have_the_published_sums_and_answer_a_shell(tmp_path, roscore, node):
    # In a process of its own: what is written depends on the packages that Python finds there.
    command = [sys.executable, "-m", "rtask", "ros", "messages", str(tmp_path), "--python"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    exported = [line for line in done.stdout.splitlines() if line.startswith("export ")]
    assert len(exported) == 2
    program = "import importlib, json, sys\nprint(json.dumps({n: getattr(importlib.import_module(" \
        "n.rpartition('.')[0]), n.rpartition('.')[2])._md5sum for n in sys.argv[1:]}))"  # fmt: skip
    python = ["/usr/bin/python3", "-c", program, *PUBLISHED]
    path = {**roscore.environment, "PYTHONPATH": str(tmp_path / "python")}
    sums = subprocess.run(python, env=path, capture_output=True, text=True)
    assert sums.returncode == 0, sums.stderr
    assert json.loads(sums.stdout) == PUBLISHED
    shell = "\n".join([*exported, 'rosservice call /rtask/resolve_request "{wanted: cup}"'])
    told = subprocess.run(
        ["bash", "-c", shell], env=roscore.environment, capture_output=True, text=True, timeout=60
    )
    assert "gripper_id is missing, and the caller has no name" in told.stderr


_TOOLS = """
import json, sys
from catkin_pkg.package import parse_package
package = parse_package(sys.argv[1])
found = {}
for version in "12":
    package.evaluate_conditions({"ROS_VERSION": version})
    tools = [one.name for one in package.buildtool_depends if one.evaluated_condition]
    found[version] = [tools[0], package.get_build_type()]
print(json.dumps(found))
"""


@pytest.mark.ros
@pytest.mark.slow
def test_one_package_file_serves_catkin_and_ament(tmp_path):
    assert CliRunner().invoke(cli, ["ros", "messages", str(tmp_path)]).exit_code == 0
    told = subprocess.run(
        ["/usr/bin/python3", "-c", _TOOLS, str(tmp_path / "rtask_msgs")],
        env={}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert json.loads(told.stdout) == {"1": ["catkin"] * 2, "2": ["ament_cmake"] * 2}


def doctor(**environment):
    done = run_command("ros", "doctor", "--json", environment=environment)
    return done.returncode, {one["name"]: one for one in json.loads(done.stdout)}


@pytest.mark.ros
@pytest.mark.slow
def test_the_doctor_finds_what_is_wrong(roscore):
    code, found = doctor(**roscore.environment)
    assert code == 0, found
    assert {one: found[one]["state"] for one in ("rospy", "master", "clock", "topics")} == {
        "rospy": "ok", "master": "ok", "clock": "ok", "topics": "ok",
    }  # fmt: skip
    gone = {**roscore.environment, "ROS_MASTER_URI": f"http://127.0.0.1:{free_port()}"}
    code, found = doctor(**{**gone, "ROS_IP": "192.0.2.1"})
    assert (code, found["master"]["mend"]) == (1, "roscore &")
    assert "192.0.2.1 (ROS_HOSTNAME or ROS_IP) is 192.0.2.1, not" in found["own address"]["detail"]
    Master(roscore.uri).ask("setParam", "/use_sim_time", True)
    try:
        code, found = doctor(**roscore.environment)
    finally:
        Master(roscore.uri).ask("deleteParam", "/use_sim_time")
    assert (code, found["clock"]["state"]) == (1, "broken")
