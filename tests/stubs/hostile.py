"""Hostile inputs: case ``number`` of a fixed sequence is a call with arguments that nobody should give.

Run as a program, ``python hostile.py FIRST LAST``, it makes those calls and prints one JSON line before each, and one
after each that did not end as it should: with an answer in plain finite numbers, or with a ChemageError.
"""

from __future__ import annotations

import faulthandler
import json
import math
import os
import sys
import tempfile
import traceback
import warnings
from decimal import Decimal
from pathlib import Path

import numpy as np

import chemage as ca

#: a case that takes longer hangs, s
PATIENCE = 120
LOOP: list = []
LOOP.append(LOOP)
DEEP: list = []
for _ in range(3000):
    DEEP = [DEEP]

#: neither numbers nor arrays
ODD = [
    None, True, False, "", "x", "1", "1 nm", "20 uN", "nan", "inf nm", "1e400 nm", "1e-400 nN", "-1 K", "1e5 s", "\x00",
    "\x1b[2J", "a" * 3000, "9" * 5000, "no", "yes", "none", "periodic", b"x", (), [], {}, [1], [1, 2], [1.0, math.nan],
    [True], [[1, 2], [3, 4]], [[1], [2, 3]], {"kind": "x"}, {"kind": "gaussian"}, {"a": {"b": 1}}, {1: 2}, object(), 1j,
    Decimal(1), Path("/"), range(3), print, LOOP, DEEP, int, np.random.default_rng(0), np.random.SeedSequence(1),
    np.datetime64("2020-01-01"), np.bool_(True), ["x"], [None], [object()], ca.Surface,
]  # fmt: skip
NUMBERS = [
    0, 1, -1, 2, 7, 2**15, 2**31 - 1, 2**31, 2**32, 2**53, 2**63 - 1, 2**63, 2**64, -(2**63), 10**30, 10**400,
    -(10**400), 0.0, -0.0, 0.5, 1.5, 5e-324, 1e-320, 1e-300, 1e-160, 1e-100, 1e-30, 1e-9, 1e9, 1e30, 1e100, 1e160,
    1e300, 1.7e308, -1e308, -1e-300, math.nan, math.inf, -math.inf, np.float32(1e38), np.float64(math.nan), np.int8(-1),
    np.uint64(2**64 - 1), np.float16(1), np.longdouble(1e300), np.array(2.0), np.array([3]), np.array([]),
]  # fmt: skip


def pick(rng, items):
    return items[int(rng.integers(len(items)))]


def strange_array(rng, good):
    """A damaged copy of an array, or something else."""
    try:
        return _strange_array(rng, good)
    except (TypeError, ValueError, IndexError, OverflowError):  # numpy makes no such array
        return strange(rng)


def _strange_array(rng, good):
    good = np.array(good)
    way = int(rng.integers(15))
    if way == 0:
        kinds = [">f8", "<f4", "i1", "u1", "i8", ">i4", "c16", "f2", "O", "U5", "bool", "u8", "f8"]
        return good.astype(pick(rng, kinds))
    if way == 1:
        return good[..., None]
    if way == 2:
        return good.ravel()[:-1]
    if way == 3:
        return np.zeros((0,) * good.ndim, good.dtype)
    if way == 4:
        return np.array(good.T, order="F")
    if way == 5:
        return good[::-1]
    if way == 6 and good.size:
        return np.repeat(good, 2, axis=0)
    if way == 7:
        return good.tolist()
    if way == 8:
        return np.full(good.shape, pick(rng, [np.nan, np.inf, 1e308, -1e308, 1e160, 1e-300, -1.0, 2.0**31, 0.0]))
    if way == 9 and good.dtype.kind in "iub" and good.size:
        return rng.integers(-(2**62), 2**62, good.shape)
    if way == 10 and good.dtype == np.bool_ and good.size:
        return rng.integers(0, 256, good.shape).astype(np.uint8).view(np.bool_)
    if way == 11 and good.size:
        raw = bytearray(good.tobytes())
        for _ in range(int(rng.integers(1, 4))):
            raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(8))
        return np.frombuffer(bytes(raw), good.dtype).reshape(good.shape)
    if way == 12 and good.size:
        changed = good.copy()
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            value = np.array(pick(rng, [-1, 0, 1, 2, 7, 100, 2**31 - 1, -(2**31)]))
            changed.ravel()[int(rng.integers(good.size))] = value.astype(good.dtype)
        return changed
    if way == 13:
        return np.ma.masked_array(good, np.ones(good.shape, bool))
    return strange(rng)


def strange(rng):
    """Whatever it is, it is no argument."""
    return pick(rng, NUMBERS if rng.random() < 0.6 else ODD)


def damaged(rng, fields):
    """Fields of which one or two are hostile."""
    made = dict(fields)
    for _ in range(1 + int(rng.random() < 0.3)):
        name = pick(rng, sorted(made))
        value = made[name]
        made[name] = strange_array(rng, value) if isinstance(value, np.ndarray) and rng.random() < 0.8 else strange(rng)
    if rng.random() < 0.03:
        made["no_such_field"] = strange(rng)
    return made


# -- what is right -----------------------------------------------------------------------------------------------------

HEIGHTS = np.random.default_rng(5).normal(size=(12, 12))
TIMES = np.array([1e-3, 1.0, 1e3])


def surface(**changes):
    return ca.Surface(**{"heights": HEIGHTS, "pixel_size": 0.5, "periodic": True, "provenance": {}, **changes})


def contact(**changes):
    pressure = np.maximum(HEIGHTS - 0.8, 0.0)
    fields = {"pressure": pressure, "load": float(pressure.sum()) * 0.25, "pixel_size": 0.5, "modulus": 35.0}
    return ca.ContactSolution(
        **{**fields, "periodic": True, "gap": np.maximum(0.8 - HEIGHTS, 0.0), "rms_slope": 0.1, "displacement": 1.0,
           "convergence": {}, "notes": (), "provenance": {}, "residual": 0.0, "iterations": 3,
           "plastic_displacement": np.where(pressure > 1.5, 0.1, 0.0), **changes}
    )  # fmt: skip


def lattice(n=24, **changes):
    rng = np.random.default_rng(n)
    ring = np.stack([(np.arange(n) - 1) % n, (np.arange(n) + 1) % n], axis=1).astype(np.int32)
    pairs = rng.uniform(-0.05, 0.2, n).astype(np.float32)
    fields = {"pixels": (1, n), "sites": np.arange(n), "forming": rng.uniform(0.5, 1.2, n)}
    fields |= {"breaking": rng.uniform(0.8, 1.2, n), "neighbours": ring, "attempt_frequency": 1e13, "pixel_size": 1.0}
    return ca.ReactionLattice(
        **{**fields, "coupling": np.stack([np.roll(pairs, 1), pairs], axis=1), "provenance": {}, **changes}
    )


def plain(n=24, **changes):
    return lattice(n, **{"neighbours": None, "coupling": None, **changes})


ENGINES = ["rejection-free", "bkl", "next-reaction", "independent", "auto"]
_histories: dict = {}


def history(kind):
    if kind not in _histories:
        _histories[kind] = ca.engine(kind).run(on(kind), TIMES, temperature=300.0, seed=4)
    return _histories[kind]


def on(kind):
    return plain() if kind == "independent" else lattice()


CHEMISTRY = {
    "forming": {"kind": "gaussian", "mean": 0.9, "std": 0.1},
    "breaking": {"kind": "uniform", "lower": 1.0, "upper": 1.2},
    "interaction": {"kind": "elastic-pairs", "strength": 0.5, "bias": 0.1},
    "activation_volume": 0.006, "attempt_frequency": 1e13, "bond_force": 3.0, "front_factor": 1.0, "hydroxylation": 1.0,
}  # fmt: skip
SCENE = {
    "name": "hostile", "title": "t",
    "surface": {"kind": "self-affine", "pixels": 16, "pixel_size": 0.5, "rms_slope": 0.1, "hurst": 0.8, "zeta": 4,
                "eta": 1, "seed": 1},
    "contact": {"kind": "fft-bem", "modulus": 35.0, "load": 4.0},
    **{name: CHEMISTRY[name] for name in ("forming", "breaking", "interaction")},
    "chemistry": {"activation_volume": 0.006, "hydroxylation": 1.0},
    "engine": {"kind": "bkl"},
    "hold": {"start": 1e-3, "stop": 1e2, "per_decade": 1, "replicas": 2, "seed": 3, "temperature": 300.0},
    "fit": {"start": 1.0, "stop": 100.0},
    "observe": [{"kind": "barrier-spectrum"}],
}  # fmt: skip
COMPONENTS = [
    ("surface", "self-affine", {"pixels": 16, "pixel_size": 0.5, "rms_slope": 0.1, "hurst": 0.8, "zeta": 4, "eta": 1}),
    ("surface", "self-affine", {"pixels": [8, 16], "pixel_size": 0.5, "rms_height": 0.1, "hurst": 0.8, "zeta": 4}),
    ("surface", "sphere", {"radius": 30.0, "pixels": 16, "pixel_size": 0.5}),
    ("contact", "fft-bem", {"modulus": 35.0, "tolerance": 1e-5, "pressure_tolerance": None, "precision": "mixed",
                            "boundary": "auto", "levels": None, "max_iterations": 500, "on_failure": "raise",
                            "gap": True, "thickness": None, "poisson_ratio": 0.25, "fft": "scipy", "threads": None,
                            "hardness": 9.0}),
    ("contact", "fft-bem", {"modulus": 35.0, "thickness": 5.0, "poisson_ratio": 0.25, "precision": "single",
                            "tolerance": 1e-4}),
    ("contact", "hertz", {"modulus": 35.0, "hardness": 9.0}),
    ("barriers", "gaussian", {"mean": 0.9, "std": 0.1, "lower": 0.5, "upper": 1.5}),
    ("barriers", "uniform", {"lower": 1.0, "upper": 1.2}),
    ("barriers", "tabulated", {"energies": np.array([0.5, 1.0, 1.5]), "weights": np.array([0.0, 1.0, 0.0]),
                               "energy_unit": 1.0}),
    ("barriers", "tabulated", {"samples": np.array([0.5, 1.0, 1.5]), "energy_unit": "eV"}),
    ("barriers", "md-silica", {}),
    ("interaction", "elastic-pairs", {"strength": 0.5, "bias": 0.1}),
    ("engine", "rejection-free", {"superbasins": False}),
    ("engine", "bkl", {"superbasins": False}),
    ("engine", "next-reaction", {"superbasins": False, "threads": 1}),
    ("engine", "independent", {"threads": 1}),
    ("engine", "auto", {"threads": 1}),
    ("observable", "barrier-spectrum", {}),
    ("observable", "pressure-spectrum", {}),
]  # fmt: skip


# -- families of cases: each makes the arguments, and returns the call ------------------------------------------------


def records(rng):
    kind = int(rng.integers(5))
    if kind == 0:
        fields = damaged(rng, surface().todict())
        return lambda: use_surface(ca.Surface(**fields))
    if kind == 1:
        fields = damaged(rng, contact().todict())
        return lambda: use_contact(ca.ContactSolution(**fields))
    if kind == 2:
        fields = damaged(rng, lattice().todict())
        return lambda: use_lattice(ca.ReactionLattice(**fields))
    if kind == 3:
        fields = damaged(rng, history("bkl").todict())
        return lambda: use_history(ca.plugin.BondHistory(**fields), "bkl")
    bonds = np.array([[1, 2, 3], [2, 3, 5]])
    fields = {"hold_times": TIMES, "bonds": bonds, "sites": np.array([9, 9]), "events": np.array([4, 5]), "load": 3.0,
              "temperature": 300.0, "bond_force": 3.0, "front_factor": 1.0, "engine": "x", "notes": (), "contact": {},
              "observables": {"a": np.ones((2, 2))}, "provenance": {}}  # fmt: skip
    fields = damaged(rng, fields)
    return lambda: use_ageing(ca.Ageing(**fields))


def use_surface(made):
    shown = [made.digest(), repr(made), made._repr_html_()]
    return [made.rms_height, made.rms_slope, made.psd(), made.nominal_area, shown]


def use_contact(made):
    known = {name: value for name, value in made.summary().items() if not allowed_nan(name, made)}
    return [known, made.patches, made.perimeter, made.pressure_histogram(), made.digest(), repr(made)]


def allowed_nan(name, made):
    if name in ("rms_slope", "rms_height", "kappa") and not math.isfinite(getattr(made, name)):
        return not math.isfinite(made.rms_slope) or not math.isfinite(made.rms_height) or made.load == 0
    return made.area == 0 and name in ("mean_contact_pressure", "perimeter_to_area")


def use_lattice(made):
    kind = ENGINES[made.sites.size % 3]
    if made.attempt_frequency > 1e14 or np.min(made.forming, initial=1) < 0.3:
        return [made.digest(), repr(made), made.to_atoms().positions]  # too many events
    if made.breaking is not None and np.min(made.breaking, initial=1) < 0.5:
        return [made.digest()]
    return [made.digest(), ca.engine(kind).run(made, TIMES, temperature=300, seed=1), made.to_atoms().positions]


def use_history(made, kind):
    later = ca.engine(kind).run(on(kind), [made.time, made.time * 10 + 1], temperature=300.0, seed=4, start=made)
    return [made.digest(), made.events, repr(made), later, made.then(later)]


def use_ageing(made):
    return [made.digest(), repr(made), made.friction_drop, made.mean_friction_drop, made.fit("1 ms", "1e3 s").beta]


def components(rng):
    role, kind, options = pick(rng, COMPONENTS)
    options = damaged(rng, options) if options else {"x": strange(rng)}
    return lambda: use_component(role, getattr(ca, role)(kind, **options))


def use_component(role, made):
    done = [made.digest(), repr(made), made.todict()]
    u = np.array([1e-16, 0.01, 0.5, 0.99, 1 - 1e-16])
    if role == "surface":
        made.expected()
        return [*done, use_surface(made.make(seed=3))]
    if role == "contact":
        sphere = ca.surface("sphere", radius=30.0, pixels=16, pixel_size=0.5).make()
        body = sphere if made.kind == "hertz" else surface()
        made.expected({"nx": 12.0, "ny": 12.0, "pixel_size": 0.5, "rms_slope": 0.1, "radius": 30.0}, 1.0)
        return [*done, use_contact(made.solve(body, 1.0))]
    if role == "barriers":
        return [*done, made.quantile(u)]
    if role == "interaction":
        sites = np.array([0, 1, 4, 6])
        graph = made.neighbours((3, 3), True, sites)
        return [*done, made.coupling(sites, graph, 3)]
    if role == "engine":
        return [*done, made.run(on(made.kind), TIMES, temperature=300.0, seed=2)]
    return done


def engines(rng):
    """Hand-made histories and lattices, and wrong arguments of ``run``."""
    kind = pick(rng, ENGINES)
    if rng.random() < 0.75:
        start = history(kind)
        resume = dict(start.resume)
        name = pick(rng, sorted(resume))
        if rng.random() < 0.1:
            del resume[name]
        else:
            resume[name] = strange_array(rng, resume[name])
        return lambda: use_history(start.model_copy(update={"resume": resume}), kind)
    arguments = {"lattice": on(kind), "hold_times": TIMES, "temperature": 300.0, "seed": 3, "start": history(kind)}
    arguments = finite_work(damaged(rng, arguments))
    return lambda: ca.engine(kind).run(**arguments)


def finite_work(arguments):
    """Arguments with which no run has so many events that it takes hours; and none that Python itself refuses."""
    arguments.pop("no_such_field", None)
    for name, most in (("temperature", 1e3), ("hold_times", 1e5)):
        try:
            too_many = most < float(np.max(np.asarray(arguments[name], float))) < math.inf
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
            continue
        if too_many:
            arguments[name] = math.nan
    return arguments


def functions(rng):
    seed, x, y = strange(rng), strange(rng), strange(rng)
    made = contact()
    chemistry = ca.Chemistry(**CHEMISTRY)
    engine = ca.engine("bkl")
    run = {"contact": made, "chemistry": chemistry, "engine": engine, "hold_times": TIMES, "temperature": 300.0,
           "replicas": 2, "seed": 1, "common": "none", "observe": (), "threads": 1, "progress": None,
           "checkpoints": None}  # fmt: skip
    run = finite_work(damaged(rng, run))
    if isinstance(run["replicas"], int) and 100 < run["replicas"] < 10**7:
        run["replicas"] = 10**9
    pair = ca.interaction("elastic-pairs", strength=0.5)
    fit = use_ageing_data()
    calls = [
        lambda: ca.age(**run),
        lambda: ca.age(**run),
        lambda: ca.age(**run),
        lambda: ca.hold_times(x, y),
        lambda: ca.hold_times("1 ms", "1 s", per_decade=x),
        lambda: ca.plugin.check_times(x),
        lambda: ca.plugin.force(x),
        lambda: ca.plugin.temperature_value(x),
        lambda: ca.plugin.checked_seed(x),
        lambda: repr(ca.plugin.convert(x, "nm")),
        lambda: fit.fit(x, y),
        lambda: ca.fit_ageing(fit, window=(x, y)),
        lambda: ca.solve_contact(ca.contact("fft-bem", modulus=35.0), surface(), x),
        lambda: ca.contact("fft-bem", modulus=35.0).solve_displacement(surface(), x),
        lambda: ca.solve_contact(x, y, 1.0),
        lambda: ca.contact("hertz", modulus=35.0).solve(x, 1.0),
        lambda: ca.make_surface(ca.surface("self-affine", **COMPONENTS[0][2]), seed),
        lambda: ca.plugin.build_lattice(chemistry, made, seed),
        lambda: ca.plugin.build_lattice(x, y, 1),
        lambda: ca.plugin.run_kinetics(engine, lattice(), **finite_work({"hold_times": x, "temperature": 300.0})),
        lambda: ca.plugin.run_kinetics(x, y, TIMES, temperature=300.0),
        lambda: ca.engine("independent").mean(plain(), TIMES, temperature=300.0, start=x),
        lambda: ca.engine("independent").mean(plain(), x, temperature=300.0),
        lambda: pair.neighbours((x, y), True, np.array([0, 1])),
        lambda: pair.neighbours((3, 3), True, strange_array(rng, np.array([0, 4, 8]))),
        lambda: pair.coupling(np.array([0, 4]), strange_array(rng, np.array([[1], [0]], np.int32)), 1),
        lambda: ca.plugin.fromdict(x if isinstance(x, str) else "engine", y),
        lambda: surface().psd(x),
        lambda: made.pressure_histogram(x),
        lambda: made.pressure_histogram(5, y),
        lambda: lattice().to_atoms(strange_array(rng, np.zeros(24, bool))),
        lambda: ca.Chemistry(**damaged(rng, CHEMISTRY)).on(made, 3),
        lambda: len(ca.plugin.override(SCENE, {pick(rng, ["surface.pixels", "observe.0.kind", "a.b", "hold"]): x})),
        lambda: ca.Measurements("m", strange_array(rng, TIMES), strange_array(rng, TIMES), "friction_drop"),
    ]
    return pick(rng, calls)


def use_ageing_data():
    bonds = np.array([[1, 2, 3], [2, 3, 5]])
    return ca.Ageing(hold_times=TIMES, bonds=bonds, sites=[9, 9], events=[4, 5], load=3.0, temperature=300.0)


def scenes(rng):
    data = json.loads(json.dumps(SCENE))
    for _ in range(1 + int(rng.random() < 0.3)):
        section = pick(rng, sorted(data))
        part = data[section]
        if isinstance(part, list) and part:
            part = part[0]
        if isinstance(part, dict) and part and rng.random() < 0.85:
            part[pick(rng, sorted(part))] = strange(rng)
        else:
            data[section] = strange(rng)
    return lambda: use_scene(data)


def use_scene(data):
    from chemage.scene.plan import plan

    scene = ca.parse_scene(data)
    known = [scene.digest(), scene.keys(), plan(scene).numbers]
    hold = scene.hold
    large = plan(scene).numbers.get("cpu_seconds", 0.0) > 1 or (hold is not None and hold.hold_times.size > 500)
    hot = hold is not None and (hold.temperature > 1000 or hold.hold_times[-1] > 1e9)
    easy = scene.chemistry is not None and min(scene.chemistry.forming.quantile(np.array([0.01]))) < 0.4
    if large or hot or easy or (scene.chemistry is not None and scene.chemistry.attempt_frequency > 1e14):
        return known
    result = ca.run(scene)
    return [*known, {n: v for n, v in result.summary().items() if n != "timings"}]


TEXTS = {
    "heights.txt": "# pixel_size = 0.5 nm\n1 2 3\n4 5.5 6\n-7 8e-1 9\n",
    "heights.csv": "\n".join(",".join(f"{h:.3f}" for h in row) for row in HEIGHTS[:5, :5]),
    "measured.csv": "# m\nhold_time (s), friction_coefficient_drop, error\n1, 0.12, 0.02\n10, 0.31, 0.02\n",
    "barriers.txt": "energy density\n0.5 0\n1.0 1\n1.5 0\n",
    "samples.csv": "0.5\n0.7\n0.9\n",
    "scene.toml": '[surface]\nkind = "sphere"\nradius = "30 nm"\npixels = 16\npixel_size = "0.5 nm"\n'
    '[contact]\nkind = "hertz"\nmodulus = "35 GPa"\nload = "1 nN"\n',
}
_whole: dict = {}


def whole(name):
    """The bytes of an undamaged file."""
    if not _whole:
        import h5py

        folder = Path(tempfile.mkdtemp())
        np.save(folder / "heights.npy", HEIGHTS[:5, :5])
        with h5py.File(folder / "heights.h5", "w") as file:
            made = file.create_dataset("maps/heights", data=HEIGHTS[:6, :6], chunks=(3, 6), compression="gzip")
            made.attrs["pixel_size"] = 0.5
            made.attrs["periodic"] = True
        for one in folder.iterdir():
            _whole[one.name] = one.read_bytes()
            one.unlink()
        folder.rmdir()
        _whole.update({one: text.encode() for one, text in TEXTS.items()})
    return _whole[name]


FILES = [*TEXTS, "heights.npy", "heights.npy", "heights.h5", "heights.h5", "heights.h5"]
PIECES = [b"\x00", b"\xff", b"\n" * 9, b"1e999", b"nan", b"9" * 400, b"[" * 200, b"-", b",,,", b";", b'"', b"\x1b[31m"]


def files(rng):
    name = pick(rng, FILES)
    content = bytearray(whole(name))
    way = int(rng.integers(4))
    if way == 0:
        content = content[: int(rng.integers(len(content)))]
    elif way == 1 and not name.endswith((".h5", ".npy")):
        at = int(rng.integers(len(content)))
        content[at:at] = pick(rng, PIECES)
    else:
        for _ in range(int(rng.integers(1, 5))):
            content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))

    def call():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.write_bytes(content)
            return use_file(path)

    return call


def use_file(path):
    if path.name == "measured.csv":
        found = ca.read_measurements(path)
        return [found.hold_times, found.values]
    if path.name in ("barriers.txt", "samples.csv"):
        return ca.barriers("tabulated", path=str(path)).quantile(np.array([0.1, 0.5, 0.9]))
    if path.suffix == ".toml":
        return use_scene(ca.load_scene(path).todict())
    return use_surface(ca.surface("from-file", path=str(path), pixel_size=0.5).make())


FAMILIES = [records, records, components, components, engines, engines, functions, scenes, files, files]


# -- judging -----------------------------------------------------------------------------------------------------------


def nonsense(value, where="answer"):
    """Where a number in an answer is not finite; "" if all are."""
    if isinstance(value, ca.plugin.BondHistory):
        if fault := value.fault():
            return f"{where}: {fault}"
        return ""
    if isinstance(value, float | np.floating):
        return "" if math.isfinite(value) else f"{where}: {value}"
    if isinstance(value, np.ndarray):
        finite = value.dtype.kind not in "fc" or np.isfinite(value).all()
        return "" if finite else f"{where}: an array that is not finite"
    if isinstance(value, dict):
        found = (nonsense(item, f"{where}.{name}") for name, item in value.items())
        return next(filter(None, found), "")
    if isinstance(value, list | tuple):
        return next(filter(None, (nonsense(item, f"{where}.{at}") for at, item in enumerate(value))), "")
    known = ca.Surface | ca.ReactionLattice | ca.ContactSolution | ca.Ageing
    fields = value.todict() if isinstance(value, known) else {}
    return nonsense({name: item for name, item in fields.items() if isinstance(item, np.ndarray)}, where)


def case(number):
    """The name of case ``number`` and its call."""
    rng = np.random.default_rng([20260101, number])
    family = FAMILIES[number % len(FAMILIES)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of making damaged arrays
        return family.__name__, family(rng)


def judge(number):
    """What is wrong with the end of case ``number``; "" if nothing."""
    name, call = case(number)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            answer = call()
    except ca.ChemageError as error:
        return "" if 0 < len(str(error)) < 20_000 else f"{name}: a message of {len(str(error))} characters"
    except BaseException:
        return f"{name}: {traceback.format_exc(limit=-6)}"
    found = nonsense(answer)
    return f"{name}: {found}" if found else ""


def main(first, last):
    os.environ.setdefault("CHEMAGE_MEMORY", "4 MB")
    for kind in ENGINES:  # compiles its kernels, where that has not been done before
        history(kind)
    for number in range(first, last):
        print(json.dumps({"begin": number}), flush=True)
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        if wrong := judge(number):
            print(json.dumps({"number": number, "wrong": wrong}), flush=True)
    print(json.dumps({"done": last}), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
