"""Checks of a material: every value can be used, and its source is named."""

from __future__ import annotations

from chemage.scene.materials import material_problems
from chemage.testing.checks import CheckFailed


def check_material(name: str) -> None:
    """Check an installed material: its file can be read, every value has a source and says how it is known, every
    option exists, and the components accept the values.

    Raises
    ------
    CheckFailed
        With everything that is wrong.
    """
    if problems := material_problems(name):
        raise CheckFailed("values_can_be_used", f"material {name!r}", "\n".join(problems))
