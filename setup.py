"""What pyproject.toml cannot say: the workflow goes into the package, README's links open outside of the repository, and the
kernels and the ray caster are compiled.

They are plain shared libraries, not extension modules: they know nothing of Python, so one wheel serves all
versions of Python 3. They are compiled when egosplat is installed, not when it is first used: compute nodes often have
no compiler, and jobs that start together would compile the same files.
"""

import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
KERNELS, RAYS = "egosplat/rasterize/kernels", "egosplat_apartments/rays"

# Files of the checkout that egosplat.pipeline.home looks for in this folder of an installed package.
SHIPPED = "egosplat/shipped"
WORKFLOW = ("workflow/**/*", "config/config.yaml", "config/presets/*.yaml", "config/scenes.tsv")

sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from compiling import compile_kernels, compile_rays
from describing import addresses, page, repository
from egosplat import __version__
from egosplat.rasterize.kernels.targets import VARIANTS
from egosplat_apartments.rays.library import LIBRARY


class BuildWithWorkflow(build_py):
    """Copy the workflow and its configuration into the package, except for an editable installation."""

    def run(self) -> None:
        super().run()
        for source, target in self._shipped().items():
            self.mkpath(str(Path(target).parent))
            self.copy_file(source, target)

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        return [*super().get_outputs(include_bytecode), *self._shipped().values()]

    def _shipped(self) -> dict[str, str]:
        found = (path for pattern in WORKFLOW for path in ROOT.glob(pattern) if path.is_file())
        names = [] if self.editable_mode else [str(path.relative_to(ROOT)) for path in found]
        return {str(ROOT / name): str(Path(self.build_lib, SHIPPED, name)) for name in names}


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


ADDRESS = repository(ROOT)

setup(
    long_description=page((ROOT / "README.md").read_text(encoding="utf-8"), ADDRESS, __version__),
    long_description_content_type="text/markdown",
    project_urls=addresses(ADDRESS),
    ext_modules=[Extension("egosplat.rasterize.kernels.library", [f"src/{KERNELS}/source/kernels.cpp"])],
    cmdclass={"build_ext": BuildKernels, "build_py": BuildWithWorkflow, "bdist_wheel": PlatformWheel},
)
