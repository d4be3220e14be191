"""A component of each role, hooks, options and what else the pages of chemage 0.2 let a plugin bring."""

from chemage.plugin import hookimpl

CHEMAGE_API = 1
CHEMAGE_OPTIONS = "chemage_basalt.parts:Options"
CALLS = []


@hookimpl
def chemage_register():
    return {
        "surface": {"basalt-waves": "chemage_basalt.parts:Waves"},
        "reader": {"basalt-table": "chemage_basalt.parts:Table"},
        "contact": {"basalt-springs": "chemage_basalt.parts:Springs"},
        "barriers": {"basalt-exponential": "chemage_basalt.parts:Exponential"},
        "interaction": {"basalt-along-x": "chemage_basalt.parts:AlongX"},
        "engine": {"basalt-mean": "chemage_basalt.parts:MeanTimes"},
        "rupture": {"basalt-strength": "chemage_basalt.parts:Strength"},
        "pulling": {"basalt-rigid": "chemage_basalt.parts:Rigid"},
        "observable": {"basalt-first": "chemage_basalt.parts:FirstHalf"},
        "ageing": {"basalt-count": "chemage_basalt.parts:Count"},
    }


@hookimpl(wrapper=True)
def chemage_make_surface():
    surface = yield
    return surface.model_copy(update={"heights": surface.heights - surface.heights.mean()})


@hookimpl(wrapper=True)
def chemage_solve_contact():
    from chemage_basalt.parts import Options

    solution = yield
    limit = Options.current().limit
    if limit is None or solution.max_pressure <= limit:
        return solution
    import numpy as np

    fields = {"pressure": np.minimum(solution.pressure, limit), "carries": f"capped at {limit} GPa"}
    return solution.model_copy(update=fields)


@hookimpl(wrapper=True)
def chemage_build_lattice(seed):
    import numpy as np

    from chemage import ReactionLattice
    from chemage.plugin import random

    lattice = yield
    wet = random.uniforms(seed, random.stream("chemage-basalt/water"), lattice.sites) < 0.1
    return ReactionLattice.fromdict({**lattice.todict(), "forming": np.where(wet, 5.0, lattice.forming)})


@hookimpl(wrapper=True)
def chemage_run_kinetics(engine, lattice, contact, chemistry):
    history = yield
    CALLS.append((engine.kind, lattice.sites.size))
    return history


@hookimpl(wrapper=True)
def chemage_rupture_bonds(bonded):
    import numpy as np

    force = yield
    limit = 100.0 * bonded.contact.area
    return force if force.max() <= limit else np.minimum(force, limit)


@hookimpl
def chemage_pull_bonds(engine, lattice, drive, times, temperature, seed, start, partners):
    CALLS.append((engine.kind, len(times)))


@hookimpl
def chemage_observe(contact, lattice, history):
    from chemage.plugin import Output

    bonded = lattice.pressures(contact)[history.state]
    mean = bonded.mean() if bonded.size else float("nan")
    return {"pressure_where_bonded": Output(unit="GPa", description="mean pressure at the bonds").of(mean)}


@hookimpl
def chemage_figures():
    return {"basalt-row": ("Pressure along the middle row.", _draw)}


def _draw(axes, results):
    for one in results:
        if one.contact is not None:
            axes.plot(one.contact.pressure[0], color=one.color, label=one.label)


@hookimpl
def chemage_published():
    return [({"surface.kind": "basalt-waves"}, 0.8, "an example, not a measurement")]


@hookimpl
def chemage_scenes():
    return {"basalt": "chemage_basalt:basalt.toml"}


@hookimpl
def chemage_materials():
    return {"basalt": "chemage_basalt:material.toml"}


@hookimpl
def chemage_names():
    return {"basalt_stiffness": "chemage_basalt:basalt_stiffness"}


def basalt_stiffness(load: float, depth: float) -> float:
    """Stiffness (nN/nm): LOAD in nN over DEPTH in nm."""
    print(load / depth)
    return load / depth


@hookimpl
def chemage_cli():
    return [("basalt-stiffness", basalt_stiffness)]
