"""Aligned comparison of two views: where their print agrees, cell by cell, and where it does not.

The number of matches that agree cannot tell a look-alike from the object: another flavour of one
brand agrees in thirty places. What tells is what does not agree between them. The stored view is
laid over the query; in a grid of cells the grey values are compared by normalised cross
correlation (blind to brightness and contrast) and the colours by their distance in Lab, after the
difference of light was taken out where the print agrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.imaging.exposure import has_colours
from features.recognition.comparison.rendering import rendered_gap
from features.recognition.comparison.windows import WindowMeans, flow_targets, window_means
from features.recognition.views.picture import ViewPicture

__all__ = ["Comparison", "ComparisonParams", "compare_pictures"]

Mask = NDArray[np.bool_]

_SAME_PRINT, _SAME_COLOUR = 0.45, 15.0
"""Cells of one print correlate by more, and differ by fewer Lab units in colour."""
_FEW_AGREEING = 4


@dataclass(frozen=True)
class ComparisonParams:
    """Constants of the comparison; lengths in px of the pictures.

    Parameters
    ----------
    cell_px, window_px
        Step of the grid and side of the window that is compared around each cell's centre.
    grey_sigma_px
        Of the smoothing before grey values are compared.
    flow_sigma_px, max_flow_px
        Smoothing and bound of the residual shift that is taken out first: packages bulge.
    noise_variance
        Added to the variance of both windows.
    textured_variance
        A window of less contrast on both sides is blank.
    agreeing
        Correlation from which a cell takes part in the white balance.
    max_tint, max_shift
        Bounds of the white balance, of red and blue over green and then in Lab units: it must not
        turn red print into green.
    reach
        Cells within so many times the extent of the matches belong to the comparison.
    min_cover
        Share of a window that both pictures must show.
    min_framed, min_spanned
        Shares of the second object that the first picture must show, and the matches span, for
        what surrounds them there to be taken for the surroundings of the object.
    """

    cell_px: int = 8
    window_px: int = 15
    grey_sigma_px: float = 1.2
    flow_sigma_px: float = 6.0
    max_flow_px: float = 6.0
    noise_variance: float = 25.0
    textured_variance: float = 100.0
    agreeing: float = 0.5
    max_tint: float = 1.4
    max_shift: float = 6.0
    reach: float = 3.0
    min_cover: float = 0.6
    min_framed: float = 0.95
    min_spanned: float = 0.3


@dataclass(frozen=True, eq=False)
class Comparison:
    """Agreement of two pictures over a grid of the first one's cells, (rows, columns) each.

    Parameters
    ----------
    correlation : float32
        Of the grey values, -1 to 1.
    colour_gap, rendered_gap : float32
        Distance of the colours, Lab units, and what is left of it if a camera's rendering of
        colours is taken out too.
    textured : bool
        The print of either side has contrast here.
    between : bool
        Both show the object here, and it lies between the matches (in their convex hull).
    near : bool
        Both show the object here, within reach of the matches.
    view_cell : (rows, columns) intp
        The same place in the second picture's grid, as an index into its flattened cells; -1
        where it does not show it.
    extent
        Square root of the area between the matches, of the longer side of the first object.
    framed_extent
        The same of the second object, where the first picture shows all of it and the matches
        span most of it; 0 elsewhere.
    comparable_colours
        Both pictures show colours, or neither does: else other colours are no place that differs.
    """

    correlation: NDArray[np.float32]
    colour_gap: NDArray[np.float32]
    rendered_gap: NDArray[np.float32]
    textured: Mask
    between: Mask
    near: Mask
    view_cell: NDArray[np.intp]
    extent: float
    framed_extent: float = 0.0
    comparable_colours: bool = True

    @property
    def agrees(self) -> Mask:
        """Return the cells that show the same print, or none on either side, in the same colour."""
        is_alike = (self.correlation > _SAME_PRINT) | ~self.textured
        return is_alike & (self.colour_gap < _SAME_COLOUR)


def grid_shape(shape: tuple[int, ...], params: ComparisonParams) -> tuple[int, int]:
    """Return the rows and columns of cells of a picture."""
    step = params.cell_px
    return -(-shape[0] // step), -(-shape[1] // step)


def compare_pictures(
    query: ViewPicture,
    view: ViewPicture,
    query_from_view: NDArray[np.float64],
    places: NDArray[np.float32],
    params: ComparisonParams | None = None,
) -> Comparison:
    """Lay a stored view's picture over the query's and compare them.

    Parameters
    ----------
    query_from_view : (3, 3) float64, px of the images that the pictures were taken from
    places : (n, 2) float32, px of the query's image
        Where matches agree.
    """
    params = params or ComparisonParams()
    matrix = query.picture_from_image @ query_from_view @ np.linalg.inv(view.picture_from_image)
    height, width = query.mask.shape
    warped, cover = _warped(view, matrix, (width, height))
    cover &= query.mask
    grey, other, moved = _brought_together(query.rgb, warped, params)
    rows, columns = (np.arange(n) * params.cell_px for n in grid_shape((height, width), params))
    # Centres of cells; a cell at the border is compared as far as the picture goes.
    at = np.ix_(
        np.minimum(rows + params.cell_px // 2, height - 1),
        np.minimum(columns + params.cell_px // 2, width - 1),
    )
    means = window_means((grey, other), (query.rgb, moved), cover, at, params.window_px)
    correlation, variance = _correlation(means, params)
    valid = (means.share > params.min_cover) & cover[at]
    hull = _hull(query, places)
    between = valid & _inside(hull, 1.0, (height, width))[at]
    near = valid & _inside(hull, params.reach, (height, width))[at]
    gap, rendered = _colour_gaps(means, between & (correlation > params.agreeing), params)
    return Comparison(
        correlation=correlation.astype(np.float32),
        colour_gap=gap.astype(np.float32),
        rendered_gap=rendered.astype(np.float32),
        textured=valid & (variance > params.textured_variance),
        between=between,
        near=near,
        view_cell=_view_cells(view, matrix, at, near, params),
        extent=_extent(hull, query),
        framed_extent=_framed_extent(hull, view, matrix, (width, height), params),
        comparable_colours=has_colours(query.rgb) == has_colours(view.rgb),
    )


def _warped(
    view: ViewPicture, matrix: NDArray[np.float64], size: tuple[int, int]
) -> tuple[UInt8Array, Mask]:
    """Return the stored picture and its mask as the query's camera would see them."""
    image = cv2.warpPerspective(view.rgb, matrix, size, borderMode=cv2.BORDER_REPLICATE)
    cover = cv2.warpPerspective(view.mask.view(np.uint8), matrix, size)
    back = np.asarray(np.linalg.inv(matrix), np.float64)
    return np.asarray(image, np.uint8), (cover > 0) & _before_horizon(back, size)


def _before_horizon(back: NDArray[np.float64], size: tuple[int, int]) -> Mask:
    """Return the pixels (h, w), or (1, 1) for all of them, before the horizon of a map's inverse.

    What lies behind it comes out mirrored: it is not shown.
    """
    width, height = size

    def weight(u: NDArray[np.intp], v: NDArray[np.intp]) -> NDArray[np.float64]:
        across: NDArray[np.float64] = back[2, 0] * u + back[2, 1] * v[:, None] + back[2, 2]
        return across

    side = np.sign(weight(np.array([width // 2]), np.array([height // 2]))[0, 0])
    # Products and sums stay in order when they are rounded: none is less than at the corners.
    corners = weight(np.array([0, width - 1]), np.array([0, height - 1])) * side
    if corners.min() > 0:
        return np.ones((1, 1), bool)
    before: Mask = weight(np.arange(width), np.arange(height)) * side > 0
    return before


def _brought_together(
    rgb: UInt8Array, warped: UInt8Array, params: ComparisonParams
) -> tuple[UInt8Array, UInt8Array, UInt8Array]:
    """Return both grey images, and the second one's colours, without the residual shift."""
    sigma = params.grey_sigma_px
    grey, other = (
        np.asarray(
            cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), sigma), np.uint8
        )
        for image in (rgb, warped)
    )
    if min(grey.shape) >= 24:
        flow = cv2.GaussianBlur(_residual_flow(grey, other), (0, 0), params.flow_sigma_px)
        at_u, at_v = flow_targets(np.asarray(flow, np.float32), np.float32(params.max_flow_px))
        way = cv2.INTER_LINEAR
        other, warped = (
            np.asarray(cv2.remap(image, at_u, at_v, way, borderMode=cv2.BORDER_REPLICATE), np.uint8)
            for image in (other, warped)
        )
    return grey, other, warped


def _residual_flow(grey: UInt8Array, other: UInt8Array) -> NDArray[np.float32]:
    """Return the shift (h, w, 2) of the second image against the first, px."""
    height, width = grey.shape
    # OpenCV chooses the coarsest level by the width alone, and crashes where the height has no
    # room for a patch of 8 px on it (opencv/opencv_contrib#1355).
    rows = max(width // 2 - height, 0)
    first, second = (
        np.asarray(cv2.copyMakeBorder(image, 0, rows, 0, 0, cv2.BORDER_REPLICATE))
        for image in (grey, other)
    )
    solver = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)
    flow = solver.calc(first, second, np.zeros((*first.shape, 2), np.float32))
    return np.asarray(flow[:height], np.float32)


def _correlation(
    means: WindowMeans, params: ComparisonParams
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return correlation and the larger variance of every cell's window."""
    scale = 1 / np.maximum(means.share, 1e-3)
    mean_a, mean_b = means.first * scale, means.second * scale
    var_a = np.maximum(means.first_square * scale - mean_a**2, 0)
    var_b = np.maximum(means.second_square * scale - mean_b**2, 0)
    covariance = means.product * scale - mean_a * mean_b
    noise = np.float32(params.noise_variance)
    correlation = covariance / np.sqrt((var_a + noise) * (var_b + noise))
    contrast = np.maximum(var_a, var_b)
    return np.asarray(correlation, np.float32), np.asarray(contrast, np.float32)


def _colour_gaps(
    means: WindowMeans, agreeing: Mask, params: ComparisonParams
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the distance of the mean colours (a, b of Lab) of every cell, and the rendered one.

    Another light multiplies the channels (von Kries); what is left of it after that, and of the
    camera's own correction, is a shift.
    """
    share = np.maximum(means.share, 1e-3)[..., None]
    here, there = means.first_rgb / share, means.second_rgb / share
    if np.count_nonzero(agreeing) >= _FEW_AGREEING:
        gains = np.median((here[agreeing] + 5) / (there[agreeing] + 5), axis=0)
        green = np.clip(gains[1], 0.4, 2.5)
        tint = np.clip(gains / gains[1], 1 / params.max_tint, params.max_tint)
        there = np.clip(there * green * tint, 0, 255)
    seen, stored = _lab(here), _lab(there)
    difference = seen - stored
    if np.count_nonzero(agreeing) >= _FEW_AGREEING:
        shift = np.median(difference[agreeing], axis=0)
        difference -= np.clip(shift, -params.max_shift, params.max_shift)
    gap: NDArray[np.float32] = np.hypot(difference[..., 0], difference[..., 1])
    rendered = rendered_gap(seen, stored, agreeing)
    return gap, gap if rendered is None else rendered


def _lab(rgb: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return a and b of Lab of colours in 0..255."""
    lab = cv2.cvtColor((rgb / 255).astype(np.float32), cv2.COLOR_RGB2LAB)
    return np.asarray(lab, np.float32)[..., 1:]


def _hull(query: ViewPicture, places: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the convex hull (k, 2) of places, in px of the picture."""
    to_picture = query.picture_from_image
    moved = places.astype(np.float64) @ to_picture[:2, :2].T + to_picture[:2, 2]
    return np.asarray(cv2.convexHull(moved.astype(np.float32)), np.float32).reshape(-1, 2)


def _inside(hull: NDArray[np.float32], times: float, shape: tuple[int, int]) -> Mask:
    """Return the pixels inside a hull that was enlarged about its middle."""
    middle = hull.mean(axis=0)
    corners = np.clip(middle + (hull - middle) * times, -4096, 4096)
    filled = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(filled, np.rint(corners).astype(np.int32), 1)
    return filled > 0


def _extent(hull: NDArray[np.float32], query: ViewPicture) -> float:
    longer = max(query.mask.shape)
    return float(np.sqrt(max(cv2.contourArea(hull), 0.0)) / longer)


def _framed_extent(
    hull: NDArray[np.float32],
    view: ViewPicture,
    matrix: NDArray[np.float64],
    size: tuple[int, int],
    params: ComparisonParams,
) -> float:
    """Return the extent of the matches on the second object, if the first picture frames it.

    A picture of a cover with the desk around it shows a small print in its middle. What is missing
    around the matches is desk there, and no part of a sibling: the stored view ends before.
    """
    contours, _ = cv2.findContours(
        view.mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    back = np.asarray(np.linalg.inv(matrix), np.float64)
    if not contours or not _before_horizon(back, size).all():
        return 0.0
    outline = np.concatenate(contours).astype(np.float64)
    shown = cv2.perspectiveTransform(outline, matrix)[:, 0]
    inside = ((shown >= 0) & (shown <= np.subtract(size, 1))).all(axis=1)
    spanned = cv2.contourArea(
        cv2.perspectiveTransform(hull[:, None].astype(np.float64), back).astype(np.float32)
    )
    if inside.mean() < params.min_framed or spanned < params.min_spanned * view.mask.sum():
        return 0.0
    return float(np.sqrt(spanned) / max(view.mask.shape))


def _view_cells(
    view: ViewPicture,
    matrix: NDArray[np.float64],
    at: tuple[NDArray[np.intp], ...],
    shown: Mask,
    params: ComparisonParams,
) -> NDArray[np.intp]:
    """Return the cell of the stored picture that each cell of the query shows."""
    back = np.linalg.inv(matrix)
    v, u = (grid.astype(np.float64) for grid in np.broadcast_arrays(*at))
    weight = back[2, 0] * u + back[2, 1] * v + back[2, 2]
    weight = np.where(np.abs(weight) < 1e-9, 1e-9, weight)
    x = (back[0, 0] * u + back[0, 1] * v + back[0, 2]) / weight
    y = (back[1, 0] * u + back[1, 1] * v + back[1, 2]) / weight
    height, width = view.mask.shape
    seen = shown & (x >= -0.5) & (y >= -0.5) & (x < width - 0.5) & (y < height - 0.5)
    columns = grid_shape((height, width), params)[1]
    row = np.where(seen, np.rint(y), 0).astype(np.intp) // params.cell_px
    column = np.where(seen, np.rint(x), 0).astype(np.intp) // params.cell_px
    return np.where(seen, row * columns + column, -1)
