"""The keys of stages stay what they are: samples, checkpoints and folders of sweeps are found by them.

``keys.json`` holds what these scenes had when the stages were declared in one place; a key may change only together
with what its stage computes. ``python tests/scene/test_keys.py`` writes the file again.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import chemage as ca

STORED = Path(__file__).with_name("keys.json")
NAMES = ("silica-rough", "silica-patch", "silica-tip", "silica-tips", "silica-afm-tip", "silica-linear-tip")
#: options that are replaced, section by section; a section that is None is left out
CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"surface": {"seed": 3}, "name": "another", "fit": {"start": "10 ms", "stop": "1e3 s"}},
    {"contact": {"load": "7 nN"}, "hold": {"temperature": "310 K", "replicas": 3, "common": "all"}},
    {"engine": {"kind": "next-reaction", "threads": 2}, "hold": {"seed": 5, "per_decade": 3}, "material": "silica"},
    {"engine": {"kind": "bkl", "superbasins": True}, "breaking": {"mean": 0.9}, "chemistry": {"bond_force": "0.4 nN"}},
    {"interaction": None, "breaking": None, "engine": {"kind": "independent"}, "observe": None},
    {"rupture": {"kind": "mean-force", "bond_force": "0.3 nN"}, "observe": [{"kind": "pressure-spectrum", "bins": 7}]},
    {"chemistry": {"site_density": "4.6 nm^-2", "hydroxylation": 0.5, "shear_strength": "2 GPa"}},
    {"ageing": {"kind": "closure", "accuracy": 0.05}, "ensemble": {"surfaces": 4}, "accuracy": {"beta": "5 %"}}
    | {"observe": None},
    {"forming": None, "breaking": None, "interaction": None, "chemistry": None, "engine": None, "hold": None}
    | {"fit": None, "observe": None, "plugins": {"prefer": ["contact"]}},
)


def data_of(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    data = {section: value for section, value in ca.plugin.scene_data(name)[0].items() if section != "sweep"}
    for section, value in changes.items():
        merged = {**data.get(section, {}), **value} if isinstance(value, dict) else value
        data |= {section: merged}
    return {section: value for section, value in data.items() if value is not None}


def keys() -> dict[str, Any]:
    stored = {}
    for name in NAMES:
        for number, changes in enumerate(CHANGES):
            scene = ca.parse_scene(data_of(name, changes))
            stored[f"{name} {number}"] = {**scene.keys(), "tasks": scene.task_keys(), "scene": scene.digest()}
    return stored


def test_the_keys_are_those_of_before():
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    assert len(stored) == 60
    assert keys() == stored


if __name__ == "__main__":
    STORED.write_text(json.dumps(keys(), indent=1) + "\n", encoding="utf-8")
