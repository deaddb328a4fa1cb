"""The C on the page about the export compiles and does what the page says."""

from __future__ import annotations

import re
from pathlib import Path as FilePath

from .building import COMPILER, STRICT, export, needs_compiler, run

PAGE = FilePath(__file__).resolve().parents[2] / "docs" / "export.md"
MAIN = """
#include <math.h>
#include <stdio.h>
int main(void)
{
    steersman_precision_observation seen = {0};
    float steer;
    int i, over = 0;
    seen.lateral_error = 0.1f;
    seen.v_x = 10.0f;
    for (i = 0; i < STEERSMAN_PRECISION_WAYPOINTS; ++i) {
        seen.preview[i][0] = (float)i * STEERSMAN_PRECISION_SPACING;
        seen.preview[i][1] = -0.1f;
    }
    steering_start();
    steer = steering_period(&seen, 1, 0.0f, &over);
    printf("%d %d", steer < 0.0f, over);
    seen.v_x = NAN;
    seen.steer = 0.25f;
    for (i = 0; i < 5; ++i) {
        steer = steering_period(&seen, i != 2, 0.25f, &over);
        printf(" %.2f %d", (double)steer, over);
    }
    return 0;
}
"""


@needs_compiler
def test_the_loop_of_the_page(tmp_path: FilePath) -> None:
    export("precision", tmp_path, single=True)
    text = PAGE.read_text(encoding="utf-8")
    loop = re.search(r"## Calling it\n.*?```c\n(.*?)```", text, re.DOTALL)
    assert loop is not None
    declared = loop[1].replace("\nvoid steering", "\nvoid steering_start(void);\nvoid steering", 1)
    (tmp_path / "loop.c").write_text(declared + MAIN)
    files = [tmp_path / name for name in ("loop.c", "steersman_precision.c")]
    run(COMPILER, *STRICT, "-o", tmp_path / "loop", *files, "-lm")
    assert run(tmp_path / "loop") == "1 0 0.25 0 0.25 0 0.25 0 0.25 1 0.25 1"


def test_the_page_names_every_file(tmp_path: FilePath) -> None:
    export("precision", tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    for file in tmp_path.iterdir():
        assert f"`{file.name}`" in text
