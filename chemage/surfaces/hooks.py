"""What can be plugged into this stage: surface makers, readers of files, and the hook that makes a surface."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from chemage.plugins.hooks import (
    Beside,
    Doubt,
    Parts,
    Stage,
    StageInputs,
    Stated,
    hookimpl,
    hookspec,
    options_in,
)

if TYPE_CHECKING:
    from chemage.foundation.checks import Seed
    from chemage.surfaces.role import SurfaceMaker
    from chemage.surfaces.surface import Surface

ROLES = {
    "surface": "chemage.surfaces.role:SurfaceMaker",
    "reader": "chemage.surfaces.reading:Reader",
}


@hookspec(firstresult=True)
def chemage_make_surface(maker: SurfaceMaker, seed: Seed) -> Surface | None:
    """Make a surface. Return None to leave it to the next plugin; chemage itself answers last."""


class OwnSurfaceMethod:
    """The maker's own method."""

    @hookimpl(trylast=True)
    def chemage_make_surface(self, maker: SurfaceMaker, seed: Seed) -> Surface:
        return maker.make(seed)


ANSWERS = OwnSurfaceMethod


#: rms slopes of surfaces: beyond these heights or pixels are likely in another unit than they are said to be
SLOPES = (1e-6, 3.0)


class _Surface(Stage):
    def run(self, inputs: StageInputs) -> Surface:
        from chemage.surfaces.role import make_surface

        return make_surface(
            inputs.parts[self.section], inputs.parts["surface.seed"]
        )

    def recorded(
        self, ageing: Mapping[str, Any], contact: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        return {self.section: options_in(contact.get(self.section))}

    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        return dict(parts[self.section].expected())

    def rows(self, parts: Parts, stated: Stated) -> Mapping[str, str]:
        numbers, seed = stated[self.section], parts["surface.seed"]
        grid = (
            f", {numbers['nx']:.0f} x {numbers['ny']:.0f} pixels"
            if {"nx", "ny"} <= numbers.keys()
            else ""
        )
        return {self.section: f"{parts[self.section].kind}{grid}, seed {seed}"}

    def fault(self, answer: Any, arguments: Mapping[str, Any]) -> str:
        if "radius" in answer.provenance and answer.periodic:
            return "its provenance has the radius of a single sphere, but it is periodic; pass periodic=False"
        return ""

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        numbers = stated[self.section]
        slope = numbers.get("rms_slope")
        if slope is not None and slope > 0 and not SLOPES[0] <= slope <= SLOPES[1]:
            yield Doubt(
                "slope",
                f"the heights of the surface imply an rms slope of {slope:.2g} on pixels of "
                f"{numbers.get('pixel_size', math.nan):g} nm, and rough surfaces have 0.001 to 1: are heights and "
                "pixels in nm? A file may be in metres or micrometres: give height_unit and pixel_size with their "
                "units",
            )
        wave, pixel = numbers.get("shortest_wavelength"), numbers.get("pixel_size")
        if wave and pixel and wave < 8 * pixel:
            yield Doubt(
                "wavelength",
                f"the shortest wavelength is {wave / pixel:.1f} pixels; pixel-scale errors of the contact area and "
                "pressure grow below about 8, compare with more pixels at the same size",
            )


STAGES = (
    _Surface(
        "surface",
        role="surface",
        required=True,
        makes="surface",
        always_in_key=True,
        beside={
            "seed": Beside(
                "surface_seed",
                {
                    "type": "integer",
                    "minimum": 0,
                    "default": 0,
                    "description": "of the surface",
                },
            )
        },
        hooks=("chemage_make_surface",),
    ),
)
