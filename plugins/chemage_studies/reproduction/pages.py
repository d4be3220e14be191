"""The written side of the reproduction: one page with every number, claim and figure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from chemage_studies.reproduction import published
from chemage_studies.reproduction.checks import Claim, Line
from chemage_studies.reproduction.points import Mean

CAPTIONS = {
    "fig1": "ΔF and Δμ against hold time at loads from 5 to 500 µN (reference surface).",
    "fig2": "Barrier and pressure distributions at three loads; ΔF and Δμ against load; ΔF against contact area.",
    "fig3": "Δμ against hold time and against h'_rms, with the activation volume (left) and without (right).",
    "fig4": "ΔF against the strength of the interaction (a claim of the paper; the figure number is ours).",
    "fig5": "Δμ·A0/A against contour length over area, rows of Table 1.",
    "fig6": "h'_rms = 0.4, half hydroxylated, detachment-front factor 0.15.",
    "table1": "Patches and contour length over area, rows of Table 1 (h'_rms = 0.05, 20 µN).",
    "kappa": "Contact area against load, beside Persson (orange) and Bush, Gibson & Thomas (green).",
}

#: the most likely reason where a number is off, by target
REASONS = {
    "kappa": """The paper gives 2.1 for the reference and "2 to 2.3" for the rows (2.15 above), from the pixels of
one realisation. E* = 35.3 GPa is used here; the stated E and ν give 35.79 GPa, which would change
the area by −1.4 %.""",
    "table1": """The paper reports one realisation. With η = 1 (cross), the longest waves carry most of the height, a
contact consists of a few islands, and surfaces differ strongly. Where ζ is small or η = 1, patches are few
and the scatter between seeds is large. The number of tiny patches depends on 8-connectivity and on the pixel
size at the rim.""",
    "fig3": """The table of barriers from molecular dynamics is not published. The triangular distribution used here was
fitted to the set with ΔV, so that only the set without ΔV is an independent test. The paper's caption assigns
the second set to panel (b); it belongs to panel (d).""",
    "fig6": """ΔV is given as "0.04 Å³" in the paper's text, which reads as 0.04 eV/GPa.""",
}

_HEAD = """# Reproduction of the paper

This page compares the published numbers of {paper}, with those of
chemage. It was written by `chemage reproduce{targets} --seeds {count}`: {pixels} x {pixels} pixels, {count} surface
seeds ({first} to {last}), 10 replicas of the disorder on each; chemage {chemage}, numpy {numpy}, numba {numba}.

*Ours* is the mean over surface seeds with the standard deviation between them. The paper gives one realisation
of each surface. *Within* says whether the difference is inside the tolerance; `scatter` means that the difference
exceeds the tolerance, but not two standard deviations between seeds.{coarse}"""


_COARSE = (
    "\n\n**Coarse pixels:** a pixel is one site, so that coarser pixels carry fewer bonds. β and Δμ are not comparable "
    "with the paper's, and contours are shorter."
)


def page(
    lines: Sequence[Line],
    claims: Sequence[Claim],
    targets: Sequence[str],
    *,
    seeds: Sequence[int],
    pixels: int,
    figures: str,
    versions: dict[str, str],
) -> str:
    """Markdown; ``figures`` is the folder of the pictures as seen from the page."""
    parts = [
        _HEAD.format(
            paper=published.PAPER,
            targets="" if len(targets) == len(CAPTIONS) else " " + " ".join(targets),
            count=len(seeds),
            pixels=pixels,
            first=seeds[0],
            last=seeds[-1],
            coarse="" if pixels == 2500 else _COARSE,
            **{name: versions[name] for name in ("chemage", "numpy", "numba")},
        )
    ]
    if lines:
        parts.append(_lines_table(lines))
    misses = [line for line in lines if line.within == "no"]
    if misses:
        parts.append(
            "Outside both the tolerance and the scatter: "
            + "; ".join(f"{line.quantity} ({line.difference:+.1%})" for line in misses)
            + ". The most likely reasons are below."
        )
    if claims:
        parts.append(
            "## Claims\n\n"
            + "\n".join(
                ["| figure | claim | found | holds |", "| --- | --- | --- | --- |"]
                + [f"| {c.target} | {c.statement} | {c.found} | {'yes' if c.holds else '**no**'} |" for c in claims]
            )
        )
    reasons = [f"- **{name}**: {' '.join(REASONS[name].split())}" for name in targets if name in REASONS]
    if reasons:
        parts.append("## Notes on the comparison\n\n" + "\n".join(reasons))
    parts.append("## Figures")
    parts += [f"![{CAPTIONS[name]}]({figures}/{name}.png)\n\n*{name}*: {CAPTIONS[name]}" for name in targets]
    return "\n\n".join(parts) + "\n"


def _lines_table(lines: Sequence[Line]) -> str:
    rows = [
        "| target | quantity | paper | ours | difference | tolerance | within |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    rows += [
        f"| {line.target} | {line.quantity} | {line.paper:g} | {shown(line.ours)} | {line.difference:+.1%} | "
        f"{line.tolerance:.0%} | {line.within if line.within != 'no' else '**no**'} |"
        for line in lines
    ]
    return "## Numbers\n\n" + "\n".join(rows)


def shown(ours: Mean) -> str:
    """A mean with its scatter between seeds, to the scatter's second digit."""
    if not (math.isfinite(ours.scatter) and ours.scatter > 0):
        return f"{ours.value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(ours.scatter)))
    return f"{ours.value:.{digits}f} ± {ours.scatter:.{digits}f}"
