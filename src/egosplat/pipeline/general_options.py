"""Options of the configuration as a whole: preset, scenes and variants."""

import re
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field
from typing_extensions import TypedDict

from egosplat.pipeline.home import PRESET_NAMES
from egosplat.pipeline.options import Options, Text, check_with, one_of
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.strict_yaml import read_yaml

_NAME = check_with(
    re.compile("[A-Za-z0-9_-]{1,200}").fullmatch, "only letters, digits, _ and -, at most 200 letters"
)
_Folder = Annotated[Text | None, BeforeValidator(lambda path: None if path == "null" else path)]

# How a recording is laid out on disk.
Format = Annotated[str, one_of(STAGES["frames"].modules)]

# Protocols of public benchmarks, under ``formats``, and ``variants``.
SHIPPED: Any = read_yaml(Path(__file__).with_name("shipped.yaml"))


_SECTIONS = check_with(
    lambda keys: GeneralOptions.model_fields.keys().isdisjoint(keys),
    "only sections with keys; preset and others outside of them hold for all scenes",
)


class VariantKeys(TypedDict, total=False):
    """Keys of a variant: sections with keys, and these two."""

    __pydantic_config__ = ConfigDict(extra="allow", strict=True)  # type: ignore[misc]

    extends: str | list[str]
    method: Annotated[str, Field(min_length=1, max_length=60)]


class GeneralOptions(Options):
    """Keys that are in no section."""

    preset: Annotated[str, one_of(PRESET_NAMES)] = "balanced"
    """Trade of speed against accuracy: a file in config/presets. Its values replace the defaults here; keys set in
    the configuration replace its values."""

    scenes: Text = "config/scenes.tsv"
    """Table of scenes, one row each. Relative to the working directory. scenes.local.tsv beside it, which egosplat run
    writes, is read too."""

    data_root: dict[str, _Folder] = Field(default={})
    """Folder that holds the recordings of each dataset, or null. Without a folder for adt, scenes 1 to 5 of adt are
    synthetic apartments; recordings of other datasets are then relative to the working directory."""

    container: Text | None = None
    """Image in which Snakemake starts each job with --software-deployment-method apptainer: a file or an address
    (docs/running.md)."""

    formats: dict[Format, Annotated[dict[str, Any], _SECTIONS]] = SHIPPED["formats"]
    """Keys for all scenes of a format. They win over the keys of all scenes, and a scene's own row wins over them. Those of
    the preset paper for hoi4d, and of the benchmarks lerf and 3d_ovs, come with egosplat; keys of the configuration win."""

    variants: dict[Annotated[str, _NAME], VariantKeys] = SHIPPED["variants"]
    """Named sets of keys that differ from the scene's, for ablations and methods of others; those below come with egosplat
    (docs/methods.md). Yours stand beside them, and replace one of the same name. The scene itself is the full method;
    results/adt/scene1/variants/baseline/ holds only the artifacts that the variant changes. `extends` names variants to
    inherit keys from (later ones win). `method` is the published method that a variant stands for, in tables."""
