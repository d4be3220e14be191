"""Figures for print: every figure of every kind of result fits one and two columns, and looks as its baseline.

``CHEMAGE_BASELINES=new python -m pytest
tests/results/test_printed_figures.py`` draws the baselines again; look at them before they are committed.
"""

from __future__ import annotations

import os
import tomllib
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from made_results import every_result, made_comparison
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.offsetbox import AnchoredOffsetbox
from matplotlib.text import Text
from PIL import Image
from seen import comparison_figures, figures

import chemage as ca
from chemage.plugin import figures as plots
from chemage.plugin import looks

pytestmark = pytest.mark.drawn

BASELINES = Path(__file__).with_name("baselines")
#: pixels of a baseline along a side
SIDE = 128
#: of 255: root mean square difference of images that show the same. Another font gives 0, 256 colours in place of all
#: up to 0.7; a curve with its errors that is missing gives 2 to 12
DIFFERENT = 1.0
WIDTHS = ("1", "2", pytest.param(None, marks=pytest.mark.long))


@pytest.fixture(scope="module")
def drawn(quick_figures):
    """Name -> figure of all results by width, drawn once."""
    results = every_result()

    @cache
    def at(width: str | None) -> dict[str, Figure]:
        with looks.drawn_as(looks.Look.of(width)):
            named = {
                f"{kind}-{name}".replace(" ", "-"): figure
                for kind, result in results.items()
                for name, figure in figures(result).items()
            }
            return named | {f"comparison-{name}": one for name, one in comparison_figures(made_comparison()).items()}

    return at


@pytest.fixture(scope="module")
def computed(small_text, tmp_path_factory):
    """A run with figures of plugins, and a sweep."""
    scene = tomllib.loads(small_text)
    axes = {"hold.temperature": [300, 320], "contact.load": [20, 40], "hold.seed": [1, 2]}
    return ca.run(scene), ca.sweep({**scene, "sweep": axes}, tmp_path_factory.mktemp("swept") / "out")


def texts_of(figure: Figure, monkeypatch):
    """(text, box in points, size) of every text that is drawn."""
    found, original = [], Text.draw

    def draw(self, renderer, *args, **options):
        if self.get_visible() and self.get_text().strip():
            found.append(self)
        return original(self, renderer, *args, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", draw)
        plots.canvas_of(figure).draw()
    scale = 72 / figure.dpi
    return [(one.get_text(), one.get_window_extent().frozen().extents * scale, one.get_fontsize()) for one in found]


def faults(figure: Figure, monkeypatch) -> list[str]:
    """What is wrong with the texts of a figure, and plots that have no room."""
    texts = texts_of(figure, monkeypatch)
    width, height = 72 * figure.get_size_inches()
    found = [f"{text!r} has {size:g} pt" for text, _, size in texts if size < 6.99]
    for text, (x0, y0, x1, y1), _ in texts:
        if x0 < -0.5 or y0 < -0.5 or x1 > width + 0.5 or y1 > height + 0.5:
            found.append(f"{text!r} leaves the figure: {x0:.0f} to {x1:.0f} of {width:.0f}, {y0:.0f} to {y1:.0f}")
    for (first, a, _), (second, b, _) in combinations(texts, 2):
        if min(a[2], b[2]) - max(a[0], b[0]) > 0.7 and min(a[3], b[3]) - max(a[1], b[1]) > 0.7:
            found.append(f"{first!r} and {second!r} overlap")
    for axes in figure.axes:
        place = axes.get_subplotspec()
        box = axes.get_position()
        if place is not None and box.width < 0.4 / place.get_gridspec().ncols:
            found.append(f"a plot has only {100 * box.width:.0f} % of the width")
    return found


@pytest.mark.parametrize("width", WIDTHS)
def test_no_text_overlaps_leaves_the_figure_or_is_small(width, drawn, monkeypatch):
    with looks.drawn_as(looks.Look.of(width)):
        found = {name: wrong for name, figure in drawn(width).items() if (wrong := faults(figure, monkeypatch))}
    assert found == {}
    inches = {figure.get_size_inches()[0] for figure in drawn(width).values()}
    assert width is None or inches == {looks.COLUMNS[width] / 25.4}


@pytest.mark.parametrize("width", WIDTHS)
def test_the_same_holds_for_a_real_run_with_figures_of_plugins_and_a_sweep(width, computed, monkeypatch):
    run, swept = computed
    with looks.drawn_as(looks.Look.of(width)):
        named = {**figures(run), **figures(swept), **figures(swept, heat=True)}
        assert len(named) >= 7
        found = {name: wrong for name, figure in named.items() if (wrong := faults(figure, monkeypatch))}
    assert found == {}


def test_faults_are_found(monkeypatch):
    figure, (axes,) = plots.panels(2.0, 1.0)
    axes.text(0.5, 0.5, "one text")
    axes.text(0.51, 0.5, "another", fontsize=5)
    axes.text(3.0, 0.5, "outside").set_in_layout(False)
    found = " ".join(faults(figure, monkeypatch))
    for words in ("'another' has 5 pt", "'outside' leaves", "'one text' and 'another' overlap"):
        assert words in found


def thumbnail(figure: Figure) -> np.ndarray:
    """The plots of a figure as a small image without words, whose size differs between versions of fonts."""
    figure.set_layout_engine("none")
    figure.set_dpi(50)
    for artist in figure.findobj(lambda one: isinstance(one, Text | Legend | AnchoredOffsetbox)):
        artist.set_visible(False)
    for axes in figure.axes:
        if (place := axes.get_subplotspec()) is not None:
            axes.set_position(place.get_position(figure))
        axes.set_visible(place is not None)  # a colour bar has the place that words leave it
    canvas = plots.canvas_of(figure)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    return np.asarray(image.resize((SIDE, SIDE), Image.Resampling.BOX))


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Root mean square difference of blocks of 2 by 2 pixels, of 255."""
    blocks = (one.astype(float) - other).reshape(SIDE // 2, 2, SIDE // 2, 2, 3).mean(axis=(1, 3))
    return float(np.sqrt((blocks**2).mean()))


def test_every_figure_looks_as_its_baseline(drawn):
    with looks.drawn_as(looks.Look.of("1")):
        made = {name: thumbnail(figure) for name, figure in drawn("1").items()}
    if os.environ.get("CHEMAGE_BASELINES") == "new":
        BASELINES.mkdir(exist_ok=True)
        for old in BASELINES.glob("*.png"):
            old.unlink()
        for name, pixels in made.items():
            Image.fromarray(pixels).quantize(256).save(BASELINES / f"{name}.png", optimize=True)
    known = {path.stem: np.asarray(Image.open(path).convert("RGB")) for path in BASELINES.glob("*.png")}
    assert set(made) == set(known)
    changed = {name: far for name in made if (far := difference(made[name], known[name])) > DIFFERENT}
    assert changed == {}
