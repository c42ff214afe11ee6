"""What docstrings say of parameters, held against the parameters that there are."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.architecture.imports import source_files

_SECTION = re.compile(r"Parameters\n-+\n(.*?)(?:\n\n[A-Z][A-Za-z ]+\n-+\n|\Z)", re.DOTALL)
_NAMES = re.compile(r"\*{0,2}[A-Za-z_]\w*(?:, \*{0,2}[A-Za-z_]\w*)*(?= :|$)")

Documented = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def _described(docstring: str) -> set[str]:
    """Return the names under ``Parameters`` in a docstring of numpydoc."""
    section = _SECTION.search(docstring)
    if section is None:
        return set()
    heads = [_NAMES.match(line) for line in section[1].splitlines()]
    return {name.strip(" *") for head in heads if head for name in head[0].split(",")}


def _parameters(node: Documented) -> set[str] | None:
    """Return the parameters of a function, or the fields of a class; None where bases have them."""
    if isinstance(node, ast.ClassDef):
        made = [part for part in node.body if isinstance(part, ast.FunctionDef)]
        made = [part for part in made if part.name == "__init__"]
        if node.bases and not made:
            return None
        fields = [part.target for part in node.body if isinstance(part, ast.AnnAssign)]
        names = {target.id for target in fields if isinstance(target, ast.Name)}
        return names.union(*(_parameters(part) or () for part in made))
    given = node.args
    several = [more for more in (given.vararg, given.kwarg) if more is not None]
    return {arg.arg for arg in (*given.posonlyargs, *given.args, *given.kwonlyargs, *several)}


def _misnamed(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, Documented):
            there = _parameters(node)
            if there is not None:
                for name in sorted(_described(ast.get_docstring(node) or "") - there):
                    yield f"{node.lineno} {node.name}: {name}"


def test_a_parameter_that_is_described_exists() -> None:
    wrong = [
        f"{module}, line {each}"
        for module, file in source_files().items()
        for each in _misnamed(ast.parse(file.read_text("utf-8")))
    ]
    assert not wrong


def test_a_former_name_is_noticed() -> None:
    text = 'def f(a, *rest):\n    """Do.\n\n    Parameters\n    ----------\n    a, was\n'
    text += "        Both.\n    *rest : int\n        More.\n\n    Returns\n    -------\n"
    tree = ast.parse(text + '    int\n        Nothing.\n    """\n')
    assert list(_misnamed(tree)) == ["1 f: was"]
