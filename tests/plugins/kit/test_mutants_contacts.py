"""Contact solvers that are wrong in one way, each found by the check named for it; with ``--long`` alone, first."""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
import pytest
from kit_examples import Bed, changed, mutant
from pydantic import Field

import chemage as ca
from chemage import ContactSolution, Surface

pytestmark = pytest.mark.long

FFT: Any = type(ca.contact("fft-bem", modulus=35.3))
Persson: Any = type(ca.contact("persson", modulus=35.3))
HERTZ: Any = type(ca.contact("hertz", modulus=35.3))
JKR: Any = type(ca.contact("jkr", modulus=35.3, work_of_adhesion=0.05))


def solver(name: str, change: Any = None, before: Any = None, base: Any = FFT, **attributes: Any) -> Any:
    """A solver whose solution is passed through ``change``, or its arguments through ``before``."""

    def _solve(self: Any, surface: Surface, load: float, start: Any) -> Any:
        given = before(self, surface, load, start) if before is not None else (surface, load, start)
        solution = base._solve(self, *given)
        return solution if change is None else change(self, solution, surface, load, start)

    return mutant(base, name, _solve=_solve, **attributes)(modulus=35.3)


def adhering(name: str, change: Any, base: Any = JKR) -> Any:
    """An adhesive solver whose solution is passed through ``change(solution, load)``."""

    def _solve(self: Any, surface: Surface, load: float, start: Any) -> Any:
        return change(base._solve(self, surface, load, start), load)

    return mutant(base, name, _solve=_solve)(modulus=35.3, work_of_adhesion=0.05)


def _unbreakable(self: Any, surface: Surface, load: float, start: Any) -> ContactSolution:
    pull = self.pull_off(surface.provenance.get("radius", 1.0))
    return changed(JKR._solve(self, surface, max(load, -pull), start), load=load)


def pressed(change: Any) -> Any:
    """A function of the pressure, as a change of the solution."""
    return lambda self, solution, *given: changed(solution, pressure=change(solution.pressure))


def heights(change: Any) -> Any:
    """A function of the heights, as a change of the arguments."""
    return lambda self, surface, load, start: (changed(surface, heights=change(surface.heights)), load, start)


def restored(self, solution, surface, load, start):
    """Names the grid and roughness of the surface that was given."""
    return changed(
        solution,
        pixel_size=surface.pixel_size,
        load=load,
        pressure=solution.pressure * (load / max(solution.pressure.sum() * surface.pixel_size**2, 1e-300)),
        rms_slope=surface.rms_slope,
        rms_height=surface.rms_height,
        periodic=surface.periodic,
        modulus=self.modulus,
    )


def _soft(self, surface, load, start):
    # half the modulus is twice the load, at the same heights
    return surface, 2 * load, start


def _unit_pixels(self, surface, load, start):
    known = {**surface.provenance}
    return changed(surface, pixel_size=1.0, provenance=known), load / surface.pixel_size**2, start


def _hasty(self: Any, surface: Surface, load: float, start: Any) -> ContactSolution:
    quick = FFT(modulus=self.modulus, max_iterations=2, levels=1, on_failure="return", precision="double")
    return changed(quick._solve(surface, load, start), converged=True, notes=(), gap=None)


def _tolerant(self: Any, surface: Surface, load: float, start: Any) -> ContactSolution:
    rough = surface.periodic and min(surface.shape) > 16
    loose = FFT(modulus=self.modulus, tolerance=0.03 if rough else 1e-5, levels=1)
    return changed(loose._solve(surface, load, start), gap=None)


def _periodic(self: Any, surface: Surface, load: float, start: Any) -> ContactSolution:
    looped = FFT(modulus=self.modulus, boundary="periodic", gap=self.gap)
    return changed(looped._solve(surface, load, start), periodic=surface.periodic)


def _cut(pressure):
    cut = np.where(pressure > 0.2 * pressure.max(), pressure, 0.0)
    return cut * (pressure.sum() / max(cut.sum(), 1e-300))


def _half_pixel(pressure):
    return 0.5 * (pressure + np.roll(pressure, 1, 0))


def _smeared(pressure):
    return 0.5 * pressure + 0.25 * (np.roll(pressure, 1, 1) + np.roll(pressure, -1, 1))


_last: list[np.ndarray] = []


def _remembering(self, solution, surface, load, start):
    """A hundredth of the last pressure on this grid stays."""
    before = [one for one in _last if one.shape == solution.shape]
    _last[:] = [solution.pressure]
    if not before or load == 0 or not before[0].any():
        return solution
    left = before[0] * (load / (before[0].sum() * solution.pixel_size**2))
    return changed(solution, pressure=0.99 * solution.pressure + 0.01 * left)


def _lazy(self, solution, surface, load, start):
    if start is None or start.shape != solution.shape or start.load == 0:
        return solution
    return changed(solution, pressure=start.pressure * (load / start.load))


def _writes(self, solution, surface, load, start):
    array = np.array(surface.heights) - 1.0
    object.__setattr__(surface, "heights", array)
    return solution


class Threads(Bed):
    """Adds up in another order on every number of threads, and single precision shows it."""

    speed_only: ClassVar[tuple[str, ...]] = ("chunks",)
    chunks: int = Field(default=1, ge=1)
    """pieces of work"""

    def _solve(self, surface, load, start):
        solution = super()._solve(surface, load, start)
        return changed(solution, pressure=solution.pressure * (1 + 1e-15 * (self.chunks - 1)))


class Reversed(Bed):
    """Trades accuracy, listed from accurate to fast."""

    trade: ClassVar[Any] = {"digits": (8, 4, 1)}
    digits: int = Field(default=8, ge=1)
    """digits of the pressure"""

    def _solve(self, surface, load, start):
        solution = super()._solve(surface, load, start)
        top = float(solution.pressure.max()) or 1.0
        rounded = np.round(solution.pressure / top, self.digits) * top
        return changed(solution, pressure=rounded * (solution.pressure.sum() / max(rounded.sum(), 1e-300)))


#: what mutants keep from call to call
_kept: dict[Any, Any] = {}


def _undeclared(name: str, change: Any = None, before: Any = None, base: Any = FFT, **attributes: Any) -> Any:
    """A solver that claims no error."""
    return solver(name, change, before, base, declared_error=None, **attributes)


def _compliant(self: Any, surface: Surface, load: float, start: Any) -> ContactSolution:
    found = JKR._solve(self.replace(modulus=0.5 * self.modulus), surface, load, start)
    return changed(found, modulus=self.modulus)


def _kept_gap(self, solution, surface, load, start):
    """The gap of the first contact on this grid."""
    if solution.gap is None:
        return solution
    return changed(solution, gap=_kept.setdefault((solution.shape, solution.pixel_size), solution.gap))


def _previous_gap(self, solution, surface, load, start):
    """The gap of the contact before on this grid."""
    if solution.gap is None:
        return solution
    gap = _kept.get(solution.shape, solution.gap)
    _kept[solution.shape] = solution.gap
    return changed(solution, gap=gap)


def _nearby(self, solution, surface, load, start):
    """The pressure at a load that is little different, scaled."""
    key = (surface.digest(), self.digest())
    near = [one for one in _kept.get(key, ()) if abs(one.load / load - 1) < 0.05] if load else []
    _kept.setdefault(key, []).append(solution)
    return changed(solution, pressure=near[0].pressure * (load / near[0].load)) if near else solution


def _shared(self: Any, surface: Surface, load: float, start: Any) -> ContactSolution:
    """All threads work in one array."""
    work = _kept.setdefault(("heights", surface.shape), np.zeros(surface.shape))
    work[...] = surface.heights
    time.sleep(2e-3)
    found = Bed._solve(self, changed(surface, heights=work), load, start)
    return changed(found, rms_slope=surface.rms_slope, rms_height=surface.rms_height)


def _recentred(pressure_of, surface, load, start):
    """The summit is moved to the middle and back, by half of the pixels that there are, rounded down."""
    half = tuple(n // 2 for n in surface.shape)
    if not surface.periodic:
        return pressure_of(surface, load, start)
    found = pressure_of(changed(surface, heights=np.roll(surface.heights, half, (0, 1))), load, start)
    return changed(found, pressure=np.roll(found.pressure, half, (0, 1)), gap=None)


def _square_grids(self, surface, load, start):
    """Right where a surface that does not repeat is square."""
    nx, ny = surface.shape
    return surface, load * (1.2 if not surface.periodic and nx != ny else 1.0), start


def _absolute(self: Any, roughness: Any, load: float) -> Any:
    return Persson._statistics(self, roughness, load * (self.modulus / 35.3) ** 0.1)


def _by_height(self: Any, roughness: Any, load: float) -> Any:
    return Persson._statistics(self.replace(kappa=2.0 + 0.1 * roughness.rms_height), roughness, load)


MUTANTS: dict[str, tuple[Any, str]] = {
    "half the modulus, and no error declared": (
        lambda: _undeclared("soft undeclared", restored, _soft),
        "contact_obeys_the_half_space",
    ),
    "Hertz with the wrong factor, and no error declared": (
        lambda: _undeclared("hertz undeclared", restored, _soft, HERTZ),
        "contact_obeys_the_half_space",
    ),
    "an adhesive sphere of half the modulus": (
        lambda: mutant(JKR, "compliant", _solve=_compliant)(modulus=35.3, work_of_adhesion=0.05),
        "contact_obeys_the_half_space",
    ),
    "a gap kept from the first contact": (lambda: solver("kept gap", _kept_gap), "gap_is_closed_in_contact"),
    "the gap of the call before": (lambda: solver("previous gap", _previous_gap), "contact_is_deterministic"),
    "a gap that is closed everywhere": (
        lambda: solver("closed", lambda self, s, *g: s if s.gap is None else changed(s, gap=0.0 * s.gap)),
        "gap_is_closed_in_contact",
    ),
    "a load that is little different": (
        lambda: solver("nearby", _nearby),
        "answers_do_not_depend_on_what_was_asked_before",
    ),
    "threads that share an array": (lambda: mutant(Bed, "shared", _solve=_shared)(), "calls_are_independent"),
    "a pixel off on odd grids": (
        lambda: mutant(
            FFT,
            "odd",
            _solve=lambda self, *given: _recentred(lambda *g: FFT._solve(self, *g), *given),
            implemented_properties=("pressure",),
        )(modulus=35.3),
        "summits_touch_first",
    ),
    "right on square tips alone": (
        lambda: solver("square tips", restored, _square_grids),
        "known_contacts_are_found",
    ),
    "a theory for one modulus": (
        lambda: mutant(Persson, "one modulus", _statistics=_absolute)(modulus=35.3),
        "statistics_carry_the_load",
    ),
    "a theory with a length of 1 nm": (
        lambda: mutant(Persson, "one length", _statistics=_by_height)(modulus=35.3),
        "statistics_carry_the_load",
    ),
    "heights upside down": (lambda: solver("down", restored, heights(lambda h: -h)), "summits_touch_first"),
    "mirrored": (lambda: solver("mirrored", pressed(lambda p: p[::-1])), "summits_touch_first"),
    "shifted by a pixel": (lambda: solver("shifted", pressed(lambda p: np.roll(p, 1, 0))), "summits_touch_first"),
    "shifted along y": (lambda: solver("sideways", pressed(lambda p: np.roll(p, -1, 1))), "summits_touch_first"),
    "transposed where square": (
        lambda: solver("transposed", pressed(lambda p: p.T if p.shape[0] == p.shape[1] else p)),
        "summits_touch_first",
    ),
    "a springy bed, mirrored, without a gap": (
        lambda: solver("bed", pressed(lambda p: p[:, ::-1]), base=Bed),
        "summits_touch_first",
    ),
    "shifted by half a pixel": (lambda: solver("half", pressed(_half_pixel)), "contact_turns_with_the_surface"),
    "smeared along y": (lambda: solver("smeared", pressed(_smeared)), "contact_turns_with_the_surface"),
    "pressure in MPa": (lambda: solver("mpa", pressed(lambda p: 1e3 * p)), "contact_carries_the_load"),
    "forces in place of pressures": (
        lambda: solver("forces", lambda self, s, *g: changed(s, pressure=s.pressure * s.pixel_size**2)),
        "contact_carries_the_load",
    ),
    "a little pressure everywhere": (
        lambda: solver("noise", pressed(lambda p: p + 1e-12 * (p.max() > 0))),
        "contact_carries_the_load",
    ),
    "pixels in metres": (
        lambda: solver(
            "metres", lambda self, s, *g: changed(s, pixel_size=1e-9 * s.pixel_size, pressure=1e18 * s.pressure)
        ),
        "solution_describes_itself",
    ),
    "another modulus": (
        lambda: solver("modulus", lambda self, s, *g: changed(s, modulus=2 * s.modulus)),
        "solution_describes_itself",
    ),
    "always periodic": (
        lambda: solver("looped", lambda self, s, *g: changed(s, periodic=True)),
        "solution_describes_itself",
    ),
    "adheres without tension": (
        lambda: adhering(
            "pushes",
            lambda s, load: changed(
                s,
                pressure=np.maximum(s.pressure, 0)
                * (load / max(float(np.maximum(s.pressure, 0).sum()) * s.pixel_size**2, 1e-300)),
            ),
        ),
        "contact_carries_the_load",
    ),
    "does not say where it touches": (
        lambda: adhering(
            "silent",
            lambda s, load: changed(s, touching=None, pressure=np.full(s.shape, max(load, 0.0) / s.nominal_area)),
        ),
        "contact_carries_the_load",
    ),
    "bears any pull": (
        lambda: mutant(JKR, "unbreakable", _solve=_unbreakable)(modulus=35.3, work_of_adhesion=0.05),
        "wrong_load_is_refused",
    ),
    "touches without a load": (
        lambda: solver("sticky", lambda self, s, *g: changed(s, pressure=s.pressure + (s.load == 0))),
        "no_load_is_no_contact",
    ),
    "half the modulus": (lambda: solver("soft", restored, _soft), "known_contacts_are_found"),
    "Hertz with the wrong factor": (
        lambda: solver("hertz", restored, _soft, base=HERTZ),
        "known_contacts_are_found",
    ),
    "gives up early": (
        lambda: mutant(FFT, "hasty", _solve=_hasty, implemented_properties=("pressure",))(modulus=35.3),
        "known_contacts_are_found",
    ),
    "gives up early on rough surfaces": (
        lambda: mutant(FFT, "tolerant", _solve=_tolerant, implemented_properties=("pressure",))(modulus=35.3),
        "contact_obeys_the_half_space",
    ),
    "periodic images of a tip": (
        lambda: mutant(FFT, "images", _solve=_periodic)(modulus=35.3),
        "known_contacts_are_found",
    ),
    "small pressures dropped": (lambda: solver("cut", pressed(_cut)), "known_contacts_are_found"),
    "an error that is not declared": (
        lambda: mutant(FFT, "vague", declared_error=0.0)(modulus=35.3),
        "approximations_are_declared",
    ),
    "pixels of 1 nm": (lambda: solver("unit", restored, _unit_pixels), "contact_scales"),
    "approach with the wrong sign": (
        lambda: solver("sign", lambda self, s, *g: changed(s, displacement=-s.displacement)),
        "contact_grows_with_load",
    ),
    "a gap below zero": (
        lambda: solver("gap", lambda self, s, *g: s if s.gap is None else changed(s, gap=-s.gap)),
        "gap_is_closed_in_contact",
    ),
    "statistics of half the load": (
        lambda: mutant(Persson, "half", _statistics=lambda self, r, load: Persson._statistics(self, r, 0.5 * load))(
            modulus=35.3
        ),
        "statistics_carry_the_load",
    ),
    "remembers the last contact": (lambda: solver("memory", _remembering), "contact_is_deterministic"),
    "changes the surface": (lambda: solver("writes", _writes, base=Bed), "contact_is_deterministic"),
    "the start is the answer": (lambda: solver("lazy", _lazy), "start_changes_nothing"),
    "threads that change bits": (lambda: Threads(), "options_count"),
    "trade from accurate to fast": (lambda: Reversed(), "trade_is_from_fast_to_accurate"),
    "trade of another contact": (
        lambda: mutant(Bed, "traded", trade={"modulus": (1.0, 20.0)})(),
        "trade_is_from_fast_to_accurate",
    ),
    "trade of a value that is refused": (
        lambda: mutant(Bed, "negative", trade={"modulus": (-1.0, 20.0)})(),
        "trade_names_options",
    ),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_solver(name, caught):
    make, check = MUTANTS[name]
    _last.clear()
    _kept.clear()
    found, said = caught(make(), check)
    assert found == check, said
