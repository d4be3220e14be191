"""Published numbers of Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018)."""

from __future__ import annotations

import tomllib
from decimal import Decimal
from importlib import resources
from typing import Any, NamedTuple

#: the contents of reproduction.toml
DATA: dict[str, Any] = tomllib.loads(
    resources.files("chemage_li2018")
    .joinpath("reproduction.toml")
    .read_text(encoding="utf-8")
)
PAPER = "Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018)"


class PublishedNumber(NamedTuple):
    """A published number as it is printed, and the interval that its digits leave open."""

    text: str
    low: float
    high: float

    @classmethod
    def of(cls, text: str) -> PublishedNumber:
        """Read ``"0.44"`` (half a unit of the last digit on both sides) or a range ``"2 to 2.3"``."""
        first, _, last = text.partition(" to ")
        if last:
            return cls(text, float(first), float(last))
        number = Decimal(text)
        exponent = number.as_tuple().exponent
        assert isinstance(exponent, int), text
        half = Decimal(5).scaleb(exponent - 1)
        return cls(text, float(number - half), float(number + half))

    @property
    def value(self) -> float | None:
        """The number; None for a range."""
        return None if " to " in self.text else float(self.text)

    def distance(self, value: float) -> float:
        """Distance of ``value`` from the interval, 0 inside, in its unit."""
        return max(self.low - value, value - self.high, 0.0)


class PaperSurface(NamedTuple):
    """A row of the paper's Table 1 (h'_rms = 0.05, 20 µN, λ_L = 1129 nm); ``marker`` is the symbol of its points."""

    name: str
    marker: str
    hurst: float
    zeta: float
    eta: float
    patches: str
    perimeter_to_area: str

    @property
    def options(self) -> dict[str, float]:
        """Its roughness: dotted path -> value."""
        return {
            f"surface.{name}": getattr(self, name) for name in ("hurst", "zeta", "eta")
        }


TABLE_1 = tuple(PaperSurface(**row) for row in DATA["table_1"])
SLOPES = (0.05, 0.1, 0.2)

#: β at 20 µN against h'_rms, by activation volume in Å³. The paper's caption of Fig. 3 gives the second set to panel
#: (b); it belongs to panel (d). Printed with two decimals.
BETA = {
    6.4: {0.05: 0.89, 0.1: 0.45, 0.2: 0.20},
    0.0: {0.05: 0.98, 0.1: 0.49, 0.2: 0.24},
}

#: A/A0 at a load in µN, reference surface, h'_rms = 0.1
AREA_FRACTION = {20.0: "0.01", 500.0: "0.22"}
KAPPA = "2.1"
#: for all rows of Table 1
KAPPA_ROWS = "2 to 2.3"

#: half hydroxylated, h'_rms = 0.4, detachment-front factor 0.15
FIG_6_BETA = "0.0087"
#: of atomic force microscopy, by load in nN
TIP_BETA = {23.0: "15", 393.0: "1.5"}
#: of macroscopic experiments
MACROSCOPIC_BETA = "0.01"
