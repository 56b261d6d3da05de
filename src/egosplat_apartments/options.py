"""Options of the stage ``synthetic``."""

from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import Auto, Natural, Options, Positive, Share


class SyntheticOptions(Options):
    """The synthetic apartment that replaces an ADT recording if no ADT root is set."""

    seed: Natural = 0
    """Seed of the apartment. Two seeds share no layout. The table of scenes sets it for each scene."""

    walk: Natural = 0
    """Number of the walk. Another one films the same apartment again, as it was at first, with other people."""

    world: Literal["usual", "busy", "foreign"] = "usual"
    """What is recorded. usual: the apartments that the small models were trained on. busy: a fuller room in which two
    people carry one thing after another, each to several places, for 24 s or more. foreign: furniture, floor
    plans, textures and lights that no model was trained on (benchmarks/worlds/README.md)."""

    size: Annotated[int, Field(ge=64, le=1408)] = 704
    """Side of the square frames in pixels. Time grows with its square."""

    fps: Annotated[float, Field(le=30, gt=0)] = 5.0
    """Frames per second. ADT has 30; fewer make the same walk cheaper."""

    seconds: Positive = 24.0
    """Length of the recording in seconds. A longer recording covers more of the room, from more sides."""

    objects: Annotated[int, Field(ge=16, le=60)] = 24
    """Number of nameable objects in the room. A usual or foreign room holds about 40, a busy one 50."""

    motion: Share = 0.5
    """Fraction of the recording, 0 to 1, during which people are active. 0 is a static scene."""

    camera: Literal["ideal", "real", "poses", "exposure", "shutter", "sensor"] = "ideal"
    """Camera that records (benchmarks/real_camera/README.md). ideal: exact poses, an instant per frame, constant
    exposure. real: all effects of a camera like an Aria's. One group of them: poses that drift, changing exposure and
    white balance, motion blur and rolling shutter, or noise, vignetting and compression of the sensor."""

    camera_strength: Annotated[float, Field(ge=0, le=16)] = 1.0
    """Factor on every effect of the camera, those of set keys included; on drift_s it has no effect. 0 is an ideal
    camera."""

    drift_mm: Annotated[float, Field(ge=0, le=1000)] | Auto = "auto"
    """RMS error in millimeters of the device's position in the closed-loop trajectory, which changes slowly. The
    semi-dense points drift with it. aria_trajectory.csv stays exact (poses.trajectory ground_truth). auto is 10
    where poses drift."""

    drift_deg: Annotated[float, Field(ge=0, le=90)] | Auto = "auto"
    """RMS error in degrees of the device's orientation in the closed-loop trajectory. auto is 0.2 where poses
    drift."""

    drift_s: Annotated[float, Field(ge=0.1)] = 5.0
    """Time in seconds over which the error of the closed-loop trajectory changes."""

    auto_exposure_stops: Annotated[float, Field(ge=0, le=20)] | Auto = "auto"
    """Range of the recording's exposure in stops (factors of two). Auto-exposure darkens bright views with a lag of
    0.3 s, first by exposure time, beyond 14 ms by gain. auto is 1 where
    the exposure changes."""
