"""``import rtask`` notices a file of the user's that hides one of its packages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rtask.shadowing import PACKAGES
from tests.architecture.imports import PACKAGES as ALL_PACKAGES
from tests.architecture.imports import ROOT


def _import_rtask(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, with the checkout on the path as an installation would be."""
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("name", ["grasp.py", "ontology/__init__.py"])
def test_a_file_that_hides_a_package_is_named(tmp_path: Path, name: str) -> None:
    culprit = tmp_path / name
    culprit.parent.mkdir(exist_ok=True)
    culprit.write_text("mine = True\n")
    done = _import_rtask(tmp_path, "import rtask")
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("ImportError: ")]
    assert f"{culprit} hides RTASK's own package {name.partition('.')[0].split('/')[0]!r}" in line
    assert "rename" in line


def test_a_hiding_module_that_is_imported_already_is_named(tmp_path: Path) -> None:
    (tmp_path / "features.py").write_text("mine = True\n")
    done = _import_rtask(tmp_path, "import features, rtask")
    assert f"ImportError: {tmp_path / 'features.py'} hides" in done.stderr


def test_files_of_other_names_and_folders_without_code_do_not_matter(tmp_path: Path) -> None:
    (tmp_path / "grasps.py").write_text("mine = True\n")
    (tmp_path / "ontology").mkdir()
    (tmp_path / "ontology" / "mine.ttl").write_text("")
    done = _import_rtask(tmp_path, "import rtask; print('imported')")
    assert done.stdout == "imported\n", done.stderr


def test_the_check_imports_none_of_the_packages(tmp_path: Path) -> None:
    program = f"import sys, rtask; print([name for name in {PACKAGES} if name in sys.modules])"
    assert _import_rtask(tmp_path, program).stdout == "[]\n"


def test_every_package_is_checked() -> None:
    assert {*PACKAGES, "rtask"} == set(ALL_PACKAGES)
