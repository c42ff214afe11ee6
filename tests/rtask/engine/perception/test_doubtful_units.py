"""A view in which nothing is found is refused where its unit is the likely reason."""

from __future__ import annotations

import numpy as np
import pytest

from features.codec.types import Cloud
from rtask.engine.perception.cutting import cut
from rtask.errors import DataError


def test_a_table_in_millimetres_is_not_called_empty() -> None:
    # In the frame of the table, so that its points are not far off in depth.
    rng = np.random.default_rng(6)
    metres = np.column_stack([rng.uniform(-0.5, 0.5, (4_000, 2)), rng.normal(0, 0.001, 4_000)])
    assert not cut(Cloud(metres.astype(np.float32))).objects
    with pytest.raises(DataError, match=r"no object was found.*another unit"):
        cut(Cloud((1_000 * metres).astype(np.float32)))
