"""Build the wheel, look at what it needs, and time the way of a new user: `python -m tools.wheel`.

Two times are printed: from a clean clone to the end of the demo (it compiles), and from the wheel to the end of the
demo with no compiler on the path and, where the system can do that (`unshare`), no network. Both start without
variables of this shell and with an empty home folder; what they need from a package index is downloaded before, and
timed apart. Then the same wheel is tried on the later versions of Python that are there, and a table tells what the
installed packages take. Development only; needs git and `build`, looks deeper with `abi3audit`, `auditwheel`.
"""

from __future__ import annotations

import importlib.metadata
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CLONE_BOUND_S = 75.0
WHEEL_BOUND_S = 15.0
GIVEN = ("pyarrow", "opencv-python-headless")
"""Libraries that the installed size is told without, too."""
NOT_OURS = ("pip", "setuptools")
LATER_PYTHONS = (12, 13, 14)
"""Minor versions that the wheel of 3.11 serves, too."""
SMALL_MB = 1.0
"""Packages below this are one row of the table."""
COMPILERS = ("cc", "gcc", "clang", "c++", "g++", "tcc")
NO_NETWORK = ("unshare", "--map-root-user", "--net")


def run(*command: str | Path, folder: Path, env: dict[str, str] | None = None) -> str:
    """What a command prints.

    Raises:
        SystemExit: It failed; its output is in the text.
    """
    done = subprocess.run([*map(str, command)], cwd=folder, env=env, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(
            f"error: {' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout}{done.stderr}"
        )
    return done.stdout


def seconds(*command: str | Path, folder: Path, env: dict[str, str] | None = None) -> float:
    """How long a command takes; it fails as `run`."""
    start = time.monotonic()
    run(*command, folder=folder, env=env)
    return time.monotonic() - start


@dataclass(frozen=True)
class Took:
    """Seconds that something took, and of the processors, which tell what a busy machine hides."""

    wall_s: float
    cpu_s: float

    def __str__(self) -> str:
        return f"{self.wall_s:.0f} s, {self.cpu_s:.0f} s of processor time"


def time_install(what: Path, scratch: Path, env: dict[str, str], inside: Sequence[str] = ()) -> Took:
    """From an empty environment to the end of the demo.

    Args:
        what: The checkout, or the wheel, that is installed.
        scratch: An empty folder.
        env: All variables.
        inside: What each command is started by.
    """
    steps: list[tuple[str | Path, ...]] = [
        (sys.executable, "-m", "venv", "environment"),
        (scratch / "environment/bin/pip", "install", "--quiet", what),
        (scratch / "environment/bin/cwcli", "demo"),
    ]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall_s = sum(seconds(*inside, *step, folder=scratch, env=env) for step in steps)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Took(wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def requirements(*, to_build: bool) -> list[str]:
    """What pyproject.toml asks for, to run or to build."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found: list[str] = project["build-system"]["requires"] if to_build else project["project"]["dependencies"]
    return found


def clean(home: Path, downloads: Path, path: str) -> dict[str, str]:
    """Variables of a shell that knows nothing but a path and its home; packages come from a folder."""
    home.mkdir()
    return {"PATH": path, "HOME": str(home), "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(downloads)}


def path_without_compiler(folder: Path) -> str:
    """A path on which Python is and no compiler."""
    folder.mkdir()
    (folder / "python3").symlink_to(sys.executable)
    assert not [name for name in COMPILERS if shutil.which(name, path=str(folder))]
    return str(folder)


def without_network(scratch: Path) -> tuple[str, ...]:
    """What starts a command without a network; nothing where the system can't."""
    program = shutil.which(NO_NETWORK[0])
    if program is None:
        return ()
    inside = (program, *NO_NETWORK[1:])
    done = subprocess.run([*inside, sys.executable, "-c", ""], cwd=scratch, capture_output=True, check=False)
    return inside if done.returncode == 0 else ()


def installed(environment: Path) -> list[importlib.metadata.Distribution]:
    """The packages of an environment, without those that every environment has."""
    (packages,) = environment.glob("lib/python*/site-packages")
    found = importlib.metadata.distributions(path=[str(packages)])
    return [each for each in found if each.name not in NOT_OURS]


def size_mb(package: importlib.metadata.Distribution) -> float:
    """Of all files that pip put there, with what it compiled of them."""
    paths = (Path(str(package.locate_file(file))) for file in package.files or ())
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def table_of_sizes(packages: Sequence[importlib.metadata.Distribution]) -> str:
    """A Markdown table: package, size, and who needs it; and below the sums."""
    names = {canonical(each.name) for each in packages}
    needed_by: dict[str, list[str]] = {name: [] for name in names}
    for each in packages:
        for requirement in each.requires or ():
            name = canonical(re.split(r"[^\w.-]", requirement, maxsplit=1)[0])
            if "extra ==" not in requirement and name in needed_by:
                needed_by[name].append(canonical(each.name))
    sizes = sorted(((size_mb(each), canonical(each.name)) for each in packages), reverse=True)
    rows = [(name, size, ", ".join(sorted({*needed_by[name]}))) for size, name in sizes if size >= SMALL_MB]
    small = [size for size, _ in sizes if size < SMALL_MB]
    rows.append((f"{len(small)} below {SMALL_MB:.0f} MB", sum(small), ""))
    total, given = sum(size for size, _ in sizes), sum(size for size, name in sizes if name in GIVEN)
    rows += [("all", total, ""), (f"all but {' and '.join(GIVEN)}", total - given, "")]
    lines = [f"| {name} | {size:.0f} | {who} |" for name, size, who in rows]
    return "\n".join(["| package | MB | needed by |", "|---|---|---|", *lines])


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def try_other_pythons(wheel: Path, scratch: Path) -> None:
    """Run the demo of the wheel on the later versions of Python that are on the path; print which.

    Raises:
        SystemExit: It failed on one.
    """
    for minor in LATER_PYTHONS:
        python = shutil.which(f"python3.{minor}")
        if python is None or subprocess.run([python, "-c", ""], capture_output=True, check=False).returncode != 0:
            print(f"Python 3.{minor} is not here")
            continue
        folder = scratch / f"python3.{minor}"
        folder.mkdir()
        run(python, "-m", "venv", "environment", folder=folder)
        run(folder / "environment/bin/pip", "install", "--quiet", wheel, folder=folder)
        run(folder / "environment/bin/cwcli", "demo", folder=folder)
        print(f"Python 3.{minor}: the same wheel passes the demo")


def look_inside(wheel: Path, scratch: Path) -> None:
    """Print what the tools that are here say of a wheel."""
    for command in (("abi3audit", "--verbose"), ("auditwheel", "show")):
        found = shutil.which(command[0])
        print(run(*command, wheel, folder=scratch) if found else f"{command[0]} is not here")


def main() -> int:
    """Exit code 1 where a bound is missed or the wheel is none for all versions of Python."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        for name in ("clone", "from-clone", "from-wheel", "wheels"):
            (scratch / name).mkdir()
        wanted = requirements(to_build=False) + requirements(to_build=True)
        pip = (sys.executable, "-m", "pip", "download", "--quiet", "--dest", "downloads")
        download_s = seconds(*pip, *wanted, folder=scratch)
        run("git", "clone", "--quiet", ROOT, scratch / "clone", folder=scratch)
        with_compiler = clean(scratch / "home", scratch / "downloads", os.defpath)
        clone = time_install(scratch / "clone", scratch / "from-clone", with_compiler)
        run(sys.executable, "-m", "build", "--outdir", scratch / "wheels", scratch / "clone", folder=scratch)
        (wheel,) = (scratch / "wheels").glob("*.whl")
        look_inside(wheel, scratch)
        bare = clean(scratch / "bare", scratch / "downloads", path_without_compiler(scratch / "programs"))
        inside = without_network(scratch)
        bare_wheel = time_install(wheel, scratch / "from-wheel", bare, inside)
        network = "no network" if inside else "the network is there, as unshare is not"
        print(f"wheel               {wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB")
        print(f"downloads           {download_s:.0f} s, not in the times below; load {os.getloadavg()[0]:.1f}")
        print(f"clone to demo       {clone} (bound {CLONE_BOUND_S:.0f})")
        print(f"wheel to demo       {bare_wheel} (bound {WHEEL_BOUND_S:.0f}), no compiler on the path, {network}\n")
        try_other_pythons(wheel, scratch)
        print(table_of_sizes(installed(scratch / "from-wheel/environment")))
        return int(clone.wall_s > CLONE_BOUND_S or bare_wheel.wall_s > WHEEL_BOUND_S or "-abi3-" not in wheel.name)


if __name__ == "__main__":
    sys.exit(main())
