"""OpenDRIVE files from strangers: read, or refused with a line that helps."""

from __future__ import annotations

import contextlib
import math
import re
import time
from pathlib import Path as FilePath

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steersman.errors import DataError
from steersman.paths.analytic import Circle
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.xodr import xml
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.write import opendrive

from . import xodr_maps as maps
from .xodr_maps import lane, road, section, whole

VIEW = '<geometry s="0" x="0" y="0" hdg="0" length="20"><line/></geometry>'
GOOD = whole(road("1", VIEW, 20.0))


def named(file: FilePath) -> str:
    """Why the map is refused, or what of it is left out."""
    try:
        found = [fault.text for fault in read_network(file).left_out]
    except DataError as error:
        found = [str(error).removeprefix(f"{file}: ")]
    assert found
    assert not any("\n" in line for line in found)
    return "\n".join(found)


def refused(file: FilePath) -> str:
    with pytest.raises(DataError) as caught:
        read_network(file)
    text = str(caught.value)
    assert text.startswith(str(file))
    assert "\n" not in text
    return text.removeprefix(f"{file}: ")


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; give an OpenDRIVE file"),
        ("x", "line 1: not valid XML: Start tag expected"),
        ("<OpenDRIVE>\n<road", "line 2: not valid XML: "),
        ("<a/>", "line 1: <a>: this is no OpenDRIVE file, whose first element is <OpenDRIVE>"),
        ("<OpenDRIVE/>", "line 1: <OpenDRIVE>: holds no road"),
        (changed(' length="20.0"', ""), "line 3: <road>: length is missing; allowed: id"),
        (changed('length="20.0"', 'lenght="20"'), "length is missing; did you mean 'lenght'?"),
        (changed('length="20.0"', 'length="far"'), "<road>: length is 'far', not a number"),
        (changed('length="20.0"', 'length="nan"'), "<road>: length is nan, not within 0 to 1e+08"),
        (changed('length="20.0"', 'length="-1"'), "<road>: length is -1, not within 0 to 1e+08"),
        (changed('length="20.0"', 'length="1e7"'), "length is 1e+07 m, the most is 1e+06 m"),
        (changed('length="20"', 'length="inf"'), "line 3: <geometry>: length is inf, not within"),
        (
            changed('length="20"', 'length="5"'),
            "its geometries end at 5 m, its length is 20 m; what is",
        ),
        (changed('s="0" x', 's="9" x'), "<road>: its geometries begin at 9 m"),
        (changed("<line/>", "<lime/>"), "<geometry>: holds none of line, arc, spiral, poly3, para"),
        (changed("<line/>", "<arc/>"), "line 3: <arc>: curvature is missing"),
        (changed("<line/>", '<arc curvature="1e99"/>'), "<arc>: curvature is 1e99, not within -1e"),
        (
            changed("<line/>", '<paramPoly3 pRange="arclength"/>'),
            "<paramPoly3>: pRange is 'arclength'; did you mean 'arcLength'?",
        ),
        (changed(VIEW, VIEW + VIEW.replace('s="0"', 's="-1"')), "<geometry>: s is -1, not within"),
        (changed(VIEW, ""), "<road>: has no <planView> with a <geometry> that has a length"),
        (changed("<lanes>", "<x>").replace("</lanes>", "</x>"), "line 3: <road>: has no <lanes>"),
        (GOOD.replace("<road ", '<road rule="RTH" '), "<road>: rule is 'RTH'; did you mean 'RHT'?"),
        (
            whole(road("1", VIEW, 20.0), road("1", VIEW, 20.0)),
            "line 4: <road>: id '1' is that of the road in line 3 too",
        ),
        (
            whole(road("1", VIEW, 20.0, section(0.0, lane(-1)))),
            "<lane>: id is -1, on the wrong side",
        ),
        (
            whole(road("1", VIEW, 20.0, section(0.0, "", lane(-1) + lane(-1)))),
            "<lane>: id -1 is there twice",
        ),
        (
            whole(road("1", VIEW, 20.0, section(0.0, "", lane(-2)))),
            "lane -2 has no neighbour towards the middle",
        ),
        (
            whole(road("1", VIEW, 20.0, section(9.0, "", lane(-1)) + maps.ONE_WAY)),
            "<lanes>: its sections are not in the order of s; taken in",
        ),
        (
            whole(*(road(str(i), VIEW.replace('"20"', '"1e6"'), 1e6) for i in range(6))),
            "<OpenDRIVE>: its lanes are 1.2e+07 m long, the most is 1e+07 m",
        ),
        (changed('<lane id="-1"', '<lane id="-1.5"'), "<lane>: id is '-1.5', not a whole number"),
        (changed('a="3.5"', 'a="wide"'), "<width>: a is 'wide', not a number"),
        (
            whole(road("1", VIEW, 20.0, links=maps.to("successor", "rood", "2"))),
            "<successor>: elementType is 'rood'; did you mean 'road'?",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path: FilePath, text: str, message: str) -> None:
    assert message in named(maps.write(tmp_path / "map.xodr", text))


@pytest.mark.parametrize("before", ["\n", " \t\r\n", "<!-- a -->\n<!-- > - b\n-->", "<!---->"])
def test_a_late_declaration_is_read(tmp_path: FilePath, before: str) -> None:
    file = maps.write(tmp_path / "map.xodr", before + GOOD)
    assert list(read_network(file).roads) == ["1"]
    odd = maps.write(tmp_path / "odd.xodr", before + changed('length="20.0"', 'length="far"'))
    assert refused(odd).startswith(f"line {before.count(chr(10)) + 3}: <road>: length is 'far'")
    for text in ("<!--", "<!-- a <?xml?>", "<!-- a --><?xml", f"{before}<?xml "):
        assert "not valid XML" in refused(maps.write(tmp_path / "cut.xodr", text))


def test_what_is_no_file(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "No such file" in refused(tmp_path / "nowhere.xodr")
    assert "is a folder" in refused(tmp_path)
    with pytest.raises(DataError, match="not the name of a file"):
        read_network(FilePath("a\0b.xodr"))
    binary = tmp_path / "binary.xodr"
    binary.write_bytes(bytes(range(256)) * 4)
    assert "not valid XML" in refused(binary)
    monkeypatch.setattr(xml, "MAX_BYTES", 100)
    assert "is larger than" in refused(maps.write(tmp_path / "large.xodr", GOOD))


def test_entities_are_refused(tmp_path: FilePath) -> None:
    secret = maps.write(tmp_path / "secret.txt", "secret")
    head = f'<!DOCTYPE OpenDRIVE [<!ENTITY x SYSTEM "{secret.as_uri()}">]>\n'
    text = GOOD.replace("<OpenDRIVE", f"{head}<OpenDRIVE").replace("<planView>", "&x;<planView>")
    assert "document type" in refused(maps.write(tmp_path / "map.xodr", text))
    outside = GOOD.replace("<OpenDRIVE", '<!DOCTYPE OpenDRIVE SYSTEM "http://[::1]:9/x"><OpenDRIVE')
    assert "document type" in refused(maps.write(tmp_path / "map.xodr", outside))


def test_what_would_blow_up_is_refused_at_once(tmp_path: FilePath) -> None:
    begun = time.perf_counter()
    rows = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    bomb = f'<!DOCTYPE a [<!ENTITY l0 "lol">{rows}]><OpenDRIVE x="&l11;">&l11;</OpenDRIVE>'
    assert refused(maps.write(tmp_path / "bomb.xodr", bomb))
    deep = "<OpenDRIVE>" * 100_000
    assert "depth" in refused(maps.write(tmp_path / "deep.xodr", deep))
    assert time.perf_counter() - begun < 5.0


def test_namespaces_comments_and_encodings(tmp_path: FilePath) -> None:
    text = opendrive(Circle())
    plain = read_network(maps.write(tmp_path / "a.xodr", text))
    other = text.replace("<OpenDRIVE>", '<!-- x --><OpenDRIVE xmlns="http://code.asam.net/x">')
    other = other.replace("<planView>", "<!-- x --><planView><?x y?>").replace("UTF-8", "UTF-16")
    file = tmp_path / "b.xodr"
    file.write_bytes(other.encode("utf-16"))
    assert read_network(file).roads == plain.roads


def test_lines_are_counted_beyond_two_bytes(tmp_path: FilePath) -> None:
    text = GOOD.replace("><", ">\n<").replace("<road", "\n" * 70_000 + "<road")
    found = refused(maps.write(tmp_path / "map.xodr", text.replace('length="20.0"', "")))
    match = re.match(r"line (\d+): <road>: length is missing", found)
    assert match is not None
    # The parser itself counts no further; beyond, it goes by the text between elements.
    assert int(match[1]) == pytest.approx(70_003, abs=3)


# Words that take the place of figures and names, and what they might do.
_WORDS = (
    "",
    "0",
    "-1",
    "1e-9",
    "1e5",
    "1e308",
    "-1e8",
    "nan",
    "inf",
    "x",
    "0x1",
    "\u0661",
    "9" * 400,
)
_SOURCE = maps.town()
_ATTRIBUTE = re.compile(r'="([^"]*)"')
_PLACES = [match.span(1) for match in _ATTRIBUTE.finditer(_SOURCE)]
_TAGS = [match.span() for match in re.finditer(r"<[^>]+>", _SOURCE)]


@st.composite
def corrupt(draw: st.DrawFn) -> bytes:
    """The town with a few words, elements or bytes changed."""
    text = _SOURCE
    kind = draw(st.sampled_from(("words", "tags", "bytes", "cut")))
    if kind == "words":
        places = draw(st.lists(st.sampled_from(_PLACES), min_size=1, max_size=4, unique=True))
        for start, end in sorted(places, reverse=True):
            text = text[:start] + draw(st.sampled_from(_WORDS)) + text[end:]
    elif kind == "tags":
        start, end = draw(st.sampled_from(_TAGS))
        other = draw(st.sampled_from(_TAGS))
        text = text[:start] + draw(st.sampled_from(("", text[slice(*other)]))) + text[end:]
    data = text.encode()
    if kind == "bytes":
        at = draw(st.integers(0, len(data) - 1))
        data = data[:at] + draw(st.binary(max_size=4)) + data[at + draw(st.integers(0, 4)) :]
    elif kind == "cut":
        data = data[: draw(st.integers(0, len(data)))]
    return data


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=corrupt(), seed=st.integers(0, 5))
def test_corrupt_files_are_read_or_refused(tmp_path: FilePath, data: bytes, seed: int) -> None:
    file = tmp_path / "corrupt.xodr"
    file.write_bytes(data)
    begun = time.process_time()
    for words in ({"route": ("a", "a")}, {"random": seed, "distance": 100.0}, {"road": "back"}):
        path = OpenDrivePath(file=file, **words)
        with contextlib.suppress(DataError):
            assert 0.0 < path.length < 1e6
            assert all(map(math.isfinite, path.at(0.5 * path.length)))
    assert time.process_time() - begun < 10.0
