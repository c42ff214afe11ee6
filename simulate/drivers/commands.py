"""``rtask robot reach``: a motion planned here, carried out by a real arm."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import json_option, print_json
from rtask.errors import RobotError, UsageError
from rtask.extras import naming_extras
from simulate import options
from simulate.drivers.rclpy_node import ros2_node, ros_arguments

if TYPE_CHECKING:
    from simulate.drivers.following import FollowingArm
    from simulate.drivers.joint_states import JointLimits
    from simulate.drivers.naoqi import NaoqiArm
    from simulate.grasping.executor import Workcell
    from simulate.motion.collision import Obstacle, PointField
    from simulate.robots.description import Arm

__all__ = ["reach"]


@click.command()
@click.argument("x", type=float)
@click.argument("y", type=float)
@click.argument("z", type=float)
@options.robot
@options.seed("the plan")
@click.option("--theta", default=0.0, show_default=True, help="Closing direction about +z, rad.")
@click.option("--naoqi", metavar="ADDRESS", help="NAOqi of a NAO, such as tcp://nao.local:9559.")
@click.option("--rosbridge", metavar="URL", help="A rosbridge server, such as ws://robot:9090.")
@click.option("--ros2", is_flag=True, help="An arm in the ROS 2 of this shell, by rclpy.")
@ros_arguments
@click.option(
    "--action",
    help="Action of the arm's driver.  [default: /<arm>_controller/follow_joint_trajectory]",
)
@click.option("--joints", default="/joint_states", show_default=True, help="Topic of the joints.")
@click.option(
    "--ros", type=click.Choice(["1", "2"]), default="2", show_default=True,
    help="ROS behind --rosbridge: its numbers say how a motion ended.",
)  # fmt: skip
@click.option(
    "--limits",
    "limits_file",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="joint_limits.yaml of the robot, as MoveIt has it: velocity, acceleration, jerk.",
)
@options.horizon
@click.option("--home", "home_first", is_flag=True, help="Bring the arm home first.")
@click.option("--back", is_flag=True, help="Return home the same way.")
@click.option(
    "--grasp", is_flag=True, help="Close the hand, lift, hold, put back, go home (--naoqi)."
)
@json_option
def reach(
    x: float,
    y: float,
    z: float,
    robot: str,
    seed: int,
    theta: float,
    naoqi: str | None,
    rosbridge: str | None,
    ros2: bool,
    ros_args: str,
    action: str | None,
    joints: str,
    ros: str,
    limits_file: Path | None,
    horizon: float,
    home_first: bool,
    back: bool,
    grasp: bool,
    as_json: bool,
) -> None:
    """Plan to reach X Y Z (m, base frame) and move a real arm there.

    Plans from the arm's home posture over an empty table; with --ros2 it keeps clear of MoveIt's
    planning scene, if get_planning_scene is offered. Refuses to move an arm that is not at
    home, unless --home finds a free path there, and an arm that moves, is outside its limits or
    whose joint states are old or incomplete. Motions keep the velocity, acceleration and jerk of
    --limits, or the maker's where they are known, else cautious ones, which is said. They are sent
    in pieces that end at rest, so that an arm whose link is lost stops within --horizon. The arm is
    stopped on every error and on Ctrl-C; it is said to be there only if its joints, measured anew,
    are.
    --ros2 needs rclpy and control_msgs for RTASK's own Python. Give -- before negative numbers. The
    token for rosbridge is read from RTASK_TOKEN. Tried on stand-ins and simulated arms only: on a
    real one, keep the emergency stop at hand.

    With --grasp, exit code 1 if nothing was held.
    """
    if [naoqi is not None, rosbridge is not None, ros2].count(True) != 1:
        raise UsageError("expected one of --naoqi ADDRESS, --rosbridge URL and --ros2")
    if ros_args and not ros2:
        raise UsageError("--ros-args goes with --ros2")
    if grasp and naoqi is None:
        raise UsageError("--grasp moves the hand, which only --naoqi does")
    from simulate.act.reach import plan_reach
    from simulate.drivers import motions
    from simulate.drivers.joint_states import JointLimits
    from simulate.drivers.rclpy_arm import RclpyArm
    from simulate.drivers.rosbridge import RosbridgeArm
    from simulate.drivers.slowed_arm import SlowedArm
    from simulate.grasping.executor import Workcell
    from simulate.motion.motion_limits import MotionLimits, read_joint_limits

    say = partial(click.echo, err=True)
    with Workcell(robot, "fast") as cell, contextlib.ExitStack() as opened:
        node = opened.enter_context(ros2_node("rtask_reach", ros_args)) if ros2 else None
        around = _around(node, cell, (x, y, z), say)
        plan = plan_reach(cell, (x, y, z), theta, seed, around)
        arm = cell.description.arm(plan.arm)
        limits = JointLimits.of(cell.description, arm.joints)
        given = read_joint_limits(limits_file) if limits_file is not None else None
        motion = MotionLimits.of(cell.description, arm.joints, given)
        if motion.assumed:
            click.echo(motion.assumed, err=True)
        report: dict[str, Any] = {"arm": plan.arm, "held": None, "evidence": ""}
        named = action or f"/{arm.name}_controller/follow_joint_trajectory"
        if naoqi is not None:
            driver: FollowingArm = opened.enter_context(_naoqi(naoqi, arm, limits))
        elif ros2:
            driver = RclpyArm(node, named, arm.joints, joints, limits=limits, say=say)
        else:
            bridged = RosbridgeArm(
                str(rosbridge), named, arm.joints, joints, os.environ.get("RTASK_TOKEN"),
                limits=limits, ros=1 if ros == "1" else 2, say=say,
            )  # fmt: skip
            driver = opened.enter_context(bridged)
        slow = SlowedArm(driver, motion, horizon)
        if home_first:
            motions.bring_home(slow, cell, plan.arm, seed, around)
        if grasp:
            judged = motions.grasp(slow, plan, cell)
            report |= {"held": judged.is_yes, "evidence": judged.evidence}
        else:
            motions.reach(slow, plan, back)
        report["is_home"] = back or grasp
    if as_json:
        print_json(report)
    elif grasp:
        click.echo(f"{plan.arm}: {'held' if report['held'] else 'not held'} ({report['evidence']})")
    else:
        place = "at home" if back else f"at ({x:g}, {y:g}, {z:g})"
        click.echo(f"{plan.arm} is {place}")
    if report["held"] is False:
        raise SystemExit(1)


def _around(
    node: Any | None,
    cell: Workcell,
    goal: tuple[float, float, float],
    say: Callable[[str], None],
) -> list[Obstacle | PointField]:
    """Return what MoveIt's planning scene says to stand around; nothing where there is none."""
    from simulate.drivers.scene import obstacles_of, scene_of

    scene = scene_of(node, cell.description.base_frame) if node is not None else None
    if scene is None:
        return []
    around = obstacles_of(scene, cell.world.table_height, goal, say)
    say(f"keeping clear of {len(around)} obstacles of MoveIt's planning scene")
    return around


@contextlib.contextmanager
def _naoqi(address: str, arm: Arm, limits: JointLimits) -> Iterator[NaoqiArm]:
    from simulate.drivers.naoqi import HANDS, NaoqiArm

    hands = [alias for alias in arm.aliases if alias in HANDS]
    if not hands:
        raise RobotError(f"{arm.name} is no arm of a NAO; give --robot nao")
    say = partial(click.echo, err=True)
    with (
        naming_extras("--naoqi"),
        NaoqiArm(address, arm.joints, hands[0], limits, say) as driver,
    ):
        yield driver
