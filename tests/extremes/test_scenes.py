"""Scenes at the edge of what makes sense: each runs, says what is special, and has figures one can look at."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from internals import figures_of

import chemage
from chemage import load_scene, parse_scene

LOOKED_AT = (pytest.mark.long, pytest.mark.drawn)
#: drawing takes most of the time: without it every case is quick, with it long
DRAWN = pytest.mark.parametrize("drawn", [False, pytest.param(True, marks=LOOKED_AT)])


def cases(*given):
    """Pairs of a value and whether its figures are drawn, each also without; those with figures are long."""
    plain = [(value, False) for value, _ in given]
    return plain + [pytest.param(value, True, marks=LOOKED_AT) for value, drawn in given if drawn]


def carried_out(small, *, drawn, **changes):
    """The small scene with dotted changes (``a__b`` is ``a.b``), run in this process.

    If ``drawn``, its figures must be sound.
    """
    result = chemage.run(load_scene(small, {name.replace("__", "."): value for name, value in changes.items()}))
    json.dumps(result.summary(), allow_nan=False)
    if drawn:
        look(result)
    chemage.write("x.h5", result, force=True)
    again = chemage.read("x.h5")
    assert (again.surface, again.contact, again.ageing) == (result.surface, result.contact, result.ageing)
    return result


def look(result):
    """Every figure draws (any warning is an error), has labelled axes with finite limits, and shows something."""
    made = figures_of(result)
    assert {"surface", *(["pressure"] if result.contact.patches else [])} <= made.keys()
    for name, figure in made.items():
        figure.canvas.draw()
        for axes in figure.axes:
            for low, high in (axes.get_xlim(), axes.get_ylim()):
                assert math.isfinite(low), name
                assert math.isfinite(high), name
                assert low < high, name
            box = axes.get_window_extent()
            assert min(box.width, box.height) > 10, f"{name}: axes of {box.width:.0f} x {box.height:.0f} pixels"
            assert axes.get_ylabel() or axes.get_xlabel(), name
            for text in (axes.title, axes.xaxis.label, axes.yaxis.label):
                place = text.get_window_extent()
                if text.get_text():
                    assert figure.bbox.x0 - 1 <= place.x0 < place.x1 <= figure.bbox.x1 + 1, f"{name}: {text.get_text()}"
                    assert figure.bbox.y0 - 1 <= place.y0 < place.y1 <= figure.bbox.y1 + 1, f"{name}: {text.get_text()}"
            assert axes.lines or axes.images or axes.collections or axes.patches or axes.texts, name
    return made


def heights(small, values, pixel_size=0.45, periodic=True, load="20 nN"):
    """A scene of the small one's chemistry on ``values``."""
    np.save("heights.npy", values)
    text = small.read_text()
    start, end = text.index("[surface]"), text.index("[contact]")
    table = f'kind = "from-file"\npath = "heights.npy"\npixel_size = {pixel_size}\nperiodic = {str(periodic).lower()}'
    small.write_text((f"{text[:start]}[surface]\n{table}\n\n{text[end:]}").replace('"40 nN"', f'"{load}"'))


# -- load ------------------------------------------------------------------------------------------------------------


@DRAWN
def test_no_load_is_a_contact_without_sites(small, command, drawn):
    result = carried_out(small, contact__load=0, drawn=drawn)
    assert (result.contact.sites.size, result.contact.patches) == (0, 0)
    assert not result.ageing.friction_drop.any()
    assert np.isnan(result.ageing.friction_coefficient_drop).all()
    summary = result.summary()
    assert set(summary["friction_drop"]) == {0.0}
    assert set(summary["friction_coefficient_drop"]) == {None}
    for name in ("kappa", "mean_contact_pressure", "perimeter_to_area", "beta", "cutoff_time"):
        assert summary[name] is None, name
    assert any("no load" in note for note in summary["notes"])
    done = command("run", small, "--set", "contact.load='0 N'", "--json")
    assert done.status == 0, done.err
    numbers = json.loads(done.out)
    assert numbers["friction_drop"]["value"] == summary["friction_drop"]
    assert len(numbers["figures"]) >= 3
    assert command("show", "small.h5").status == 0


@pytest.mark.parametrize(("load", "drawn"), cases((1e-9, True), (1.0, False)))
def test_a_vanishing_load_touches_somewhere(small, load, drawn):
    result = carried_out(small, contact__load=load, drawn=drawn)
    assert 1 <= result.contact.sites.size < 60
    assert result.contact.pressure.sum() * 0.4518**2 == pytest.approx(load, rel=1e-4)


@pytest.mark.parametrize(("load", "drawn"), cases(("20 uN", True), ("1 N", False)))
def test_a_load_beyond_full_contact_says_so(small, command, load, drawn):
    result = carried_out(small, contact__load=load, drawn=drawn)
    assert result.contact.area_fraction == 1
    (note,) = [note for note in result.summary()["notes"] if note.startswith("full contact")]
    assert command("show", "x.h5").out.replace("\n", " ").count(note) == 1
    assert not any("full" in note for note in chemage.run(load_scene(small)).summary()["notes"])


# -- grids -----------------------------------------------------------------------------------------------------------


@pytest.mark.drawn
def test_a_single_pixel(small):
    heights(small, np.zeros((1, 1)), load="1 nN")
    result = carried_out(small, drawn=True)
    assert result.contact.shape == (1, 1)
    assert result.contact.area_fraction == 1
    assert result.contact.pressure[0, 0] == pytest.approx(1 / 0.45**2)
    assert set(result.ageing.sites) == {1}
    assert result.ageing.bonds.max() <= 1


@pytest.mark.parametrize(("pixels", "drawn"), cases(([1, 64], True), ([64, 1], False), ([33, 21], False), (47, True)))
def test_grids_that_are_not_square_or_even(small, pixels, drawn):
    result = carried_out(
        small,
        surface__pixels=pixels,
        surface__zeta=3,
        surface__eta=1,
        contact__load="5 nN",
        drawn=drawn,
    )
    shape = tuple(pixels) if isinstance(pixels, list) else (pixels, pixels)
    assert result.surface.shape == result.contact.shape == shape
    total = float(result.contact.pressure.sum(dtype=float)) * 0.4518**2
    assert total == pytest.approx(5, rel=1e-5)


@pytest.mark.drawn
@pytest.mark.long
def test_a_strip_is_stretched_until_it_can_be_seen(small):
    changes = {"surface.pixels": [1200, 20], "surface.zeta": 24, "contact.load": "0.3 uN"}
    result = chemage.run(load_scene(small, changes))
    assert result.contact.shape == (1200, 20)
    made = look(result)
    for name in ("surface", "pressure"):
        box = made[name].axes[0].get_window_extent()
        assert min(box.width, box.height) > 200


@pytest.mark.parametrize(
    ("flat", "drawn"),
    cases(
        *(((shape, periodic), True) for shape, periodic in [((1, 1), True), ((1, 1), False), ((1, 5), False)]),
        (((16, 16), True), False),
        (((16, 16), False), True),
    ),
)
def test_a_flat_surface(small, flat, drawn):
    shape, periodic = flat
    heights(small, np.full(shape, 3.0), periodic=periodic)
    result = carried_out(small, drawn=drawn)
    assert (result.surface.rms_height, result.surface.rms_slope) == (0, 0)
    if periodic:
        assert result.contact.area_fraction == 1
        assert np.ptp(result.contact.pressure) <= 1e-5 * result.contact.pressure.max()


# -- time and replicas -----------------------------------------------------------------------------------------------


@pytest.fixture
def timed(small):
    """The small scene with its own hold times."""

    def change(*times):
        small.write_text(small.read_text().replace('start = "1 ms"\nstop = "1e5 s"', f"times = {list(times)}"))
        return small

    return change


@DRAWN
def test_one_hold_time_and_one_replica(timed, drawn):
    result = carried_out(timed(10.0), drawn=drawn, hold__replicas=1)
    assert result.ageing.bonds.shape == (1, 1)
    summary = result.summary()
    assert summary["friction_drop_stderr"] == [None]
    assert summary["beta"] is None


@DRAWN
def test_hold_time_zero_has_no_bonds(timed, drawn):
    result = carried_out(timed(0.0), drawn=drawn)
    assert not result.ageing.bonds.any()


@DRAWN
def test_zero_is_a_hold_time_among_others_and_a_time_may_come_twice(timed, drawn):
    result = carried_out(timed(0.0, 10.0, 10.0, 1000.0), drawn=drawn)
    assert not result.ageing.bonds[:, 0].any()
    assert np.array_equal(result.ageing.bonds[:, 1], result.ageing.bonds[:, 2])
    assert result.fit() is not None


def test_hold_times_with_units(timed):
    assert load_scene(timed("1 ms", "2 min")).hold.hold_times.tolist() == [1e-3, 120.0]


@DRAWN
def test_a_fit_window_without_hold_times_gives_no_beta(small, drawn):
    assert carried_out(small, fit={"start": 1e6, "stop": 1e7}, drawn=drawn).summary()["beta"] is None


@DRAWN
def test_ages_of_the_universe_and_great_heat(timed, drawn):
    result = carried_out(timed(1e-15, 4e17), hold__temperature=3000, breaking=None, drawn=drawn)
    assert np.array_equal(result.ageing.bonds[:, 1], result.ageing.sites)


# -- what is left out is not modelled --------------------------------------------------------------------------------


@DRAWN
def test_without_interaction_there_is_no_neighbour_list(small, drawn):
    scene = load_scene(small, {"interaction": None})
    contact = carried_out(small, interaction=None, drawn=drawn).contact
    lattice = scene.chemistry.on(contact, seed=1)
    assert (lattice.neighbours, lattice.coupling, lattice.interacting) == (None, None, False)
    assert load_scene(small).chemistry.on(contact, seed=1).interacting


@DRAWN
def test_without_breaking_bonds_last(small, drawn):
    result = carried_out(small, breaking=None, interaction=None, drawn=drawn)
    bonds = result.ageing.bonds
    assert (np.diff(bonds, axis=1) >= 0).all()
    assert np.array_equal(result.ageing.events, bonds[:, -1])
    with_breaking = chemage.run(load_scene(small, {"interaction": None})).ageing
    assert (with_breaking.events > with_breaking.bonds[:, -1]).any()


def test_without_activation_volume_pressure_only_decides_who_is_in_contact(small):
    scene = load_scene(small, {"chemistry": None})
    contact = chemage.run(scene).contact
    doubled = contact.model_copy(update={"pressure": 2 * contact.pressure})
    one, two = (scene.chemistry.on(c, seed=3) for c in (contact, doubled))
    assert np.array_equal(one.forming, two.forming)
    assert np.array_equal(one.sites, contact.sites)


@DRAWN
def test_without_forming_only_the_contact_is_computed(small, drawn):
    data = {name: part for name, part in load_scene(small).todict().items() if name in ("name", "surface", "contact")}
    scene = parse_scene(data)
    assert (scene.chemistry, scene.hold, scene.engine) == (None, None, None)
    result = chemage.run(scene)
    assert result.ageing is None
    if drawn:
        assert look(result).keys() == {"surface", "pressure"}
    summary = result.summary()
    assert summary["engine"] is None
    assert (summary["hold_times"], summary["friction_drop"]) == ([], [])
    assert result.contact == chemage.run(load_scene(small)).contact


@DRAWN
def test_no_site_carries_a_hydroxyl(small, drawn):
    result = carried_out(small, chemistry__hydroxylation=0, drawn=drawn)
    assert result.contact.sites.size > 0
    assert not result.ageing.sites.any()
    assert not result.ageing.friction_drop.any()
