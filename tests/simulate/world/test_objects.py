"""Products: the same name is the same thing; sizes, masses, inertia and meshes agree."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from rtask.errors import UsageError
from simulate.world.objects import (
    KINDS,
    ObjectSpec,
    Primitive,
    inertia_of,
    product,
    sample_objects,
    write_assets,
)


def _read_obj(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rows: dict[str, list[list[float]]] = {"v": [], "vt": [], "vn": [], "f": []}
    for line in path.read_text().splitlines():
        tag, *values = line.split()
        if tag in ("v", "vt", "vn"):
            rows[tag].append([float(x) for x in values])
        elif tag == "f":
            rows["f"].append([int(x.split("/")[0]) - 1 for x in values])
    return (
        np.array(rows["v"]),
        np.array(rows["vt"]),
        np.array(rows["vn"]),
        np.array(rows["f"], dtype=int),
    )


def test_a_draw_of_six_holds_at_least_four_kinds_and_no_product_twice() -> None:
    for seed in range(20):
        specs = sample_objects(np.random.default_rng(seed), 6)
        assert len({spec.kind for spec in specs}) >= 4
        assert len({spec.name for spec in specs}) == 6


def test_the_same_generator_gives_the_same_draw() -> None:
    first = sample_objects(np.random.default_rng(5), 8)
    assert first == sample_objects(np.random.default_rng(5), 8)
    assert first != sample_objects(np.random.default_rng(6), 8)


def test_kinds_can_be_chosen_and_are_mixed_evenly() -> None:
    specs = sample_objects(np.random.default_rng(0), 7, ("can", "pen"))
    assert sorted(Counter(spec.kind for spec in specs).values()) == [3, 4]


@pytest.mark.parametrize("kind", KINDS)
def test_products_fit_the_hand_and_differ_in_look(kind: str) -> None:
    specs = [product(kind, number) for number in range(20)]  # type: ignore[arg-type]
    assert all(min(spec.extent) <= 0.042 and max(spec.extent) <= 0.13 for spec in specs)
    assert all(0.005 <= spec.mass <= 0.06 for spec in specs)
    assert len({spec.texture_seed for spec in specs}) == 20


@pytest.mark.parametrize("kind", KINDS)
def test_the_mesh_is_closed_outward_and_as_large_as_the_product(kind: str, tmp_path: Path) -> None:
    spec = product(kind, 1)  # type: ignore[arg-type]
    points, uv, normals, faces = _read_obj(write_assets(spec, tmp_path).obj_path)
    size = points.max(axis=0) - points.min(axis=0)
    # 36 facets around: the narrowest bounding width is 0.4 % below the diameter.
    np.testing.assert_allclose(size, spec.extent, rtol=0.005, atol=2e-6)
    assert points[:, 2].min() == pytest.approx(-spec.rest_height, rel=0.005, abs=2e-6)
    a, b, c = (points[faces[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    solid = np.linalg.norm(area, axis=1) > 1e-12  # lids meet in their centre: no area there
    assert (np.sum(area * normals[faces[:, 0]], axis=1)[solid] > 0).all()
    volume = float(np.sum(a * np.cross(b, c))) / 6
    shapes = sum(shape.volume for shape in write_assets(spec, tmp_path).collision)
    # Facets lose 0.5 % of a cylinder, 1.5 % of a ball; a bottle's shoulder is a cone, not a step.
    assert volume == pytest.approx(shapes, rel=0.03)
    assert uv.min() >= 0
    assert uv.max() <= 1


def test_inertia_is_that_of_the_solid(tmp_path: Path) -> None:
    ball = ObjectSpec("ball", (0.04,), 0.02, 1, "test-ball")
    assert write_assets(ball, tmp_path).inertia == pytest.approx([0.4 * 0.02 * 0.02**2] * 3)
    pen = ObjectSpec("pen", (0.02, 0.1), 0.012, 1, "test-pen")
    along, across, _ = write_assets(pen, tmp_path).inertia
    assert along == pytest.approx(0.5 * 0.012 * 0.01**2)
    assert across == pytest.approx(0.012 / 12 * (3 * 0.01**2 + 0.1**2))
    dumb_bell = tuple(Primitive("sphere", (0.01,), (0.0, 0.0, z)) for z in (-0.03, 0.03))
    about_x, _, about_z = inertia_of(dumb_bell, 0.02)
    assert about_x == pytest.approx(0.02 * (0.4 * 0.01**2 + 0.03**2))
    assert about_z == pytest.approx(0.02 * 0.4 * 0.01**2)
    bottle = product("bottle", 0)
    ix, iy, iz = write_assets(bottle, tmp_path).inertia
    assert ix == pytest.approx(iy)
    assert 0 < iz < ix


def test_a_bottles_origin_is_its_centre_of_mass(tmp_path: Path) -> None:
    bottle = product("bottle", 3)
    shapes = write_assets(bottle, tmp_path).collision
    assert sum(s.volume * s.position[2] for s in shapes) == pytest.approx(0, abs=1e-12)
    low = min(s.position[2] - 0.5 * s.size[1] for s in shapes)
    assert low == pytest.approx(-bottle.rest_height)
    assert bottle.rest_height < 0.5 * bottle.extent[2]


def test_files_are_the_same_when_written_again_elsewhere(tmp_path: Path) -> None:
    spec = product("can", 4)
    first, second = (write_assets(spec, tmp_path / name) for name in ("a", "b"))
    assert first.obj_path.read_bytes() == second.obj_path.read_bytes()
    assert first.texture_path.read_bytes() == second.texture_path.read_bytes()
    assert write_assets(spec, tmp_path / "a") == first


def test_prints_have_rows_that_opengl_can_read(tmp_path: Path) -> None:
    for kind in KINDS:
        image = cv2.imread(str(write_assets(product(kind, 2), tmp_path).texture_path))
        assert image.shape[0] % 4 == 0
        assert image.shape[1] % 4 == 0


def test_a_scaled_product_keeps_shape_and_density() -> None:
    small = product("bottle", 4)
    large = small.scaled(1.5)
    assert large.dims == pytest.approx([1.5 * size for size in small.dims], abs=1e-4)
    assert large.mass == pytest.approx(small.mass * 1.5**3, abs=1e-4)
    assert large.name != small.name


def test_wrong_requests_are_refused_by_name() -> None:
    with pytest.raises(UsageError, match="teapot"):
        product("teapot", 1)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="3 positive sizes"):
        ObjectSpec("box", (0.1, 0.1), 0.1, 0, "flat")
    with pytest.raises(UsageError, match="cannot draw"):
        sample_objects(np.random.default_rng(0), 5, ())
