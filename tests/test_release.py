"""What a release is made of says one thing: versions, the lock and the bill of materials."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
REMAKE = "run `make lock`"


def pins(file: str) -> dict[str, str]:
    """Version by name."""
    text = (ROOT / file).read_text(encoding="utf-8")
    found = re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE)
    return {plain(name): version for name, version in found}


def plain(name: str) -> str:
    """A package's name as registries compare it."""
    return re.sub(r"[-_.]+", "-", name.lower())


def test_the_lock_has_the_versions_of_the_tests_with_digests() -> None:
    lock, tested = pins("requirements.lock"), pins("constraints.txt")
    missing = {name for name, version in tested.items() if lock.get(name) != version}
    assert missing <= {"torch"}, REMAKE
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    for requirement in re.split(r"\n(?=\w)", text):
        assert "--hash=sha256:" in requirement, requirement
    assert not re.search("://|index-url|find-links", text)


def test_the_bill_of_materials_has_them_too() -> None:
    bill = json.loads((ROOT / "sbom.cdx.json").read_text(encoding="utf-8"))
    found = {plain(part["name"]): part["version"] for part in bill["components"]}
    wanted = pins("constraints.txt")
    assert {name for name in wanted if found.get(name) != wanted[name]} <= {"torch"}, REMAKE


def test_a_version_is_the_same_wherever_it_stands() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = project["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## [{version}] - " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
