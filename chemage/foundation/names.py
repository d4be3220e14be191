"""The version, and the public names: of ``chemage``, for users, and of ``chemage.plugin``, for authors of plugins."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from inspect import isgeneratorfunction, unwrap
from pkgutil import resolve_name
from types import FunctionType
from typing import Any

__version__ = "0.2.0"


#: the names that users need, which ``chemage`` has; all others below are in ``chemage.plugin``
_USERS = (
    "surface make_surface Surface contact contact_modulus solve_contact ContactSolution open_maps "
    "barriers interaction chemistry Chemistry ReactionLattice engine hold_times rupture pulling observable "
    "ageing_method "
    "age Ageing fit_ageing arrhenius Measurements read_measurements read write write_report compare_files "
    "Scene load_scene parse_scene material run Run sweep SweepResult load_sweep collect_sweep ensemble Ensemble "
    "ChemageError InputError PlanWarning errors "
    "plugin_options prefer_plugins register unregister plugin testing"
)
USERS = frozenset(_USERS.split())
#: module -> its public names
NAMES = {
    "ageing.age": "age",
    "ageing.ageing": "Ageing",
    "results.arrhenius": "ActivationEnergy Arrhenius arrhenius",
    "ageing.fitting": "FIT_WINDOW Fit fit_ageing",
    "foundation.checks": "hold_times Seed check_times checked_count checked_seed checked_states force "
    "temperature_value",
    "ageing.columns": "read_columns",
    "ageing.covariance": "correlated_errors",
    "ageing.measurements": "Measurements read_measurements read_table",
    "ageing.methods": "AgedBonds AgedReplica AgeingMethod AgeingRequest Kinetics Origin ageing_method",
    "ageing.observables": "Maps Observable Observed PlottedResult observable",
    "contacts.options": "ContactModulus contact_modulus",
    "contacts.patches": "label_patches",
    "contacts.role": "ContactSolver contact solve_contact",
    "contacts.solution": "ContactSolution ContactStatistics",
    "contacts.theory": "ContactTheory",
    "studies.ensembles.ensemble": "Ensemble",
    "studies.ensembles.running": "ensemble",
    "scene.materials": "Material MaterialValue material",
    "scene.provenance": "versions",
    "scene.plan": "plan",
    "scene.run": "Run ageing_of contact_of run surface_of",
    "scene.scene": "Scene",
    "scene.files": "load_scene override parse_scene scene_data value_at",
    "foundation.kernels": "kernel",
    "foundation.machine": "cache_folder",
    "foundation.outputs": "Output record",
    "foundation.quantities": "Curve ErrorPart Estimate Quantity Rank",
    "foundation.records": "Doubles Flags Indices Named Plain PositiveNumber Record content_hash file_hash",
    "foundation.components": "Component",
    "foundation.errors": "ChemageError ConvergenceError DamagedError ExecutorError InputError PlanWarning PluginError "
    "SceneError StoreError UnitError UnknownKindError WorkerLost nearest",
    "foundation.files": "FileStamp file_stamp fresh_file open_file preflight regular_file write_file",
    "foundation.result": "Comparable OfRecord Panel Picture Result Table displays result_of",
    "foundation.units": "EV_PER_GPA_NM3 Energy FilePath Force Frequency KB Length Pressure Temperature Time Unit "
    "Volume array_in convert",
    "friction.pulling": "Drive Partners PullHistory Pulling partners_of pull pulling",
    "friction.role": "Bonded Rupture RuptureForce rupture rupture_bonds",
    "kinetics.history": "BondHistory Followed counters_of",
    "kinetics.role": "Engine Ramp engine run_kinetics",
    "lattices.chemistry": "Chemistry chemistry contact_statistics coordination barriers build_lattice interaction",
    "lattices.independent": "TwoState",
    "lattices.lattice": "ABSENT ReactionLattice",
    "lattices.role": "Barriers Interaction",
    "lattices.site_grid": "SITE_POSITIONS ContactSites contact_sites",
    "plugins.hooks": "API_VERSION Doubt Stage StageInputs hookimpl lazy_attributes",
    "plugins.options": "Choice PluginOptions plugin_options prefer_plugins",
    "plugins.registry": "fromdict register unregister",
    "results.comparison": "compare_files",
    "results.decisions": "ClaimTest Limits",
    "results.page": "write_report",
    "results.files": "open_maps read write",
    "surfaces.reading": "HeightMap Reader reader_for",
    "surfaces.role": "CONTINUATIONS Scatter SurfaceMaker make_surface surface",
    "surfaces.surface": "Roughness Surface",
    "studies.study": "Design carry_out",
    "studies.tasks": "Outcome Task Worker",
    "studies.trade": "TradeMap TradePoint",
    "studies.sweeps.grid": "scenes_of",
    "studies.sweeps.result": "Collected Point SweepResult collect_sweep load_sweep",
    "studies.sweeps.running": "sweep",
}
#: public name -> the module it is in
HOME = {name: module for module, names in NAMES.items() for name in names.split()}
#: role -> the function that makes a component of it, where a module has the name of the role
FACTORIES = {"ageing": "ageing_method"}
#: the module that knows what shows the results of chemage
PICTURES = "results.kinds"
#: public modules -> their full name
MODULES = {
    "algebra": "foundation.algebra",
    "completion": "cli.completion",
    "decisions": "results.decisions",
    "drawing": "results.drawing",
    "container": "foundation.container",
    "options": "cli.options",
    "output": "cli.output",
    "memory": "foundation.memory",
    "progress": "foundation.progress",
    "statistics": "foundation.statistics",
    "steadiness": "foundation.steadiness",
    "tables": "foundation.tables",
    "text": "foundation.text",
    "errors": "foundation.errors",
    "figures": "foundation.figures",
    "looks": "foundation.looks",
    "patches": "contacts.patches",
    "plugin": "plugin",
    "random": "foundation.random",
    "registry": "plugins.registry",
    "roughness": "surfaces.roughness",
    "testing": "testing",
    "theory": "contacts.theory",
    "threads": "foundation.threads",
    "units": "foundation.units",
}


def spelling(cls: Any, everywhere: bool) -> str:
    """How data name the kind of a component's class: so that it is read as that class here, or ``everywhere``.

    The registry of plugins, which knows whose it is, puts its own function here.
    """
    return cls.kind


@cache
def load(name: str, target: str = "") -> Any:
    """The object, or the module, with this public name, or the ``target`` (``"module:object"``) of a plugin; a function
    or class for which a wrong argument is one error."""
    if name in MODULES:
        return import_module(f"chemage.{MODULES[name]}")
    value = resolve_name(target or f"chemage.{HOME[name]}:{name}")
    if isinstance(value, FunctionType) or hasattr(value, "cache_info"):
        return _checked(name, value)
    if isinstance(value, type) and isinstance(
        vars(value).get("__init__"), FunctionType
    ):
        value.__init__ = _checked(name, value.__init__)  # pyright: ignore[reportAttributeAccessIssue]
    return value


def _checked(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """``function``; where it fails because an argument is not what its annotation says, the error is an InputError that
    names the argument."""

    of_block = isgeneratorfunction(unwrap(function))  # which fails after this call

    @wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        try:
            if of_block:
                _blame(function, args, kwargs)
            return function(*args, **kwargs)
        except Exception as error:
            if type(error).__module__.startswith("chemage."):
                raise
            _blame(function, args, kwargs)
            if isinstance(error, OSError) and error.strerror:
                from chemage.foundation.errors import StoreError, shortened

                raise StoreError(
                    f"{shortened(error.filename)}: {error.strerror}"
                ) from error
            raise

    checked.__module__ = (
        "chemage.plugin" if name in HOME and name not in USERS else "chemage"
    )  # where pickle finds it
    return checked


def _blame(
    function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> None:
    from chemage.foundation.checks import check_arguments

    check_arguments(function, args, kwargs)
