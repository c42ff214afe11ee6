"""The DDS of the wheel beside the library of an RMW, and a library that ends its process."""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rtask.cli.ros2 import wheel
from rtask.errors import UsageError
from rtask.interop.ros.dds import library

cyclonedds = pytest.importorskip("cyclonedds")


@pytest.mark.slow
def test_another_cyclone_that_is_preloaded_is_named_instead_of_ending_the_process(tmp_path):
    folder = Path(cyclonedds.__file__).parent.with_name("cyclonedds.libs")
    own = next(folder.glob("libddsc*.so*"), None)
    if own is None:
        pytest.skip("this wheel has no library of its own")
    other = shutil.copy(own, tmp_path / "libddsc.so.0")
    call = [sys.executable, "-m", "rtask", "ros2", "dds", "call", "where_is", '{"name": "cup"}']
    done = subprocess.run(
        call, env={**os.environ, "LD_PRELOAD": str(other)}, capture_output=True, text=True,
        check=False, timeout=100,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    said = re.search(r"two of Cyclone DDS are loaded into this process: (.+); start", done.stderr)
    assert said, done.stderr
    assert {Path(each).resolve() for each in said[1].split(", ")} == {Path(other), own.resolve()}
    assert "env -u LD_PRELOAD" in done.stderr


@pytest.mark.parametrize(
    ("line", "state", "words"),
    [
        ("kill -SEGV $$", "broken", "the library ended its process with SIGSEGV"),
        ("echo 'no such library' >&2; exit 3", "broken", "no such library"),
        ("echo '{\"nodes\": null}'", "broken", "not heard on this machine"),
        ('echo \'{"nodes": ["/robot"]}\'', "ok", "a message was sent and heard"),
        ('echo \'{"error": "two of them", "loaded_twice": true}\'', "note", "two of them"),
    ],
)
def test_what_the_child_process_ends_with_is_a_finding(tmp_path, monkeypatch, line, state, words):
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{line}\n")
    python.chmod(python.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(wheel, "sys", SimpleNamespace(executable=str(python)))
    found = {each.name: each for each in wheel.examine_dds(0, 0.1, is_needed=False)}
    assert (found["dds"].state, words in found["dds"].detail) == (state, True), found["dds"]
    again = {each.name: each for each in wheel.examine_dds(0, 0.1, is_needed=True)}
    assert again["dds"].state == ("broken" if state == "note" else state)


def test_one_library_is_not_refused_and_two_are(tmp_path, monkeypatch):
    maps = tmp_path / "maps"
    monkeypatch.setattr(library, "_MAPS", maps)
    line = "7f00-7f01 r-xp 00000000 08:01 42    {}\n"
    maps.write_text(line.format("/venv/cyclonedds.libs/libddsc-ad12.so.11.0.1") * 2)
    library.check_single_library()
    maps.write_text(maps.read_text() + line.format("/opt/ros/jazzy/lib/libddsc.so.0.10.2"))
    with pytest.raises(UsageError) as caught:
        library.check_single_library()
    assert caught.value.details["libraries"] == [
        "/opt/ros/jazzy/lib/libddsc.so.0.10.2",
        "/venv/cyclonedds.libs/libddsc-ad12.so.11.0.1",
    ]
    maps.unlink()
    library.check_single_library()


def test_the_child_prints_one_object_also_of_a_failure(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["wheel", "0", "0.1"])

    def refuse(domain, wait_s):
        raise UsageError("two of them", libraries=["a", "b"])

    monkeypatch.setattr(wheel, "_heard_nodes", refuse)
    wheel.main()
    assert json.loads(capsys.readouterr().out) == {"error": "two of them", "loaded_twice": True}
