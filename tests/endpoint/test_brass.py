"""The listing of Kehoe 2014, 5.7: its service, its dataset and its programs, on a real server.

The files in ``tests/rtask/services/listing`` are those of the thesis, with its OpenRAVE lines
replaced and the model's path and the joint angles taken from the command line.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import simulate.services
from rtask.services.registry import load
from simulate.services.kinematics import read_chains
from tests.commands import run_command
from tests.servers import running_server

pytestmark = pytest.mark.slow  # starts a server

LISTING = Path(__file__).parents[1] / "rtask" / "services" / "listing"


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    for file in LISTING.glob("*.txt"):
        shutil.copy(file, tmp_path / f"{file.stem}.py")
    return tmp_path


def test_the_listing_runs(programs: Path):
    model, joints = programs / "panda.urdf", [0.3, -0.5, 0.2, -1.9, 0.4, 1.6, 0.7, 0.0]
    model.write_bytes(simulate.services.DATASETS["robots/Panda"]()["model"])
    with running_server(None, "--service", str(programs / "example.py")) as server:
        environment = {**os.environ, "RTASK_SERVER": server.url}

        def rtask(*arguments: str) -> str:
            done = run_command(*arguments, environment=environment)
            assert done.returncode == 0, done.stderr
            return done.stdout

        shown = json.loads(rtask("service", "show", "example/Kinematics", "--json"))
        assert list(shown["methods"]) == ["forwardKinematics"]
        rtask("dataset", "create", "robots/PR2")
        rtask("service", "run", str(programs / "load_robot.py"), str(model))
        user = str(programs / "end_user.py")
        pose = json.loads(rtask("service", "run", user, "panda_leftfinger", json.dumps(joints)))
    chains, _ = read_chains(model)
    rotations, positions = chains["panda_leftfinger"].tool_poses(np.array([joints]))
    # The pose travels as a quaternion.
    np.testing.assert_allclose(np.array(pose)[:3, :3], rotations[0], atol=1e-9)
    np.testing.assert_allclose(np.array(pose)[:3, 3], positions[0], atol=1e-9)


def test_its_service_is_called_after_file_and_class_with_its_inputs_in_order(programs: Path):
    (definition,) = load(str(programs / "example.py"))
    assert definition.name == "example/Kinematics"
    method = definition.methods["forwardKinematics"]
    assert list(method.request.model_fields) == ["manipulator", "joints"]
    assert method.output == "pose"
    assert list(definition.resources) == ["robot"]
    assert "brass" not in sys.modules
