"""The skeleton of a person who walks, bends and holds objects."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import make_pose

Array = NDArray[np.float64]
THIGH, SHIN, _ANKLE = 0.43, 0.42, 0.08
UPPER_ARM, FOREARM, _HAND = 0.29, 0.26, 0.09
_TORSO, _HIP_HEIGHT, _HIP_HALF, _SHOULDER_HALF = 0.5, 0.92, 0.09, 0.19

_STRIDE_M = 1.3

_UP = np.array([0.0, 1.0, 0.0])

# Order of the joints in a skeleton.
JOINTS = [
    "hips",
    "chest",
    "neck",
    "head",
    "left_shoulder",
    "left_elbow",
    "left_wrist",
    "left_hand",
    "right_shoulder",
    "right_elbow",
    "right_wrist",
    "right_hand",
    "left_hip",
    "left_knee",
    "left_ankle",
    "left_toe",
    "right_hip",
    "right_knee",
    "right_ankle",
    "right_toe",
]


@dataclass(frozen=True)
class Stance:
    """A person's posture at one moment.

    Attributes:
        place: (2,) x and z of the body's center; heading [rad]; walked: distance so far [m].
        crouch: how far the shoulders move down [m]; lean: how far they move forward [m].
        hands: (left, right) (3,) targets of the palms, None for an arm that hangs.
        reach: 0..1, progress of the hands towards their targets.
        lively: 0..1, amplitude of the swing of legs and arms.
    """

    place: Array
    heading: float
    walked: float
    crouch: float
    lean: float
    hands: tuple[Array | None, Array | None]
    reach: float
    lively: float


def joints_of(stance: Stance) -> dict[str, Array]:
    """(3,) position of every one of ``JOINTS`` in the world."""
    forward = np.array([np.sin(stance.heading), 0.0, np.cos(stance.heading)])
    right = np.cross(forward, _UP)
    ground = np.array([stance.place[0], 0.0, stance.place[1]])
    phase = 2 * np.pi * stance.walked / _STRIDE_M
    # The knees give 45 % of a crouch. The rest comes from the hips, which also tilt the shoulders forward.
    drop = 0.45 * stance.crouch
    bob = 0.012 * stance.lively * np.cos(2 * phase)
    tilt = np.arctan2(stance.lean + 0.12 * stance.crouch, _TORSO)
    tilt = max(
        tilt,
        math.acos(np.clip(1 - (stance.crouch - drop) / _TORSO, -1, 1)) if stance.crouch > 0 else 0.0,
    )
    tilt = min(tilt, 1.3)
    back = 0.35 * _TORSO * np.sin(tilt) - 0.3 * stance.lean
    joints = {"hips": ground + (_HIP_HEIGHT - drop + bob) * _UP - back * forward}
    spine = np.cos(tilt) * _UP + np.sin(tilt) * forward
    joints["chest"] = joints["hips"] + 0.6 * _TORSO * spine
    joints["neck"] = joints["hips"] + _TORSO * spine
    joints["head"] = joints["neck"] + 0.2 * (0.75 * _UP + 0.25 * spine + 0.12 * forward)
    for side, sign, hand in (("left", -1, stance.hands[0]), ("right", 1, stance.hands[1])):
        swing = stance.lively * np.sin(phase + (0 if sign > 0 else np.pi))
        joints[f"{side}_hip"] = joints["hips"] + sign * _HIP_HALF * right
        lift = max(0.0, stance.lively * np.cos(phase + (np.pi if sign > 0 else 0.0)))
        ankle = ground + (_ANKLE + 0.07 * lift) * _UP + sign * _HIP_HALF * right - 0.27 * swing * forward
        joints[f"{side}_knee"], joints[f"{side}_ankle"] = _bend(
            joints[f"{side}_hip"], ankle, THIGH, SHIN, forward
        )
        joints[f"{side}_toe"] = joints[f"{side}_ankle"] + 0.16 * forward - 0.05 * _UP
        shoulder = joints["neck"] - 0.06 * spine + sign * _SHOULDER_HALF * right
        rest = shoulder - 0.53 * _UP + (0.06 + 0.16 * swing) * forward + sign * 0.06 * right
        wrist = rest if hand is None else rest + stance.reach * (_wrist_for(shoulder, hand) - rest)
        elbow_way = -0.6 * _UP + sign * 0.5 * right - 0.5 * forward
        elbow, wrist = _bend(shoulder, wrist, UPPER_ARM, FOREARM, elbow_way)
        palm = (
            rest - _HAND * _UP
            if hand is None
            else rest - _HAND * _UP + stance.reach * (hand - rest + _HAND * _UP)
        )
        joints[f"{side}_shoulder"], joints[f"{side}_elbow"], joints[f"{side}_wrist"] = shoulder, elbow, wrist
        joints[f"{side}_hand"] = wrist + _HAND * _unit(palm - wrist)
    return joints


def _wrist_for(shoulder: Array, hand: Array) -> Array:
    """The wrist position one palm's length before the hand, on the line from the shoulder."""
    return hand - _HAND * _unit(hand - shoulder)


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector, axis=-1)), 1e-9)


def _bend(root: Array, end: Array, upper: float, lower: float, bulge: Array) -> tuple[Array, Array]:
    """Middle and end joint of a limb of two bones that reaches for ``end``, bent towards ``bulge``."""
    way = end - root
    distance = float(np.clip(np.linalg.norm(way, axis=-1), 0.12, 0.999 * (upper + lower)))
    way = _unit(way)
    along = (upper**2 - lower**2 + distance**2) / (2 * distance)
    side = _unit(bulge - (bulge * way).sum() * way)
    middle = root + along * way + np.sqrt(max(upper**2 - along**2, 0.0)) * side
    return middle, root + distance * way


# Joints of each limb: the first is its origin, its y axis points to the second.
LIMBS = {
    "pelvis": ("hips", "chest"),
    "torso": ("hips", "neck"),
    "head": ("neck", "head"),
    **{
        f"{side} {limb}": (f"{side}_{start}", f"{side}_{end}")
        for side in ("left", "right")
        for limb, start, end in (
            ("upper arm", "shoulder", "elbow"),
            ("forearm", "elbow", "wrist"),
            ("hand", "wrist", "hand"),
            ("thigh", "hip", "knee"),
            ("shin", "knee", "ankle"),
            ("shoe", "ankle", "toe"),
        )
    },
}

ARMS = tuple(limb for limb in LIMBS if limb.split()[-1] in ("arm", "forearm", "hand"))


def limb_pose(limb: str, joints: dict[str, Array], heading: float) -> Array:
    """(4, 4) ``world_from_limb``: x points to the person's left, as far as the y axis allows."""
    start, end = (joints[name] for name in LIMBS[limb])
    y = _unit(end - start)
    left = -np.cross([np.sin(heading), 0.0, np.cos(heading)], _UP)
    x = _unit(left - (left * y).sum() * y)
    return make_pose(np.stack([x, y, np.cross(x, y)], axis=1), start)
