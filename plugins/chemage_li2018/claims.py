"""Claims of the paper in words, tested against what was computed; claims.toml has their sentences and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from chemage.plugin import ClaimTest, Limits, decisions
from chemage_li2018 import measures
from chemage_li2018.published import data
from chemage_li2018.sweeps import Studies

DATA = data("claims")


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper, and what became of it."""

    target: str
    sentence: str
    #: how what it says is known
    known: str
    #: of a law, tested against twelve others
    shape: bool = False
    calibrated: bool = False
    #: None if it is not tested, and why
    test: ClaimTest | None = None
    reason: str = ""

    @property
    def word(self) -> str:
        """One of the five words."""
        if self.test is None:
            return decisions.CANNOT
        return self.test.word(calibrated=self.calibrated)

    @property
    def ours(self) -> str:
        """What was found."""
        if self.test is None:
            return self.reason
        more = ""
        if not self.test.decidable:
            more = "; three surfaces are needed for the noise"
        elif self.word == decisions.CANNOT:
            more = f"; {self.test.remedy}"
        return self.test.found() + more


def claims(studies: Studies, targets: Sequence[str]) -> list[Claim]:
    """Test the claims of ``targets`` with the computed ``studies``."""
    found = []
    for one in DATA["claims"]:
        if one["target"] in targets:
            one = {"limits": (), **one}
            measure = getattr(measures, one.pop("measure"))
            made = measure(studies, *([one.pop("at")] if "at" in one else []))
            limits = [Limits(**limit) for limit in one.pop("limits")]
            rivals = one.pop("rivals")
            test = replace(
                made,
                limits=limits or made.limits,
                claimed=one.pop("claimed"),
                rivals=rivals if isinstance(rivals, dict) else DATA["rivals"][rivals],
            )
            found.append(Claim(**one, test=test))
    if "estimates" in targets:
        for sentence, reason in DATA["untested"].items():
            found.append(Claim("estimates", sentence, "words", reason=reason))
    return found
