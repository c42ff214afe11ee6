"""Everything that a look leaves of an object is in the graph, and recognition follows from it."""

from __future__ import annotations

import io
import shutil

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import rtask
from features.codec import decode, from_wire
from features.recognition import ViewFeatures, describe_frame
from rtask.cli import cli
from rtask.engine import Engine
from rtask.model import RTASK

pytestmark = pytest.mark.slow

NS = "https://w3id.org/rtask-kg/ns#"
KINDS = {
    "ColorImage",
    "CompressedPointCloud",
    "SIFTFeatureSet",
    "HOGDescriptor",
    "FPFHFeatureSet",
    "BSplineContour",
    "BSplineSurface",
}
FEATURES = f"""PREFIX rt: <{NS}>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
SELECT ?object ?class ?kind ?blob WHERE {{
  ?object a ?class ; rt:hasView/rt:viewContent ?content . ?content a ?kind ; rt:hasBlob ?blob .
  ?class rdfs:subClassOf rt:ManipulableObject
  FILTER(?class != rt:ManipulableObject && ?kind IN ({", ".join(f"rt:{k}" for k in sorted(KINDS))}))
}}"""


@pytest.fixture(scope="module")
def store(bench, tmp_path_factory):
    """Return the folder of a store that knows a tin, the tin and what was sent of it."""
    folder = tmp_path_factory.mktemp("visual") / "kb"
    seen = bench.sight(bench.CAN)
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.register()
        robot.insert(bench.sight(bench.BOX), class_description="carton")
        tin = robot.insert(seen, class_description="tin")["objects"][0]
    return folder, tin, seen


def test_sparql_finds_every_kind_of_feature_by_object_and_class(store):
    folder, tin, _ = store
    with rtask.open(folder, reason=False) as kb:
        rows = [row for row in kb.select(FEATURES) if row.value("object") == tin["object"]]
        assert {str(row.value("class")) for row in rows} == {tin["class_iri"]}
        kinds = sorted(str(row.value("kind")).removeprefix(NS) for row in rows)
        assert kinds == sorted(KINDS)
        assert all(kb.blobs.read(str(row.value("blob"))) for row in rows)


def test_the_object_layer_reads_the_features_back_as_they_were_seen(store):
    folder, tin, seen = store
    crop = decode(from_wire(seen["data"]))
    expected = describe_frame(crop)
    with rtask.open(folder, reason=False) as kb, kb.session() as session:
        thing = RTASK.ManipulableObject
        found = session.query(thing).prefetch(thing.has_view.view_content.has_blob)
        mine = next(one for one in found if str(one.iri) == tin["object"])
        (view,) = mine.has_view
        contents = {type(c).__name__: c for c in view.view_content}
        data = {kind: kb.blobs.read(next(iter(c.has_blob)).iri) for kind, c in contents.items()}
        counts = {kind: getattr(c, "descriptor_count", None) for kind, c in contents.items()}
    assert set(data) == KINDS
    assert data["CompressedPointCloud"] == from_wire(seen["data"])
    picture = cv2.imdecode(np.frombuffer(data["ColorImage"], np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape[:2] == crop.depth_m.shape
    stored = ViewFeatures.from_bytes(data["SIFTFeatureSet"])
    assert np.array_equal(stored.descriptors, expected.descriptors)
    assert counts["SIFTFeatureSet"] == len(expected) > 0

    def arrays(kind):
        return np.load(io.BytesIO(data[kind]))

    assert np.array_equal(arrays("HOGDescriptor")["hog"], expected.hog)
    assert arrays("FPFHFeatureSet")["fpfh"].shape == (counts["FPFHFeatureSet"], 33)
    outline = arrays("BSplineContour")["control_points_px"]
    assert np.array_equal(outline, expected.contour.control_points)
    depth = arrays("BSplineSurface")["coefficients_m"]
    assert np.array_equal(depth, expected.surface.coefficients)


@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [["CAN"], pytest.param(["CAN", "BOX", "PEN"], marks=pytest.mark.deep)]
)
def test_after_rtask_rebuild_every_answer_is_the_same(bench, store, names):
    folder, _, _ = store
    things = [getattr(bench, name) for name in names]
    before = _answers(bench, folder, things)
    shutil.rmtree(folder / "index")
    done = CliRunner().invoke(cli, ["rebuild", "recognition", "--data", str(folder)])
    assert done.exit_code == 0, done.output
    assert "recognition: 2 views" in done.output
    assert _answers(bench, folder, things) == before


def _answers(bench, folder, things):
    """Return what the store says of things, of which the pen is not known, and of views."""
    eye = bench.Eye(position=(0.03, 0.02, 0.6))
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        looks = [robot.recognise(bench.sight(thing, eye))["recognition"] for thing in things]
        return looks, sorted(str(row) for row in kb.select(FEATURES))
