"""Declared requests and answers, beside the same work on plain dictionaries.

    python tests/benchmarks/endpoint/bench_wire.py

The request is `recognise_for_grasp` with a cloud of 360 kB, as bytes and as base64; the peer looks
at the same fields by hand and decodes the text with :mod:`base64`. The answer is one of some 49 kB;
the peer builds dictionaries, checks nothing and calls :func:`json.dumps`, which is what a server
without declarations does. CPU time, medians of pairs that take turns. Imports are timed in
processes of their own.
"""

from __future__ import annotations

import argparse
import base64
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from grasp.messages import matrix_from_message, pose_message, spatial_grasp_message
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import ParallelGripper
from rtask.engine.memory.statistics import GraspStatistics, summary
from rtask.engine.operations.recognise import RecogniseForGrasp
from rtask.engine.operations.recognition_answer import OfferedGrasp, Recognition
from rtask.wire.message import read

CLOUD = np.random.default_rng(3).bytes(360_000)
POSE = pose_message(np.eye(4))
HAND = ParallelGripper("hand", "nao_hand", 0.0, 0.05)
TEXTS = ("task", "gripper_id", "frame_id", "object")
NUMBERS = {
    "support_height": (-np.inf, np.inf), "stamp": (-np.inf, np.inf), "max_grasps": (1, 50),
    "seed": (0, np.inf), "min_confidence": (0, 1), "min_identity": (0, 1), "min_pose": (0, 1),
    "min_grasp": (0, 1),
}  # fmt: skip
FLAGS = ("propose", "in_space", "decide")
OTHERS = ("data", "image", "sensor_pose", "exclude", "neighbours")
IMPORTS = {
    "json, dataclasses, typing": "import json, dataclasses, typing",
    "the same and pydantic": "import json, dataclasses, typing, pydantic",
    "all declarations": "import json, dataclasses, typing, pydantic; "
    "import rtask.engine.operations.table as t",
    "all declarations, each built": "import json, dataclasses, typing, pydantic; "
    "import rtask.engine.operations.table as t; "
    "[m.model_rebuild() for o in t.OPERATIONS.values() for m in (o.request, o.answer)]",
    "`rtask --help`": "import sys; sys.argv = ['rtask', '--help']; "
    "import contextlib, io, rtask.cli\n"
    "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()): "
    "rtask.cli.main()",
}


def by_hand(message: dict[str, Any]) -> dict[str, Any]:
    """Check a request field by field, as a program without declarations does."""
    known = {*TEXTS, *NUMBERS, *FLAGS, *OTHERS}
    for name in message:
        if name not in known:
            raise ValueError(f"unknown field {name}")
    given = dict(message)
    for name in TEXTS:
        if name in given and not (isinstance(given[name], str) and given[name].strip()):
            raise ValueError(f"{name}: not a text")
    for name, (low, high) in NUMBERS.items():
        if name in given:
            number = float(given[name])
            if not low <= number <= high:
                raise ValueError(f"{name}: out of bounds")
            given[name] = number
    for name in FLAGS:
        if name in given and not isinstance(given[name], bool):
            raise ValueError(f"{name}: not a flag")
    for name in ("data", "image"):
        if isinstance(given.get(name), str):
            given[name] = base64.b64decode(given[name], validate=True)
    if "sensor_pose" in given:
        given["sensor_pose"] = matrix_from_message(given["sensor_pose"])
    return given


def answer_parts(grasps: int) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return what a recognition answers: the fields of each grasp, and those of the whole."""
    dice = np.random.default_rng(5)
    offered = []
    for k in range(grasps):
        frame_from_gripper = np.eye(4)
        frame_from_gripper[:3, 3] = dice.uniform(-0.3, 0.3, 3)
        candidate = GraspCandidate(frame_from_gripper, 0.03, source="bench", opening=0.045)
        message = spatial_grasp_message(candidate, HAND, "base_footprint")
        x, y, z = (float(value) for value in dice.uniform(-0.3, 0.3, 3))
        offered.append({
            **message, "id": f"https://example.org/kb/grasp/{k}", "kind": "spatial",
            "source": "memory", "x": x, "y": y, "z": z, "theta": 0.3, "width": 0.03,
            "opening": 0.045, "mean": 0.7, "interval90": [0.5, 0.9], "alpha": 7.0, "beta": 3.0,
            "explanation": {"quality": 0.8, "graph": [6.0, 2.0], "text": "chance 0.70 " * 12},
            "in_object": {"x": x, "y": y, "z": z, "theta": 0.3},
        })  # fmt: skip
    top = {name: offered[0][name] for name in (*message,) if name != "id"}
    whole = {
        "task_response": "grasp", "task_id": "t-1", "object": "urn:o", "class_iri": "urn:c",
        "label": "cup", "confidence": 0.97, **top, "shape": None, "recognition": {"matches": []},
        "similar_objects": [], "grasps_left_out": 0, "decision": None, "times": {"total_s": 0.1},
    }  # fmt: skip
    return offered, whole


def declared_answer(parts: tuple[list[dict[str, Any]], dict[str, Any]]) -> bytes:
    """Build and write an answer as an operation does."""
    offered, whole = parts
    statistics_ = summary(6, 8)
    grasps = [OfferedGrasp(**one, statistics=statistics_) for one in offered]
    return Recognition(**whole, class_="Cup", grasps=grasps, statistics=statistics_).to_json()


def plain_answer(parts: tuple[list[dict[str, Any]], dict[str, Any]]) -> bytes:
    """Build and write an answer of dictionaries."""
    offered, whole = parts
    numbers = dict(GraspStatistics.as_json(summary(6, 8)))
    grasps = [{**one, "statistics": numbers} for one in offered]
    answer = {**whole, "class": "Cup", "grasps": grasps, "statistics": numbers}
    return json.dumps(answer, allow_nan=False).encode()


def pairs(ours: Callable[[], Any], peer: Callable[[], Any], rounds: int) -> tuple[float, float]:
    """Return the median CPU time of each side, s; the sides take turns."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for call, found in zip((ours, peer), times, strict=True):
            start = time.process_time_ns()
            for _ in range(10):
                call()
            found.append((time.process_time_ns() - start) / 10 * 1e-9)
    return statistics.median(times[0]), statistics.median(times[1])


def line(name: str, times: tuple[float, float]) -> None:
    """Print a row of the table."""
    ours, peer = (1e6 * one for one in times)
    print(f"| {name} | {ours:.0f} us | {peer:.0f} us | {ours / peer:.2f} |")


def cpu_of(code: str) -> float:
    """Return the CPU time of a program in a new process, s, without the interpreter's start."""
    timed = (
        f"import time; start_ = time.process_time()\n{code}\nprint(time.process_time() - start_)"
    )
    runs = [
        subprocess.run([sys.executable, "-c", timed], capture_output=True, text=True, check=True)
        for _ in range(5)
    ]
    return min(float(one.stdout.splitlines()[-1]) for one in runs)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=40)
    rounds = parser.parse_args().rounds
    request = {"data": CLOUD, "gripper_id": "hand", "sensor_pose": POSE, "frame_id": "base",
               "support_height": 0.4, "max_grasps": 10, "propose": True}  # fmt: skip
    text = {**request, "data": base64.b64encode(CLOUD).decode()}
    parts = answer_parts(20)
    written = declared_answer(parts)
    assert json.loads(written) == json.loads(plain_answer(parts))
    print("| what | ours | peer | ratio |\n|---|---|---|---|")
    for name, message in (("bytes", request), ("base64", text)):
        line(
            f"check, cloud of 360 kB as {name}",
            pairs(
                lambda m=message: read(RecogniseForGrasp, m), lambda m=message: by_hand(m), rounds
            ),  # type: ignore[misc]
        )
    line(
        f"answer of {len(written) / 1000:.0f} kB, built and written",
        pairs(lambda: declared_answer(parts), lambda: plain_answer(parts), rounds),
    )
    for name, code in IMPORTS.items():
        print(f"import: {name}: {cpu_of(code):.3f} s")


if __name__ == "__main__":
    main()
