"""Build the wheel, look at what it needs, and time the way of a new user: `python -m tools.wheel`.

Two times are printed: from a clean clone to the end of the demo (it compiles), and from the wheel to the end of the
demo with no compiler on the path. Development only; needs git and `build`, looks deeper with `abi3audit`, `auditwheel`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CLONE_BOUND_S = 90.0
WHEEL_BOUND_S = 15.0
GIVEN = ("pyarrow", "cv2", "opencv_python_headless.libs")
"""Libraries that the installed size is told without."""
NOT_OURS = ("pip", "setuptools")


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


def time_install(what: Path, scratch: Path, env: dict[str, str]) -> float:
    """Seconds from an empty environment to the end of the demo.

    Args:
        what: The checkout, or the wheel, that is installed.
        scratch: An empty folder.
        env: The variables of the environment.
    """
    start = time.monotonic()
    run(sys.executable, "-m", "venv", "environment", folder=scratch)
    run(scratch / "environment/bin/pip", "install", "--quiet", what, folder=scratch, env=env)
    run(scratch / "environment/bin/cwcli", "demo", folder=scratch, env=env)
    return time.monotonic() - start


def without_compiler(scratch: Path) -> dict[str, str]:
    """The environment variables with a path on which Python is and no compiler."""
    programs = scratch / "programs"
    programs.mkdir()
    (programs / "python3").symlink_to(sys.executable)
    return {"PATH": str(programs), "HOME": str(scratch), "CC": "no-compiler"} | {
        name: value for name, value in os.environ.items() if name.startswith("PIP_")
    }


def sizes_mb(environment: Path) -> dict[str, float]:
    """Megabytes of each folder of the installed packages, largest first."""
    (packages,) = environment.glob("lib/python*/site-packages")
    found = {
        entry.name: sum(path.stat().st_size for path in entry.rglob("*") if path.is_file()) / 1e6
        for entry in packages.iterdir()
        if entry.is_dir() and entry.name not in NOT_OURS
    }
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def main() -> int:
    """Exit code 1 where a bound is missed or the wheel is none for all versions of Python."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        for name in ("clone", "from-clone", "from-wheel", "wheels"):
            (scratch / name).mkdir()
        run("git", "clone", "--quiet", ROOT, scratch / "clone", folder=scratch)
        clone_s = time_install(scratch / "clone", scratch / "from-clone", dict(os.environ))
        run(sys.executable, "-m", "build", "--outdir", scratch / "wheels", scratch / "clone", folder=scratch)
        (wheel,) = (scratch / "wheels").glob("*.whl")
        print(
            run("abi3audit", "--verbose", wheel, folder=scratch)
            if shutil.which("abi3audit")
            else "abi3audit is not here"
        )
        print(
            run("auditwheel", "show", wheel, folder=scratch) if shutil.which("auditwheel") else "auditwheel is not here"
        )
        wheel_s = time_install(wheel, scratch / "from-wheel", without_compiler(scratch))
        sizes = sizes_mb(scratch / "from-wheel/environment")
        rest = sum(size for name, size in sizes.items() if name not in GIVEN)
        print(f"wheel               {wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB")
        print(f"clone to demo       {clone_s:.0f} s (bound {CLONE_BOUND_S:.0f})")
        print(f"wheel to demo       {wheel_s:.0f} s (bound {WHEEL_BOUND_S:.0f}), no compiler on the path")
        print(f"installed           {sum(sizes.values()):.0f} MB, {rest:.0f} without {', '.join(GIVEN)}")
        for name, size in list(sizes.items())[:8]:
            print(f"  {name:28} {size:6.1f} MB")
        return int(clone_s > CLONE_BOUND_S or wheel_s > WHEEL_BOUND_S or "-abi3-" not in wheel.name)


if __name__ == "__main__":
    sys.exit(main())
