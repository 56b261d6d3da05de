"""Bundle adjustment of a whole model."""

import pycolmap


def adjust(model: pycolmap.Reconstruction, focal_length: bool, distortion: bool = False) -> None:
    """Refine all poses and points of a model in place.

    Args:
        focal_length, distortion: whether these of its camera are refined too. The principal point is kept.
    """
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.refine_focal_length = focal_length
    options.refine_extra_params = distortion
    # With more threads, the result depends on their order.
    options.ceres.solver_options.num_threads = 1
    config = pycolmap.BundleAdjustmentConfig()
    for number in model.reg_image_ids():
        config.add_image(number)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # ``pycolmap.bundle_adjustment`` does the same, and logs past every level.
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()
