"""What all tests share."""

from __future__ import annotations

import functools
import gc
import importlib
import importlib.util
import itertools
import os
import random
import signal
import sys
from importlib import metadata
from pathlib import Path
from textwrap import dedent
from typing import NamedTuple

import numpy as np
import pytest
import typer
from hypothesis import HealthCheck, settings

import chemage
from chemage.plugin import registry
from chemage.testing import isolated_registry as isolated_registry

# the same examples on every run: a test that fails does so for everyone, and one that passes stays passed
settings.register_profile(
    "chemage",
    derandomize=True,
    deadline=None,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("chemage")
settings.register_profile("chemage-long", settings.get_profile("chemage"), max_examples=60)


# few cycles are made, and looking for them among a million objects takes a tenth of the time
gc.set_threshold(100_000, 20, 50)

# What the user has set or installed beside chemage is no part of a test, but for the place of kernels.
for name in [name for name in os.environ if name.startswith("CHEMAGE_") or name == "COLUMNS"]:
    if name not in ("CHEMAGE_BASELINES", "CHEMAGE_CACHE"):
        del os.environ[name]
strangers = [point.name for point in metadata.entry_points(group=registry.GROUP) if point.dist.name != "chemage"]
if strangers:
    os.environ["CHEMAGE_PLUGINS"] = ",".join(f"-{name}" for name in strangers)

# Started in the background, a shell has Ctrl-C ignored, and every program the tests start would inherit that.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="run also what is marked long (minutes)")
    parser.addoption("--random-order", type=int, metavar="SEED", help="files, and tests in each, in a random order")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    # neighbours stay in one process, which computes and compiles once what they share
    if getattr(config.option, "numprocesses", None) and config.option.dist == "no":
        config.option.dist = "worksteal"


def pytest_configure(config):
    if config.getoption("long"):
        settings.load_profile("chemage-long")


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Every second worker collects from the end: each rewrites the assertions of a half of the files, and both read them
    all."""
    report = yield
    if isinstance(collector, pytest.Directory) and worker_number() % 2:
        report.result.reverse()
    return report


def worker_number():
    return int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    if "PYTEST_XDIST_WORKER" in os.environ:
        # workers must agree on the order in which they number the tests
        items.sort(key=lambda item: item.path)
    if (seed := config.getoption("random_order")) is not None:
        draw = random.Random(seed).random
        files = {item.path: draw() for item in items}
        items.sort(key=lambda item: (files[item.path], draw()))
    if config.getoption("long"):
        return
    config.hook.pytest_deselected(items=list(filter(takes_long, items)))
    items[:] = itertools.filterfalse(takes_long, items)


def takes_long(item):
    return any(map(item.get_closest_marker, ("long", "campaign")))


def pytest_collection_finish():
    # what was imported stays: the garbage collector need not look at it again and again
    gc.collect()
    gc.freeze()
    # modules that tests write anew leave no bytecode behind that a later import would take for that of the new text
    sys.dont_write_bytecode = True


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes():
    # workers share the processors, so that threads of a BLAS library in each would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session):
    """Before a large run on several workers, each compiles a part of the kernels."""
    worker, workers = os.environ.get("PYTEST_XDIST_WORKER"), int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if worker and workers > 1 and len(session.items) > 1000:
        import compiled

        compiled.share(int(worker.removeprefix("gw")), workers)


@pytest.fixture(autouse=True, scope="session")
def quick_figures():
    """Where no test looks at figures, they are drawn coarsely and their parts are not arranged: both take long."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    from chemage.plugin import figures

    usual = ConstrainedLayoutEngine.execute, figures.panels.__kwdefaults__["dpi"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConstrainedLayoutEngine, "execute", lambda self, figure: None)
        patch.setitem(figures.panels.__kwdefaults__, "dpi", 40)
        yield usual


@pytest.fixture(autouse=True)
def usual_figures(request, quick_figures):
    """As users see them, for a test or a module that is marked as ``drawn``."""
    if not request.node.get_closest_marker("drawn"):
        yield
        return
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    from chemage.plugin import figures

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConstrainedLayoutEngine, "execute", quick_figures[0])
        patch.setitem(figures.panels.__kwdefaults__, "dpi", quick_figures[1])
        yield


@pytest.fixture(autouse=True, scope="session")
def no_speed():
    """Estimates are those of the reference machine and checks wait for hours: no test depends on the speed of this."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("chemage.scene.plan.slowness", lambda: 1.0)
        for module in ("checks", "answers"):
            patch.setattr(f"chemage.testing.{module}.LIMIT", 3600.0)
        # no power fails during the tests
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="module")
def few_choices():
    """Maps of speed and accuracy without methods of ageing that make a table first, which takes seconds, and without
    contact solvers of libraries that may be installed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("chemage_trade.result.PREPARATION", 0.0)
        for library in ("tamaas", "ContactMechanics"):
            patch.setitem(sys.modules, library, None)
        yield


class Site:
    """A folder of installed distributions, as pip would leave it."""

    def __init__(self, folder):
        self.folder = folder
        self.names = []

    def install(self, name, files, entry_points=None, version="1.0"):
        """Write the distribution ``name``: ``files`` are path -> source, ``entry_points`` name -> module."""
        for path, text in files.items():
            file = self.folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(dedent(text), encoding="utf-8")
            # of a module written twice in one second with equal length, Python would run the bytecode of the first
            Path(importlib.util.cache_from_source(str(file))).unlink(missing_ok=True)
        info = self.folder / f"{name.replace('-', '_')}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        points = "".join(f"{key} = {value}\n" for key, value in (entry_points or {}).items())
        (info / "entry_points.txt").write_text(f"[chemage]\n{points}")
        self.names.append(name)
        importlib.invalidate_caches()

    def registry(self, **options):
        """A registry of what was installed here, without chemage's own plugins."""
        points = metadata.entry_points(group=registry.GROUP)
        return registry.Registry([p for p in points if p.dist is not None and p.dist.name in self.names], **options)


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder on the import path in which distributions can be installed for one test."""
    registry.current()  # is found before
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    yield Site(folder)
    for name, module in list(sys.modules.items()):
        if str(folder) in (getattr(module, "__file__", None) or ""):
            del sys.modules[name]
    importlib.invalidate_caches()


#: a whole experiment that takes a tenth of a second
SMALL = """
name = "small"
title = "A small rough contact"

[surface]
kind = "self-affine"
pixels = 48
pixel_size = "0.4518 nm"
rms_slope = 0.1
hurst = 0.8
zeta = 8
eta = 3
seed = 1

[contact]
kind = "fft-bem"
modulus = "35.3 GPa"
load = "40 nN"

[forming]
kind = "md-silica"

[breaking]
kind = "gaussian"
mean = "1.1 eV"
std = "0.02 eV"

[interaction]
kind = "elastic-pairs"
strength = "0.5 eV"
bias = 0.1

[chemistry]
activation_volume = "6.4 angstrom**3"

[engine]
kind = "rejection-free"

[hold]
start = "1 ms"
stop = "1e5 s"
per_decade = 2
replicas = 3
seed = 5

[[observe]]
kind = "barrier-spectrum"
"""


@pytest.fixture(scope="session")
def small_text():
    """The text of a small whole scene."""
    return SMALL


@pytest.fixture
def small(tmp_path, monkeypatch):
    """The file of a small whole scene, in an empty working folder."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    file = folder / "small.toml"
    file.write_text(SMALL, encoding="utf-8")
    return file


class Outcome(NamedTuple):
    """What a command left behind."""

    status: int
    out: str
    err: str


parameters_of = functools.cache(typer.main.get_params_from_function)


@pytest.fixture
def command(monkeypatch, capsys):
    """``command("run", "scene.toml", ...)``: the command line, in this process."""
    from chemage.cli import app as command_line

    def leave(status):
        raise SystemExit(status)

    monkeypatch.setattr(command_line.app, "registered_commands", list(command_line.app.registered_commands))
    monkeypatch.setattr(command_line.os, "_exit", leave)
    # a busy machine says nothing of loading
    monkeypatch.setattr("chemage.foundation.progress.LOADING", 1e5)
    # each test adds the commands of plugins again, and the parameters of the others are the same
    monkeypatch.setattr("typer.main.get_params_from_function", parameters_of)
    # the first kernel that a command compiles starts no processes that compile all others
    monkeypatch.setattr("chemage.foundation.compiling.begin", lambda *_: {})

    def call(*words):
        capsys.readouterr()
        monkeypatch.setattr(sys, "argv", ["chemage", *map(str, words)])
        with pytest.raises(SystemExit) as stop:
            command_line.main()
        printed = capsys.readouterr()
        return Outcome(stop.value.code, printed.out, printed.err)

    return call


class Tiny:
    """An installed plugin with a whole experiment of a millisecond, which logs what it computes."""

    def __init__(self, folder):
        self._log, self._hold = folder / "computed.log", folder / "hold"

    def scene(self, **sections):
        """Scene data; ``sections`` replace or add whole sections."""
        return {
            "name": "tiny",
            "surface": {"kind": "tiny-tip"},
            "contact": {"kind": "tiny-even", "load": 10.0},
            "forming": {"kind": "tiny-flat"},
            "chemistry": {"site_density": "pixel"},
            "engine": {"kind": "tiny-coin"},
            "hold": {"times": [1.0, 10.0, 100.0, 1000.0], "replicas": 2},
            "fit": {"start": 1.0, "stop": 1e3},
            **sections,
        }

    def computed(self, stage=""):
        """Log lines of a stage (surface, contact, kinetics), in any process, since the last :meth:`forget`."""
        lines = self._log.read_text().splitlines() if self._log.exists() else []
        return [line for line in lines if line.startswith(stage)]

    def forget(self):
        """Start a new log."""
        self._log.unlink(missing_ok=True)

    def hold(self, replicas, seconds=0.0):
        """Let that many replicas (of the log) be computed at once, and each further one wait; None: none waits."""
        if replicas is None:
            self._hold.unlink(missing_ok=True)
        else:
            self._hold.write_text(f"{replicas} {seconds}")


@pytest.fixture
def tiny(site, tmp_path, monkeypatch):
    """The plugin ``tests/stubs/chemage_tiny.py``, installed for this test, here and in every process started here."""
    source = (Path(__file__).parent / "stubs" / "chemage_tiny.py").read_text(encoding="utf-8")
    site.install("chemage-tiny", {"chemage_tiny.py": source}, {"tiny": "chemage_tiny"})
    monkeypatch.setenv("PYTHONPATH", str(site.folder), prepend=os.pathsep)
    made = Tiny(tmp_path)
    monkeypatch.setenv("CHEMAGE_TINY_LOG", str(tmp_path / "computed.log"))
    monkeypatch.setenv("CHEMAGE_TINY_HOLD", str(tmp_path / "hold"))
    with registry.using(site.registry()):
        yield made


class Examples:
    """A record of each kind, with some fields changed."""

    @staticmethod
    def surface(**changes):
        heights = np.arange(12.0).reshape(3, 4)
        return chemage.Surface(**{"heights": heights, "pixel_size": 0.5, "provenance": {"kind": "ramp"}, **changes})

    @staticmethod
    def contact(**changes):
        pressure = np.zeros((4, 5))
        pressure[1, 1:3] = 2.0, 4.0
        pressure[3, 0] = 6.0
        return chemage.ContactSolution(
            **{"pressure": pressure, "load": 3.0, "pixel_size": 0.5, "modulus": 10.0, **changes}
        )

    @staticmethod
    def lattice(**changes):
        fields = {
            "pixels": (3, 3),
            "sites": [1, 4, 7],
            "forming": [0.8, 0.9, 1.0],
            "breaking": [1.1, 1.1, 1.2],
            "neighbours": [[1, -1], [0, 2], [1, -1]],
            "coupling": [[0.1, 0.0], [0.1, -0.2], [-0.2, 0.0]],
            "pixel_size": 0.45,
        }
        return chemage.ReactionLattice(**{**fields, **changes})

    @staticmethod
    def history(**changes):
        fields = {
            "hold_times": [1.0, 10.0],
            "bonds": [1, 2],
            "formed": [2, 4],
            "broken": [1, 2],
            "state": [True, False, True],
            "time": 10.0,
            "temperature": 300.0,
            "engine": "by-hand",
            "resume": {"words": np.array([3], np.uint64)},
        }
        return chemage.plugin.BondHistory(**{**fields, **changes})

    @staticmethod
    def ageing(**changes):
        fields = {
            "hold_times": [1.0, 10.0, 100.0],
            "bonds": [[10, 20, 30], [12, 24, 30]],
            "sites": [50, 50],
            "events": [40, 44],
            "load": 60.0,
            "temperature": 300.0,
            "engine": "by-hand",
            "observables": {"x": np.array([[1.0], [2.0]])},
        }
        return chemage.Ageing(**{**fields, **changes})


@pytest.fixture(scope="session")
def examples():
    """``examples.surface(pixel_size=2.0)`` and so on: small records of plain arrays."""
    return Examples
