"""States at every hold time are those of the run without them, to the last bit; they are there where asked for."""

from __future__ import annotations

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.ageing.replicas import CheckpointWarning, run_with_checkpoints

ENGINES = ("rejection-free", "bkl", "next-reaction", "independent", "auto")
COUNTS = ("hold_times", "bonds", "formed", "broken", "state")
#: a time that is listed twice is one state
TIMES = np.array([0.0, 1e-3, 1e-2, 0.1, 0.1, 1.0, 10.0, 1e3, 1e5])


def lattice(interacting: bool = True) -> ca.ReactionLattice:
    surface = ca.surface("self-affine", pixels=64, pixel_size=0.45, rms_slope=0.1, hurst=0.8, zeta=8, eta=3).make(1)
    contact = ca.contact("fft-bem", modulus=35.3).solve(surface, 100.0)
    silica = ca.chemistry(
        forming=ca.barriers("md-silica"),
        breaking=ca.barriers("gaussian", mean=0.95, std=0.05),
        activation_volume="6.4 angstrom**3",
        interaction=ca.interaction("elastic-pairs", strength=0.5, bias=0.1) if interacting else None,
    )
    return silica.on(contact, 3)


@pytest.mark.parametrize("kind", ENGINES)
def test_bonds_events_and_state_are_those_of_the_run_without_states(kind):
    sites, engine = lattice(kind != "independent"), ca.engine(kind)
    plain = ca.plugin.run_kinetics(engine, sites, TIMES, temperature=300, seed=7)
    seen = ca.plugin.run_kinetics(engine, sites, TIMES, temperature=300, seed=7, states=True)
    assert plain.states is None
    assert plain.broken[-1] > 20
    for name in COUNTS:
        np.testing.assert_array_equal(getattr(seen, name), getattr(plain, name))
    assert (seen.events, seen.notes, seen.engine, seen.time) == (plain.events, plain.notes, plain.engine, plain.time)
    assert seen.states.shape == (TIMES.size, sites.sites.size)
    np.testing.assert_array_equal(seen.states.sum(axis=1), plain.bonds)
    np.testing.assert_array_equal(seen.states[-1], plain.state)
    # each row is what a run that ends there ends with
    for number in (1, 4, 6):
        until = engine.run(sites, TIMES[: number + 1], temperature=300, seed=7)
        np.testing.assert_array_equal(seen.states[number], until.state)


def test_a_history_with_states_can_be_resumed():
    sites, engine = lattice(), ca.engine("rejection-free")
    plain = engine.run(sites, TIMES, temperature=300, seed=7)
    first = ca.plugin.run_kinetics(engine, sites, TIMES[:5], temperature=300, seed=7, states=True)
    later = ca.plugin.run_kinetics(engine, sites, TIMES[5:], temperature=300, seed=7, start=first, states=True)
    both = first.then(later)
    assert both.states.shape == (TIMES.size, sites.sites.size)
    np.testing.assert_array_equal(both.bonds, plain.bonds)
    # of a part the states are not known
    assert first.then(engine.run(sites, TIMES[5:], temperature=300, seed=7, start=first)).states is None


@pytest.mark.parametrize("every", [0.0, 60.0])
def test_checkpoints_keep_the_states(every, tmp_path):
    sites, engine = lattice(), ca.engine("rejection-free")
    whole = ca.plugin.run_kinetics(engine, sites, TIMES, temperature=300, seed=7, states=True)
    options = {"temperature": 300.0, "seed": 7, "path": tmp_path / "one.h5"}
    for _ in range(2):
        kept = run_with_checkpoints(engine, sites, TIMES, every=every, states=True, **options)
        for name in (*COUNTS, "states"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(whole, name))
    again = ca.read(tmp_path / "one.h5")
    assert again.states.dtype == bool
    np.testing.assert_array_equal(again.states, whole.states)
    # not asked for: the same run without them
    assert run_with_checkpoints(engine, sites, TIMES, **options).states is None


def test_a_checkpoint_without_states_is_computed_again_where_they_are_asked_for(tmp_path):
    sites, engine = lattice(), ca.engine("rejection-free")
    options = {"temperature": 300.0, "seed": 7, "path": tmp_path / "one.h5"}
    plain = run_with_checkpoints(engine, sites, TIMES, **options)
    with pytest.warns(CheckpointWarning, match="computed again: it was kept without the states"):
        kept = run_with_checkpoints(engine, sites, TIMES, states=True, **options)
    np.testing.assert_array_equal(kept.bonds, plain.bonds)
    assert ca.read(tmp_path / "one.h5").states.shape == (TIMES.size, sites.sites.size)


class Forgetful(ca.plugin.Engine):
    """Cannot resume."""

    kind = "forgetful"
    restart = False

    def _run(self, lattice, hold_times, temperature, seed, start):
        raise AssertionError("computed")


def test_an_engine_that_cannot_resume_gives_none():
    with pytest.raises(InputError, match=r"engine 'forgetful' cannot resume from a history .* use another engine"):
        ca.plugin.run_kinetics(Forgetful(), lattice(), TIMES, temperature=300, states=True)


def test_states_that_do_not_fit_are_refused(examples):
    history = examples.history
    assert history(states=[[False, False, True], [True, False, True]]).states.shape == (2, 3)
    with pytest.raises(InputError, match=r"states: shape \(1, 3\); give \(2, 3\)"):
        history(states=[[True, False, True]])
    with pytest.raises(InputError, match="not the state at the end"):
        history(states=[[True, False, True], [False, False, True]])


def test_without_states_records_and_files_are_as_before(examples, tmp_path):
    """The field is part of the digest and of a file only where it is set."""
    plain = examples.history()
    ca.write(tmp_path / "plain.h5", plain)
    import h5py

    with h5py.File(tmp_path / "plain.h5") as file:
        assert "states" not in file["history"]
        assert "states" not in file["history"].attrs
    assert ca.read(tmp_path / "plain.h5") == plain
    with_states = examples.history(states=[[False, False, True], [True, False, True]])
    assert with_states != plain
    ca.write(tmp_path / "states.h5", with_states)
    assert ca.read(tmp_path / "states.h5") == with_states
