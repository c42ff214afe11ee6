"""Reading a camera_info that a person pastes, as ROS prints it or as a calibration stores it.

JSON is read as the YAML that nearly all of it is. Aliases are refused, because a few of them can
stand for any amount of data.
"""

from __future__ import annotations

import math
from typing import Any

import yaml  # type: ignore[import-untyped]  # its stubs are a package of their own

from rtask.errors import UsageError

__all__ = ["CAMERA_INFO", "read_camera_info"]

CAMERA_INFO = "camera_info"
MAX_CHARACTERS = 20_000
_MATRIX = 9
_Values = dict[str, Any]


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # untyped
    """Reads plain data without aliases."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node.

        Raises
        ------
        ValueError
            It is an alias.
        """
        if self.check_event(yaml.AliasEvent):
            raise ValueError("aliases (*name) are not read")
        return super().compose_node(parent, index)


def read_camera_info(text: str) -> dict[str, str]:
    """Return the fields of a camera in ``register_robot`` that a camera_info says.

    Parameters
    ----------
    text
        A sensor_msgs/CameraInfo as JSON, as YAML as ``rostopic echo`` and ``ros2 topic echo`` print
        it, or the file that ROS's camera_calibration writes. Of several documents the first counts.

    Returns
    -------
    Width, height, focal lengths and optical centre, px; name and frame where the text says them.

    Raises
    ------
    UsageError
        It is none of these, or does not say how large the picture is and where its centre is.

    Examples
    --------
    >>> found = read_camera_info('''
    ... image_width: 640
    ... image_height: 480
    ... camera_name: head
    ... camera_matrix: {rows: 3, cols: 3, data: [525, 0, 319.5, 0, 526, 239.5, 0, 0, 1]}
    ... ''')
    >>> found["name"], found["width"], found["fx"], found["cy"]
    ('head', '640', '525.0', '239.5')
    """
    try:
        if len(text) > MAX_CHARACTERS:
            raise ValueError(f"more than {MAX_CHARACTERS} characters")
        values = _fields(_first_document(text))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}: " if mark else ""
        raise _refusal(f"{where}{error.problem or error.context}") from None
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise _refusal(f"no {error}" if isinstance(error, KeyError) else str(error)) from None
    except yaml.YAMLError as error:
        raise _refusal(str(error).splitlines()[0]) from None
    return {name: str(value) for name, value in values.items()}


def _refusal(detail: str) -> UsageError:
    return UsageError(f"expected a camera_info as YAML or JSON: {detail}", field=CAMERA_INFO)


def _first_document(text: str) -> _Values:
    # In YAML a tab does not indent; in JSON it may.
    document = next(iter(yaml.load_all(text.replace("\t", " "), Loader=_Loader)), None)
    if not isinstance(document, dict):
        raise ValueError(
            "expected width, height and K, or image_width, image_height and camera_matrix"
        )
    return document


def _fields(info: _Values) -> _Values:
    """Return the fields of a camera by their names."""
    if "camera_matrix" in info:  # a file of camera_calibration
        width, height, frame = info["image_width"], info["image_height"], ""
        camera_matrix, name = info["camera_matrix"], str(info.get("camera_name") or "")
        camera_matrix = camera_matrix["data"] if isinstance(camera_matrix, dict) else camera_matrix
    else:
        width, height, camera_matrix = info["width"], info["height"], info.get("k") or info["K"]
        header = info.get("header")
        frame = str(header.get("frame_id") or "") if isinstance(header, dict) else ""
        name = frame.rpartition("/")[2]
    from features.imaging.camera import lens_from_message

    matrix = [float(value) for value in camera_matrix]
    if len(matrix) != _MATRIX or not all(map(math.isfinite, matrix)) or matrix[0] <= 0:
        raise ValueError("K: expected nine numbers, the focal length first")
    # Column by column, or as shares of the picture, it would be stored as another camera.
    lens_from_message({"width": int(width), "height": int(height), "k": matrix})
    values: _Values = {"width": int(width), "height": int(height), "fx": matrix[0], "fy": matrix[4],
                       "cx": matrix[2], "cy": matrix[5]}  # fmt: skip
    labels = {"name": name, "frame_id": frame}
    return {**{key: value for key, value in labels.items() if value}, **values}
