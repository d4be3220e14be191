"""Claims of the paper in words, tested against what was computed; claims.toml has their sentences and limits."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

from chemage_li2018 import measures
from chemage_li2018.decisions import CANNOT, ClaimTest, Limits
from chemage_li2018.sweeps import Studies

DATA: dict[str, Any] = tomllib.loads(
    resources.files("chemage_li2018")
    .joinpath("claims.toml")
    .read_text(encoding="utf-8")
)


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
            return CANNOT
        return self.test.word(calibrated=self.calibrated)

    @property
    def ours(self) -> str:
        """What was found."""
        if self.test is None:
            return self.reason
        more = ""
        if not self.test.decidable:
            more = "; three surfaces are needed for the noise"
        elif self.word == CANNOT:
            more = f"; {self.test.remedy}"
        return self.test.found() + more


def claims(studies: Studies, targets: Sequence[str]) -> list[Claim]:
    """Test the claims of ``targets`` with the computed ``studies``."""
    found = []
    for data in DATA["claims"]:
        if data["target"] in targets:
            about = {name: data[name] for name in ("target", "sentence", "known")} | {
                name: data.get(name, False) for name in ("shape", "calibrated")
            }
            measure = getattr(measures, data["measure"])
            test = measure(studies, data["at"]) if "at" in data else measure(studies)
            limits = [Limits(**one) for one in data.get("limits", ())]
            rivals = data["rivals"]
            test = replace(
                test,
                limits=limits or test.limits,
                claimed=data["claimed"],
                rivals=rivals if isinstance(rivals, dict) else DATA["rivals"][rivals],
            )
            found.append(Claim(**about, test=test))
    if "estimates" in targets:
        for sentence, reason in DATA["untested"].items():
            found.append(Claim("estimates", sentence, "words", reason=reason))
    return found
