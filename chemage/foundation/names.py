"""The public names: those of ``chemage``, for users, and those of ``chemage.plugin``, for authors of plugins."""

from __future__ import annotations

from importlib import import_module
from typing import Any

#: the names that users need, which ``chemage`` has; all others below are in ``chemage.plugin``
_USERS = (
    "surface make_surface Surface contact contact_modulus solve_contact ContactSolution open_maps "
    "barriers interaction chemistry Chemistry ReactionLattice engine hold_times rupture observable ageing_method "
    "age Aging fit_aging arrhenius Measurements read_measurements read write write_report compare_files "
    "Scene load_scene parse_scene material run Run sweep SweepResult load_sweep collect_sweep ensemble Ensemble "
    "infer Inference MeasuredCurve read_curves ChemageError InputError PlanWarning errors "
    "plugin_options prefer_plugins register unregister plugin testing"
)
USERS = frozenset(_USERS.split())
#: module -> its public names
NAMES = {
    "ageing.age": "age",
    "ageing.aging": "Aging",
    "studies.arrhenius": "ActivationEnergy Arrhenius",
    "ageing.fitting": "FIT_WINDOW Fit fit_aging",
    "ageing.hold_times": "hold_times",
    "ageing.measurements": "Measurements read_measurements",
    "ageing.methods": "AgedBonds AgeingMethod AgeingRequest ageing_method",
    "ageing.observables": "Observable observable",
    "ageing.outputs": "Output",
    "ageing.plotted": "Maps Observed PlottedResult",
    "contacts.modulus": "ContactModulus contact_modulus",
    "contacts.patches": "label_patches",
    "contacts.role": "ContactSolver",
    "contacts.solution": "ContactSolution",
    "contacts.statistics": "ContactStatistics",
    "contacts.theories": "ContactTheory",
    "contacts.stage": "contact solve_contact",
    "studies.ensembles.ensemble": "Ensemble ErrorPart Estimate",
    "studies.ensembles.running": "ensemble",
    "scene.materials": "Material MaterialValue material",
    "scene.provenance": "versions",
    "scene.run": "Run run",
    "scene.scene": "Scene parse_scene",
    "scene.scene_files": "load_scene override scene_data",
    "foundation.checks": "Seed check_times checked_count checked_seed checked_states force temperature_value",
    "foundation.components": "Component",
    "foundation.errors": "ChemageError ConvergenceError DamagedError ExecutorError InputError PluginError "
    "SceneError StoreError UnitError UnknownKindError WorkerLost",
    "foundation.files": "fresh_file preflight",
    "foundation.inputs": "regular_file",
    "foundation.messages": "nearest",
    "foundation.warned": "PlanWarning",
    "foundation.units": "EV_PER_GPA_NM3 Energy Force Frequency KB Length Pressure Temperature Time Unit Volume convert",
    "friction.bonded": "Bonded",
    "friction.force": "RuptureForce",
    "friction.role": "Rupture",
    "friction.stage": "rupture rupture_bonds",
    "inference.curves": "MeasuredCurve read_curves",
    "inference.forecast": "Forecast",
    "inference.infer": "infer",
    "inference.inference": "Inference",
    "inference.unexplained": "UnexplainedError",
    "kinetics.history": "BondHistory",
    "kinetics.role": "Engine",
    "kinetics.stage": "engine run_kinetics",
    "lattices.chemistry": "Chemistry chemistry",
    "lattices.lattice": "ReactionLattice",
    "lattices.role": "Barriers Interaction",
    "lattices.site_grid": "ContactSites contact_sites",
    "lattices.statistics": "contact_statistics coordination",
    "lattices.stage": "barriers build_lattice interaction",
    "plugins.choices": "Choice",
    "plugins.hooks": "API_VERSION hookimpl",
    "plugins.options": "PluginOptions",
    "plugins.registry": "fromdict register unregister",
    "plugins.settings": "plugin_options prefer_plugins",
    "results.arrhenius": "arrhenius",
    "results.comparison.comparison": "compare_files",
    "results.page": "write_report",
    "results.maps": "open_maps",
    "results.files": "read write",
    "surfaces.height_map": "HeightMap",
    "surfaces.measures": "Roughness",
    "surfaces.reading": "Reader reader_for",
    "surfaces.role": "SurfaceMaker",
    "surfaces.scatter": "Scatter",
    "surfaces.stage": "make_surface surface",
    "surfaces.surface": "Surface",
    "studies.sweeps.collecting": "Collected collect_sweep",
    "studies.sweeps.result": "Point SweepResult load_sweep",
    "studies.sweeps.running": "sweep",
}
#: public name -> the module it is in
HOME = {name: module for module, names in NAMES.items() for name in names.split()}
#: role -> the function that makes a component of it, where a module has the name of the role
FACTORIES = {"ageing": "ageing_method"}
#: the module that draws results in notebooks
PICTURES = "results.pictures"
#: public modules -> their full name
MODULES = {
    "options": "cli.options",
    "memory": "foundation.memory",
    "progress": "foundation.progress",
    "statistics": "foundation.statistics",
    "tables": "foundation.tables",
    "text": "foundation.text",
    "errors": "foundation.errors",
    "figures": "results.figures",
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


def load(name: str) -> Any:
    """The object, or the module, with this public name."""
    if name in MODULES:
        return import_module(f"chemage.{MODULES[name]}")
    return getattr(import_module(f"chemage.{HOME[name]}"), name)
