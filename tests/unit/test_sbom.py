"""The bill of materials names every package that cwcli needs, once, with what it needs itself."""

from __future__ import annotations

import tomllib
from importlib.metadata import version
from pathlib import Path

from tools.sbom import bill_of_materials, normalised

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_every_dependency_is_a_component() -> None:
    document = bill_of_materials()
    found = {each["name"]: each["version"] for each in document["components"]}
    for text in PROJECT["dependencies"]:
        name = normalised(text.partition(">=")[0])
        assert found[name] == version(name)
    assert {"typer", "shellingham"} <= found.keys()  # the second one by the first
    assert "pytest" not in found
    assert len(document["components"]) == len(found)


def test_references_lead_to_components() -> None:
    document = bill_of_materials()
    refs = {each["bom-ref"] for each in document["components"]} | {document["metadata"]["component"]["bom-ref"]}
    assert {each["ref"] for each in document["dependencies"]} == refs
    assert all(set(each["dependsOn"]) <= refs for each in document["dependencies"])
    (root,) = (each for each in document["dependencies"] if each["ref"].startswith("pkg:pypi/cwcli-drive@"))
    assert f"pkg:pypi/numpy@{version('numpy')}" in root["dependsOn"]
    assert bill_of_materials() == document
