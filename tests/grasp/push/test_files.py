"""Outlines of parts from JSON, SVG, DXF, images and clouds."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasp.push import (
    Outline,
    as_part,
    outline_from_cloud,
    plan_push_grasps,
    read_outline,
)
from grasp.push.inputs.contours import rings_from_image
from grasp.push.inputs.dxf import rings_from_dxf
from grasp.push.inputs.rings import outline_and_holes
from grasp.push.inputs.sources import outline_from_json, without_details
from grasp.push.inputs.svg import rings_from_svg

SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]
FILES = Path(__file__).parent / "files"


def _area(ring: object) -> float:
    return as_part(ring).area  # type: ignore[arg-type]


def _svg_area(text: str) -> float:
    return _area(outline_and_holes(rings_from_svg(text)[0], "SVG")[0])


def _dxf_area(text: str) -> float:
    return _area(outline_and_holes(rings_from_dxf(text).rings, "DXF").outline)


def test_json_gives_outline_and_centre_of_mass(tmp_path: Path) -> None:
    path = tmp_path / "part.json"
    path.write_text(json.dumps({"polygon": SQUARE, "com": [0.9, 0.5]}))
    outline = read_outline(path)
    assert outline.polygon.shape == (4, 2)
    assert outline.com is not None
    assert outline.com.tolist() == [0.9, 0.5]


@pytest.mark.parametrize(
    "text",
    ["{", "{}", "[1, 2]", '{"polygon": [["a", 1]]}', "null", '{"polygon": null}', "3", "[" * 9999],
)
def test_json_that_is_no_part_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "part.json"
    path.write_text(text)
    with pytest.raises(ValueError):
        read_outline(path)


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        ('<polygon points="0,0 2,0 2,1 0,1"/>', 2.0),
        ('<rect x="1" y="2" width="3mm" height="1"/>', 3 * 96 / 25.4),  # a pixel is 1/96 in
        ('<rect width="4" height="2" rx="1"/>', 4 + math.pi),
        ('<rect width="4" height="2" rx="9" ry="1"/>', 2 * math.pi),
        ('<ellipse cx="5" rx="2" ry="1"/>', 2 * math.pi),
        ('<rect transform="scale(2)" width="1" height="1"/>', 4.0),
        ('<rect transform="translate(3,4) rotate(30) scale(2 -1)" width="1" height="1"/>', 2.0),
        ('<rect transform="rotate(45, 9, 9) skewX(30)skewY(0)" width="1" height="1"/>', 1.0),
        ('<rect transform="matrix(2 0 1 3 7 7)" width="1" height="1"/>', 6.0),
        (
            '<g transform="scale(2)"><g transform="scale(3)"><rect width="1" height="1"/></g></g>',
            36.0,
        ),
        ('<path d="m1 1 2 0 0 1-2 0z"/>', 2.0),
        ('<path d="M0 0H4V3zm9 9h1v1h-1z"/>', 6.0),
        ('<path d="m0 0a1 1 0 012 0z"/>', math.pi / 2),
        ('<path d="M0,0c0,1 1,1 1,0s1,-1 1,0v-9h-2z"/>', 18.0),
        ('<path d="M0 0a2 1 90 1 1 0 .0001z"/>', 2 * math.pi),
        (
            '<defs><rect id="a" width="3" height="3"/></defs><use href="#a" transform="scale(2)"/>',
            36,
        ),
        ('<clipPath><rect width="9" height="9"/></clipPath><rect width="1" height="1"/>', 1.0),
        ('<g display="none"><rect width="9" height="9"/></g><rect width="1" height="1"/>', 1.0),
        ('<polygon points=""/><path d="M1 1"/><rect width="1" height="1"/>', 1.0),
        ('<svg x="1"><rect width="50%" height="1"/></svg>', 50.0),
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
    """Curves may be .05 % of the extent off: 1 % of a bow's area."""
    text = f'<svg xmlns="http://www.w3.org/2000/svg">{shape}</svg>'
    assert _svg_area(text) == pytest.approx(area, rel=0.01)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<svg", "no SVG"),
        ("<svg/>", "no closed outline"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><svg/>', "entity"),
        ('<svg><path d="M0 0 L1"/></svg>', "takes 2 numbers"),
        ('<svg><rect transform="scale(2 3 4)" width="1" height="1"/></svg>', "scale of 3 numbers"),
        ('<svg><rect transform="spin(2)" width="1" height="1"/></svg>', "transform"),
        ('<svg><rect transform="scale(2" width="1" height="1"/></svg>', "cannot be read"),
        ('<svg><rect width="1em" height="1"/></svg>', "unit"),
        ('<svg><rect width="wide" height="1"/></svg>', "no length"),
        ('<svg width="9em" viewBox="0 0 1 1"><rect width="1" height="1"/></svg>', "unit"),
        ('<svg><path d="M0 0L1e999 0 1 1z"/></svg>', "out of range"),
        ('<svg><g id="a"><use href="#a"/></g></svg>', "uses"),
        ("<svg>" + "<g>" * 3000 + "</g>" * 3000 + "</svg>", "nested too deeply"),
    ],
)
def test_svg_without_a_part_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        _svg_area(text)


def _dxf(*entities: str) -> str:
    return "\n".join(["0", "SECTION", "2", "ENTITIES", *entities, "0", "ENDSEC", "0", "EOF"])


def _tags(name: str, *pairs: tuple[int, object], layer: str = "0") -> str:
    return "\n".join(["0", name, *(f"{code}\n{value}" for code, value in [(8, layer), *pairs])])


def _box(x: float, y: float, width: float, height: float, layer: str = "0") -> str:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    pairs = [(c, v) for p in corners for c, v in zip((10, 20), p, strict=True)]
    return _tags("LWPOLYLINE", (90, 4), (70, 1), *pairs, layer=layer)


def _layered(layers: dict[str, tuple[int, int]], *entities: str, blocks: str = "") -> str:
    """Return a drawing whose layers have a colour (negative: off) and flags (1: frozen)."""
    table = [
        f"0\nLAYER\n2\n{name}\n70\n{flags}\n62\n{colour}\n6\nCONTINUOUS"
        for name, (colour, flags) in layers.items()
    ]
    head = ["0", "SECTION", "2", "TABLES", "0", "TABLE", "2", "LAYER", "70", str(len(table)),
            *table, "0", "ENDTAB", "0", "ENDSEC"]  # fmt: skip
    inside = ["0", "SECTION", "2", "BLOCKS", blocks, "0", "ENDSEC"] if blocks else []
    return "\n".join([*head, *inside, _dxf(*entities)])


@pytest.mark.slow
def test_dxf_outlines_are_read() -> None:
    poly = _tags("LWPOLYLINE", (90, 4), *((c, v) for p in SQUARE for c, v in zip((10, 20), p)))  # noqa: B905
    assert _dxf_area(_dxf(poly)) == 2.0
    lines = [
        _tags("LINE", (10, p[0]), (20, p[1]), (11, q[0]), (21, q[1]))
        for p, q in zip(SQUARE, SQUARE[1:] + SQUARE[:1], strict=True)
    ]
    assert _dxf_area(_dxf(*lines[::-1])) == 2.0
    old = "\n".join(
        [_tags("POLYLINE", (70, 1)), *(_tags("VERTEX", (10, x), (20, y)) for x, y in SQUARE),
         _tags("SEQEND")]
    )  # fmt: skip
    assert _dxf_area(_dxf(old)) == 2.0
    circle = _tags("CIRCLE", (10, 1), (20, 1), (40, 2))
    assert _dxf_area(_dxf(circle)) == pytest.approx(4 * math.pi, rel=0.01)
    half = _tags("LWPOLYLINE", (70, 1), (10, -1), (20, 0), (42, 1), (10, 1), (20, 0))
    assert _dxf_area(_dxf(half)) == pytest.approx(math.pi / 2, rel=0.01)
    arc = _tags("ARC", (10, 0), (20, 0), (40, 1), (50, 0), (51, 180))
    chord = _tags("LINE", (10, -1), (20, 0), (11, 1), (21, 0))
    assert _dxf_area(_dxf(arc, chord)) == pytest.approx(math.pi / 2, rel=0.01)


@pytest.mark.parametrize(
    "text", ["", "AutoCAD Binary DXF\n1\n2\n3\n", "a\nb\nc\nd", _dxf(), _dxf(_tags("CIRCLE"))]
)
def test_dxf_without_a_part_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        _dxf_area(text)


def test_a_drawing_of_inkscape_is_read_in_its_unit() -> None:
    """Layers and groups with transforms, a clone, relative curves, mm by width and viewBox."""
    outline = read_outline(FILES / "inkscape.svg")
    assert outline.unit == "mm"
    assert outline.polygon.min(axis=0) == pytest.approx([30, -60])
    assert outline.polygon.max(axis=0) == pytest.approx([90, -20])
    assert _area(outline.polygon) == pytest.approx(60 * 40 - 2 * (100 - 25 * math.pi), rel=1e-3)
    assert [_area(hole) for hole in outline.holes] == pytest.approx([36 * math.pi], rel=0.01)
    assert "1 hole" in outline.note


@pytest.mark.parametrize(
    ("name", "unit", "holes"),
    [
        ("plate_r2000", "mm", {"circle": 64 * math.pi, "ellipse": 18 * math.pi, "spline": 33.6}),
        ("plate_r12", "", {"circle": 64 * math.pi, "slot of lines and arcs": 40 + 4 * math.pi}),
    ],
)
def test_drawings_of_ezdxf_are_read(name: str, unit: str, holes: dict[str, float]) -> None:
    """A plate with bulges at its corners; holes also in a block that is turned by 90 degrees."""
    outline = read_outline(FILES / f"{name}.dxf")
    assert outline.unit == unit
    assert _area(outline.polygon) == pytest.approx(6000 - 100 * (4 - math.pi), rel=1e-3)
    assert [_area(h) for h in outline.holes] == pytest.approx(list(holes.values()), rel=0.012)
    assert np.ptp(outline.holes[1], axis=0)[1] > 1.5 * np.ptp(outline.holes[1], axis=0)[0]
    whole = sum(holes.values())
    assert outline.com is not None
    assert outline.com[0] > 50 + 30 * holes["circle"] / 5914 - 20 * 34 / (5914 - whole) - 0.1


def test_open_lines_are_closed_only_where_nothing_else_is() -> None:
    circle = _tags("CIRCLE", (10, 1), (20, 1), (40, 2))
    bracket = _tags("LWPOLYLINE", *((c, v) for p in SQUARE for c, v in zip((10, 20), p)))  # noqa: B905
    long = bracket.replace("2.0", "90.0")
    assert _dxf_area(_dxf(bracket)) == 2.0
    assert _dxf_area(_dxf(bracket, _tags("LWPOLYLINE", (70, 1), (10, 5), (20, 5)))) == 2.0
    assert _dxf_area(_dxf(circle, long)) == pytest.approx(4 * math.pi, rel=0.01)


def test_what_was_drawn_from_below_is_mirrored() -> None:
    below = [(210, 0), (220, 0), (230, -1.0)]
    points = [(10, 0), (20, 0), (10, 1), (20, 0), (10, 0), (20, 1)]
    corner = _tags("LWPOLYLINE", (70, 1), *below, *points)
    assert rings_from_dxf(_dxf(corner)).rings[0].min() == -1.0


@pytest.mark.parametrize(
    ("entities", "words"),
    [
        ([_tags("SPLINE", (71, 3), (40, 0), (10, 1), (20, 1))], "knots"),
        ([_tags("SPLINE", (71, 3))], "without points"),
        ([_tags("LINE", (10, 1))], "y coordinate"),
        ([_tags("CIRCLE", (10, 1), (20, 1))], "CIRCLE without a radius"),
        ([_tags("CIRCLE", (10, "nan"), (20, 1), (40, 2))], "no finite number"),
        ([_tags("LINE", (10, "x"), (20, 1), (11, 1), (21, 1))], "no DXF"),
    ],
)
def test_dxf_entities_that_lack_something_are_refused(entities: list[str], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        rings_from_dxf(_dxf(*entities))


def _read_dxf(tmp_path: Path, text: str) -> Outline:
    path = tmp_path / "part.dxf"
    path.write_text(text)
    return read_outline(path)


@pytest.mark.parametrize(
    "hidden", [(-7, 0), (7, 1), (-7, 1)], ids=["off", "frozen", "off and frozen"]
)
def test_what_lies_on_a_hidden_layer_is_not_the_part(
    tmp_path: Path, hidden: tuple[int, int]
) -> None:
    layers = {"part": (7, 0), "Frame": hidden}
    drawing = _layered(layers, _box(-5, -5, 30, 20, "FRAME"), _box(0, 0, 4, 2, "part"))
    outline = _read_dxf(tmp_path, drawing)
    assert _area(outline.polygon) == 8.0
    assert "1 hidden entity left out" in outline.note
    with pytest.raises(ValueError, match="1 entity on hidden layers left out"):
        _read_dxf(tmp_path, _layered(layers, _box(0, 0, 4, 2, "FRAME")))


def test_invisible_entities_are_not_the_part(tmp_path: Path) -> None:
    frame = _tags("CIRCLE", (60, 1), (10, 0), (20, 0), (40, 99))
    assert _area(_read_dxf(tmp_path, _dxf(frame, _box(0, 0, 4, 2))).polygon) == 8.0


def test_layer_0_of_a_block_is_the_layer_of_its_insert(tmp_path: Path) -> None:
    """The frame, on layer 0 of a block, hides with its insert; what has its own layer does not."""
    begin = _tags("BLOCK", (2, "b"), (70, 0), (10, 0), (20, 0))
    inside = [_box(-5, -5, 30, 20), _box(0, 0, 4, 2, "part")]
    block = "\n".join([begin, *inside, _tags("ENDBLK")])
    insert = _tags("INSERT", (2, "b"), (10, 0), (20, 0), layer="aside")
    seen = _layered({"part": (7, 0), "aside": (7, 0)}, insert, blocks=block)
    off = _layered({"part": (7, 0), "aside": (-7, 0)}, insert, blocks=block)
    frozen = _layered({"part": (7, 0), "aside": (7, 1)}, insert, blocks=block)
    assert _area(_read_dxf(tmp_path, seen).polygon) == 600.0
    assert _area(_read_dxf(tmp_path, off).polygon) == 8.0
    with pytest.raises(ValueError, match="no closed outline"):
        _read_dxf(tmp_path, frozen)


def test_blocks_that_would_grow_without_bound_are_refused(tmp_path: Path) -> None:
    inner = _tags("INSERT", (2, "b"), (10, 0), (20, 0))
    block = "\n".join([_tags("BLOCK", (2, "b"), (70, 0), (10, 0), (20, 0)), inner,
                       _tags("ENDBLK")])  # fmt: skip
    with pytest.raises(ValueError, match="nested"):
        _read_dxf(tmp_path, _layered({"0": (7, 0)}, inner, blocks=block))
    plain = block.replace(inner, _box(0, 0, 4, 2))
    rows = _tags("INSERT", (2, "b"), (10, 0), (20, 0), (70, 30000), (71, 30000), (44, 1), (45, 1))
    with pytest.raises(ValueError, match="inserted more than 1000 times"):
        _read_dxf(tmp_path, _layered({"0": (7, 0)}, rows, blocks=plain))


def test_an_open_outline_is_closed_and_said_to_be(tmp_path: Path) -> None:
    """The way back from (0, 1) to (0, 0) is 1 long."""
    pairs = [(c, v) for p in SQUARE for c, v in zip((10, 20), p, strict=True)]
    outline = _read_dxf(tmp_path, _dxf(_tags("LWPOLYLINE", (90, 4), *pairs)))
    assert _area(outline.polygon) == 2.0
    assert "the outline is open: a straight line of 1 closes it" in outline.note


@pytest.mark.slow
def test_a_second_part_in_a_file_is_said_to_be_left_out(tmp_path: Path) -> None:
    """Also one of the same size; marks beside the part are none."""
    two = _dxf(_box(0, 0, 4, 2), _box(9, 0, 4, 2), _box(6, 0, 0.1, 0.1))
    assert "another part was left out" in _read_dxf(tmp_path, two).note
    svg = tmp_path / "part.svg"
    boxes = "".join(f'<rect x="{9 * k}" width="{4 - k}" height="2"/>' for k in range(3))
    svg.write_text(f'<svg>{boxes}<rect x="10" y=".5" width="1" height="1"/></svg>')
    assert "2 other parts were left out" in read_outline(svg).note
    image = np.full((200, 300), 235, np.uint8)
    cv2.rectangle(image, (20, 50), (149, 149), 30, -1)
    cv2.rectangle(image, (200, 50), (249, 99), 30, -1)
    cv2.rectangle(image, (280, 180), (282, 182), 30, -1)
    cv2.imwrite(str(tmp_path / "part.png"), image)
    assert "another part was left out" in read_outline(tmp_path / "part.png").note
    svg.write_text(
        '<svg><rect width="4" height="2"/><rect x="1" y=".5" width="1" height="1"/></svg>'
    )
    assert "left out" not in read_outline(svg).note


def test_each_part_of_a_file_can_be_planned(tmp_path: Path) -> None:
    """The second one comes with its own hole, and no third one is invented."""
    path = tmp_path / "parts.svg"
    path.write_text(
        '<svg><rect width="4" height="2"/><rect x="1" y=".5" width="1" height="1"/>'
        '<rect x="9" width="3" height="2"/><rect x="10" y=".5" width="1" height="1"/></svg>'
    )
    first, second = (read_outline(path, part=k) for k in (1, 2))
    assert [_area(one.polygon) for one in (first, second)] == [8.0, 6.0]
    assert [len(one.holes) for one in (first, second)] == [1, 1]
    assert second.holes[0][:, 0].min() == 10.0
    assert "another part was left out: this is part 2 of 2 by size" in second.note
    with pytest.raises(ValueError, match="part 3: there are 2 parts in this SVG"):
        read_outline(path, part=3)
    plain = tmp_path / "part.json"
    plain.write_text("[[0, 0], [4, 0], [4, 1]]")
    with pytest.raises(ValueError, match=r"part 2: a file .json holds one part"):
        read_outline(plain, part=2)


# Holes


@pytest.mark.slow
def test_holes_move_the_centre_of_mass_and_nothing_else(tmp_path: Path) -> None:
    """A plate 4 x 2 with a square hole of area 1 at (3, 1): (8 * 2 - 3) / 7."""
    hole = [[2.5, 0.5], [2.5, 1.5], [3.5, 1.5], [3.5, 0.5]]
    plate = [[0, 0], [4, 0], [4, 2], [0, 2]]
    path = tmp_path / "part.json"
    path.write_text(json.dumps({"polygon": plate, "holes": [hole]}))
    outline = read_outline(path)
    assert outline.com == pytest.approx([13 / 7, 1.0])
    assert outline.polygon.tolist() == plate
    svg = tmp_path / "part.svg"
    svg.write_text(
        '<svg><path d="M0 0H4V2H0zM2.5 .5v1h1v-1z"/><circle cx="3" cy="1" r=".1"/></svg>'
    )
    drawn = read_outline(svg)
    assert drawn.com == pytest.approx([13 / 7, -1.0])
    assert len(drawn.holes) == 1  # what lies in a hole is none
    with_holes = plan_push_grasps(outline.polygon, outline.com, jaw_width=0.5, samples=20)
    without = plan_push_grasps(outline.polygon, jaw_width=0.5, samples=20)
    assert np.array_equal(with_holes.grasps.contacts, without.grasps.contacts)
    assert not np.array_equal(with_holes.analysis.counts, without.analysis.counts)


def test_a_given_centre_of_mass_counts_more_than_holes() -> None:
    text = '{"polygon": [[0,0],[4,0],[4,2],[0,2]], "com": [2, 1], "holes": [[[1,1],[2,1],[2,1.5]]]}'
    _, com, holes = outline_from_json(text)
    assert com is not None
    assert com.tolist() == [2.0, 1.0]
    assert len(holes) == 1


@pytest.mark.parametrize(
    ("holes", "words"),
    [
        ([[[3, 1], [5, 1], [5, 1.5]]], "inside the outline"),
        ([[[1, 1], [2, 1], [2, 1.5]], [[1.5, 1.1], [1.9, 1.1], [1.9, 1.2]]], "apart"),
        ([[[1, 1], [2, 1.5], [2, 1], [1, 1.5]]], "crosses itself"),
        ([[[1, 1]]], "three different"),
        (3, "list"),
    ],
)
def test_holes_that_make_no_sense_are_refused(holes: object, words: str) -> None:
    plate = [[0, 0], [4, 0], [4, 2], [0, 2]]
    with pytest.raises(ValueError, match=words):
        outline_from_json(json.dumps({"polygon": plate, "holes": holes}))


def test_an_outline_drawn_twice_is_no_hole() -> None:
    rings = [np.array(SQUARE), np.array(SQUARE) * 0.999 + 0.0005]
    assert outline_and_holes(rings, "drawing")[1] == ()


def test_an_image_shows_its_holes() -> None:
    image = np.full((200, 300), 235, np.uint8)
    cv2.rectangle(image, (50, 50), (249, 149), 30, -1)
    cv2.circle(image, (200, 100), 20, 235, -1)
    outline, holes, _ = outline_and_holes(rings_from_image(image), "image")
    assert _area(outline) == pytest.approx(20_000, rel=0.03)
    assert [_area(hole) for hole in holes] == pytest.approx([400 * math.pi], rel=0.1)


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
        rings_from_image(np.full((50, 50), 128, np.uint8))
    with pytest.raises(ValueError, match="no image"):
        rings_from_image(b"PNG")


def test_parts_of_one_pixels_width_do_not_make_an_outline_touch_itself() -> None:
    image = np.full((120, 260), 235, np.uint8)
    cv2.rectangle(image, (20, 20), (109, 99), 30, -1)
    cv2.rectangle(image, (140, 30), (219, 89), 30, -1)
    cv2.line(image, (110, 40), (139, 69), 30, 1)  # a neck whose pixels meet at their corners
    cv2.line(image, (220, 50), (235, 50), 30, 1)  # a wire
    ring = rings_from_image(image)[0]
    part = as_part(ring)
    assert part.area == pytest.approx(90 * 80 + 80 * 60, rel=0.03)
    assert np.allclose(part.vertices[:, 0].min(), 20, atol=1)
    assert np.allclose(part.vertices[:, 0].max(), 235, atol=1)
    assert as_part(without_details(Outline(ring, read=len(ring))).polygon).area > 10_000


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
