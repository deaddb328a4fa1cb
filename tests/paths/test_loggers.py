"""What loggers write beside rows of numbers: sections, other units of angle, gaps, bad fixes."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.config import resolve
from steersman.errors import DataError
from steersman.paths.csv_path import CsvPath
from steersman.paths.log_path import LogPath
from steersman.tables import read_sheet

NORTH, EAST = 48.7765, 11.4354
# A road to the north-east, bending to the left: degrees of latitude and longitude.
ANGLES = np.linspace(0.0, 1.2, 40)
LAT = NORTH + 8e-4 * (1.0 - np.cos(ANGLES))
LON = EAST + 1.2e-3 * np.sin(ANGLES)
DECIMAL = [f"{a:.9f},{b:.9f}" for a, b in zip(LAT, LON, strict=True)]


def written(file: FilePath, lines: list[str]) -> CsvPath:
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return CsvPath(file=file)


@pytest.fixture
def plain(tmp_path: FilePath) -> CsvPath:
    return written(tmp_path / "plain.csv", ["lat,lon", *DECIMAL])


def same(one: CsvPath, other: CsvPath) -> None:
    """Both are one line in the plane, to a centimetre."""
    a, b = one.recorded(speeds=True), other.recorded(speeds=True)
    assert a.place == pytest.approx(b.place, abs=0.01)


def vbox(speed: float = 36.0) -> list[str]:
    rows = [
        f"017 1012{33 + 0.5 * k:05.2f} +{60 * a:011.6f} {-60 * b:+012.6f} {speed:07.3f} 090.00"
        for k, (a, b) in enumerate(zip(LAT, LON, strict=True))
    ]
    head = ["File created on 11/06/2024 at 10:12:33", "", "[header]", "time", "velocity kmh", ""]
    names = ["[column names]", "sats time lat long velocity heading", "", "[data]"]
    return [*head, *names, *rows]


@pytest.mark.parametrize("name", ["drive.vbo", "drive.csv"])
def test_a_file_of_vbox_is_in_minutes_and_west(
    plain: CsvPath, tmp_path: FilePath, name: str
) -> None:
    path = written(tmp_path / name, vbox())
    same(path, plain)
    speed = path.recorded(speeds=True).speed
    assert speed == pytest.approx(np.full(len(LAT), 10.0))
    sheet = read_sheet(tmp_path / name, "", lambda _: False)
    assert np.diff(sheet.numbers("time [s]")) == pytest.approx(0.5)
    assert sheet.lines[0] == len(vbox()) - len(LAT) + 1


def test_the_head_of_a_section_is_no_row(plain: CsvPath, tmp_path: FilePath) -> None:
    path = written(tmp_path / "a.csv", ["[log]", "lat,lon", "[data]", *DECIMAL])
    assert len(path.recorded().place) == len(LAT)
    same(path, plain)


def arc(value: float, sides: str) -> str:
    degrees, rest = divmod(abs(value) * 3600.0, 3600.0)
    minutes, seconds = divmod(rest, 60.0)
    return f"{degrees:.0f}°{minutes:02.0f}'{seconds:07.4f}\"{sides[int(value < 0.0)]}"


def test_degrees_may_have_minutes_and_seconds(plain: CsvPath, tmp_path: FilePath) -> None:
    rows = [f"{arc(a, 'NS')},{arc(b, 'EW')}" for a, b in zip(LAT, LON, strict=True)]
    same(written(tmp_path / "dms.csv", ["Lat,Lon", *rows]), plain)
    south = [f"{arc(-a, 'NS')};{arc(-b, 'OW')}" for a, b in zip(LAT, LON, strict=True)]
    turned = written(tmp_path / "south.csv", ["Lat;Lon", *south]).recorded().place
    assert turned == pytest.approx(-plain.recorded().place, abs=0.02)


def test_a_header_that_is_repeated_is_left_out(plain: CsvPath, tmp_path: FilePath) -> None:
    head = ["lat,lon", "deg,deg"]
    path = written(tmp_path / "r.csv", [*head, *DECIMAL[:17], *head, *DECIMAL[17:]])
    assert len(path.recorded().place) == len(LAT)
    same(path, plain)


@pytest.mark.parametrize(("factor", "text"), [(60.0, "latitude=TITLE/60"), (1e7, "TITLE/1e7")])
def test_angles_in_another_unit_say_how_to_read_them(
    plain: CsvPath, tmp_path: FilePath, factor: float, text: str
) -> None:
    rows = [f"{factor * a:.7f},{factor * b:.7f}" for a, b in zip(LAT, LON, strict=True)]
    path = written(tmp_path / "large.csv", ["lat,lon", *rows])
    with pytest.raises(DataError, match=text):
        path.recorded()
    scaled = f"latitude=lat/{factor:.0f},longitude=lon/{factor:.0f}"
    same(path.model_copy(update={"columns": scaled}), plain)


def test_a_gap_in_reception_says_where_and_how_long(tmp_path: FilePath) -> None:
    rows = [",".join("" if 10 <= k < 20 else c for c in row.split(","))
            for k, row in enumerate(DECIMAL)]  # fmt: skip
    path = written(tmp_path / "gap.csv", ["lat,lon", *rows])
    place = path.recorded().place
    gap = math.dist(place[9], place[10])
    (told,) = (note for note in path.notes() if "without a position" in note)
    assert told.startswith("10 rows without a position are left out; the longest gap, ")
    assert f"{gap:.3g} m behind line 11, is bridged" in told


@pytest.mark.parametrize("smoothing", [None, "auto"])
def test_one_bad_fix_is_named_by_its_line(tmp_path: FilePath, smoothing: str | None) -> None:
    """Before that, the car stands and its position jitters."""
    rng = np.random.default_rng(0)
    stands = rng.normal(0.0, 0.02, (20, 2))
    drives = np.column_stack([np.arange(60) * 1.4, np.zeros(60)]) + rng.normal(0, 0.02, (60, 2))
    place = np.vstack([stands, drives])
    place[50, 1] += 8.0
    rows = [f"{x:.4f},{y:.4f}" for x, y in place.tolist()]
    path = written(tmp_path / "bad.csv", ["x,y", *rows]).model_copy(update={"smoothing": smoothing})
    with pytest.raises(DataError, match=r"line 52: the point is [78]\S* m beside its neighbours"):
        _ = path.table


def test_a_recording_in_degrees_is_led_to_the_kind_that_reads_it(tmp_path: FilePath) -> None:
    lines = ["time,lat,lon", *(f"{0.1 * k:.1f},{row}" for k, row in enumerate(DECIMAL))]
    (tmp_path / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(DataError, match="latitude and longitude are for path=csv, with speed=path"):
        LogPath(file=tmp_path / "log.csv").recorded()


def test_a_loop_that_is_closed_over_a_gap_says_so(tmp_path: FilePath) -> None:
    bend = [f"{20 * math.sin(a / 20)},{20 - 20 * math.cos(a / 20)}" for a in range(60)]
    path = written(tmp_path / "bend.csv", ["x,y", *bend])
    closed = path.model_copy(update={"loop": True})
    (told,) = (note for note in closed.notes() if "closed over" in note)
    assert "from line 61 to 2 (loop: true)" in told
    whole = [f"{20 * math.sin(a / 20)},{20 - 20 * math.cos(a / 20)}" for a in range(125)]
    lap = written(tmp_path / "lap.csv", ["x,y", *whole]).model_copy(update={"loop": True})
    assert not [note for note in lap.notes() if "closed over" in note]


@pytest.mark.parametrize(
    ("name", "data", "cure"),
    [
        ("track.kml", b"<kml/>", "gpsbabel -i kml"),
        ("track.xlsx", b"PK\x03\x04", "save the sheet as CSV"),
        ("track.csv", b"PK\x03\x04rest", "an archive like those of Excel; save it as CSV"),
        ("track.nmea", b"$GPGGA,1", "gpsbabel -i nmea"),
        ("track.txt", b"$GNRMC,1,2\r\n$GNGGA,3,4\r\n", "gpsbabel -i nmea"),
    ],
)
def test_other_formats_say_what_becomes_of_them(
    tmp_path: FilePath, name: str, data: bytes, cure: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DataError, match=cure):
        _ = resolve("path", str(tmp_path / name)).table  # type: ignore[union-attr]
