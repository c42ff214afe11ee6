"""The packages' files and what each imports of the others, read from their source."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("ontology", "reasoner", "features", "grasp", "rtask", "simulate", "endpoint")

Graph = Mapping[str, frozenset[str]]


@cache
def source_files() -> dict[str, Path]:
    """Return the file of each module of the packages, generated code left out."""
    files = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            if "generated" not in parts:
                files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


@cache
def imports_of(module: str) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """Return the import statements of a module of the packages.

    Only these are kept: the syntax trees of all modules hold millions of objects, which would slow
    down every garbage collection of the test run.
    """
    return tuple(import_statements(ast.parse(source_files()[module].read_text(encoding="utf-8"))))


def import_statements(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Yield every import statement of a file, wherever it stands; expressions are skipped."""
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        for child in getattr(node, field, ()):
            if isinstance(child, ast.Import | ast.ImportFrom):
                yield child
            else:
                yield from import_statements(child)


def imported_modules(
    statements: Iterable[ast.Import | ast.ImportFrom],
    module: str,
    is_package: bool,
    known: Collection[str],
) -> Iterator[str]:
    """Yield each known module that a file's import statements name.

    ``from a import b`` means the module ``a.b`` where there is one, and ``a`` otherwise;
    ``import a.b`` means ``a.b``. Importing ``a.b`` runs the ``__init__`` of ``a`` as well, which
    is not counted: otherwise no ``__init__`` could offer what its own folder defines.
    """
    for node in statements:
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name in known:
                    yield alias.name
        else:
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                parts = parts[: len(parts) - node.level + is_package]
                base = ".".join([*parts, node.module] if node.module else parts)
            for alias in node.names:
                submodule = f"{base}.{alias.name}"
                if submodule in known:
                    yield submodule
                elif base in known:
                    yield base


@cache
def import_graph() -> Graph:
    """Return what each module of the packages imports of them."""
    files = source_files()
    return {
        module: frozenset(
            imported_modules(imports_of(module), module, path.name == "__init__.py", files)
        )
        - {module}
        for module, path in files.items()
    }
