"""How much results differ between realisations of a random surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

from chemage.foundation.errors import InputError
from chemage.foundation.text import percent


@dataclass(frozen=True)
class Scatter:
    """How much β differs between surfaces that are equal but for their seed; replicas on one surface do not show it."""

    #: standard deviation of β over its mean; 0: the seed does not change the surface; None: it does, by how much is
    #: not known here
    relative: float | None
    #: how this is known, in words
    source: str = ""

    def __post_init__(self) -> None:
        if self.relative is not None and not 0 <= self.relative < math.inf:
            raise InputError.of(
                "relative", self.relative, "must be finite and at least 0", "or None if it is not known"
            )

    def text(self, replicas: float = math.nan) -> str:
        """One sentence for users; ``replicas`` is the relative standard error of β over replicas."""
        if self.relative == 0:
            return ""
        if self.relative is None:
            found = "β differs between surface seeds by more than between replicas; an ensemble measures it"
        else:
            found = f"β differs by about {percent(self.relative)} between surface seeds (standard deviation)"
            if math.isfinite(replicas):
                found += f", the standard error of the replicas is {percent(replicas)}"
        return f"{found}; {self.source}" if self.source else found
