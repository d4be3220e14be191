"""The numbers of the page on pulling are those of its command."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import chemage as ca

PAGE = (Path(__file__).parents[2] / "docs/pulling.md").read_text(encoding="utf-8")
#: name of a row -> its numbers
TABLE = {
    row.split("|")[1].strip(): [float(cell) for cell in row.split("|")[2:-1]]
    for row in re.findall(r"^\| (?:speed|Δμ|β) .*\|$", PAGE, re.MULTILINE)
}
SPEEDS = TABLE["speed (nm/s)"]


@pytest.mark.parametrize(
    "column", [pytest.param(at, marks=[] if at in (0, 5) else pytest.mark.long) for at in range(len(SPEEDS))]
)
def test_the_table_of_speeds_is_what_its_scene_gives(column):
    blocks = [tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)]
    assert len(blocks[1]["sweep"]["rupture.speed"]) == len(SPEEDS)
    hold = {"hold.start": "0.1 s", "hold.stop": "100 s", "hold.per_decade": 1, "hold.replicas": 20}
    assert all(f"`{name.removeprefix('hold.')} = " in PAGE for name in hold)
    law = {**blocks[0]["rupture"], "speed": SPEEDS[column]}
    result = ca.run(ca.load_scene("silica-afm-tip", {**hold, "rupture": law}))
    drop = result.ageing.friction_coefficient_drop.mean(axis=0)
    # what is printed, and the events that another processor may order otherwise
    assert drop[0] == pytest.approx(TABLE["Δμ after 0.1 s"][column], abs=0.015)
    assert drop[-1] == pytest.approx(TABLE["Δμ after 100 s"][column], abs=0.03)
    assert result.summary()["beta"] == pytest.approx(TABLE["β per decade of hold time"][column], abs=0.015)
