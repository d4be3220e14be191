"""The page of the reproduction with all numbers, claims and figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from chemage.plugin import decisions
from chemage_li2018 import claims, comparisons, estimates, published
from chemage_li2018.claims import Claim
from chemage_li2018.comparisons import Line
from chemage_li2018.estimates import Band, Estimate
from chemage_li2018.pages import render
from chemage_li2018.sweeps import TARGETS, read_points, studies_of

#: folder of the figures, relative to the page
FIGURES = "figures/reproduction"

CAPTIONS: dict[str, str] = published.DATA["captions"]
#: probable reasons for differences, and what is open, by target
REASONS: dict[str, str] = published.DATA["reasons"]


@dataclass(frozen=True)
class Reproduction:
    """Everything that a reproduction found, for its page and the terminal."""

    lines: list[Line]
    claims: list[Claim]
    estimates: list[Estimate] = field(default_factory=list)
    #: β over the members of the barrier density
    bands: list[Band] = field(default_factory=list)

    def summary(self) -> Iterator[str]:
        """What the terminal shows."""
        width = max((len(line.quantity) for line in self.lines), default=0)
        for line in self.lines:
            numbers = (
                f"paper {line.paper.text:<8} ours {line.ours!s:18} {line.shown:>7}"
            )
            yield f"{line.target:7} {line.quantity:{width}}  {numbers}  {line.word}"
        for claim in self.claims:
            yield f"{claim.target:7} {claim.word}: {claim.sentence}\n{'':8}{claim.ours}"
        for estimate in self.estimates:
            yield f"text    {estimate.word or '–'}: {estimate.statement}\n{'':8}{estimate.ours}"


def of_points(file: Path) -> tuple[Reproduction, str]:
    """Compare the stored points of :func:`chemage_li2018.sweeps.save_points` with the paper, and write the page."""
    points, about = read_points(file)
    names = about["targets"]
    studies = studies_of(points, names)
    compared = Reproduction(
        comparisons.lines(studies, names),
        claims.claims(studies, names),
        list(estimates.estimates(studies)) if "estimates" in names else [],
        estimates.bands(studies) if "calibration" in names else [],
    )
    return compared, page(compared, **about)


def page(results: Reproduction, targets: Sequence[str], **about: Any) -> str:
    """Write the page as Markdown; ``about`` are the seeds, pixels and versions of the points."""
    seeds = about["seeds"]
    surfaces = f"one surface per row (seed {seeds[0]})"
    if len(seeds) > 1:
        surfaces = f"{len(seeds)} surfaces per row (seeds {seeds[0]} to {seeds[-1]})"
    return render(
        "reproduction",
        results=results,
        paper=published.PAPER,
        targets=" all" if len(targets) == len(TARGETS) else " " + " ".join(targets),
        surfaces=surfaces,
        **about,
        decisions=decisions,
        factor=comparisons.FACTOR,
        misses=[line for line in results.lines if line.word == decisions.DISAGREES],
        read=[line for line in results.lines if line.readings],
        conflict=published.DATA["conflict"],
        reasons={
            one: " ".join(REASONS[one].split()) for one in targets if one in REASONS
        },
        captions={name: CAPTIONS[name] for name in targets if name in CAPTIONS},
        folder=FIGURES,
    )
