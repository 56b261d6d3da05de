"""Models as COLMAP makes them."""

import pycolmap


def synthesized(
    seed: int, frames: int, points: int, noise: float = 0.0, **camera: object
) -> pycolmap.Reconstruction:
    """A model of pictures of one camera, whose points are located to ``noise`` px; ``camera``: options of pycolmap's."""
    pycolmap.set_random_seed(seed)
    about = {"num_rigs": 1, "num_cameras_per_rig": 1, "num_frames_per_rig": frames, "num_points3D": points}
    model = pycolmap.synthesize_dataset(pycolmap.SyntheticDatasetOptions(**about | camera))
    if noise:
        pycolmap.synthesize_noise(pycolmap.SyntheticNoiseOptions(point2D_stddev=noise), model)
    return model
