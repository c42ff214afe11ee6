"""Reader of print by RapidOCR (extra ``words``): PP-OCR networks that lie in its wheel.

Nothing is ever downloaded: the networks are named by their files, and one that is missing is an
error. RapidOCR would fetch it from the web.
"""

from __future__ import annotations

import importlib.metadata
import threading
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from features.geometry import UInt8Array
from features.words.word import Word

__all__ = ["RapidReader"]

_NETWORKS = {
    "Det": "PP-OCRv6_det_small.onnx",
    "Cls": "ch_ppocr_mobile_v2.0_cls_mobile.onnx",
    "Rec": "PP-OCRv6_rec_small.onnx",
}
_MAX_SIDE_PX = 1280
_MAX_LINES = 400


class RapidReader:
    """Reads lines of print, also upside down, in Latin and Chinese letters.

    Takes .4 s of the processor for a photograph of 348 px. Safe from several threads, one at a
    time.

    Parameters
    ----------
    threads
        Of the runtime for one picture.

    Raises
    ------
    ModuleNotFoundError
        The extra ``words`` is not installed.
    ValueError
        Its installation lacks a network.
    """

    def __init__(self, threads: int = 1) -> None:
        import onnxruntime  # noqa: F401  the message names what is missing
        import rapidocr

        folder = Path(rapidocr.__file__).parent / "models"
        missing = [name for name in _NETWORKS.values() if not (folder / name).is_file()]
        version = importlib.metadata.version("rapidocr")
        if missing:
            raise ValueError(
                f"rapidocr {version} lacks {', '.join(missing)} in {folder}; install it again: "
                "pip install --force-reinstall --no-deps rapidocr"
            )
        params = {
            "Global.log_level": "error",
            "EngineConfig.onnxruntime.intra_op_num_threads": threads,
            "EngineConfig.onnxruntime.inter_op_num_threads": 1,
            **{f"{part}.model_path": str(folder / name) for part, name in _NETWORKS.items()},
        }
        self._engine = rapidocr.RapidOCR(params=params)
        self._reading = threading.Lock()
        self.name = f"rapidocr {version}, {_NETWORKS['Rec'].removesuffix('.onnx')}"

    def read(self, rgb: UInt8Array) -> Sequence[Word]:
        """Return the lines in a picture (h, w, 3) uint8, in no particular order.

        Raises
        ------
        ValueError
            The library failed on it.
        """
        scale = min(1.0, _MAX_SIDE_PX / max(rgb.shape[:2]))
        bgr = np.ascontiguousarray(rgb[..., ::-1])
        if scale < 1.0:
            size = (round(rgb.shape[1] * scale), round(rgb.shape[0] * scale))
            bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
        try:
            with self._reading:
                result = self._engine(bgr)
        except Exception as error:  # those of the library have no narrower base in common
            raise ValueError(f"{self.name}: a picture of {rgb.shape}: {error}") from error
        if result.boxes is None or result.txts is None or result.scores is None:
            return ()
        lines = zip(result.txts, result.scores, result.boxes, strict=True)
        words = [
            Word.of_corners(str(text), float(score), np.asarray(box, np.float64) / scale)
            for text, score, box in list(lines)[:_MAX_LINES]
        ]
        return tuple(word for word in words if word is not None)
