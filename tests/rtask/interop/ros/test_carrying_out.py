"""Simulated robots carry out a plan by services of ROS 1, on a server that knows nothing else."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rtask
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.crew import Crew
from simulate.tasks.executor import Executor
from simulate.tasks.lab import read_lab
from tests.rtask.tasks.conftest import CUP, LAB, LEFT, NAO, PANDA

pytestmark = [pytest.mark.ros, pytest.mark.slow]


class OverRos:
    """What a robot's program has of the graph if it claims and ends steps by services of ROS.

    Queries go by HTTP, and so do outcomes: of a grasp in a lab without poses ROS has no message.
    """

    def __init__(self, robot, graph):
        self._robot, self._graph, self.query = robot, graph, graph.query
        self.called = set()

    def call(self, operation, timeout_s=None, /, **fields):
        if operation == "report_outcome":
            return self._graph.call(operation, **fields)
        self.called.add(operation)
        # An optional number is a list of at most one, and what has no type of its own is JSON.
        given = {name: [value] if name == "lease" else value
                 for name, value in fields.items() if value is not None}  # fmt: skip
        answer = self._robot.call(f"/rtask/{operation}", **given)
        assert isinstance(answer, dict), answer
        assert not answer.get("refused"), answer
        if operation == "claim_step":
            answer["arguments"] = json.loads(answer["arguments_json"] or "{}")
            answer["answer"] = next(iter(answer["answer"]), None)
        return answer


def test_simulated_robots_carry_out_a_plan_over_services_of_ros_1(robot, ros_server):
    with rtask.connect(ros_server.url) as graph:
        graph.update(LAB)
        lab = read_lab(graph.query, np.random.default_rng(3), 0.0)
        over_ros = OverRos(robot, graph)
        robots = {iri: Executor(over_ros, lab.robot(iri), iri) for iri in (NAO, PANDA)}
        graph.call("store_plan", goal="every cup into the left box")
        (ended,) = Crew(graph, robots).work()
        assert (ended.result, ended.repairs) == ("reached", 0)
        assert over_ros.called == {"claim_step", "end_step"}
        assert lab.where[CUP] == LEFT
        linked = f"{PREFIXES}SELECT DISTINCT ?attempt WHERE {{ ?step rt:carriedOutBy ?attempt }}"
        assert len(graph.query(linked)) == [deed[1] for deed in lab.done].count("pick") == 2
