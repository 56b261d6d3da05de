"""What pyproject.toml cannot say: the kernels and the ray caster are compiled here.

They are plain shared libraries, not extension modules: they know nothing of Python, so one wheel serves all
versions of Python 3.
"""

import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

ROOT = Path(__file__).resolve().parent
KERNELS, RAYS = "egosplat/rasterize/kernels", "egosplat_apartments/rays"

sys.path.insert(0, str(ROOT / "src"))

from egosplat.rasterize.kernels.compiling import compile_kernels, compile_rays
from egosplat.rasterize.kernels.targets import VARIANTS
from egosplat_apartments.rays.library import LIBRARY


class BuildKernels(build_ext):
    """Compile the kernels and the ray caster beside the wrappers that load them."""

    def run(self) -> None:
        notes = compile_kernels(ROOT / "src" / KERNELS, self._folder(KERNELS))
        notes += compile_rays(ROOT / "src" / RAYS, self._folder(RAYS))
        for note in dict.fromkeys(notes):
            print(note, file=sys.stderr)

    def get_outputs(self) -> list[str]:
        paths = [self._folder(KERNELS) / variant.file for variant in VARIANTS]
        return [str(path) for path in [*paths, self._folder(RAYS) / LIBRARY] if path.is_file()]

    def get_output_mapping(self) -> dict[str, str]:
        return {}

    def _folder(self, package: str) -> Path:
        return (ROOT / "src" if self.inplace else Path(self.build_lib)) / package


class PlatformWheel(bdist_wheel):
    """A wheel for this platform and every Python 3."""

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", super().get_tag()[2]


setup(
    ext_modules=[Extension("egosplat.rasterize.kernels.library", [f"src/{KERNELS}/source/kernels.cpp"])],
    cmdclass={"build_ext": BuildKernels, "bdist_wheel": PlatformWheel},
)
