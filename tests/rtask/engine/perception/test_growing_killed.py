"""Killed at any point of a commit that lets a model grow, graph and blobs still agree."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rtask
from features.modelling import ObjectModel
from rtask.engine import Engine
from rtask.engine.perception.observation import stored_frame
from rtask.engine.stored import stored_models
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).with_name("growing_process.py")
YAWS = (0.3, 0.9, -0.5, 1.4)


@pytest.fixture(scope="module")
def begun(bench, tmp_path_factory):
    """A store with one view of a box, the views still to come, and the box's IRI."""
    place = tmp_path_factory.mktemp("growing")
    with rtask.open(place / "kb", reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.register()
        name = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    views = [bench.sight(bench.BOX.at(0.16, -0.06, yaw)) for yaw in YAWS]
    lines = [
        json.dumps({"objects": [{**view, "object": name, "task_id": f"urn:task:{k}"}]})
        for k, view in enumerate(views)
    ]
    (place / "requests").write_text("\n".join(lines))
    return place, name


@pytest.fixture(scope="module")
def victims(begun):
    """Return what sends a process into an insertion in which it is killed."""
    command = [sys.executable, str(SCRIPT), str(begun[0] / "requests")]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        out, answers = process.stdin, process.stdout

        def insert(folder: Path, view: int, calls: int) -> str:
            out.write(json.dumps({"folder": str(folder), "view": view, "calls": calls}) + "\n")
            out.flush()
            return answers.readline().strip()

        yield insert


def held_views(folder: Path, name: str) -> int:
    """Open a store, check that everything of its one model agrees; return how many views it has."""
    with rtask.open(folder, reason=False) as kb:
        assert [f for f in kb.verify() if f.severity == "error"] == []
        (stored,) = stored_models(kb, iri(name))
        model = ObjectModel.from_bytes(kb.blobs.read(stored.blob))
        assert {source for source, _ in model.sources} == stored.views
        views = {quad.object.value for quad in kb.match(name, RT.hasView)}
        assert stored.views <= views
        for view in views:
            assert stored_frame(kb, view) is not None
        (mesh,) = kb.match(None, RDF.type, RT.TriangleMesh)
        (ply,) = kb.match(mesh.subject, RT.hasBlob)
        assert kb.blobs.read(ply.object).startswith(b"ply")
        return len(stored.views)


@pytest.mark.parametrize(
    "moments",
    [(9, 34, 61), pytest.param((2, 9, 16, 25, 34, 43, 52, 61), marks=pytest.mark.deep)],
    ids=len,
)
def test_a_growth_that_is_killed_happened_wholly_or_not_at_all(begun, victims, tmp_path, moments):
    place, name = begun
    folder = tmp_path / "kb"
    shutil.copytree(place / "kb", folder)
    before, killed, grew = held_views(folder, name), 0, set()
    # The insertion of a view is some 40 such operations; odd: behind it.
    for calls in moments:
        said = victims(folder, 1, calls)
        killed += said == "killed"
        now = held_views(folder, name)
        grew.add(now - before)
        if now > before:  # begin again: each kill is to meet a commit that grows the model
            shutil.rmtree(folder)
            shutil.copytree(place / "kb", folder)
    assert killed >= len(moments) // 2
    assert grew <= {0, 1}
    assert 0 in grew
    # What was killed again and again goes on as if nothing had been.
    assert victims(folder, 1, 10**6) == "stored"
    assert victims(folder, 2, 10**6) == "stored"
    assert held_views(folder, name) == before + 2
