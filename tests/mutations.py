"""Change a line of the code at random, and see whether a test notices.

``python -m tests.mutations --seed 1 -n 30 --journal FILE`` draws thirty changes over all rooms, or
of the files named, and tries each in a copy of the checkout with the nearest tests, those of `make
test` alone. Each result is printed and kept at once: called again, the command goes on after the
last. What no test notices is printed with its line. Some changes do nothing (an order that does not
matter, a bound that is never met): read before you write a test.

``--again tests/mutations.jsonl`` tries the changes of such a file with just the tests that noticed
them, some seconds each, and with all others where those pass.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("reasoner", "features", "grasp", "rtask", "endpoint", "simulate")
_COMPARISONS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_ARITHMETIC = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
# Of pytest: a process of tests costs as much as collecting all of them.
_MANY_FILES = 8
_NO_TESTS = 5
_TIMED_OUT = 124
_STATES = ("noticed", "NOT NOTICED", "tests fail without it")


@dataclass(frozen=True)
class Mutation:
    """One change of a module's text.

    Parameters
    ----------
    path
        Of the module, from the root.
    line
        Of the change, from 1.
    text
        The module with it.
    words
        What became what.
    """

    path: Path
    line: int
    text: str
    words: str


def mutations_of(path: Path, text: str) -> list[Mutation]:
    """Return every change that can be drawn in a module.

    Examples
    --------
    >>> [m.words for m in mutations_of(Path("m.py"), "def f(a):\\n    return a < 2 and not a\\n")]
    ['a < 2 and not a: or', 'a < 2: <=', '2: 3', 'not a: a']
    """
    source = text.encode()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def replaced(node: ast.expr, new: str, sign: str) -> Mutation:
        # The tree counts columns in bytes.
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
        old = " ".join(source[begin:end].decode().split())
        changed = source[:begin] + new.encode() + source[end:]
        return Mutation(path, node.lineno, changed.decode(), f"{old}: {sign}")

    return [
        replaced(node, new, sign) for node in _code(ast.parse(text)) for new, sign in _new(node)
    ]


def _code(tree: ast.Module) -> Iterator[ast.expr]:
    """Yield the expressions that run in functions: no annotations, decorators or defaults."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for statement in function.body:
                if isinstance(statement, ast.FunctionDef | ast.ClassDef | ast.Raise):
                    continue  # an inner function comes by itself; messages are not behaviour
                yield from _expressions(statement)


def _expressions(node: ast.AST) -> Iterator[ast.expr]:
    for inner in ast.iter_child_nodes(node):
        # Python 3.11 does not know where in the file the parts of an f-string are.
        if not isinstance(inner, ast.JoinedStr):
            if isinstance(inner, ast.expr):
                yield inner
            yield from _expressions(inner)


def _new(node: ast.expr) -> Iterator[tuple[str, str]]:
    """Yield the texts that may take the place of an expression, and what changed."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        operator = _COMPARISONS[type(node.ops[0])]
        left, right = ast.unparse(node.left), ast.unparse(node.comparators[0])
        yield f"({left} {operator} {right})", operator
    elif isinstance(node, ast.BoolOp):
        word = "or" if isinstance(node.op, ast.And) else "and"
        yield "(" + f" {word} ".join(f"({ast.unparse(v)})" for v in node.values) + ")", word
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        inner = ast.unparse(node.operand)
        yield f"({inner})", inner
    elif isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        sign = _ARITHMETIC[type(node.op)]
        yield f"({ast.unparse(node.left)} {sign} {ast.unparse(node.right)})", sign
    elif isinstance(node, ast.Constant) and isinstance(node.value, int):
        new = repr(not node.value if isinstance(node.value, bool) else node.value + 1)
        yield new, new


def drawn(seed: int, count: int, files: Sequence[Path]) -> list[Mutation]:
    """Return changes, at most one of a module unless there are more changes than modules."""
    draw = random.Random(seed)
    chosen: list[Mutation] = []
    files = list(files)
    while len(chosen) < count and files:
        draw.shuffle(files)
        for path in list(files):
            text = (ROOT / path).read_text(encoding="utf-8")
            rest = [m for m in mutations_of(path, text) if m not in chosen]
            if not rest:
                files.remove(path)
            elif len(chosen) < count:
                chosen.append(draw.choice(rest))
    return chosen


def tests_of(path: Path) -> Iterator[list[str]]:
    """Yield the tests to try for a module, the nearest first and none twice.

    Its own examples, and those in the folder that mirrors its own and import it; those beside
    them; those below; those elsewhere that import it.
    """
    module = ".".join(path.with_suffix("").parts)
    parent, _, name = module.rpartition(".")
    is_imported = re.compile(
        rf"{re.escape(module)}\b|from {re.escape(parent)} import [^\n]*\b{name}\b"
    )
    folder = Path("tests", path).parent
    while not any((ROOT / folder).rglob("test_*.py")):
        folder = folder.parent
    tests = [p.relative_to(ROOT) for p in sorted((ROOT / "tests").rglob("test_*.py"))]
    tests = [p for p in tests if p.parts[1] != "browser"]
    importing = [p for p in tests if is_imported.search((ROOT / p).read_text(encoding="utf-8"))]
    stages = (
        [path, *(p for p in importing if folder in p.parents)],
        [p for p in tests if p.parent == folder],
        [p for p in tests if folder in p.parents],
        importing,
    )
    tried: set[Path] = set()
    for stage in stages:
        rest = [p for p in stage if p not in tried]
        tried.update(rest)
        if rest:
            yield [str(p) for p in rest]


@dataclass(frozen=True)
class Run:
    """How tests ended: pytest's code, and the first test that failed, if one did."""

    code: int
    failed: str | None


def run(copy: Path, tests: Sequence[str], timeout_s: float) -> Run:
    """Run tests in a copy of the checkout until the first failure."""
    # A change may make a loop endless: the limit of one test ends it before that of the run.
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:schemathesis",
               "--timeout", "120", "-m", "not deep and not browser", *tests]  # fmt: skip
    if len(tests) > _MANY_FILES:
        command += ["-n", "2"]
    # Each run would compile all that it imports anew, half of its time.
    kept = {name: v for name, v in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment = kept | {"CI": "true", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment, timeout=timeout_s, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Run(_TIMED_OUT, None)
    failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return Run(done.returncode, failed[1] if failed else None)


@dataclass(frozen=True)
class Result:
    """What the tests said of a change.

    Parameters
    ----------
    state
        One of `_STATES`.
    test
        The first that failed.
    """

    mutation: Mutation
    state: str
    test: str | None
    cpu_s: float

    def record(self) -> dict[str, object]:
        """Return the row of a journal, which names the change by its text: lines move."""
        text = (ROOT / self.mutation.path).read_text(encoding="utf-8").splitlines()
        return {
            "path": str(self.mutation.path), "text": text[self.mutation.line - 1].strip(),
            "change": self.mutation.words, "state": self.state, "test": self.test,
        }  # fmt: skip


def tried(copy: Path, mutation: Mutation, timeout_s: float, first: str | None = None) -> Result:
    """Try a change with its tests.

    Parameters
    ----------
    first
        The test that noticed it before.
    """
    spent = _children_s()
    target = copy / mutation.path
    original = target.read_text(encoding="utf-8")
    state, test = _STATES[1], None
    for tests in ([first], *tests_of(mutation.path)) if first else tests_of(mutation.path):
        target.write_text(mutation.text, encoding="utf-8")
        changed = run(copy, tests, timeout_s)
        target.write_text(original, encoding="utf-8")
        if changed.code not in (0, _NO_TESTS):
            test = changed.failed
            # Tests that hang on a busy machine, or on what is installed, have noticed nothing.
            sound = run(copy, [test] if test else tests, timeout_s).code == 0
            state = _STATES[0 if sound else 2]
            break
    return Result(mutation, state, test, _children_s() - spent)


def _children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _files(named: Sequence[str]) -> list[Path]:
    tracked = subprocess.run(
        ["git", "ls-files", "--", *(named or ROOMS)], cwd=ROOT, check=True, capture_output=True,
        text=True,
    ).stdout.splitlines()  # fmt: skip
    return [Path(p) for p in tracked if p.endswith(".py") and "generated" not in p]


def _rows(file: Path | None) -> list[dict[str, str]]:
    if file is None or not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def _of_row(row: dict[str, str]) -> Mutation | None:
    """Return the change that a row names, or None if the code is no longer so."""
    path = ROOT / row["path"]
    if not path.exists():
        return None
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    return next(
        (
            m
            for m in mutations_of(Path(row["path"]), text)
            if m.words == row["change"] and lines[m.line - 1].strip() == row["text"]
        ),
        None,
    )


def _say(state: str, mutation: Mutation, more: str) -> None:
    sys.stdout.write(f"{state:12} {mutation.path}:{mutation.line}  {mutation.words}  {more}\n")
    sys.stdout.flush()


def main() -> None:
    """Draw, or read what was drawn, try and tell."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("files", nargs="*", help="Files or folders; without, all rooms.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-n", type=int, default=30, help="How many changes.")
    parser.add_argument("--timeout", type=float, default=900.0, help="Of a run of tests, s.")
    parser.add_argument("--journal", type=Path, help="Keep results in this file, and go on there.")
    parser.add_argument("--again", type=Path, help="Try the changes of this journal anew.")
    given = parser.parse_args()
    former = {
        mutation: row for row in _rows(given.again or given.journal) if (mutation := _of_row(row))
    }
    if given.again:
        mutations = list(former)
        gone = len(_rows(given.again)) - len(former)
        sys.stdout.write(f"{gone} are changes of code that is no longer so\n" if gone else "")
    else:
        # What was tried counts, though another draw may follow from files that came or went since.
        drawn_now = drawn(given.seed, given.n, _files(given.files))
        mutations = list(dict.fromkeys([*former, *drawn_now]))[: max(given.n, len(former))]
    states = []
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        copy = Path(folder) / "checkout"
        # With what git does not track, such as bundled pages, but without environment and history.
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".venv", ".git", "node_modules"))
        for mutation in mutations:
            row = former.get(mutation)
            if row and not given.again:
                states.append(row["state"])
                _say(row["state"], mutation, f"{row['test'] or ''} (before)")
                continue
            result = tried(copy, mutation, given.timeout, row["test"] if row else None)
            states.append(result.state)
            _say(result.state, mutation, f"{result.test or ''} {result.cpu_s:.0f} s CPU")
            if given.journal:
                with given.journal.open("a", encoding="utf-8") as journal:
                    journal.write(json.dumps(result.record()) + "\n")
    sys.stdout.write(f"{states.count(_STATES[0])} of {len(states)} noticed\n")


if __name__ == "__main__":
    main()
