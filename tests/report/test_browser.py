"""The page in a browser: headless Chromium of the system, driven by Playwright."""

import re
import time

import numpy as np
import pytest

from steersman.report.article import Section, write_article
from steersman.report.marks import marks
from steersman.report.scene import RoadGroup
from steersman.report.signals import ShownDrive

PHONE = {"width": 390, "height": 844}


def cursor(page):
    return float(state(page, "cursor"))


def state(page, name):
    # The next frame is what tells it.
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    return page.locator("#replay").get_attribute(f"data-{name}")


def part(page, name):
    return page.locator(f"[data-part={name}]")


@pytest.mark.parametrize(
    ("name", "scheme"),
    [("several", "dark"), ("one step", "light"), ("off", "dark"), ("nothing", "light")],
)
def test_every_page_opens_and_plays_without_a_fault(visit, name, scheme):
    page = visit(name, color_scheme=scheme)
    page.keyboard.press(" ")
    for key in ("n", "p", "+", "0", "f", "r", "End", "ArrowLeft", "Home"):
        page.keyboard.press(key)
    assert cursor(page) == pytest.approx(0.0, abs=0.5)


def test_it_plays_at_its_rate_and_stops(visit):
    page = visit("several")
    play = part(page, "play")
    assert play.get_attribute("aria-label") == "Play"
    part(page, "rate").select_option("2")
    play.click()
    begun = time.monotonic()
    while cursor(page) < 0.5:
        assert time.monotonic() < begun + 20.0
    assert state(page, "playing") == "true"
    page.keyboard.press("Escape")
    play.press(" ")
    paused = cursor(page)
    page.wait_for_timeout(120)
    assert cursor(page) == paused
    assert play.get_attribute("aria-label") == "Play"
    # At the end it stops, and begins anew.
    part(page, "rate").select_option("0.1")
    page.keyboard.press("Escape")
    play.focus()
    page.keyboard.press("End")
    play.click()
    assert 0.0 <= cursor(page) < 1.0


def test_slider_and_signals_scrub(visit, drives):
    page = visit("several")
    part(page, "slider").fill("4")
    assert cursor(page) == pytest.approx(4.0, abs=0.01)
    box = part(page, "overlay").bounding_box()
    left, right = 58, 12  # panels.js
    part(page, "overlay").click(position={"x": left + (box["width"] - left - right) / 4, "y": 80})
    end = max(r.episode["time"][-1] for r in drives["several"][:3])
    assert cursor(page) == pytest.approx(end / 4, abs=end / 500)
    assert part(page, "time").inner_text().startswith(f"{cursor(page):.2f} / {end:.1f} s")


def test_what_is_told_at_the_cursor_is_what_was_recorded(visit, drives):
    page = visit("several")
    part(page, "slider").fill("3.5")
    assert cursor(page) == pytest.approx(3.5, abs=0.01)
    told = page.locator(".values").first.inner_text()
    episode = drives["several"][0].episode
    speed = float(np.hypot(episode["v_x"], episode["v_y"])[70])
    error = abs(1e3 * episode["lateral_error"][70])
    assert told.startswith(f"{speed:.1f} m/s · ")
    assert float(re.search(r"· ([\d.]+) mm", told)[1]) == pytest.approx(error, rel=0.01, abs=0.01)


def test_marks_are_jumped_to_and_followed(visit, drives):
    page = visit("off")
    episode = drives["off"][0].episode
    wanted = marks(episode)
    buttons = page.locator(".moment")
    assert buttons.count() == len(wanted)
    end = page.locator(".moment[data-kind=end]")
    assert "off track" in end.inner_text()
    end.click()
    assert cursor(page) == pytest.approx(episode["time"][-1], abs=2e-3)
    assert "off track" in page.locator("[role=status]").inner_text()


def test_keys_go_from_mark_to_mark_in_the_order_of_time(visit, drives):
    page = visit("several")
    episodes = [r.episode for r in drives["several"][:3]]
    times = sorted({float(e["time"][m["row"]]) for e in episodes for m in marks(e)} - {0.0})
    assert len(times) >= 3
    found = []
    for _ in times:
        page.keyboard.press("n")
        found.append(cursor(page))
    assert found == pytest.approx(times, abs=2e-3)
    page.keyboard.press("n")
    assert cursor(page) == found[-1]
    page.keyboard.press("p")
    assert cursor(page) == found[-2]


def test_the_keyboard_does_what_the_legend_says(visit):
    page = visit("several")
    page.keyboard.press("ArrowRight")
    assert cursor(page) == pytest.approx(1.0)
    page.keyboard.press("Shift+ArrowRight")
    assert cursor(page) == pytest.approx(1.05)
    page.keyboard.press("ArrowLeft")
    assert cursor(page) == pytest.approx(0.05)
    before = float(state(page, "scale"))
    page.keyboard.press("+")
    assert float(state(page, "scale")) > before
    page.keyboard.press("f")
    assert state(page, "follow") == "false"
    page.keyboard.press("ArrowUp")
    assert part(page, "rate").input_value() == "2"
    page.keyboard.press("?")
    help_ = page.locator("dialog")
    assert help_.is_visible()
    assert "play, pause" in help_.inner_text()
    part(page, "keys").uncheck()
    page.keyboard.press("Escape")
    page.keyboard.press("f")
    assert state(page, "follow") == "false"
    part(page, "rate").focus()
    page.keyboard.press("n")  # a list of choices has a use for letters of its own
    page.keyboard.press("ArrowRight")
    assert cursor(page) == pytest.approx(0.05)
    assert state(page, "playing") == "false"


def test_the_map_is_panned_and_zoomed(visit):
    page = visit("several")
    box = part(page, "map").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(*middle)
    before = float(state(page, "scale"))
    page.mouse.wheel(0, -100)
    assert float(state(page, "scale")) == before  # the page's own wheel
    page.mouse.down()
    page.mouse.move(middle[0] + 50, middle[1])
    page.mouse.up()
    assert state(page, "follow") == "false"
    top = page.evaluate("scrollY")
    page.mouse.wheel(0, -100)
    assert float(state(page, "scale")) > before
    assert page.evaluate("scrollY") == top


def test_drives_are_hidden_followed_and_shown(visit):
    page = visit("several")
    assert page.locator(".drives li").count() == 3
    ours = page.evaluate(COLOURED, "#0072b2")
    assert ours > 50
    page.locator(".drives .chip").first.click()
    page.locator(".drives .chip").first.evaluate("node => node.blur()")
    assert page.locator(".drives .chip").first.get_attribute("aria-pressed") == "false"
    state(page, "cursor")
    assert page.evaluate(COLOURED, "#0072b2") < ours / 10
    page.locator(".drives .lead").nth(1).click()
    assert page.locator(".drives .lead").nth(1).get_attribute("aria-pressed") == "true"


# Pixels of the map and of the signals that have a colour.
COLOURED = """(color) => {
  const wanted = [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16));
  let count = 0;
  for (const name of ["map", "base"]) {
    const canvas = document.querySelector(`[data-part=${name}]`);
    const copy = new OffscreenCanvas(canvas.width, canvas.height);
    const context = copy.getContext("2d", { willReadFrequently: true });
    context.drawImage(canvas, 0, 0);
    const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
    for (let i = 0; i < data.length; i += 4) {
      count += wanted.every((value, k) => Math.abs(data[i + k] - value) < 6);
    }
  }
  return count;
}"""


def test_place_instead_of_time(visit, drives):
    page = visit("several")
    part(page, "slider").fill("2")
    part(page, "axis").select_option("along")
    episode = drives["several"][0].episode
    assert cursor(page) == pytest.approx(float(episode["s"][40]), abs=0.02)
    page.keyboard.press("Escape")
    part(page, "map").focus()
    page.keyboard.press("ArrowRight")
    assert cursor(page) == pytest.approx(float(episode["s"][40]) + 10.0, abs=0.02)


def test_it_fits_a_phone_and_a_small_screen(visit):
    page = visit("several", PHONE, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    page = visit("several")
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280
    player = page.locator("#replay").bounding_box()
    signals = part(page, "signals").bounding_box()
    # From its heading to the last signal, the player is seen at once.
    assert signals["y"] + signals["height"] - player["y"] <= 720
    page.set_viewport_size(PHONE)
    state(page, "cursor")
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]


def test_light_and_dark_follow_the_system_and_the_button(visit):
    page = visit("several", color_scheme="dark")
    back = "getComputedStyle(document.body).backgroundColor"
    dark, dark_map = page.evaluate(back), page.evaluate(COLOURED, "#171d1c")
    page.locator(".theme").click()
    state(page, "cursor")
    light, light_map = page.evaluate(back), page.evaluate(COLOURED, "#eef2ec")
    assert light == "rgb(255, 255, 255)"
    assert dark != light
    assert min(dark_map, light_map) > 50_000  # the ground
    assert page.evaluate(COLOURED, "#171d1c") < dark_map / 100
    page.emulate_media(color_scheme="light")
    page.locator(".theme").click()
    assert page.evaluate(back) == dark


@pytest.mark.parametrize("name", ["several", "one step"])
def test_names_stay_names(visit, name):
    page = visit(name)
    assert page.title().startswith("</script><img")
    assert page.locator("img").count() == 0
    assert page.locator("script").count() == 3
    assert page.locator(".drives .name").filter(has_text="</script><img").count() == 1


def test_an_article_replays_behind_its_first_section(visit, article):
    page = visit(article, PHONE)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    titles = page.locator("h2").all_inner_texts()
    assert titles == ["First", "Replay", "Last"]
    roads = part(page, "road")
    assert roads.locator("option").count() == 2
    page.locator(".moment[data-kind=end]").click()
    assert cursor(page) > 1.0
    assert 0 <= part(page, "map").bounding_box()["y"] < 400  # what is jumped to is seen
    roads.select_option("1")
    assert (state(page, "group"), cursor(page)) == ("1", 0.0)
    assert page.locator(".drives li").count() == 1
    assert page.locator("img").count() == 0


def test_scenarios_are_chosen_by_class_and_two_drives_of_them(visit, drives, tmp_path):
    three = [ShownDrive(f"driver {k}", drives["several"][0].episode) for k in range(3)]
    kinds = ("worst of each controller", "clean", "clean", "wind")
    groups = [RoadGroup(f"road {k}", three, 1.5, kind=kind) for k, kind in enumerate(kinds)]
    page = visit(write_article([Section("First")], tmp_path / "r.html", "t", replay=groups), PHONE)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    part(page, "kind").select_option("clean")
    assert part(page, "road").locator("option").all_inner_texts() == ["road 1", "road 2"]
    assert state(page, "group") == "1"

    def shown():
        return page.locator(".drives .chip[aria-pressed=true] .name").all_inner_texts()

    assert shown() == ["driver 0", "driver 1"]
    part(page, "one").select_option(label="driver 2")
    assert shown() == ["driver 1", "driver 2"]
    part(page, "kind").select_option("wind")  # the same two drive here
    assert (state(page, "group"), shown()) == ("3", ["driver 1", "driver 2"])
    page.keyboard.press("Escape")
    page.keyboard.press(" ")
    begun = time.monotonic()
    while cursor(page) < 0.2:
        assert time.monotonic() < begun + 20.0


def test_everything_that_can_be_operated_has_a_name_and_a_place_in_the_order(visit):
    page = visit("several")
    unnamed = page.evaluate("""() => {
      const named = (node) => node.getAttribute("aria-label")
        || (node.tagName === "BUTTON" && node.textContent.trim())
        || (node.closest("label") && node.closest("label").textContent.trim());
      const all = [...document.querySelectorAll("button, select, input")];
      return all.filter((node) => !named(node)).map((node) => node.outerHTML);
    }""")
    assert unnamed == []
    assert page.evaluate("document.querySelector('.map').tabIndex") == 0
