"""A server that reads words, with a stand-in for the library that reads."""

from __future__ import annotations

import base64
import html
import json
import os
import sys
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest

import rtask
from rtask.client import connect
from tests.features.words.printed_cartons import carton, photograph
from tests.servers import running_server

# What it takes is the start of a server; test_printed_words.py asks the engine the same.
pytestmark = [pytest.mark.slow, pytest.mark.deep]

_LIBRARY = '''
"""Stand-in for rapidocr: it finds the labels of the cartons."""
from types import SimpleNamespace
import numpy as np
from tests.features.words.printed_cartons import StandInReader

class RapidOCR:
    def __init__(self, params):
        assert params["Det.model_path"].endswith("PP-OCRv6_det_small.onnx")

    def __call__(self, bgr):
        words = StandInReader().read(np.ascontiguousarray(bgr[..., ::-1]))
        if not words:
            return SimpleNamespace(boxes=None, txts=None, scores=None)
        return SimpleNamespace(
            boxes=np.array([word.corners for word in words]),
            txts=tuple(word.text for word in words), scores=tuple(word.score for word in words),
        )
'''


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Return the environment of a machine where the stand-in is installed and asked for."""
    library = tmp_path / "library"
    networks = library / "rapidocr" / "models"
    networks.mkdir(parents=True)
    for name in ("PP-OCRv6_det_small", "PP-OCRv6_rec_small", "ch_ppocr_mobile_v2.0_cls_mobile"):
        (networks / f"{name}.onnx").write_bytes(b"")
    (library / "rapidocr" / "__init__.py").write_text(_LIBRARY)
    described = library / "rapidocr-3.99.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: rapidocr\nVersion: 3.99\n")
    path = os.pathsep.join([str(library), str(Path(rtask.__file__).parents[1])])
    return {**os.environ, "PYTHONPATH": path, "RTASK_WORDS": "1"}


def look(flavour: str, seed: int) -> dict[str, Any]:
    """Return a photograph of a carton as a client sends it."""
    image, box = photograph(carton(flavour), seed)
    picture = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
    return {"image": base64.b64encode(picture.tobytes()).decode(), "box": box}


def _page(url: str, seen: dict[str, Any]) -> str:
    """Return the page, without its JSON, that answers a look sent by the form of a browser."""
    sent = httpx.post(
        f"{url}/services/rtask/Engine",
        data={"$method": "search_object", "box": json.dumps(seen["box"])},
        files={"image": ("seen.jpg", base64.b64decode(seen["image"]))},
        headers={"Accept": "text/html"},
        timeout=60,
    )
    assert sent.status_code == 200
    return html.unescape(sent.text).partition("As JSON")[0]


def test_a_client_learns_which_word_tells_a_sibling(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    # By its script: the usual start forks a process that has its own path already.
    command = (str(Path(sys.executable).with_name("rtask")),)
    with (
        running_server(tmp_path / "store", command=command, environment=environment) as server,
        connect(server.url) as robot,
    ):
        item = {**look("VANILJ", 0), "name": "vanilla"}
        robot.insert_object(objects=[item])
        same = robot.search_object(**look("VANILJ", 7))
        assert (same["accepted"], same["message"]) == (True, "is vanilla")
        other = robot.search_object(**look("NATURELL", 8))
        assert not other["accepted"]
        assert (other["word_seen"], other["word_stored"]) == ("NATURELL", "VANILJ")
        assert other["message"].endswith('says "NATURELL" where vanilla says "VANILJ"')
        page = _page(server.url, look("NATURELL", 8))
        assert 'says "NATURELL" where vanilla says "VANILJ"' in page
        shown = other["similar_objects"][0]
        assert f'src="/api/blobs/{shown["picture"]}"' in page
        picture = httpx.get(f"{server.url}/api/blobs/{shown['picture']}")
        assert picture.headers["content-type"].startswith("image/")
        kept = cv2.imdecode(np.frombuffer(picture.content, np.uint8), cv2.IMREAD_COLOR)
        assert kept is not None
        assert kept.size
        read = robot.query(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> SELECT ?by ?text "
            "{ ?r rt:readBy ?by ; rt:hasWord/rt:wordText ?text }"
        )
        rows = [(row["by"], row["text"]) for row in read]
        assert rows == [("rapidocr 3.99, PP-OCRv6_rec_small", "VANILJ")]
