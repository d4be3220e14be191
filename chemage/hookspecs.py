"""Every hook a plugin can implement.

A plugin is a module (or package) named by an entry point in the group ``chemage``; its functions marked with
``chemage.hookimpl`` answer these hooks. A plugin may leave out arguments it does not need. Arguments are only ever
added; a changed meaning is a new hook.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np

    from chemage.objects import BondHistory, ContactSolution, ReactionLattice, Surface
    from chemage.reactions import Chemistry
    from chemage.spec import ContactSolver, Engine, Seed, SurfaceMaker

#: A plugin module may set ``CHEMAGE_API = 1``; one made for another version is reported and skipped.
API_VERSION = 1

#: The hooks that are arrows of the pipeline: what answers or wraps one changes results.
ARROWS = ("chemage_make_surface", "chemage_solve_contact", "chemage_build_lattice", "chemage_run_kinetics")

hookspec = pluggy.HookspecMarker("chemage")
hookimpl = pluggy.HookimplMarker("chemage")


@hookspec
def chemage_register() -> Mapping[str, Mapping[str, str]]:  # pyright: ignore[reportReturnType]
    """The choices this plugin offers: ``{role: {kind: "module:Class"}}``.

    Strings, so that discovery imports nothing heavy; the class is imported when a user asks for the kind.
    """


@hookspec(firstresult=True)
def chemage_make_surface(maker: SurfaceMaker, seed: Seed) -> Surface | None:
    """Make a surface. Return None to leave it to the next plugin; chemage itself answers last."""


@hookspec(firstresult=True)
def chemage_solve_contact(
    solver: ContactSolver, surface: Surface, load: float, start: ContactSolution | None
) -> ContactSolution | None:
    """Solve a contact at ``load`` nN. Return None to leave it to the next plugin; chemage itself answers last.

    Wrap it (``hookimpl(wrapper=True)``) to change a solution, for example to cap the pressure at a hardness.
    """


@hookspec(firstresult=True)
def chemage_build_lattice(chemistry: Chemistry, contact: ContactSolution, seed: Seed) -> ReactionLattice | None:
    """Turn a contact into reactive sites. Return None to leave it to the next plugin; chemage itself answers last."""


@hookspec(firstresult=True)
def chemage_run_kinetics(
    engine: Engine,
    lattice: ReactionLattice,
    hold_times: np.ndarray,
    temperature: float,
    seed: Seed,
    start: BondHistory | None,
) -> BondHistory | None:
    """Run one replica. Called once a replica (once a piece where checkpoints are kept; ``start`` is the piece before),
    never per event. Return None to leave it to the next plugin."""


@hookspec
def chemage_observe(contact: ContactSolution, lattice: ReactionLattice, history: BondHistory) -> Mapping[str, Any]:  # pyright: ignore[reportReturnType]
    """Further named numbers or arrays of a finished replica; kept in ``Aging.observables``."""


@hookspec
def chemage_scenes() -> Mapping[str, str]:  # pyright: ignore[reportReturnType]
    """Scenes this plugin ships: ``{name: "package:file.toml"}``."""


@hookspec
def chemage_cli() -> Sequence[tuple[str, Any]]:  # pyright: ignore[reportReturnType]
    """Further subcommands: ``[(name, function), ...]``; the function's signature is its command line (typer)."""
