"""The pose in six degrees of freedom of an object whose model is stored (Kehoe 2014, 4.4).

Every hypothesis about which pixels are the object's gives poses; the free space of the depth image
decides among them. The best ones collect the points that the segmenter left out, and are judged
again.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from features.pose.colour import ColourChoice, choose_by_colour, colour_misfits
from features.pose.confidence import PoseConfidence
from features.pose.hypotheses import Hypothesis, hypotheses
from features.pose.icp import distances
from features.pose.model import PoseModel
from features.pose.rotations import angle_between
from features.pose.search import Poses, ScenePoints, refine, scene_points, search
from features.pose.visibility import check_free_space

__all__ = ["PoseAlternative", "PoseEstimate", "PoseParams", "estimate_pose"]

log = logging.getLogger(__name__)

_MIN_POINTS = 30
_STRAY = 0.75
_OTHER_RAD, _OTHER_M = np.deg2rad(15.0), 0.010
_SAME_SIDE_RAD = np.deg2rad(45)
_EXPLAINED_M = 0.008
_OVER_TABLE_M = 0.003
_MAX_TURNS = 48


@dataclass(frozen=True)
class PoseParams:
    """Search effort and limits of the pose estimation.

    Parameters
    ----------
    starts, more_starts
        Rotations tried for the segment, and for the segment with neighbours.
    keep
        Distinct poses of each that are refined.
    max_points
        Of a segment.
    recollected
        Best poses that collect the points the segmenter left out.
    merge
        Try neighbouring segments as parts of the object.
    near_m
        Points so near to a posed model may be collected, besides half a grid cell.
    enough_fit, max_violation
        A pose of the segment alone that is so good ends the search: what the segmenter left out
        would contradict a wrong one.
    penalty
        Of a contradiction with free space, in units of fit.
    as_good
        A pose whose score is less below the best one's is as good.
    time_limit_s
        After so long no further hypothesis is begun.
    confidence
        Constants of the confidence.
    """

    starts: int = 256
    more_starts: int = 128
    keep: int = 24
    max_points: int = 1200
    recollected: int = 6
    merge: bool = True
    near_m: float = 0.007
    enough_fit: float = 0.6
    max_violation: float = 0.10
    penalty: float = 0.8
    as_good: float = 0.03
    time_limit_s: float | None = None
    confidence: PoseConfidence = field(default_factory=PoseConfidence)


@dataclass(frozen=True, eq=False)
class PoseAlternative:
    """Another pose that explains the view.

    Parameters
    ----------
    camera_from_object : (4, 4) float64
    score
        On the scale of the best pose's; 1 = perfect.
    """

    camera_from_object: NDArray[np.float64]
    score: float


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """Estimated pose of an object, with its confidence.

    Parameters
    ----------
    camera_from_object : (4, 4) float64, m
        Of the frame that the model was given in.
    confidence
        Kehoe's s_T, 0..1.
    accepted
        Whether it reaches c_T. Below, the pose cannot be determined.
    fit, violation, coverage, explained
        How well the segment lies on the model; share of contradictions with free space; share of
        the visible side that was measured; share of the segment's points on the model.
    alternatives
        Distinct other poses, best first.
    ambiguous
        One of them is as good: no look from here can tell.
    symmetric_axes : (j, 3) float64
        Axes, in the object's frame, about which the turn means nothing.
    segments_used
        Labels of the segments that the object was taken to consist of.
    is_complete
        False when the time limit cut the search short.
    decided_by_colour
        Colours told this pose from those that a symmetry of the shape allows.
    """

    camera_from_object: NDArray[np.float64]
    confidence: float
    accepted: bool
    fit: float
    violation: float
    coverage: float
    explained: float
    alternatives: tuple[PoseAlternative, ...]
    ambiguous: bool
    symmetric_axes: NDArray[np.float64]
    segments_used: tuple[int, ...]
    is_complete: bool = True
    decided_by_colour: bool = False


def estimate_pose(
    model: PoseModel,
    frame: Frame,
    labels: NDArray[np.int32],
    label: int,
    params: PoseParams | None = None,
    plane: NDArray[np.float64] | None = None,
    initial: NDArray[np.float64] | None = None,
    is_matched: bool = False,
) -> PoseEstimate | None:
    """Find the pose of an object of which one segment is known.

    Parameters
    ----------
    model
        Of the object.
    frame
        Depth with its camera.
    labels : (h, w) int32
        Segments of the frame, 0 = none; a mask alone will do.
    label
        The object's.
    plane : (4,) float64, optional
        Unit normal and offset of the table in the camera's frame, the camera above it.
    initial : (k, 4, 4) float64, optional
        Poses ``camera_from_object`` to begin with. When one leaves nothing to explain it is the
        answer.
    is_matched
        The first initial pose comes from matched keypoints. Print tells apart what shape cannot,
        and what a model of few views gets wrong, which knows one side only: the answer is turned
        as that pose is, if any is, and colours are not asked.

    Returns
    -------
    PoseEstimate or None
        None when fewer than 30 points have depth; the log says so.
    """
    params = params or PoseParams()
    if labels.shape != frame.depth_m.shape:
        raise ValueError(f"labels {labels.shape} and depth {frame.depth_m.shape} differ in shape")
    started = time.perf_counter()
    task = _Task(model, frame, np.asarray(labels, np.int32), label, params, plane)
    if len(task.judged) < _MIN_POINTS:
        log.info("no pose: segment %d has %d points with depth", label, len(task.judged))
        return None
    begun = np.asarray([] if initial is None else initial, np.float64).reshape(-1, 4, 4)
    matched = begun[0, :3, :3] if is_matched and len(begun) else None
    pool = task.given(begun) if len(begun) else []
    if pool and task.is_enough(pool):
        pool.sort(key=lambda found: -found.score)
        return task.answer(pool, True, matched)
    complete = True
    for k, guess in enumerate(task.guesses()):
        late = (
            params.time_limit_s is not None and time.perf_counter() - started > params.time_limit_s
        )
        if k and late:
            complete = False
            break
        pool += task.poses(guess, params.starts if k == 0 else params.more_starts)
        if k == 0 and task.is_enough(pool):
            break
    if matched is not None:
        pool = task.turned_alike(pool, matched) or pool
    pool.sort(key=lambda found: -found.score)
    if not task.is_enough(pool):
        for found in pool[: params.recollected]:
            pool += task.recollected(found)
        pool.sort(key=lambda found: -found.score)
    return task.answer(pool, complete, matched)


@dataclass(frozen=True, eq=False)
class _Found:
    """One pose with what speaks for and against it."""

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    labels: tuple[int, ...]
    fit: float
    violation: float
    coverage: float
    score: float


class _Task:
    """One object in one frame."""

    def __init__(
        self,
        model: PoseModel,
        frame: Frame,
        labels: NDArray[np.int32],
        label: int,
        params: PoseParams,
        plane: NDArray[np.float64] | None,
    ) -> None:
        self.model, self.labels, self.label = model, labels, label
        self.params, self.plane = params, plane
        self.depth = np.where(np.isfinite(frame.depth_m), frame.depth_m, 0).astype(np.float32)
        self.rgb = frame.rgb
        self.points = frame.points()
        lens = frame.intrinsics
        self.camera = (lens.fx, lens.fy, lens.cx - frame.x0, lens.cy - frame.y0)
        self.rng = np.random.default_rng(0)
        self.judged = self._chosen(labels == label)
        self._around: tuple[NDArray[np.intp], NDArray[np.float64]] | None = None

    def guesses(self) -> list[Hypothesis]:
        if not self.params.merge:
            return [Hypothesis((self.label,), self.labels == self.label)]
        return hypotheses(self.points, self.labels, self.label, self.model.diameter_m)

    def poses(self, guess: Hypothesis, starts: int) -> list[_Found]:
        alone = len(guess.labels) == 1
        points = self.judged if alone else self._chosen(guess.mask)
        if len(points) < _MIN_POINTS:
            return []
        found = search(self.model, points, starts, self.params.keep)
        if not alone:
            found = refine(self.model, points, found, self.judged)
        return self._judge(found, guess.mask, guess.labels)

    def given(self, poses: NDArray[np.float64]) -> list[_Found]:
        """Improve poses that are known from elsewhere."""
        turns = np.ascontiguousarray(poses[:, :3, :3])
        centred = Poses(turns, poses[:, :3, 3] + turns @ self.model.centre, np.zeros(len(poses)))
        found = refine(self.model, self.judged, centred)
        return self._judge(found, self.labels == self.label, (self.label,))

    def is_enough(self, pool: list[_Found]) -> bool:
        """Tell whether the best pose leaves nothing to explain."""
        best = max(pool, key=lambda found: found.score)
        params = self.params
        return best.fit >= params.enough_fit and best.violation <= params.max_violation

    def turned_alike(self, pool: list[_Found], matched: NDArray[np.float64]) -> list[_Found]:
        """Return the poses turned by little from a matched one, symmetries of the shape apart."""
        symmetries = self.model.symmetries
        return [f for f in pool if angle_between(f.rotation, matched, symmetries) < _SAME_SIDE_RAD]

    def recollected(self, found: _Found) -> list[_Found]:
        """Let a pose collect the points that lie on it, and improve it on them, twice."""
        poses = Poses(found.rotation[None], found.translation[None], np.zeros(1))
        mask = self.labels == self.label
        for _ in range(2):
            mask = self._on_model(poses.rotations[0], poses.translations[0])
            points = self._chosen(mask)
            if len(points) < _MIN_POINTS:
                return []
            poses = refine(self.model, points, poses, self.judged)
        return self._judge(poses, mask, found.labels)

    def answer(
        self, pool: list[_Found], complete: bool, matched: NDArray[np.float64] | None
    ) -> PoseEstimate:
        best = pool[0]
        others: list[_Found] = []
        for found in pool[1:]:
            if all(self._differ(found, other) for other in [best, *others]):
                others.append(found)
            if len(others) == 5:
                break
        alike = [o for o in others if best.score - o.score < self.params.as_good]
        candidates = [best, *alike]
        choice = (
            self._by_colour(candidates) if matched is None else self._nearest(candidates, matched)
        )
        rivals = choice.rivals
        winner = [best, *alike][choice.candidate]
        others = [found for found in (best, *others) if found is not winner]
        best = self._varied(winner, choice.variant)
        away = self._distances(self.judged.places, best.rotation, best.translation)
        explained = float((away < _EXPLAINED_M + self.model.cell_m / 2).mean())
        constants = self.params.confidence
        sure = constants.of(best.fit, best.violation, explained, rivals)
        return PoseEstimate(
            camera_from_object=self._pose(best),
            confidence=sure,
            accepted=sure >= constants.threshold,
            fit=best.fit,
            violation=best.violation,
            coverage=best.coverage,
            explained=explained,
            alternatives=tuple(PoseAlternative(self._pose(o), o.score) for o in others),
            ambiguous=rivals > 0,
            symmetric_axes=self.model.symmetric_axes,
            segments_used=best.labels,
            is_complete=complete,
            decided_by_colour=choice.is_decided or choice.candidate > 0,
        )

    def _by_colour(self, candidates: list[_Found]) -> ColourChoice:
        """Let colours choose among poses as good by shape, and among those that symmetry allows."""
        model, turns = self.model, self._turns()
        undecided = ColourChoice(0, 0, len(candidates) - 1, False)
        if model.colours is None or self.rgb is None or len(candidates) * len(turns) < 2:
            return undecided
        rotations = np.concatenate([found.rotation @ turns for found in candidates])
        places = np.repeat([found.translation for found in candidates], len(turns), axis=0)
        misfits = colour_misfits(
            model.samples, model.colours, (rotations, places), self.depth, self.rgb, self.camera
        )
        return choose_by_colour(misfits.reshape(len(candidates), -1), turns)

    def _nearest(self, candidates: list[_Found], matched: NDArray[np.float64]) -> ColourChoice:
        """Choose, as colours do, the pose and variant that is turned least from a matched one."""
        rotations = np.stack([found.rotation for found in candidates])
        off = np.einsum("cij,sjk,ik->cs", rotations, self._turns(), matched)
        candidate, variant = np.unravel_index(int(off.argmax()), off.shape)
        return ColourChoice(int(candidate), int(variant), 0, False)

    def _turns(self) -> NDArray[np.float64]:
        """Return symmetries of the shape (s, 3, 3), at most 48, the identity first."""
        turns = self.model.symmetries
        return turns[:: -(-len(turns) // _MAX_TURNS)]

    def _varied(self, found: _Found, variant: int) -> _Found:
        return replace(found, rotation=found.rotation @ self._turns()[variant])

    def _pose(self, found: _Found) -> NDArray[np.float64]:
        return self.model.camera_from_object(found.rotation, found.translation)

    def _chosen(self, mask: NDArray[np.bool_]) -> ScenePoints:
        return scene_points(
            self.points[mask], self.params.max_points, _STRAY * self.model.diameter_m, self.rng
        )

    def _judge(
        self, poses: Poses, mask: NDArray[np.bool_], labels: tuple[int, ...]
    ) -> list[_Found]:
        sight = check_free_space(
            self.model.samples, poses.rotations, poses.translations,
            self.depth, mask, self.camera, self.model.spacing_m, self.plane,
        )  # fmt: skip
        violation, coverage = sight.violation, sight.coverage
        return [
            _Found(
                poses.rotations[k], poses.translations[k], labels,
                float(poses.fit[k]), float(violation[k]), float(coverage[k]),
                float(poses.fit[k] - self.params.penalty * violation[k]),
            )
            for k in range(len(poses))
        ]  # fmt: skip

    def _on_model(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return the segment together with all other points that lie on the posed model."""
        if self._around is None:
            self._around = self._candidates()
        numbers, places = self._around
        near = self._distances(places, rotation, translation)
        mask: NDArray[np.bool_] = self.labels == self.label
        mask.reshape(-1)[numbers[near < self.params.near_m + self.model.cell_m / 2]] = True
        return mask

    def _candidates(self) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return pixels and places of what stands on the table around the segment."""
        flat = self.points.reshape(-1, 3)
        middle = np.median(self.judged.places, axis=0)
        with np.errstate(invalid="ignore"):
            near = np.abs(flat - middle).max(axis=1) < 1.1 * self.model.diameter_m
            if self.plane is None:
                near &= self.labels.ravel() > 0
            else:
                near &= flat @ self.plane[:3] + self.plane[3] > _OVER_TABLE_M
        numbers = np.flatnonzero(near)
        return numbers, flat[numbers].astype(np.float64)

    def _distances(
        self,
        places: NDArray[np.float64],
        rotation: NDArray[np.float64],
        translation: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        model = self.model
        away: NDArray[np.float64] = distances(
            *(places, rotation, translation, model.samples),
            *(model.grid, model.corner, model.cell_m),
        )
        return away

    def _differ(self, a: _Found, b: _Found) -> bool:
        if len(self.model.symmetric_axes) < 2:
            turn = angle_between(a.rotation, b.rotation, self.model.symmetries)
            if turn > _OTHER_RAD:
                return True
        return float(np.linalg.norm(a.translation - b.translation)) > _OTHER_M
