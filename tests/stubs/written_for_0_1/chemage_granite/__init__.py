"""Seven components, hooks and a command, as the pages of chemage 0.1 and its `plugins new` wrote them."""

from chemage import hookimpl

CHEMAGE_API = 1
CALLS = []


@hookimpl
def chemage_register():
    """What this plugin offers; strings, so that the module is imported only when it is used."""
    return {
        "surface": {"granite-surface": "chemage_granite.surface:GraniteSurface"},
        "reader": {"granite-reader": "chemage_granite.reader:GraniteReader"},
        "contact": {"granite-contact": "chemage_granite.contact:GraniteContact"},
        "barriers": {"granite-barriers": "chemage_granite.barriers:GraniteBarriers"},
        "interaction": {"granite-interaction": "chemage_granite.interaction:GraniteInteraction"},
        "engine": {"granite-engine": "chemage_granite.engine:GraniteEngine"},
        "observable": {"granite-observable": "chemage_granite.observable:GraniteObservable"},
    }


@hookimpl(wrapper=True)
def chemage_make_surface():
    from chemage import Surface

    surface = yield
    return Surface.fromdict({**surface.todict(), "heights": surface.heights - surface.heights.mean()})


@hookimpl
def chemage_solve_contact(solver, surface, load):
    from chemage.spec import ContactSolver

    assert isinstance(solver, ContactSolver)
    CALLS.append(("contact", load))


@hookimpl(wrapper=True)
def chemage_build_lattice(seed):
    import numpy as np

    from chemage import ReactionLattice, random

    lattice = yield
    wet = random.uniforms(seed, random.FIRST_FREE_STREAM, lattice.sites) < 0.1
    return ReactionLattice.fromdict({**lattice.todict(), "forming": np.where(wet, 5.0, lattice.forming)})


@hookimpl(wrapper=True)
def chemage_run_kinetics(engine, lattice):
    history = yield
    CALLS.append((engine.kind, lattice.sites.size, history.events))
    return history


@hookimpl
def chemage_observe(contact, lattice, history):
    pressure = contact.pressure.ravel()[lattice.sites]
    bonded = pressure[history.state]
    return {"pressure_where_bonded": bonded.mean() if bonded.size else float("nan")}


@hookimpl
def chemage_scenes():
    return {"granite": "chemage_granite:granite.toml"}


def granite_stiffness(load: float, depth: float) -> None:
    """Stiffness (nN/nm): LOAD in nN over DEPTH in nm."""
    from chemage.units import convert

    print(convert(load, "nN") / convert(depth, "nm"))


@hookimpl
def chemage_cli():
    return [("granite-stiffness", granite_stiffness)]
