"""What this package adds to the pipeline: the stage ``synthetic``."""

from egosplat.pipeline.stage import Stage

STAGES = (
    Stage(
        "synthetic",
        "egosplat_apartments.stage",
        "Make the recording of a synthetic apartment.",
        options="egosplat_apartments.options:SyntheticOptions",
        output="recording",
        libraries=("numpy", "opencv-contrib-python-headless", "scipy", "projectaria-tools"),
        request=(2000, 1500, 60, 500),
        before="frames",
    ),
)

SECTIONS: dict[str, str] = {}
MODULES: dict[str, dict[str, str]] = {}
