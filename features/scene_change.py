"""Selection of the camera frames worth sending: those that show a change of the scene.

Gatto 2016, 3.2.1 culls frames by the entropy of sequential ones and sends a frame only when the
variation passes a threshold, after Beksi and Papanikolopoulos. Here, in the spirit of that: the
image is cut into blocks, and the distributions of depth and of brightness in each block are
compared with those of the last frame *sent* by their Jensen-Shannon divergence, which is 0 bit for
equal and 1 bit for disjoint ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from features.geometry import FloatArray, Frame, UInt8Array

__all__ = ["SceneChange", "SceneChangeGate", "SceneChangeParams", "warm_up"]

BLOCK_PX = 20
_GREY_BINS = 8
_MAX_BINS = 1_024
_COMPARABLE, _EMPTY, _FULL = 0.25, 0.10, 0.60


@dataclass(frozen=True)
class SceneChangeParams:
    """Thresholds above which a frame counts as new.

    Parameters
    ----------
    depth_bits, colour_bits
        Divergence of the second most changed block above which a frame is sent. Brightness is held
        to less, for lamps flicker.
    max_age_s
        A frame is sent after so long anyway.
    moved_m
        A segment's centroid that moved this far counts as a change.
    """

    depth_bits: float = 0.07
    colour_bits: float = 0.15
    max_age_s: float = 10.0
    moved_m: float = 0.01

    def __post_init__(self) -> None:
        for name in ("depth_bits", "colour_bits", "max_age_s", "moved_m"):
            value = getattr(self, name)
            if not value > 0:
                raise ValueError(f"{name} must be positive, got {value}")


@dataclass(frozen=True)
class SceneChange:
    """Result of comparing a frame with the last one sent.

    Parameters
    ----------
    send
        Whether it is worth sending.
    reason
        ``first``, ``forced``, ``camera``, ``depth``, ``colour``, ``segments``, ``age`` or
        ``unchanged``.
    depth_change, colour_change
        Divergence of the second most changed block, bit: one bad block is noise. NaN when there was
        nothing to compare with.
    """

    send: bool
    reason: str
    depth_change: float = float("nan")
    colour_change: float = float("nan")


@dataclass(frozen=True)
class _Key:
    """The last frame sent."""

    frame: Frame
    grey: UInt8Array | None
    stamp_s: float
    centroids: FloatArray | None


class SceneChangeGate:
    """Decides frame by frame; what it compares with is the last frame that it let through.

    A slow drift adds up for that reason, and is sent in the end.

    Examples
    --------
    >>> import numpy as np
    >>> from features.geometry import Frame, Intrinsics
    >>> camera = Intrinsics.from_fov(160, 120, 1.2)
    >>> table = np.full((120, 160), 0.8, np.float32)
    >>> gate = SceneChangeGate()
    >>> gate.offer(Frame(table, camera), 0.0).reason
    'first'
    >>> gate.offer(Frame(table, camera), 0.1).reason
    'unchanged'
    >>> box = table.copy()
    >>> box[40:100, 40:100] = 0.7
    >>> gate.offer(Frame(box, camera), 0.2).reason
    'depth'
    """

    def __init__(self, params: SceneChangeParams | None = None) -> None:
        self.params = params or SceneChangeParams()
        self._key: _Key | None = None

    def offer(
        self,
        frame: Frame,
        now_s: float | None = None,
        *,
        centroids: FloatArray | None = None,
        force: bool = False,
    ) -> SceneChange:
        """Tell whether a frame is worth sending; if so, it is what the next ones are held against.

        Parameters
        ----------
        now_s
            Time of the frame, s; None = its own stamp.
        centroids : (k, 3) or None, m
            Of the segments, for callers that have segmented the frame: small things that come or
            go change few pixels.
        force
            Send whatever it shows.
        """
        stamp_s = frame.stamp_s if now_s is None else now_s
        grey = None if frame.rgb is None else _grey(frame.rgb)
        now = _Key(frame, grey, stamp_s, None if centroids is None else np.array(centroids))
        change = self._compare(now, force)
        if change.send:
            self._key = now
        return change

    def _compare(self, now: _Key, force: bool) -> SceneChange:
        key, frame = self._key, now.frame
        if key is None:
            return SceneChange(True, "first")
        if (
            frame.depth_m.shape != key.frame.depth_m.shape
            or frame.intrinsics != key.frame.intrinsics
            or (frame.x0, frame.y0) != (key.frame.x0, key.frame.y0)
        ):
            return SceneChange(True, "camera")
        depth = _second_largest(_depth_divergence(key.frame.depth_m, frame.depth_m, BLOCK_PX))
        colour = 0.0
        if now.grey is not None and key.grey is not None:
            # A camera that sets its exposure anew changes every pixel, and nothing of the scene.
            gain = _median(key.grey) / max(_median(now.grey), 1)
            colour = _second_largest(_grey_divergence(key.grey, now.grey, gain, BLOCK_PX))
        limits = self.params
        reason = "unchanged"
        if force:
            reason = "forced"
        elif depth > limits.depth_bits:
            reason = "depth"
        elif colour > limits.colour_bits:
            reason = "colour"
        elif _segments_moved(key.centroids, now.centroids, limits.moved_m):
            reason = "segments"
        elif now.stamp_s - key.stamp_s >= limits.max_age_s:
            reason = "age"
        return SceneChange(reason != "unchanged", reason, depth, colour)


def _segments_moved(before: FloatArray | None, now: FloatArray | None, limit_m: float) -> bool:
    if before is None or now is None:
        return False
    if len(before) != len(now):
        return True
    if len(now) == 0:
        return False
    distance = np.linalg.norm(np.asarray(before)[:, None] - np.asarray(now)[None], axis=-1)
    return bool(max(distance.min(axis=0).max(), distance.min(axis=1).max()) > limit_m)


def _second_largest(values: FloatArray) -> float:
    if values.size < 2:
        return float(values.max(initial=0.0))
    return float(np.partition(values.ravel(), -2)[-2])


def _grey(rgb: UInt8Array) -> UInt8Array:
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _median(grey: UInt8Array) -> int:
    counts = np.cumsum(cv2.calcHist([grey], [0], None, [256], [0, 256]))
    return int(np.searchsorted(counts, counts[-1] / 2))


@njit(cache=True, nogil=True)
def _divergence(p: NDArray[np.float64], q: NDArray[np.float64], low: int, high: int) -> float:
    """Return the Jensen-Shannon divergence of the entries low..high of two histograms, bit."""
    total_p = total_q = 0.0
    for k in range(low, high + 1):
        total_p += p[k]
        total_q += q[k]
    if total_p == 0.0 or total_q == 0.0:
        return 0.0
    bits = 0.0
    for k in range(low, high + 1):
        a, b = p[k] / total_p, q[k] / total_q
        middle = (a + b) / 2
        if a > 0.0:
            bits += 0.5 * a * np.log2(a / middle)
        if b > 0.0:
            bits += 0.5 * b * np.log2(b / middle)
    return bits


@njit(cache=True, nogil=True)
def _depth_divergence(
    before: NDArray[np.float32], now: NDArray[np.float32], block: int
) -> NDArray[np.float64]:
    """Return per block of ``block`` px the divergence of depth; bins are as wide as the noise."""
    rows, columns = before.shape[0] // block, before.shape[1] // block
    out = np.zeros((rows, columns))
    p, q = np.zeros(_MAX_BINS), np.zeros(_MAX_BINS)
    for i in range(rows):
        for j in range(columns):
            here = before[i * block : (i + 1) * block, j * block : (j + 1) * block]
            there = now[i * block : (i + 1) * block, j * block : (j + 1) * block]
            total, seen_p, seen_q = 0.0, 0, 0
            near, far = np.float32(np.inf), np.float32(0.0)
            for r in range(block):
                for c in range(block):
                    a, b = here[r, c], there[r, c]
                    if 0 < a < np.inf:
                        total += a
                        near, far = a if a < near else near, a if a > far else far
                        seen_p += 1
                    if 0 < b < np.inf:
                        near, far = b if b < near else near, b if b > far else far
                        seen_q += 1
            share_p, share_q = seen_p / block**2, seen_q / block**2
            # Depth that comes or goes altogether is a change, though there is nothing to compare.
            if min(share_p, share_q) < _EMPTY and max(share_p, share_q) > _FULL:
                out[i, j] = 1.0
            elif share_p >= _COMPARABLE and share_q >= _COMPARABLE:
                mean = total / seen_p
                # Three times the axial noise of a Kinect (Nguyen, Izadi and Lovell 2012).
                width = max(0.01, 3 * (0.0012 + 0.0019 * (mean - 0.4) ** 2))
                low = min(int(near / width), _MAX_BINS - 1)
                high = min(int(far / width), _MAX_BINS - 1)
                p[low : high + 1], q[low : high + 1] = 0.0, 0.0
                for r in range(block):
                    for c in range(block):
                        if 0 < here[r, c] < np.inf:
                            p[min(int(here[r, c] / width), _MAX_BINS - 1)] += 1
                        if 0 < there[r, c] < np.inf:
                            q[min(int(there[r, c] / width), _MAX_BINS - 1)] += 1
                out[i, j] = _divergence(p, q, low, high)
    return out


@njit(cache=True, nogil=True)
def _shares(gain: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return for each brightness times ``gain`` its bin and the share that the next one gets.

    It counts in the two bins whose centres are nearest.
    """
    bins, shares = np.empty(256, np.int64), np.empty(256)
    for value in range(256):
        # Shared between the two nearest bins, so that a value at their border does not flip.
        at = min(gain * value, 255.0) / 256 * _GREY_BINS - 0.5
        low = int(np.floor(at))
        bins[value], shares[value] = low, at - low
    return bins, shares


@njit(cache=True, nogil=True)
def _grey_divergence(
    before: NDArray[np.uint8], now: NDArray[np.uint8], gain: float, block: int
) -> NDArray[np.float64]:
    """Return per block the divergence of brightness, the second image's times ``gain``."""
    rows, columns = before.shape[0] // block, before.shape[1] // block
    out = np.zeros((rows, columns))
    p, q = np.zeros(_GREY_BINS + 2), np.zeros(_GREY_BINS + 2)
    bins_p, shares_p = _shares(1.0)
    bins_q, shares_q = _shares(gain)
    for i in range(rows):
        for j in range(columns):
            p[:], q[:] = 0.0, 0.0
            for r in range(i * block, (i + 1) * block):
                for c in range(j * block, (j + 1) * block):
                    here, there = before[r, c], now[r, c]
                    p[bins_p[here] + 1] += 1 - shares_p[here]
                    p[bins_p[here] + 2] += shares_p[here]
                    q[bins_q[there] + 1] += 1 - shares_q[there]
                    q[bins_q[there] + 2] += shares_q[there]
            for histogram in (p, q):  # what lies beyond the outermost centres counts there
                histogram[1] += histogram[0]
                histogram[_GREY_BINS] += histogram[_GREY_BINS + 1]
            out[i, j] = _divergence(p, q, 1, _GREY_BINS)
    return out


def warm_up() -> None:
    """Compile ahead of the first frame."""
    depth = np.ones((2 * BLOCK_PX, 2 * BLOCK_PX), np.float32)
    _depth_divergence(depth, depth, BLOCK_PX)
    grey = np.ones((2 * BLOCK_PX, 2 * BLOCK_PX), np.uint8)
    _grey_divergence(grey, grey, 1.0, BLOCK_PX)
