"""How the kernels are compiled; everything else about the package stands in pyproject.toml.

Every `cwcli/kernels/*.pyx` is an extension of its own. They keep to Python's limited API, so that one wheel serves 3.11
and all later versions; measured against the full one it costs nothing (docs/decisions.md). What Cython generates for
every memoryview stands in one more extension that the others share: most of the time of a compilation went there.
"""

from __future__ import annotations

import compileall
import os
import shlex
import shutil
import sysconfig
from pathlib import Path

import setuptools
from setuptools import Extension, setup
from setuptools.command.build import build
from setuptools.command.build_ext import build_ext

KERNELS = Path("cwcli/kernels")
SHARED_MODULE = "cwcli.kernels._memoryviews"
"""The extension with the code of memoryviews; Cython generates it whole."""
LIMITED_API = "0x030B0000"
"""Of Python 3.11, the oldest version that is supported."""
HEADERS = [str(path) for path in sorted(KERNELS.glob("*.px[di]"))]
"""What every kernel is compiled anew for."""
FLAGS = {"msvc": ["/O2", "/fp:precise"]}
GCC_FLAGS = ["-O3", "-g0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"]
"""No fused multiply-add: the same input gives the same bytes on every processor. Nobody reads `errno` or the exception
flags behind a square root or a comparison, and loops that would have to set them are no vector code: the search of
lanes took half as long again. No number changes by it.
"""
LEAST_SETUPTOOLS = 77
"""The first version that reads the license in pyproject.toml; `pip` gets it by itself."""


def kernel(name: str, source: Path) -> Extension:
    """The extension of one `.pyx`, or of a generated `.c`."""
    return Extension(
        name,
        [str(source)],
        depends=HEADERS,
        define_macros=[("Py_LIMITED_API", LIMITED_API), ("CYTHON_LIMITED_API", "1")],
        py_limited_api=True,
    )


class Build(build):
    """`build` that says in one line, before anything else is done, that the compiler is missing."""

    def finalize_options(self) -> None:
        super().finalize_options()
        command = os.environ.get("CC") or sysconfig.get_config_var("CC")  # neither is set where MSVC compiles
        if command and shutil.which(shlex.split(command)[0]) is None:
            raise SystemExit(
                f"error: building cwcli needs a C compiler, and `{shlex.split(command)[0]}` is not there. Install one "
                "(Debian and Ubuntu: apt install gcc; macOS: xcode-select --install), or install a wheel."
            )


class BuildKernels(build_ext):
    """`build_ext` that generates the C of all kernels at once, and has the flags of the compiler that is used."""

    def build_extensions(self) -> None:
        self.generate_c()
        for extension in self.extensions:
            extension.extra_compile_args = FLAGS.get(self.compiler.compiler_type, GCC_FLAGS)
        super().build_extensions()

    def generate_c(self) -> None:
        """Run Cython in as many processes as there are processors; setuptools would run it in one, file by file."""
        from Cython.Build import cythonize  # an installation's metadata is asked for without it

        cythonize(self.extensions, nthreads=os.cpu_count() or 1, shared_utility_qualified_name=SHARED_MODULE)
        self.extensions.sort(key=lambda each: -Path(each.sources[0]).stat().st_size)  # the dear ones are begun first

    def copy_extensions_to_source(self) -> None:
        for path in KERNELS.glob("*.cpython-*"):  # an older checkout's: Python prefers a build for its own version
            path.unlink()
        super().copy_extensions_to_source()
        # an installation of a checkout has no other step that does it, and where PYTHONDONTWRITEBYTECODE is set, as in
        # many containers, every command would compile some hundred modules anew
        compileall.compile_dir("cwcli", quiet=1, workers=os.cpu_count() or 1)


if int(setuptools.__version__.partition(".")[0]) < LEAST_SETUPTOOLS:
    raise SystemExit(
        f"error: setup.py needs setuptools {LEAST_SETUPTOOLS} or later, and {setuptools.__version__} is here: "
        "run `pip install -U setuptools`, or let pip build by `pip install -e .`"
    )
if __name__ == "__main__":  # Cython's processes import this file where they are not forked
    setup(
        ext_modules=[
            kernel(SHARED_MODULE, KERNELS / "_memoryviews.c"),
            *(kernel(f"cwcli.kernels.{path.stem}", path) for path in sorted(KERNELS.glob("*.pyx"))),
        ],
        cmdclass={"build": Build, "build_ext": BuildKernels},
        options={"build_ext": {"parallel": True}, "bdist_wheel": {"py_limited_api": "cp311"}},
    )
