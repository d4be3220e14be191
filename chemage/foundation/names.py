"""The public names of chemage, and the modules they are in."""

from __future__ import annotations

#: module -> its public names
NAMES = {
    "ageing.age": "age",
    "ageing.aging": "Aging",
    "ageing.fitting": "FIT_WINDOW Fit fit_aging",
    "ageing.hold_times": "hold_times",
    "ageing.measurements": "Measurements read_measurements",
    "ageing.observables": "Observable observable",
    "ageing.plotted": "Maps Observed PlottedResult",
    "contacts.patches": "label_patches",
    "contacts.role": "ContactSolver",
    "contacts.solution": "ContactSolution",
    "contacts.stage": "contact solve_contact",
    "experiments.provenance": "versions",
    "experiments.run": "Run run",
    "experiments.scene": "Scene parse_scene",
    "experiments.scene_files": "load_scene override scene_data",
    "foundation.checks": "Seed check_times checked_seed force temperature_value",
    "foundation.components": "Component",
    "foundation.errors": "ChemageError ConvergenceError DamagedError ExecutorError InputError PluginError SceneError "
    "StoreError UnitError UnknownKindError WorkerLost",
    "foundation.files": "fresh_file preflight",
    "foundation.messages": "nearest",
    "foundation.units": "EV_PER_GPA_NM3 Energy Force Frequency KB Length Pressure Temperature Time Unit Volume convert",
    "kinetics.history": "BondHistory",
    "kinetics.role": "Engine",
    "kinetics.stage": "engine run_kinetics",
    "lattices.chemistry": "Chemistry chemistry",
    "lattices.lattice": "ReactionLattice",
    "lattices.role": "Barriers Interaction",
    "lattices.stage": "barriers build_lattice interaction",
    "plugins.choices": "Choice",
    "plugins.hooks": "hookimpl",
    "plugins.options": "PluginOptions",
    "plugins.registry": "fromdict register unregister",
    "plugins.settings": "plugin_options prefer_plugins",
    "reports.comparison.comparison": "compare_files",
    "reports.page": "write_report",
    "store.results": "read write",
    "surfaces.reading": "Reader reader_for",
    "surfaces.role": "SurfaceMaker",
    "surfaces.stage": "make_surface surface",
    "surfaces.surface": "Surface",
    "sweeps.result": "Point SweepResult load_sweep",
    "sweeps.running": "sweep",
}
#: public name -> the module it is in
HOME = {name: module for module, names in NAMES.items() for name in names.split()}
#: public modules -> their full name
MODULES = {
    "options": "cli.options",
    "progress": "foundation.progress",
    "statistics": "foundation.statistics",
    "tables": "foundation.tables",
    "text": "foundation.text",
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
