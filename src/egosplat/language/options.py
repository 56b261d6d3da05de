"""Configuration keys of the stage ``language``."""

from dataclasses import dataclass

from egosplat.language.training import CodeOptions


@dataclass(frozen=True)
class LanguageOptions(CodeOptions):
    """Configuration keys of the stage; ``config.schema.yaml`` describes each."""

    method: str
    # Of segments: how the masks were found.
    segmenter: str
    point_prompts: str
    pixels: int
    scales: int
    channels: int
    checkpoint_s: float
    backend: str
