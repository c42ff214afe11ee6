"""Films of a simulated attempt: two cameras, at a fixed rate of simulated time."""

from __future__ import annotations

import numpy as np

from simulate.agent.films import FILM_HZ, filming
from simulate.world.camera import Camera
from simulate.world.world import World


def test_two_cameras_film_at_their_rate_and_stop_afterwards() -> None:
    world, steps = World("fast"), []
    try:
        world.add_table()
        camera = Camera(world.client)
        world.on_step = lambda: steps.append(world.time)
        with filming(world, camera, None, "right") as films:
            world.step(0.25)
            world.step(0.1)
        seen = len(films["front"])
        world.step(0.3)
    finally:
        world.close()
    assert seen == len(films["front"]) == len(films["overhead"]) == 1 + int(0.35 * FILM_HZ)
    assert len(steps) == 3  # whoever watched before still does
    shapes = {frame.shape for film in films.values() for frame in film}
    assert shapes == {(120, 160, 3)}
    front, above = (films[name][0].astype(float) for name in ("front", "overhead"))
    assert np.abs(front - above).mean() > 5  # from two places
    assert above.std() > 5  # the table is in view
