"""How many sentences of people are understood as goals, and how many are taken for another goal.

    python -m tests.benchmarks.tasks.bench_goals [LIST ...] [--all]

reads the lists of ``tests/benchmarks/tasks/goals``: a sentence a line, and behind a tab where its
writer wants each thing in the end (:func:`tests.benchmarks.tasks.goals_lab.differences`), or ``X``
where it is to be refused. Each is planned in a made-up lab of twelve things. Where a refused
sentence is answered with a proposal, that is judged instead. ``--all`` prints the right ones, too.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase
from tests.benchmarks.tasks.goals_lab import differences, open_lab

GOALS = Path(__file__).with_name("goals")
_FIRST_WIDE = 14
RESULTS = (
    "right", "refused", "taken for another goal", "rightly refused", "right proposal",
    "wrong proposal",
)  # fmt: skip


def main() -> None:
    """Print what is not understood of each list, and a line of figures for it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lists", nargs="*", type=Path, help="files; by default all of goals/")
    parser.add_argument("--all", action="store_true", help="print what is right as well")
    given = parser.parse_args()
    with open_lab() as lab, open_lab(is_wide=True) as wide:
        for path in given.lists or sorted(GOALS.glob("*.txt")):
            tally: Counter[str] = Counter()
            for sentence, expected in sentences(path):
                result, why = judged(wide if is_wide(path) else lab, sentence, expected)
                tally[result] += 1
                if given.all or result in (*RESULTS[1:3], RESULTS[5]):
                    print(f"{result} | {sentence} | {expected} | {why[:300]}", flush=True)
            print(f"{path.stem}: {', '.join(f'{tally[key]} {key}' for key in RESULTS)}", flush=True)


def sentences(path: Path) -> list[tuple[str, str]]:
    """Return the sentences of a list, each with what its writer wants."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = [line.split("\t") for line in lines if line.strip() and not line.startswith("#")]
    return [(sentence, expected) for sentence, expected in rows]


def is_wide(path: Path) -> bool:
    """Return whether a list is about the lab with bowls and owners: those from the 14th on."""
    return int(path.stem.rpartition("-")[2]) >= _FIRST_WIDE


def judged(lab: KnowledgeBase, sentence: str, expected: str) -> tuple[str, str]:
    """Return which of :data:`RESULTS` comes of a sentence, and why."""
    try:
        plan = lab.tasks.plan(sentence)
    except RtaskError as error:
        proposals = error.details.get("proposals", [])
        if proposals:
            result, why = judged(lab, proposals[0]["sentence"], expected)
            return f"{'right' if result == 'right' else 'wrong'} proposal", f"{why}: {error}"
        return ("rightly refused" if expected == "X" else "refused"), str(error)
    understood = "; ".join(plan.understood)
    if not plan.is_complete:
        return ("rightly refused" if expected == "X" else "refused"), f"no plan: {plan.text}"
    if expected == "X":
        return "taken for another goal", understood
    wrong = differences(expected, plan)
    return ("taken for another goal" if wrong else "right"), "; ".join([*wrong, understood])


if __name__ == "__main__":
    main()
