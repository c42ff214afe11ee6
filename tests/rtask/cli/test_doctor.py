"""Kernels are compiled before they are needed: those of a first grasp at once, others aside."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

import features
import grasp
from rtask.cli import doctor, main


def _code(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(["doctor", "--quiet", *arguments])
    return int(caught.value.code or 0)


def test_compiling_in_the_background_leaves_the_rest_to_another_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compiled: list[str] = []
    started: list[list[str]] = []

    class Started:
        pid = 1

        def __init__(self, command: list[str], **options: object) -> None:
            assert options["start_new_session"]
            started.append(command)

    monkeypatch.setattr(doctor, "examine", lambda data, port: iter(()))
    monkeypatch.setattr(doctor.subprocess, "Popen", Started)
    monkeypatch.setattr(doctor, "warm_up", lambda modules=("all",): compiled.extend(modules))
    assert _code("--warm-up") == 0
    assert (compiled, started) == (["all"], [])
    compiled.clear()
    assert _code("--warm-up", "--background") == 0
    assert "features.recognition" in compiled
    assert "grasp.push" not in compiled
    assert "grasp.push" in started[0][-1]
    compile(started[0][-1], "call", "exec")


def test_the_background_is_only_for_compiling() -> None:
    assert _code("--background") == 2


def test_every_module_that_can_compile_ahead_is_named() -> None:
    named = [
        importlib.import_module(name) for name in (*doctor._FIRST_KERNELS, *doctor._LATER_KERNELS)
    ]
    reached = {
        Path(module.warm_up.__code__.co_filename) for module in named if hasattr(module, "warm_up")
    }
    defined = {
        path
        for package in (features, grasp)
        for path in Path(package.__path__[0]).rglob("*.py")
        if any(
            isinstance(node, ast.FunctionDef) and node.name == "warm_up"
            for node in ast.parse(path.read_text("utf-8")).body
        )
    }
    assert reached == defined
