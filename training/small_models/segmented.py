"""Masks that the small SAM2 finds in images, as the stage ``segments`` does, without its crops of the image."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from egosplat.models.sam2_loader import load_sam2
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.single_frames import join_frames, segment_frame
from egosplat.segments.video import Video


def segment_images(images: NDArray[np.uint8]) -> Iterator[NDArray[np.int32]]:
    """Find the masks of each of (N, H, W, 3) images.

    Yields:
        (L, H, W) int32 masks at each level, numbered across all images; -1 for none.
    """
    # Crops of the image find smaller things, and take four fifths of the time.
    options = SegmentsOptions(track_moving="never", crops_per_side=1, device="cpu")
    sam2 = load_sam2(options.sam2_config, options.sam2_checkpoint, options.device, options.precision, None)
    valid = np.ones(images.shape[1:3], bool)
    video, every = Video(len(images), images.__getitem__, lambda _: valid), range(len(images))
    masks = [segment_frame(sam2, video, frame, options) for frame in every]
    found = join_frames(masks, every, len(images), valid.shape)
    return (found.labels[frame] for frame in every)
