"""The effects of a real camera, from the keys of ``synthetic``, in SI units (benchmarks/real_camera/README.md)."""

from dataclasses import dataclass

import numpy as np

from egosplat_apartments.options import SyntheticOptions

# Values of the keys that are ``auto``, with ``camera: real``; benchmarks/real_camera/README.md has their sources.
REAL = {
    "drift_mm": 10.0,
    "drift_deg": 0.2,
    "time_offset_ms": 2.5,
    "exposure_ms": 9.0,
    "readout_ms": 5.0,
    "auto_exposure_stops": 1.0,
    "white_balance_percent": 3.0,
    "shot_noise_percent": 1.0,
    "read_noise_percent": 0.1,
    "vignetting_percent": 10.0,
}
_REAL_JPEG, _IDEAL_JPEG = 90, 95


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
        jpeg_quality: 1 to 95.
    """

    drift_m: float = 0.0
    drift_rad: float = 0.0
    drift_s: float = 5.0
    time_offset_ns: int = 0
    exposure_s: float = 0.0
    readout_s: float = 0.0
    exposure_stops: float = 0.0
    white_balance: float = 0.0
    shot_noise: float = 0.0
    read_noise: float = 0.0
    vignetting: float = 0.0
    jpeg_quality: int = _IDEAL_JPEG

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


IDEAL = Effects()


def make_effects(options: SyntheticOptions) -> Effects:
    """The effects that the keys ask for, each multiplied by ``camera_strength``."""
    strength, real = options.camera_strength, options.camera == "real"

    def scaled(key: str) -> float:
        value = getattr(options, key)
        return strength * ((REAL[key] if real else 0.0) if value == "auto" else value)

    quality = options.jpeg_quality
    if quality == "auto":
        quality = _REAL_JPEG if real else _IDEAL_JPEG
    # Strength 0 is the ideal camera's quality, 1 the given one; beyond, the loss grows in proportion.
    quality = round(_IDEAL_JPEG - strength * (_IDEAL_JPEG - quality))
    return Effects(
        drift_m=scaled("drift_mm") * 1e-3,
        drift_rad=float(np.deg2rad(scaled("drift_deg"))),
        drift_s=options.drift_s,
        time_offset_ns=round(scaled("time_offset_ms") * 1e6),
        exposure_s=scaled("exposure_ms") * 1e-3,
        readout_s=scaled("readout_ms") * 1e-3,
        exposure_stops=scaled("auto_exposure_stops"),
        white_balance=scaled("white_balance_percent") * 0.01,
        shot_noise=scaled("shot_noise_percent") * 0.01,
        read_noise=scaled("read_noise_percent") * 0.01,
        vignetting=scaled("vignetting_percent") * 0.01,
        jpeg_quality=int(np.clip(quality, 1, _IDEAL_JPEG)),
    )
