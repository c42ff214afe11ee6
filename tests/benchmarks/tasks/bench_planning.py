"""Search for plans: processor time and cost, beside another planner if one is given.

    python tests/benchmarks/tasks/bench_planning.py
    python tests/benchmarks/tasks/bench_planning.py --planner "python fast-downward.py \
        --plan-file {plan} --alias lama-first {domain} {problem}"

The lab has robots in a row, of which neighbours share a place; each thing is to be brought one
robot's reach further, so that a third of them change hands. The other planner gets the same problem
as PDDL and runs as a process; its plan is read back, each step checked, and its cost compared.
"""

from __future__ import annotations

import argparse
import contextlib
import resource
import shlex
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from rtask.tasks.planning.pddl import PddlProblem, write_pddl
from rtask.tasks.planning.problem import Problem, Step
from rtask.tasks.planning.search import find_plan
from tests.rtask.tasks.lab import lab

SIZES = ((10, 2), (50, 4), (500, 10))
TARGETS_S = {(50, 4): 1.0, (500, 10): 10.0}
COST_RATIOS = {(50, 4): 1.2, (500, 10): 1.5}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--planner", help="command with {domain}, {problem} and {plan}")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds for it")
    given = parser.parse_args()
    print("things x robots | steps | cost, s | CPU, s | target | other: steps | cost | CPU | ratio")
    for size in SIZES:
        problem = lab(*size)
        began = time.process_time()
        plan = find_plan(problem)
        took_s = time.process_time() - began
        assert plan is not None
        row = [
            f"{size[0]} x {size[1]}", f"{len(plan.steps)}", f"{plan.cost_s:.0f}", f"{took_s:.2f}",
            f"{TARGETS_S.get(size, '-')}",
        ]  # fmt: skip
        if given.planner:
            row += other(given.planner, given.limit, problem, size, plan.cost_s)
        print(" | ".join(row), flush=True)


def other(
    command: str, limit_s: float, problem: Problem, size: tuple[int, int], cost_s: float
) -> list[str]:
    """Return the columns of the other planner."""
    pddl = write_pddl(problem)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    steps = run(command, limit_s, pddl)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    took_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if steps is None:
        return ["none in time", "-", f"{took_s:.2f}", "-"]
    cost = sum(step.cost_s(problem.failure_cost_s) for step in steps)
    target = COST_RATIOS.get(size)
    ratio = f"{cost_s / cost:.3f}" + (f" (at most {target})" if target else "")
    return [f"{len(steps)}", f"{cost:.0f}", f"{took_s:.2f}", ratio]


def run(command: str, limit_s: float, pddl: PddlProblem) -> Sequence[Step] | None:
    """Return the steps of another planner's plan, or None if it wrote none in time."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {part: folder / f"{part}.pddl" for part in ("domain", "problem")}
        files["domain"].write_text(pddl.domain, encoding="utf-8")
        files["problem"].write_text(pddl.problem, encoding="utf-8")
        plan = folder / "plan"
        words = [word.format(plan=plan, **files) for word in shlex.split(command)]
        with contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(words, cwd=folder, capture_output=True, timeout=limit_s, check=False)
        written = sorted(folder.glob("plan*"))  # an anytime planner numbers its plans
        return pddl.read_plan(written[-1].read_text("utf-8")) if written else None


if __name__ == "__main__":
    main()
