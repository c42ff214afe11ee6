"""A folder holds files of one concern, and few enough of them to be read as a list."""

from __future__ import annotations

from collections import Counter

from tests.architecture.imports import ROOT, source_files

MAX_FILES = 18

# Folders that are larger, each with its reason; the number may only fall.
LARGER: dict[str, int] = {}


def _sizes() -> Counter[str]:
    """Count each folder's modules, its ``__init__`` left out."""
    return Counter(
        str(path.parent.relative_to(ROOT))
        for path in source_files().values()
        if path.name != "__init__.py"
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
