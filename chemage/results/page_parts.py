"""What the page of a report is made of: sections, tables, pictures."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Table:
    """A table of text; a ``wide`` one scrolls horizontally on narrow screens."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    wide: bool = False


@dataclass(frozen=True)
class Picture:
    """A figure as markup, with its caption."""

    picture: Any
    caption: str


@dataclass
class Part:
    """The content below one heading of a section."""

    heading: str = ""
    #: the main numbers, in large type: (value, what it is)
    numbers: list[tuple[str, str]] = field(default_factory=list)
    paragraphs: list[Any] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    figures: list[Picture] = field(default_factory=list)
    code: str = ""
    items: list[str] = field(default_factory=list)


@dataclass
class Section:
    """A section of the page; ``key`` is its anchor."""

    key: str
    name: str
    paragraphs: list[str] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)


def markup(text: str) -> Any:
    """Text that is markup already, so that it is not escaped."""
    from markupsafe import Markup

    return Markup(text)


def scene_part(scene: Mapping[str, Any], but: str = "") -> Part:
    """The scene of a result; ``but`` says in what a run of it may differ."""
    about = markup(
        "All options, in internal units (nm, nN, GPa, eV, s, K). Saved as a file, this scene reproduces the result "
        f"with <code>chemage run</code>{but}."
    )
    return Part("Scene", paragraphs=[about], code=scene_toml(scene))


def scene_toml(scene: Mapping[str, Any]) -> str:
    """Format plain scene data as TOML, from which equal data can be read."""
    import tomli_w

    return tomli_w.dumps(scene)


def svg(figure: Figure, alt: str, key: str) -> str:
    """Make inline SVG without addresses or metadata, with unique ids and the text colour of the page for black."""
    import matplotlib as mpl

    data = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": "chemage"}):
        figure.savefig(data, format="svg", transparent=True, metadata=nothing)
    text = data.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text).replace("xlink:href=", "href=")
    text = re.sub(r'\bid="', f'id="{key}-', text)
    text = text.replace('href="#', f'href="#{key}-').replace("url(#", f"url(#{key}-")
    text = text.replace("#000000", "currentColor")
    label = f'role="img" aria-label="{escape(alt, quote=True)}" fill="currentColor"'
    return re.sub(r"<svg\b", f"<svg {label}", text, count=1)
