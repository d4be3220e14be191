"""The first stage: a component makes a surface."""

from __future__ import annotations

from typing import Any

from chemage.foundation.checks import Seed, expect
from chemage.foundation.progress import logged, of_plugins
from chemage.plugins import registry
from chemage.plugins.sources import approximations, providers
from chemage.surfaces.role import SurfaceMaker
from chemage.surfaces.surface import Surface


def surface(kind: str, **options: Any) -> Any:
    """A surface maker: ``chemage.surface("self-affine", pixels=2500, ...).make(seed=1)``."""
    return registry.current().make("surface", kind, options)


def make_surface(maker: SurfaceMaker, seed: Seed = 0) -> Surface:
    """The surface of ``maker``, through the hook ``chemage_make_surface``.

    The plugins that took part, see :mod:`chemage.plugins.sources`, are noted in the surface's ``provenance``.
    """
    expect("maker", maker, SurfaceMaker, 'make one with chemage.surface("sphere", ...)')
    with logged("surface", maker.kind) as outcome:
        answer, plugins = registry.current().answer("chemage_make_surface", Surface, maker=maker, seed=seed)
        answer = answer.noting(providers(maker) | plugins, approximations(maker))
        outcome(f"{answer.shape[0]} x {answer.shape[1]} pixels; {of_plugins(answer.plugins)}")
    return answer
