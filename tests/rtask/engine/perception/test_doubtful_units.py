"""A view in which nothing is found is refused where its unit is the likely reason."""

from __future__ import annotations

import numpy as np
import pytest

from features.codec.pcd import write_pcd
from features.codec.types import Cloud
from rtask.engine.perception.clutter import view_clutter
from rtask.engine.perception.cutting import cut
from rtask.engine.perception.observation import Look, observe
from rtask.errors import DataError, UsageError


def test_a_table_in_millimetres_is_not_called_empty() -> None:
    # In the frame of the table, so that its points are not far off in depth.
    rng = np.random.default_rng(6)
    metres = np.column_stack([rng.uniform(-0.5, 0.5, (4_000, 2)), rng.normal(0, 0.001, 4_000)])
    assert not cut(Cloud(metres.astype(np.float32))).objects
    with pytest.raises(DataError, match=r"no object was found.*another unit"):
        cut(Cloud((1_000 * metres).astype(np.float32)))


@pytest.mark.parametrize("scale", [100, 1_000])
def test_an_object_in_millimetres_is_not_stored_as_one_of_many_metres(scale: int) -> None:
    rng = np.random.default_rng(7)
    points = scale * rng.uniform((-0.05, -0.03, 0.6), (0.05, 0.03, 0.7), (2_000, 3))
    table = {axis: points[:, k].astype("<f4") for k, axis in enumerate("xyz")}
    with pytest.raises(UsageError, match=r"data: .*another unit"):
        observe(Look(data=write_pcd(table, (1, len(points)))))


@pytest.mark.parametrize("support_height", [750.0, 0.9, -2.0])
def test_an_object_far_from_its_support_is_not_placed_there(support_height: float) -> None:
    rng = np.random.default_rng(8)
    points = rng.uniform((-0.05, -0.03, 0.0), (0.05, 0.03, 0.06), (2_000, 3))
    cloud = {axis: points[:, k].astype("<f4") for k, axis in enumerate("xyz")}
    data = write_pcd(cloud, (1, len(points)))
    with pytest.raises(UsageError, match=r"support_height: .*another frame"):
        observe(Look(data=data, frame_id="base_link", support_height=support_height))
    # A camera that looks straight down sees the top alone, which is not on the table.
    seen = observe(Look(data=data, frame_id="base_link", support_height=-0.3))
    assert seen.shape is not None
    assert seen.shape.height == pytest.approx(0.36, abs=0.005)  # noise of the points' top 2 %


def test_a_table_at_another_height_than_told_is_not_called_empty() -> None:
    rng = np.random.default_rng(9)
    table = np.column_stack([rng.uniform(-0.5, 0.5, (20_000, 2)), np.full(20_000, 0.8)])
    camera = np.diag([1.0, -1.0, -1.0, 1.0])
    camera[2, 3] = 1.6
    seen = (table - camera[:3, 3]) @ camera[:3, :3]
    assert view_clutter(seen, None, camera, table_height=0.8) is not None
    with pytest.raises(UsageError, match=r"near 800 m.* lies at 0\.8 m: another unit") as caught:
        view_clutter(seen, None, camera, table_height=800.0)
    assert caught.value.details["field"] == "support_height"
