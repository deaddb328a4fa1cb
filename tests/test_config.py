import math
import subprocess
import sys
from collections.abc import Iterator
from datetime import date
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from pydantic import ValidationError, field_validator

from steersman import core_yaml, registry
from steersman.config import (
    Component,
    Of,
    Settings,
    build,
    components,
    dump,
    families,
    field_unit,
    lookup,
    merge,
    override,
    param,
    read_yaml,
    register,
    required,
    resolve,
    to_yaml,
)
from steersman.errors import ConfigError, DataError


class Gains(Settings):
    kp: float = param(1.0, "1/m", "proportional gain", ge=0)
    ki: float = param(0.0, "1/(m s)", "integral gain")


@register("widget", "plain")
class Plain(Component):
    radius: float = param(50.0, "m", "radius", gt=0)
    turns: int = param(1, "-", "number of turns", ge=1, le=9)
    flag: bool = param(False, "-", "whether")
    mode: Literal["on", "off", "auto"] = param("auto", "-", "mode of operation")
    label: str = param("", "-", "any text")
    file: FilePath | None = param(None, "-", "a file")
    weights: tuple[float, ...] = param((1.0, 2.0), "-", "weights", max_length=5)
    gains: Gains = param(Gains(), "-", "gains of the feedback")
    by_name: dict[str, Gains] = param({}, "-", "gains by name")
    limit: float | Literal["none"] = param("none", "m/s", "limit")
    unlimited: float = param(math.inf, "s", "may be infinite", allow_inf_nan=True)


@register("widget", "outer")
class Outer(Component):
    length: float = required("m", "length of the outer one", gt=0)
    inner: Annotated[Any, Of("widget")] = param("plain", "-", "the inner one")
    spare: Annotated[Any, Of("widget", optional=True)] = param(None, "-", "another, or none")
    several: tuple[Annotated[Any, Of("widget")], ...] = param((), "-", "some more")


@register("widget", "strict_author")
class StrictAuthor(Component):
    even: int = param(2, "-", "an even number")

    @field_validator("even")
    @classmethod
    def _even(cls, value: int) -> int:
        if value % 2:
            raise ValueError("needs an even number")
        return value


class Run(Settings):
    duration: float = param(60.0, "s", "how long to drive", gt=0)
    widget: Annotated[Any, Of("widget")] = param("plain", "-", "what is driven")
    seeds: str = param("0", "-", "seeds")


def complaint(data: dict[str, Any], cls: type[Settings] = Run) -> str:
    with pytest.raises(ConfigError) as caught:
        build(cls, data)
    message = str(caught.value)
    assert "\n" not in message
    return message


# ------------------------------------------------------------------------------- messages


@pytest.mark.parametrize(
    ("assignments", "expected"),
    [
        (["duraton=3"], "duraton: unknown field; did you mean 'duration'?"),
        (["kp=3"], "kp: unknown field; allowed: duration, seeds, widget"),
        (["widget.kp=3"], "widget.kp: unknown field of plain; did you mean 'gains.kp'?"),
        (
            ["widget={kind: outer, length: 1, widget: plain}"],
            "widget.widget: unknown field of outer; did you mean 'inner'?",
        ),
        (["widget=plan"], "widget: unknown widget 'plan'; did you mean 'plain'?"),
        (["widget.radus=3"], "widget.radus: unknown field of plain; did you mean 'radius'?"),
        (["widget.gains.kpp=3"], "widget.gains.kpp: unknown field; did you mean 'kp'?"),
        (["widget.radius=-3"], "widget.radius: -3 is not allowed; must be greater than 0 [m]"),
        (["widget.turns=10"], "widget.turns: 10 is not allowed; must be at most 9"),
        (["widget.turns=1.5"], "widget.turns: 1.5 is not a whole number"),
        (
            ["widget.radius=50m"],
            "widget.radius: '50m' is not a number; the unit is m, write e.g. 50",
        ),
        (
            ["widget.radius=50 km"],
            "widget.radius: '50 km' is not a number; the unit is m, write the value in m",
        ),
        (["widget.radius=wide"], "widget.radius: 'wide' is not a number; the unit is m"),
        (["widget.radius=true"], "widget.radius: True is not a number; the unit is m"),
        (["widget.turns=true"], "widget.turns: True is not a whole number"),
        (["widget.weights=[1, false]"], "widget.weights: [1, False] is not a number"),
        (["widget.weights=[1, x]"], "widget.weights[1]: 'x' is not a number"),
        (["widget.weights=5"], "widget.weights: 5 is not a list"),
        (
            ["widget.weights=[1, 2, 3, 4, 5, 6]"],
            "widget.weights: [1, 2, 3, 4, 5, 6] is not allowed; must have at most 5 values",
        ),
        (["widget.radius=.nan"], "widget.radius: nan is not allowed; must be finite [m]"),
        (["widget.radius=.inf"], "widget.radius: inf is not allowed; must be finite [m]"),
        (["widget.flag=perhaps"], "widget.flag: 'perhaps' is not true or false"),
        (["widget.mode=of"], "widget.mode: 'of' is not allowed; must be 'on', 'off' or 'auto'"),
        (["widget.label=12"], "widget.label: 12 is not text; put it in quotes: '12'"),
        (["widget.label=true"], "widget.label: True is not text; put it in quotes: 'True'"),
        (["widget.label=[1]"], "widget.label: [1] is not text"),
        (
            ["widget.gains=3"],
            "widget.gains: 3 is not a set of key: value pairs",
        ),
        (
            ["widget.gains.kp=-1"],
            "widget.gains.kp: -1 is not allowed; must be at least 0 [1/m]",
        ),
        (
            ["widget.by_name.left.kp=-1"],
            "widget.by_name.left.kp: -1 is not allowed; must be at least 0 [1/m]",
        ),
        (["widget.limit=fast"], "widget.limit: 'fast' is not a number; the unit is m/s"),
        (
            ["widget=outer"],
            "widget.length: required, but not given: length of the outer one [m]",
        ),
        (
            ["widget=outer", "widget.length=1", "widget.inner.gains.kp=x"],
            "widget.inner.gains.kp: 'x' is not a number; the unit is 1/m",
        ),
        (
            ["widget=outer", "widget.length=1", "widget.several=[plain, {kind: plain, radus: 1}]"],
            "widget.several[1].radus: unknown field of plain; did you mean 'radius'?",
        ),
        (["widget=strict_author", "widget.even=3"], "widget.even: needs an even number"),
        (
            ["widget=outer", "widget.lenght=3"],
            "widget.lenght: unknown field of outer; did you mean 'length'? "
            "(also at fault: length)",
        ),
        (["duration=0", "seeds=1"], "duration: 0 is not allowed; must be greater than 0 [s]"
         " (also at fault: seeds)"),
        (
            ["widget=[1]"],
            "widget: a widget is a name, or fields among them 'kind'; given [1];"
            " names: outer, plain, strict_author",
        ),
    ],
)  # fmt: skip
def test_a_fault_is_told_in_one_line(assignments: list[str], expected: str) -> None:
    tree = dump(Run())
    assert tree is not None
    assert complaint(override(tree, assignments)) == expected


class Dated(Settings):
    day: date = param(date(2026, 1, 2), "-", "a type that has no wording of its own")


def test_any_other_fault_is_told_in_the_words_of_the_validator() -> None:
    message = complaint({"day": "soon"}, Dated)
    assert message.startswith("day: 'soon' is not allowed; input should be a valid date")


def test_long_values_and_line_breaks_do_not_spread() -> None:
    message = complaint({"duration": "x\ny" * 1000})
    assert len(message) < 120


def test_the_full_path_is_kept_however_deep() -> None:
    tree: dict[str, Any] = {"kind": "plain", "radius": 0}
    for _ in range(3):
        tree = {"kind": "outer", "length": 1, "inner": tree}
    assert complaint({"widget": tree}).startswith("widget.inner.inner.inner.radius: 0 is not")


@given(st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
))  # fmt: skip
def test_no_value_gets_past_validation_other_than_as_a_config_error(value: Any) -> None:
    for cls in (Run, Plain, Outer, Gains):
        for name in cls.model_fields:
            try:
                build(cls, {name: value})
                message = "accepted"
            except ConfigError as error:
                message = str(error)
            assert len(message.splitlines()) == 1


# --------------------------------------------------------------------------- declarations


def test_constructors_refuse_what_files_may_not_hold() -> None:
    with pytest.raises(ValidationError):
        Plain(radius=True)
    with pytest.raises(ValidationError):
        Plain(radius=math.nan)
    assert Plain(unlimited=math.inf).unlimited == math.inf


def test_a_component_is_frozen() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Plain().radius = 3.0  # type: ignore[misc]


def test_unit_of_a_field() -> None:
    assert field_unit(Plain.model_fields["radius"]) == "m"
    assert field_unit(Plain.model_fields["label"]) == "-"
    assert field_unit(None) == "-"


def test_a_kind_cannot_be_declared_twice() -> None:
    class Impostor(Component):
        pass

    with pytest.raises(ConfigError, match="widget 'plain' is declared twice"):
        register("widget", "plain")(Impostor)
    assert Impostor.kind == ""
    assert register("widget", "plain")(Plain) is Plain


# In a process of its own, where nothing of the family is imported yet.
_NAMED_LIKE_OURS = """
import steersman as sm
for family, kind in (("controller", "lqr"), ("path", "circle"), ("reward", "progress")):
    base = sm.Controller if family == "controller" else sm.Component
    try:
        sm.register(family, kind)(type("Mine", (base,), {"__module__": "__main__"}))
    except sm.ConfigError as error:
        print(error)
assert type(sm.make("controller", "lqr")).__name__ == "Lqr"  # the session goes on
"""


def test_a_name_of_the_package_is_refused_at_once() -> None:
    result = subprocess.run(
        [sys.executable, "-c", _NAMED_LIKE_OURS], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0] == (
        "controller 'lqr' is steersman.controllers.lqr.Lqr of the package; give yours another name"
    )
    assert [line.partition(" is ")[2].partition(";")[0] for line in lines[1:]] == [
        "steersman.paths.analytic.Circle of the package",
        "steersman.learning.rewards.Progress of the package",
    ]


def test_lookup_and_listing() -> None:
    assert lookup("widget", "plain") is Plain
    assert list(components("widget")) == ["outer", "plain", "strict_author"]
    assert {"path", "controller", "widget"} <= set(families())
    with pytest.raises(ConfigError, match="unknown kind of component 'widgt'; did you mean 'wid"):
        components("widgt")
    with pytest.raises(ConfigError, match="unknown widget 'plainn'; did you mean 'plain'"):
        lookup("widget", "plainn")


class FakeEntryPoint:
    name, value = "gadget.mine", "mine:Gadget"

    def __init__(self, fails: bool) -> None:
        self.fails = fails

    def load(self) -> None:
        if self.fails:
            raise ImportError("no module named mine")

        @register("gadget", "mine")
        class Gadget(Component):
            pass


def test_entry_points_of_other_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry._REGISTRY, "gadget", {})
    points = [FakeEntryPoint(fails=True)]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    with pytest.raises(ConfigError, match=r"gadget\.mine = mine:Gadget cannot be loaded: no mod"):
        components("gadget")
    points[:] = [FakeEntryPoint(fails=False)]
    assert list(components("gadget")) == ["mine"]


def test_resolve_takes_a_name_a_mapping_or_the_component() -> None:
    assert resolve("widget", "plain") == Plain()
    assert resolve("widget", {"kind": "plain", "radius": 3}) == Plain(radius=3.0)
    assert resolve("widget", Plain(turns=2)) == Plain(turns=2)
    assert resolve("widget", None, optional=True) is None
    with pytest.raises(ConfigError, match="a widget is a name"):
        resolve("widget", None)
    with pytest.raises(ConfigError, match="a widget was given where a path is expected"):
        resolve("path", Plain())
    with pytest.raises(ConfigError, match="a Component was given where a path is expected"):
        resolve("path", Component())


class Holder(Settings):
    widget: Annotated[Any, Of("widget")] = param(Plain(radius=7, turns=3), "-", "with defaults")
    named: Annotated[Any, Of("widget")] = param("plain", "-", "a default by name")
    gains: Gains = param(Gains(kp=4, ki=5), "-", "gains with other defaults than their class")


def test_fields_of_a_group_keep_the_defaults_of_the_others() -> None:
    holder = build(Holder, {"widget": {"turns": 2}, "named": {"radius": 3}, "gains": {"kp": 1}})
    assert holder.widget == Plain(radius=7.0, turns=2)
    assert holder.named == Plain(radius=3.0)
    assert holder.gains == Gains(kp=1, ki=5)
    assert build(Holder, {"widget": {"kind": "plain"}}).widget == Plain()


# ----------------------------------------------------------------------------- round trips

numbers = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=1e-300, allow_infinity=False)
gains = st.builds(Gains, kp=st.floats(0, 1e300), ki=numbers)
plains = st.builds(
    Plain,
    radius=positive,
    turns=st.integers(1, 9),
    flag=st.booleans(),
    mode=st.sampled_from(["on", "off", "auto"]),
    label=st.text(st.characters(codec="utf-8")),
    file=st.none() | st.just(FilePath("some/folder/file.csv")),
    weights=st.lists(numbers, max_size=5).map(tuple),
    gains=gains,
    by_name=st.dictionaries(st.text(st.characters(codec="utf-8")), gains, max_size=2),
    limit=st.just("none") | numbers,
    unlimited=positive | st.just(math.inf),
)
widgets = st.recursive(
    plains,
    lambda inner: st.builds(
        Outer,
        length=positive,
        inner=inner,
        spare=st.none() | inner,
        several=st.lists(inner, max_size=2).map(tuple),
    ),
    max_leaves=3,
)


@given(widgets)
def test_resolve_of_dump_is_the_same(widget: Component) -> None:
    assert resolve("widget", dump(widget)) == widget


@given(widgets)
@example(Outer(length=1, spare=Plain(label="\x85")))
@example(Plain(label="a  \n b\u2028\ufeff#: 'x\"", by_name={"1e3": Gains(), "no": Gains()}))
def test_yaml_gives_back_the_same(widget: Component) -> None:
    run = Run(widget=widget)
    assert build(Run, core_yaml.load(to_yaml(run))) == run


def test_dump_of_nothing() -> None:
    assert dump(None) is None


# --------------------------------------------------------------------- merge and override

words = st.text("abcd", min_size=1, max_size=2)
scalars = st.integers() | st.booleans() | st.none()
trees = st.dictionaries(
    words,
    st.recursive(scalars, lambda inner: st.dictionaries(words, inner, max_size=3), max_leaves=5),
    max_size=3,
)


@given(trees, trees)
def test_merging_twice_is_merging_once(base: dict[str, Any], change: dict[str, Any]) -> None:
    try:
        once = merge(base, change)
    except ConfigError:  # fields over a number, which would be lost
        return
    assert merge(once, change) == once
    assert merge(base, {}) == base
    assert set(once) == set(base) | set(change)


@given(trees, st.lists(words, min_size=1, max_size=3), st.integers())
def test_what_is_assigned_is_there_and_the_rest_stays(
    tree: dict[str, Any], keys: list[str], value: int
) -> None:
    before = repr(tree)
    try:
        out = override(tree, [f"{'.'.join(keys)}={value}"])
    except ConfigError:  # fields over a number, which would be lost
        return
    assert repr(tree) == before
    assert {k: v for k, v in out.items() if k != keys[0]} == {
        k: v for k, v in tree.items() if k != keys[0]
    }
    found: Any = out
    for key in keys:
        found = found[key]
    assert found == value


def test_naming_a_component_replaces_its_whole_subtree() -> None:
    tree = {"widget": {"kind": "plain", "radius": 3}}
    for text in ("widget=outer", "widget.kind=outer", "widget={kind: outer}"):
        assert resolve("widget", override(tree, [text, "widget.length=2"])["widget"]) == Outer(
            length=2.0
        )


def test_assignments_count_in_their_order() -> None:
    tree = {"widget": "plain"}
    assert override(tree, ["widget.radius=3", "widget=plain"]) == {"widget": "plain"}
    assert override(tree, ["widget=plain", "widget.radius=3", "widget.radius=4"]) == {
        "widget": {"kind": "plain", "radius": 4}
    }
    assert override(tree, ["widget.gains.kp=2", "widget.gains.ki=1"]) == {
        "widget": {"kind": "plain", "gains": {"kp": 2, "ki": 1}}
    }


@pytest.mark.parametrize("text", ["widget", "=3", "a..b=3", ".a=3", "a.=3", ""])
def test_what_is_no_assignment(text: str) -> None:
    with pytest.raises(ConfigError, match="is not an assignment; write key=value"):
        override({}, [text])


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        ("1e-3", 0.001),
        ("1e5", 100000.0),
        ("-.5", -0.5),
        ("010", 10),
        ("0x10", 16),
        ("0..4", "0..4"),
        ("0:4", "0:4"),
        ("1_000", "1_000"),
        ("2026-01-01", "2026-01-01"),
        ("true", True),
        ("yes", "yes"),
        ("null", None),
        ("", None),
        ("[1, 2e0, no]", [1, 2.0, "no"]),
        ("{a: 1}", {"a": 1}),
        ("'12'", "12"),
        ("[1", "[1"),
        ("a: b", "a: b"),
        ("runs/a #1", "runs/a #1"),
        ("a=b", "a=b"),
        ("<<", "<<"),
        ("!!python/object:os.system", "!!python/object:os.system"),
    ],
)
def test_value_of_an_assignment(raw: str, expected: Any) -> None:
    found = override({}, [f"key={raw}"])["key"]
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(("word", "flag"), [("yes", True), ("off", False), ("true", True)])
def test_words_for_booleans_count_where_a_boolean_is_meant(word: str, flag: bool) -> None:
    assert build(Plain, override({}, [f"flag={word}"])).flag is flag


def test_a_word_for_a_boolean_stays_text_where_text_is_meant() -> None:
    assert build(Plain, override({}, ["mode=off", "label=no"])) == Plain(mode="off", label="no")


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_reads_as_itself(number: float) -> None:
    assert override({}, [f"a={number!r}"])["a"] == number


@given(st.text())
def test_any_text_can_be_assigned(text: str) -> None:
    assume("=" not in text)
    assert list(override({}, [f"a={text}"])) == ["a"]


# ----------------------------------------------------------------------------------- files


def test_read_yaml(tmp_path: FilePath) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("base: &b {kind: plain, radius: 1e-3}\nwidget:\n  <<: *b\n  label: no\n")
    assert read_yaml(file)["widget"] == {"kind": "plain", "radius": 0.001, "label": "no"}
    file.write_text("# nothing yet\n")
    assert read_yaml(file) == {}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"a: 1\nb: [1, 2\nc: 3", "line 3: not valid YAML: "),
        (b"a: 1\nb: 2\na: 3", "line 3: not valid YAML: 'a' stands twice"),
        (b"a: !!python/object:os.system {}", "line 1: not valid YAML: could not determine"),
        (b"\xff\xfe\xfa", "not valid YAML: "),
        (b"a: \x00", "not valid YAML: "),
        (b"- 1\n- 2", "holds a list, expected key: value pairs"),
        (b"just text", "holds a str, expected key: value pairs"),
    ],
)
def test_a_bad_file_is_named_with_its_line(
    tmp_path: FilePath, content: bytes, expected: str
) -> None:
    file = tmp_path / "bad.yaml"
    file.write_bytes(content)
    with pytest.raises(DataError) as caught:
        read_yaml(file)
    assert str(caught.value).startswith(f"{file}: {expected}")
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_folder(tmp_path: FilePath) -> None:
    with pytest.raises(DataError, match=r"no\.yaml: no such file"):
        read_yaml(tmp_path / "no.yaml")
    with pytest.raises(DataError, match="cannot be read"):
        read_yaml(tmp_path)


# Other tests go through all families; that of this module is one only while its tests run.
WIDGETS = registry._REGISTRY.pop("widget")


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    """The family of this module is registered."""
    registry._REGISTRY["widget"] = WIDGETS
    yield
    del registry._REGISTRY["widget"]


def test_a_number_is_a_constant_schedule() -> None:
    schedule = resolve("schedule", 0.25)
    assert dump(schedule) == {"kind": "constant", "at": 0.25}
    for value in (True, "fast"):
        with pytest.raises(ConfigError):
            resolve("schedule", value)
    with pytest.raises(ConfigError, match="a path is a name"):
        resolve("path", 3)
