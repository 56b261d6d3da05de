"""A person who walks, bends and holds objects: the skeleton, the surfaces of the limbs, and clothes."""

import math
from dataclasses import dataclass

import numpy as np

from egosplat.geometry import make_pose
from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.objects.materials import some_fabric
from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.shapes import Part, Shape, cushion, ellipsoid, join, rod
from egosplat_apartments.objects.textures import Texture, cloth, make_texture, noise, shaded, speckled

THIGH, SHIN, _ANKLE = 0.43, 0.42, 0.08
UPPER_ARM, FOREARM, _HAND = 0.29, 0.26, 0.09
_TORSO, _HIP_HEIGHT, _HIP_HALF, _SHOULDER_HALF = 0.5, 0.92, 0.09, 0.19

# Length of a stride of two steps.
STRIDE_M = 1.3

_UP = np.array([0.0, 1.0, 0.0])

# Order of the joints in a skeleton.
JOINTS = ["hips", "chest", "neck", "head"] + [
    f"{side}_{joint}"
    for limb in (("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "toe"))
    for side in ("left", "right")
    for joint in limb
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
    phase = 2 * np.pi * stance.walked / STRIDE_M
    # The knees give 45 % of a crouch. The rest comes from the hips, which also tilt the shoulders forward.
    drop = 0.45 * stance.crouch
    bob = 0.012 * stance.lively * np.cos(2 * phase)
    tilt = np.arctan2(stance.lean + 0.12 * stance.crouch, _TORSO)
    tilt = max(
        tilt, math.acos(np.clip(1 - (stance.crouch - drop) / _TORSO, -1, 1)) if stance.crouch > 0 else 0.0
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
        wrist, palm = rest, rest - _HAND * _UP
        if hand is not None:
            # The wrist is one palm's length before the hand, on the line from the shoulder.
            wrist = rest + stance.reach * (hand - _HAND * _unit(hand - shoulder) - rest)
            palm = rest - _HAND * _UP + stance.reach * (hand - rest + _HAND * _UP)
        elbow_way = -0.6 * _UP + sign * 0.5 * right - 0.5 * forward
        elbow, wrist = _bend(shoulder, wrist, UPPER_ARM, FOREARM, elbow_way)
        joints[f"{side}_shoulder"], joints[f"{side}_elbow"], joints[f"{side}_wrist"] = shoulder, elbow, wrist
        joints[f"{side}_hand"] = wrist + _HAND * _unit(palm - wrist)
    return joints


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


@dataclass(frozen=True)
class Clothes:
    """Textures of a person."""

    skin: Texture
    shirt: Texture
    trousers: Texture
    hair: Texture
    shoes: Texture


def random_clothes(rng: Rng) -> Clothes:
    """Random clothes, skin and hair."""
    tones = ((0.86, 0.66, 0.52), (0.62, 0.42, 0.3), (0.4, 0.27, 0.2), (0.93, 0.76, 0.65))
    skin = tones[rng.integers(len(tones))]
    hair = ((0.15, 0.1, 0.08), (0.45, 0.3, 0.15), (0.6, 0.58, 0.55))[rng.integers(3)]
    return Clothes(
        make_texture(shaded(skin, 0.06 * noise(rng, (128, 128), 1.2)), 0.3, surface="skin"),
        some_fabric(rng),
        make_texture(cloth(rng, random_color(rng, (0.2, 0.6), (0.2, 0.5)), 0.25), 0.3, surface="plain cloth"),
        make_texture(shaded(hair, 0.25 * noise(rng, (128, 128), 0.8, 8.0)), 0.2, surface="hair"),
        make_texture(
            speckled(rng, random_color(rng, (0.1, 0.8), (0.2, 0.8)), (0.9, 0.9, 0.9), 60),
            0.2,
            surface="leather",
        ),
    )


def limb_parts(limb: str, clothes: Clothes) -> tuple[Part, ...]:
    """The surfaces of a limb in its own axes."""
    match limb.split()[-1]:
        case "pelvis":
            return (Part(limb, ellipsoid((0.17, 0.15, 0.12), (0, 0.0, 0)), clothes.trousers),)
        case "torso":
            trunk = [
                ellipsoid((0.165, 0.3, 0.115), (0, 0.24, 0)),
                ellipsoid((0.2, 0.16, 0.115), (0, 0.37, 0)),
            ]
            return (
                Part(limb, join(trunk), clothes.shirt),
                Part("neck", rod((0, 0.46, 0), (0, 0.58, 0), 0.052), clothes.skin),
            )
        case "head":
            return _head_parts(clothes)
        case "arm":
            return (Part(limb, rod((0, 0, 0), (0, UPPER_ARM, 0), 0.055, 0.045), clothes.shirt),)
        case "forearm":
            sleeve = rod((0, -0.01, 0), (0, FOREARM * 0.62, 0), 0.045, 0.04)
            return (
                Part("sleeve", sleeve, clothes.shirt),
                Part(limb, rod((0, 0.1, 0), (0, FOREARM, 0), 0.036, 0.028), clothes.skin),
            )
        case "hand":
            return (Part(limb, _hand(-1.0 if limb.startswith("left") else 1.0), clothes.skin),)
        case "thigh":
            return (Part(limb, rod((0, 0, 0), (0, THIGH, 0), 0.085, 0.062), clothes.trousers),)
        case "shin":
            return (Part(limb, rod((0, 0, 0), (0, SHIN, 0), 0.062, 0.045), clothes.trousers),)
        case _:
            return (Part(limb, cushion((-0.045, -0.05, -0.04), (0.045, 0.19, 0.045), 0.035), clothes.shoes),)


def _head_parts(clothes: Clothes) -> tuple[Part, ...]:
    """Parts of the head: y points to its top, z to the face."""
    eyes = [ellipsoid((0.012, 0.009, 0.006), (x, 0.2, 0.095), 8) for x in (-0.034, 0.034)]
    ears = [ellipsoid((0.012, 0.03, 0.02), (x, 0.185, 0.0), 8) for x in (-0.08, 0.08)]
    face = [
        ellipsoid((0.078, 0.115, 0.098), (0, 0.18, 0)),
        rod((0, 0.2, 0.09), (0, 0.165, 0.108), 0.011),
        *ears,
    ]
    hair = [
        ellipsoid((0.084, 0.085, 0.1), (0, 0.235, -0.022)),
        ellipsoid((0.075, 0.09, 0.05), (0, 0.17, -0.062)),
    ]
    white = make_texture(np.full((16, 16, 3), 0.12), 0.1)
    return (
        Part("face", join(face), clothes.skin),
        Part("hair", join(hair), clothes.hair),
        Part("eyes", join(eyes), white),
    )


def _hand(side: float) -> Shape:
    """A palm with four fingers along +y, slightly spread, and a thumb towards the middle of the body."""
    palm = cushion((-0.018, -0.02, -0.042), (0.018, 0.085, 0.042), 0.016)
    roots = [(0.0, 0.075, z) for z in (-0.032, -0.011, 0.011, 0.032)]
    fingers = [
        rod(root, (side * 0.006, 0.155 - 6 * root[2] ** 2, root[2] * 1.25), 0.0095, 0.007) for root in roots
    ]
    thumb = rod((0.0, 0.02, 0.04), (side * 0.01, 0.085, 0.072), 0.011, 0.008)
    return join([palm, *fingers, thumb])
