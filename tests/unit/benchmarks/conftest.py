"""The benchmarks, and the library of the training scripts, are not installed: tests import them from where they lie."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "training")]
