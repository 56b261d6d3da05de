"""Stage ``features``: aggregate each instance's consistent feature, form the supervision, compress to codes."""

from pathlib import Path
from typing import Any

import torch

from egosplat.arrays import Floats
from egosplat.artifacts import provenance
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FEATURES, VIEW_FEATURES
from egosplat.artifacts.writer import create
from egosplat.features.aggregation import MAD_K, Aggregate, aggregate
from egosplat.features.compression import fit
from egosplat.features.options import FeaturesOptions
from egosplat.features.supervision import mean_cosine, spread, supervise_views
from egosplat.language.decoder import decode, decoder_metadata
from egosplat.progress import log


def run(view_features_path: Path, output: Path, options: FeaturesOptions) -> None:
    """Write the features of ``view_features`` (UserError: ``dims`` exceeds the features' channels, or
    training diverges)."""
    view_features = open_artifact(view_features_path, VIEW_FEATURES)
    record = provenance.begin_from("features", options.as_dict(), [view_features])
    feature, instance = view_features.read("feature"), view_features.read("instance")
    level = view_features.read("instances/level")
    found = aggregate(feature, instance, len(level), options.mad_norm, MAD_K)
    # In the memory of the features: those of an hour take gigabytes.
    supervision, consistent, agreement, mismatched = supervise_views(feature, instance, found, options)
    compressed = fit(supervision, options.compression, options.dims, options.epochs, options.seed)
    codes, consistent_codes = (compressed.encode(part) for part in (supervision, consistent))
    seen = found.views > 0
    # An encoder maps the zero feature to an arbitrary code.
    consistent_codes[~seen] = 0.0

    def decoded(codes: Floats) -> Floats:
        return decode(torch.from_numpy(codes), compressed.decoder).numpy()

    facts = {
        "levels": view_features.facts["levels"],
        "clip": view_features.facts["clip"],
        "decoder": decoder_metadata(compressed.decoder),
        "outliers": int((~found.inlier).sum()),
        "slipped": int(mismatched.sum()),
        "reconstruction": {"mean": mean_cosine(supervision, lambda part: decoded(codes[part]))},
        "agreement": float(agreement.mean()) if len(agreement) else None,
        "spread": {"features": spread(consistent[seen]), "decoded": spread(decoded(consistent_codes[seen]))},
    }
    arrays = {
        "consistent": consistent,
        "views": found.views,
        "instances/level": level,
        "instance": instance,
        "frame": view_features.read("frame"),
        "inlier": found.inlier,
        "supervision": supervision,
        "code": codes,
        "consistent_code": consistent_codes,
        "decoder/values": compressed.decoder.values,
    }
    with create(output, FEATURES, record) as artifact:
        for name, values in arrays.items():
            artifact.put(name, values)
        artifact.facts = facts
    log(_summary_line(facts, found))


def _summary_line(facts: dict[str, Any], found: Aggregate) -> str:
    cosine, apart = facts["reconstruction"]["mean"], facts["spread"]
    text = f"{int((found.views > 0).sum())} instances, {len(found.inlier)} views, {facts['outliers']} of them outliers, "
    text += f"{facts['slipped']} mismatched"
    if cosine is None:
        return text
    text += f"; codes of {facts['decoder']['widths'][0]} dimensions, reconstruction cosine {cosine:.3f}"
    if apart["features"] is None:
        return text
    return f"{text}; mean cosine between instances {apart['features']:.3f}, decoded {apart['decoded']:.3f}"
