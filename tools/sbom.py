"""Write what a release is made of and needs, as CycloneDX 1.6: `python -m tools.sbom dist/cwcli.cdx.json`.

Components are the installed packages that cwcli needs, with those of its extras that are installed; each with its
version, its licence, and the packages that it needs itself. Two runs in one environment write the same bytes.

Format: https://cyclonedx.org/docs/1.6/json/
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Iterable, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SHIPPED_EXTRAS = ("plots", "report", "bags", "can", "import", "ray", "view", "remote")
"""Extras for users; the others are for development."""
LICENCE_CLASSIFIER = "License :: OSI Approved :: "


def normalised(name: str) -> str:
    """A package's name as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def names_needed(requirements: Iterable[str]) -> list[str]:
    """The packages that requirements name, but for those of extras; which are needed here, shows what is installed."""
    named = (each for each in requirements if "extra" not in each.partition(";")[2])
    return sorted({normalised(re.split(r"[^A-Za-z0-9._-]", each.strip(), maxsplit=1)[0]) for each in named})


def needs_below(first: Sequence[str]) -> tuple[dict[str, Distribution], dict[str, list[str]]]:
    """Name -> each installed package below these, themselves included, and name -> what it needs of them."""
    packages: dict[str, Distribution] = {}
    needs: dict[str, list[str]] = {}
    waiting = list(first)
    while waiting:
        name = waiting.pop()
        if name in packages:
            continue
        try:
            packages[name] = distribution(name)
        except PackageNotFoundError:  # of an extra that is not installed
            continue
        needs[name] = names_needed(packages[name].requires or ())
        waiting += needs[name]
    return packages, {name: [each for each in below if each in packages] for name, below in needs.items()}


def component(name: str, package: Distribution) -> dict[str, Any]:
    """One component."""
    described: dict[str, Any] = {
        "type": "library",
        "bom-ref": f"pkg:pypi/{name}@{package.version}",
        "name": name,
        "version": package.version,
        "purl": f"pkg:pypi/{name}@{package.version}",
    }
    fields: Any = package.metadata  # a message of the standard library, which its type does not say
    words = fields.get("License-Expression") or next(
        (
            each.removeprefix(LICENCE_CLASSIFIER)
            for each in fields.get_all("Classifier") or ()
            if each.startswith(LICENCE_CLASSIFIER)
        ),
        "",
    )
    if words:
        is_expression = "License-Expression" in fields
        described["licenses"] = [{"expression": words}] if is_expression else [{"license": {"name": words}}]
    return described


def bill_of_materials() -> dict[str, Any]:
    """The document. What cwcli needs itself is what the checkout's `pyproject.toml` says."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = (text for extra in SHIPPED_EXTRAS for text in project["optional-dependencies"][extra])
    first = names_needed([*project["dependencies"], *extras])
    packages, needs = needs_below(first)
    described = {name: component(name, packages[name]) for name in sorted(packages)}
    ref = f"pkg:pypi/{project['name']}@{project['version']}"
    root = {"type": "application", "bom-ref": ref, "name": project["name"], "version": project["version"], "purl": ref}
    below = {ref: [name for name in first if name in packages]} | {
        each["bom-ref"]: needs[name] for name, each in described.items()
    }
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": root | {"licenses": [{"expression": project["license"]}]}},
        "components": list(described.values()),
        "dependencies": [
            {"ref": each, "dependsOn": [described[name]["bom-ref"] for name in names]} for each, names in below.items()
        ],
    }


def main() -> None:
    """Write the document to the file that is named."""
    target = Path(sys.argv[1])
    target.write_text(json.dumps(bill_of_materials(), indent=2) + "\n", encoding="utf-8")
    print(f"wrote {target}")


if __name__ == "__main__":
    main()
