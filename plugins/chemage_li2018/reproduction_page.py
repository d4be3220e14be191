"""The page of the reproduction with all numbers, claims and figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from chemage_li2018 import claims, comparisons, estimates, published
from chemage_li2018.comparisons import COMMON, DISAGREES, Claim, Estimate, Line
from chemage_li2018.estimates import Band
from chemage_li2018.pages import render
from chemage_li2018.shapes import EQUAL, ScalingLaw
from chemage_li2018.sweeps import TARGETS, Mean, read_points, studies_of

#: folder of the figures, relative to the page
FIGURES = "figures/reproduction"

CAPTIONS = {
    "fig1": "Fig. 1: the rough surface, the contact on it, and the pressure in the square.",
    "fig2": "Fig. 2: (a) intrinsic barriers to forming and to breaking, and E_form(t = 0) at three loads; (b) ΔF and "
    "Δμ against hold time; (c) pressure at three loads; (d) ΔF and Δμ against load and against A/A0.",
    "fig3": "Fig. 3: the seven rows of Table 1 at three slopes, with ΔV (above) and without (below): Δμ against hold "
    "time, and against A/A0 at 1 s and 10³ s. Symbols are those of the rows.",
    "fig4": "Fig. 4: distributions of the local pressure and of E_form(t = 0) at h'_rms = 0.05, 0.1 and 0.2.",
    "fig5": "Fig. 5: Δμ·A0/A at 10³ s against C/A for ΔV = 0, one point per surface; grey: the line through all.",
    "fig6": "Fig. 6: h'_rms = 0.4, half hydroxylated, detachment-front factor 0.15; right: what β hangs on.",
    "table1": "Table 1: patches and contour length over area (h'_rms = 0.05, 20 µN); grey: equality.",
    "kappa": "Contact area and κ against load, with the theories of Persson (orange) and of Bush, Gibson & Thomas "
    "(green); right: κ of the rows of Table 1 and of Fig. 6.",
    "maps": "Supplement: contact of each row of Table 1.",
    "areas": "Supplement: contact area against load.",
    "barriers": "Supplement: E_form(t = 0) against load.",
    "interaction": "Our own: ΔF against the strength of the interaction.",
    "temperature": "Our own: β and ΔF against temperature, of a piece of the rough contact (231 nm) and of a tip "
    "(30 nm, 50 nN).",
    "tips": "Our own: ΔF and β of tips against load, with β of atomic force microscopy as the paper gives it.",
}

#: probable reasons for differences, and what is open, by target
REASONS = {
    "fig2": """ΔF against log t looks straight (R² above 0.99), but its local slope falls from the first decade
to the last by far more than its error: hold times of 1 s to 10⁵ s see barriers over 0.3 eV, and neither the density nor
the share of sites that are still free is constant over these. None of the laws compared need be exact.""",
    "kappa": """The paper gives 2.1 for the reference and "2 to 2.3" for the rows, from one realisation and its
pixels; a row agrees if it lies in that range. A/A0 = 0.01 has one digit, so that any value from 0.005 to 0.015
agrees. E* = 35.3 GPa is used; the stated E and ν give 35.79 GPa, which would change the area by −1.4 %. At h' = 0.4
part of the contact exceeds 10 GPa, where silica would yield.""",
    "table1": """The paper has one realisation. With η = 1 (cross) the longest waves have most of the height, and the
contact consists of a few islands that differ from surface to surface; a single surface may have half as many patches as
another. Over eight surfaces N_p is low in
most rows, within what chance explains (`chemage reproduce patches`). If
the paper counts a patch that crosses an edge twice and does not connect corners, 1.4 % are left; which of the rest
holds is open, as the paper's surfaces are not published.""",
    "fig3": """The barriers from molecular dynamics are not published. The density used instead is fitted to these
six β, which therefore test nothing: the residual and the band over densities that the paper leaves open are in the
table. That of all numbers here (member 0) has the least misfit of rates and times together. With ΔV at
1 s, Δμ falls with A/A0 along a curve and not along a line: a power of A/A0, with the exponent −0.53, leaves an rms of
1.5 % where the line leaves 9.2 %. The rows lie on one curve, so the word for *other parameters* comes from the line
that the test assumes. The caption in the paper
assigns the second set to panel (b); it belongs to panel (d).""",
    "fig5": """The limit is a correlation of 0.95, over surfaces and over means of rows. The means of the rows are
above it at every slope; single surfaces are not at the larger slopes, where the change with C/A is only some 4 %. Noise
of the replicas, two on most surfaces, is a likely part of the scatter; it was not separated.""",
    "fig6": """The paper does not state the fit window, nor whether half of the sites react because one face or both
faces are half hydroxylated, and gives ΔV as "0.04 Å³", which is taken as 0.04 eV/GPa. β changes by more between these
readings than it differs from the paper's; the figure shows each.""",
    "tips": """ΔF grows as a power of the load between the area of a tip (2/3) and a line: the area times the effect of
pressure. A line through it has an offset, but fits worse by far. The paper quotes β of atomic force microscopy, about
15 at 23 nN and 1.5 at 393 nN: 115 and 197 bonds per decade, a ratio of {bonds:.1f} at a ratio of the loads of 17. A
contact without adhesion has a ratio of the areas of 17^(2/3) = 6.6, so that no radius gives both. The likely reason is
adhesion, which the paper's model does not have: an adhesive force of about {adhesion:.0f} nN added to both loads gives
the ratio (Hertz, area ∝ F^(2/3)). With the contacts `jkr` and `dmt` a tip of 100 nm and a work of adhesion of 0.2 and
0.5 J/m² has β of 12.2 and 1.40, and of 12.8 and 1.25 (`tests/benchmarks/tip_adhesion.py`); one of 30 nm needs more than
2 J/m². Neither radius nor adhesion is published with β, and two parameters for two numbers test nothing, so they are
not fitted: the measured pull-off force, 94 nN and 314 nN here, would decide.""",
    "temperature": """The claim is from the model of a single asperity that the paper builds on. It is tested for
the growth per decade, β over 10 to 10⁴ s. ΔF itself rises to a broad maximum at a higher temperature, where forming and
breaking balance within the hold time.""",
}


#: in place of the parameters of a power without an exponent
DEGENERATE = "degenerate, its exponent runs to 0: the logarithm"


@dataclass(frozen=True)
class Reproduction:
    """Everything that a reproduction found, for its page and the terminal."""

    lines: list[Line]
    claims: list[Claim]
    estimates: list[Estimate] = field(default_factory=list)
    #: β of Fig. 6 by what it hangs on
    variants: dict[str, Mean] = field(default_factory=dict)
    #: β over the members of the barrier density
    bands: list[Band] = field(default_factory=list)
    #: the least and the largest of times of Fig. 3 over the members, s
    times: dict[str, tuple[float, float]] = field(default_factory=dict)


def of_points(file: Path) -> tuple[Reproduction, str]:
    """Compare the stored points of :func:`chemage_li2018.sweeps.save_points` with the paper, and write the page."""
    points, about = read_points(file)
    names = about["targets"]
    studies = studies_of(points, names)
    compared = Reproduction(
        comparisons.lines(studies, names),
        claims.claims(studies, names),
        list(estimates.estimates(studies)) if "estimates" in names else [],
        estimates.variants(studies) if "fig6" in names else {},
        estimates.bands(studies) if "calibration" in names else [],
        estimates.times(studies) if "calibration" in names else {},
    )
    return compared, page(compared, names, seeds=about["seeds"], pixels=about["pixels"], versions=about["versions"])


def page(
    results: Reproduction, targets: Sequence[str], *, seeds: Sequence[int], pixels: int, versions: dict[str, str]
) -> str:
    """Write the page as Markdown."""
    surfaces = f"one surface per row (seed {seeds[0]})"
    if len(seeds) > 1:
        surfaces = f"{len(seeds)} surfaces per row (seeds {seeds[0]} to {seeds[-1]})"
    return render(
        "reproduction",
        results=results,
        paper=published.PAPER,
        targets=" all" if len(targets) == len(TARGETS) else " " + " ".join(targets),
        surfaces=surfaces,
        seeds=seeds,
        pixels=pixels,
        versions=versions,
        common=COMMON,
        equal=EQUAL,
        fig_6=float(published.FIG_6_BETA),
        word=_word,
        parameters=_parameters,
        misses=[line for line in results.lines if line.word == DISAGREES],
        reasons={name: reason(name) for name in targets if name in REASONS},
        captions={name: CAPTIONS[name] for name in targets if name in CAPTIONS},
        folder=FIGURES,
    )


def _word(one: Line | Claim | Estimate) -> str:
    return f"**{one.word}**" if one.word == DISAGREES else one.word


def _parameters(law: ScalingLaw) -> str:
    return ", ".join(f"{number:.3g}" for number in law.parameters) or DEGENERATE


def reason(target: str) -> str:
    """The probable reason for the differences of a target."""
    (low, first), (high, last) = ((load, float(text)) for load, text in published.TIP_BETA.items())
    bonds = last * high / (first * low)
    share = bonds**-1.5  # (low + adhesion) / (high + adhesion), area ∝ load^(2/3)
    adhesion = (share * high - low) / (1 - share)
    return " ".join(REASONS[target].split()).format(bonds=bonds, adhesion=adhesion)
