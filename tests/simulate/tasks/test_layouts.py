"""Where things are laid on the tables of whole arms."""

from __future__ import annotations

import numpy as np
import pytest

from rtask.errors import UsageError
from simulate.tasks.arms.layouts import place_things, sorting_table
from simulate.world.objects import spec_of

_LARGE = ["bottle-88", "box-170", "box-1", "box-2"]


@pytest.mark.parametrize("seed", [3, 18, 19])  # of these the first ones leave the last no room
def test_things_that_leave_no_room_for_the_last_are_laid_anew(seed):
    table, specs = sorting_table(), [spec_of(name) for name in _LARGE]
    placed = place_things(table, specs, np.random.default_rng(seed))
    assert [spot.spec.name for spot in placed] == [spec.name for spec in specs]
    for spot in placed:
        assert any(area.holds(spot.x, spot.y) for area in table.areas if not area.is_box)


def test_more_things_than_a_table_has_room_for_are_refused():
    with pytest.raises(UsageError, match="no room for 40 things"):
        place_things(sorting_table(), [spec_of("box-170")] * 40, np.random.default_rng(0))
