"""One object in one frame: poses for every guess at its pixels, and what speaks for each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from features.geometry import Frame, finite_depth
from features.pose.hypotheses import Hypothesis, halves, hypotheses, parted
from features.pose.icp import distances
from features.pose.model import PoseModel
from features.pose.result import PoseParams
from features.pose.rotations import angle_between, rotation_about
from features.pose.search import Poses, ScenePoints, refine, scene_points, search
from features.pose.visibility import check_free_space

__all__ = ["MIN_POINTS", "PoseTask", "ScoredPose"]

MIN_POINTS = 30
_STRAY = 0.75
_OTHER_RAD, _OTHER_M = np.deg2rad(15.0), 0.010
_SAME_SIDE_RAD = np.deg2rad(45)
_OVER_TABLE_M = 0.003
_BESIDE_M, _MAX_BESIDE, _MAX_COMPARED = 0.006, 4000, 48
_CLEARLY = 0.01
_MAX_TURNS = 48
_LITTLE_RAD = np.deg2rad([0.0, -18.0, -12.0, -6.0, 6.0, 12.0, 18.0])


@dataclass(frozen=True, eq=False)
class ScoredPose:
    """One pose with what speaks for and against it.

    Parameters
    ----------
    rotation, translation : (3, 3), (3,) float64, m
        ``camera_from_model`` of the centred model.
    labels
        Segments that its points came from.
    fit, violation, coverage
        As of :class:`~features.pose.result.PoseEstimate`.
    score
        Fit less contradictions, and less what other poses explain of the surroundings.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    labels: tuple[int, ...]
    fit: float
    violation: float
    coverage: float
    score: float


class PoseTask:
    """One object in one frame: finds poses, and judges them by all that the frame shows."""

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
        self.depth = finite_depth(frame.depth_m)
        self.rgb = frame.rgb
        self.points = frame.points()
        lens = frame.intrinsics
        self.camera = (lens.fx, lens.fy, lens.cx - frame.x0, lens.cy - frame.y0)
        # The same frame gives the same pose, whatever was asked before.
        self.rng = np.random.default_rng(0)
        self.judged = self._chosen(labels == label)
        self._around: tuple[NDArray[np.intp], NDArray[np.float64]] | None = None

    def guesses(self) -> list[Hypothesis]:
        """Return the segment alone and, where they may be merged, with what touches it."""
        if not self.params.merge:
            return [Hypothesis((self.label,), self.labels == self.label)]
        return hypotheses(self.points, self.labels, self.label, self.model.diameter_m)

    def parted(self) -> list[Hypothesis]:
        """Return guesses of last resort: with segments that lie apart from this one."""
        if not self.params.merge:
            return []
        return parted(self.points, self.labels, self.label, self.model.diameter_m)

    def halves(self) -> list[Hypothesis]:
        """Return guesses that the segment shows another thing beside the object."""
        return halves(self.points, self.labels, self.label) if self.params.merge else []

    def poses(self, guess: Hypothesis, starts: int) -> list[ScoredPose]:
        """Search for poses; whatever the guess, their fit is that of the segment asked for."""
        alone = len(guess.labels) == 1 and not guess.is_part
        points = self.judged if alone else self._chosen(guess.mask)
        if len(points) < MIN_POINTS:
            return []
        poses = search(self.model, points, starts, self.params.keep)
        if not alone:
            poses = refine(self.model, points, poses, self.judged)
        mask = self.labels == self.label if guess.is_part else guess.mask
        return self._judge(poses, mask, guess.labels)

    def given(self, poses: NDArray[np.float64]) -> list[ScoredPose]:
        """Improve poses that are known from elsewhere."""
        turns = np.ascontiguousarray(poses[:, :3, :3])
        centred = Poses(turns, poses[:, :3, 3] + turns @ self.model.centre, np.zeros(len(poses)))
        refined = refine(self.model, self.judged, centred)
        return self._judge(refined, self.labels == self.label, (self.label,))

    def is_enough(self, pool: list[ScoredPose]) -> bool:
        """Tell whether the best pose leaves nothing to explain."""
        best = max(pool, key=lambda scored: scored.score)
        params = self.params
        return best.fit >= params.enough_fit and best.violation <= params.max_violation

    def leaves_much(self, pool: list[ScoredPose]) -> bool:
        """Tell whether the best pose leaves much of the segment unexplained."""
        return max(pool, key=lambda scored: scored.score).fit < self.params.enough_fit

    def turned_alike(
        self, pool: list[ScoredPose], matched: NDArray[np.float64]
    ) -> list[ScoredPose]:
        """Return the poses turned by little from a matched one, symmetries of the shape apart."""
        symmetries = self.model.symmetries
        return [f for f in pool if angle_between(f.rotation, matched, symmetries) < _SAME_SIDE_RAD]

    def distinct(self, pool: list[ScoredPose], most: int) -> list[ScoredPose]:
        """Return the best poses of a sorted pool that differ from one another."""
        distinct: list[ScoredPose] = []
        for scored in pool:
            if all(self.differ(scored, other) for other in distinct):
                distinct.append(scored)
            if len(distinct) == most:
                break
        return distinct

    def with_surroundings(self, pool: list[ScoredPose]) -> list[ScoredPose]:
        """Judge the best poses of a sorted pool by what they explain beside the segment.

        A handle that the segmenter cut off lies on the model in the right pose only, while a wrong
        one hides its handle behind the body, where nothing contradicts it.
        """
        pool = pool[:_MAX_COMPARED]
        short = self._short(pool).tolist()
        pool = [
            replace(scored, score=self._score(scored.fit, scored.violation) - less)
            for scored, less in zip(pool, short, strict=True)
        ]
        return sorted(pool, key=lambda scored: -scored.score)

    def completed(self, scored: ScoredPose) -> ScoredPose:
        """Lay a pose on the points beside the segment as well, if it clearly explains more then.

        Otherwise they only let it slide along a smooth body.
        """
        pool = [scored, *self.recollected(scored)]
        before, *after = [
            rival.score - less for rival, less in zip(pool, self._short(pool), strict=True)
        ]
        return pool[-1] if after and after[-1] > before + _CLEARLY else scored

    def _short(self, pool: list[ScoredPose]) -> NDArray[np.float64]:
        """Return by how much of the score (n,) each explains less beside the segment than any."""
        numbers, places = self._surroundings()
        beside = places[self.labels.ravel()[numbers] != self.label]
        # Thinned evenly: a large surface beside the thing costs no more than a small one.
        step = max(-(-len(beside) // _MAX_BESIDE), 1)
        own = max(int((self.labels == self.label).sum()), 1) / step
        near = [
            np.count_nonzero(
                self.distances(beside[::step], scored.rotation, scored.translation) < _BESIDE_M
            )
            for scored in pool
        ]
        shares = np.array(near) / (np.array(near) + own)
        short: NDArray[np.float64] = self.params.gain * (shares.max() - shares)
        return short

    def recollected(self, scored: ScoredPose) -> list[ScoredPose]:
        """Let a pose collect the points that lie on it, and improve it on them, twice."""
        poses = Poses(scored.rotation[None], scored.translation[None], np.zeros(1))
        mask = self.labels == self.label
        for _ in range(2):
            mask = self._on_model(poses.rotations[0], poses.translations[0])
            points = self._chosen(mask)
            if len(points) < MIN_POINTS:
                return []
            poses = refine(self.model, points, poses, self.judged)
        return self._judge(poses, mask, scored.labels)

    def turns(self) -> NDArray[np.float64]:
        """Return symmetries of the shape (s, 3, 3), at most 48, the identity first."""
        turns = self.model.symmetries
        return turns[:: -(-len(turns) // _MAX_TURNS)]

    def varied(self, scored: ScoredPose, variant: int) -> list[ScoredPose]:
        """Return a pose turned by a symmetry of the shape, and by a little more or less.

        Each is laid on the points again. What noise lets pass as a symmetry may be off by some
        degrees, and so may its axis.
        """
        turn = self.turns()[variant]
        axis = Rotation.from_matrix(turn).as_rotvec()
        length = float(np.linalg.norm(axis))
        little = _LITTLE_RAD if length > 1e-6 else np.zeros(1)
        axis = axis / length if length > 1e-6 else axis
        turns = np.stack([turn @ rotation_about(axis, angle) for angle in little.tolist()])
        places = np.repeat(scored.translation[None], len(turns), axis=0)
        laid = refine(self.model, self.judged,
                      Poses(scored.rotation @ turns, places, np.zeros(len(turns))))  # fmt: skip
        near_best = np.flatnonzero(laid.fit > min(scored.fit, float(laid.fit.max())) - _CLEARLY)
        return [
            replace(scored, rotation=laid.rotations[k], translation=laid.translations[k],
                    fit=float(laid.fit[k]))
            for k in near_best
        ]  # fmt: skip

    def pose_of(self, scored: ScoredPose) -> NDArray[np.float64]:
        return self.model.camera_from_object(scored.rotation, scored.translation)

    def _chosen(self, mask: NDArray[np.bool_]) -> ScenePoints:
        return scene_points(
            self.points[mask], self.params.max_points, _STRAY * self.model.diameter_m, self.rng
        )

    def _judge(
        self, poses: Poses, mask: NDArray[np.bool_], labels: tuple[int, ...]
    ) -> list[ScoredPose]:
        sight = check_free_space(
            self.model.samples, poses.rotations, poses.translations,
            self.depth, mask, self.camera, self.model.spacing_m, self.plane,
        )  # fmt: skip
        violation, coverage = sight.violation, sight.coverage
        return [
            ScoredPose(
                poses.rotations[k], poses.translations[k], labels,
                float(poses.fit[k]), float(violation[k]), float(coverage[k]),
                self._score(float(poses.fit[k]), float(violation[k])),
            )
            for k in range(len(poses))
        ]  # fmt: skip

    def _score(self, fit: float, violation: float) -> float:
        return fit - self.params.penalty * violation

    def _on_model(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return the segment together with all other points that lie on the posed model."""
        numbers, places = self._surroundings()
        near = self.distances(places, rotation, translation)
        mask: NDArray[np.bool_] = self.labels == self.label
        mask.reshape(-1)[numbers[near < self.params.near_m + self.model.cell_m / 2]] = True
        return mask

    def _surroundings(self) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return pixels and places of what stands on the table around the segment, found once."""
        if self._around is None:
            self._around = self._candidates()
        return self._around

    def _candidates(self) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return pixels and places of what stands on the table around the segment."""
        flat = self.points.reshape(-1, 3)
        middle = np.median(self.judged.places, axis=0)
        reach = 1.1 * self.model.diameter_m
        with np.errstate(invalid="ignore"):
            # One axis after the other, each on what is left: most of an image lies elsewhere.
            numbers = np.flatnonzero(np.abs(flat[:, 2] - middle[2]) < reach)
            for axis in (0, 1):
                numbers = numbers[np.abs(flat[numbers, axis] - middle[axis]) < reach]
        if self.plane is None:
            numbers = numbers[self.labels.ravel()[numbers] > 0]
            return numbers, flat[numbers].astype(np.float64)
        places = flat[numbers].astype(np.float64)
        stands = places @ self.plane[:3] + self.plane[3] > _OVER_TABLE_M
        return numbers[stands], places[stands]

    def distances(
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

    def differ(self, a: ScoredPose, b: ScoredPose) -> bool:
        if len(self.model.symmetric_axes) < 2:
            turn = angle_between(a.rotation, b.rotation, self.model.symmetries)
            if turn > _OTHER_RAD:
                return True
        return float(np.linalg.norm(a.translation - b.translation)) > _OTHER_M
