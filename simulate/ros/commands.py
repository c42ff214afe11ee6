"""``rtask simulate ros``, ``ros2`` and ``ros-reach``: a simulated robot in ROS, and a client."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import print_json
from rtask.cli.ros.node import end_on_signals
from rtask.cli.ros.schema import engine_schema
from rtask.errors import RemoteUnavailableError, RobotError
from rtask.scratch import ScratchFolder
from simulate import options
from simulate.drivers.rclpy_node import ros_arguments

if TYPE_CHECKING:
    from simulate.ros.front import Front

__all__ = ["ros", "ros2", "ros_reach"]


def _body_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a simulated body, the same in ROS 1 and ROS 2."""
    for option in reversed(
        (
            options.robot,
            click.option(
                "--objects", default=4, show_default=True, help="Objects put on the table."
            ),
            options.seed(),
            options.preset,
            click.option(
                "--look", default="right", show_default=True, help="Side to which the head turns."
            ),
            click.option(
                "--clock", is_flag=True,
                help="Publish simulated time on /clock, and stamp with it.",
            ),
            click.option(
                "--unpaced", is_flag=True, help="Run as fast as it goes, not at the wall's time."
            ),
            click.option("--prefix", default="", help="Before the names of its frames, as nao1/."),
            click.option(
                "--joints-hz", default=20.0, show_default=True, help="Joints and TF per second."
            ),
            click.option(
                "--frames-hz", default=5.0, show_default=True, help="Clouds and images per second."
            ),
        )
    ):  # fmt: skip
        command = option(command)
    return command


@click.command()
@click.argument("remaps", nargs=-1, metavar="[REMAPS]...")
@_body_options
@click.option("--name", default="body", show_default=True, help="Name of the node.")
@click.option(
    "--wait", "wait_s", default=10.0, show_default=True, help="Longest wait for the ROS master, s."
)
def ros(remaps: tuple[str, ...], name: str, wait_s: float, clock: bool, **given: Any) -> None:
    """Show a simulated robot in ROS 1, as the drivers of a real one do, until Ctrl-C.

    Publishes camera/depth_registered/points, camera/rgb/image_raw/compressed and its camera_info,
    /joint_states, /tf and /tf_static. Offers the actions <arm>_controller/follow_joint_trajectory
    and the service act. REMAPS are arguments of ROS, __ns:=/nao1 for one.
    """
    from rtask.interop.ros.find import use_ros
    from rtask.interop.ros.package import load_messages

    load_messages(engine_schema(), use_ros())
    from rtask.interop.ros.node import NodeOptions, RosNode
    from simulate.ros.rospy_front import RospyFront

    node = RosNode(NodeOptions(name, remaps, wait_s, publishes_clock=clock), ["act"])
    try:
        end_on_signals(node)
        _show(RospyFront(), node.name, node.ended.is_set, clock=clock, **given)
    finally:
        node.end()
    if node.reason:
        raise RemoteUnavailableError(f"ROS ended the node {node.name}: {node.reason}")


@click.command()
@_body_options
@click.option("--name", default="body", show_default=True, help="Name of the node.")
@ros_arguments
def ros2(name: str, ros_args: str, **given: Any) -> None:
    """Show a simulated robot in ROS 2, as the drivers of a real one do, until Ctrl-C.

    The topics, actions and frames of `rtask simulate ros`. Needs rclpy in RTASK's own Python:
    source a ROS 2 for that version of Python, and a workspace with the package of `rtask ros
    messages`.
    """
    from rtask.cli.ros2.dds import ended_by_signals
    from simulate.drivers.rclpy_node import ros2_node
    from simulate.ros.rclpy_front import RclpyFront

    with ros2_node(name, ros_args, threads=8) as node:
        ended = ended_by_signals()
        _show(RclpyFront(node), node.get_fully_qualified_name(), ended.is_set, **given)


def _show(
    front: Front,
    full_name: str,
    is_ended: Callable[[], bool],
    *,
    robot: str,
    objects: int,
    seed: int,
    preset: str,
    look: str,
    clock: bool,
    unpaced: bool,
    prefix: str,
    joints_hz: float,
    frames_hz: float,
) -> None:
    """Show a simulated robot until the end."""
    from simulate.act.commands import lay_objects
    from simulate.act.service import ActService
    from simulate.grasping.executor import Workcell
    from simulate.ros.body import RosBody
    from simulate.ros.sensors import Rates

    with (
        Workcell(robot, preset) as cell,
        ScratchFolder("assets") as folder,
    ):
        standing = lay_objects(cell, objects, seed, folder)
        cell.robot.look(look)
        if min(joints_hz, frames_hz) <= 0:
            raise RobotError("--joints-hz, --frames-hz: expected rates above 0")
        rates = Rates(joints_hz, frames_hz)
        body = RosBody(front, ActService(cell, seed=seed), rates, clock, prefix, not unpaced)
        click.echo(f"ready {full_name}: {robot}, {len(standing)} objects")
        body.run(is_ended)


@click.command("ros-reach")
@click.argument("x", type=float)
@click.argument("y", type=float)
@click.argument("z", type=float)
@click.argument("remaps", nargs=-1, metavar="[REMAPS]...")
@options.robot
@options.seed("the plan")
@click.option("--theta", default=0.0, show_default=True, help="Closing direction about +z, rad.")
@click.option("--back", is_flag=True, help="Return home the same way.")
@click.option("--name", default="reach", show_default=True, help="Name of the node.")
@click.option(
    "--wait", "wait_s", default=10.0, show_default=True, help="Longest wait for master and driver."
)
@click.option(
    "--limits",
    "limits_file",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="joint_limits.yaml of the robot, as MoveIt has it: velocity, acceleration, jerk.",
)
@options.horizon
@options.json_flag("result")
def ros_reach(
    x: float,
    y: float,
    z: float,
    remaps: tuple[str, ...],
    robot: str,
    seed: int,
    theta: float,
    back: bool,
    name: str,
    wait_s: float,
    limits_file: Path | None,
    horizon: float,
    as_json: bool,
) -> None:
    """Plan to reach X Y Z (m, base frame) and move a robot's own driver in ROS 1 there.

    Plans from the arm's home posture over an empty table, and sends the trajectory to the action
    <arm>_controller/follow_joint_trajectory. Refuses to move an arm that is not at home; cancels on
    every error and on Ctrl-C. Motions keep --limits, or the maker's where they are known, else
    cautious ones, which is said, and stop within --horizon when this program or the network is
    lost. Give -- before negative numbers. Tried on simulated arms only: on
    a real one, keep the emergency stop at hand.
    """
    from rtask.interop.ros.find import use_ros
    from rtask.interop.ros.package import load_messages

    load_messages(engine_schema(), use_ros())
    from rtask.interop.ros.node import NodeOptions, RosNode
    from simulate.act.reach import plan_reach
    from simulate.drivers.joint_states import JointLimits
    from simulate.drivers.slowed_arm import SlowedArm
    from simulate.grasping.executor import Workcell
    from simulate.motion.motion_limits import MotionLimits, read_joint_limits
    from simulate.motion.trajectory import join, reverse
    from simulate.ros.driver import ArmDriver
    from simulate.world.quiet import banner_on_stderr

    with banner_on_stderr(), Workcell(robot, "fast") as cell:
        plan = plan_reach(cell, (x, y, z), theta, seed)
        joints = cell.description.arm(plan.arm).joints
        limits = JointLimits.of(cell.description, joints)
        given = read_joint_limits(limits_file) if limits_file is not None else None
        motion = MotionLimits.of(cell.description, joints, given)
    if motion.assumed:
        click.echo(motion.assumed, err=True)
    way = join([plan.free, plan.approach])
    node = RosNode(NodeOptions(name, remaps, wait_s))
    try:
        named = f"{plan.arm}_controller/follow_joint_trajectory"
        say = partial(click.echo, err=True)
        driver = SlowedArm(ArmDriver(named, joints, wait_s, limits, say), motion, horizon)
        seconds = sum(piece.duration for piece in driver.pieces(way))
        seconds = sum(piece.duration for piece in driver.pieces(way))
        driver.follow(way)
        if not as_json:
            click.echo(f"{plan.arm} is at ({x:g}, {y:g}, {z:g})")
        if back:
            driver.follow(reverse(way))
            if not as_json:
                click.echo(f"{plan.arm} is at home")
        if as_json:
            print_json({"arm": plan.arm, "seconds": seconds, "is_home": back})
    finally:
        node.end()
