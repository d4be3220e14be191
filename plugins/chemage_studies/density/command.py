"""What ``chemage study density`` writes."""

from __future__ import annotations

from pathlib import Path


def write(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study, write page, figures and the table of densities into ``out``, and return their paths.

    Computed densities and contacts are kept in ``out/rates``; rerun the same command to resume.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or ``out`` cannot be written.
    """
    from chemage.plugin import StoreError, fresh_file, preflight, progress
    from chemage_studies.density import figures, page, table
    from chemage_studies.density.rates import Rates
    from chemage_studies.density.study import QUICK, Size, compute

    drawn = {
        "densities": figures.densities_figure,
        "residuals": figures.residuals_figure,
        "curves": figures.claims_figure,
    }
    try:
        (out / "figures").mkdir(parents=True, exist_ok=True)
        (out / "rates").mkdir(exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {out}: {error.strerror}") from error
    texts = [out / "barrier_density.md", out / "md_silica_barriers.csv"]
    pictures = [out / "figures" / f"density-{name}.png" for name in drawn]
    for path in (*texts, *pictures):
        preflight(path, force=force)
    size = QUICK if quick else Size()
    with progress.progress_bars() as report:
        study = compute(Rates(out / "rates", report, size.pixels), size)
    members = [one.parameters for one in (study.best, *study.members)]
    for path, text in zip(texts, (page.page(study, "figures"), table.table(study.family, members)), strict=True):
        with fresh_file(path, force=force) as part:
            part.write_text(text, encoding="utf-8")
    for path, draw in zip(pictures, drawn.values(), strict=True):
        with fresh_file(path, force=force) as part:
            draw(study).savefig(part, format="png")
    return [*texts, *pictures]
