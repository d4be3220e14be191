"""A check finds a component that breaks it: engines, as mutants of one that is right."""

from __future__ import annotations

import math
import threading
from typing import Any

import numba
import numpy as np
import pytest
from kit_examples import broken, changed, failing, with_fields

import chemage as ca
from chemage.plugin import BondHistory


def mutant(change: Any = None, before: Any = None, **attributes: Any) -> Any:
    """The installed rejection-free engine, its result passed through ``change`` or its lattice through ``before``."""
    base = ca.engine("rejection-free").__class__

    def _run(self, lattice, hold_times, temperature, seed, start):
        given = (lattice, hold_times, temperature, seed, start)
        if before is not None:
            given = before(*given)
        history = base._run(self, *given)
        return history if change is None else change(history, *given)

    return broken(base, _run=_run, **attributes)()


def _faster(lattice, *rest):
    return changed(lattice, forming=lattice.forming - 0.003), *rest


def _half_coupled(lattice, *rest):
    if lattice.interacting:
        lattice = changed(lattice, coupling=lattice.coupling * 0.5)
    return lattice, *rest


def _no_breaking(lattice, *rest):
    return changed(lattice, breaking=None), *rest


def _breaking(lattice, *rest):
    if lattice.breaking is None:
        lattice = changed(lattice, breaking=np.full(lattice.sites.size, 0.78))
    return lattice, *rest


def _one_seed(lattice, times, temperature, seed, start):
    return lattice, times, temperature, 0, start


def _forgetful(lattice, times, temperature, seed, start):
    return lattice, times, temperature, seed, start.state if isinstance(start, BondHistory) else start


def _unstarted(lattice, times, temperature, seed, start):
    return lattice, times, temperature, seed, None if isinstance(start, np.ndarray) else start


def _crowded(history, *given):
    if threading.current_thread() is not threading.main_thread():
        return changed(history, bonds=history.bonds + 1)
    return history


def _eager(history, lattice, times, *rest):
    return changed(history, bonds=history.bonds + (times == 0))


def _single(history, lattice, times, *rest):
    return changed(history, bonds=history.bonds * np.append(1, np.diff(times) > 0))


def _capped(lattice, times, temperature, seed, start):
    # a barrier far below zero is taken as it is by a careless exp
    return changed(lattice, forming=np.maximum(lattice.forming, 0.02)), times, temperature, seed, start


def _haunted(history, lattice, times, *rest):
    return history if lattice.sites.size else changed(history, bonds=history.bonds + 1)


def _stirred(history, lattice, times, *rest):
    if (lattice.forming > 20).all() and times[-1] > 1:
        return changed(history, formed=history.formed + 1)
    return history


@pytest.mark.parametrize("said", [{"cpu_seconds": -1.0}, {"bytes": math.nan}, {"events": 0.1}])
def test_what_engines_say_beforehand(said):
    wrong = mutant(expected=lambda self, sites, interacting: said)
    assert next(iter(said)) in failing(wrong, "engine_cost_is_estimated")


@pytest.mark.long
def test_speed_that_changes_bonds():
    base = ca.engine("rejection-free").__class__
    fields = {"__annotations__": {"threads_used": int}, "threads_used": 1, "speed_only": ("threads_used",)}

    def _run(self, lattice, hold_times, temperature, seed, start):
        history = base._run(self, lattice, hold_times, temperature, seed, start)
        return changed(history, formed=history.formed + (self.threads_used > 2))

    hasty = broken(base, **fields, _run=_run)()
    assert "threads_used = 3: the answers differ" in failing(hasty, "options_count")


def test_options_that_change_rates():
    base = ca.engine("rejection-free").__class__

    def _run(self, lattice, *rest):
        given = _half_coupled(lattice, *rest) if self.superbasins else (lattice, *rest)
        return base._run(self, *given)

    assert "superbasins = True: 1 by 2 sites" in failing(broken(base, _run=_run)(), "options_keep_the_rates")


def _threaded(history, *given):
    return changed(history, formed=history.formed + numba.get_num_threads())


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS == 1, reason="there is one thread only")
def test_bonds_that_depend_on_the_threads():
    assert "one thread and several" in failing(mutant(_threaded), "threads_change_nothing")


def _overwriting(self, lattice, hold_times, **options):
    history = type(self).__mro__[1].run(self, lattice, hold_times, **options)
    hold_times += 1e-9
    return history


ENGINE_MUTANTS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "counts too many": ("history_adds_up", "the final state", {"change": with_fields(bonds=lambda h: h.bonds + 1)}),
    "forgets events": ("history_adds_up", "formed less broken", {"change": with_fields(formed=lambda h: h.formed + 1)}),
    "names another": ("history_adds_up", "engine is 'x'", {"change": with_fields(engine=lambda h: "x")}),
    "stops early": ("history_adds_up", "wrong time", {"change": with_fields(time=lambda h: h.time / 2)}),
    "one seed for all": ("run_follows_its_seed", "gave 1 different", {"before": _one_seed}),
    "bonds without sites": ("no_sites_is_no_bonds", "bonds without sites", {"change": _haunted}),
    "0.003 eV too low": ("one_site_is_the_closed_form", "is bonded in", {"before": _faster}),
    "no breaking": ("one_site_is_the_closed_form", "is bonded in", {"before": _no_breaking}),
    "a floor under barriers": ("barrierless_is_the_attempt_frequency", "over a barrier of 0 eV", {"before": _capped}),
    "breaks what lasts": ("bonds_last_without_breaking", "bonds broke", {"before": _breaking}),
    "an event at rate 0": ("nothing_happens_at_rate_zero", "1 events", {"change": _stirred}),
    "bonds at time 0": ("hold_times_may_coincide", "bonds at time 0", {"change": _eager}),
    "drops a twin": ("hold_times_may_coincide", "where once gave", {"change": _single}),
    "ignores the start": ("start_is_taken", "started with", {"before": _unstarted}),
    "goes on from the state alone": ("restart_is_exact", "continued from", {"before": _forgetful}),
    "not for threads": ("calls_are_independent", "concurrent calls gave", {"change": _crowded}),
    "changes the hold times": ("calls_are_independent", "what was given has changed", {"run": _overwriting}),
    "half the coupling": ("coupled_sites_are_refused_or_right", "master equation", {"before": _half_coupled}),
    "refuses nothing": (
        "coupled_sites_are_refused_or_right",
        "expected InputError",
        {"interacting": False, "run": lambda self, *given, **named: None},
    ),
    "takes any time": ("wrong_input_is_refused", "expected InputError", {"run": lambda self, *given, **named: None}),
}


@pytest.mark.parametrize("name", ENGINE_MUTANTS)
def test_engines(name):
    check, said, changes = ENGINE_MUTANTS[name]
    assert said in failing(mutant(**changes), check)
