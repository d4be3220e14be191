"""``chemage study tips``: the study on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def study(
    name: Annotated[str, typer.Argument(help="which study: tips")],
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the page, its figures and tables")] = Path(
        "study-tips"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="a few contacts only, to see what comes out")] = False,
    force: Annotated[bool, typer.Option("--force", help="overwrite what is already there")] = False,
) -> None:
    """Run a study that comes with chemage and write it down: a page with figures, and tables as CSV."""
    from chemage import InputError

    if name != "tips":
        raise InputError(f"no study {name!r}; there is: tips")
    for path in write(out, quick=quick, force=force):
        typer.echo(path)


def write(out: Path, *, quick: bool = False, force: bool = False) -> list[Path]:
    """Run the study and write page, figures and tables into ``out``; existing files are kept unless ``force``."""
    from rich.console import Console
    from rich.progress import Progress

    from chemage import StoreError, fresh_file, preflight
    from chemage_studies.tips import page
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
    with Progress(console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def tell(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(f"interaction {stage}", total=total)
            bars.update(tasks[stage], completed=done)

        studies = [compute(strength, tell, quick=quick) for strength in STRENGTHS]
    texts = (page.page(studies, "figures"), page.contacts_csv(studies), page.curves_csv(studies))
    for path, text in zip(targets, texts, strict=False):
        with fresh_file(path, force=force) as part:
            part.write_text(text, encoding="utf-8")
    main = studies[0]
    drawn = (page.collapse_figure(main), page.pressure_figure(main), page.rim_figure(studies))
    for path, figure in zip(targets[3:], drawn, strict=True):
        with fresh_file(path, force=force) as part:
            figure.savefig(part, format="png")
    return targets
