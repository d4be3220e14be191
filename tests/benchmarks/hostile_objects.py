"""Whatever object is given to whatever public function: an answer, or an error of chemage, within 10 s of CPU time.

    python tests/benchmarks/hostile_objects.py [FIRST LAST]

Every public function that takes arguments is called with right ones, of which one or two are exchanged for another
object: numbers at the limits, arrays and tables of other libraries, dates, masks, quantities, paths of all kinds. Case
n is the same everywhere. The calls are made in a process of their own (see ``tests/stubs/hostile.py``).
"""

from __future__ import annotations

import collections
import datetime
import inspect
import json
import os
import sys
import tempfile
import time
import traceback
import warnings
from fractions import Fraction
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import pint
import xarray as xr

sys.path.insert(0, str(Path(__file__).parents[1] / "stubs"))
import hostile

import chemage as ca
from chemage.foundation import errors

#: of CPU time, for machines that do something else as well; an inference with right arguments takes 30
SECONDS = {"infer": 60.0}
UNITS = pint.UnitRegistry()
SERIES = pd.Series([0.02])
SERIES.attrs["units"] = "uN"
#: what other libraries have for numbers, times and tables
FOREIGN = [
    xr.DataArray(0.02, attrs={"units": "uN"}), xr.DataArray([1.0, 2.0], attrs={"units": "hour"}), xr.DataArray(3.0),
    xr.DataArray([[1.0, 2.0], [3.0, 4.0]], attrs={"units": "um"}), xr.Dataset({"a": ("x", [1.0])}), SERIES,
    pd.Series([1.0, 2.0]), pd.DataFrame({"a": [1.0, 2.0]}), pd.NA, pd.NaT, pd.Timestamp("2020-01-01"),
    pd.Timedelta("5h"), pd.Index([1.0, 2.0]), pd.Categorical(["a", "b"]), UNITS.Quantity(0.02, "uN"),
    UNITS.Quantity([1.0, 2.0], "hour"), UNITS.Quantity(1.0, "V"), UNITS.nanometer, np.ma.masked,
    np.ma.array([1.0, 2.0], mask=[0, 1]), np.ma.array(0.02, mask=True), np.timedelta64(5, "h"), np.timedelta64("NaT"),
    np.datetime64("NaT"), np.array(["2020-01-01"], "M8[D]"), np.array([5], "m8[h]"), datetime.datetime(2020, 1, 1),
    datetime.timedelta(hours=5), Fraction(1, 3), np.array(object()), np.array([None]), np.array("x"),
    np.rec.array([(1,)]),
    np.zeros(3, [("a", "f8")]), np.zeros((0, 3)), np.zeros((2, 2, 2, 2)), memoryview(b"abc"), iter([1]), frozenset([1]),
    {"a": np.ma.masked}, [np.ma.masked], [pd.NA], "/dev/null", "/", "no/such/file.h5", Path("x.h5"), "a\x00b",
    "x" * 5000,
    b"bytes.h5", 10**400, -(10**400), 1e-320, 1e300, True, 2**63, 2**64, float("nan"), float("inf"),
]  # fmt: skip


@lru_cache(maxsize=1)
def good() -> dict[str, tuple[object, dict]]:
    """Public name -> the function and right arguments."""
    folder = Path(tempfile.mkdtemp(prefix="chemage-hostile-"))
    os.chdir(folder)
    data = {name: part for name, part in hostile.SCENE.items() if name != "observe"}
    data["hold"] = {"times": [1e-3, 1.0, 100.0], "replicas": 2}
    (folder / "measured.csv").write_text(hostile.TEXTS["measured.csv"])
    scene = ca.parse_scene(data)
    run = ca.run(scene)
    ca.write("run.h5", run)
    chemistry, contact, lattice = ca.Chemistry(**hostile.CHEMISTRY), hostile.contact(), hostile.lattice()
    ageing, engine, times = run.ageing, ca.engine("bkl"), hostile.TIMES
    curve = {"load": 3.0, "temperature": 300.0, "hold_times": times, "values": [1.0, 2.0, 3.0], "errors": [0.1] * 3}
    maker = ca.surface("sphere", radius=30.0, pixels=16, pixel_size=0.5)
    history, kit = hostile.history("bkl"), {"hold_times": times, "temperature": 300.0, "seed": 1}
    arguments = {
        "make_surface": {"maker": maker, "seed": 1},
        "solve_contact": {"solver": ca.contact("fft-bem", modulus=35.0), "surface": hostile.surface(), "load": 1.0},
        "contact_modulus": {"young": 70.0, "poisson": 0.2, "counter_young": 70.0, "counter_poisson": 0.2},
        "open_maps": {"path": "run.h5"},
        "read": {"path": "run.h5", "maps": True},
        "write": {"path": "other.h5", "result": ageing, "force": True},
        "write_report": {"files": ["run.h5"], "out": "r.html", "measured": [], "force": True},
        "compare_files": {"files": ["run.h5", "run.h5"], "measured": ["measured.csv"], "times": [1.0, 100.0]},
        "read_measurements": {"path": "measured.csv"},
        "read_curves": {"path": "measured.csv", "load": 3.0, "temperature": 300.0, "relative_error": 0.1},
        "hold_times": {"start": 1.0, "stop": 10.0, "per_decade": 2},
        "age": {"contact": contact, "chemistry": chemistry, "engine": engine, "replicas": 1, **kit},
        "fit_ageing": {"data": ageing, "model": "line", "window": (1e-3, 100.0), "samples": 100, "confidence": 0.9,
                      "seed": 0, "quantity": "friction_drop"},
        "arrhenius": {"results": [ageing, ageing], "levels": [1.0], "window": (1e-3, 100.0)},
        "load_scene": {"where": "silica-tip", "changes": {"contact.load": 2.0, "hold.temperature": 300.0}},
        "parse_scene": {"data": data, "source": "here"},
        "scene_data": {"where": "silica-tip"},
        "override": {"data": data, "changes": {"contact.load": 2.0}},
        "run": {"scene": scene, "threads": 1, "progress": None, "surface": None, "contact": None, "checkpoints": None},
        "sweep": {"scene": data, "out": "sweep", "axes": {"contact.load": [1.0]}, "workers": 1, "executor": None},
        "load_sweep": {"folder": "sweep"},
        "collect_sweep": {"folder": "sweep"},
        "SweepResult": {"folder": "sweep"},
        "ensemble": {"scene": scene, "surfaces": 2, "most": None, "accuracy": None, "budget": None, "samples": None},
        "infer": {"measured": [ca.MeasuredCurve(**curve)], "scene": scene, "samples": 50, "seed": 1,
                  "families": ["uniform"]},
        "material": {"name": "silica"},
        "plugin_options": {"name": "surfaces"},
        "register": {"cls": type(maker)},
        "unregister": {"cls": str},
        "prefer_plugins": {"names": "contact"},
        "Measurements": {"name": "m", "hold_times": times, "values": times + 1, "quantity": "friction_drop"},
        "MeasuredCurve": curve,
        "build_lattice": {"chemistry": chemistry, "contact": contact, "seed": 1},
        "run_kinetics": {"engine": engine, "lattice": lattice, "start": history, "states": False, **kit},
        "contact_sites": {"contact": contact, "density": "pixel"},
        "contact_statistics": {"contact": contact, "chemistry": chemistry},
        "coordination": {"interaction": ca.interaction("elastic-pairs", strength=0.5), "spacing": 0.5},
        "label_patches": {"contact": contact.pressure > 0, "periodic": True},
        "content_hash": {"content": {"a": 1}},
        "convert": {"value": 1.0, "unit": "nm", "field": "x"},
        "force": {"load": 1.0},
        "temperature_value": {"temperature": 300.0},
        "check_times": {"hold_times": times},
        "checked_count": {"name": "n", "value": 3, "least": 1},
        "checked_seed": {"seed": 3},
        "checked_states": {"name": "s", "state": np.ones(3, bool), "sites": 3},
        "fromdict": {"role": "engine", "fields": {"kind": "bkl"}},
        "nearest": {"word": "bkl", "known": ["bkl"]},
        "preflight": {"path": "new.h5", "force": False, "size": 3.0},
        "regular_file": {"path": "run.h5"},
        "reader_for": {"path": "x.npy"},
        "HeightMap": {"heights": hostile.HEIGHTS, "height_unit": 1.0, "pixel_size": (1.0, 1.0), "periodic": False},
        "Scatter": {"relative": 0.1, "source": "x"},
        "TwoState": {"forming": np.ones(3), "breaking": 1.0},
        "Output": {"dims": ("a",), "unit": "nm", "description": "x"},
        "Surface": hostile.surface().todict(),
        "ContactSolution": contact.todict(),
        "ReactionLattice": lattice.todict(),
        "BondHistory": history.todict(),
        "Ageing": ageing.todict(),
        "Chemistry": dict(hostile.CHEMISTRY),
        "chemistry": dict(hostile.CHEMISTRY),
        "Scene": {name: getattr(scene, name) for name in type(scene).model_fields},
    }  # fmt: skip
    for role, kind, options in hostile.COMPONENTS:
        arguments[f"{role} {kind}"] = {"kind": kind, **options}
    return {name: (getattr(ca, name.split()[0]), given) for name, given in arguments.items()}


def case(number: int) -> tuple[str, object, dict]:
    """The name of case ``number``, its function and arguments."""
    rng = np.random.default_rng([20261123, number])
    name = list(good())[number % len(good())]
    function, arguments = good()[name]
    arguments = dict(arguments)
    for _ in range(1 + int(rng.random() < 0.3)):
        pool = FOREIGN if rng.random() < 0.6 else hostile.NUMBERS if rng.random() < 0.5 else hostile.ODD
        arguments[hostile.pick(rng, sorted(arguments))] = hostile.pick(rng, pool)
    return name, function, bounded(arguments)


def bounded(arguments: dict) -> dict:
    """The arguments, of which no number that is allowed asks for hours."""
    for name, most in (("replicas", 10), ("surfaces", 4), ("samples", 500), ("temperature", 1000.0), ("most", 100)):
        value = arguments.get(name)
        if isinstance(value, int | float) and not isinstance(value, bool) and most < value < 10**7:
            arguments[name] = most
    if "hold_times" in arguments:
        hostile.finite_work(arguments)
    return arguments


def outcome(number: int) -> tuple[str, float, str]:
    """Function, seconds, and what is wrong with the end of case ``number``; "" if nothing."""
    name, function, arguments = case(number)
    begin, wrong = time.process_time(), ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            call(name, function, arguments)
    except ca.ChemageError as error:
        wrong = "" if 0 < len(str(error)) < 20_000 else f"a message of {len(str(error))} characters"
    except BaseException as error:
        values = {
            key: errors.shown(value, 60) for key, value in arguments.items() if value is not good()[name][1].get(key)
        }
        wrong = f"{type(error).__name__}: {error}\n{values}\n{traceback.format_exc(limit=-3)}"
    seconds = time.process_time() - begin
    return name, seconds, wrong or (f"took {seconds:.1f} s" if seconds > SECONDS.get(name, 10.0) else "")


def call(name: str, function: object, arguments: dict) -> object:
    """What the function returns; of a block, what it gives."""
    if name == "prefer_plugins":
        answer = function(arguments["names"])
    elif " " in name or name == "plugin_options":
        arguments = dict(arguments)
        answer = function(arguments.pop("kind" if "kind" in arguments else "name"), **arguments)
    else:
        answer = function(**arguments)
    if name == "unregister":
        return answer
    if hasattr(answer, "__enter__") and not inspect.isclass(answer):
        with answer:
            pass
    return answer


def main(first: int = 0, last: int = 2000) -> int:
    os.environ.setdefault("CHEMAGE_MEMORY", "1 GB")
    ends, slowest, begin = collections.Counter(), ("", 0.0), time.process_time()
    for number in range(first, last):
        name, seconds, wrong = outcome(number)
        ends["wrong" if wrong else "right"] += 1
        slowest = max(slowest, (f"{number} {name}", seconds), key=lambda one: one[1])
        if wrong:
            print(json.dumps({"case": number, "function": name, "wrong": wrong}), flush=True)
    print(f"{dict(ends)}; slowest: {slowest[0]}, {slowest[1]:.2f} s; {time.process_time() - begin:.0f} s of CPU time")
    return ends["wrong"]


if __name__ == "__main__":
    sys.exit(bool(main(*map(int, sys.argv[1:]))))
