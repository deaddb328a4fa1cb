"""The live page: refused to strangers, drives at each change, keeps what is driven by hand."""

import json
import os
import shlex
import shutil
import socket
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest

from steersman.commands import configuration
from steersman.config import build
from steersman.episode import load_episode
from steersman.learning.config import TrainConfig, load_preset
from steersman.learning.running import TrainingState
from steersman.live.drives import DriveCache, LiveRun
from steersman.live.form import Choices, ChosenPart, chosen, form
from steersman.live.page import LiveAddress
from steersman.live.relay import Relay
from steersman.live.server import reachable
from steersman.live.training import FollowedTraining, TrainingRequest
from steersman.policy_file import locate
from steersman.report import seen
from steersman.rollout import attempt

TOKEN = "tested"
BASE = configuration("drive", ["pid"], {"path": "circle", "duration": 5})


@contextmanager
def serving(port, folder, training=None, base=BASE):
    uvicorn = pytest.importorskip("uvicorn", reason="the extra live has uvicorn")
    server = pytest.importorskip("steersman.live.server")
    address = LiveAddress(port, TOKEN)
    app = server.live_app(base, address, str(folder), training)
    config = uvicorn.Config(
        app, host=server.HOST, port=port, log_level="error", ws="none", lifespan="off"
    )
    running = uvicorn.Server(config)
    thread = threading.Thread(target=running.run, daemon=True)
    thread.start()
    while not running.started:
        assert thread.is_alive()
        time.sleep(0.01)
    try:
        yield address
    finally:
        running.should_exit = running.force_exit = True
        thread.join(10.0)


@pytest.fixture(scope="module")
def port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def address(port, tmp_path):
    with serving(port, tmp_path) as found:
        yield found


def ask(address, place, body=None, **headers):
    """Status and text of an answer."""
    data = None if body is None else json.dumps(body).encode()
    url = f"http://127.0.0.1:{address.port}{place}"
    try:
        with urllib.request.urlopen(urllib.request.Request(url, data, headers)) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def test_strangers_are_refused(address):
    good, own = {"x-steersman-token": TOKEN}, f"http://127.0.0.1:{address.port}"
    assert ask(address, f"/?token={TOKEN}")[0] == 200
    assert ask(address, "/alive", Origin=own, **good)[0] == 200
    for place, headers in (
        ("/", {}),
        ("/?token=guess", {}),
        ("/alive", good | {"Origin": "http://evil.example"}),
        ("/alive", good | {"Origin": "null"}),
        ("/alive", good | {"Host": f"evil.example:{address.port}"}),
    ):
        status, text = ask(address, place, **headers)
        assert (status, text.partition(":")[0]) == (403, "refused"), (place, headers)
    assert ask(address, "/drive", [])[0] == 403


def test_mistakes_are_one_line(address):
    run = {"name": "now", "choices": {"parts": {"path": {"word": "cirle"}}}}
    for body, words in (
        ([run], "did you mean 'circle'?"),
        ([{"name": 1}], "0.name: Input should be a valid string"),
        ([], "runs: none is given"),
        ([{"name": "x", "choices": {"settings": {"duration": 1e6}}}], "drives up to 600 [s]"),
    ):
        status, text = ask(address, "/drive", body, **{"x-steersman-token": TOKEN})
        assert status == 422
        assert words in json.loads(text)["error"]


def test_a_map_drives_disturbed(address):
    parts = {"speed": {"word": "constant_speed", "fields": {"speed": 12.0}}}
    given = {"choices": {"parts": parts}, "x": "delay", "y": "mass", "points": [[0, 0], [1, 1]]}
    token = {"x-steersman-token": TOKEN}
    status, text = ask(address, "/map", given, **token)
    calm, rough = json.loads(text)["cells"]
    assert (status, calm["words"], calm["failed"]) == (200, "delay 0 s, mass 1", False)
    assert (rough["words"], rough["failed"]) == ("delay 0.5 s, mass 1.5", True)
    for wrong, words in (
        ({"x": "masss"}, "did you mean 'mass'?"),
        ({"y": "delay"}, "y: delay is x already"),
        ({"points": [[2, 0]]}, "points.0.0: Input should be less than or equal to 1"),
    ):
        status, text = ask(address, "/map", given | wrong, **token)
        assert status == 422
        assert words in json.loads(text)["error"]


NEWEST = "Drive the newest policy"
STATES = "() => document.getElementById('states').textContent"


def test_a_training_is_followed(browser, port, tmp_path):
    runs, ask = tmp_path / "runs", "() => document.querySelector('#training .legend').textContent"

    def record(seed, count):
        (runs / f"seed_{seed}").mkdir(parents=True, exist_ok=True)
        lines = [f"{k},{100 / (k + seed + 1)}" for k in range(count)]
        text = "\n".join(["steps,validation_error_mm", *lines]) + "\n"
        (runs / f"seed_{seed}" / "progress.csv").write_text(text)

    record(0, 1)
    with serving(port, tmp_path, runs) as address:
        page = browser.new_page()
        page.goto(address.url)
        until(page, f"() => ({ask})().includes('seed_0')")
        assert page.locator("#newest").is_disabled()
        # Paused and stopped by the page's buttons; alarms; the newest validation drive.
        run, asked = runs / "seed_0", runs / "seed_0" / "request"
        state = TrainingState(state="running", steps=10, total=99, alarms=("shaky",))
        (run / "state.json").write_text(state.model_dump_json())
        attempt(BASE).episode.save(run / "validation.npz")
        until(page, f"() => ({STATES})() === 'seed_0: running, 10 of 99 steps⚠ shaky'")
        for button, request in (("Pause", "pause"), ("Stop", "stop")):
            page.get_by_role("button", name=button, exact=True).click()
            until(page, lambda word=request: asked.is_file() and asked.read_text() == word)
        assert page.get_by_role("button", name="Go on").is_disabled()
        ended = state.model_copy(update={"state": "ended", "steps": 99})
        (run / "state.json").write_text(ended.model_dump_json())
        until(page, "() => document.querySelector('[data-ask=stop]').hidden")
        assert page.locator("#training button:visible").all_inner_texts()[-1] == NEWEST
        page.check("#validations")
        until(page, "() => document.querySelector('#figures').textContent.includes('seed_0')")
        record(1, 3)
        for suffix in (".onnx", ".json"):
            shutil.copy(locate("precision").with_suffix(suffix), runs / f"policy{suffix}")
        until(page, f"() => ({ask})().includes('median and range of 2 seeds')")
        assert page.locator("#training canvas").count() == 1
        page.click("#newest")
        until(page, "() => document.getElementById('command').textContent.includes('policy.onnx')")
        page.close()


def test_a_training_alone_has_its_folders_name(tmp_path):
    run = tmp_path / "mine"
    run.mkdir()
    (run / "progress.csv").write_text("steps,validation_error_mm\n1,100\n")
    (run / "state.json").write_text(
        TrainingState(state="ended", steps=9, total=9).model_dump_json()
    )
    attempt(BASE).episode.save(run / "validation.npz")
    found = FollowedTraining(run).answer(TrainingRequest(drive=0.0))
    assert [one["name"] for one in found["training"]["runs"]] == ["mine"]
    assert [one["words"] for one in found["states"]] == ["mine: ended, 9 of 9 steps"]
    assert found["drive"]["figures"]["runs"] == ["validation of mine"]


def test_a_person_demonstrates_to_a_training(browser, port, tmp_path):
    question = {"drive": 0, "dt": 0.05, "executed": None, "heading_error": 0.0, "yaw_rate": 0.0,
                "v_x": 8.0, "v_y": 0.0, "lateral_error": 0.1, "steer": 0.0, "curvature": 0.0,
                "spacing": 2.0, "preview": [[2.0 * k, 0.0] for k in range(20)]}  # fmt: skip
    asked = Relay(tmp_path)
    assert asked.answer("{}") is None  # there is no server yet
    with serving(port, tmp_path, tmp_path / "runs") as address, reachable(address, tmp_path):
        assert (tmp_path / "address.json").stat().st_mode & 0o077 == 0
        page = browser.new_page()
        page.goto(address.url)
        until(page, "() => Boolean(window.steersman)")
        steers, times, going = [], [], threading.Event()

        def training():
            while not going.is_set():
                line = json.dumps(question | {"time": 0.05 * len(times)})
                steers.append(asked.answer(line))
                times.append(time.monotonic())
                time.sleep(0.0 if steers[-1] is not None else 0.01)

        thread = threading.Thread(target=training)
        thread.start()
        try:
            page.click("#demonstrate")
            until(page, lambda: "the agent drives" in page.text_content("#hand-values"))
            assert set(steers) == {None}
            page.keyboard.down("ArrowRight")
            until(page, lambda: (steers[-1] or 0.0) < -0.02)
            until(page, lambda: "you demonstrate" in page.text_content("#hand-values"))
            first, count = times[-1], len(times)
            until(page, lambda: len(times) > count + 10)
            assert times[count + 10] - first > 0.45  # in real time, 0.05 s a step
            page.keyboard.up("ArrowRight")
            until(page, lambda: steers[-1] is None)
            page.keyboard.press("Escape")
            until(page, "() => document.getElementById('hand').hidden")
        finally:
            going.set()
            thread.join(10.0)
        page.close()
    assert not (tmp_path / "address.json").exists()
    config = build(TrainConfig, load_preset("by_hand"))
    assert config.problem.demonstration.controller.command[-2:] == (Relay.__module__, "runs/live")
    assert config.agent.vehicles == 1


def test_a_file_that_changes_is_driven_again(tmp_path):
    file, cache = tmp_path / "road.csv", DriveCache(BASE)
    run = LiveRun(name="now", choices=Choices(parts={"path": ChosenPart(word=str(file))}))
    ends = []
    for length in (30, 60):
        file.write_text("x,y\n" + "".join(f"{x},0\n" for x in range(length)))
        os.utime(file, (length, length))
        answer = cache.answer([run])
        assert cache.answer([run])["figures"] == answer["figures"]
        ends.append(answer["figures"]["rows"][0]["cells"][0]["text"])
    assert ends == ["end of path", "duration"]


def test_choices_are_the_configuration():
    first = chosen(BASE)
    assert first.config(BASE) == BASE
    assert first.command() == (
        "steersman drive controller=pid path=circle speed=constant_throttle "
        "vehicle=carla_model3 sensor=waypoints plant=simulator duration=5.0"
    )
    noise = ChosenPart(word="sensor_bias", fields={"heading": 0.01})
    parts = {"controller": ChosenPart(word="tuned/lqr", fields={"q_lateral": 0.5})}
    more = Choices(parts=parts, disturbances=[noise])
    config = more.config(BASE)
    assert (config.controller.kind, config.controller.q_lateral) == ("lqr", 0.5)
    assert [(one.kind, one.heading) for one in config.disturbances] == [("sensor_bias", 0.01)]
    assert "controller=tuned/lqr controller.q_lateral=0.5" in more.command()
    own = configuration("drive", ["tuned/pid", "path=figure_eight", "path.radius=30"])
    assert chosen(own).config(BASE).controller == own.controller
    assert chosen(own).parts["controller"] == ChosenPart(word="tuned/pid")
    words = shlex.split(more.command())[2:]
    assert configuration("drive", words) == config.model_copy(update={"duration": None})


def test_the_command_is_one_for_a_shell_with_a_car_of_a_file_too(tmp_path):
    (tmp_path / "my car.yaml").write_text("base: bmw_320i\nmass: 1500\n")
    own = configuration("drive", [f"vehicle={tmp_path / 'my car.yaml'}"])
    words = shlex.split(chosen(own).command())[2:]
    assert configuration("drive", words).vehicle.model_dump(exclude={"kind", "file"}) == (
        own.vehicle.model_dump(exclude={"kind", "file"})
    )


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A drive of the user's own car, road and gains."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "van.yaml").write_text("base: vw_t7\nmass: 2310\n")
    (tmp_path / "Spa.csv").write_text("x_m,y_m\n" + "".join(f"{x},0\n" for x in range(200)))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "tuned.yaml").write_text("controller: {kind: lqr, q_lateral: 3.0}\n")
    words = ["vehicle=van.yaml", "path=Spa.csv", "estimated/mine", "duration=2"]
    return configuration("drive", words)


def test_ones_own_files_are_offered_with_their_fields(own):
    found, first = form(own), chosen(own)
    assert {"path": "Spa", "controller": "estimated/mine"}.items() <= found["labels"].items()
    for family, part in first.parts.items():
        fields = {field["name"]: field for field in found["families"][family][part.word]}
        assert not part.fields
        assert Choices(parts={family: part}).config(own) == own
        if family == "vehicle":
            assert fields["mass"]["default"] == 2310.0
            assert {"c_f", "friction", "steer_delay"} <= set(fields)
        if family == "path":
            assert "spacing" in fields
    assert {"steering_delay", "wind.speed"} <= {
        field["name"] for field in found["families"]["plant"]["simulator"]
    }
    beside = configuration("drive", [own, "path=csv", "path.file=Spa.csv"])
    assert chosen(beside).parts["path"].word == "Spa.csv"


def test_the_page_says_what_the_command_line_says(own):
    odd = ChosenPart(word="van.yaml", fields={"mass": 1.8})
    run = LiveRun(name="now", choices=Choices(parts={"vehicle": odd}))
    (line,) = DriveCache(own).answer([run])["hints"]
    assert line.startswith("vehicle: yaw_inertia / (mass l_f l_r) is")
    fast = ChosenPart(word="constant_speed", fields={"speed": 50.0})
    bend = {"speed": fast, "path": ChosenPart(word="circle")}
    run = LiveRun(name="now", choices=Choices(parts=bend, settings={"duration": 20.0}))
    assert any("the car holds" in line for line in DriveCache(BASE).answer([run])["hints"])


def test_what_the_page_began_with_comes_back(browser, port, tmp_path, own):
    with serving(port, tmp_path, base=own) as address:
        page = browser.new_page()
        page.goto(address.url)
        until(page, "() => Boolean(document.getElementById('took').textContent)")
        began = page.text_content("#yaml")
        for family, other in (("vehicle", "bmw_320i"), ("controller", "lqr"), ("path", "straight")):
            select = page.locator(f"select[name={family}]")
            mine = select.input_value()
            select.select_option(other)
            until(page, lambda: page.text_content("#yaml") != began)
            select.select_option(mine)
            until(page, lambda: page.text_content("#yaml") == began)
        assert page.text_content("#notice") == ""
        assert page.locator("select[name=vehicle] option").first.inner_text() == "van.yaml"
        page.close()


def test_every_word_of_the_form_can_be_driven():
    found = form()
    assert {"lqr", "tuned/lqr"} <= set(found["families"]["controller"])
    for family, words in found["families"].items():
        for word, fields in words.items():
            assert getattr(Choices(parts={family: ChosenPart(word=word)}).config(BASE), family)
            for field in fields:
                low, high = field.get("low", 0.0), field.get("high", 1.0)
                assert low < high, (word, field)
    json.dumps(found, allow_nan=False)
    assert build(type(BASE), {}) is not None


def until(page, words, arg=None):
    begun = time.monotonic()
    while not (words() if callable(words) else page.evaluate(words, arg)):
        assert time.monotonic() < begun + 20.0, (words, page.text_content("#notice"))
        page.wait_for_timeout(20)


FIRST_TO_LAST = ("pin", "figures", "choose", "replay", "failures")
# Whether the upper and the lower end of the driver's view have the road's colour.
ROAD_SHARES = """() => {
  const canvas = document.getElementById('view');
  const context = canvas.getContext('2d');
  context.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--road');
  const road = [1, 3, 5].map((k) => parseInt(context.fillStyle.slice(k, k + 2), 16));
  const all = context.getImageData(0, 0, canvas.width, canvas.height).data;
  return [0.3, 0.98].map((share) => {
    const from = 4 * canvas.width * Math.round(share * (canvas.height - 1));
    const row = all.subarray(from, from + 4 * canvas.width);
    const same = (i) => road.every((value, k) => Math.abs(row[i + k] - value) < 3);
    return row.filter((_, i) => i % 4 === 0 && same(i)).length > 20;
  });
}"""
FIGURES = "() => document.querySelector('#figures tbody').textContent"


def slide(page, name, share):
    before = page.evaluate(FIGURES)
    page.locator(f"input[type=range][aria-label='{name}']").evaluate(
        "(node, share) => { node.value = Number(node.min) + share * (node.max - node.min);"
        " node.dispatchEvent(new Event('input')); }",
        share,
    )
    until(page, f"(before) => ({FIGURES})() !== before", before)


def by_hand(page, folder):
    """With keys, then with a game pad; what was driven is an episode to learn from."""
    page.click("#wheel")
    page.keyboard.down("ArrowRight")
    until(page, "() => parseFloat(document.getElementById('hand-values').textContent) > 0.5")
    assert page.evaluate(ROAD_SHARES) == [True, True]  # ahead of the car and behind it
    page.keyboard.up("ArrowRight")
    page.keyboard.press("Escape")
    until(page, "() => document.getElementById('kept').textContent.includes('hand_1')")
    episode = load_episode(folder / "hand_1" / "episode.npz")
    assert episode.end in {"interrupted", "off_track"}
    assert episode["steer_command"].min() < -0.02  # to the right
    assert len(episode) >= 10
    assert "By hand: stopped by you, after " in page.text_content("#kept")
    until(page, "() => document.getElementById('figures').textContent.includes('stopped by you')")
    assert page.locator("#pin").is_disabled()  # it would keep another drive than the one shown
    # With a game pad, until the car has left the road.
    page.evaluate("navigator.getGamepads = () => [null, { axes: [-0.9, 0], buttons: [] }]")
    page.click("#wheel")
    until(page, lambda: "game pad" in page.text_content("#hand-values"))
    until(page, "() => document.getElementById('kept').textContent.includes('hand_2')")
    assert "By hand: you left the road, after " in page.text_content("#kept")
    episode = load_episode(folder / "hand_2" / "episode.npz")
    assert episode["steer_command"].max() > 0.05  # to the left
    assert episode.end == "off_track"


def test_in_a_browser(browser, port, tmp_path):
    faults = []
    seen.waypoints(attempt(BASE).episode, BASE.path)  # compiles, which no page has to wait for

    def tab():
        page = browser.new_context(viewport={"width": 390, "height": 844}).new_page()
        page.on("pageerror", lambda e: faults.append(str(e)))
        page.on("console", lambda m: faults.append(m.text))
        page.goto(address.url)
        until(page, "() => Boolean(document.getElementById('took').textContent)")
        tops = [page.locator(f"#{name}").bounding_box()["y"] for name in FIRST_TO_LAST]
        assert tops == sorted(tops)  # the form beneath the figures, above the replay
        page.locator("#choose > summary").click()
        return page

    with serving(port, tmp_path) as address:
        page, other = tab(), tab()
        assert page.text_content("#figures thead") == "figurenow"
        slide(page, "controller.gains.k_p", 0.9)
        assert page.text_content("#figures thead") == "figurenowbefore"
        assert "controller.gains.k_p=" in page.text_content("#command")
        page.click("#pin")
        until(page, "() => document.querySelector('#figures thead').textContent.includes('pinned')")
        assert "pinned: gains.k_p=" in page.text_content("#figures thead")
        page.click("#pin")  # it is there
        assert page.text_content("#figures thead").count("pinned") == 1
        assert other.text_content("#figures thead") == "figurenow"
        slide(other, "controller.k_heading", 0.5)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        # A map over two disturbances fills, until something is changed.
        page.locator("#failures summary").click()
        page.click("#fill")
        until(page, "() => document.getElementById('filled').textContent !== ''")
        assert "mass" in page.locator("#cells span").nth(0).get_attribute("title")
        assert page.locator("#ends-x span").all_inner_texts() == ["delay 0 s", "0.25 s", "0.5 s"]
        assert page.locator("#ends-y span").all_inner_texts() == ["mass 0.5", "1", "1.5"]
        slide(page, "controller.gains.k_p", 0.2)
        assert page.text_content("#filled") == ""
        by_hand(page, tmp_path)
        assert faults == []
    # The server is gone, and comes back: the page goes on where it was.
    other.locator("select[name=path]").select_option("straight")
    until(other, "() => document.getElementById('notice').textContent.includes('Start it again')")
    with serving(port, tmp_path):
        until(other, "() => document.getElementById('notice').hidden")
        until(other, "() => document.getElementById('command').textContent.includes('straight')")
    assert all("ERR_CONNECTION" in fault for fault in faults)
    for each in (page, other):
        each.context.close()
