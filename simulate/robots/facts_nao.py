"""Published dimensions, limits and masses of the NAO H25 V5.

Sources: Aldebaran documentation 2-4 / 2-5 (doc.aldebaran.com, family/nao_h25 and family/robots),
pages *Joints*, *Links*, *Motors* and *Masses*; the inertia tensors of the V50 as published in the
``nao_description`` package of ros-naoqi (BSD-3-Clause, see docs/licences.md).

Units: m, rad, kg, s, N m. At the zero pose all joint frames are parallel: x forward, y left, z up.
The left column is given; :func:`simulate.robots.nao.describe_nao` mirrors it.
"""

from __future__ import annotations

from typing import Final

Vector = tuple[float, float, float]

TORSO_HEIGHT: Final = 0.33309
"""Torso origin above the floor with straight legs: .085 + .100 + .1029 + .04519 (*Links*)."""

HEAD_JOINTS: Final[dict[str, tuple[str, str, Vector, Vector, float, float, float, float]]] = {
    # name: (parent, child, origin, axis, lower, upper, velocity, effort)
    "HeadYaw": ("torso", "Neck", (0, 0, 0.1265), (0, 0, 1), -2.08567, 2.08567, 8.26797, 1.547),
    "HeadPitch": ("Neck", "Head", (0, 0, 0), (0, 1, 0), -0.671952, 0.514872, 7.19407, 1.532),
}

ARM_JOINTS: Final[dict[str, tuple[str, str, Vector, Vector, float, float, float, float]]] = {
    "ShoulderPitch": (
        "torso", "Shoulder", (0, 0.098, 0.100), (0, 1, 0), -2.08567, 2.08567, 8.26797, 1.329,
    ),
    "ShoulderRoll": (
        "Shoulder", "Bicep", (0, 0, 0), (0, 0, 1), -0.314159, 1.32645, 7.19407, 1.7835,
    ),
    "ElbowYaw": (
        "Bicep", "Elbow", (0.105, 0.015, 0), (1, 0, 0), -2.08567, 2.08567, 8.26797, 1.547,
    ),
    "ElbowRoll": (
        "Elbow", "ForeArm", (0, 0, 0), (0, 0, 1), -1.54462, -0.0349066, 7.19407, 1.532,
    ),
    "WristYaw": (
        "ForeArm", "wrist", (0.05595, 0, 0), (1, 0, 0), -1.82387, 1.82387, 24.6229, 0.4075,
    ),
}  # fmt: skip

LEG_JOINTS: Final[dict[str, tuple[str, str, Vector, Vector, float, float, float, float]]] = {
    "HipYawPitch": (
        "torso", "Pelvis", (0, 0.05, -0.085), (0, 0.7071, -0.7071),
        -1.14529, 0.740718, 4.16174, 3.348,
    ),
    "HipRoll": ("Pelvis", "Hip", (0, 0, 0), (1, 0, 0), -0.379435, 0.79046, 4.16174, 3.348),
    "HipPitch": ("Hip", "Thigh", (0, 0, 0), (0, 1, 0), -1.53589, 0.48398, 6.40239, 3.023),
    "KneePitch": ("Thigh", "Tibia", (0, 0, -0.100), (0, 1, 0), -0.0923279, 2.11255, 6.40239, 3.023),
    "AnklePitch": (
        "Tibia", "AnklePitch", (0, 0, -0.1029), (0, 1, 0), -1.18944, 0.922581, 6.40239, 3.023,
    ),
    "AnkleRoll": (
        "AnklePitch", "ankle", (0, 0, 0), (1, 0, 0), -0.397761, 0.768992, 4.16174, 3.348,
    ),
}  # fmt: skip

RIGHT_ANKLE_PITCH_LIMITS: Final = (-1.1863, 0.932006)
SOLE: Final[Vector] = (0, 0, -0.04511)

# The hand. Fingers are not mirrored: both hands have the same phalanx frames (Finger1 on +y).
# One motor drives all phalanges: joint value = .999899 x Hand, 1 = open and straight.
PHALANX_RANGE: Final = 0.999899
PHALANX_VELOCITY: Final = 12.56
PHALANX_EFFORT: Final = 0.144
PHALANGES: Final[dict[str, tuple[str, Vector, Vector]]] = {
    # name: (parent, origin, rpy); the axis is z throughout
    "Finger11": ("wrist", (0.06907, 0.01157, -0.00304), (1.8862, 0.976662, 0.264067)),
    "Finger12": ("Finger11", (0.01436, 0, 0), (0, 0, -0.999899)),
    "Finger13": ("Finger12", (0.01436, 0, 0), (0, 0, -0.999899)),
    "Finger21": ("wrist", (0.06907, -0.01157, -0.00304), (1.25539, 0.976662, -0.264067)),
    "Finger22": ("Finger21", (0.01436, 0, 0), (0, 0, -0.999899)),
    "Finger23": ("Finger22", (0.01436, 0, 0), (0, 0, -0.999899)),
    "Thumb1": ("wrist", (0.04895, 0, -0.02638), (-1.5708, 0.0472984, 0)),
    "Thumb2": ("Thumb1", (0.01236, -0.0015, 0), (0, 0, -0.999899)),
}
GRIPPER_FRAME: Final[dict[str, Vector]] = {
    "l_gripper": (0.05775, 0, -0.01231),
    "r_gripper": (0.05775, 0, -0.01213),
}

HEAD_PITCH_LIMITS_DEG: Final = (
    # (|HeadYaw|, lowest HeadPitch, highest HeadPitch), symmetric in yaw (*Joints*)
    (0.0, -38.50, 29.51),
    (27.85, -38.50, 24.18),
    (43.32, -31.40, 21.20),
    (51.74, -27.50, 18.91),
    (62.45, -24.64, 17.19),
    (87.49, -18.91, 11.46),
    (119.52, -25.73, 18.91),
)

MASSES: Final[dict[str, tuple[float, Vector, Vector, Vector]]] = {
    # link: (mass, centre of mass, (Ixx, Iyy, Izz), (Ixy, Ixz, Iyz)) at the centre of mass, V50
    "torso": (
        1.04956, (-0.00413, 0, 0.04342),
        (3.08361e-3, 2.8835e-3, 1.5924e-3), (1.43116e-5, -3.30211e-5, -2.70793e-5),
    ),
    "Neck": (
        0.07842, (-0.00001, 0, -0.02742),
        (1.60324e-5, 1.70394e-5, 5.53372e-6), (1.57e-9, 3.16e-9, -5.295e-8),
    ),
    "Head": (
        0.60533, (-0.00112, 0, 0.05258),
        (9.57766e-4, 8.16836e-4, 9.84976e-4), (8.78814e-6, 5.33702e-6, -2.99579e-5),
    ),
    "Shoulder": (
        0.09304, (-0.00165, -0.02663, 0.00014),
        (1.83025e-5, 1.39005e-5, 2.01862e-5), (2.06011e-6, 1.89e-9, -3.66592e-7),
    ),
    "Bicep": (
        0.15777, (0.02455, 0.00563, 0.0033),
        (8.7181e-5, 2.74712e-4, 2.41812e-4), (-2.53381e-5, -1.4213e-5, 4.71e-7),
    ),
    "Elbow": (
        0.06483, (-0.02744, 0, -0.00014),
        (5.59588e-6, 2.66179e-5, 2.76294e-5), (4.21e-9, 2.92241e-7, -1.84e-9),
    ),
    "ForeArm": (
        0.07761, (0.02556, 0.00281, 0.00076),
        (2.46746e-5, 3.83837e-5, 3.59708e-5), (3.23152e-6, 1.58221e-6, 1.39e-7),
    ),
    "wrist": (
        0.18533, (0.03434, -0.00088, 0.00308),
        (6.86477e-5, 1.35756e-4, 1.33228e-4), (1.15e-7, -2.87254e-6, 2.67539e-6),
    ),
    "Pelvis": (
        0.06981, (-0.00781, -0.01114, 0.02661),
        (2.3407e-5, 4.76355e-5, 4.97021e-5), (1.07922e-6, -1.76003e-6, 2.76058e-6),
    ),
    "Hip": (
        0.14053, (-0.01549, 0.00029, -0.00515),
        (2.38445e-5, 6.08246e-5, 5.43691e-5), (-6.53605e-7, 7.12893e-6, -2.14e-7),
    ),
    "Thigh": (
        0.38968, (0.00138, 0.00221, -0.05373),
        (5.09844e-4, 4.65358e-4, 3.01098e-4), (2.11296e-6, 5.64129e-5, -7.91029e-6),
    ),
    "Tibia": (
        0.30142, (0.00453, 0.00225, -0.04936),
        (4.46171e-4, 3.88084e-4, 1.85516e-4), (3.70584e-6, -3.09008e-5, 6.01953e-6),
    ),
    "AnklePitch": (
        0.13416, (0.00045, 0.00029, 0.00685),
        (3.22034e-5, 6.7943e-5, 5.48269e-5), (-8.8e-9, 4.27549e-6, 2.85e-7),
    ),
    "ankle": (
        0.17184, (0.02542, 0.0033, -0.03239),
        (8.72911e-5, 3.53024e-4, 4.12846e-4), (8.71925e-6, -2.10563e-6, 3.73e-7),
    ),
}  # fmt: skip

TOTAL_MASS: Final = 5.3054
"""Sum of the published link masses; the 4.3 kg of Gatto 2016, Table 1 is another count."""

RIGHT_INERTIA: Final[dict[str, tuple[Vector, Vector]]] = {
    # right links whose published tensor is not the mirror of the left one
    "Bicep": (
        (1.03401e-4, 2.7077e-4, 2.54529e-4), (5.48849e-5, -1.32643e-5, 9.16707e-6),
    ),
    "Pelvis": (
        (3.18766e-5, 5.18361e-5, 5.39657e-5), (-1.07152e-6, -1.77295e-6, -7.00664e-6),
    ),
    "Tibia": (
        (4.46171e-4, 3.88084e-4, 1.85516e-4), (-3.70584e-6, -3.94e-5, -6.01953e-6),
    ),
    "wrist": (
        (6.86477e-5, 1.35756e-4, 1.33228e-4), (1.13165e-5, -2.87254e-6, 3.68e-6),
    ),
}  # fmt: skip

SENSOR_FRAMES: Final[dict[str, tuple[str, Vector, Vector]]] = {
    # name: (parent, origin, rpy)
    "CameraTop_frame": ("Head", (0.05871, 0, 0.06364), (0, 0.0209435, 0)),
    "CameraBottom_frame": ("Head", (0.05071, 0, 0.01774), (0, 0.692896, 0)),
    "HeadTouchFront_frame": ("Head", (0.0312, 0, 0.1014), (0, 0, 0)),
    "HeadTouchMiddle_frame": ("Head", (0.001, 0, 0.1099), (0, 0, 0)),
    "HeadTouchRear_frame": ("Head", (-0.0257, 0, 0.1045), (0, 0, 0)),
    "Accelerometer_frame": ("torso", (-0.008, 0.00606, 0.027), (0, 0, 0)),
    "Gyrometer_frame": ("torso", (-0.008, 0.006, 0.029), (0, 0, 0)),
}
HAND_TOUCH_FRAMES: Final[dict[str, tuple[Vector, Vector]]] = {
    # name: (origin, rpy) in the wrist frame, the same on both hands
    "HandTouchLeft": ((0.032, 0.025, 0.003), (0, 0, 1.5707963)),
    "HandTouchRight": ((0.035, -0.025, 0.0035), (0, 0, -1.5707963)),
    "HandTouchBack": ((0.038, 0, 0.025), (0, -1.5707963, 0)),
}
FORCE_SENSORS_LEFT_FOOT: Final[dict[str, Vector]] = {
    "FsrFL": (0.07025, 0.0299, -0.04511),
    "FsrFR": (0.07025, -0.0231, -0.04511),
    "FsrRL": (-0.03025, 0.0299, -0.04511),
    "FsrRR": (-0.02965, -0.0191, -0.04511),
}
