"""Files that nobody can read in a review: only those that are known, and none of other people's."""

from __future__ import annotations

import subprocess
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Each kind with where it may lie, and what makes it.
KNOWN = {
    "docs/images/*.png": "pictures of pages, by the commands that docs name",
    "docs/images/theses/*.png": "figures of the theses' studies, by `rtask thesis all --markdown`",
    "docs/images/*.webp": "films of README, by commands that docs name",
    "grasp/spatial/hand_search/models/*.npz": "filters of pairs, fitted on generated objects",
    "tests/rtask/kb/durability/first_folders.tar.xz": "folders that the first version wrote",
    "simulate/demo/recorded.tar.xz": "the recorded demo, by `rtask demo --record`",
}
MAX_BYTES = 4 << 20


def _committed() -> list[str]:
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if done.returncode:
        pytest.skip("this is no checkout of git")
    return [name for name in done.stdout.decode().split("\0") if name]


def test_every_binary_file_is_known_and_small() -> None:
    unknown, large = [], []
    for name in _committed():
        path = ROOT / name
        if not path.is_file() or b"\0" not in path.read_bytes():
            continue
        if not any(PurePosixPath(name).match(pattern) for pattern in KNOWN):
            unknown.append(name)
        if path.stat().st_size > MAX_BYTES:
            large.append(name)
    assert unknown == [], "say in KNOWN what makes it, or take it out"
    assert large == []


def test_every_known_kind_exists() -> None:
    names = [PurePosixPath(name) for name in _committed()]
    assert [p for p in KNOWN if not any(name.match(p) for name in names)] == []
