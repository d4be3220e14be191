"""A stage that is declared as a room of chemage declares its own: the wear of a slip (for test_toy_stage.py)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping

import chemage as ca
from chemage.plugins.hooks import Doubt, Parts, Stage, Stated


class Wear(ca.plugin.Component, ABC):
    """Role ``wear``: what a slip takes away."""

    role = "wear"

    @abstractmethod
    def depth(self, load: float) -> float: ...


class Archard(Wear):
    """Proportional to the load."""

    kind = "archard"
    cite = ("J. F. Archard, J. Appl. Phys. 24, 981 (1953)",)
    slip: ca.plugin.Length
    """path of a slip, nm"""
    table: ca.plugin.FilePath | None = None
    """measured coefficients"""

    def depth(self, load: float) -> float:
        return load * self.slip


class WearStage(Stage):
    def problems(self, parts: Parts) -> Iterator[tuple[str, str]]:
        if self.section in parts and parts[self.section].slip > 1e6:
            yield f"{self.section}.slip", "is longer than any surface"

    def estimate(self, parts: Parts, stated: Stated) -> Mapping[str, float]:
        return {"cpu_seconds": 1000.0 + stated["contact"]["area_fraction"]}

    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        if self.section in parts and parts[self.section].slip < 1:
            yield Doubt("slip", f"a slip of {parts[self.section].slip:g} nm wears nothing off")


ROLES = {"wear": f"{__name__}:Wear"}
STAGES = (WearStage("wear", role="wear", needs="forming", inputs=("contact",), key="ageing"),)
