"""Benchmark of loading: time and memory, beside the store's own bulk loader.

    python tests/benchmarks/kb/bench_load.py
    python tests/benchmarks/kb/bench_load.py --triples 1000000 --rounds 5

Each line is a process of its own on a fresh folder; rounds are interleaved and the median of CPU
seconds counts. The peer writes the same N-Triples file into one named graph with `Store.bulk_load`
and flushes. The first row is what users do: a robot's grasps, poses and outcomes into a knowledge
base with the ontology and its rules; then that graph is replaced by as many other statements, and
everything dropped. The rows beneath load objects of a vocabulary that no ontology knows, with the
ontology left out.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

_RT = "https://w3id.org/rtask-kg/ns#"
_ROBOT = "ontology, rules"
_REPLACED, _DROPPED = "replaced", "DROP ALL"
_OF_ROBOTS = (_ROBOT, _REPLACED, _DROPPED, "raw, robot")
_SIDES = (*_OF_ROBOTS, "raw", "view", "merged", "merged, closure")


def write_file(path: Path, triples: int) -> None:
    """Write objects with five statements each."""
    rng = random.Random(1)
    kind = "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type>"
    double = "<http://www.w3.org/2001/XMLSchema#double>"
    count = triples // 5
    with path.open("w") as out:
        for number in range(count):
            thing = f"<https://example.org/lab/object/{number}>"
            near = f"<https://example.org/lab/object/{rng.randrange(count)}>"
            out.write(f"{thing} {kind} <https://example.org/lab/Mug> .\n")
            out.write(f'{thing} <{_RT}mass> "{rng.random():.6f}"^^{double} .\n')
            out.write(f'{thing} <{_RT}objectId> "lab/mug-{number}" .\n')
            out.write(f'{thing} <https://example.org/lab/name> "mug number {number}" .\n')
            out.write(f"{thing} <https://example.org/lab/near> {near} .\n")


def write_robot_file(path: Path, triples: int) -> None:
    """Write grasps of objects, their poses, attempts and outcomes, in RTASK's own terms."""
    rng = random.Random(1)
    written = 0
    xsd = "http://www.w3.org/2001/XMLSchema#"
    with path.open("w") as out:

        def say(subject: str, predicate: str, value: str) -> None:
            nonlocal written
            out.write(f"<https://example.org/lab/{subject}> {predicate} {value} .\n")
            written += 1

        def is_a(subject: str, name: str) -> None:
            say(subject, "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type>", f"<{_RT}{name}>")

        def link(subject: str, name: str, other: str) -> None:
            say(subject, f"<{_RT}{name}>", f"<https://example.org/lab/{other}>")

        def value(subject: str, name: str, text: str, kind: str) -> None:
            say(subject, f"<{_RT}{name}>", f'"{text}"^^<{xsd}{kind}>')

        for robot in range(4):
            is_a(f"robot{robot}", "Robot")
            is_a(f"hand{robot}", "Gripper")
            link(f"robot{robot}", "hasGripper", f"hand{robot}")
        for number in itertools.count():
            if written >= triples:
                return
            thing, frame = f"object{number // 20}", f"frame{number // 20}"
            if number % 20 == 0:
                is_a(thing, "DrinkingVessel")
                value(thing, "mass", f"{rng.random():.4f}", "double")
                is_a(frame, "Frame")
                link(frame, "frameOf", thing)
            grasp, pose, attempt, outcome, feedback = (
                f"{name}{number}" for name in ("grasp", "pose", "attempt", "outcome", "feedback")
            )
            is_a(grasp, "SpatialGrasp")
            link(grasp, "graspPose", pose)
            link(grasp, "graspOf", thing)
            is_a(pose, "Pose")
            link(pose, "inFrame", frame)
            for axis in ("x", "y", "z", "qx", "qy", "qz", "qw"):
                value(pose, axis, f"{rng.random():.5f}", "double")
            robot = rng.randrange(4)
            is_a(attempt, "GraspAttempt")
            link(attempt, "performedBy", f"robot{robot}")
            link(attempt, "activates", f"hand{robot}")
            link(attempt, "executesGrasp", grasp)
            link(attempt, "hasOutcome", outcome)
            held = "true" if rng.random() < 0.6 else "false"
            is_a(outcome, "GraspOutcome")
            value(outcome, "success", held, "boolean")
            link(outcome, "hasFeedback", feedback)
            is_a(feedback, "PhysicsFeedback")
            value(feedback, "verdict", held, "boolean")


def load(side: str, file: Path, folder: Path) -> dict[str, float]:
    """Load once; return CPU seconds and megabytes."""
    if side.startswith("raw"):
        import pyoxigraph as ox

        store = ox.Store(folder)
        start = time.process_time()
        graph = ox.NamedNode("urn:g")
        store.bulk_load(path=str(file), format=ox.RdfFormat.N_TRIPLES, to_graph=graph)
        store.flush()
        seconds = time.process_time() - start
    else:
        import rtask

        options: dict[str, Any] = {}
        if side not in _OF_ROBOTS:
            options = {
                "union": side.partition(",")[0],
                "reason": "closure" in side,
                "ontologies": False,
            }
        with rtask.open(folder, **options) as kb:
            if side in (_REPLACED, _DROPPED):
                kb.load(file, graph="urn:g")
            start = time.process_time()
            if side == _DROPPED:
                kb.update("DROP ALL")
            elif side == _REPLACED:
                other = file.read_bytes().replace(b"example.org/lab", b"example.org/hall")
                kb.load(other, format="ntriples", graph="urn:g", replace=True)
            else:
                kb.load(file)
            seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": seconds, "peak": peak}


def main() -> None:
    """Measure in processes of their own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triples", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--side", help=argparse.SUPPRESS)
    parser.add_argument("--file", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.side:
        print(json.dumps(load(options.side, options.file, options.folder)))
        return
    with tempfile.TemporaryDirectory() as place:
        file, robot_file = Path(place) / "objects.nt", Path(place) / "robot.nt"
        write_file(file, options.triples)
        write_robot_file(robot_file, options.triples)
        print(
            f"{options.triples} triples, {file.stat().st_size / 1e6:.0f} MB; "
            f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
        )
        found: dict[str, list[dict[str, float]]] = {side: [] for side in _SIDES}
        for number in range(options.rounds):
            for side in _SIDES:
                folder = Path(place) / f"{side} {number}"
                command = [sys.executable, __file__, "--side", side]
                source = robot_file if side in _OF_ROBOTS else file
                command += ["--file", str(source), "--folder", str(folder)]
                answer = subprocess.run(command, capture_output=True, text=True, check=True)
                found[side].append(json.loads(answer.stdout))
    raws = {
        side: statistics.median(run["seconds"] for run in found[side])
        for side in ("raw, robot", "raw")
    }
    print(f"{'':18s}{'CPU s':>9s}{'triples/s':>11s}{'ratio':>7s}{'peak MB':>9s}")
    for side, runs in found.items():
        seconds = statistics.median(run["seconds"] for run in runs)
        raw = raws["raw, robot" if side in _OF_ROBOTS else "raw"]
        peak = max(run["peak"] for run in runs)
        rate = options.triples / seconds
        print(f"{side:18s}{seconds:9.2f}{rate:11.0f}{seconds / raw:7.1f}{peak:9.0f}")


if __name__ == "__main__":
    main()
