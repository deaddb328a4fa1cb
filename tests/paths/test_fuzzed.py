"""What damaged files did to the readers of paths (benchmarks/fuzz.py)."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.config import resolve
from steersman.errors import DataError

# A position far from all others, after which a spline swings for hundreds of kilometres.
TURN = [[11.5 + 1e-5 * k * k, 48.1 + 1e-4 * k] for k in range(20)]
FAR = {"type": "LineString", "coordinates": [[11.0, 48.1], *TURN[1:]]}
REFERENCE = {"pos_x": [0.0, 3.0, 1e300, 9.0], "pos_y": [0.0] * 4, "ref_v": [5.0] * 4}
FILES = {
    "overshoot": ("geojson", json.dumps(FAR), r"position \d+: after this point the curve takes"),
    "far": ("tum_reference", json.dumps(REFERENCE), r"point 3: \(1e\+300, 0\) is too far"),
    "deep": ("tum_reference", "[" * 99 + "]" * 99, "nests deeper than 50 levels"),
    "titles": ("log", "time,x,y\n", "no row follows the titles"),
    "one row": ("log", "time,x,y\n0,1,2\n", "holds 1 points, a path needs at least 2"),
}


@pytest.mark.parametrize("what", FILES)
def test_one_line(what: str, tmp_path: FilePath) -> None:
    kind, text, why = FILES[what]
    (tmp_path / "a").write_text(text)
    path: Any = resolve("path", {"kind": kind, "file": str(tmp_path / "a")})
    with pytest.raises(DataError, match=why) as caught:
        _ = path.length
    assert "\n" not in str(caught.value)
