"""Parts from files, and every bad input: refused with words, never a wrong answer."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasp.push import (
    Elimination,
    PushTest,
    Tolerance,
    as_part,
    as_polygon,
    open_executor,
    outline_from_cloud,
    plan_push_grasps,
    read_outline,
    sample_grasps,
    simplify,
)
from grasp.push.dxf import outline_from_dxf
from grasp.push.sources import outline_from_image, outline_from_json
from grasp.push.svg import outline_from_svg as from_svg

SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]


def _area(ring: object) -> float:
    return as_part(ring).area  # type: ignore[arg-type]


# Polygons


def test_clockwise_outlines_are_turned_round() -> None:
    assert _area(SQUARE[::-1]) == 2.0


def test_repeated_vertices_are_one_vertex() -> None:
    doubled = [p for p in SQUARE for _ in range(3)] + SQUARE[:1]
    assert as_polygon(doubled).tolist() == as_polygon(SQUARE).tolist()


@pytest.mark.parametrize(
    ("ring", "words"),
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], r"crosses itself: edge 0 \(0-1\) and edge 2 \(2-3\)"),
        ([(0, 0), (2, 0), (1, 0), (1, 1)], "touches or crosses itself"),
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "touches or crosses itself"),
        ([(0, 0), (1, 1), (2, 2), (3, 3)], "collinear"),
        ([(0, 0), (1, 0)], "three different vertices, got 2"),
        ([(0, 0), (0, 0), (0, 0)], "three different vertices, got 1"),
        ([(0, 0), (1, 0), (math.nan, 1)], "vertex 2 of the polygon is not finite"),
        ([(0, 0), (math.inf, 0), (0, 1)], "not finite"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], r"shape \(n, 2\)"),
        ([(0, 0), (1e200, 0), (0, 1e200)], "out of range"),
        ("part", "array"),
        ([], "shape"),
    ],
)
def test_outlines_that_are_no_polygon_are_refused(ring: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        as_polygon(ring)  # type: ignore[arg-type]


def test_a_part_of_ten_thousand_vertices_is_simplified_or_refused() -> None:
    angle = np.linspace(0, 2 * np.pi, 10_000, endpoint=False)
    radius = 1 + 0.3 * np.cos(5 * angle)
    star = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    assert _area(star) == pytest.approx(np.pi * 1.045, rel=1e-3)
    with pytest.raises(ValueError, match="simplify it first"):
        plan_push_grasps(star, jaw_width=0.3)
    small = simplify(star, 60)
    assert len(small) <= 60
    assert _area(small) == pytest.approx(_area(star), rel=0.02)
    assert plan_push_grasps(small, jaw_width=0.3, samples=5).analysis.evaluations > 0


# Numbers


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"friction": -0.1}, "friction must be at least 0"),
        ({"friction": math.nan}, "friction"),
        ({"jaw_width": 0.0}, "jaw_width must be positive"),
        ({"jaw_width": math.inf}, "jaw_width must be positive"),
        ({"vertex_std": -1.0}, "at least 0"),
        ({"vertex_std": [0.1, 0.1]}, "one for each of the 4 vertices"),
        ({"com_std": math.nan}, "finite"),
        ({"com": (math.nan, 0)}, "two finite numbers"),
        ({"samples": 0}, "samples must be at least 1"),
        ({"angles": 4}, "odd"),
        ({"density": 0.0}, "density must be positive"),
        ({"density": 1e9}, "too many"),
        ({"filter_distance": -1.0}, "filter_distance"),
        ({"max_angle_deg": 100.0}, "max_angle_deg"),
        ({"max_opening": 0.3}, "bigger than the gripper's stroke: at least 1 between"),
        ({"max_opening": -1.0}, "max_opening must be positive"),
        ({"method": "guess"}, "method is bound or simulation"),
        ({"closure": "any"}, "closure is strict or nguyen"),
        ({"stop": True, "elimination": Elimination((5, 5), 0.5)}, "exclude each other"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        plan_push_grasps(SQUARE, **{"jaw_width": 0.5, **change})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "call",
    [
        lambda: Elimination((), 0.5),
        lambda: Elimination((5,), 1.0),
        lambda: PushTest(1.0, step=1.0),
        lambda: open_executor("cluster"),  # type: ignore[arg-type]
        lambda: open_executor("threads", -1),
    ],
)
def test_settings_that_make_no_sense_are_refused(call) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError):
        call()


@pytest.mark.parametrize("method", ["bound", "simulation"])
@pytest.mark.parametrize(
    "change",
    [
        {"jaw_width": 50.0},  # wider than the part
        {"friction": 0.0},
        {"friction": 2.0},
        {"vertex_std": 0.0, "com_std": 0.0},
        {"com": (9.0, 9.0)},  # outside
        {"samples": 1, "density": 0.01, "angles": 1},
        {"pose_std": (0.1, 0.2)},
        {"vertex_std": [0.0, 0.1, 0.0, 0.1]},
    ],
)
def test_extremes_give_numbers_without_warnings(change: dict[str, object], method: str) -> None:
    given = {"jaw_width": 0.5, "samples": 4, "method": method, **change}
    plan = plan_push_grasps(SQUARE, **given)  # type: ignore[arg-type]
    quality = plan.analysis.quality
    assert np.all((quality >= 0) & (quality <= 1))
    if "com" in change and method == "bound":
        assert plan.quality == 0.0


def test_a_needle_is_planned_on() -> None:
    plan = plan_push_grasps([(0, 0), (10, 0), (5, 1e-4)], jaw_width=1.0, samples=20)
    assert np.all(np.isfinite(plan.analysis.quality))


def test_the_stroke_leaves_out_what_does_not_fit() -> None:
    plan = plan_push_grasps(SQUARE, jaw_width=0.5, max_opening=1.3, vertex_std=0.01)
    assert 0 < len(plan.grasps) < 30
    assert plan.openings.max() <= 1.3
    assert len(sample_grasps(as_part(SQUARE))) == 30


def test_tolerances_are_explicit_standard_deviations() -> None:
    part = as_part(SQUARE)
    usual, pixels = Tolerance.default(part), Tolerance.variance_px(part)
    assert usual.vertex_std == pytest.approx(pixels.vertex_std, rel=0.01)
    assert usual.com_std == pytest.approx(pixels.com_std, rel=0.01)


# Files


def test_json_gives_outline_and_centre_of_mass(tmp_path: Path) -> None:
    path = tmp_path / "part.json"
    path.write_text(json.dumps({"polygon": SQUARE, "com": [0.9, 0.5]}))
    outline = read_outline(path)
    assert outline.polygon.shape == (4, 2)
    assert outline.com is not None
    assert outline.com.tolist() == [0.9, 0.5]


@pytest.mark.parametrize("text", ["{", "{}", "[1, 2]", '{"polygon": [["a", 1]]}', "null"])
def test_json_that_is_no_part_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        as_polygon(outline_from_json(text)[0])


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        ('<polygon points="0,0 2,0 2,1 0,1"/>', 2.0),
        ('<rect x="1" y="2" width="3mm" height="1"/>', 3.0),
        ('<circle cx="0" cy="0" r="2"/>', math.pi * 4),
        ('<path d="M0 0h2v1h-2z"/>', 2.0),
        ('<path d="M 0,0 L 2 0 2 1 0 1 Z"/>', 2.0),
        ('<path d="M-1,0 A1,1 0 0 1 1,0 L1,1 L-1,1 Z"/>', 2 + math.pi / 2),
        ('<path d="M0 0 C0 1 1 1 1 0 Z"/>', 0.6),
        ('<path d="M0 0 Q1 2 2 0 Z"/>', 4 / 3),
        ('<path d="M0 0 Q1 2 2 0 T4 0 L4 -3 L0 -3 Z"/>', 12.0),
        ('<rect width="1" height="1"/><g><rect width="5" height="1"/></g>', 5.0),
    ],
)
def test_svg_shapes_are_read(shape: str, area: float) -> None:
    """Curves are chords of a sixteenth: .5 % of the area of a bow."""
    text = f'<svg xmlns="http://www.w3.org/2000/svg">{shape}</svg>'
    assert _area(from_svg(text)) == pytest.approx(area, rel=0.01)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<svg", "no SVG"),
        ("<svg/>", "no closed outline"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><svg/>', "entity"),
        ('<svg><path d="M0 0 L1"/></svg>', "takes 2 numbers"),
        ('<svg><rect transform="scale(2)" width="1" height="1"/></svg>', "transform"),
    ],
)
def test_svg_without_a_part_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        from_svg(text)


def _dxf(*entities: str) -> str:
    return "\n".join(["0", "SECTION", "2", "ENTITIES", *entities, "0", "ENDSEC", "0", "EOF"])


def _tags(name: str, *pairs: tuple[int, object]) -> str:
    return "\n".join(["0", name, *(f"{code}\n{value}" for code, value in pairs)])


def test_dxf_outlines_are_read() -> None:
    poly = _tags("LWPOLYLINE", (90, 4), *((c, v) for p in SQUARE for c, v in zip((10, 20), p)))  # noqa: B905
    assert _area(outline_from_dxf(_dxf(poly))) == 2.0
    lines = [
        _tags("LINE", (10, p[0]), (20, p[1]), (11, q[0]), (21, q[1]))
        for p, q in zip(SQUARE, SQUARE[1:] + SQUARE[:1], strict=True)
    ]
    assert _area(outline_from_dxf(_dxf(*lines[::-1]))) == 2.0
    old = "\n".join(
        [_tags("POLYLINE", (70, 1)), *(_tags("VERTEX", (10, x), (20, y)) for x, y in SQUARE),
         _tags("SEQEND")]
    )  # fmt: skip
    assert _area(outline_from_dxf(_dxf(old))) == 2.0
    circle = _tags("CIRCLE", (10, 1), (20, 1), (40, 2))
    assert _area(outline_from_dxf(_dxf(circle))) == pytest.approx(4 * math.pi, rel=0.01)
    half = _tags("LWPOLYLINE", (10, -1), (20, 0), (42, 1), (10, 1), (20, 0))
    assert _area(outline_from_dxf(_dxf(half))) == pytest.approx(math.pi / 2, rel=0.01)
    arc = _tags("ARC", (10, 0), (20, 0), (40, 1), (50, 0), (51, 180))
    chord = _tags("LINE", (10, -1), (20, 0), (11, 1), (21, 0))
    assert _area(outline_from_dxf(_dxf(arc, chord))) == pytest.approx(math.pi / 2, rel=0.01)


@pytest.mark.parametrize(
    "text", ["", "AutoCAD Binary DXF\n1\n2\n3\n", "a\nb\nc\nd", _dxf(), _dxf(_tags("CIRCLE"))]
)
def test_dxf_without_a_part_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        outline_from_dxf(text)


def test_the_contour_of_an_image_is_the_part(tmp_path: Path) -> None:
    image = np.full((200, 300, 3), 235, np.uint8)
    cv2.fillPoly(image, [np.array([(50, 50), (250, 50), (250, 100), (120, 100), (120, 160),
                                   (50, 160)])], (40, 60, 90))  # fmt: skip
    path = tmp_path / "part.png"
    cv2.imwrite(str(path), image)
    outline = read_outline(path, 16)
    assert outline.note.startswith("simplified from")
    part = as_part(outline.polygon)
    assert part.area == pytest.approx(200 * 50 + 70 * 60, rel=0.03)
    assert part.centroid[1] < 0  # y upwards
    with pytest.raises(ValueError, match="nothing stands out"):
        outline_from_image(np.full((50, 50), 128, np.uint8))
    with pytest.raises(ValueError, match="no image"):
        outline_from_image(b"PNG")


def test_the_footprint_of_a_cloud_is_the_part(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    flat = rng.uniform(0, 0.1, (20_000, 2))
    flat = flat[(flat[:, 0] < 0.03) | (flat[:, 1] < 0.03)]  # an L, 10 cm
    cloud = np.column_stack([flat, rng.uniform(0, 0.04, len(flat))])
    ring, height = outline_from_cloud(cloud)
    assert as_part(ring).area == pytest.approx(0.0051, rel=0.12)
    assert height == pytest.approx(0.04, abs=0.002)
    path = tmp_path / "object.npy"
    np.save(path, cloud)
    assert as_part(read_outline(path).polygon).area == pytest.approx(0.0051, rel=0.12)


@pytest.mark.parametrize(
    ("cloud", "words"),
    [
        (np.zeros((1, 3)), "ten finite points, got 1"),
        (np.full((50, 3), np.nan), "ten finite points, got 0"),
        (np.zeros((50, 3)), "line"),
        (np.column_stack([np.linspace(0, 1, 50)] * 2 + [np.zeros(50)]), "line"),
        (np.zeros((50, 2)), "shape"),
    ],
)
def test_clouds_without_a_footprint_are_refused(cloud: np.ndarray, words: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(ValueError, match=words):
        outline_from_cloud(cloud)


def test_a_cloud_of_one_level_plane_has_a_footprint_without_height() -> None:
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 40)), -1).reshape(-1, 2)
    ring, height = outline_from_cloud(np.column_stack([grid, np.zeros(len(grid))]))
    assert height == 0.0
    assert as_part(ring).area == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("name", ["part.txt", "cloud.npy", "cloud.xyz", "image.png"])
def test_files_of_another_kind_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"\x00\x01nothing")
    with pytest.raises(ValueError):
        read_outline(path)
