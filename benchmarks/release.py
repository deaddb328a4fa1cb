"""Build a release, look into it, install it as a stranger would, and try it in an empty folder.

    python benchmarks/release.py [--python PYTHON[:EXTRAS] ...] [--tools DIR] [--dist dist]
                                 [--out results/release]

Builds sdist and wheel; every file that the repository has must be in the sdist, every file of the
packages in the wheel, and nothing else. Each Python gets new environments: the wheel alone, the
sdist alone, both with the newest of what they need, and the wheel with EXTRAS (else all for users)
in the versions of constraints.txt. In each, in an empty folder: the version,
a first drive, a controller as C with its test, the shipped policy; with extras also a page, the
policy as C, and the first notebook. The notes are this version's part of CHANGELOG.md. Run by
``make release``, whose tools (build, twine) are in ``--tools``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import zipfile
from pathlib import Path
from typing import NamedTuple

from steersman.files import write_text
from steersman.provenance import provenance

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NOT_FOR_USERS = {"docs", "dev"}
NOTEBOOK = "docs/notebooks/1_first_drive.ipynb"
LARGEST = 12
"""That many packages are named with their size."""
EACH = (
    "steersman --version",
    "steersman drive duration=5 --out first",
    "steersman export tuned/lqr --to c --out lqr",
    "steersman drive precision duration=5",
)
WITH_EXTRAS = (
    "steersman report first --out first.html",
    "steersman export precision --to c --out policy",
    f"python -c {NOTEBOOK}",
)


class Environment(NamedTuple):
    """Where a distribution is tried."""

    python: str
    what: str
    file: Path
    extras: str = ""

    def words(self) -> list[str]:
        """Of ``pip install``: the newest of everything, or with extras what is pinned."""
        if not self.extras:
            return [str(self.file)]
        return ["-c", str(ROOT / "constraints.txt"), f"{self.file}[{self.extras}]"]


def main() -> None:
    """Build, check, try, and write the record and the notes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", action="append", help="a Python, and the extras tried with it")
    parser.add_argument("--tools", type=Path, default=Path(sys.executable).parent)
    parser.add_argument("--dist", type=Path, default=Path("dist"))
    parser.add_argument("--out", type=Path, default=Path("results/release"))
    words = parser.parse_args()
    wheel, sdist, version = built(words.tools.resolve(), words.dist.resolve())
    write_text(words.dist / "notes.md", notes(version))
    made = {"made": provenance(), "version": version}
    size = {file.name: file.stat().st_size for file in (wheel, sdist)}
    rows: list[dict[str, object]] = []
    for place in environments(words.python or found_pythons(), wheel, sdist):
        rows.append(tried(place, version))
        sys.stdout.write(json.dumps(rows[-1]) + "\n")
        sys.stdout.flush()
        record = json.dumps({**made, "bytes": size, "rows": rows}, indent=1)
        write_text(words.out / "release.json", record + "\n")
    raise SystemExit(any(row["failed"] for row in rows))


def built(tools: Path, dist: Path) -> tuple[Path, Path, str]:
    """Wheel, sdist and version, made of what is committed and checked."""
    if run("git", "status", "--porcelain", "--untracked-files=no"):
        raise SystemExit("a release is made of what is committed: commit first")
    shutil.rmtree(dist, ignore_errors=True)
    run(str(tools / "python"), "-m", "build", "--outdir", str(dist), str(ROOT))
    [wheel], [sdist] = dist.glob("*.whl"), dist.glob("*.tar.gz")
    run(str(tools / "twine"), "check", "--strict", str(wheel), str(sdist))
    version = wheel.name.split("-")[1]
    tracked = set(run("git", "ls-files").splitlines())
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    same(sdist.name, names - {"PKG-INFO"}, tracked)
    with zipfile.ZipFile(wheel) as whole:
        names = {name for name in whole.namelist() if ".dist-info/" not in name}
    source = {name.removeprefix("src/") for name in tracked if name.startswith("src/")}
    same(wheel.name, names, source)
    return wheel, sdist, version


def same(where: str, names: set[str], wanted: set[str]) -> None:
    """Refuse a distribution that lacks a file, or has one that is in no commit."""
    if names != wanted:
        raise SystemExit(f"{where}: lacks {sorted(wanted - names)}; adds {sorted(names - wanted)}")


def notes(version: str) -> str:
    """What CHANGELOG.md says of a version."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    part = re.search(rf"^## \[{re.escape(version)}\].*?(?=^## |\Z)", text, re.M | re.S)
    if part is None:
        raise SystemExit(f"CHANGELOG.md has no part of {version}: '## [{version}] - DATE'")
    return part[0].rstrip() + "\n"


def found_pythons() -> list[str]:
    """The Pythons of the classifiers that are on the path and start."""
    numbers = [each.rpartition(" ")[2] for each in PROJECT["classifiers"] if ":: 3." in each]
    names = [f"python{number}" for number in numbers]
    return [name for name in names if not subprocess.run([name, "-V"], check=False).returncode]


def environments(pythons: list[str], wheel: Path, sdist: Path) -> list[Environment]:
    """Those of each Python; its extras stand behind a colon, nothing there for none."""
    for_users = ",".join(sorted(set(PROJECT["optional-dependencies"]) - NOT_FOR_USERS))
    words = [word.partition(":") for word in pythons]
    whole = [(python, extras if colon else for_users) for python, colon, extras in words]
    return [
        *(Environment(python, "wheel", wheel) for python, _ in whole),
        *(
            Environment(python, "wheel with extras", wheel, extras)
            for python, extras in whole
            if extras
        ),
        *(Environment(python, "sdist", sdist) for python, _ in whole),
    ]


def tried(place: Environment, version: str) -> dict[str, object]:
    """One row: what was installed, how large it is, what failed."""
    lines = [line.split() for line in (*EACH, *(WITH_EXTRAS if place.extras else ()))]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(place.python, "-m", "venv", str(folder / "venv"))
        programs, empty = folder / "venv" / "bin", folder / "empty"
        empty.mkdir()
        begun = time.monotonic()
        run(str(programs / "pip"), "install", "--quiet", *place.words())
        took = time.monotonic() - begun
        sizes = packages(folder / "venv")
        number = run(
            str(programs / "python"), "-c", "import platform; print(platform.python_version())"
        )
        failed = [fault for words in lines if (fault := fails(words, programs, empty, version))]
    return {
        "python": number.strip(),
        "installed": place.what,
        "extras": place.extras,
        "install_s": round(took),
        "installed_mb": round(sum(sizes.values()), 1),
        "largest_mb": dict(list(sizes.items())[:LARGEST]),
        "ran": len(lines) - len(failed),
        "failed": failed,
    }


def fails(words: list[str], programs: Path, folder: Path, version: str) -> str:
    """What a command prints that fails, or "" for one that does as it should."""
    command = [
        str(programs / words[0]),
        *(cells() if word == NOTEBOOK else word for word in words[1:]),
    ]
    done = subprocess.run(
        command, cwd=folder, env=environment(), capture_output=True, text=True, check=False
    )
    wrong = words[1] == "--version" and done.stdout.split() != ["steersman", version]
    return (
        f"{' '.join(words)}: {(done.stdout + done.stderr)[-500:]}"
        if done.returncode or wrong
        else ""
    )


def cells() -> str:
    """The code of a notebook."""
    cells = json.loads((ROOT / NOTEBOOK).read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


def packages(venv: Path) -> dict[str, float]:
    """MB of each entry of site-packages, the largest first; pip and setuptools are left out."""
    [site] = venv.glob("lib/python*/site-packages")
    sizes: dict[str, float] = {}
    for file in site.rglob("*"):
        name = file.relative_to(site).parts[0].removesuffix(".libs")
        if file.is_file() and not re.match("pip|setuptools|pkg_resources|_distutils", name):
            sizes[name] = sizes.get(name, 0.0) + file.stat().st_size / 1e6
    return {name: round(sizes[name], 1) for name in sorted(sizes, key=lambda n: -sizes[n])}


def environment() -> dict[str, str]:
    """The shell's variables without those that lead to this checkout."""
    return {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV"}}


def run(*words: str) -> str:
    """What a command prints; the release ends where it fails."""
    done = subprocess.run(
        words, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


if __name__ == "__main__":
    main()
