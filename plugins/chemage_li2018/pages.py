"""Pages of studies: Markdown templates of this package."""

from __future__ import annotations

import re
from importlib import resources
from typing import Any


def render(template: str, **values: Any) -> str:
    """Fill a template of this package with values."""
    import jinja2

    page = jinja2.Template(
        resources.files("chemage_li2018")
        .joinpath(f"{template}.md.j2")
        .read_text("utf-8"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).render(values)
    return re.sub(r"\n{3,}", "\n\n", page).strip() + "\n"
