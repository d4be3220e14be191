"""The role that makes surfaces, and the first stage: a component makes one."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from chemage.foundation.checks import Seed, expect
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.foundation.progress import logged, of_plugins
from chemage.foundation.quantities import Quantity
from chemage.foundation.text import percent
from chemage.plugins import registry
from chemage.plugins.sources import noted
from chemage.surfaces.surface import Roughness, Surface

#: what another seed gives where it changes only waves that were not measured
CONTINUATIONS = "continuations"


@dataclass(frozen=True)
class Scatter:
    """How much β differs between surfaces that are equal but for their seed; replicas on one surface do not show it."""

    #: standard deviation of β over its mean; 0: the seed does not change the surface; None: it does, by how much is
    #: not known here
    relative: float | None
    #: how this is known, in words
    source: str = ""
    #: what another seed gives, in words
    between: str = "surfaces"

    def __post_init__(self) -> None:
        if self.relative is not None and not 0 <= self.relative < math.inf:
            raise InputError.of(
                "relative",
                self.relative,
                "must be finite and at least 0",
                "or None if it is not known",
            )

    def text(self, replicas: float = math.nan) -> str:
        """One sentence for users; ``replicas`` is the relative standard error of β over replicas."""
        if self.relative == 0:
            return ""
        if self.relative is None:
            text = "β differs between surface seeds by more than between replicas; an ensemble measures it"
        else:
            text = f"β differs by about {percent(self.relative)} between surface seeds (standard deviation)"
            if math.isfinite(replicas):
                text += (
                    f", the standard error of the replicas is {percent(replicas)}"
                )
        return f"{text}; {self.source}" if self.source else text

    def quantity(self) -> Quantity:
        """The same as a number; not known of a :attr:`relative` of None."""
        label = f"scatter of β between {self.between}, relative"
        value = math.nan if self.relative is None else self.relative
        return Quantity(
            "beta_scatter_between_surfaces",
            "1",
            label,
            meaning="standard deviation of β between surfaces of other seeds, over its mean",
            value=value,
            reason=self.source,
        )


class SurfaceMaker(Component, ABC):
    """Role ``surface``: makes the rough body."""

    role = "surface"
    error_of = "the heights"

    @abstractmethod
    def make(self, seed: Seed = 0) -> Surface:
        """The surface. The same seed gives the same bytes; a deterministic maker ignores it."""

    def expected(self) -> dict[str, float]:
        """What is known before anything is computed, as far as it is: ``nx``, ``ny`` (pixels), ``pixel_size`` (nm),
        ``rms_slope``, ``shortest_wavelength`` (nm), ``radius`` (of a sphere, nm), ``periodic`` (1 or 0),
        ``sites`` (that the surface has, see :data:`chemage.plugin.SITE_POSITIONS`), ``cpu_seconds`` (to make it). Used
        by ``chemage check``."""
        return {}

    def roughness(self, seed: Seed = 0) -> Roughness:
        """The roughness of the surface of ``seed``, for theories that need no heights.

        Here the surface is made and measured; override it where the roughness is known without.
        """
        return Roughness.of(self.make(seed))

    def scatter(self, contact: Mapping[str, float]) -> Scatter | None:
        """How much β differs between surfaces of other seeds, of which one has a ``contact`` with these measures
        (:data:`chemage.contacts.solution.MEASURES`); ``Scatter(0.0)`` where the seed does not change the surface,
        ``Scatter(None)`` where it does and nothing more is known. None: the class does not say."""
        return None

    def members(self, count: int) -> Sequence[SurfaceMaker]:
        """Makers of other surfaces that the same measurement allows, at most ``count`` of them; none where nothing is
        unknown, or as much as the seeds show.

        A mean over surfaces computes them, too, and their scatter is its error ``measurement``.
        """
        return ()

    @property
    def unknown(self) -> str:
        """In what :meth:`members` differ, and what none of them shows, in words."""
        return ""

    def coarser(self, factor: int) -> Self | None:
        """A maker of the same surface at the same size on pixels ``factor`` times larger; None where there is none."""
        return None

    def sketch(self) -> Self | None:
        """A maker of the same surface at the same size on hardly more pixels than its waves need; None where there is
        none. The area of its contact tells surfaces with larger contacts from others, and need not be right: it is the
        control of an ensemble (:mod:`chemage.studies.ensembles.quantities`)."""
        return None

    def coarser_errors(
        self, factor: int, contact: Mapping[str, float]
    ) -> Mapping[str, float]:
        """Relative standard errors of what contacts on :meth:`coarser` pixels give, with these measures on average
        (:data:`chemage.contacts.solution.MEASURES`), as measured before on surfaces like this one: ``beta``, and
        ``friction_drop`` at any hold time. What is not in it is not known, and is measured by computing some surfaces
        on both grids."""
        return {}


def surface(kind: str, **options: Any) -> Any:
    """A surface maker: ``chemage.surface("self-affine", pixels=2500, ...).make(seed=1)``."""
    return registry.current().make("surface", kind, options)


def make_surface(maker: SurfaceMaker, seed: Seed = 0) -> Surface:
    """The surface of ``maker``, through the hook ``chemage_make_surface``.

    The plugins that took part, see :mod:`chemage.plugins.sources`, are noted in the surface's ``provenance``.
    """
    expect(
        "maker", maker, SurfaceMaker, 'make one with chemage.surface("sphere", ...)'
    )
    with logged("surface", maker.kind) as outcome:
        answer, took_part, recorded = registry.current().answer(
            "chemage_make_surface", Surface, maker=maker, seed=seed
        )
        answer = noted(answer, recorded, took_part, maker)
        outcome(
            f"{answer.shape[0]} x {answer.shape[1]} pixels; {of_plugins(answer.plugins)}"
        )
    return answer
