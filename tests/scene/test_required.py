"""Nothing is computed or kept that a scene does not require: calls and bytes are counted."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections import Counter

import h5py
import numpy as np
import pytest

import chemage as ca
from chemage import ensemble
from chemage.ageing import methods
from chemage.lattices import chemistry as lattices
from chemage.studies import tasks
from chemage_contact import FFTBEM, Hertz
from chemage_surfaces import SelfAffine

TIP = {
    "name": "tip",
    "surface": {"kind": "sphere", "radius": 30.0, "pixels": 40, "pixel_size": 0.45},
    "contact": {"kind": "hertz", "modulus": 35.3, "load": 50.0},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "chemistry": {"activation_volume": "6.4 angstrom**3", "site_density": "pixel"},
    "engine": {"kind": "rejection-free"},
    "hold": {"times": [1e-2, 1.0, 1e2, 1e4], "replicas": 3, "seed": 5},
}
ROUGH = {
    **TIP,
    "name": "rough",
    "surface": {"kind": "self-affine", "pixels": 64, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 60.0},
}
BREAKING = {"kind": "gaussian", "mean": "1.1 eV", "std": "0.02 eV"}
PAIRS = {"kind": "elastic-pairs", "strength": "0.5 eV"}


@pytest.fixture
def calls(monkeypatch):
    """``calls(owner, name)`` counts the calls of a method or function from then on, and keeps what it returned."""
    made = Counter()
    returned: dict[str, list] = {}

    def count(owner, name):
        inner = getattr(owner, name)

        def counted(*arguments, **options):
            made[name] += 1
            found = inner(*arguments, **options)
            returned.setdefault(name, []).append(found)
            return found

        monkeypatch.setattr(owner, name, counted)

    count.made, count.returned = made, returned  # pyright: ignore[reportFunctionMemberAccess]
    return count


# -- contacts ---------------------------------------------------------------------------------------------------------


def test_a_contact_that_is_given_is_not_solved_and_needs_no_surface(tiny):
    stored = ca.run(tiny.scene()).contact
    tiny.forget()
    ca.run(tiny.scene(hold={"times": [1.0, 10.0], "replicas": 2, "temperature": 350.0}), contact=stored)
    assert not tiny.computed("contact")
    assert not tiny.computed("surface")
    assert len(tiny.computed("kinetics")) == 2


def test_a_contact_among_the_checkpoints_is_not_solved_again(calls, tmp_path):
    first = ca.run(ROUGH, checkpoints=tmp_path)
    calls(FFTBEM, "_solve")
    assert ca.run(ROUGH, checkpoints=tmp_path).ageing == first.ageing
    assert not calls.made["_solve"]


def test_a_sweep_of_chemistry_and_temperature_solves_one_contact(tiny, tmp_path):
    axes = {"forming.top": ["1.2 eV", "1.4 eV", "1.6 eV"], "hold.temperature": [300, 320]}
    ca.sweep({**tiny.scene(), "sweep": axes}, tmp_path / "out")
    assert len(tiny.computed("surface")) == len(tiny.computed("contact")) == 1
    assert len(tiny.computed("kinetics")) == 6 * 2


def test_points_that_differ_in_the_fit_share_their_kinetics(tiny, tmp_path):
    ca.sweep({**tiny.scene(), "sweep": {"fit.stop": [100.0, 1000.0]}}, tmp_path / "out")
    assert len(tiny.computed("kinetics")) == 2


def test_a_finished_sweep_computes_nothing(tiny, tmp_path):
    scene = {**tiny.scene(), "sweep": {"contact.load": ["5 nN", "10 nN"]}}
    ca.sweep(scene, tmp_path / "out")
    tiny.forget()
    ca.sweep(scene, tmp_path / "out")
    assert not tiny.computed()


def test_replicas_of_a_tip_share_one_contact(calls):
    calls(Hertz, "_solve")
    made = ensemble(ca.parse_scene(TIP), accuracy={"beta": 0.1})
    assert made.surfaces > 1
    assert calls.made["_solve"] == 1


def test_samples_that_are_there_are_not_computed_again(calls, tmp_path):
    calls(FFTBEM, "_solve")
    first = ensemble(ca.parse_scene(ROUGH), surfaces=3, samples=tmp_path)
    again = ensemble(ca.parse_scene(ROUGH), surfaces=5, samples=tmp_path)
    assert calls.made["_solve"] == 5
    assert np.array_equal(again.rows["0"][:3], first.rows["0"])


def test_a_contact_has_a_gap_only_where_sites_are_finer_than_pixels(calls):
    calls(FFTBEM, "_solve")
    ca.run(ROUGH)
    fine = {**ROUGH, "chemistry": {"site_density": "10 / nm**2"}}
    ca.run(fine)
    ca.run({name: fine[name] for name in ("name", "surface", "contact")})  # without chemistry nothing needs it
    gaps = [one.gap is not None for one in calls.returned["_solve"]]
    assert gaps == [False, True, False]


def test_hertz_transforms_nothing(monkeypatch):
    from scipy import fft

    def refused(*_, **__):
        raise AssertionError("a transform")

    for module in (fft, np.fft):
        for name in ("fft", "ifft", "rfft", "irfft", "fft2", "ifft2", "rfft2", "irfft2", "fftn", "rfftn", "irfftn"):
            monkeypatch.setattr(module, name, refused)
    assert ca.run(TIP).summary()["beta"] > 0


@pytest.mark.long
def test_a_run_of_a_tip_imports_no_boundary_elements_and_no_figures(tmp_path):
    """In a process of its own: no kernels of the boundary elements, no matplotlib."""
    text = (
        f"import sys, chemage as ca; made = ca.run({TIP!r}, warn=False); made.summary(); "
        f"ca.write({str(tmp_path / 'tip.h5')!r}, made); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    loaded = done.stdout.split()
    assert "chemage_contact.closed_forms" in loaded
    for name in ("matplotlib", "chemage_contact.fft_bem", "chemage_contact._grid", "xarray"):
        assert name not in loaded


# -- chemistry and kinetics -------------------------------------------------------------------------------------------


def test_no_neighbours_are_searched_without_interaction(calls):
    for name in ("neighbours_of", "graph_of", "coupling_of"):
        calls(lattices, name)
    calls(methods, "build_lattice")
    ca.run(TIP)
    ca.run({**TIP, "chemistry": {"hydroxylation": 0.5, "site_density": "pixel"}})
    assert not calls.made["neighbours_of"] + calls.made["graph_of"] + calls.made["coupling_of"]
    assert all(one.neighbours is None and one.coupling is None for one in calls.returned["build_lattice"])
    ca.run({**TIP, "interaction": PAIRS})
    assert calls.made["coupling_of"] == 3


def test_no_breaking_barriers_are_drawn_without_breaking(calls):
    calls(type(ca.barriers("gaussian", mean=1.1, std=0.02)), "quantile")
    calls(methods, "build_lattice")
    calls(methods, "run_kinetics")
    ca.run(TIP)
    assert not calls.made["quantile"]
    assert all(one.breaking is None for one in calls.returned["build_lattice"])
    assert not any(one.broken.any() for one in calls.returned["run_kinetics"])
    ca.run({**TIP, "breaking": BREAKING}, warn=False)
    # of the three replicas, and of the expected number of events
    assert 3 <= calls.made["quantile"] <= 4


@pytest.mark.parametrize("kind", ["rejection-free", "bkl", "next-reaction"])
def test_no_history_goes_beyond_the_last_hold_time(calls, kind):
    calls(methods, "run_kinetics")
    made = ca.run({**TIP, "engine": {"kind": kind}, "breaking": BREAKING}, threads=1)
    for history, events in zip(calls.returned["run_kinetics"], made.ageing.events, strict=True):
        assert history.time == 1e4
        assert history.hold_times.tolist() == TIP["hold"]["times"]
        assert events == history.formed[-1] + history.broken[-1]


def test_states_and_observables_are_kept_only_where_they_are_asked_for(calls):
    calls(methods, "run_kinetics")
    made = ca.run(TIP)
    assert made.ageing.observables == {}
    assert all(one.states is None for one in calls.returned["run_kinetics"])
    asked = ca.run({**TIP, "observe": [{"kind": "barrier-spectrum"}]})
    assert asked.ageing.observables
    assert np.array_equal(asked.ageing.bonds, made.ageing.bonds)


# -- ensembles --------------------------------------------------------------------------------------------------------


def test_an_ensemble_measures_no_more_than_it_averages(calls):
    calls(methods, "measure")
    spectra = {**ROUGH, "observe": [{"kind": "barrier-spectrum"}], "hold": {**ROUGH["hold"], "replicas": 1}}
    ensemble(ca.parse_scene(spectra), accuracy={"beta": 0.5})
    assert all(not one.values for one in calls.returned["measure"])


def test_a_number_of_surfaces_is_computed_on_the_grid_of_the_scene_alone(calls):
    calls(FFTBEM, "_solve")
    ensemble(ca.parse_scene(ROUGH), surfaces=3)
    assert [one.shape for one in calls.returned["_solve"]] == [(64, 64)] * 3


def test_no_grid_is_used_that_the_goal_does_not_need(calls):
    """A wide interval needs the first level only; the cost of the grids does not depend on the goal."""
    calls(FFTBEM, "_solve")
    made = ensemble(ca.parse_scene(ROUGH), accuracy={"beta": 0.5})
    shapes = Counter(one.shape for one in calls.returned["_solve"])
    assert len(shapes) == 1
    assert sum(shapes.values()) == made.surfaces
    assert len(made.levels) == 1


@pytest.mark.long
def test_an_ensemble_keeps_numbers_and_no_maps(tmp_path):
    """Samples are a few numbers each, in memory, in the folder and in the file: no contact outlives its sample."""
    gc.collect()
    before = {id(one) for one in gc.get_objects() if issubclass(type(one), ca.ContactSolution | ca.Surface)}
    made = ensemble(ca.parse_scene(ROUGH), surfaces=6, samples=tmp_path / "samples")
    gc.collect()
    left = [
        one
        for one in gc.get_objects()
        if issubclass(type(one), ca.ContactSolution | ca.Surface) and id(one) not in before
    ]
    assert not left
    assert made.rows["0"].size == 6 * made.quantities.count
    kept = sum(file.stat().st_size for file in (tmp_path / "samples").iterdir())
    assert kept < 6 * 2000 < 64 * 64 * 8
    ca.write(tmp_path / "mean.h5", made)
    assert (tmp_path / "mean.h5").stat().st_size < 64 * 64 * 8 * 6


# -- what is kept -----------------------------------------------------------------------------------------------------


def arrays_of(file):
    """name -> bytes of the arrays in a file, before compression."""
    found = {}
    with h5py.File(file) as opened:
        opened.visititems(lambda name, one: found.update({name: one.nbytes}) if isinstance(one, h5py.Dataset) else None)
    return found


def test_a_result_has_one_map_of_heights_and_one_of_pressures(tmp_path):
    made = ca.run(ROUGH)
    ca.write(tmp_path / "rough.h5", made)
    maps = {name for name, size in arrays_of(tmp_path / "rough.h5").items() if size >= made.contact.pressure.nbytes}
    assert maps == {"surface/heights", "contact/pressure"}


def test_a_theory_has_no_map(tmp_path):
    theory = {**ROUGH, "contact": {"kind": "persson", "modulus": 35.3, "load": 60.0}, "ageing": {"kind": "closure"}}
    theory["chemistry"] = {}
    made = ca.run(theory)
    assert made.surface is None
    ca.write(tmp_path / "theory.h5", made)
    assert max(arrays_of(tmp_path / "theory.h5").values()) < 64 * 64 * 4


def test_a_sweep_keeps_pressures_of_sites_and_frees_its_contacts_in_the_end(tmp_path):
    scene = {**ROUGH, "sweep": {"contact.load": ["30 nN", "60 nN"], "hold.temperature": [300, 320]}}
    swept = ca.sweep(scene, tmp_path / "out")
    contacts = sorted((swept.folder / "contacts").iterdir())
    assert len(contacts) == 2
    for file, point in zip(contacts, swept.where({"hold.temperature": 300}), strict=True):
        with np.load(file) as stored:
            largest = max(stored[name].size for name in stored.files if stored[name].dtype.kind in "fiu")
        assert 0 < largest < 64 * 64 / 2
        assert point.contact().sites.size < 64 * 64 / 2
    assert {"surface", "contact"} <= tasks._kept.keys()
    assert not any(recent._kept for recent in tasks._kept.values())


# -- figures ----------------------------------------------------------------------------------------------------------


def test_no_figure_is_made_unless_one_is_asked_for(calls, command, small, monkeypatch):
    from matplotlib.figure import Figure

    calls(Figure, "__init__")
    ca.run(TIP)
    outcome = command("run", small, "--no-figures")
    assert outcome.status == 0
    assert not calls.made["__init__"]
    assert not (small.parent / "small-figures").exists()


@pytest.mark.long
def test_the_command_without_figures_does_not_import_matplotlib(small):
    text = (
        "import atexit, sys; atexit.register(lambda: print('matplotlib' in sys.modules)); "
        "from chemage.cli import app; app.os._exit = sys.exit; "
        f"sys.argv = ['chemage', 'run', {str(small)!r}, '--no-figures', '--json']; app.main()"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "False"


def test_what_check_says_of_a_scene_is_not_found_out_where_nobody_reads_it(calls):
    from chemage.scene.plan import Plan

    calls(Plan, "doubts")
    ca.run(TIP, warn=False)
    assert not calls.made["doubts"]
    ca.run(TIP)
    assert calls.made["doubts"] == 1


def test_surfaces_are_made_once(calls):
    calls(SelfAffine, "make")
    ca.run(ROUGH)
    assert calls.made["make"] == 1
