"""``steersman adopt``: what is printed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

from typer.testing import Result

from ..learning.sb3_model import model


def test_signs_of_another_kind_end_beside_the_road(
    steersman: Callable[..., Result], tmp_path: FilePath
) -> None:
    (tmp_path / "theirs.zip").write_bytes(model())
    words = "encoding.features=[lateral_error,heading_error,{kind: road_curvatures, count: 1}]"
    given = ("theirs.zip", "--encoding", "list", words, "--limits", "1,-1", "--out", "o")
    result = steersman("adopt", *given)
    assert result.exit_code == 0, result.stderr
    assert "ended by off_track" in result.stderr
    assert "signs (--limits 1,-1)" in result.stderr
    assert result.stdout.strip() == str(FilePath("o", "policy.onnx"))
    refused = steersman("adopt", "theirs.zip", "--encoding", "waypoints", "--out", "o")
    assert refused.exit_code == 2
    assert "theirs.zip reads 3 numbers, but waypoints gives 33" in refused.stderr
