"""Figures show the numbers of the run: what is drawn is compared with what is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from seen import every_figure, figures, published, report, result_of

import chemage
import chemage_ageing
from chemage import Ageing, ContactSolution, compare_files, load_scene
from chemage.plugin import StoreError, looks, statistics
from chemage.plugin import figures as plots
from chemage.plugin import text as wording


@pytest.fixture(scope="module")
def result(tmp_path_factory, small_text):
    file = tmp_path_factory.mktemp("run") / "small.toml"
    file.write_text(small_text)
    return chemage.run(load_scene(file))


def contact_of(pressure, periodic=False):
    pressure = np.asarray(pressure, dtype=float)
    return ContactSolution(
        pressure=pressure, load=float(pressure.sum()), pixel_size=1.0, modulus=35.3, periodic=periodic
    )


def test_pooling_keeps_the_peaks_and_the_shape():
    values = np.zeros((2000, 1200))
    values[1234, 567] = 7.0
    small = plots.pooled(values, np.max)
    assert small.shape == (667, 400)
    assert small.max() == 7.0
    assert np.argwhere(small == 7).tolist() == [[1234 // 3, 567 // 3]]
    assert plots.pooled(values[:30, :30], np.max) is not None
    assert plots.pooled(np.full((901, 3), 2.0), np.mean).tolist() == np.full((451, 2), 2.0).tolist()


def test_the_surface_map_has_x_to_the_right(result):
    figure = figures(result.surface)["surface"]
    image = figure.axes[0].images[0]
    assert np.array_equal(image.get_array(), result.surface.heights.T)
    assert image.get_extent() == pytest.approx([0, 48 * 0.4518, 0, 48 * 0.4518])
    assert image.origin == "lower"


def test_the_spectrum_is_that_of_the_surface(result):
    (line,) = figures(result.surface)["surface"].axes[1].lines
    q, density = result.surface.psd()
    drawn = dict(line.get_xydata())
    assert drawn
    known = dict(zip(q, density, strict=True))
    assert all(drawn[x] == known[x] for x in drawn)
    assert max(drawn) <= 8.001 * 2 * np.pi / (48 * 0.4518) * np.sqrt(1.2)


def test_what_is_not_in_contact_is_blank(result):
    image = figures(result.contact)["pressure"].axes[0].images[0]
    shown = image.get_array()
    assert np.array_equal(~np.ma.getmaskarray(shown).T, result.contact.contact)
    assert image.get_clim() == (0.0, result.contact.pressure.max())


def test_patches_are_outlined_along_their_pixels():
    pressure = np.zeros((9, 11))
    pressure[2:5, 3:7] = 1.0
    pressure[7, 8] = 2.0
    contact = contact_of(pressure)
    (outlines,) = figures(contact)["pressure"].axes[1].collections[:1]
    segments = np.array(outlines.get_segments())
    lengths = np.abs(np.diff(segments, axis=1)).sum()
    assert lengths == contact.perimeter == 14 + 4
    assert segments[..., 0].min() == 2.0
    assert segments[..., 0].max() == 8.0


def test_a_window_shows_the_largest_patch():
    pressure = np.zeros((400, 300))
    pressure[10:20, 10:20] = 1.0
    pressure[350:380, 200:210] = 2.0
    axes = figures(contact_of(pressure))["pressure"].axes[1]
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    assert (x0 <= 350, x1 >= 380) == (True, True)
    assert (y0 <= 200, y1 >= 210) == (True, True)
    assert x1 - x0 < 200


def test_full_contact_is_shown_between_its_extremes():
    pressure = np.linspace(100, 120, 64).reshape(8, 8)
    image = figures(contact_of(pressure))["pressure"].axes[0].images[0]
    assert image.get_clim() == (100.0, 120.0)


def test_friction_is_drawn_with_its_errors_and_its_fit(result):
    coefficient, local = figures(result)["friction"].axes
    t, drops = np.log10(result.ageing.hold_times), result.ageing.friction_coefficient_drop
    pairs = [(i, min(j for j in range(t.size) if t[j] - t[i] > 0.499)) for i in range(t.size) if t[-1] - t[i] > 0.499]
    slopes = np.array([(drops[:, j] - drops[:, i]) / (t[j] - t[i]) for i, j in pairs]).T
    for axes, times, values in (
        (coefficient, t, drops),
        (local, [0.5 * (t[i] + t[j]) for i, j in pairs], slopes),
    ):
        (bars,) = axes.containers
        line, _, (sticks,) = bars
        assert np.log10(line.get_xdata()) == pytest.approx(times)
        assert line.get_ydata() == pytest.approx(values.mean(axis=0))
        half = [0.5 * (stick[1, 1] - stick[0, 1]) for stick in sticks.get_segments()]
        # an error that is not known has no bar
        assert half == pytest.approx(np.nan_to_num(statistics.half_width(values)))
    assert not np.allclose(*(axes.containers[0][0].get_ydata()[-3:] for axes in (coefficient, local)))
    (fitted,) = [line for line in coefficient.lines if str(line.get_label()).startswith("β")]
    fit = result.fit()
    t, y = fitted.get_xdata(), fitted.get_ydata()
    assert np.diff(y) / np.diff(np.log10(t)) == pytest.approx(fit.beta)
    assert (t[0], t[-1]) == pytest.approx((10.0, 1e4))
    assert (
        fitted.get_label()
        == f"β = {wording.with_error(fit.beta, fit.beta_half_width)} per decade (fitted line, 10–10⁴ s)"
    )
    labels = [text.get_text() for text in coefficient.get_legend().get_texts()]
    assert labels == [f"{result.name}, mean of {result.ageing.replicas} replicas, 95 %", fitted.get_label()]


def test_barriers_are_normalised_and_labelled_for_what_lowered_them(result, tmp_path, small_text):
    figure = figures(result)["barriers"]
    axes = figure.axes[0]
    start = axes.patches[0]
    values, edges, _ = start.get_data()
    assert np.sum(values * np.diff(edges)) == pytest.approx(1.0)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[:2] == ["intrinsic", "lowered by pressure"]
    file = tmp_path / "small.toml"
    file.write_text(small_text)
    without = chemage.run(load_scene(file, {"chemistry": None}))
    labels = [text.get_text() for text in figures(without)["barriers"].axes[0].get_legend().get_texts()]
    assert "lowered by pressure" not in labels


def test_a_run_without_observables_has_no_barrier_figure(tmp_path, small_text):
    file = tmp_path / "small.toml"
    file.write_text(small_text)
    made = figures(chemage.run(load_scene(file, {"observe": None})))
    assert "barriers" not in made
    assert "friction" in made


def test_figures_of_plugins_that_are_gone_are_left_out(result, isolated_registry):
    assert list(figures(result)) == ["surface", "pressure", "friction"]


def test_figures_of_barriers_that_are_gone_lack_only_their_density(result, isolated_registry):
    isolated_registry.register(chemage_ageing, "ageing")
    axes = figures(result)["barriers"].axes[0]
    assert not axes.lines
    assert len(axes.patches) >= 3


def test_saving_checks_every_name_before_the_first_is_written(result, tmp_path):
    (tmp_path / "friction.png").write_text("mine")
    with pytest.raises(StoreError, match=r"friction\.png is already there"):
        plots.save_figures(figures(result), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["friction.png"]


@pytest.mark.long
@pytest.mark.drawn
def test_each_figure_is_drawn_once(result, tmp_path, monkeypatch):
    """``savefig`` draws a figure twice, and what it writes is the same."""
    made, again, drawn = every_figure(result), every_figure(result), []
    draw = Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda self, renderer: (drawn.append(self), draw(self, renderer)))
    for path in plots.save_figures(made, tmp_path):
        assert drawn.count(made[path.stem]) == 1
        with looks.drawn_as():
            again[path.stem].savefig(tmp_path / "twice", format="png")
        assert (tmp_path / "twice").read_bytes() == path.read_bytes()


def test_blocks_of_a_map_are_the_largest_or_the_mean_of_their_pixels():
    values = np.random.default_rng(0).normal(size=(23, 40))
    padded = np.pad(values, ((0, 1), (0, 0)), mode="edge")
    for pool in (np.max, np.mean):
        blocks = [[pool(padded[4 * i : 4 * i + 4, 4 * j : 4 * j + 4]) for j in range(10)] for i in range(6)]
        assert plots.pooled(values, pool, 10) == pytest.approx(np.array(blocks))


def test_saving_into_what_is_no_folder(result, tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(StoreError, match="cannot make the folder"):
        plots.save_figures(figures(result), tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.long
def test_nothing_global_changes(result, tmp_path):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    plots.save_figures(figures(result), tmp_path / "figures")
    assert dict(mpl.rcParams) == before


@pytest.mark.drawn
@pytest.mark.parametrize(
    ("pixel_size", "top"),
    [(1e-3, 0.01), *(pytest.param(*one, marks=pytest.mark.long) for one in ((0.45, 14.4), (2.824, 5.978))), (1e6, 1e3)],
)
def test_titles_and_labels_are_inside_the_figure(pixel_size, top):
    pressure = np.zeros((300, 300))
    pressure[60:85, 180:210] = np.linspace(0.01, 1, 750).reshape(25, 30) * top
    contact = ContactSolution(pressure=pressure, load=1.0, pixel_size=pixel_size, modulus=35.3)
    heights = np.random.default_rng(0).normal(size=(300, 300))
    surface = chemage.Surface(heights=heights * top, pixel_size=pixel_size)
    for figure in (figures(surface)["surface"], figures(contact)["pressure"]):
        figure.canvas.draw()
        inside = figure.bbox.padded(-3)
        for axes in figure.axes:
            for text in (axes.title, axes.xaxis.label, axes.yaxis.label):
                place = text.get_window_extent()
                if text.get_text():
                    assert inside.x0 <= place.x0 < place.x1 <= inside.x1, text.get_text()
                    assert inside.y0 <= place.y0 < place.y1 <= inside.y1, text.get_text()


def with_patches(*patches):
    pressure = np.zeros((64, 64))
    for x, y, side in patches:
        pressure[x : x + side, y : y + side] = 1.0
    return ContactSolution(pressure=pressure, load=1.0, pixel_size=0.5, modulus=35.3)


def captions(contact):
    """Of the maps on a page."""
    return [panel.caption for picture in result_of(contact).pictures().values() for panel in picture.panels]


def test_one_patch_is_drawn_once_and_no_contact_not_at_all():
    none, one, two = with_patches(), with_patches((20, 20, 6)), with_patches((5, 5, 3), (40, 40, 6))
    assert figures(none) == {}
    assert captions(none) == []
    (tip, bar) = figures(one)["pressure"].axes
    assert tip.get_title().startswith("1 patch")
    assert np.ptp(tip.get_xlim()) == pytest.approx(8 * 0.5), "the window is as large as the patch needs"
    assert bar.get_ylabel() == "pressure (GPa)"
    assert len(captions(one)) == 1
    assert len(figures(two)["pressure"].axes) == 4  # two maps with their bars
    assert len(captions(two)) == 2


def test_without_load_there_is_no_empty_panel(result):
    ageing = Ageing(**result.ageing.todict() | {"load": 0.0})
    figure = figures(replace(result, ageing=ageing))["friction"]
    labels = ["friction drop ΔF (nN)", "slope dΔF/dlog$_{10}$t per decade (nN)"]
    assert [axes.get_ylabel() for axes in figure.axes] == labels
    once = Ageing(**ageing.todict() | {"hold_times": np.full_like(ageing.hold_times, 10.0)})
    assert len(figures(replace(result, ageing=once))["friction"].axes) == 1
    at_once = Ageing(**ageing.todict() | {"hold_times": np.zeros_like(ageing.hold_times)})
    assert "friction" not in figures(replace(result, ageing=at_once))


def test_the_published_slope_of_a_scene_is_drawn_beside_its_fit():
    scene = load_scene("silica-rough").todict()
    ((beta, source),) = published(scene)
    assert beta == 0.45
    assert "Li et al." in source
    assert published({**scene, "contact": {**scene["contact"], "load": 1000.0}}) == []
    assert published(load_scene("silica-tip").todict()) == []


def test_the_line_and_the_range_of_a_fit_are_those_of_the_hold_times_there_are(result, tmp_path, small_text, command):
    """Three hold times end at 100 s, in a window to 10⁴ s: nothing is drawn or claimed beyond, and it is said."""
    file = tmp_path / "small.toml"
    file.write_text(small_text)
    few = chemage.run(load_scene(file, {"hold.stop": 100.0, "hold.per_decade": 2}))
    assert few.fit().span == pytest.approx((10.0, 100.0))
    doubt = "β rests on 3 hold times over 1 decade; take at least six over two decades"
    assert doubt in few.notes
    assert not any("rests on" in note for note in result.notes)
    (fitted,) = [line for line in figures(few)["friction"].axes[0].lines if "β" in str(line.get_label())]
    assert (min(fitted.get_xdata()), max(fitted.get_xdata())) == pytest.approx((10.0, 100.0))
    assert fitted.get_label().endswith(f"(fitted line, 10–100 s)\n{doubt.partition(';')[0]}")
    assert few.summary()["fit_range"] == pytest.approx([10.0, 100.0])
    chemage.write(tmp_path / "few.h5", few)
    shown = command("show", tmp_path / "few.h5").out
    assert "over 3 hold times from 10 to 100 s" in shown
    assert doubt in " ".join(shown.split())
    rows = dict(compare_files([tmp_path / "few.h5"]).table())
    assert doubt in rows["ageing rate per decade β"][0]
    page = report([tmp_path / "few.h5"])
    assert doubt in page
    notebook = few._repr_html_()
    assert "over 3 hold times from 10 to 100 s" in notebook
    for text in (shown, page, notebook, str(rows)):
        assert "10–10⁴ s" not in text
        assert "10000 s" not in text
