"""Trace of a request: the files that it enters, and its climbs from a lower layer to a higher one.

    python tests/benchmarks/endpoint/trace_request.py

A robot recognises a stored box that it has just seen anew, and inserts a box that nobody has seen,
each after others of their kind, so that imports and catalogues are warm. `sys.setprofile` sees
every call of a Python function. A file counts when a function of it was called. A climb is a call
from a file of a lower layer into one of a higher layer, by the import contracts in pyproject.toml:
engine over knowledge base over SPARQL over terms, and all of `rtask` over `reasoner`, `features`
and `grasp`. Data goes one way when the only climbs are the announcements of a commit.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import Frame, Intrinsics
from grasp.messages import pose_message
from rtask.engine import Engine
from rtask.kb.commit.access import Access

ROOT = Path(__file__).resolve().parents[3]
ROOMS = ("endpoint", "rtask", "reasoner", "features", "grasp", "ontology")
ROBOT = Access("bench-1", "robot")
HAND = {"name": "hand", "gripper_type": "pinch", "max_opening": 0.08, "max_payload": 0.5}
CAMERA = Intrinsics(320, 240, 350.0, 350.0, 159.5, 119.5)


def contracts() -> dict[str, list[list[str]]]:
    """Return the layers of each container of the import contracts, the highest first."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found: dict[str, list[list[str]]] = {}
    for contract in settings["tool"]["importlinter"]["contracts"]:
        if contract["type"] == "layers":
            for container in contract.get("containers", [""]):
                layers = [
                    [part.strip().strip("()") for part in layer.replace(":", "|").split("|")]
                    for layer in contract["layers"]
                ]
                found.setdefault(container, layers)
    return found


def height_of(module: str, layers: dict[str, list[list[str]]]) -> tuple[int, ...]:
    """Return the place of a module in the layers, from the outermost; larger is higher."""
    height: list[int] = []
    parts, container = module.split("."), ""
    for part in parts:
        ranks = layers.get(container)
        if ranks is None:
            break
        at = next((k for k, layer in enumerate(ranks) if part in layer), None)
        if at is None:
            break
        height.append(-at)
        container = f"{container}.{part}".lstrip(".")
    return tuple(height)


class Trace:
    """Files that a call entered.

    Attributes
    ----------
    files
        Calls into each file.
    climbs
        Calls from a file (first) of a lower layer into one of a higher layer (second).
    """

    def __init__(self) -> None:
        self.files: Counter[str] = Counter()
        self.climbs: Counter[tuple[str, str]] = Counter()
        self._layers = contracts()
        self._modules: dict[str, str] = {}

    def run(self, call: Callable[[], Any]) -> None:
        """Carry out a call under the trace."""
        sys.setprofile(self._enter)
        try:
            call()
        finally:
            sys.setprofile(None)

    def _enter(self, frame: FrameType, event: str, argument: Any) -> None:
        if event != "call":
            return
        entered = self._module(frame.f_code.co_filename)
        if not entered or frame.f_code.co_name == "<module>":
            return
        self.files[entered] += 1
        caller = frame.f_back
        while caller is not None and not self._module(caller.f_code.co_filename):
            caller = caller.f_back
        came_from = self._module(caller.f_code.co_filename) if caller else ""
        if came_from and self._is_lower(came_from, entered):
            self.climbs[came_from, entered] += 1

    def _module(self, path: str) -> str:
        """Return the dotted name of a file of ours, empty for any other."""
        if path not in self._modules:
            name = ""
            if path.startswith(str(ROOT)):
                inner = Path(path).relative_to(ROOT).with_suffix("")
                if inner.parts[0] in ROOMS:
                    name = ".".join(inner.parts).removesuffix(".__init__")
            self._modules[path] = name
        return self._modules[path]

    def _is_lower(self, one: str, other: str) -> bool:
        """Tell whether one module lies in a lower layer than another."""
        a, b = height_of(one, self._layers), height_of(other, self._layers)
        return next((x < y for x, y in zip(a, b, strict=False) if x != y), False)


def view(seed: int, brighter: int = 0) -> dict[str, Any]:
    """Return what a robot sends of a textured box below a camera that looks straight down."""
    dice = np.random.default_rng(seed)
    depth = np.full((240, 320), 0.57, np.float32)
    depth[104:136, 137:183] = 0.53
    colours = dice.integers(0, 240, (60, 80, 3), np.uint8).repeat(4, 0).repeat(4, 1) + brighter
    mask = depth < 0.55
    frame = Frame(depth, CAMERA, colours.astype(np.uint8), mask, frame_id="optical")
    camera = np.diag([1.0, -1.0, -1.0, 1.0])
    camera[2, 3] = 0.57
    return {
        "data": to_wire(encode_frame(frame.crop(mask))),
        "sensor_pose": pose_message(camera),
        "frame_id": "base",
        "support_height": 0.0,
    }


def main() -> None:
    """Print the files and climbs of one recognition and one insertion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--list", action="store_true", help="name every file entered")
    listed = parser.parse_args().list
    with rtask.open(":memory:") as kb, Engine(kb) as engine:
        robot = {"name": ROBOT.agent, "model": "arm", "end_effectors": [HAND]}
        engine.call("register_robot", robot, ROBOT)

        def recognise() -> dict[str, Any]:
            request = {**view(1), "gripper_id": "hand", "propose": True, "max_grasps": 5}
            return engine.call("recognise_for_grasp", request, ROBOT)

        def insert(seed: int) -> None:
            best = recognise()["grasps"]
            item = {**view(seed), "gripper_id": "hand", "success": True}
            if best:
                item["grasp"] = dict(best[0])
            engine.call("insert_object", {"objects": [item]}, ROBOT)

        insert(1)
        insert(2)
        answer = recognise()
        seen = view(1, brighter=3)
        requests = {
            "recognition": lambda: engine.call(
                "recognise_for_grasp",
                {**seen, "gripper_id": "hand", "propose": True, "max_grasps": 5, "seed": 1},
                ROBOT,
            ),
            "insertion": lambda: engine.call(
                "insert_object",
                {"objects": [{**view(3), "gripper_id": "hand", "success": True,
                              "grasp": plain(answer["grasps"][0])}]},
                ROBOT,
            ),
        }  # fmt: skip
        for name, request in requests.items():
            trace = Trace()
            trace.run(request)
            print(f"{name}: {len(trace.files)} files, {sum(trace.climbs.values())} climbs")
            for (lower, higher), count in trace.climbs.most_common():
                print(f"    {count:5d} {lower} -> {higher}")
            if listed:
                for module, count in sorted(trace.files.items()):
                    print(f"    {count:6d} {module}")


def plain(answer: Any) -> dict[str, Any]:
    """Return a part of an answer as a dictionary."""
    return answer.as_json() if hasattr(answer, "as_json") else dict(answer)


if __name__ == "__main__":
    main()
