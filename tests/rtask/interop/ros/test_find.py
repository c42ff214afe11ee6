"""Finding ROS, and the message for one that cannot be used."""

from __future__ import annotations

import sys

from rtask.interop.ros.find import INSTALL, _why


def installed_for(tmp_path, tag):
    (tmp_path / "tf2_py").mkdir()
    (tmp_path / "tf2_py" / f"_tf2.cpython-{tag}-x86_64-linux-gnu.so").touch()
    return tmp_path


def test_a_ros_for_another_python_names_both_versions_and_the_way_out(tmp_path):
    said = _why(installed_for(tmp_path, "38"), "tf2_ros", ImportError("no module _tf2"))
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert f"is for Python 3.8, this is Python {own}: tf2_ros: no module _tf2" in said
    assert "set ROS_MASTER_URI there" in said


def test_a_ros_that_lacks_a_package_names_the_command(tmp_path):
    own = f"{sys.version_info.major}{sys.version_info.minor}"
    said = _why(installed_for(tmp_path, own), "actionlib", ImportError("No module"))
    assert said.endswith(INSTALL)
    assert "lacks actionlib" in said
