"""How all figures look: width in print, font and style file, said once for all that are drawn inside one block."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

from chemage.foundation.errors import InputError, nearest
from chemage.foundation.files import read_text
from chemage.foundation.units import convert

#: widths that have a name, mm
COLUMNS = {"1": 85.0, "2": 180.0}
#: mm; what is narrower or wider is no figure on a page
NARROWEST, WIDEST = 50.0, 1000.0
#: pt; no text is smaller
SMALLEST_FONT = 7.0
#: what a larger font makes larger
_SIZES = (
    "font.size",
    "axes.titlesize",
    "axes.labelsize",
    "xtick.labelsize",
    "ytick.labelsize",
    "legend.fontsize",
    "legend.title_fontsize",
    "figure.titlesize",
)
#: of a program, not of a figure
_NO_STYLE = (
    "backend",
    "interactive",
    "toolbar",
    "webagg",
    "savefig.directory",
    "figure.max_open_warning",
)


@dataclass(frozen=True)
class Look:
    """How figures are drawn.

    Parameters
    ----------
    width
        In print, mm: each panel is as wide as its column, and its text has the size that the style says. None: for a
        screen.
    family, size
        Of the font, pt; as the style says where not given.
    style
        File of matplotlib's settings (``.mplstyle``) that replace chemage's own.
    """

    width: float | None = None
    family: str = ""
    size: float | None = None
    style: str = ""

    @classmethod
    def of(
        cls, width: str | None = None, font: str | None = None, style: object = None
    ) -> Look:
        """The look that ``--width``, ``--font`` and ``--style`` say.

        Raises
        ------
        InputError
            The width is no length of a page, the font is not installed or too small, or the style has a setting that
            matplotlib does not know.
        """
        family, size = _font(font) if font else ("", None)
        look = cls(
            _width(width) if width else None,
            family,
            size,
            str(style) if style else "",
        )
        look.settings()
        return look

    def settings(self) -> dict[Any, Any]:
        """Matplotlib's settings, those of the style file and the font included."""
        import matplotlib as mpl

        settings = {**_style(None), **(_style(self.style) if self.style else {})}
        if self.family:
            settings["font.family"] = [self.family]
        if self.size:
            with mpl.rc_context(settings):
                factor = self.size / mpl.rcParams["font.size"]
                sizes = {name: mpl.rcParams[name] for name in _SIZES}
            for name, size in sizes.items():
                if isinstance(size, int | float):
                    settings[name] = max(SMALLEST_FONT, factor * size)
        return settings


_USUAL = Look()
_LOOK: ContextVar[Look] = ContextVar("look", default=_USUAL)


def current() -> Look:
    """The look of what is drawn now."""
    return _LOOK.get()


@contextmanager
def drawn_as(look: Look | None = None) -> Iterator[Look]:
    """Draw and save all figures in this block with one look; without ``look`` with that of the block around it."""
    import matplotlib as mpl

    chosen = look or current()
    token = _LOOK.set(chosen)
    try:
        with mpl.rc_context(chosen.settings()):
            yield chosen
    finally:
        _LOOK.reset(token)


def colours() -> list[str]:
    """The colours of curves in the order of the style."""
    import matplotlib as mpl
    from matplotlib.colors import to_hex

    cycle = (
        current().settings().get("axes.prop_cycle", mpl.rcParams["axes.prop_cycle"])
    )
    return [to_hex(colour).upper() for colour in cycle.by_key().get("color", [])]


def _width(text: str) -> float:
    remedy = "give 1 or 2 for columns of 85 and 180 mm, or a length such as 120 mm"
    if text.strip() in COLUMNS:
        return COLUMNS[text.strip()]
    if not any(letter.isalpha() for letter in text):
        raise InputError.of(
            "width", text, "is neither one nor two columns and has no unit", remedy
        )
    width = convert(text, "nm", "width") * 1e-6
    if not NARROWEST <= width <= WIDEST:
        raise InputError.of(
            "width", text, f"is not between {NARROWEST:g} and {WIDEST:g} mm", remedy
        )
    return width


def _font(text: str) -> tuple[str, float | None]:
    """Family and size (pt) of ``"Arial 9"``, ``"Arial"`` or ``"9"``."""
    from matplotlib import font_manager

    *words, last = text.replace(" pt", "").split() or [""]
    try:
        size = float(last)
    except ValueError:
        words, size = [*words, last], None
    if size is not None and not SMALLEST_FONT <= size <= 30:
        raise InputError.of(
            "font",
            text,
            f"is not between {SMALLEST_FONT:g} and 30 pt",
            'give "Arial 9", say',
        )
    family = " ".join(words)
    known = sorted({entry.name for entry in font_manager.fontManager.ttflist})
    if family and family not in (*known, "sans-serif", "serif", "monospace"):
        listed = ", ".join(known[:12]) + (", …" if len(known) > 12 else "")
        raise InputError.of(
            "font",
            family,
            f"is not installed{nearest(family, known)}",
            f"choose of {listed}",
        )
    return family, size


@lru_cache(maxsize=8)
def _parsed(text: str, where: str) -> dict[Any, Any]:
    """The settings in the text of a style file."""
    import matplotlib as mpl
    from matplotlib import cbook

    settings: dict[Any, Any] = mpl.RcParams()
    for number, line in enumerate(text.splitlines(), 1):
        name, colon, value = cbook._strip_comment(line).partition(":")  # pyright: ignore[reportAttributeAccessIssue]
        name = name.strip()
        if not name:
            continue
        place = f"{where}, line {number}"
        if not colon:
            raise InputError(
                f"{place}: {line.strip()!r} is no setting; write NAME: VALUE"
            )
        if name.startswith(_NO_STYLE):
            raise InputError(
                f"{place}: {name} is a setting of the program, not of a figure; leave it out"
            )
        if name not in mpl.rcParams:
            raise InputError(
                f"{place}: matplotlib has no setting {name!r}{nearest(name, list(mpl.rcParams))}"
            )
        try:
            settings[name] = re.sub(r'^"(.*)"$', r"\1", value.strip())
        except ValueError as error:
            raise InputError(f"{place}: {error}") from None
    return dict(settings)


def _style(path: str | None) -> dict[Any, Any]:
    if path is None:
        name = "chemage.mplstyle"
        return _parsed(
            resources.files("chemage.foundation").joinpath(name).read_text("utf-8"),
            name,
        )
    return _parsed(read_text(path, 1e6), path)
