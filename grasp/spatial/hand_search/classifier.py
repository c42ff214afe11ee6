"""Classifier of candidates from one view, trained on simulated views.

Two models: gradient boosting over 26 statistics, and the linear machine over gradients of a
picture (ten Pas and Platt 2015, 5). Both are calibrated by isotonic regression on objects that
they were not trained on. Training takes the extra ``classifier``; a stored model is numbers and
text alone, evaluated here.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.clouds.cloud import SurfaceCloud
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.closing_region import (
    HOG_LENGTH,
    PICTURE,
    STATISTICS,
    closing_regions,
    closing_statistics,
    hog,
)

__all__ = ["GraspClassifier", "GraspSamples", "ModelKind", "gripper_key", "train"]

ModelKind = Literal["boosting", "svm"]

_FORMAT = "rtask-grasp-classifier-2"
_SAMPLES = "rtask-grasp-samples-2"
_TREES, _DEPTH, _RATE = 150, 4, 0.1
_HELD_OUT = 0.25
_LEAF = -1


@dataclass(frozen=True, eq=False)
class GraspSamples:
    """Candidates on single views, and which were right on the whole object.

    Parameters
    ----------
    statistics : (n, 26) float32
    pictures : (n, 80, 100) bool
        Both of :func:`grasp.spatial.hand_search.closing_region.closing_regions`.
    right : (n,) bool
    objects : (n,) int64
        Which object each was found on: learning and testing never share one.
    geometry : (n,) float32
        The rank that geometry gave a hand, 0..1; NaN for a pair of contacts.
    one_sided : (n,) bool
        Nothing opposes one of the jaws: left out of training.
    gripper : str
        Type of the gripper, and its stroke in mm.
    """

    statistics: NDArray[np.float32]
    pictures: NDArray[np.bool_]
    right: NDArray[np.bool_]
    objects: NDArray[np.int64]
    geometry: NDArray[np.float32]
    one_sided: NDArray[np.bool_]
    gripper: str

    def __post_init__(self) -> None:
        n = len(self.right)
        if self.statistics.shape != (n, len(STATISTICS)) or self.pictures.shape != (n, *PICTURE):
            raise ValueError(
                f"{n} samples have statistics (n, {len(STATISTICS)}) and pictures (n, 80, 100), "
                f"got {self.statistics.shape} and {self.pictures.shape}"
            )

    def __len__(self) -> int:
        return len(self.right)

    def take(self, index: NDArray[Any]) -> GraspSamples:
        """Return some of them."""
        return GraspSamples(
            self.statistics[index], self.pictures[index], self.right[index], self.objects[index],
            self.geometry[index], self.one_sided[index], self.gripper,
        )  # fmt: skip

    @property
    def digest(self) -> str:
        """SHA-256 over all values, hexadecimal."""
        state = hashlib.sha256(self.gripper.encode())
        for array in (self.statistics, np.packbits(self.pictures), self.right, self.objects):
            state.update(np.ascontiguousarray(array).tobytes())
        return state.hexdigest()

    def save(self, path: Path) -> None:
        """Write an ``.npz`` of plain arrays."""
        with path.open("wb") as file:
            np.savez_compressed(
                file, format=_SAMPLES, statistics=self.statistics, right=self.right,
                pictures=np.packbits(self.pictures), objects=self.objects,
                geometry=self.geometry, one_sided=self.one_sided, gripper=self.gripper,
            )  # fmt: skip

    @classmethod
    def load(cls, path: Path) -> GraspSamples:
        """Read what :meth:`save` wrote.

        Raises
        ------
        ValueError
            When the file holds something else.
        """
        data = _read(path, _SAMPLES)
        count = len(data["right"]) * PICTURE[0] * PICTURE[1]
        pictures = np.unpackbits(data["pictures"], count=count).astype(bool)
        return cls(
            data["statistics"], pictures.reshape(-1, *PICTURE), data["right"], data["objects"],
            data["geometry"], data["one_sided"], str(data["gripper"]),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class GraspClassifier:
    """A trained model for one type of gripper.

    Parameters
    ----------
    kind
        ``boosting`` over the statistics or ``svm`` over the pictures' gradients.
    arrays
        Of boosting: ``feature``, ``threshold``, ``left``, ``right``, ``value`` of all nodes,
        ``roots`` of the trees, ``start``; of the machine: ``weights``, ``bias``; of both:
        ``scores`` and ``probabilities``, the steps of the calibration.
    gripper
        Type and stroke, as in :class:`GraspSamples`.
    about
        Digest of the samples, their number, versions of the libraries.
    """

    kind: ModelKind
    arrays: dict[str, NDArray[Any]]
    gripper: str
    about: dict[str, Any]

    def score(
        self, statistics: NDArray[np.float32], pictures: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return the model's raw score (n,): log-odds, or distance from the plane."""
        if self.kind == "svm":
            return np.asarray(hog(pictures) @ self.arrays["weights"] + self.arrays["bias"])
        return _boosted(self.arrays, statistics)

    def probability(
        self, statistics: NDArray[np.float32], pictures: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return calibrated probabilities (n,) that the grasps are right."""
        raw = self.score(statistics, pictures)
        return np.asarray(np.interp(raw, self.arrays["scores"], self.arrays["probabilities"]))

    def judge(
        self,
        cloud: SurfaceCloud,
        candidates: Sequence[GraspCandidate],
        gripper: ParallelGripper,
    ) -> NDArray[np.float64]:
        """Return the probability (n,) that each candidate found on ``cloud`` is right.

        Raises
        ------
        ValueError
            When the model was trained for another gripper.
        """
        if gripper_key(gripper) != self.gripper:
            raise ValueError(
                f"the classifier was trained for {self.gripper!r}, not for {gripper_key(gripper)!r}"
            )
        if len(candidates) == 0:
            return np.empty(0)
        if self.kind == "svm":
            return self.probability(*closing_regions(cloud, candidates, gripper))
        statistics = closing_statistics(cloud, candidates, gripper)
        return self.probability(statistics, np.empty((len(statistics), *PICTURE), bool))

    def judged(
        self,
        cloud: SurfaceCloud,
        candidates: Sequence[GraspCandidate],
        gripper: ParallelGripper,
    ) -> list[GraspCandidate]:
        """Return the candidates with :meth:`judge`'s probability as ``scores["classifier"]``."""
        return [
            replace(candidate, scores={**candidate.scores, "classifier": float(p)})
            for candidate, p in zip(candidates, self.judge(cloud, candidates, gripper), strict=True)
        ]

    def save(self, path: Path) -> None:
        """Write an ``.npz`` of plain arrays and text."""
        header = {"kind": self.kind, "gripper": self.gripper, "about": self.about}
        arrays: dict[str, Any] = {**self.arrays, "format": _FORMAT, "header": json.dumps(header)}
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: Path) -> GraspClassifier:
        """Read what :meth:`save` wrote; nothing in the file is executed.

        Raises
        ------
        ValueError
            When the file holds something else.
        """
        data = _read(path, _FORMAT)
        header = json.loads(str(data.pop("header")))
        del data["format"]
        model = cls(header["kind"], data, header["gripper"], header["about"])
        model._check(path)
        return model

    def _check(self, path: Path) -> None:
        """Refuse arrays with which evaluation would leave its bounds or never end."""
        required = {"scores", "probabilities"}
        required |= (
            {"weights", "bias"}
            if self.kind == "svm"
            else {"feature", "threshold", "left", "right", "value", "roots", "start"}
        )
        a = self.arrays
        good = self.kind in ("svm", "boosting") and required <= set(a)
        good = good and len(a["scores"]) == len(a["probabilities"]) > 0
        if good and self.kind == "svm":
            good = a["weights"].shape == (HOG_LENGTH,)
        elif good:
            n, own = len(a["feature"]), np.arange(len(a["feature"]))
            inner = a["feature"] != _LEAF
            # A child comes after its parent: every walk ends.
            good = all(
                len(a[name]) == n and (a[name][inner] > own[inner]).all()
                and (a[name][inner] < n).all()
                for name in ("left", "right")
            ) and a["feature"].max() < len(STATISTICS) and a["roots"].max() < n  # fmt: skip
        if not good:
            raise ValueError(f"{path}: the model's arrays do not fit together")


def gripper_key(gripper: ParallelGripper) -> str:
    """Return the key of a gripper's models: type and stroke in mm.

    >>> gripper_key(ParallelGripper("hand", "nao_hand", 0.0, 0.05))
    'nao_hand 50'
    """
    return f"{gripper.gripper_type} {1e3 * gripper.max_opening:.3g}"


def train(samples: GraspSamples, kind: ModelKind = "boosting", seed: int = 0) -> GraspClassifier:
    """Train a model and calibrate it on a quarter of the objects, kept apart.

    Parameters
    ----------
    samples
        With right and wrong ones on at least four objects.
    seed
        Of the split and of the training.

    Raises
    ------
    ValueError
        When the samples are too few.
    ModuleNotFoundError
        Without scikit-learn, which the extra ``classifier`` brings.
    """
    rng = np.random.default_rng(seed)
    objects = rng.permutation(np.unique(samples.objects))
    held_out = np.isin(samples.objects, objects[: max(1, int(_HELD_OUT * len(objects)))])
    learnt = np.flatnonzero(~held_out & ~samples.one_sided)
    right = samples.right[learnt]
    if len(objects) < 4 or not held_out.any() or right.all() or not right.any():
        raise ValueError("training takes right and wrong grasps on at least four objects")
    try:
        import sklearn
        from sklearn.isotonic import IsotonicRegression
    except ModuleNotFoundError as error:
        # Named, so that the command line can tell which extra brings it.
        raise ModuleNotFoundError(
            "training a classifier takes scikit-learn: the extra 'classifier'", name="sklearn"
        ) from error
    chosen = samples.take(_balanced(learnt, right, rng) if kind == "svm" else learnt)
    fitted = _fit_svm(chosen, seed) if kind == "svm" else _fit_boosting(chosen, seed)
    arrays = {**fitted, "scores": np.zeros(1), "probabilities": np.zeros(1)}
    about = {
        "samples": len(samples),
        "objects": len(objects),
        "digest": samples.digest,
        "versions": {"scikit-learn": sklearn.__version__, "numpy": np.__version__},
    }
    rest = samples.take(np.flatnonzero(held_out))
    raw = GraspClassifier(kind, arrays, samples.gripper, about)
    steps = IsotonicRegression(y_min=0.0, y_max=1.0, out_of_bounds="clip")
    steps.fit(raw.score(rest.statistics, rest.pictures), rest.right)
    arrays["scores"] = np.asarray(steps.X_thresholds_, np.float64)
    arrays["probabilities"] = np.asarray(steps.y_thresholds_, np.float64)
    return raw


def _balanced(
    index: NDArray[np.int64], right: NDArray[np.bool_], rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return as many wrong samples as right ones, drawn."""
    good, bad = index[right], index[~right]
    count = min(len(good), len(bad))
    return np.concatenate(
        [rng.choice(good, count, replace=False), rng.choice(bad, count, replace=False)]
    )


def _fit_svm(samples: GraspSamples, seed: int) -> dict[str, NDArray[Any]]:
    from sklearn.svm import LinearSVC

    machine = LinearSVC(C=0.01, class_weight="balanced", random_state=seed, max_iter=5000)
    machine.fit(hog(samples.pictures), samples.right)
    return {"weights": machine.coef_[0].astype(np.float64), "bias": machine.intercept_[0]}


def _fit_boosting(samples: GraspSamples, seed: int) -> dict[str, NDArray[Any]]:
    """Return all trees' nodes in one set of arrays, children after their parents."""
    from sklearn.ensemble import GradientBoostingClassifier

    boosted = GradientBoostingClassifier(
        n_estimators=_TREES, max_depth=_DEPTH, learning_rate=_RATE, subsample=0.5,
        min_samples_leaf=20, random_state=seed,
    )  # fmt: skip
    boosted.fit(samples.statistics, samples.right)
    columns: dict[str, list[NDArray[Any]]] = {
        name: [] for name in ("feature", "threshold", "left", "right", "value")
    }
    roots, nodes = [], 0
    for (stage,) in boosted.estimators_:
        tree = stage.tree_
        leaf = tree.children_left < 0
        columns["feature"].append(np.where(leaf, _LEAF, tree.feature))
        columns["threshold"].append(tree.threshold)
        columns["left"].append(np.where(leaf, 0, tree.children_left + nodes))
        columns["right"].append(np.where(leaf, 0, tree.children_right + nodes))
        columns["value"].append(_RATE * tree.value[:, 0, 0])
        roots.append(nodes)
        nodes += tree.node_count
    share = float(samples.right.mean())
    arrays: dict[str, NDArray[Any]] = {k: np.concatenate(v) for k, v in columns.items()}
    return {**arrays, "roots": np.array(roots), "start": np.array(np.log(share / (1 - share)))}


def _boosted(
    arrays: dict[str, NDArray[Any]], statistics: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return log-odds (n,): the sum of the leaves that each row falls into."""
    rows = np.arange(len(statistics))
    total = np.full(len(statistics), float(arrays["start"]))
    for root in arrays["roots"]:
        node = np.full(len(statistics), root)
        while True:
            feature = arrays["feature"][node]
            inner = feature != _LEAF
            if not inner.any():
                break
            goes_left = statistics[rows, np.maximum(feature, 0)] <= arrays["threshold"][node]
            child = np.where(goes_left, arrays["left"][node], arrays["right"][node])
            node = np.where(inner, child, node)
        total += arrays["value"][node]
    return total


def _read(path: Path, expected: str) -> dict[str, NDArray[Any]]:
    try:
        if not zipfile.is_zipfile(path):
            raise ValueError("it is no .npz archive")
        with np.load(path, allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: no file of grasp samples or models: {error}") from error
    if str(data.get("format")) != expected:
        raise ValueError(
            f"{path}: expected {expected}, found {data.get('format', 'something else')}"
        )
    return data
