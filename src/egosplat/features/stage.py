"""Stage ``features``: aggregate each instance's consistent feature, form the supervision, compress to codes."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FEATURES, VIEW_FEATURES
from egosplat.artifacts.writer import create
from egosplat.features.aggregation import Aggregate, aggregate
from egosplat.features.compression import SHARE, Compression, Need, fit
from egosplat.features.options import FeaturesOptions
from egosplat.features.supervision import (
    agreement,
    consistent_directions,
    reconstruction,
    spread,
    summary,
    supervise,
    vanishing,
)
from egosplat.language.decoder import decode, decoder_metadata
from egosplat.language.vectors import unit
from egosplat.progress import log

Features = NDArray[np.float32]

_ROWS_AT_ONCE = 2**14

# Cosine with the original that 95 % of the decoded view features reach where dims is auto.
_LEAST_COSINE = 0.99


@dataclass(frozen=True)
class _Aggregated:
    """``consistent`` (N, D), ``supervision`` (R, D) float32; ``views`` (N,), ``inlier`` and ``mismatched`` (R,)."""

    consistent: Features
    supervision: Features
    views: NDArray[np.int32]
    inlier: NDArray[np.bool_]
    mismatched: NDArray[np.bool_]


def run(view_features_path: Path, output: Path, options: FeaturesOptions) -> None:
    """Write the features of ``view_features``.

    Raises:
        UserError: ``dims`` exceeds the features' channels, or training diverges.
    """
    view_features = open_artifact(view_features_path, VIEW_FEATURES)
    record = provenance.begin_from("features", options.as_dict(), [view_features])
    feature, instance = view_features.read("feature"), view_features.read("instance")
    level = view_features.read("instances/level")
    found = aggregate(feature, instance, len(level), options.mad_norm, options.mad_k)
    result = _aggregated(feature, instance, found, options)
    compressed = fit(
        result.supervision,
        options.compression,
        dims=options.dims,
        epochs=options.epochs,
        seed=options.seed,
        least_cosine=_LEAST_COSINE,
    )
    codes, consistent_codes = (compressed.encode(part) for part in (result.supervision, result.consistent))
    # An encoder maps the zero feature to an arbitrary code.
    consistent_codes[found.views == 0] = 0.0
    facts = _facts(view_features, result, codes, consistent_codes, compressed)
    arrays = {
        "consistent": result.consistent,
        "views": result.views,
        "instances/level": level,
        "instance": instance,
        "frame": view_features.read("frame"),
        "inlier": result.inlier,
        "supervision": result.supervision,
        "code": codes,
        "consistent_code": consistent_codes,
        "decoder/values": compressed.decoder.values,
    }
    with create(output, FEATURES, record) as artifact:
        for name, values in arrays.items():
            artifact.put(name, values)
        artifact.facts = facts
    log(_summary_line(facts, result))


def _aggregated(
    feature: Features, instance: NDArray[np.int32], found: Aggregate, options: FeaturesOptions
) -> _Aggregated:
    consistent = found.feature
    if options.normalize:
        consistent = consistent_directions(consistent, feature, instance)
    # A view whose cosine is below the midpoint of 1 and that between instances shows another object.
    apart = spread(consistent[found.views > 0]) if options.mismatched_views == "keep_own" else None
    limit = -math.inf if apart is None else (1 + apart) / 2
    mismatched = np.zeros(len(feature), bool)
    supervision = np.empty_like(feature)
    for begin in range(0, len(supervision), _ROWS_AT_ONCE):
        part = slice(begin, begin + _ROWS_AT_ONCE)
        own, common = feature[part].astype(np.float64), consistent[instance[part]]
        mismatched[part] = (unit(own) * unit(common)).sum(axis=1) < limit
        values = supervise(
            own, common, found.inlier[part], mismatched[part], options.supervision, options.outlier_target
        )
        if options.normalize:
            # Opposite features cancel; the average then has no direction of its own.
            values = unit(np.where(vanishing(values)[:, None], common, values))
        supervision[part] = values
    return _Aggregated(consistent.astype(np.float32), supervision, found.views, found.inlier, mismatched)


def _facts(
    view_features: Artifact,
    result: _Aggregated,
    codes: Features,
    consistent_codes: Features,
    compressed: Compression,
) -> dict[str, Any]:
    instance, level = view_features.read("instance"), view_features.read("instances/level")
    seen, names = result.views > 0, view_features.facts["levels"]
    cosines = reconstruction(result.supervision, codes, compressed.decoder)
    decoded = decode(torch.from_numpy(consistent_codes[seen]), compressed.decoder).numpy()
    return {
        "levels": names,
        "clip": view_features.facts["clip"],
        "decoder": decoder_metadata(compressed.decoder),
        "need": _need(compressed.need),
        "instances_without_views": int((~seen).sum()),
        "outliers": int((~result.inlier).sum()),
        "slipped": int(result.mismatched.sum()),
        "reconstruction": summary(cosines, level[instance], names),
        "agreement": agreement(view_features.read("feature"), result.consistent, instance),
        "spread": {"features": spread(result.consistent[seen]), "decoded": spread(decoded)},
    }


def _need(need: Need | None) -> dict[str, Any] | None:
    """Return why codes have their length, if it was ``auto``, with the share of views per length."""
    if need is None:
        return None
    return {"dims": need.dims, "share_wanted": SHARE, "share": [round(one, 6) for one in need.share.tolist()]}


def _summary_line(facts: dict[str, Any], result: _Aggregated) -> str:
    cosine, apart = facts["reconstruction"]["mean"], facts["spread"]
    text = f"{int((result.views > 0).sum())} instances, {len(result.inlier)} views, {facts['outliers']} of them outliers, "
    text += f"{facts['slipped']} mismatched"
    if cosine is None:
        return text
    text += f"; codes of {facts['decoder']['widths'][0]} dimensions, reconstruction cosine {cosine:.3f}"
    if apart["features"] is None:
        return text
    return f"{text}; mean cosine between instances {apart['features']:.3f}, decoded {apart['decoded']:.3f}"
