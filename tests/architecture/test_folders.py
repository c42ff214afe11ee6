"""A folder holds files of one concern, and few enough of them to be read as a list."""

from __future__ import annotations

from collections import Counter

from tests.architecture.imports import ROOT, source_files

MAX_FILES = 18

# Folders that are larger, each with its reason; the number may only fall.
LARGER: dict[str, int] = {
    "tests/browser": 21,  # one file a page, and every one of them shares its few helpers
    "tests/clients": 31,  # one server as its callers see it, whatever they call; a contract by hand
    "tests/reasoner": 20,  # one closure, asked in many ways, beside a naive one
    "tests/rtask/services": 19,
}


def _sizes() -> Counter[str]:
    """Count the modules of each folder, ``__init__`` and ``conftest`` left out."""
    return Counter(
        str(path.parent.relative_to(ROOT))
        for path in [*source_files().values(), *(ROOT / "tests").rglob("*.py")]
        if path.name not in ("__init__.py", "conftest.py")
    )


def test_no_folder_holds_more_files_than_can_be_taken_in() -> None:
    too_large = {
        folder: count for folder, count in _sizes().items() if count > LARGER.get(folder, MAX_FILES)
    }
    assert not too_large


def test_no_larger_folder_is_allowed_more_files_than_it_has() -> None:
    sizes = _sizes()
    loose = {
        folder: sizes[folder]
        for folder, allowed in LARGER.items()
        if sizes[folder] < allowed or sizes[folder] <= MAX_FILES
    }
    assert not loose, "write the smaller number down, or take the folder off the list"
