"""What can be plugged into this stage: contact solvers, and the hook that solves a contact."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugins.hooks import hookimpl, hookspec

if TYPE_CHECKING:
    from chemage.contacts.role import ContactSolver
    from chemage.contacts.solution import ContactSolution
    from chemage.surfaces.surface import Surface

ROLES = {"contact": "chemage.contacts.role:ContactSolver"}


@hookspec(firstresult=True)
def chemage_solve_contact(
    solver: ContactSolver, surface: Surface, load: float, start: ContactSolution | None
) -> ContactSolution | None:
    """Solve a contact at ``load`` nN. Return None to leave it to the next plugin; chemage itself answers last.

    Wrap it (``hookimpl(wrapper=True)``) to change a solution, for example to cap the pressure at a hardness.
    """


class Default:
    """The solver's own method."""

    @hookimpl(trylast=True)
    def chemage_solve_contact(
        self, solver: ContactSolver, surface: Surface, load: float, start: ContactSolution | None
    ) -> ContactSolution:
        return solver.solve(surface, load, start=start)
