"""Published numbers of Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018)."""

from __future__ import annotations

import tomllib
from decimal import Decimal
from importlib import resources
from typing import Any, NamedTuple


def data(name: str) -> dict[str, Any]:
    """Read a table of this package."""
    return tomllib.loads(
        resources.files("chemage_li2018").joinpath(f"{name}.toml").read_text("utf-8")
    )


DATA = data("reproduction")
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

#: target -> its numbers, see reproduction.toml
NUMBERS: dict[str, list[dict[str, Any]]] = DATA["numbers"]
#: target -> numbers of each row of Table 1: quantity, what is printed, value
ROWS: dict[str, list[tuple[str, str, str]]] = DATA["rows"]
#: of Fig. 3, with ΔV first, and of Fig. 6
BETA = [float(number["paper"]) for number in NUMBERS["fig3"]]
FIG_6_BETA = float(NUMBERS["fig6"][0]["paper"])
KAPPA = float(NUMBERS["kappa"][-1]["paper"])


class Reading(NamedTuple):
    """Hold times over which the paper may have fitted β, which it does not state."""

    #: first hold time with ΔV and without, s; None: where a curve first has half of its fitted slope
    starts: tuple[float | None, float | None]
    #: last hold time, s
    end: float


#: each line from where the paper says that the logarithmic regime starts
PREFERRED = Reading((1.0, 10.0), 1e4)


def window(volume: float) -> tuple[float, float]:
    """First and last hold time (s) of :data:`PREFERRED` for an activation volume (nm³)."""
    first = PREFERRED.starts[0 if volume else 1]
    assert first is not None
    return first, PREFERRED.end


#: of macroscopic experiments
MACROSCOPIC_BETA = "0.01"


def by_load(target: str, value: str) -> dict[float, float]:
    """Published numbers of a target by their load, nN."""
    found = (number for number in NUMBERS[target] if number["value"] == value)
    return {number["at"]["contact.load"]: float(number["paper"]) for number in found}
