"""`rtask world export`: the scene at a time as a file, from a folder and from a server."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import rtask
from rtask.cli import main
from tests.rtask.world.conftest import _LAB, BASE, Lab
from tests.servers import running_server

pytestmark = pytest.mark.slow
AT = "2025-11-28T12:01:00Z"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    with rtask.open(tmp_path / "kb", base=BASE, reason=False) as kb:
        kb.update(_LAB)
        lab = Lab(kb)
        lab.stand(lab.table, lab.map, 2.0, 0.0, 0.0)
        lab.see(lab.cup, 0.3, 0.3, 10.0, frame=lab.table)
        lab.put(lab.see(lab.box, 0.3, -0.1, 10.0), "in", lab.left_box, 20.0)
    return tmp_path / "kb"


def run(capsys: Any, *arguments: str) -> tuple[int, str, str]:
    """Return the exit code and what was printed."""
    with pytest.raises(SystemExit) as ended:
        main(["world", "export", *arguments])
    printed = capsys.readouterr()
    return int(ended.value.code or 0), printed.out, printed.err


def test_a_folder_and_a_server_give_the_same_file(store: Path, tmp_path: Path, capsys: Any) -> None:
    glb, usda = tmp_path / "scene.glb", tmp_path / "scene.usda"
    code, out, _ = run(capsys, str(glb), "--at", AT, "-d", str(store), "--json")
    said = json.loads(out)
    assert (code, said["things"], said["root"]) == (0, 1, f"{BASE}frame/map")
    assert said["bytes"] == glb.stat().st_size
    assert [one["label"] for one in said["unplaced"]] == ["tea box"]
    code, _, err = run(capsys, str(usda), "--at", AT, "--frame", "table", "-d", str(store))
    assert code == 0
    assert "1 things" in err
    assert "not drawn: tea box: in left box, whose pose is not known" in err
    assert "another tree: --frame" not in err or "nao" in err
    local = glb.read_bytes(), usda.read_bytes()
    with running_server(store) as server:
        assert run(capsys, str(glb), "--at", AT, "--server", server.url)[0] == 0
        assert (
            run(capsys, str(usda), "--at", AT, "--server", server.url, "--frame", "table")[0] == 0
        )
        code, _, err = run(capsys, str(glb), "--at", "noon", "--server", server.url)
        assert (code, "'noon' is not a time" in err) == (2, True)
    assert (glb.read_bytes(), usda.read_bytes()) == local


def test_a_name_of_no_known_format_and_a_frame_that_is_none_are_refused(
    store: Path, tmp_path: Path, capsys: Any
) -> None:
    code, _, err = run(capsys, str(tmp_path / "scene.obj"), "-d", str(store))
    assert (code, "ends in .glb or .usda" in err) == (2, True)
    code, _, err = run(capsys, str(tmp_path / "scene.glb"), "--frame", "attic", "-d", str(store))
    assert (code, "no frame 'attic'" in err) == (1, True)
    assert list(tmp_path.glob("scene.*")) == []
