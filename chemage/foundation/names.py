"""The public names of chemage, and the modules they are in."""

from __future__ import annotations

#: module -> its public names
NAMES = {
    "ageing.age": "age",
    "ageing.aging": "Aging",
    "studies.arrhenius": "ActivationEnergy Arrhenius",
    "ageing.fitting": "FIT_WINDOW Fit fit_aging",
    "ageing.hold_times": "hold_times",
    "ageing.measurements": "Measurements read_measurements",
    "ageing.methods": "AgedBonds AgeingMethod AgeingRequest ageing_method",
    "ageing.observables": "Maps Observable Observed PlottedResult observable",
    "ageing.outputs": "Output",
    "contacts.options": "ContactModulus contact_modulus",
    "contacts.patches": "label_patches",
    "contacts.role": "ContactSolver ContactTheory",
    "contacts.solution": "ContactSolution ContactStatistics",
    "contacts.stage": "contact solve_contact",
    "studies.ensembles.ensemble": "Ensemble ErrorPart Estimate",
    "studies.ensembles.running": "ensemble",
    "scene.materials": "Material MaterialValue material",
    "scene.provenance": "versions",
    "scene.run": "Run run",
    "scene.scene": "Scene",
    "scene.parsing": "parse_scene",
    "scene.files": "load_scene override scene_data",
    "foundation.machine": "cache_folder",
    "foundation.records": "content_hash",
    "foundation.checks": "Seed check_times checked_count checked_seed checked_states force temperature_value",
    "foundation.components": "Component",
    "foundation.errors": "ChemageError ConvergenceError DamagedError ExecutorError InputError PlanWarning PluginError "
    "SceneError StoreError UnitError UnknownKindError WorkerLost",
    "foundation.files": "fresh_file preflight regular_file",
    "foundation.messages": "nearest",
    "foundation.units": "EV_PER_GPA_NM3 Energy FilePath Force Frequency KB Length Pressure Temperature Time Unit "
    "Volume convert",
    "friction.role": "Bonded Rupture RuptureForce",
    "friction.stage": "rupture rupture_bonds",
    "inference.curves": "MeasuredCurve read_curves",
    "inference.forecast": "Forecast",
    "inference.infer": "infer",
    "inference.result": "Inference UnexplainedError",
    "kinetics.history": "BondHistory",
    "kinetics.role": "Engine",
    "kinetics.stage": "engine run_kinetics",
    "lattices.chemistry": "Chemistry chemistry contact_statistics coordination",
    "lattices.independent": "TwoState",
    "lattices.lattice": "ReactionLattice",
    "lattices.role": "Barriers Interaction",
    "lattices.site_grid": "ContactSites contact_sites",
    "lattices.stage": "barriers build_lattice interaction",
    "plugins.hooks": "hookimpl",
    "plugins.options": "Choice PluginOptions plugin_options prefer_plugins",
    "plugins.registry": "fromdict register unregister",
    "results.arrhenius": "arrhenius",
    "results.comparison": "compare_files",
    "results.page": "write_report",
    "results.files": "open_maps read write",
    "surfaces.reading": "HeightMap Reader reader_for",
    "surfaces.role": "Scatter SurfaceMaker",
    "surfaces.stage": "make_surface surface",
    "surfaces.surface": "Roughness Surface",
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
    "container": "foundation.container",
    "options": "cli.options",
    "memory": "foundation.memory",
    "progress": "foundation.progress",
    "statistics": "foundation.statistics",
    "tables": "foundation.tables",
    "text": "foundation.text",
    "errors": "foundation.errors",
    "figures": "foundation.figures",
    "random": "foundation.random",
    "registry": "plugins.registry",
    "roughness": "surfaces.roughness",
    "testing": "testing",
    "theory": "contacts.theory",
    "threads": "foundation.threads",
    "units": "foundation.units",
}
