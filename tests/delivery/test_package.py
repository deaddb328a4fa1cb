"""What a delivery consists of, whatever names and texts it was made from."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.delivery import c_text
from steersman.delivery.graph import TOLERANCE
from steersman.delivery.package import write_onnx
from steersman.delivery.vector_text import answers, rows_of
from steersman.errors import ConfigError, DataError, SteersmanError
from steersman.learning.export import network
from steersman.policy_file import PolicyCard, locate, read_policy, sha256

from ..loops import random_net
from .building import COMPILER, STRICT, export, needs_compiler, policy, run

HOSTILE = '*/ #error "\n??/\\\n%s $x ${name} \x00 é */ int main(void){} /*'


@pytest.fixture
def file(tmp_path: FilePath) -> FilePath:
    """A small policy."""
    return policy(tmp_path / "agent", "little")


def edit(file: FilePath, **fields: Any) -> FilePath:
    """Change fields of the card."""
    card = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
    file.with_suffix(".json").write_text(json.dumps(card | fields), encoding="utf-8")
    return file


def replace(file: FilePath, data: bytes) -> FilePath:
    """Another network with its digest."""
    file.write_bytes(data)
    return edit(file, files={file.name: sha256(data)})


def card_of(folder: FilePath, name: str) -> PolicyCard:
    return read_policy(folder / f"{name}.onnx")[1]


# --------------------------------------------------------------------------------------- contents


def test_the_card_names_every_file_and_limit(file: FilePath, tmp_path: FilePath) -> None:
    setting = export(file.parent, tmp_path / "out", single=True)
    card, before = card_of(tmp_path / "out", "agent"), read_policy(file)[1]
    assert setting.name == "agent"
    assert {*card.files, "agent.json"} == {f.name for f in (tmp_path / "out").iterdir()}
    assert card.limits["steer rate [1/s]"] == [-1.5708, 1.5708]
    assert card.limits["path shift [m]"] == [-0.3, 0.3]
    assert card.made_for is not None
    assert card.made_for["precision"] == "single"
    assert card.made_for["vehicle"]["kind"] == "carla_model3"
    new = {"files", "limits", "made_for"}
    assert card.model_dump(exclude=new) == before.model_dump(exclude=new)


@pytest.mark.parametrize("name", ["steersman_agent.c", "Makefile", "vector_agent.h", "agent.onnx"])
def test_a_changed_file_is_refused_by_name(name: str, file: FilePath, tmp_path: FilePath) -> None:
    export(file, tmp_path / "out")
    changed = tmp_path / "out" / name
    expected, data = sha256(changed.read_bytes()), changed.read_bytes() + b" "
    changed.write_bytes(data)
    with pytest.raises(DataError) as caught:
        read_policy(tmp_path / "out" / "agent.onnx")
    said = str(caught.value)
    assert said.startswith(
        f"{changed}: its SHA-256 is {sha256(data)}, but its card agent.json says"
    )
    assert expected in said
    assert "\n" not in said


def test_what_was_delivered_can_be_delivered_again(file: FilePath, tmp_path: FilePath) -> None:
    export(file, tmp_path / "c")
    (tmp_path / "onnx").mkdir()
    written, _ = write_onnx(str(tmp_path / "c" / "agent.json"), tmp_path / "onnx", str)
    assert read_policy(written)[0] == file.read_bytes()
    assert list(read_policy(written)[1].files) == ["agent.onnx"]
    assert read_policy(written)[1].made_for is None
    export(written, tmp_path / "again")
    for each in ("steersman_agent.c", "steersman_agent.h", "vector_agent.h"):
        assert (tmp_path / "again" / each).read_bytes() == (tmp_path / "c" / each).read_bytes()


def test_onnx_says_how_far_it_is_from_float64(tmp_path: FilePath) -> None:
    said: list[str] = []
    write_onnx("precision", tmp_path, said.append)
    assert "to the bit; from float64 at most" in said[0]
    assert (tmp_path / "precision.onnx").read_bytes() == locate("precision").read_bytes()


def test_the_vector_holds_history_saturation_and_failure(tmp_path: FilePath) -> None:
    setting = export("precision", tmp_path)
    given = rows_of(setting)
    said = answers(setting, given)
    assert len(given) > 300
    assert {answer.status.name for answer in said} == {"SOLVED", "SATURATED", "FALLBACK"}
    numbers = np.array([row.seen[1:8] for row in given])
    assert np.array_equal(numbers, numbers.astype(np.float32), equal_nan=True)
    # Without the history the answers would be others.
    alone = answers(setting, [row._replace(restart=True) for row in given])
    away = [abs(a.steer - b.steer) for a, b in zip(said, alone, strict=True)]
    assert np.mean(np.array(away) > 100 * TOLERANCE) > 0.5


# ------------------------------------------------------------------------------- names and texts


@pytest.mark.parametrize("name", ["plain", "9 */ lives", "Ü", "x" * 200, "double", "_", "a.b"])
def test_names_become_parts_of_c_names(name: str) -> None:
    made = c_text.identifier(name)
    assert f"steersman_{made}".isidentifier()
    assert made.isascii()
    assert 0 < len(made) <= 40


def test_names_without_letters_differ() -> None:
    assert c_text.identifier("龍") != c_text.identifier("虎")


@needs_compiler
def test_hostile_texts_stay_in_their_comments(file: FilePath, tmp_path: FilePath) -> None:
    folder = file.parent.rename(file.parent.with_name('a*"??\\\n#error $x'))
    _, card = read_policy(folder / file.name)
    names = [HOSTILE] * len(card.observation)
    edit(folder / file.name, observation=names, units={HOSTILE: HOSTILE}, versions={"x": HOSTILE})
    prefix = export(folder, tmp_path / "out").prefix
    assert prefix == "steersman_a_error_x"
    files = [tmp_path / "out" / f"{prefix}.c", tmp_path / "out" / "test_a_error_x.c"]
    run(COMPILER, *STRICT, "-o", tmp_path / "test", *files, "-lm")
    assert "as expected" in run(tmp_path / "test")
    for each in files[0], files[0].with_suffix(".h"):
        text = each.read_text(encoding="ascii")
        assert "??/" not in text
        assert text.count("/*") == text.count("*/")


@needs_compiler
def test_a_policy_that_sees_no_waypoints(file: FilePath, tmp_path: FilePath) -> None:
    prefix = export(edit(file, waypoints=0), tmp_path / "out", single=True).prefix
    files = [tmp_path / "out" / f"{prefix}.c", tmp_path / "out" / "test_agent.c"]
    run(COMPILER, *STRICT, "-o", tmp_path / "test", *files, "-lm")
    assert "as expected" in run(tmp_path / "test")


# --------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"rate_limit": 1e300}, "does not fit into float32"),
        ({"waypoints": 101}, "count: 101 is not allowed"),
        ({"scale": [1.0]}, "1 scales for"),
        ({"rate_limit": -1.0}, "rate_limit: -1.0 is not allowed; must be greater than 0"),
    ],
)
def test_nothing_is_written_of_what_is_refused(
    fields: dict[str, Any], message: str, file: FilePath, tmp_path: FilePath
) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(SteersmanError, match=message) as caught:
        export(edit(file, **fields), tmp_path / "out", single=True)
    assert "\n" not in str(caught.value)
    assert not list((tmp_path / "out").iterdir())


def test_weights_that_overflow(file: FilePath, tmp_path: FilePath) -> None:
    _, card = read_policy(file)
    net = random_net(len(card.scale))
    net.w1[0, 0] = 1e35
    replace(file, network(net, card.scale))
    with pytest.raises(ConfigError, match=r"hidden values up to 1\.0e\+37, which leave float"):
        export(file, tmp_path, single=True)
