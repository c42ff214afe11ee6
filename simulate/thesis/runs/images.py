"""Training and asking with images over HTTP (Kehoe 2014, 4.4): the answer has the stored image."""

from __future__ import annotations

import base64
import urllib.request
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import rtask
from rtask.scratch import ScratchFolder
from simulate.demo.processes import Endpoint
from simulate.thesis.materials.pictures import png
from simulate.thesis.materials.products import SIX, STAND_INS, Turned, turned
from simulate.thesis.result import Result, Setting, share_of

__all__ = ["stored_images"]

Picture = NDArray[np.uint8]
# The first image loads what recognition needs, which takes long on a busy machine.
_PATIENCE_S = 300.0


def stored_images(setting: Setting) -> Result:
    """Train on labelled images, ask with others over HTTP, and fetch the image that matched."""
    step, names = (30, SIX[::2]) if setting.fast else (10, SIX)
    views = {name: list(turned(name, step, setting.seed)) for name in names}
    trained = {name: of_one[::2] for name, of_one in views.items()}
    asked = accepted = right = named = own = 0
    with ScratchFolder("images") as folder:
        endpoint = Endpoint(folder / "store", 0, folder / "log")
        try:
            with rtask.connect(endpoint.url, timeout_s=_PATIENCE_S) as client:
                for name, shown_first in trained.items():
                    kind = name.partition("-")[0]
                    for view in shown_first:
                        client.teach_object(operation="teach", class_description=kind, name=name,
                                            **_sent(view))  # fmt: skip
                for name, of_one in views.items():
                    for view in of_one[1::2]:
                        answer = client.search_object(**_sent(view))
                        asked += 1
                        if not answer["accepted"]:
                            continue
                        first = answer["similar_objects"][0]
                        accepted, right = accepted + 1, right + (first["label"] == name)
                        named += bool(first["picture"])
                        if first["picture"]:
                            shown = _fetched(endpoint.url, first["picture"])
                            own += _nearest(shown, trained) == first["label"]
        finally:
            endpoint.stop()
    return Result(
        (
            share_of("images that were identified", accepted, asked),
            share_of("of those, rightly", right, accepted),
            share_of("of those, with the stored image that matches", named, accepted),
            share_of("stored images, fetched: the training image most like it is of that object",
                     own, named),
        ),
        (
            STAND_INS,
            "images alone, without depth, sent with the object's pixels; the stored image is "
            "fetched by its SHA-256 at /api/blobs",
            "the thesis describes the answer and gives no figures; for its recall see "
            "kehoe-table-4.1",
            *setting.shrunk("products", len(SIX), len(names)),
            *((f"views every {step} degrees instead of 10 (--fast)",) if setting.fast else ()),
        ),
    )  # fmt: skip


def _sent(view: Turned) -> dict[str, Any]:
    """Return the fields of a request with the image and the object's pixels."""
    assert view.frame.rgb is not None  # of a simulated camera
    mask = view.frame.object_mask().astype(np.uint8)
    encoded = bytes(cv2.imencode(".png", mask)[1])
    return {"image": base64.b64encode(png(view.frame.rgb)).decode(),
            "mask": base64.b64encode(encoded).decode()}  # fmt: skip


def _fetched(url: str, sha256: str) -> Picture:
    """Return a stored image (h, w, 3), RGB."""
    with urllib.request.urlopen(f"{url}/api/blobs/{sha256}") as answer:
        pixels = cv2.imdecode(np.frombuffer(answer.read(), np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None  # it was stored as an image
    return np.asarray(pixels[..., ::-1], np.uint8)


def _nearest(shown: Picture, trained: Mapping[str, Sequence[Turned]]) -> str:
    """Return the object of whose training images one holds the stored one with the least error."""
    errors = {}
    for name, views in trained.items():
        wholes = [view.frame.rgb for view in views if view.frame.rgb is not None]
        errors[name] = min(
            float(cv2.matchTemplate(whole, shown, cv2.TM_SQDIFF).min()) for whole in wholes
        )
    return min(errors, key=errors.__getitem__)
