"""Figures for print: every figure of every kind of result fits one and two columns, and looks as its baseline.

``CHEMAGE_BASELINES=new python -m pytest
tests/results/test_printed_figures.py`` draws the baselines again; look at them before they are committed.
"""

from __future__ import annotations

import csv
import io
import os
import tomllib
from functools import cache
from itertools import combinations
from pathlib import Path

import faults as faults_made
import numpy as np
import pytest
from made_results import every_result, made_ageing, made_comparison, made_contact, made_run, made_surface
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.offsetbox import AnchoredOffsetbox
from matplotlib.text import Text
from PIL import Image
from seen import comparison_figures, drawn_data, figures

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
WIDTHS = ("1", *(pytest.param(width, marks=pytest.mark.campaign) for width in ("2", None)))


@pytest.fixture(scope="module")
def results():
    return every_result()


def drawn_anew(results, width: str | None) -> dict[str, Figure]:
    """Name -> figure of all results, for tests that change them."""
    with looks.drawn_as(looks.Look.of(width)):
        named = {
            f"{kind}-{name}".replace(" ", "-"): figure
            for kind, result in results.items()
            for name, figure in figures(result).items()
        }
        return named | {f"comparison-{name}": one for name, one in comparison_figures(made_comparison()).items()}


@pytest.fixture(scope="module")
def drawn(results):
    """The same by width, drawn once, for tests that only look."""
    return cache(lambda width: drawn_anew(results, width))


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


@pytest.mark.long
@pytest.mark.parametrize("width", WIDTHS)
def test_no_text_overlaps_leaves_the_figure_or_is_small(width, drawn, monkeypatch):
    with looks.drawn_as(looks.Look.of(width)):
        found = {name: wrong for name, figure in drawn(width).items() if (wrong := faults(figure, monkeypatch))}
    assert found == {}
    inches = {figure.get_size_inches()[0] for figure in drawn(width).values()}
    assert width is None or inches == {looks.COLUMNS[width] / 25.4}


@pytest.mark.long
@pytest.mark.parametrize("width", WIDTHS)
def test_the_same_holds_for_a_real_run_with_figures_of_plugins_and_a_sweep(width, computed, monkeypatch):
    run, swept = computed
    with looks.drawn_as(looks.Look.of(width)):
        named = {**figures(run), **figures(swept), **figures(swept, heat=True)}
        assert len(named) >= 7
        found = {name: wrong for name, figure in named.items() if (wrong := faults(figure, monkeypatch))}
    assert found == {}


@pytest.mark.long
def test_legends_leave_two_thirds_of_a_figure_in_one_column(drawn):
    for name, figure in drawn("1").items():
        legends = [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]
        share = sum(legend.get_window_extent().height for legend in legends) / figure.bbox.height
        assert share < 1 / 3, f"{name}: {100 * share:.0f} %"


def test_faults_are_found(monkeypatch):
    figure, (axes,) = plots.panels(2.0, 1.0)
    axes.text(0.5, 0.5, "one text")
    axes.text(0.51, 0.5, "another", fontsize=5)
    axes.text(3.0, 0.5, "outside").set_in_layout(False)
    found = " ".join(faults(figure, monkeypatch))
    for words in ("'another' has 5 pt", "'outside' leaves", "'one text' and 'another' overlap"):
        assert words in found


def thumbnail(figure: Figure) -> np.ndarray:
    """The plots of a figure, which is changed, as a small image; without words, whose size differs between fonts."""
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


@pytest.mark.long
def test_every_figure_looks_as_its_baseline(results):
    with looks.drawn_as(looks.Look.of("1")):
        made = {name: thumbnail(figure) for name, figure in drawn_anew(results, "1").items()}
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


@pytest.mark.long
def test_a_curve_that_is_missing_is_seen(results):
    figure = drawn_anew({"force": results["force"]}, "1")["force-friction"]
    before = thumbnail(figure)
    (bars,) = figure.axes[0].containers
    for artist in (bars.lines[0], *bars.lines[1], *bars.lines[2]):
        artist.set_visible(False)
    assert difference(before, thumbnail(figure)) > 3 * DIFFERENT


# -- looks ------------------------------------------------------------------------------------------------------------


def test_the_usual_style_has_the_palette_and_text_as_text():
    with looks.drawn_as():
        assert looks.colours() == [colour.upper() for colour in plots.PALETTE]
    settings = looks.Look().settings()
    assert (settings["pdf.fonttype"], settings["svg.fonttype"]) == (42, "none")


def test_colours_of_curves_differ_for_all_kinds_of_sight():
    """Distances in CIELAB of the first seven colours as protanopes and deuteranopes see them (Viénot et al. 1999)."""
    from matplotlib.colors import to_rgb

    def seen(colour, kind):
        linear = np.power(np.array(to_rgb(colour)), 2.2)
        if kind != "all":
            to_lms = np.array(
                [[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]]
            )
            keep = {
                "red": [[0, 2.02344, -2.52581], [0, 1, 0], [0, 0, 1]],
                "green": [[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]],
            }
            linear = np.clip(np.linalg.inv(to_lms) @ np.array(keep[kind]) @ to_lms @ linear, 0, 1)
        xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ linear
        f = np.cbrt(xyz / [0.9505, 1.0, 1.089])
        return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])

    for kind in ("all", "red", "green"):
        for one, other in combinations(plots.PALETTE[:7], 2):
            assert np.linalg.norm(seen(one, kind) - seen(other, kind)) > 9, (kind, one, other)


def test_a_style_file_replaces_colours_fonts_and_lines(tmp_path):
    file = tmp_path / "mine.mplstyle"
    file.write_text('axes.prop_cycle: cycler("color", ["111111", "222222"])\naxes.titlesize: 11\nlines.linewidth: 3\n')
    with looks.drawn_as(looks.Look.of("1", None, file)):
        axes = figures(made_ageing(load=0.0))["friction"].axes[0]
    assert to_hex(axes.lines[0].get_color()) == "#111111"
    assert axes.title.get_fontsize() == 11
    assert axes.xaxis.label.get_fontsize() == 8


def test_a_font_has_family_and_size(tmp_path):
    with looks.drawn_as(looks.Look.of("2", "DejaVu Serif 10")):
        made = figures(made_ageing())
        plots.save_figures(made, tmp_path, suffix="svg", data=True)
    text = (tmp_path / "friction.svg").read_text()
    assert "font-family: 'DejaVu Serif'" in text or "DejaVu Serif" in text
    assert ">hold time (s)</text>" in text
    assert made["friction"].axes[0].xaxis.label.get_fontsize() == 10
    with looks.drawn_as():
        plots.save_figures(figures(made_ageing()), tmp_path, suffix="pdf")
    assert b"/Type3" not in (tmp_path / "friction.pdf").read_bytes()


@pytest.mark.parametrize(
    ("width", "font", "style", "words"),
    [
        ("3", None, None, "neither one nor two columns"),
        ("2 mm", None, None, "not between 50 and 1000 mm"),
        ("3 s", None, None, "width"),
        (None, "5", None, "not between 7 and 30 pt"),
        (None, "Wingdinks 9", None, "is not installed"),
        (None, None, "lines.linewith: 3", "line 1: matplotlib has no setting 'lines.linewith' .did you mean"),
        (None, None, "\nlines.linewidth: thick", "line 2: "),
        (None, None, "backend: pdf", "backend is a setting of the program"),
        (None, None, "lines.linewidth 3", "is no setting; write NAME: VALUE"),
    ],
)
def test_wrong_looks_are_refused(width, font, style, words, tmp_path):
    file = tmp_path / "x.mplstyle"
    if style:
        file.write_text(style)
    with pytest.raises(ca.InputError, match=words):
        looks.Look.of(width, font, file if style else None)


# -- single panels and numbers -----------------------------------------------------------------------------------------


def test_panels_are_chosen_by_name():
    ageing = made_ageing()
    (name,) = figures(ageing, ["slope"])
    assert name == "friction-slope"
    assert list(figures(ageing, ["friction"])) == ["friction", "friction-slope"]
    (one,) = figures(ageing, ["friction-slope"]).values()
    assert len(one.axes) == 1
    with pytest.raises(ca.InputError, match=r"did you mean 'slope'.*choose of friction, slope"):
        figures(ageing, ["slop"])


def table(figure: Figure) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(drawn_data(figure))))


def test_the_table_beside_a_figure_has_its_numbers():
    ageing = made_ageing()
    rows = [row for row in table(figures(ageing)["friction"]) if "replicas" in row["curve"] and row["panel"] == "1"]
    assert [float(row["x"]) for row in rows] == ageing.hold_times.tolist()
    assert [float(row["y"]) for row in rows] == ageing.mean_friction_coefficient_drop.tolist()
    half = [0.5 * (float(row["high"]) - float(row["low"])) for row in rows]
    assert half == pytest.approx(ageing.friction_coefficient_drop_half_width)
    assert rows[0]["y quantity"] == "friction coefficient drop Δμ"


@pytest.mark.long
def test_bands_bars_and_maps_are_in_the_table(results, drawn):
    inference = {name.removeprefix("inference-"): one for name, one in drawn("2").items()}
    band = [row for row in table(inference["density"]) if row["curve"] == "90 % band"]
    one = results["inference"].inference
    low, high = one.band(0.90)
    assert [(float(row["low"]), float(row["high"])) for row in band] == list(zip(low, high, strict=True))
    heights = [row for row in table(figures(made_surface())["surface"]) if row["value"]]
    assert (
        np.array([float(row["value"]) for row in heights]).reshape(96, 96).T.tolist() == made_surface().heights.tolist()
    )
    assert len([row for row in table(inference["unknowns"]) if row["y"]]) >= 40


@pytest.mark.long
def test_forecasts_and_measurements_have_the_colour_of_their_condition(results, drawn):
    result = results["inference"]
    plots_ = drawn("2")["inference-forecasts"].axes
    colours = {line.get_label(): to_hex(line.get_color()) for axes in plots_ for line in axes.lines}
    measured = {label: colour for label, colour in colours.items() if label.startswith("measured")}
    assert len(set(measured.values())) == 2
    assert colours["load=20 nN, temperature=350 K"] == measured["measured: 20 nN, 350 K"]
    shown = [label.partition(" (")[0] for label in colours if label.startswith("load")]
    assert sorted(shown) == sorted(result.forecasts), "all of the table are drawn"
    for label, one in result.forecasts.items():
        lines = [line for axes in plots_ for line in axes.lines if str(line.get_label()).startswith(label)]
        assert lines[0].get_ydata() == pytest.approx(one.band(0.90)[0] if one.bounds_only else one.median)


@pytest.mark.long
def test_scatter_between_surfaces_is_drawn_where_it_is_larger_than_the_error_of_the_replicas(monkeypatch):
    run = made_run(made_ageing())
    error = run.fit().relative_stderr
    for scatter, expected in ((0.5 * error, []), (0.1, ["β of other surfaces, 95 % (± 20 %)"]), (None, []), (0.0, [])):
        faults_made.known_scatter(monkeypatch, scatter)
        axes = figures(run)["friction"].axes[1]
        assert [one.get_label() for one in axes.collections if "other" in str(one.get_label())] == expected


def test_contacts_can_be_seen_and_the_zoom_is_where_its_box_is():
    contact = made_contact()
    with looks.drawn_as(looks.Look.of("1")):
        figure = figures(contact)["pressure"]
        whole, zoom = figure.axes[:2]
        (box,) = whole.patches
        assert box.get_bbox().extents == pytest.approx(zoom.viewLim.extents)
        blocks = whole.images[0].get_array()
        # a block is no smaller than a dot of a printer at 300 dpi, and contact is far from white
        assert blocks.shape[0] <= whole.get_window_extent().width / figure.dpi * 300
        low = whole.images[0].cmap(0.0)
        assert min(low[:3]) < 0.3
    for axes in (whole, zoom):
        (bar,) = [one for one in axes.artists if isinstance(one, AnchoredOffsetbox)]
        words = [text.get_text() for text in bar.findobj(Text)]
        assert any(word.endswith("nm") for word in words)
