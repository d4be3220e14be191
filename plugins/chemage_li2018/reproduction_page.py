"""The page of the reproduction with all numbers, claims and figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from chemage_li2018 import claims, comparisons, estimates, published
from chemage_li2018.comparisons import COMMON, DISAGREES, Claim, Estimate, Line
from chemage_li2018.estimates import Band, Variant
from chemage_li2018.shapes import EQUAL
from chemage_li2018.sweeps import TARGETS, read_points, studies_of

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
the paper counts a patch that crosses an edge twice and does not connect corners, 1.4 % are left. Load, modulus,
tolerance and pixels do not explain it; which of the rest holds is open, as the paper's surfaces are not published.""",
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

_HEAD = """# Reproduction of the paper

{paper}: the published numbers, figures and claims beside ours. Output of `chemage reproduce{targets} --seeds
{count}` with {pixels} x {pixels} pixels, {surfaces} and 10 replicas of the disorder on each (on the
rows of Table 1 other than the circle, for the interaction, and from 100 µN on, 2); chemage {chemage}, numpy {numpy},
numba {numba}, processor {processor}. Another kind of processor rounds otherwise, which moves mean β by up to 0.3 %. The
seeds 101 and above were used to tune nothing: neither the barrier density nor any option.

*Ours* is the mean over surface seeds ± the standard deviation between them; error bars and bands in figures are the
same. The paper has one realisation of each surface. Every comparison has one of four words:

- *calibrated*: the barrier density was fitted to this number or statement; its agreement says nothing about accuracy.
- *predicted*: not fitted, and the two agree: within the digits or the range of the paper, within {common:.0%}, or
  within the interval that holds the value of one more surface with a probability of 95 % (the column *because* says
  which). A claim is predicted if it holds.
- *disagrees*: not fitted, and the two do not agree, or the claim does not hold.
- *not tested*: the reason stands beside it.{coarse}"""


_COARSE = (
    "\n\n**Coarse surfaces:** a pixel is one site, so coarser pixels have fewer bonds; β and Δμ are not comparable "
    "with those of the paper, and contours are shorter."
)


@dataclass(frozen=True)
class Reproduction:
    """Everything that a reproduction found, for its page and the terminal."""

    lines: list[Line]
    claims: list[Claim]
    estimates: list[Estimate] = field(default_factory=list)
    #: β of Fig. 6 by what it hangs on
    variants: list[Variant] = field(default_factory=list)
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
        estimates.estimates(studies) if "estimates" in names else [],
        estimates.variants(studies) if "fig6" in names else [],
        estimates.bands(studies) if "calibration" in names else [],
        estimates.times(studies) if "calibration" in names else {},
    )
    return compared, page(compared, names, seeds=about["seeds"], pixels=about["pixels"], versions=about["versions"])


def page(
    results: Reproduction,
    targets: Sequence[str],
    *,
    seeds: Sequence[int],
    pixels: int,
    versions: dict[str, str],
) -> str:
    """Write the page as Markdown."""
    several = f"{len(seeds)} surfaces per row (seeds {seeds[0]} to {seeds[-1]})"
    parts = [
        _HEAD.format(
            paper=published.PAPER,
            targets=" all" if len(targets) == len(TARGETS) else " " + " ".join(targets),
            count=len(seeds),
            pixels=pixels,
            surfaces=several if len(seeds) > 1 else f"one surface per row (seed {seeds[0]})",
            common=COMMON,
            coarse="" if pixels == 2500 else _COARSE,
            **{name: versions[name] for name in ("chemage", "numpy", "numba")},
            processor=versions["processor"].partition(" ")[0],
        )
    ]
    if results.lines:
        parts.append(_lines_table(results.lines))
    misses = [line for line in results.lines if line.word == DISAGREES]
    if misses:
        parts.append(
            "Disagree: "
            + "; ".join(f"{line.quantity} ({line.shown})" for line in misses)
            + ". Probable reasons are given below."
        )
    parts += [
        table for table in (_bands_table(results.bands, results.times), _variants_table(results.variants)) if table
    ]
    if results.claims:
        rows = [f"| {c.target} | {c.statement} | {c.ours} | {_word(c.word)} |" for c in results.claims]
        parts.append(_table("Claims", "figure | claim | found | word", rows))
        parts += [table for table in [_laws_table(results.claims)] if table]
    if results.estimates:
        rows = [f"| {e.statement} | {e.ours} | {e.how} | {_word(e.word)} |" for e in results.estimates]
        parts.append(_table("Estimates of the text", "paper | ours | how ours is computed | word", rows))
    reasons = [f"- **{name}**: {_reason(name)}" for name in targets if name in REASONS]
    if reasons:
        parts.append("## Reasons for differences\n\n" + "\n".join(reasons))
    drawn = [name for name in targets if name in CAPTIONS]
    if drawn:
        parts.append("## Figures")
    parts += [f"![{CAPTIONS[name]}]({FIGURES}/{name}.png)\n\n*{name}*. {CAPTIONS[name]}" for name in drawn]
    return "\n\n".join(parts) + "\n"


def _word(word: str) -> str:
    return f"**{word}**" if word == DISAGREES else word


def _reason(name: str) -> str:
    (low, first), (high, last) = ((load, float(text)) for load, text in published.TIP_BETA.items())
    bonds = last * high / (first * low)
    share = bonds**-1.5  # (low + adhesion) / (high + adhesion), area ∝ load^(2/3)
    adhesion = (share * high - low) / (1 - share)
    text = REASONS[name]
    return " ".join((text.format(bonds=bonds, adhesion=adhesion) if name == "tips" else text).split())


def _table(title: str, header: str, rows: Sequence[str]) -> str:
    count = header.count("|") + 1
    return f"## {title}\n\n" + "\n".join([f"| {header} |", "| " + " | ".join(["---"] * count) + " |", *rows])


def _lines_table(lines: Sequence[Line]) -> str:
    rows = [
        f"| {line.target} | {line.quantity} | {line.paper.text} | {line.ours} | {line.shown} | "
        f"{_word(line.word)} | {'' if line.calibrated else line.reason} |"
        for line in lines
    ]
    return _table("Numbers", "target | quantity | paper | ours | difference | word | because", rows)


#: in place of the parameters of a power without an exponent
DEGENERATE = "degenerate, its exponent runs to 0: the logarithm"


def _laws_table(claims: Sequence[Claim]) -> str:
    rows = [
        f"| {claim.statement} | {law.name} | "
        f"{', '.join(f'{number:.3g}' for number in law.parameters) or DEGENERATE} | "
        f"{law.chi_squared:.1f} | {law.criterion - claim.laws[0].criterion:.1f} |"
        for claim in claims
        for law in claim.laws
    ]
    if not rows:
        return ""
    text = (
        "\n\nLaws of growth with hold time are fitted to the increments of the mean curve, relative to the mean "
        "increment, with the errors of independent surfaces; laws of the load to ΔF, with the errors of replicas. A "
        f"statement is refused if a rival has a criterion (AICc) lower by more than {EQUAL:g}, unless the local slope "
        f"changes by less than {COMMON:.0%} from the first decade to the last."
    )
    return (
        _table("Claims of shape against rivals", "claim | law | its parameters | χ² | AICc over the least", rows) + text
    )


def _bands_table(bands: Sequence[Band], times: dict[str, tuple[float, float]]) -> str:
    if not bands:
        return ""
    rows = [
        f"| {b.quantity} | {b.paper} | {b.residual:+.1%} | {b.low:+.1%} to {b.high:+.1%} | {b.word} |" for b in bands
    ]
    text = (
        f"\n\nThe barrier density has {bands[0].members} members that span what the published rates and times and an "
        "unknown window of the fit leave open (`barrier_density.md`). The band is the smallest and the largest β over "
        "these, relative to the density of all other numbers (member 0), on the first surface with the same random "
        "numbers; the residual is that of member 0, ours over the paper's less one, on all surfaces. **Every number "
        "that rests on the density has the error of the band beside the scatter between surfaces.**"
    )
    if times:
        listed = ", ".join(f"{name} {low:.2g} to {high:.2g} s" for name, (low, high) in times.items())
        text += f" Of the times in the claims on Fig. 3, to which they are fitted, the members give: {listed}."
    return _table("Calibration", "quantity | paper | residual | band over the members | word", rows) + text


def _variants_table(variants: Sequence[Variant]) -> str:
    if not variants:
        return ""
    paper = float(published.FIG_6_BETA)
    rows = [f"| {variant.name} | {variant.beta} | {variant.beta.value / paper - 1:+.1%} |" for variant in variants]
    return _table("What β of Fig. 6 hangs on", f"computed with | β | relative to {published.FIG_6_BETA}", rows)
