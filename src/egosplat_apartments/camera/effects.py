"""The effects of a real camera, from the keys of ``synthetic``, in SI units (benchmarks/real_camera/README.md)."""

import math
from dataclasses import dataclass

from egosplat_apartments.options import SyntheticOptions

# The effects of ``camera: real`` by group, which is a value of the key, too; benchmarks/real_camera/README.md has their sources.
REAL = {
    "poses": {"drift_m": 0.01, "drift_rad": math.radians(0.2), "time_offset_ns": 2.5e6},
    "exposure": {"exposure_stops": 1.0, "white_balance": 0.03},
    "shutter": {"exposure_s": 0.009, "readout_s": 0.005},
    "sensor": {"shot_noise": 0.01, "read_noise": 0.001, "vignetting": 0.1, "jpeg_loss": 5.0},
}

# Keys that set an effect alone, with the effect and its unit.
KEYS = {
    "drift_mm": ("drift_m", 1e-3),
    "drift_deg": ("drift_rad", math.pi / 180),
    "auto_exposure_stops": ("exposure_stops", 1.0),
}


@dataclass(frozen=True)
class Effects:
    """The effects of one recording; the defaults are an ideal camera.

    Attributes:
        drift_m, drift_rad: RMS error of position and orientation of the closed-loop trajectory.
        drift_s: time over which the error changes.
        time_offset_ns: the closed-loop trajectory has the pose of this much later.
        exposure_s: time over which light is integrated, 0 for an instant.
        readout_s: from the readout of the first row to that of the last.
        exposure_stops: range of the brightness that auto-exposure covers.
        white_balance: standard deviation of the gains of red and blue.
        shot_noise: standard deviation at white, as a fraction of it; it grows with the root of the signal.
        read_noise: standard deviation as a fraction of white.
        vignetting: fraction of the light that is lost at the edge of the lens circle, beyond the ideal lens.
        jpeg_loss: by how much the quality of the stored frames is below 95.
    """

    drift_m: float = 0.0
    drift_rad: float = 0.0
    drift_s: float = 5.0
    time_offset_ns: float = 0.0
    exposure_s: float = 0.0
    readout_s: float = 0.0
    exposure_stops: float = 0.0
    white_balance: float = 0.0
    shot_noise: float = 0.0
    read_noise: float = 0.0
    vignetting: float = 0.0
    jpeg_loss: float = 0.0

    @property
    def drifts(self) -> bool:
        """Whether the poses of the closed-loop trajectory drift."""
        return bool(self.drift_m or self.drift_rad)

    @property
    def change_light(self) -> bool:
        """Whether an image is more than a rendering of one instant."""
        shutter = self.exposure_s or self.readout_s
        return bool(shutter or self.white_balance or self.vignetting or self.noisy)

    @property
    def noisy(self) -> bool:
        """Whether the sensor adds noise."""
        return bool(self.shot_noise or self.read_noise)

    @property
    def jpeg_quality(self) -> int:
        """Quality of the stored frames, 1 to 95."""
        return max(1, round(95 - self.jpeg_loss))


IDEAL = Effects()


def make_effects(options: SyntheticOptions) -> Effects:
    """The effects that the keys ask for, each multiplied by ``camera_strength``."""
    groups = REAL if options.camera == "real" else REAL.keys() & {options.camera}
    values = {name: value for group in groups for name, value in REAL[group].items()}
    for key, (name, unit) in KEYS.items():
        if (value := getattr(options, key)) != "auto":
            values[name] = unit * value
    strong = {name: options.camera_strength * value for name, value in values.items()}
    return Effects(drift_s=options.drift_s, **strong)
