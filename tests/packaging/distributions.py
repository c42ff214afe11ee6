"""Sdist and wheel: built as a release is, the wheel from the sdist, and checked.

``make dist`` builds both into ``dist`` and prints what is wrong with them.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
import zipfile
from dataclasses import dataclass
from email.message import Message
from email.parser import BytesParser
from pathlib import Path

from packaging.metadata import Metadata
from packaging.utils import parse_sdist_filename, parse_wheel_filename

from tests.architecture.imports import PACKAGES, ROOT

__all__ = ["Distributions", "build_distributions", "faults"]

_VENDOR = "endpoint/pages/static/vendor"
_OF_OTHERS = (".whl", ".egg", ".deb", ".jar", ".exe", ".so", ".dll", ".dylib")


@dataclass(frozen=True)
class Distributions:
    """The two files of a release."""

    sdist: Path
    wheel: Path


def build_distributions(folder: Path) -> Distributions:
    """Build the sdist of the checkout, and the wheel from that sdist alone."""
    _run(ROOT, "hatchling", "build", "--target", "sdist", "--directory", folder)
    sdist = max(folder.glob("*.tar.gz"), key=lambda path: path.stat().st_mtime_ns)
    with tempfile.TemporaryDirectory() as unpacked:
        with tarfile.open(sdist) as archive:
            archive.extractall(unpacked, filter="data")
        (source,) = Path(unpacked).iterdir()
        _run(source, "hatchling", "build", "--target", "wheel", "--directory", folder)
    wheel = max(folder.glob("*.whl"), key=lambda path: path.stat().st_mtime_ns)
    return Distributions(sdist, wheel)


def _run(folder: Path, module: str, *arguments: str | Path) -> None:
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(
        command, cwd=folder, check=False, timeout=120, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def faults(built: Distributions) -> list[str]:
    """Return what is wrong with a release, one line each: missing files, metadata, names."""
    with tarfile.open(built.sdist) as archive:
        files = [member for member in archive.getmembers() if member.isfile()]
        packed = {member.name.partition("/")[2] for member in files}
        about = archive.extractfile(f"{files[0].name.partition('/')[0]}/PKG-INFO")
        assert about is not None
        sdist_metadata = about.read()
    with zipfile.ZipFile(built.wheel) as archive:
        names = set(archive.namelist())
        (info,) = {name.partition("/")[0] for name in names if ".dist-info/" in name}
        wheel_metadata = archive.read(f"{info}/METADATA")
        entry_points = archive.read(f"{info}/entry_points.txt").decode()
    installed = {name for name in names if not name.startswith(info)}
    # Built by `make pages` where npm is installed; a release carries them, git does not.
    bundled = {str(path.relative_to(ROOT)) for path in (ROOT / _VENDOR).glob("*.js")}
    whole = _tracked(*PACKAGES) | bundled
    project = _tracked("README.md", "LICENSE", "NOTICE", "CHANGELOG.md", "pyproject.toml", "tests")
    found = [f"the sdist lacks {name}" for name in sorted((whole | project) - packed)]
    # What `pip download` leaves in a checkout belongs to others, and would be released as ours.
    found += [f"the sdist holds {name}" for name in sorted(packed) if name.endswith(_OF_OTHERS)]
    found += [f"the wheel lacks {name}" for name in sorted(whole - installed)]
    found += [f"the wheel holds {name}" for name in sorted(installed - whole)]
    found += [f"the wheel lacks {name}" for name in ("LICENSE", "NOTICE")
              if f"{info}/licenses/{name}" not in names]  # fmt: skip
    if "rtask = rtask.cli:main" not in entry_points:
        found.append("the wheel does not install the command rtask")
    return [*found, *_metadata_faults(built, sdist_metadata, wheel_metadata)]


def _tracked(*paths: str) -> set[str]:
    """Return the files of the checkout that git knows and that are there."""
    command = ["git", "ls-files", *paths]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return {name for name in listed.splitlines() if (ROOT / name).exists()}


def _metadata_faults(built: Distributions, of_sdist: bytes, of_wheel: bytes) -> list[str]:
    """Return what an index would refuse: core metadata, description, names of the files."""
    found = []
    for kind, text in (("sdist", of_sdist), ("wheel", of_wheel)):
        try:
            Metadata.from_email(text, validate=True)
        except ExceptionGroup as errors:
            found += [f"metadata of the {kind}: {error}" for error in errors.exceptions]
    raw: Message = BytesParser().parsebytes(of_wheel)
    is_markdown = str(raw["Description-Content-Type"]).startswith("text/markdown")
    if not is_markdown or not str(raw.get_payload()).strip():
        found.append("the description is empty, or not in Markdown")
    of_files = parse_sdist_filename(built.sdist.name)[1], parse_wheel_filename(built.wheel.name)[1]
    if {str(version) for version in of_files} != {str(raw["Version"])}:
        found.append(f"{built.sdist.name} and {built.wheel.name} differ from the metadata")
    return found


def _main(folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    built = build_distributions(folder)
    wrong = faults(built)
    sys.stderr.writelines(f"{line}\n" for line in wrong)
    if not wrong:
        sys.stdout.write(f"{built.sdist.name}\n{built.wheel.name}\nboth are complete\n")
    return 3 if wrong else 0


if __name__ == "__main__":
    sys.exit(_main(Path(sys.argv[1]).absolute()))
