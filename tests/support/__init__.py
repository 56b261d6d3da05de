"""Helpers that several tests use, and where the repository's things are."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PRESETS = ROOT / "config/presets"
HEADER = "dataset\tscene\tformat\trecording\toptions\n"
"""Heading of a table of scenes."""
