"""The second stage: a solver presses a surface on a half-space."""

from __future__ import annotations

from typing import Any

from chemage.contacts.role import ContactSolver
from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import expect
from chemage.foundation.progress import logged, of_plugins
from chemage.foundation.units import QuantityLike
from chemage.plugins import registry
from chemage.plugins.sources import approximation_of, approximations, providers
from chemage.surfaces.surface import Surface


def contact(kind: str, **options: Any) -> Any:
    """A contact solver: ``chemage.contact("fft-bem", modulus="35.3 GPa").solve(surface, load="20 uN")``."""
    return registry.current().make("contact", kind, options)


def solve_contact(
    solver: ContactSolver, surface: Surface, load: QuantityLike, *, start: ContactSolution | None = None
) -> ContactSolution:
    """The contact of ``surface`` under ``load`` (a force or a nominal pressure), by the hook ``chemage_solve_contact``.

    The plugins that took part, here or at the surface, are noted in the solution's ``provenance``.
    """
    expect("solver", solver, ContactSolver, 'make one with chemage.contact("hertz", ...)')
    expect("surface", surface, Surface, "make one with chemage.surface(...).make()")
    force = solver.normal_force(load, surface)
    with logged("contact", f"{solver.kind}, load {force:g} nN, {surface.shape[0]} x {surface.shape[1]} pixels") as out:
        solution, plugins = registry.current().answer(
            "chemage_solve_contact", ContactSolution, solver=solver, surface=surface, load=force, start=start
        )
        # a plugin that answers with another solver may record which
        kind = solution.provenance.get("kind")
        used = approximation_of("contact", kind) if isinstance(kind, str) and kind != solver.kind else []
        approximate = [*surface.approximate, *approximations(solver), *used]
        solution = solution.noting(surface.plugins | providers(solver) | plugins, approximate)
        out(f"{solution.iterations} iterations, residual {solution.residual:.3g}; {of_plugins(solution.plugins)}")
    return solution
