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

    camera: Literal["ideal", "real"] = "ideal"
    """Camera that records. ideal: exact poses, an instant per frame, constant exposure. real: drift, motion blur,
    rolling shutter, auto-exposure and noise like an Aria's, each by a key of its own whose value auto is on under
    real and off under ideal (benchmarks/real_camera/README.md)."""

    camera_strength: Annotated[float, Field(ge=0, le=16)] = 1.0
    """Factor on every effect of the camera, those of set keys included; on drift_s it has no effect. 0 is an ideal
    camera."""

    drift_mm: Annotated[float, Field(ge=0, le=1000)] | Auto = "auto"
    """RMS error in millimeters of the device's position in the closed-loop trajectory, which changes slowly. The
    semi-dense points drift with it. aria_trajectory.csv stays exact (poses.trajectory ground_truth). auto is 10
    under real."""

    drift_deg: Annotated[float, Field(ge=0, le=90)] | Auto = "auto"
    """RMS error in degrees of the device's orientation in the closed-loop trajectory. auto is 0.2 under real."""

    drift_s: Annotated[float, Field(ge=0.1)] = 5.0
    """Time in seconds over which the error of the closed-loop trajectory changes."""

    time_offset_ms: Annotated[float, Field(ge=-10000, le=10000)] | Auto = "auto"
    """Time in milliseconds by which the closed-loop trajectory is ahead of the camera: its row of a time has the
    pose of this much later. Beyond the recording the device stands still. auto is 2.5 under real."""

    exposure_ms: Annotated[float, Field(ge=0, le=50)] | Auto = "auto"
    """Exposure time in milliseconds over which motion blurs a frame; auto-exposure varies it. 0 renders an instant.
    Each pixel of blur costs one more rendering, up to 8. auto is 9 under real."""

    readout_ms: Annotated[float, Field(ge=0, le=50)] | Auto = "auto"
    """Time in milliseconds from the readout of the first sensor row to that of the last (rolling shutter). The
    middle row is exposed at the frame's own time. auto is 5 under real."""

    auto_exposure_stops: Annotated[float, Field(ge=0, le=20)] | Auto = "auto"
    """Range of the recording's exposure in stops (factors of two). Auto-exposure darkens bright views with a lag of
    0.3 s, first by exposure time, beyond 14 ms by gain. auto is 1 under real."""

    white_balance_percent: Annotated[float, Field(ge=0, le=100)] | Auto = "auto"
    """Standard deviation in percent of the gains of red and blue, which drift within seconds. auto is 3 under
    real."""

    shot_noise_percent: Annotated[float, Field(ge=0, le=100)] | Auto = "auto"
    """Standard deviation of the noise at white in percent of white, in linear light; its variance grows linearly
    with the light. 1 is that of 10,000 electrons. auto is 1 under real."""

    read_noise_percent: Annotated[float, Field(ge=0, le=100)] | Auto = "auto"
    """Standard deviation of the noise at black in percent of white, in linear light. auto is 0.1 under real."""

    vignetting_percent: Annotated[float, Field(ge=0, le=100)] | Auto = "auto"
    """Light in percent that is lost at the edge of the lens circle, in addition to the falloff of the ideal lens.
    auto is 10 under real."""

    jpeg_quality: Annotated[int, Field(ge=1, le=95)] | Auto = "auto"
    """Quality of the stored frames on Pillow's scale. camera_strength multiplies its difference from 95. auto is 90
    under real, else 95."""
