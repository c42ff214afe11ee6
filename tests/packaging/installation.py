"""Install the wheel outside the checkout, with nothing else than the libraries it declares."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from dataclasses import dataclass
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.architecture.imports import PACKAGES, ROOT


@dataclass(frozen=True)
class Installation:
    """A virtual environment that holds the wheel and the libraries that it declares.

    Parameters
    ----------
    folder
        Of the environment.
    """

    folder: Path

    @property
    def environment(self) -> dict[str, str]:
        """Variables of a process that sees the environment only, not the checkout."""
        return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    @property
    def rtask(self) -> Path:
        """The command."""
        return self.folder / "bin" / "rtask"

    @property
    def packages(self) -> Path:
        """The folder of installed packages."""
        version = sysconfig.get_python_version()
        return self.folder / "lib" / f"python{version}" / "site-packages"

    def run(
        self, *command: str | Path, folder: Path, timeout_s: float = 120
    ) -> subprocess.CompletedProcess[str]:
        """Run a program of the environment in a folder."""
        return subprocess.run(
            [self.folder / "bin" / command[0], *command[1:]],
            cwd=folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )


def install(wheel: Path, folder: Path, *extras: str) -> Installation:
    """Install a wheel with extras into a new environment.

    The libraries are linked from the environment that runs the tests: those that the wheel's
    requirements reach and no other, so a library that is not declared is missing.
    """
    venv.create(folder, with_pip=False, symlinks=True)
    made = Installation(folder)
    # Compiled when it is imported: most modules of an installation are not, in these tests.
    options = ("--no-deps", "--no-compile", "--no-index")
    _pip("--python", folder / "bin" / "python", "install", *options, wheel)
    for name in _required(set(extras)):
        _link(name, made.packages)
    _copy_kernels(made.packages)
    return made


def _pip(*arguments: str | Path) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    subprocess.run(command, cwd=ROOT, check=True, timeout=120)


def _required(extras: set[str]) -> set[str]:
    """Return the distributions that an installation with some extras brings."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    waiting = [Requirement(text) for text in project["dependencies"]]
    waiting += [
        Requirement(text) for extra in extras for text in project["optional-dependencies"][extra]
    ]
    found: set[str] = set()
    seen: set[str] = set()
    while waiting:
        requirement = waiting.pop()
        if str(requirement) in seen:
            continue
        seen.add(str(requirement))
        if canonicalize_name(requirement.name) == "rtask-kg":
            nested = [project["optional-dependencies"][extra] for extra in requirement.extras]
            waiting += [Requirement(text) for texts in nested for text in texts]
            continue
        found.add(requirement.name)
        for text in importlib.metadata.requires(requirement.name) or []:
            further = Requirement(text)
            wanted = [{"extra": extra} for extra in ("", *requirement.extras)]
            if further.marker is None or any(further.marker.evaluate(env) for env in wanted):
                waiting.append(further)
    return found


def _link(name: str, packages: Path) -> None:
    """Link what belongs to a distribution into a folder of packages."""
    distribution = importlib.metadata.distribution(name)
    tops = {file.parts[0] for file in distribution.files or []} - {"..", "__pycache__"}
    for top in sorted(tops):
        if not (packages / top).exists():
            (packages / top).symlink_to(str(distribution.locate_file(top)))


def _copy_kernels(packages: Path) -> None:
    """Bring the numeric kernels that the checkout has compiled; they are known by content."""
    for package in PACKAGES:
        for compiled in (ROOT / package).rglob("__pycache__/*.nb[ci]"):
            target = packages / compiled.relative_to(ROOT)
            if not target.parents[1].is_dir():  # of a package that has moved since
                continue
            target.parent.mkdir(exist_ok=True)
            shutil.copy(compiled, target)
