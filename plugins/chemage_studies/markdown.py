"""Markdown of the pages of studies."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence


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
