"""Pages of studies: Markdown templates of this package."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

from chemage.plugin import StoreError, preflight


def render(template: str, **values: Any) -> str:
    """Fill a template of this package with values."""
    import jinja2

    text = resources.files("chemage_li2018").joinpath(f"{template}.md.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page = environment.from_string(text).render(values)
    return re.sub(r"\n{3,}", "\n\n", page).strip() + "\n"


def free_folder(out: Path, names: list[str], *, force: bool = False) -> None:
    """Make a folder with one for figures, before anything is computed.

    Raises
    ------
    StoreError
        A file of these names exists and ``force`` is false, or ``out`` cannot be written.
    """
    try:
        (out / "figures").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {out}: {error.strerror}") from error
    for name in names:
        preflight(out / name, force=force)
