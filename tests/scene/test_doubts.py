"""What is wrong or hopeless about a scene is said before anything is computed."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from seen import result_of

import chemage as ca
from chemage import run
from chemage.plugin import plan

PATCH, TIP = "silica-patch", "silica-tip"
BEM_TIP = {"contact": {"kind": "fft-bem", "modulus": 35.3, "load": "50 nN"}}
THEORY = {"contact": {"kind": "persson", "modulus": 35.3, "load": "839 nN"}, "observe": None}
CLOSURE = {"ageing": {"kind": "closure"}, "observe": None}
NO_SPAN = {"hold.start": None, "hold.stop": None}

#: scene, changes, what the plan warns of
DOUBTFUL = {
    "25 K for 25 °C": (PATCH, {"hold.temperature": 25.0}, 'hold.temperature = 25 K: is 25 °C meant? Write "25 degC"'),
    "27 K with the barriers that 27 K gives": (
        TIP,
        {"hold.temperature": 27.0, "forming": {"kind": "uniform", "lower": 0.05, "upper": 0.16}},
        'hold.temperature = 27 K: is 27 °C meant? Write "27 degC", which is 300.15 K',
    ),
    "30 K on a tip": (TIP, {"hold.temperature": 30.0}, "no bond is expected at 30 K and 100000 s, none in all"),
    "fit window after the hold times": (
        PATCH,
        {"fit.start": 1e6, "fit.stop": 1e7},
        "beta will not be fitted: no hold time lies between 1e+06 and 1e+07 s, 2 are needed (the hold times: 0.1 to",
    ),
    "fit window of one hold time": (PATCH, {"fit.start": 9.0, "fit.stop": 11.0}, "one hold time lies between 9 and 11"),
    "fit window of two hold times": (PATCH, {"fit.start": 9.0, "fit.stop": 20.0}, "β rests on 2 hold times over"),
    "three hold times over two decades": (
        PATCH,
        {"hold.times": [10.0, 100.0, 1000.0], **NO_SPAN},
        "β rests on 3 hold times over 2 decades",
    ),
    "rough, above the hardness": (
        PATCH,
        {"chemistry.hardness": "1 GPa"},
        "the mean contact pressure is expected to be 1.6 GPa, with 74 % of the contact area above the hardness",
    ),
    "tip, above the hardness": (TIP, {"chemistry.hardness": "1.2 GPa"}, "of the contact area above the hardness of"),
    "adhesion that the contact leaves out": (TIP, {"chemistry.work_of_adhesion": 0.05}, "holds this sphere with up to"),
    "modulus in Pa": (PATCH, {"contact.modulus": 35.3e9}, "contact.modulus = 3.53e+10 GPa: moduli and strengths"),
    "load in N": (PATCH, {"contact.load": 2e-5}, "Is load = 2e-05 nN meant? A bare number is in nN"),
    "pixels too large": (
        PATCH,
        {"surface.pixel_size": "1 um", "surface.pixels": 64, "surface.zeta": 8},
        "pixels will be in contact: the contact area is about",
    ),
    "attempt frequency in THz": (
        PATCH,
        {"chemistry.attempt_frequency": 10.0},
        "chemistry.attempt_frequency = 10 Hz: attempt frequencies are those of atoms, 1e12 to 1e14 Hz; a bare number",
    ),
    "activation volume in Å³": (
        PATCH,
        {"chemistry.activation_volume": 6.4},
        'chemistry.activation_volume = 6.4 nm**3: activation volumes are a few atoms, 0.001 to 0.1 nm³; a bare number',
    ),
    "bond force in N": (PATCH, {"chemistry.bond_force": 3e-9}, "chemistry.bond_force = 3e-09 nN: bonds break at"),
    "heights in metres": (
        PATCH,
        {"surface.rms_slope": 1e6},
        "the heights of the surface imply an rms slope of 1e+06 on pixels of 0.4518 nm, and rough surfaces have",
    ),
    "rms height in the wrong unit": (
        PATCH,
        {"surface.rms_slope": None, "surface.rms_height": "1 mm"},
        "are heights and pixels in nm? A file may be in metres or micrometres: give height_unit and pixel_size",
    ),
    "slopes that are not small": (PATCH, {"surface.rms_slope": 1.5}, "the rms slope is 1.5, and the half-space needs"),
    "a mean pressure near E*": (
        PATCH,
        {"surface.rms_slope": 0.8},
        "0.36 of the contact modulus, which no solid bears: use a contact with a hardness",
    ),
    "a tip under a mean pressure near E*": (
        TIP,
        {"surface.radius": 10, "contact.modulus": 5.0, "contact.load": "0.3 uN"},
        "which no solid bears",
    ),
    "shortest wavelength": (PATCH, {"surface.zeta": 200}, "the shortest wavelength is 2.6 pixels; pixel-scale errors"),
    "barrier of -1 eV": (
        PATCH,
        {"forming": {"kind": "gaussian", "mean": -1.0, "std": 0.1}},
        "half of the forming barriers are below -1 eV: no barrier is left to cross",
    ),
    "negative breaking barrier": (PATCH, {"breaking.mean": -1.0}, "breaking.mean = -1 eV: a barrier is not negative"),
    "barriers in kJ/mol": (
        PATCH,
        {"forming": {"kind": "gaussian", "mean": 80.0, "std": 5.0}},
        "forming.mean = 80 eV: barriers of bonds are 0.1 to 5 eV",
    ),
    "bonds that break sooner than they form": (
        TIP,
        {"breaking.mean": 0.1, "hold.replicas": 1},
        "no bond is expected at 300 K and 100000 s",
    ),
    "a few sites": (TIP, {"contact.load": "1 nN"}, "sites will be in contact; averages need many replicas or seeds"),
    "no load": (PATCH, {"contact.load": 0}, "the load is 0: nothing touches"),
    "full contact": (PATCH, {"contact.load": "300 uN"}, "the contact is expected to be nearly full"),
    "late start": (PATCH, {"hold.start": "1e15 s", "hold.stop": "1e17 s"}, "nearly every forming barrier is already"),
    "hours": (
        PATCH,
        {"hold.temperature": 400.0, "hold.stop": 1e7},
        "hours on",
    ),
    "hours at most, with superbasins": (
        PATCH,
        {"hold.temperature": 400.0, "hold.stop": 1e8, "engine": {"kind": "next-reaction", "superbasins": True}},
        "this will take up to",
    ),
    "a tip that nearly reaches the edge": (
        TIP,
        {**BEM_TIP, "contact.load": "4 uN"},
        "of the way from the apex to the edge of the grid",
    ),
    "a tip that is repeated": (
        TIP,
        {**BEM_TIP, "contact.boundary": "periodic"},
        "boundary = 'periodic' repeats a surface that is not periodic",
    ),
    "one period for the whole body": (
        PATCH,
        {"contact.boundary": "free"},
        "boundary = 'free' takes one period of a periodic surface for the whole body",
    ),
}  # fmt: skip

#: scene, changes, the error of check and of run
HOPELESS = {
    "hertz on a rough surface": (
        PATCH,
        {"contact": {"kind": "hertz", "modulus": 35.3, "load": "839 nN"}},
        "contact 'hertz' needs a sphere, but this surface has no radius",
    ),
    "hertz beyond the grid": (TIP, {"contact.load": "20 uN"}, "but the surface reaches only 14.46 nm from the apex"),
    "fft-bem beyond the grid": (TIP, {**BEM_TIP, "contact.load": "20 uN"}, "would be cut off at the edge of the grid"),
    "a layer under a tip": (TIP, {**BEM_TIP, "contact.thickness": "5 nm"}, "a layer needs a periodic surface"),
    "persson on a sphere": (
        TIP,
        {**THEORY, **CLOSURE},
        "contact 'persson' is a theory of randomly rough surfaces, and this surface is a sphere",
    ),
    "persson and every site": (PATCH, THEORY, "contact 'persson' gives statistics and no map of the pressure"),
    "persson and pixels": (
        PATCH,
        {**THEORY, **CLOSURE, "chemistry.site_density": "pixel"},
        "a contact without a map has no pixels; give the sites per nm²",
    ),
    "negative load": (TIP, {"contact.load": -5.0}, "contact.load: -5.0: must be finite and not negative"),
    "Hurst exponent": (PATCH, {"surface.hurst": 1.8}, "surface.hurst"),
    "waves below the pixels": (PATCH, {"surface.zeta": 300}, "above the Nyquist limit 256 of 512 pixels"),
    "hold times in the wrong order": (PATCH, {"hold.start": "1e5 s", "hold.stop": "0.1 s"}, "hold"),
    "negative seed": (PATCH, {"hold.seed": -1}, "hold.seed"),
    "an engine for sites that do not interact": (
        PATCH,
        {"engine": {"kind": "independent"}},
        "engine 'independent' treats sites that do not interact",
    ),
    "a window larger than the surface": (
        PATCH,
        {"ageing": {"kind": "sample", "share": 0.1, "window": 1000}, "observe": None},
        "window",
    ),
    "memory": (PATCH, {"surface.pixels": 1_000_000}, "use fewer pixels"),
    "a temperature in another dimension": (PATCH, {"hold.temperature": "25 eV"}, "hold.temperature"),
}  # fmt: skip


def planned(base, changes):
    return plan(ca.load_scene(base, changes))


@pytest.mark.parametrize("case", DOUBTFUL)
def test_what_is_doubtful_is_said(case):
    base, changes, said = DOUBTFUL[case]
    assert sum(said in note for note in planned(base, changes).notes) == 1, planned(base, changes).notes
    assert not any(said in note for note in planned(base, {}).notes)


def test_a_solver_that_limits_the_pressure_is_not_above_the_hardness():
    texts = [
        "\n".join(planned(PATCH, {"chemistry.hardness": "1 GPa", **more}).notes)
        for more in ({}, {"contact.hardness": "1 GPa"})
    ]
    assert ["above the hardness" in text for text in texts] == [True, False]


@pytest.mark.parametrize("case", ["a tip that is repeated", "one period for the whole body"])
def test_a_boundary_that_is_doubtful_is_computed_as_it_was_given(case):
    base, changes, _ = DOUBTFUL[case]
    small = {"surface.pixels": 64, **({"surface.zeta": 8, "contact.load": "0.2 uN"} if base == PATCH else {})}
    done = run(ca.load_scene(base, {**changes, **small, "hold.replicas": 2}))
    assert done.contact.periodic is (done.scene["contact"]["boundary"] == "periodic")
    assert done.contact.periodic is not done.surface.periodic
    assert done.ageing.bonds[:, -1].min() > 0


@pytest.mark.parametrize("case", HOPELESS)
def test_what_is_hopeless_is_refused_by_check_and_run_alike(case):
    base, changes, said = HOPELESS[case]
    with pytest.raises(ca.ChemageError) as first:
        planned(base, changes)
    with pytest.raises(ca.ChemageError) as second:
        run(ca.load_scene(base, changes))
    assert said in str(first.value)
    assert str(first.value) == str(second.value)


@pytest.mark.parametrize("base", [PATCH, TIP, "silica-afm-tip", "silica-linear-tip"])
def test_nothing_is_said_of_the_scenes_of_the_paper(base):
    assert planned(base, {}).notes == []


def test_a_solver_refuses_what_it_refuses_in_check():
    """By its own method as well, without a scene."""
    rough = ca.load_scene(PATCH, {"surface.pixels": 64, "surface.zeta": 8}).surface.make(1)
    tip = ca.load_scene(TIP).surface
    for solve, surface, load in (
        (ca.contact("hertz", modulus=35.3), rough, 20.0),
        (ca.contact("hertz", modulus=35.3), tip.make(), 2e4),
        (ca.contact("fft-bem", modulus=35.3, thickness=5.0), tip.make(), 20.0),
    ):
        known = {"nx": 64, "ny": 64, "pixel_size": surface.pixel_size, "periodic": float(surface.periodic)}
        known |= {"radius": surface.provenance["radius"]} if "radius" in surface.provenance else {}
        with pytest.raises(ca.InputError) as checked:
            solve.check(known, load)
        with pytest.raises(ca.InputError) as solved:
            solve.solve(surface, load)
        assert str(checked.value).partition(" (")[0][:60] == str(solved.value).partition(" (")[0][:60]
    theory = ca.contact("persson", modulus=35.3)
    with pytest.raises(ca.InputError, match="this surface is a sphere"):
        theory.statistics(tip, 20.0)


@pytest.mark.parametrize("text", ["25 degC", "25 °C", "25.0 °C", "298.15 K"])
def test_celsius_is_read(text):
    assert ca.load_scene(PATCH, {"hold.temperature": text}).hold.temperature == pytest.approx(298.15)


def test_run_warns_of_what_the_plan_says(small):
    changes = {"fit": {"start": 1e6, "stop": 1e7}}
    notes = plan(ca.load_scene(small, changes)).notes
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        ca.run(ca.load_scene(small, changes))
    assert [str(one.message) for one in found] == notes
    assert notes
    assert all(issubclass(one.category, ca.PlanWarning) for one in found)


def test_heights_of_a_file_in_metres(tmp_path):
    """Heights of nanometres written in metres, on pixels in nm; and micrometres taken for nanometres."""
    heights = ca.load_scene(PATCH, {"surface.pixels": 64, "surface.zeta": 8}).surface.make(1).heights
    for factor, implied in ((1e-9, "imply an rms slope of 1e-10"), (1e3, "imply an rms slope of 1e+02 on")):
        np.save(tmp_path / "heights.npy", heights * factor)
        surface = {"kind": "from-file", "path": str(tmp_path / "heights.npy"), "pixel_size": 0.4518}
        assert sum(implied in note for note in planned(PATCH, {"surface": surface}).notes) == 1


def test_what_a_third_party_solver_is_doubtful_of_is_said(monkeypatch):
    cls = type(ca.contact("hertz", modulus=35.3))
    monkeypatch.setattr(cls, "check", lambda self, surface, load: ("this tip is blunt",))
    assert "this tip is blunt" in planned(TIP, {}).notes


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ([20.0], "one hold time lies between 10 and 10000 s, 2 are needed (the hold times: 20 s)"),
        ([1.0, 2.0], "no hold time lies between 10 and 10000 s"),
    ],
)
def test_a_fit_that_cannot_be_made_says_why(small, times, said):
    result = ca.run(ca.load_scene(small, {"hold.start": None, "hold.stop": None, "hold.times": times}))
    assert result.fit() is None
    assert result.summary()["beta"] is None
    assert said in result.summary()["beta_reason"]
    again = ca.run(small)
    assert again.fit() is not None
    assert again.summary()["beta_reason"] is None


@pytest.mark.parametrize(
    ("slope", "load", "said"),
    [
        (0.3, "2 uN", []),
        (1.2, "2 uN", ["the rms slope is 1.2, and the half-space needs slopes well below 1"]),
        (0.9, "2 uN", ["the mean contact pressure is "]),
        (0.78, "2 uN", ["the largest contact pressure is "]),
    ],
)
def test_a_contact_beyond_elasticity_says_so(slope, load, said):
    """Without a hardness; with one it is the slope alone that is beyond."""
    surface = ca.surface("self-affine", pixels=64, pixel_size=1.0, zeta=8, hurst=0.8, rms_slope=slope).make(1)
    for hardness in (None, 5.0):
        contact = ca.contact("fft-bem", modulus=35.3, hardness=hardness).solve(surface, load)
        notes = [note for note in result_of(contact).notes() if "contact pressure" in note or "slope is" in note]
        expected = said if hardness is None or slope > 1 else []
        assert [note.startswith(text) for note, text in zip(notes, expected, strict=True)] == [True] * len(expected)


def test_a_block_of_bad_pixels_is_not_silent(tmp_path):
    heights = ca.load_scene(PATCH, {"surface.pixels": 64, "surface.zeta": 8}).surface.make(1).heights.copy()
    heights[10:14, 10:14] += 10.0
    np.save(tmp_path / "heights.npy", heights)
    surface = {"kind": "from-file", "path": str(tmp_path / "heights.npy"), "pixel_size": 0.4518}
    data = {"surface": surface, "contact": {"kind": "fft-bem", "modulus": 35.3, "load": "0.2 uN"}}
    scene = ca.parse_scene(data)
    assert sum("the rms slope is 1.6, and the half-space needs" in note for note in plan(scene).notes) == 1
    assert sum("the rms slope is 1.6, and the half-space needs" in note for note in run(scene).notes) == 1
