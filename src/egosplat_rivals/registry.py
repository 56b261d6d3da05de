"""What this package adds to the pipeline: the stage ``tiles``, methods of others, and formats of their benchmarks."""

from egosplat.pipeline.stage import Stage

STAGES = (
    Stage(
        "tiles",
        "egosplat_rivals.tiles_stage",
        "Encode tiles of the frames, for methods of others.",
        options="egosplat_rivals.options:TilesOptions",
        output="tiles.zarr",
        inputs=("frames",),
        optional=("survey",),
        libraries=("numpy", "open_clip_torch", "pillow", "torch", "torchvision", "sam2", "zarr"),
        by_chunks=True,
        request=(6000, 1000, 60, 2000),
        before="language",
        aside=True,
    ),
)

# Options of sections that belong to no stage.
SECTIONS = {
    "tables": "egosplat_rivals.options:TablesOptions",
    "tradeoff": "egosplat_rivals.options:TradeoffOptions",
}

# Modules by stage and by the value that chooses them.
MODULES = {
    "frames": {"lerf": "egosplat_rivals.formats.lerf", "3d_ovs": "egosplat_rivals.formats.ovs"},
    "annotations": {"lerf": "egosplat_rivals.formats.lerf", "3d_ovs": "egosplat_rivals.formats.ovs"},
    "language": {
        "trained": "egosplat_rivals.langsplat",
        "projected": "egosplat_rivals.semantic_gaussians",
        "center": "egosplat_rivals.occam",
        "clustered": "egosplat_rivals.splat_feature_solver",
        "sparse": "egosplat_rivals.langsplat_v2",
        "granular": "egosplat_rivals.gags",
        "field": "egosplat_rivals.lerf",
        "quantized": "egosplat_rivals.legaussians",
    },
}
