"""Change a line of the code at random, and see whether a test notices.

``python -m tests.mutations --seed 1 -n 30`` draws thirty changes over all rooms, or of the files
named, and tries each in a copy of the checkout with the nearest tests, those of `make test` alone.
What none notices is printed with its line. Some changes do nothing (an order that does not matter,
a bound that is never met): read before you write a test.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
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
_TIMED_OUT = 124


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


def tests_of(path: Path) -> Iterator[list[Path]]:
    """Yield the tests to try for a module, the nearest first.

    Its own examples, and those in the folder that mirrors its own and import it; all of that
    folder; those elsewhere that import it.
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
    named = [p for p in tests if is_imported.search((ROOT / p).read_text(encoding="utf-8"))]
    stages = (
        [path, *(p for p in named if folder in p.parents)], [folder],
        [p for p in named if folder not in p.parents],
    )  # fmt: skip
    return (stage for stage in stages if stage)


def run(copy: Path, tests: Sequence[Path], timeout_s: float) -> int:
    """Return pytest's code for tests in a copy of the checkout, which end at the first failure."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:schemathesis", "-n", "2",
               "-m", "not deep and not browser", *map(str, tests)]  # fmt: skip
    environment = os.environ | {"CI": "true", "OMP_NUM_THREADS": "1"}
    try:
        return subprocess.run(
            command, cwd=copy, env=environment, timeout=timeout_s, check=False,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        ).returncode  # fmt: skip
    except subprocess.TimeoutExpired:
        return _TIMED_OUT


def is_noticed(
    copy: Path, mutation: Mutation, timeout_s: float, sound: dict[tuple[Path, ...], bool]
) -> bool | None:
    """Whether a test fails by a change; None if its tests fail without it as well.

    Parameters
    ----------
    sound
        Whether tests pass without any change, as far as they were tried; is added to.
    """
    target = copy / mutation.path
    original = target.read_text(encoding="utf-8")
    for tests in tests_of(mutation.path):
        target.write_text(mutation.text, encoding="utf-8")
        code = run(copy, tests, timeout_s)
        target.write_text(original, encoding="utf-8")
        if code not in (0, 5):  # 5: there were no tests
            key = tuple(tests)
            if key not in sound:
                sound[key] = run(copy, tests, timeout_s) == 0
            return True if sound[key] else None
    return False


def _files(named: Sequence[str]) -> list[Path]:
    tracked = subprocess.run(
        ["git", "ls-files", "--", *(named or ROOMS)], cwd=ROOT, check=True, capture_output=True,
        text=True,
    ).stdout.splitlines()  # fmt: skip
    return [Path(p) for p in tracked if p.endswith(".py") and "generated" not in p]


def main() -> None:
    """Draw, try and tell."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("files", nargs="*", help="Files or folders; without, all rooms.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-n", type=int, default=30, help="How many changes.")
    parser.add_argument("--timeout", type=float, default=900.0, help="Of a run of tests, s.")
    given = parser.parse_args()
    noticed = {True: 0, False: 0, None: 0}
    sound: dict[tuple[Path, ...], bool] = {}
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        copy = Path(folder) / "checkout"
        # With what git does not track, such as bundled pages, but without environment and history.
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".venv", ".git", "node_modules",
                                                                  "__pycache__"))  # fmt: skip
        for mutation in drawn(given.seed, given.n, _files(given.files)):
            state = is_noticed(copy, mutation, given.timeout, sound)
            noticed[state] += 1
            word = {True: "noticed", False: "NOT NOTICED", None: "tests fail without it"}[state]
            sys.stdout.write(f"{word:12} {mutation.path}:{mutation.line}  {mutation.words}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{noticed[True]} of {sum(noticed.values())} noticed\n")


if __name__ == "__main__":
    main()
