"""Frames that are worth sending, Gatto 2016, 3.2.1: culling by entropy as a table changes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from features.geometry import look_at
from features.scene_change import SceneChangeGate
from simulate.thesis.result import Result, Setting, share_of
from simulate.thesis.runs.tables_seen import CAMERA, EYE, TARGET
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.objects import sample_objects, write_assets
from simulate.world.scene import arrange
from simulate.world.world import World

__all__ = ["culling"]

_STILL, _RATE_HZ = 8, 10.0
_PRODUCTS = 4


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
    with tempfile.TemporaryDirectory(prefix="rtask-culling-") as folder, World() as world:
        world.add_table(0.0)
        bodies = [
            world.spawn(p.spec, (p.x, p.y), p.yaw, write_assets(p.spec, Path(folder)))
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
