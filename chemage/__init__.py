"""chemage: chemical ageing of frictional contacts.

scene → surface → contact → reaction lattice → kinetics → ageing → store → plots. The names below are the public ones;
each is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from chemage.ageing import age as age
    from chemage.compare import compare_files as compare_files
    from chemage.hookspecs import hookimpl as hookimpl
    from chemage.measured import fit_aging as fit_aging
    from chemage.measured import read_measurements as read_measurements
    from chemage.objects import Aging as Aging
    from chemage.objects import BondHistory as BondHistory
    from chemage.objects import ContactSolution as ContactSolution
    from chemage.objects import Fit as Fit
    from chemage.objects import ReactionLattice as ReactionLattice
    from chemage.objects import Surface as Surface
    from chemage.objects import hold_times as hold_times
    from chemage.pipeline import build_lattice as build_lattice
    from chemage.pipeline import make_surface as make_surface
    from chemage.pipeline import run_kinetics as run_kinetics
    from chemage.pipeline import solve_contact as solve_contact
    from chemage.reactions import Chemistry as Chemistry
    from chemage.reactions import chemistry as chemistry
    from chemage.registry import barriers as barriers
    from chemage.registry import contact as contact
    from chemage.registry import engine as engine
    from chemage.registry import fromdict as fromdict
    from chemage.registry import interaction as interaction
    from chemage.registry import observable as observable
    from chemage.registry import surface as surface
    from chemage.report import write_report as write_report
    from chemage.results import Run as Run
    from chemage.runs import run as run
    from chemage.scene import Scene as Scene
    from chemage.scene import load_scene as load_scene
    from chemage.store import read as read
    from chemage.store import write as write
    from chemage.sweeps import SweepResult as SweepResult
    from chemage.sweeps import load_sweep as load_sweep
    from chemage.sweeps import sweep as sweep

_HOME = {
    **dict.fromkeys(("Chemistry", "chemistry"), "reactions"),
    "compare_files": "compare",
    "age": "ageing",
    "hookimpl": "hookspecs",
    **dict.fromkeys(("fit_aging", "read_measurements"), "measured"),
    "write_report": "report",
    **dict.fromkeys(
        ("Aging", "BondHistory", "ContactSolution", "Fit", "ReactionLattice", "Surface", "hold_times"), "objects"
    ),
    **dict.fromkeys(("build_lattice", "make_surface", "run_kinetics", "solve_contact"), "pipeline"),
    **dict.fromkeys(("barriers", "contact", "engine", "fromdict", "interaction", "observable", "surface"), "registry"),
    "Run": "results",
    "run": "runs",
    **dict.fromkeys(("Scene", "load_scene"), "scene"),
    **dict.fromkeys(("read", "write"), "store"),
    **dict.fromkeys(("SweepResult", "load_sweep", "sweep"), "sweeps"),
}

__all__ = ["__version__", *sorted(_HOME)]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module 'chemage' has no attribute {name!r}")
    value = getattr(import_module(f"chemage.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
