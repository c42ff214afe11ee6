"""Kill a knowledge base while it saves its closure, and open it again.

    python tests/benchmarks/reasoner/stress_closure.py
    python tests/benchmarks/reasoner/stress_closure.py --kills 30 --triples 100000

Each round starts a process that commits and saves the closure after every commit, and kills it
with SIGKILL at a random moment after its first commit. Then a process of its own opens the folder:
every saved closure must be whole, the commits that were acknowledged must be there, and the closure
that is used, its inferred graph and its contradictions must equal those of a rebuilt one.
Printed is also how long it took until the folder could be written again.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def prepare(folder: Path, triples: int) -> None:
    """Make a knowledge base with the ontology and a robot's attempts."""
    import rtask
    from tests.benchmarks.kb.bench_load import write_robot_file

    file = folder.parent / "robot.nt"
    write_robot_file(file, triples)
    with rtask.open(folder) as kb:
        kb.load(file)


def write(folder: Path) -> None:
    """Commit, and save the closure after each commit, until killed."""
    import rtask
    from rtask.kb.durability import recovery, saved_closures

    saved_closures._DUE_CHANGES = 0
    recovery._EVERY_S = 0.0
    graph = "https://w3id.org/rtask-kg/ns#"
    with rtask.open(folder) as kb:
        number = kb.seq
        while True:
            number += 1
            kb.update(
                f"INSERT DATA {{ <urn:g{number}> a <{graph}SpatialGrasp> ; "
                f"<{graph}graspOf> <https://example.org/lab/object0> }}",
                agent="nao-1",
            )
            print(kb.seq, flush=True)


def check(folder: Path, acknowledged: int) -> None:
    """Open the folder and compare the closure with a rebuilt one."""
    import rtask
    from reasoner.saved.container import read_head, require_whole
    from rtask.kb.durability.saved_closures import saved_folders

    folders = saved_folders(folder)
    for path in folders:
        require_whole(path, read_head(path))  # only whole ones have their name
    start = time.perf_counter()
    with rtask.open(folder) as kb:
        inference = kb._inference
        assert inference is not None
        restored = inference._restore()
        ready = time.perf_counter() - start
        assert kb.seq >= acknowledged, (kb.seq, acknowledged)
        built = inference._build()
        stored = {(q.subject, q.predicate, q.object) for q in kb.match(graph=kb.graphs.inferred)}
        assert stored == set(built.inferred())
        if restored is not None:
            assert restored.digest() == built.digest()
            assert list(map(str, restored.contradictions())) == [
                str(clash) for clash in built.contradictions()
            ]
        saved = 0 if restored is None else int(folders[0].name.rpartition("-")[2])
        print(
            json.dumps({"ready": ready, "followed": kb.seq - saved, "used": restored is not None})
        )


def kill_once(folder: Path, rng: random.Random) -> int:
    """Return the last commit that a killed process acknowledged."""
    command = [sys.executable, __file__, "--folder", str(folder), "--do", "write"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        first = child.stdout.readline()
        time.sleep(rng.random() * 1.5)
        child.send_signal(signal.SIGKILL)
        rest = child.stdout.read()
    whole = [line for line in (first + rest).splitlines(keepends=True) if line.endswith("\n")]
    return int(whole[-1]) if whole else 0


def main() -> None:
    """Run the rounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--triples", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--do", choices=("prepare", "write", "check"), help=argparse.SUPPRESS)
    parser.add_argument("--acknowledged", type=int, default=0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.do == "prepare":
        prepare(options.folder, options.triples)
    elif options.do == "write":
        write(options.folder)
    elif options.do == "check":
        check(options.folder, options.acknowledged)
    if options.do:
        return
    rng = random.Random(options.seed)
    found = []
    torn = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "kb"
        base = [sys.executable, __file__, "--folder", str(folder), "--do"]
        command = [*base, "prepare", "--triples", str(options.triples)]
        subprocess.run(command, check=True)
        for _ in range(options.kills):
            acknowledged = kill_once(folder, rng)
            torn += bool(list(folder.glob("closure-*.tmp")))
            command = [*base, "check", "--acknowledged", str(acknowledged)]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            found.append(json.loads(done.stdout))
    used = sum(each["used"] for each in found)
    slowest = max(each["ready"] for each in found)
    print(
        f"{options.kills} kills, {torn} while a closure was being written, "
        f"{used} times a saved one was used, none torn; ready after at most {slowest:.2f} s"
    )


if __name__ == "__main__":
    main()
