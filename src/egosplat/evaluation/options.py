"""Options of the stage ``metrics``."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from egosplat.evaluation.intervals import IntervalOptions
from egosplat.evaluation.queries import BenchmarkQueries
from egosplat.query.options import QueryOptions


@dataclass(frozen=True)
class MetricsOptions(QueryOptions, BenchmarkQueries, IntervalOptions):
    """The keys of ``metrics``, ``query``, ``presence`` and of OpenCLIP in ``models``; see ``config.schema.yaml``."""

    backend: str
    hit_region: str
    negatives: tuple[str, ...]
    clip_model: str
    clip_checkpoint: str
    device: str
    precision: str


def metrics_options(keys: Mapping[str, Any]) -> MetricsOptions:
    """Make the options from keys with lists, as the configuration and ``metrics.json`` hold them."""
    named = {field.name: keys[field.name] for field in fields(MetricsOptions)}
    return MetricsOptions(
        **{key: tuple(value) if isinstance(value, list) else value for key, value in named.items()}
    )
