"""Put the recording on the page: poses of all frames, and small pictures of some."""

import numpy as np

from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Array, known_poses
from egosplat.images import encode_webp, evenly_spaced, shrink_image
from egosplat.viewing.container import Arrays, Facts

# Largest number of pictures, their longer side [px] and the quality of WebP.
PICTURES, SIDE, QUALITY = 40, 256, 60


def pack_frames(frames: Artifact, camera_to_world: Array) -> tuple[Arrays, Facts]:
    """Pack ``poses`` (P, 3, 4) float32 of all frames that have one, and ``pictures`` uint8, WebP files of some in a row.

    Args:
        camera_to_world: (F, 4, 4) float64, NaN without a pose.
    """
    posed = known_poses(camera_to_world)
    shown = posed[evenly_spaced(len(posed), PICTURES)].tolist()
    files = [encode_webp(shrink_image(frames.row("rgb", frame), SIDE), QUALITY) for frame in shown]
    arrays = {
        "poses": camera_to_world[posed, :3].astype(np.float32),
        "pictures": np.concatenate(files) if files else np.zeros(0, np.uint8),
    }
    seconds = (frames.read("timestamp_ns")[posed] - frames.read("timestamp_ns")[posed[:1]]) / 1e9
    return arrays, {
        "frames": posed.tolist(),
        "seconds": np.round(seconds, 2).tolist(),
        "pictures": [{"frame": frame, "bytes": len(file)} for frame, file in zip(shown, files, strict=True)],
    }
