"""Commands run within the process, and files that are wrong in many ways."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from steersman.cli import app
from steersman.config import dump
from steersman.encoding import ExtendedEncoding

Steersman = Callable[..., Result]


@pytest.fixture
def steersman(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> Steersman:
    """Runs the command line in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> Result:
        return CliRunner().invoke(app, list(words), prog_name="steersman", catch_exceptions=False)

    return run


@pytest.fixture
def wrong_files(tmp_path: FilePath) -> None:
    """Files and folders that the wrong inputs name."""
    (tmp_path / "folder").mkdir()
    texts = {
        "empty": "",
        "list.yaml": "- 1\n- 2\n",
        "twice.yaml": "duration: 5\nduration: 6\n",
        "bad.yaml": "path: [1\n",
        "typo.yaml": "path:\n  kind: circle\n  radius: 50m\n",
        "one.csv": "x,y\n1,2\n",
        "car.yaml": "base: bmw_320i\nmas: 5\n",
        "broken.onnx": "x",
        "broken.json": "{",
        "alone.onnx": "x",
        "training.yaml": "problem: {}\nagent: {kind: ddpg}\n",
        "imitation.yaml": "problem: {}\nfit: {}\n",
        "tuning.yaml": "controller: pid\nsmoothness: 0.1\n",
        "search.yaml": "controller: pid\nranges: {}\n",
        "suite.yaml": "courses: {}\n",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "trained").mkdir()
    (tmp_path / "trained" / "config.yaml").write_text(texts["training.yaml"], encoding="utf-8")
    (tmp_path / "trained" / "policy.onnx").write_bytes(b"x")
    (tmp_path / "binary.yaml").write_bytes(b"\x00\xff\xfe")
    _policy(tmp_path / "nonsense", {})
    _policy(tmp_path / "period", {"dt": 0.1})
    _policy(tmp_path / "other", {"files": {"other.onnx": "0" * 64}})
    _policy(tmp_path / "newer", {"format": 9})
    _policy(tmp_path / "scales", {"scale": [1.0]})
    _policy(tmp_path / "encoding", {"encoding": {"kind": "wayponts"}})
    _policy(tmp_path / "unknown", {"sped": 1})
    _policy(tmp_path / "negative", {"spacing": -1.0})
    (tmp_path / "array.onnx").write_bytes(b"x")
    (tmp_path / "array.json").write_text("[]", encoding="utf-8")


def _policy(stem: FilePath, changes: dict[str, Any]) -> None:
    """A card of today's format beside something that is no network."""
    data, encoding = b"no network", ExtendedEncoding()
    layout = encoding.layout(2.0, 0.05, "rate")
    card = {
        "format": 2,
        "files": {f"{stem.name}.onnx": hashlib.sha256(data).hexdigest()},
        "action": "rate",
        "rate_limit": 1.5,
        "dt": 0.05,
        "waypoints": 15,
        "spacing": 2.0,
        "encoding": dump(encoding),
        "observation": layout.names,
        "scale": [1.0] * len(layout.names),
        "units": {},
        "signs": {},
        "limits": {},
        "seed": 0,
        "training": {},
        "versions": {},
        "commit": None,
    }
    stem.with_suffix(".onnx").write_bytes(data)
    stem.with_suffix(".json").write_text(json.dumps(card | changes), encoding="utf-8")
