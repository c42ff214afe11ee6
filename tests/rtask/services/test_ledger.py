"""A version that was served stays what it was over restarts, unless it is still in development."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

import rtask
from rtask.engine.engine import Engine
from rtask.errors import UsageError
from rtask.services.offered import open_host

CODE = '''
from rtask.services import Service, method

FACTOR = {factor}


class Scale(Service):
    """Numbers made larger."""

    name = "lab/Scale"
    version = "{version}"

    @method
    def scale(self, number: float{more}) -> float:
        """Multiply."""
        if number < 0:
            number = -number
        {step}number += 1
        return FACTOR * number{comment}


class Other(Service):
    """Another one in the same file."""

    name = "lab/Other"
    version = "{other}"

    @method
    def go(self) -> float:
        """Go."""
        return {value}
'''
FIRST = {
    "factor": "2", "version": "1.0.0", "more": "", "comment": "", "step": "", "other": "0.1.0",
    "value": "1.0",
}  # fmt: skip
_numbers = itertools.count()


def serve(tmp_path: Path, **changes: str) -> None:
    """Start a host as a server does, with a file as an author has changed it."""
    # A restarted server reads the file again; in one process that takes another name.
    file = tmp_path / f"scale{next(_numbers)}.py"
    file.write_text(CODE.format(**{**FIRST, **changes}))
    with rtask.open(tmp_path / "kb") as kb, Engine(kb) as engine, open_host(engine, [str(file)]):
        pass


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"factor": "3"}, r"lab/Scale@1\.0\.0 was served before with other code; .*new version"),
        ({"step": "    "}, "with other code"),  # a line moves into the block before it
        ({"more": ", offset: float = 0.0"}, "with other requests or answers"),
    ],
)
def test_a_version_that_has_changed_is_refused_until_it_has_a_new_one(tmp_path, changes, words):
    serve(tmp_path)
    with pytest.raises(UsageError, match=words):
        serve(tmp_path, **changes)
    serve(tmp_path, version="1.0.1", **changes)
    serve(tmp_path, version="1.0.1", **changes)


def test_comments_and_other_services_of_the_file_may_change(tmp_path):
    serve(tmp_path)
    serve(tmp_path, comment="  # twice", value="2.0")


def test_a_version_in_development_may_change(tmp_path):
    serve(tmp_path, version="0.9.0")
    serve(tmp_path, version="0.9.0", factor="5")


def test_a_refused_start_notes_nothing(tmp_path):
    serve(tmp_path)
    before = (tmp_path / "kb" / "services.json").read_text()
    with pytest.raises(UsageError):
        serve(tmp_path, factor="3", other="2.0.0")
    assert (tmp_path / "kb" / "services.json").read_text() == before


@pytest.mark.parametrize("text", ["{", "null", '{"lab/Scale@1.0.0": 1}'])
def test_a_list_of_versions_that_cannot_be_read_is_named(tmp_path, text):
    serve(tmp_path)
    (tmp_path / "kb" / "services.json").write_text(text)
    with pytest.raises(UsageError, match=r"services\.json.*cannot be read"):
        serve(tmp_path)
