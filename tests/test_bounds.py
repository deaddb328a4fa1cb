"""What a file of unknown origin may cost: one line, in little time and memory."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.bounds import DEEPEST, from_json, read_arrays
from steersman.commands import configuration
from steersman.config import override, read_yaml
from steersman.core_yaml import MOST_BYTES
from steersman.episode import load_episode
from steersman.errors import ConfigError, DataError
from steersman.learning import snapshot

DOUBLED = "\n".join(f"b{i}: &b{i} [*b{i - 1}, *b{i - 1}]" for i in range(1, 40))
MERGED = "\n".join(f"m{i}: &m{i} {{<<: [*m{i - 1}, *m{i - 1}]}}" for i in range(1, 40))
CHAINED = "\n".join(f"c{i}: &c{i} {{k: *c{i - 1}}}" for i in range(1, 90))
YAML = {
    "flow": ("a: " + "[" * 2000, "nests deeper than"),
    "mappings": ("a: " + "{b: " * 2000, "nests deeper than"),
    "blocks": ("- " * 2000, "nests deeper than"),
    "keys": ("? " * 2000, "nests deeper than"),
    "chain of aliases": (f"c0: &c0 [1]\n{CHAINED}", "nests deeper than"),
    "doubled": (f"b0: &b0 [1, 2]\n{DOUBLED}", "aliases followed"),
    "merged": (f"m0: &m0 {{a: 1}}\n{MERGED}", "aliases followed"),
    "itself": ("&a\npath: *a", "what it is a part of"),
    "itself within": ("a: &a [[{b: *a}]]", "what it is a part of"),
    "digits": (f"a: {'1' * 5000}", "digits"),
    "hexadecimal digits": (f"a: 0x{'f' * 5000}", "digits"),
    "no truth": ("a: !!bool abc", "'abc' is no bool"),
    "no number": ("a: !!float abc", "'abc' is no float"),
    "no whole number": ("a: !!int 1.5", "'1.5' is no int"),
    "date": ("a: !!timestamp abc", "timestamp"),
    "set": ("a: !!set {b}", "set"),
    "pairs": ("a: !!pairs [[1, 2]]", "pairs"),
    "python": ("a: !!python/object/apply:os.getcwd []", "os.getcwd"),
    "size": ("#" * (MOST_BYTES + 1), "larger than 1 MB"),
}


@pytest.mark.parametrize("name", YAML)
def test_yaml_is_bounded(tmp_path: FilePath, name: str) -> None:
    text, said = YAML[name]
    file = tmp_path / "a.yaml"
    file.write_text(text)
    with pytest.raises(DataError, match=said):
        read_yaml(file)


def test_ordinary_anchors_are_read(tmp_path: FilePath) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("a: &a {x: 1, y: [1, 2]}\nb: {<<: *a, x: 2}\nc: [*a, *a]")
    tree = read_yaml(file)
    assert tree["b"] == {"x": 2, "y": [1, 2]}
    assert tree["c"] == [tree["a"], tree["a"]]


@pytest.mark.parametrize(
    "word", ["path=" + "[" * 2000, ".".join("a" * 3000) + "=1", f"duration={'1' * 5000}"]
)
def test_assignments_are_bounded(word: str) -> None:
    with pytest.raises(ConfigError) as caught:
        override({}, [word])
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize("deep", [DEEPEST, 900, 100_000])
@pytest.mark.parametrize("ends", ["[]", "{}"])
def test_json_is_bounded_in_depth(deep: int, ends: str) -> None:
    text = "[" * deep + "]" * deep if ends == "[]" else '{"a":' * deep + "1" + "}" * deep
    if deep == DEEPEST and ends == "[]":
        from_json(text)
        text = f"[{text}]"
    elif deep == DEEPEST:
        text = f"[{text}]"
    with pytest.raises(ValueError, match="nests deeper"):
        from_json(text)


def test_json_has_no_endless_numbers() -> None:
    with pytest.raises(ValueError, match="digits"):
        from_json("1" * 400)
    assert float(from_json("9" * 300)) > 0.0


def _npy(array: object = None, header: str | None = None, body: bytes = b"") -> bytes:
    out = io.BytesIO()
    if header is None:
        np.lib.format.write_array(out, np.asarray(array), allow_pickle=True)
    else:
        text = header.encode()
        out.write(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body)
    return out.getvalue()


def _header(shape: str, kind: str = "<f8") -> str:
    return f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n"


MEMBERS = {
    "huge": _npy(header=_header("(999999999999,)")),
    "huge of nothing": _npy(header=_header("(999999999999999,)", "|V0")),
    "negative": _npy(header=_header("(-1,)"), body=bytes(8)),
    "short": _npy(header=_header("(3,)"), body=bytes(8)),
    "no header": _npy(header="{'descr': ((((((("),
    "nested header": _npy(header="(" * 60_000),
    "objects": _npy([{}]),
    "no array": b"abc",
    "nothing": b"",
}


def _archive(file: FilePath, **members: bytes) -> FilePath:
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return file


def _episode(file: FilePath) -> object:
    return load_episode(file)


def _checkpoint(file: FilePath) -> object:
    with file.open("rb") as stream:
        return snapshot.read(stream)


@pytest.mark.parametrize("reader", [_episode, _checkpoint])
@pytest.mark.parametrize("name", MEMBERS)
def test_damaged_arrays_are_one_line(
    tmp_path: FilePath, name: str, reader: Callable[[FilePath], object]
) -> None:
    head = _npy(np.frombuffer(b"{}", np.uint8))
    file = _archive(tmp_path / "a.npz", head=head, state=head, time=MEMBERS[name])
    with pytest.raises(DataError) as caught:
        reader(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("reader", [_episode, _checkpoint])
def test_nested_heads_are_one_line(
    tmp_path: FilePath, reader: Callable[[FilePath], object]
) -> None:
    deep = _npy(np.frombuffer(b"[" * 20_000, np.uint8))
    with pytest.raises(DataError, match="nests deeper"):
        reader(_archive(tmp_path / "a.npz", head=deep, state=deep))


@pytest.mark.parametrize("reader", [_episode, _checkpoint])
def test_archives_are_measured_before_they_are_unpacked(
    tmp_path: FilePath, reader: Callable[[FilePath], object]
) -> None:
    file = tmp_path / "a.npz"
    _archive(file, time=_npy(np.zeros(1000)))
    # The size that the directory claims, without the work of packing so much.
    data = file.read_bytes()
    size = len(_npy(np.zeros(1000))).to_bytes(4, "little")
    place = data.rindex(size)
    claimed = (4_000_000_000).to_bytes(4, "little")
    file.write_bytes(data[:place] + claimed + data[place + 4 :])
    with pytest.raises(DataError, match="unpacks to 4000 MB"):
        reader(file)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("speed=random_profile speed.interval=1e-6", "speed.interval: 1e-06 is not allowed"),
        ("speed=random_profile speed.seconds=1e300", "speed.seconds: 1e+300 is not allowed"),
        ("speed=random_profile speed.low=30", "low 30.0 m/s is more than high 25.0 m/s"),
        ("path=harmonic_road path.shortest=300", "shortest 300.0 m is more than longest 250.0 m"),
        ("path=clothoid_road path.longest=5", "shortest 12.0 m is more than longest 5.0 m"),
        ("path=clothoid_road path.min_radius=400", "min_radius 400.0 m is more than max_radius"),
        ("path=spline_road path.shortest=1e12", "path.shortest: 1000000000000.0 is not allowed"),
        ("path=surveyed_road path.max_radius=5", "min_radius 15.0 m is more than max_radius"),
        ("path=random_road path.max_clothoid=2", "min_clothoid 8.0 m is more than max_clothoid"),
        ("vehicle.l_f=1e300", "vehicle.l_f: 1e+300 is not allowed"),
        ("controller=mpc_pid controller.v0=1e300", "controller.v0: 1e+300 is not allowed"),
        ("sensor.spacing=1e300", "sensor.spacing: 1e+300 is not allowed"),
    ],
)
def test_numbers_that_nothing_drives_with_are_named(word: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        configuration("drive", word.split())
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_written_is_read() -> None:
    tree: dict[str, Any] = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": {"c": np.uint8(3), "d": ["x", 1.5, None]},
    }
    out = io.BytesIO()
    snapshot.write(tree, out)
    found = snapshot.read(out)
    assert json.dumps(found["b"], default=int) == json.dumps(tree["b"], default=int)
    assert np.array_equal(found["a"], tree["a"])
    assert set(read_arrays(out)) == {"a", "b.c", "state"}
