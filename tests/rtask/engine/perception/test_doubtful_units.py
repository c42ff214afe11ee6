"""A view in which nothing is found is refused where its unit is the likely reason."""

from __future__ import annotations

import numpy as np
import pytest

from features.codec.pcd import write_pcd
from features.codec.types import Cloud
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
