"""Of a crowd on one road, drives under the same conditions are shown together."""

import pytest

from steersman.report.html import CROWD, by_conditions
from steersman.report.scene import RoadGroup
from steersman.report.signals import ShownDrive


@pytest.fixture
def group(drive):
    def make(count, *speeds, **config):
        drives = [
            ShownDrive(f"{k}", drive(n=3, meta={"config": {
                "controller": f"c{k}", "seed": k, "speed": {"kind": "constant", "speed": v},
                **config,
            }}))
            for v in speeds for k in range(count)
        ]  # fmt: skip
        return RoadGroup("Road", drives, 1.5)

    return make


def test_a_few_stay_together(group):
    few = group(1, *range(CROWD))
    assert by_conditions(few) == [few]


def test_a_crowd_is_told_apart_by_what_differs(group):
    found = by_conditions(group(3, 10.0, 20.0, 30.0))
    assert [g.title for g in found] == [f"Road: speed.speed {v}" for v in (10, 20, 30)]
    assert [len(g.drives) for g in found] == [3, 3, 3]
    assert {g.half_width for g in found} == {1.5}


@pytest.mark.parametrize("speeds", [[1.0] * 9, range(9)])
def test_a_crowd_in_which_nobody_or_everybody_differs_stays_together(group, speeds):
    crowd = group(1, *speeds)
    assert by_conditions(crowd) == [crowd]


def test_fields_of_some_kinds_alone_are_no_words_of_their_own(group):
    constant = group(4, 10.0)
    other = group(4, 1.0, speed={"kind": "profile", "file": "a.csv"})
    found = by_conditions(constant._replace(drives=[*constant.drives, *other.drives]))
    assert [g.title for g in found] == ["Road: speed.kind constant", "Road: speed.kind profile"]


def test_what_is_not_recorded_is_apart(group, drive):
    crowd = group(4, 1.0, 2.0)
    bare = [ShownDrive("a", drive(n=3)), ShownDrive("b", drive(n=3))]
    found = by_conditions(crowd._replace(drives=[*crowd.drives, *bare]))
    assert found[-1].title == "Road: conditions not recorded"
    assert [d.name for d in found[-1].drives] == ["a", "b"]
