"""Drivers before robots that lie, one of each kind for a module."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from types import SimpleNamespace

import pytest

from rtask.cli.ros.schema import engine_schema
from rtask.interop.ros.find import INSTALL, find_ros
from tests.rtask.ros2 import standin
from tests.simulate.drivers.benches import NAOQI, ROS1, ROS2, be_patient, open_bench, waits_restored

# A program that imports rospy as it starts; the search for doctests would import it here.
collect_ignore = [] if find_ros() else ["ros1_arm.py"]


@pytest.fixture(scope="module")
def ros2_world():
    """The stand-in for rclpy, whose action servers end goals with any number."""
    pytest.importorskip("rosbags")
    world = standin.World(engine_schema())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(standin, "_STATUS", {number: number for number in range(100)})
        patch.setattr(
            standin.Clock, "now", lambda self: SimpleNamespace(nanoseconds=time.time_ns())
        )
        standin.install(world, lambda name, module: patch.setitem(sys.modules, name, module))
        yield world


@pytest.fixture(scope="module")
def benches(request):
    """Return the bench of a driver; each is opened once."""
    opened = {}
    with waits_restored(), contextlib.ExitStack() as stack:
        be_patient()

        def bench(driver):
            if driver == NAOQI:
                pytest.importorskip("qi")
            if driver == ROS1 and find_ros() is None:
                if os.environ.get("RTASK_ROS_INSTALLED"):
                    pytest.fail(f"ROS was to be installed and rospy is not there: {INSTALL}")
                pytest.skip(f"no rospy: {INSTALL}")
            if driver == ROS2:
                pytest.importorskip("rosbags")
            if driver not in opened:
                opened[driver] = open_bench(driver, request)
                stack.callback(opened[driver].close)
            return opened[driver]

        yield bench
