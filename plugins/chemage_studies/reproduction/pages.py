"""The page of the reproduction with all numbers, claims and figures."""

from __future__ import annotations

from collections.abc import Sequence

from chemage_studies.reproduction import published
from chemage_studies.reproduction.checks import Claim, Line

CAPTIONS = {
    "fig1": "ΔF and Δμ against hold time at loads from 5 to 500 µN (reference surface).",
    "fig2": "Barrier and pressure distributions at three loads; ΔF and Δμ against load; ΔF against contact area.",
    "fig3": "Δμ against hold time and against h'_rms, with the activation volume (left) and without (right).",
    "fig4": "ΔF against the strength of the interaction. The claim is from the paper, the figure number is ours.",
    "fig5": "Δμ·A0/A against contour length over area, rows of Table 1.",
    "fig6": "h'_rms = 0.4, half hydroxylated, detachment-front factor 0.15.",
    "table1": "Patches and contour length over area, rows of Table 1 (h'_rms = 0.05, 20 µN).",
    "kappa": "Contact area against load, with the theories of Persson (orange) and of Bush, Gibson & Thomas (green).",
}

#: probable reasons for differences, by target
REASONS = {
    "kappa": """The paper gives 2.1 for the reference and "2 to 2.3" for the rows (2.15 above), from one
realisation and its pixels. E* = 35.3 GPa is used; the stated E and ν give 35.79 GPa, which would change the area by
−1.4 %.""",
    "table1": """The paper has one realisation. With η = 1 (cross) the longest waves have most of the height, and the
contact consists of a few islands that differ from surface to surface. The number of patches is small for small ζ or
η = 1, and its scatter between seeds is large. The number of very small patches depends on 8-connectivity and on the
pixel size.""",
    "fig3": """The barriers from molecular dynamics are not published. The triangular density used instead is fitted to
the results with ΔV, so that those without ΔV are the independent test. The caption in the paper assigns the second set
to panel (b); it belongs to panel (d).""",
    "fig6": """ΔV is given as "0.04 Å³" in the text of the paper, which is taken as 0.04 eV/GPa.""",
}

_HEAD = """# Reproduction of the paper

{paper}: the published numbers and ours. Output of `chemage reproduce{targets} --seeds {count}` with {pixels} x
{pixels} pixels, {count} surface seeds ({first} to {last}) and 10 replicas of the disorder on each; chemage
{chemage}, numpy {numpy}, numba {numba}.

*Ours* is the mean over surface seeds and the standard deviation between them. The paper has one realisation of each
surface. *Within* states whether the difference is within the tolerance; `scatter` means that it is larger than the
tolerance, but within two standard deviations between seeds.{coarse}"""


_COARSE = (
    "\n\n**Coarse surfaces:** a pixel is one site, so coarser pixels have fewer bonds; β and Δμ are not comparable "
    "with those of the paper, and contours are shorter."
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
    """Write the page as Markdown; ``figures`` is the folder of its figures, relative to the page."""
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
            + ". Probable reasons are given below."
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
        parts.append("## Reasons for differences\n\n" + "\n".join(reasons))
    parts.append("## Figures")
    parts += [f"![{CAPTIONS[name]}]({figures}/{name}.png)\n\n*{name}*: {CAPTIONS[name]}" for name in targets]
    return "\n\n".join(parts) + "\n"


def _lines_table(lines: Sequence[Line]) -> str:
    rows = [
        "| target | quantity | paper | ours | difference | tolerance | within |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    rows += [
        f"| {line.target} | {line.quantity} | {line.paper:g} | {line.ours} | {line.difference:+.1%} | "
        f"{line.tolerance:.0%} | {line.within if line.within != 'no' else '**no**'} |"
        for line in lines
    ]
    return "## Numbers\n\n" + "\n".join(rows)
