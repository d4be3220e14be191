"""Markdown of the pages of studies, and their files."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from chemage.plugin import StoreError, fresh_file, preflight, write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Make a table."""
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def filled(text: str) -> str:
    """Break paragraphs and list items of Markdown at 120 characters; all else stays as it is."""
    blocks, code = [], False
    for block in re.split(r"\n{2,}", text.strip()):
        # code may have empty lines, and then is more than one block
        fences = len(re.findall(r"^```", block, re.MULTILINE))
        if code or fences or block.startswith(("#", "|", "!")):
            blocks.append(block)
            code ^= fences % 2 == 1
            continue
        indent = "  " if block.startswith("- ") else ""
        items = (" ".join(item.split()) for item in re.split(r"\n(?=- )", block))
        blocks.append(
            "\n".join(
                textwrap.fill(item, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
                for item in items
            )
        )
    return "\n\n".join(blocks) + "\n"


def write_pages(
    out: Path, texts: Mapping[str, Callable[[], str]], drawn: Mapping[str, Callable[[], Figure]], *, force: bool = False
) -> list[Path]:
    """Write texts and figures by their names in ``out``, and return their paths."""
    paths = []
    for name, text in texts.items():
        write_file(out / name, text(), force=force)
        paths.append(out / name)
    for name, draw in drawn.items():
        with fresh_file(out / "figures" / name, force=force) as part:
            draw().savefig(part, format="png")
        paths.append(out / "figures" / name)
    return paths


def free_folder(out: Path, names: Iterable[str], *, force: bool = False) -> None:
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
