"""Goals for whole arms in physics, by sentence: how many are reached, and which are given up.

    python tests/benchmarks/tasks/bench_crew.py FIRST LAST [--out FILE]

carries out the goals of :data:`GOALS` from number FIRST to LAST, each by ``rtask simulate crew`` on
an empty graph. The list was fixed before anything was tried on it; :func:`compare` of two files of
results says what each alone reached.

    python tests/benchmarks/tasks/bench_crew.py --compare BEFORE AFTER
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from simulate.study.intervals import wilson

_SORTING = (
    "every box into the right box",
    "every can into the left box",
    "every bottle into the right box",
    "every box into the left box",
    "every can into the right box; every bottle into the left box",
    "every box into the left box; every can into the right box",
)
_PANDA = ("every box into the left box", "everything into the right box")
_NAO = (
    "something into the left box; something into the right box",
    "something into the right box",
)
GOALS = (
    *(("sorting", 3, 5101 + k, _SORTING[k % len(_SORTING)]) for k in range(12)),
    *(("panda", 3, 5113 + k, _PANDA[k % len(_PANDA)]) for k in range(4)),
    *(("nao", 2, 5117 + k, _NAO[k % len(_NAO)]) for k in range(4)),
)
"""Table, things on it, seed and sentence of each goal."""
_CALL = "import sys; from rtask.cli import main; main(sys.argv[1:])"
_LIMIT_S = 3000.0
"""After which a run that does not end is stopped."""


def main() -> None:
    """Carry out some goals, or compare two files of results."""
    parser = argparse.ArgumentParser()
    parser.add_argument("range", nargs="*", type=int, help="first and last number, from 0")
    parser.add_argument("--out", type=Path, help="file to which results are added")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("BEFORE", "AFTER"))
    given = parser.parse_args()
    if given.compare:
        compare(*given.compare)
        return
    first, last = given.range or (0, len(GOALS) - 1)
    for number in range(first, last + 1):
        result = carry_out(number)
        print({**result, "turns": len(result["turns"])}, flush=True)
        if given.out:
            with given.out.open("a") as file:
                file.write(json.dumps(result) + "\n")


def carry_out(number: int) -> dict[str, Any]:
    """Return what came of one goal, with the processor time that it took, s."""
    table, things, seed, goal = GOALS[number]
    with tempfile.TemporaryDirectory() as folder:
        words = ["simulate", "crew", goal, "-d", folder + "/kb", "--table", table, "--json"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = subprocess.run(
            [sys.executable, "-c", _CALL, *words, "--things", str(things), "--seed", str(seed)],
            capture_output=True, text=True, timeout=_LIMIT_S, check=False,
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    about = {"number": number, "table": table, "seed": seed, "goal": goal, "code": run.returncode}
    took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if not run.stdout.strip():
        refused = run.stderr.strip().splitlines()[-1:]
        return {**about, "result": "refused", "comment": refused, "cpu_s": took, "turns": [],
                "is_true": True, "repairs": 0}  # fmt: skip
    printed = json.loads(run.stdout.splitlines()[-1])
    [ended] = printed["goals"]
    wrong = [t for t in printed["things"] if t["remembered"] and t["remembered"] != t["truly"]]
    return {**about, "result": ended["result"], "comment": ended["comment"], "cpu_s": took,
            "turns": printed["turns"], "is_true": not wrong, "repairs": ended["repairs"],
            "things": printed["things"]}  # fmt: skip


def compare(before: Path, after: Path) -> None:
    """Print what was reached before and after, and the goals in which these differ."""
    results = [
        {r["number"]: r for r in map(json.loads, file.read_text().splitlines())}
        for file in (before, after)
    ]
    both = sorted(set(results[0]) & set(results[1]))
    for name, of in zip(("before", "after"), results, strict=True):
        able = [of[n] for n in both if of[n]["result"] != "refused"]
        reached = sum(r["result"] == "reached" for r in able)
        low, high = wilson(reached, len(able))
        print(
            f"{name}: {reached} of {len(able)} ({low:.2f} to {high:.2f}), steps "
            f"{sum(len(r['turns']) for r in able)}, {sum(r['cpu_s'] for r in able):.0f} s of CPU, "
            f"elsewhere than remembered {sum(not r['is_true'] for r in able)}"
        )
    for n in both:
        ends = [of[n]["result"] for of in results]
        if ends[0] != ends[1]:
            print(f"  {GOALS[n]}: {ends[0]} -> {ends[1]}")


if __name__ == "__main__":
    main()
