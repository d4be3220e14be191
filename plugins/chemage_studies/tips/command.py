"""What ``chemage study tips`` writes."""

from __future__ import annotations

from pathlib import Path


def write(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study, write page, figures and tables into ``out``, and return their paths.

    Raises
    ------
    StoreError
        A file exists and ``force`` is false, or ``out`` cannot be written.
    """
    from chemage.plugin import StoreError, fresh_file, preflight, progress
    from chemage_studies.tips import figures, page
    from chemage_studies.tips.study import STRENGTHS, compute

    try:
        (out / "figures").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {out}: {error.strerror}") from error
    names = ["tips.md", "tips-contacts.csv", "tips-curves.csv"]
    pictures = [f"tips-{name}.png" for name in ("collapse", "pressure", "rim")]
    targets = [*(out / name for name in names), *(out / "figures" / name for name in pictures)]
    for path in targets:
        preflight(path, force=force)
    with progress.progress_bars() as report:
        studies = [compute(strength, report, quick=quick) for strength in STRENGTHS]
    texts = (page.page(studies, "figures"), page.contacts_csv(studies), page.curves_csv(studies))
    for path, text in zip(targets, texts, strict=False):
        with fresh_file(path, force=force) as part:
            part.write_text(text, encoding="utf-8")
    main = studies[0]
    drawn = (figures.collapse_figure(main), figures.pressure_figure(main), figures.rim_figure(studies))
    for path, figure in zip(targets[3:], drawn, strict=True):
        with fresh_file(path, force=force) as part:
            figure.savefig(part, format="png")
    return targets
