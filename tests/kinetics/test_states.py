"""States at every hold time are those of the run without them, to the last bit; they are there where asked for."""

from __future__ import annotations

import itertools
from typing import ClassVar

import numpy as np
import pytest

import chemage as ca
from chemage import InputError

ENGINES = ("rejection-free", "bkl", "next-reaction", "independent", "auto")
COUNTS = ("hold_times", "bonds", "formed", "broken", "state")
#: a time that is listed twice is one state
TIMES = np.array([0.0, 1e-3, 1e-2, 0.1, 0.1, 1.0, 10.0, 1e3, 1e5])


def pressed() -> ca.ContactSolution:
    surface = ca.surface("self-affine", pixels=64, pixel_size=0.45, rms_slope=0.1, hurst=0.8, zeta=8, eta=3).make(1)
    return ca.contact("fft-bem", modulus=35.3).solve(surface, 100.0)


def silica(interacting: bool = True) -> ca.Chemistry:
    return ca.chemistry(
        forming=ca.barriers("md-silica"),
        breaking=ca.barriers("gaussian", mean=0.95, std=0.05),
        activation_volume="6.4 angstrom**3",
        interaction=ca.interaction("elastic-pairs", strength=0.5, bias=0.1) if interacting else None,
    )


def lattice(interacting: bool = True) -> ca.ReactionLattice:
    return silica(interacting).on(pressed(), 3)


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


class Seen(ca.plugin.Observable):
    """What an observable is shown."""

    kind = "seen"
    states = True
    histories: ClassVar[list] = []

    def measure(self, contact, lattice, history):
        self.histories.append(history)
        return {}


class Unseen(Seen):
    kind = "unseen"
    states = False


def history_of(observable, contact, **options) -> ca.plugin.BondHistory:
    """The one replica of a run with this observable, as it sees it."""
    engine, call = ca.engine("rejection-free"), {"temperature": 300.0, "replicas": 1, "seed": 7}
    ca.age(contact, silica(), engine=engine, hold_times=TIMES, observe=[observable], **call, **options)
    return Seen.histories.pop()


@pytest.mark.parametrize("seconds", [0.0, 61.0])
def test_checkpoints_keep_the_states(seconds, tmp_path, monkeypatch):
    """Each piece of the run takes so long."""
    contact, clock = pressed(), itertools.count(0.0, seconds)
    whole = history_of(Seen(), contact)
    for _ in range(2):
        with monkeypatch.context() as patch:
            patch.setattr("time.monotonic", lambda: next(clock))
            kept = history_of(Seen(), contact, checkpoints=tmp_path)
        for name in (*COUNTS, "states"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(whole, name))
    (file,) = tmp_path.iterdir()
    again = ca.read(file)
    assert again.states.dtype == bool
    np.testing.assert_array_equal(again.states, whole.states)
    # not asked for: the same run without them
    assert history_of(Unseen(), contact, checkpoints=tmp_path).states is None


def test_a_checkpoint_without_states_is_computed_again_where_they_are_asked_for(tmp_path):
    contact = pressed()
    plain = history_of(Unseen(), contact, checkpoints=tmp_path)
    with pytest.warns(UserWarning, match="computed again: it was kept without the states"):
        kept = history_of(Seen(), contact, checkpoints=tmp_path)
    np.testing.assert_array_equal(kept.bonds, plain.bonds)
    (file,) = tmp_path.iterdir()
    assert ca.read(file).states.shape == (TIMES.size, plain.state.size)


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
