"""Ledger of the code that was served under each version, kept over restarts (Kehoe 2014, 5.4).

::

    FILE    {"lab/Reach@1.0.0": {"contract": "<digest>", "code": "<digest>"}}

A result names the version that it came from, so a version must stay what it was. Versions below
1.0.0 are for development and may change (Semantic Versioning 2.0.0, 4).
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
import os
import sys
import tokenize
from collections.abc import Iterable
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any

from rtask.errors import UsageError
from rtask.kb.durability.blobs import sync_folder
from rtask.services.definition import Definition
from rtask.services.outward.announced import contract_of

__all__ = ["Ledger"]

_MEANINGLESS = (tokenize.COMMENT, tokenize.NL)
_LAYOUT = {tokenize.NEWLINE: ";", tokenize.INDENT: "{", tokenize.DEDENT: "}"}
"""Ends of statements and of blocks, whatever spaces they are written with."""


class Ledger:
    """Digests by service and version.

    Parameters
    ----------
    file
        Where they are kept; None = nowhere, and nothing is checked.

    Raises
    ------
    UsageError
        The file cannot be read.
    """

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._digests: dict[str, dict[str, str]] = {}
        if file is not None and file.exists():
            try:
                stored = json.loads(file.read_text("utf-8"))
                self._digests = {exact: dict(digests) for exact, digests in stored.items()}
            except (OSError, ValueError, TypeError, AttributeError) as error:
                raise UsageError(
                    f"{file}, the list of versions that were served, cannot be read: {error}; "
                    "mend or remove it"
                ) from error

    def check(self, definitions: Iterable[Definition]) -> None:
        """Note what is served, and refuse a version that has changed since it was served before.

        Raises
        ------
        UsageError
            Requests, answers or code are no longer those of the version; nothing is noted.
        """
        if self._file is None:
            return
        noted = dict(self._digests)
        for served in definitions:
            if served.version.startswith("0."):
                continue
            digests = {"contract": _digest(contract_of(served)), "code": _digest(_code_of(served))}
            before = noted.setdefault(served.exact, digests)
            what = [name for name, digest in digests.items() if before.get(name) != digest]
            if what:
                changed = "requests or answers" if "contract" in what else "code"
                raise UsageError(
                    f"{served.exact} was served before with other {changed}; give this one a new "
                    "version (below 1.0.0 while it still changes), or remove its line from "
                    f"{self._file}"
                )
        if noted != self._digests:
            _write(self._file, noted)
            self._digests = noted


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _code_of(definition: Definition) -> str:
    """Return the code of a service's class and what its file defines beside other services.

    Comments and spaces count for nothing; code whose source is not there is empty.
    """
    module, _, name = definition.source.rpartition(":")
    code_module = _module_of(module)
    if code_module is None:
        return ""
    try:
        text = inspect.getsource(code_module)
    except (OSError, TypeError):
        return ""
    parts = []
    for node in ast.parse(text).body:
        is_other = (
            isinstance(node, ast.ClassDef) and node.name != name and _is_service(code_module, node)
        )
        if not is_other:
            named = (*getattr(node, "decorator_list", ()), node)
            parts += [_bare(ast.get_source_segment(text, named_node) or "") for named_node in named]
    return "\n".join(parts)


def _module_of(source: str) -> ModuleType | None:
    module = sys.modules.get(source)
    if module is not None:
        return module
    files = (
        candidate for candidate in list(sys.modules.values()) if isinstance(candidate, ModuleType)
    )
    return next(
        (candidate for candidate in files if vars(candidate).get("__rtask_file__") == source), None
    )


def _is_service(module: ModuleType, node: ast.ClassDef) -> bool:
    from rtask.services.service import Service

    value: Any = getattr(module, node.name, None)
    return isinstance(value, type) and issubclass(value, Service)


def _bare(text: str) -> str:
    tokens = tokenize.generate_tokens(StringIO(text).readline)
    return " ".join(
        _LAYOUT.get(token.type, token.string) for token in tokens if token.type not in _MEANINGLESS
    )


def _write(file: Path, ledger: dict[str, dict[str, str]]) -> None:
    draft = file.with_suffix(".tmp")
    with draft.open("w", encoding="utf-8") as out:
        json.dump(ledger, out, indent=1, sort_keys=True)
        out.flush()
        os.fsync(out.fileno())
    draft.replace(file)
    sync_folder(file.parent)
