"""What can be plugged into this stage: surface makers, readers of files, and the hook that makes a surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugins.hooks import hookimpl, hookspec

if TYPE_CHECKING:
    from chemage.foundation.checks import Seed
    from chemage.surfaces.role import SurfaceMaker
    from chemage.surfaces.surface import Surface

ROLES = {"surface": "chemage.surfaces.role:SurfaceMaker", "reader": "chemage.surfaces.reading:Reader"}


@hookspec(firstresult=True)
def chemage_make_surface(maker: SurfaceMaker, seed: Seed) -> Surface | None:
    """Make a surface. Return None to leave it to the next plugin; chemage itself answers last."""


class Default:
    """The maker's own method."""

    @hookimpl(trylast=True)
    def chemage_make_surface(self, maker: SurfaceMaker, seed: Seed) -> Surface:
        return maker.make(seed)
