"""Typed classes generated from ontologies that others publish can be imported and checked."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

import rtask
from rtask.cli import main
from rtask.model import Model

SHARED = Path(
    os.environ.get("RTASK_SHARED_DATA", Path(__file__).resolve().parents[4] / "shared" / "data")
)
FOLDER = SHARED / "ontologies"
ONTOLOGIES = (
    "w3c/sosa.ttl", "w3c/ssn.ttl", "w3c/time.ttl", "aur/ieee1872-2_aur.ttl", "brick/Brick.n3",
    "knowrob/srdl2-cap.owl", "knowrob/srdl2-comp.owl", "knowrob/URDF.owl", "soma/SOMA.owl",
    "soma/SOMA-ACT.owl", "rtask2020/rtask.owl",
)  # fmt: skip
pytestmark = [
    pytest.mark.deep,
    pytest.mark.skipif(
        not FOLDER.is_dir(), reason=f"{FOLDER} not found; set RTASK_SHARED_DATA to its parent"
    ),
]


def test_classes_of_public_ontologies_can_be_imported_and_are_typed(tmp_path: Path) -> None:
    for name in ONTOLOGIES:
        file = tmp_path / f"classes_{name.replace('/', '_').replace('-', '_').partition('.')[0]}.py"
        with pytest.raises(SystemExit) as ended:
            main(["model", "generate", str(FOLDER / name), "--out", str(file)])
        assert not ended.value.code, name
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        own = [
            value
            for value in vars(module).values()
            if isinstance(value, type) and issubclass(value, Model)
        ]
        assert len(own) > 5, name
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", *map(str, sorted(tmp_path.glob("*.py")))],
        capture_output=True,
        text=True,
        cwd=Path(rtask.__file__).parents[1],
        check=False,
    )
    assert checked.returncode == 0, checked.stdout
