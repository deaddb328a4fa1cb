"""The page: complete, self-contained, and safe against the names in it."""

import base64
import gzip
import hashlib
import json
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from steersman.config import build
from steersman.errors import DataError, SteersmanError
from steersman.metrics.base import summarise
from steersman.report import ReportRun, Table, tables, web, write_report
from steersman.report import html as module
from steersman.report.html import LIMIT, group_title, render
from steersman.report.signals import ShownDrive, group_by_path
from steersman.report.tables import flat, text
from steersman.rollout import RunConfig, run

EVIL = "<script>alert('&\"')</script>"
VOID = {"meta", "link", "line", "input", "br"}


@pytest.fixture
def runs(drive):
    meta = {"config": {"path": {"kind": "circle"}, "corridor": 2.0}, "seed": 1}
    good, bad = drive(meta=meta), drive(end="off_track", meta={EVIL: EVIL})
    return [
        ReportRun("pid", good, summarise(good), config=good.meta),
        ReportRun(EVIL, bad, {**summarise(bad), "fallbacks": 3}, config=bad.meta),
        ReportRun("same", good, summarise(good), config=good.meta),
        ReportRun("training", training={"steps": np.arange(3.0), EVIL: np.arange(3.0)}),
        ReportRun(
            "table", table=Table(EVIL, [{"a": EVIL}, {"a": 1.5, "b": 2}], {"a": EVIL, "b": "b"})
        ),
    ]


def test_the_table_of_runs_tells_who_drove_what(drive):
    config = {"controller": {"kind": "stanley"}, "vehicle": "bmw_320i"}
    episode = drive(meta={"config": config})
    known = tables.summary_row(ReportRun("a", episode, summarise(episode), config=config))
    meta = tables.summary_row(
        ReportRun("c", episode, summarise(episode), config=dict(episode.meta))
    )
    assert [cell.text for cell in meta[:2]] == ["stanley", "bmw_320i"]
    unknown = tables.summary_row(ReportRun("b", episode, summarise(episode)))
    assert [cell.text for cell in known[:3]] == ["stanley", "bmw_320i", "duration"]
    assert [cell.text for cell in unknown[:2]] == [tables.NOTHING] * 2


class Outline(HTMLParser):
    """Collects tags, attributes and text; fails on tags that do not match."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.open, self.texts = [], [], [], []
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def packed(page, name):
    content = re.search(rf'id="{name}">([^<]*)<', page).group(1)
    return gzip.decompress(base64.b64decode(content)).decode()


def test_names_cannot_break_out(runs):
    page = render(runs, EVIL)
    assert EVIL not in page
    outline = Outline(page)
    assert outline.tags.count("script") == 3  # the data, the columns, the page's own
    assert EVIL in outline.texts
    # The script gets the very name, and puts it into the page as text (test_browser).
    assert json.loads(packed(page, "data"))["groups"][0]["runs"][1]["name"] == EVIL


def test_nothing_is_fetched(runs):
    page = render(runs, "title")
    outline = Outline(page)
    references = {value for key, value in outline.attributes if key in ("src", "href", "action")}
    assert references == {"data:,"}
    readable = re.sub(r'id="(columns|data)">[^<]*<', "", page)
    readable = readable.replace("http://www.w3.org/2000/svg", "")  # a name, not an address
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", readable)
    policy = [value for key, value in outline.attributes if key == "content"]
    assert any(value.startswith("default-src 'none';") for value in policy)
    assert "connect-src" not in page


def test_only_the_pages_own_script_may_run(runs):
    page = render(runs, "title")
    content = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    (policy,) = [v for _, v in Outline(page).attributes if str(v).startswith("default-src")]
    (allowed,) = re.findall(r"script-src ([^;]*);", policy)
    digests = [base64.b64encode(hashlib.sha256(c.encode()).digest()).decode() for c in content]
    assert [allowed] == [f"'sha256-{digest}'" for digest in digests]


def test_it_is_small_and_the_same_each_time(runs, tmp_path):
    first = write_report(runs, tmp_path / "a" / "report.html", "title").read_bytes()
    second = write_report(runs, tmp_path / "b.html", "title").read_bytes()
    assert first == second
    assert len(first) < 150_000


def test_twenty_minutes_are_kept_step_by_step():
    tree = {"controller": "stanley", "duration": 60.0, "vehicle": "bmw_320i",
            "speed": {"kind": "constant_speed", "speed": 9.0},
            "sensor": {"kind": "waypoints", "error_range": 0.1}}  # fmt: skip
    minute = run(build(RunConfig, tree))
    columns = {name: np.tile(values, 20) for name, values in minute.columns.items()}
    columns["time"] = 0.05 * np.arange(24_000)
    episode = replace(minute, columns=columns)
    assert len(episode) == 24_000
    page = render([ReportRun("long", episode, summarise(episode))], "t")
    assert len(page) < LIMIT / 2
    (found,) = json.loads(packed(page, "data"))["groups"][0]["runs"]
    assert found["kept"]
    assert found["seen"]["every"] == 1


def test_the_data_are_those_of_the_runs(runs):
    data = json.loads(packed(render(runs, "title"), "data"))
    (group,) = data["groups"]
    assert [run["name"] for run in group["runs"]][::2] == ["pid", "same"]
    assert {signal["key"] for signal in data["signals"]} <= set(group["runs"][0]["columns"])
    assert data["training"]["x"] == "environment steps"


def test_runs_that_failed_and_fallbacks_are_marked(runs):
    page = render(runs, "title")
    assert ' bad">off track</td>' in page
    assert 'bad">3</td>' in page
    assert page.count(' bad">') == 2


def test_a_single_drive_has_its_figures_in_large_letters(drive):
    episode = drive(n=100, end="roll_over")
    values = {**summarise(episode), "interventions": 2}
    page = render([ReportRun("one", episode, values)], "t")
    tiles = re.findall(r"<div><dt>([^<]*)</dt><dd([^>]*)>([^<]*)", page)
    found = {title: (text.strip(), "bad" in marks) for title, marks, text in tiles}
    assert found["ended by"] == ("roll over", True)
    assert found["max |d|"] == ("10", False)
    assert found["interventions"] == ("2", True)
    assert "interventions" not in dict(
        re.findall(
            r"<dt>([^<]*)</dt>(.)", render([ReportRun("one", episode, summarise(episode))], "t")
        )
    )
    several = render([ReportRun("one", episode, values), ReportRun("two", episode, values)], "t")
    assert "<dt>ended by" not in several
    assert "inter-ventions" in several
    assert "inter-ventions" not in render([ReportRun("one", episode, summarise(episode))] * 2, "t")


def test_nothing_in_the_script_ends_it_early():
    assert not re.search(r"</script|<!--", web.script(), re.IGNORECASE)


def test_each_configuration_is_shown_once(runs):
    page = render(runs, "title")
    assert page.count("<pre>") == 2
    assert "<summary>pid, same</summary>" in page


def test_tables_alone_need_no_script():
    page = render(
        [
            ReportRun("t", table=Table("T", [{"a": None}], {"a": "A"})),
            ReportRun("m", metrics={"x": 1.0}),
        ],
        "t",
    )
    Outline(page)
    assert len(page) < 20_000
    assert "<script" not in page
    assert any("script-src 'none'" in str(v) for _, v in Outline(page).attributes)


def test_the_replay_is_first_and_long_tables_are_folded_up_behind_short_ones(drive):
    tables = [Table("Long", [{"a": k} for k in range(13)]), Table("Short", [{"a": 1}])]
    runs = [ReportRun(table.title, table=table) for table in tables]
    page = render([*runs, *(ReportRun(f"folder/{k}", drive()) for k in "xy")], "t")
    places = [page.index(words) for words in ('id="replay"', "<h2>Short", "Long (13 rows)")]
    assert places == sorted(places)
    assert page.count("<details>") == page.count("</details>") - page.count("<details ")


@pytest.mark.parametrize("n", [0, 1, 2])
def test_very_short_drives(drive, n):
    episode = drive(n=n)
    page = render([ReportRun("short", episode, summarise(episode))], "t")
    Outline(page)
    assert "short" in page
    assert not re.search(r">\s*nan\s*<", page, re.IGNORECASE)


def test_a_training_without_rows():
    page = render([ReportRun("t", training={"steps": np.array([]), "loss": np.array([])})], "t")
    assert "Nothing was recorded yet" in page


def test_nothing_to_report(tmp_path):
    with pytest.raises(DataError, match="nothing to report"):
        write_report([], tmp_path / "report.html", "t")
    assert not list(tmp_path.iterdir())


def test_a_missing_extra_says_what_to_install(runs, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(SteersmanError, match=r"pip install 'steersman\[report\]'"):
        render(runs, "t")


def test_the_template_engine_is_imported_only_when_used():
    code = "import sys, steersman.report as r; sys.exit('jinja2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("meta", "title"),
    [
        ({"config": {"path": {"kind": "figure_eight"}}}, "Figure eight, loop of 314.2 m"),
        ({"path": "circle"}, "Circle, loop of 314.2 m"),
        ({}, "Path, loop of 314.2 m"),
        ({"config": 3}, "Path, loop of 314.2 m"),
    ],
)
def test_titles_of_groups(drive, meta, title):
    assert group_title([ShownDrive("a", drive(meta=meta))]) == title


def test_the_corridor_is_the_recorded_one(runs, drive):
    assert module.half_width(group_by_path(runs)[0]) == 2.0
    assert module.half_width([ShownDrive("a", drive())]) == 1.5
    (group,) = json.loads(packed(render(runs, "t"), "data"))["groups"]
    assert group["half"] == 2.0


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "\u2013"), (float("nan"), "\u2013"), (True, "yes"), (False, "no"), (12345, "12345"),
        (0.00012346, "0.0001235"), (12345.6, "12346"), (1.5e9, "1.5e+09"), ([1, 2.5], "1, 2.5"),
        ("text", "text"),
    ],
)  # fmt: skip
def test_values_as_text(value, shown):
    assert text(value) == shown


def test_nested_metrics_are_flattened():
    assert flat({"a": 1, "steady": {"b": 2}}) == {"a": 1, "steady.b": 2}
