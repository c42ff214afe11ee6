"""The sense module of Gatto 2016: Figures 5, 8, 9, 10, 12 and 13, culling."""

from __future__ import annotations

import time
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import look_at
from features.recognition.views.sift import detect_keypoints
from features.scene_change import SceneChangeGate
from features.segmentation import segment_scene
from features.segmentation.segment import segment_cloud
from rtask.scratch import ScratchFolder
from simulate.thesis.materials.pictures import png
from simulate.thesis.materials.tables_seen import CAMERA, EYE, TARGET, SeenTable, seen_tables
from simulate.thesis.result import Compared, Result, Setting, counted, share_of
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.objects import sample_objects, write_assets
from simulate.world.scene import arrange
from simulate.world.world import World

__all__ = ["culling", "keypoints", "objects", "segmentation", "supervoxels", "table_hull"]

Image = NDArray[np.uint8]

_STAND_IN = "a simulated table and Kinect instead of the laboratory's"
_LEAST_IOU = 0.5
_STILL, _RATE_HZ = 8, 10.0
_PRODUCTS = 4


def objects(setting: Setting) -> Result:
    """Products on a table, as the robot's camera sees them."""
    (table,) = seen_tables(1, 6, setting.seed)
    seen = sum(bool((table.bodies == body).any()) for body in table.products)
    return Result(
        (Compared("products in the image, of 6", float(seen)),),
        (_STAND_IN,),
        {"six products": png(_rgb(table))},
    )


def table_hull(setting: Setting) -> Result:
    """The table's points and the hull of the table that is found in them."""
    (table,) = seen_tables(1, 5, setting.seed)
    scene = segment_scene(table.frame.points(), table.frame.rgb, gravity=table.down)
    assert scene.plane is not None  # there is a table
    up = float(np.degrees(np.arccos(np.clip(-scene.plane.normal @ table.down, -1, 1))))
    points = table.frame.points()
    heights = np.abs(scene.plane.heights(np.nan_to_num(points)))
    on_plane = (table.frame.depth_m > 0) & (heights < 0.008)
    image = _rgb(table).copy()
    image[on_plane] = (0.5 * image[on_plane] + (20, 110, 20)).astype(np.uint8)
    edge, _ = cv2.findContours(on_plane.astype(np.uint8), cv2.RETR_EXTERNAL,
                               cv2.CHAIN_APPROX_NONE)  # fmt: skip
    hull = cv2.convexHull(np.vstack(edge))
    cv2.polylines(image, [hull], True, (220, 40, 40), 2, cv2.LINE_AA)
    return Result(
        (
            Compared("angle between the plane and the true table", up, unit="deg"),
            Compared("share of pixels on the table's plane", float(on_plane.mean())),
        ),
        (_STAND_IN, "the thesis draws both and gives no figures"),
        {"the table's points in green, their hull in red": png(image)},
    )


def supervoxels(setting: Setting) -> Result:
    """Supervoxels of a table (VCCS)."""
    (table,) = seen_tables(1, 5, setting.seed)
    segment_cloud(table.frame.points(), table.frame.rgb)  # compiles before the clock runs
    began = time.process_time()
    cut = segment_cloud(table.frame.points(), table.frame.rgb)
    spent = time.process_time() - began
    return Result(
        (
            Compared("supervoxels", float(cut.supervoxels.max() + 1)),
            Compared("time from cloud to segments", spent, unit="s"),
        ),
        (_STAND_IN, "the thesis shows another author's picture"),
        {"supervoxels": png(_painted(cut.supervoxels + 1))},
    )


def segmentation(setting: Setting) -> Result:
    """Segmentation of simulated tables, against the truth (Fig. 10 and 12)."""
    tables = setting.size(40, 6)
    whole = products = 0
    shown: dict[str, str | bytes] = {}
    for number, table in enumerate(seen_tables(tables, 5, setting.seed)):
        labels = segment_scene(table.frame.points(), table.frame.rgb, gravity=table.down).labels
        if number == 0:
            shown = {"image": png(_rgb(table)), "segments": png(_painted(labels))}
        for body in table.products:
            true = (table.bodies == body) & (table.frame.depth_m > 0)
            if true.sum() < 100:
                continue
            products += 1
            own = labels[true & (labels > 0)]
            if len(own):
                label = int(np.bincount(own).argmax())
                both = (labels == label) & (table.frame.depth_m > 0)
                whole += bool((true & both).sum() / (true | both).sum() >= _LEAST_IOU)
    return Result(
        (share_of(f"products segmented alone (IoU >= {_LEAST_IOU})", whole, products),),
        (_STAND_IN, "the thesis shows one scene and gives no figures",
         *setting.shrunk("tables", 40, tables)),
        shown,
    )  # fmt: skip


def keypoints(setting: Setting) -> Result:
    """SIFT keypoints of a product, with size and direction."""
    (table,) = seen_tables(1, 4, setting.seed)
    image = _rgb(table)
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    mask = np.isin(table.bodies, table.products)
    places, descriptors = detect_keypoints(np.asarray(grey, np.uint8), mask)
    drawn = image.copy()
    for x, y, size, degrees in places[:, :4].tolist():
        turn, middle = np.deg2rad(degrees), (round(x), round(y))
        end = (round(x + size / 2 * np.cos(turn)), round(y + size / 2 * np.sin(turn)))
        cv2.circle(drawn, middle, max(round(size / 2), 1), (230, 60, 40), 1, cv2.LINE_AA)
        cv2.line(drawn, middle, end, (230, 60, 40), 1, cv2.LINE_AA)
    return Result(
        (
            Compared("keypoints on four products", float(len(places))),
            counted("values of a descriptor", float(descriptors.shape[1]), 128.0),
        ),
        (_STAND_IN,),
        {"keypoints": png(drawn)},
    )


def _rgb(table: SeenTable) -> Image:
    assert table.frame.rgb is not None  # of a simulated camera
    return table.frame.rgb


def _painted(labels: NDArray[np.integer[Any]]) -> Image:
    """Return an image with a colour for each label, grey where it is 0."""
    rng = np.random.default_rng(1)
    colours = rng.integers(60, 255, (int(labels.max()) + 1, 3)).astype(np.uint8)
    colours[0] = 30
    return np.asarray(colours[np.maximum(labels, 0)], np.uint8)


def culling(setting: Setting) -> Result:
    """Offer frames of a table of which now and then a product is taken away."""
    tables = setting.size(12, 2)
    still = sent_still = changes = noticed = 0
    for number in range(tables):
        counts = _watched(np.random.default_rng([setting.seed, number, 0xC011]))
        still, sent_still = still + counts[0], sent_still + counts[1]
        changes, noticed = changes + counts[2], noticed + counts[3]
    frames, sent = still + changes, sent_still + noticed
    return Result(
        (
            share_of("frames of a table at rest that are sent", sent_still, still),
            share_of("products taken away that are sent at once", noticed, changes),
            share_of("frames that are sent", sent, frames),
        ),
        (
            f"{_STILL} frames at {_RATE_HZ:g} Hz after each change, with a Kinect's noise; each "
            "change is one of four products that is taken away",
            "the thesis names the method of others and gives no figures",
            *setting.shrunk("tables", 12, tables),
        ),
    )


def _watched(rng: np.random.Generator) -> tuple[int, int, int, int]:
    """Return frames at rest, those of them sent, changes, and those of them sent at once."""
    specs = sample_objects(rng, _PRODUCTS)
    gate, noise, light = SceneChangeGate(), SensorNoise(), Lighting.sample(rng)
    now, still, sent_still, noticed = 0.0, 0, 0, 0
    with ScratchFolder("culling") as folder, World() as world:
        world.add_table(0.0)
        bodies = [
            world.spawn(p.spec, (p.x, p.y), p.yaw, write_assets(p.spec, folder))
            for p in arrange(specs, rng)
        ]
        world.step(0.5)
        camera, pose = Camera(world.client, CAMERA), look_at(EYE, TARGET)
        for turn in range(_PRODUCTS + 1):
            if turn:
                world.remove(bodies[turn - 1])
            exact, _ = camera.capture(pose, light)
            for k in range(_STILL):
                sent = gate.offer(noise.apply(exact, rng), now).send
                now += 1 / _RATE_HZ
                if k:
                    still, sent_still = still + 1, sent_still + sent
                elif turn:
                    noticed += sent
    return still, sent_still, _PRODUCTS, noticed
