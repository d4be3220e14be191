"""chemage: chemical ageing of frictional contacts.

scene → surface → contact → reaction lattice → kinetics → ageing → store → report. The names below are the public ones,
for users and for plugins; each is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.foundation.version import __version__ as __version__

if TYPE_CHECKING:
    from chemage import testing as testing
    from chemage.ageing.age import age as age
    from chemage.ageing.aging import Aging as Aging
    from chemage.ageing.fitting import FIT_WINDOW as FIT_WINDOW
    from chemage.ageing.fitting import Fit as Fit
    from chemage.ageing.fitting import fit_aging as fit_aging
    from chemage.ageing.hold_times import hold_times as hold_times
    from chemage.ageing.measurements import Measurements as Measurements
    from chemage.ageing.measurements import read_measurements as read_measurements
    from chemage.ageing.observables import Observable as Observable
    from chemage.ageing.observables import Observed as Observed
    from chemage.ageing.observables import observable as observable
    from chemage.contacts import theory as theory
    from chemage.contacts.patches import label_patches as label_patches
    from chemage.contacts.role import ContactSolver as ContactSolver
    from chemage.contacts.solution import ContactSolution as ContactSolution
    from chemage.contacts.stage import contact as contact
    from chemage.contacts.stage import solve_contact as solve_contact
    from chemage.experiments.provenance import versions as versions
    from chemage.experiments.run import Run as Run
    from chemage.experiments.run import run as run
    from chemage.experiments.scene import Scene as Scene
    from chemage.experiments.scene import parse_scene as parse_scene
    from chemage.experiments.scene_files import load_scene as load_scene
    from chemage.experiments.scene_files import override as override
    from chemage.experiments.scene_files import scene_data as scene_data
    from chemage.foundation import errors as errors
    from chemage.foundation import random as random
    from chemage.foundation import threads as threads
    from chemage.foundation import units as units
    from chemage.foundation.checks import Seed as Seed
    from chemage.foundation.checks import check_times as check_times
    from chemage.foundation.checks import checked_seed as checked_seed
    from chemage.foundation.checks import force as force
    from chemage.foundation.checks import temperature_value as temperature_value
    from chemage.foundation.components import Component as Component
    from chemage.foundation.errors import ChemageError as ChemageError
    from chemage.foundation.errors import ConvergenceError as ConvergenceError
    from chemage.foundation.errors import ExecutorError as ExecutorError
    from chemage.foundation.errors import InputError as InputError
    from chemage.foundation.errors import PluginError as PluginError
    from chemage.foundation.errors import SceneError as SceneError
    from chemage.foundation.errors import StoreError as StoreError
    from chemage.foundation.errors import UnitError as UnitError
    from chemage.foundation.errors import UnknownKindError as UnknownKindError
    from chemage.foundation.errors import WorkerLost as WorkerLost
    from chemage.foundation.files import fresh_file as fresh_file
    from chemage.foundation.files import preflight as preflight
    from chemage.foundation.messages import nearest as nearest
    from chemage.foundation.units import EV_PER_GPA_NM3 as EV_PER_GPA_NM3
    from chemage.foundation.units import KB as KB
    from chemage.foundation.units import Energy as Energy
    from chemage.foundation.units import Force as Force
    from chemage.foundation.units import Frequency as Frequency
    from chemage.foundation.units import Length as Length
    from chemage.foundation.units import Pressure as Pressure
    from chemage.foundation.units import Temperature as Temperature
    from chemage.foundation.units import Time as Time
    from chemage.foundation.units import Unit as Unit
    from chemage.foundation.units import Volume as Volume
    from chemage.foundation.units import convert as convert
    from chemage.kinetics.history import BondHistory as BondHistory
    from chemage.kinetics.role import Engine as Engine
    from chemage.kinetics.stage import engine as engine
    from chemage.kinetics.stage import run_kinetics as run_kinetics
    from chemage.lattices.chemistry import Chemistry as Chemistry
    from chemage.lattices.chemistry import chemistry as chemistry
    from chemage.lattices.lattice import ReactionLattice as ReactionLattice
    from chemage.lattices.role import Barriers as Barriers
    from chemage.lattices.role import Interaction as Interaction
    from chemage.lattices.stage import barriers as barriers
    from chemage.lattices.stage import build_lattice as build_lattice
    from chemage.lattices.stage import interaction as interaction
    from chemage.plugins import registry as registry
    from chemage.plugins.hooks import hookimpl as hookimpl
    from chemage.plugins.registry import fromdict as fromdict
    from chemage.reports import figures as figures
    from chemage.reports.comparison.comparison import compare_files as compare_files
    from chemage.reports.page import write_report as write_report
    from chemage.store.results import read as read
    from chemage.store.results import write as write
    from chemage.surfaces import roughness as roughness
    from chemage.surfaces.reading import Reader as Reader
    from chemage.surfaces.reading import reader_for as reader_for
    from chemage.surfaces.role import SurfaceMaker as SurfaceMaker
    from chemage.surfaces.stage import make_surface as make_surface
    from chemage.surfaces.stage import surface as surface
    from chemage.surfaces.surface import Surface as Surface
    from chemage.sweeps.result import Point as Point
    from chemage.sweeps.result import SweepResult as SweepResult
    from chemage.sweeps.result import load_sweep as load_sweep
    from chemage.sweeps.running import sweep as sweep

#: public name -> the module it is in
_HOME = {
    "age": "ageing.age",
    "Aging": "ageing.aging",
    **dict.fromkeys(("FIT_WINDOW", "Fit", "fit_aging"), "ageing.fitting"),
    "hold_times": "ageing.hold_times",
    **dict.fromkeys(("Measurements", "read_measurements"), "ageing.measurements"),
    **dict.fromkeys(("Observable", "Observed", "observable"), "ageing.observables"),
    "label_patches": "contacts.patches",
    "ContactSolver": "contacts.role",
    "ContactSolution": "contacts.solution",
    **dict.fromkeys(("contact", "solve_contact"), "contacts.stage"),
    "versions": "experiments.provenance",
    **dict.fromkeys(("Run", "run"), "experiments.run"),
    **dict.fromkeys(("Scene", "parse_scene"), "experiments.scene"),
    **dict.fromkeys(("load_scene", "override", "scene_data"), "experiments.scene_files"),
    **dict.fromkeys(("Seed", "check_times", "checked_seed", "force", "temperature_value"), "foundation.checks"),
    "Component": "foundation.components",
    **dict.fromkeys(
        (
            "ChemageError",
            "ConvergenceError",
            "ExecutorError",
            "InputError",
            "PluginError",
            "SceneError",
            "StoreError",
            "UnitError",
            "UnknownKindError",
            "WorkerLost",
        ),
        "foundation.errors",
    ),
    **dict.fromkeys(("fresh_file", "preflight"), "foundation.files"),
    "nearest": "foundation.messages",
    **dict.fromkeys(
        (
            "EV_PER_GPA_NM3",
            "Energy",
            "Force",
            "Frequency",
            "KB",
            "Length",
            "Pressure",
            "Temperature",
            "Time",
            "Unit",
            "Volume",
            "convert",
        ),
        "foundation.units",
    ),
    "BondHistory": "kinetics.history",
    "Engine": "kinetics.role",
    **dict.fromkeys(("engine", "run_kinetics"), "kinetics.stage"),
    **dict.fromkeys(("Chemistry", "chemistry"), "lattices.chemistry"),
    "ReactionLattice": "lattices.lattice",
    **dict.fromkeys(("Barriers", "Interaction"), "lattices.role"),
    **dict.fromkeys(("barriers", "build_lattice", "interaction"), "lattices.stage"),
    "hookimpl": "plugins.hooks",
    "fromdict": "plugins.registry",
    "compare_files": "reports.comparison.comparison",
    "write_report": "reports.page",
    **dict.fromkeys(("read", "write"), "store.results"),
    **dict.fromkeys(("Reader", "reader_for"), "surfaces.reading"),
    "SurfaceMaker": "surfaces.role",
    **dict.fromkeys(("make_surface", "surface"), "surfaces.stage"),
    "Surface": "surfaces.surface",
    **dict.fromkeys(("Point", "SweepResult", "load_sweep"), "sweeps.result"),
    "sweep": "sweeps.running",
}
#: public modules -> their full name
_MODULES = {
    "errors": "foundation.errors",
    "figures": "reports.figures",
    "random": "foundation.random",
    "registry": "plugins.registry",
    "roughness": "surfaces.roughness",
    "testing": "testing",
    "theory": "contacts.theory",
    "threads": "foundation.threads",
    "units": "foundation.units",
}

__all__ = ["__version__", *sorted(_HOME), *sorted(_MODULES)]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name in _MODULES:
        value: Any = import_module(f"chemage.{_MODULES[name]}")
    elif name in _HOME:
        value = getattr(import_module(f"chemage.{_HOME[name]}"), name)
    else:
        raise AttributeError(f"module 'chemage' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
