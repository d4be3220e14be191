"""The critic of an inference: which undeclared trouble most likely explains its residuals, and which it would miss.

Measured values are taken as normal: about the mean of the prior of the density, with the covariance of its samples and
of the errors. A trouble changes values by an amplitude of standard deviation s times its signature v, and adds s² v vᵀ:
what densities can imitate of v counts for nothing. Troubles are compared by their evidence (Kass & Raftery, J. Am. Stat.
Assoc. 90, 773 (1995)), groups of points with what all others predict of them. A factor that all forces share is free
throughout: a density of fewer sites is the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from chemage.plugin import KB, algebra
from chemage_inference.noise import WIDER

#: log odds against measurements without trouble from which one is named, and those by which it excludes others
NAMED, CLOSE = 2.0, 2.0
#: standard deviations by which an amplitude is not zero
SURE = 1.5
#: standard deviations of amplitudes over the typical one
SPREADS = np.array([0.15, 0.4, 1.0, 2.5])
#: errors over the stated ones, and their probabilities beside a trouble
LARGER = np.array([1.0, 1.25, 1.5, 2.0, 3.0, 4.5])
BESIDE = np.array([0.7, 0.1, 0.09, 0.07, 0.03, 0.01])
#: e-folds of the hold time over which errors may be correlated
TIMES = (1.5, 5.0, 15.0)
#: standard deviation of the logarithm of the factor that all forces share
SHARED = 1.0
#: probability of the least probable group, times their number, below which it is named
UNLIKELY = 0.002
#: wrong values at most that are one cause
SEVERAL = 4
#: scale of the errors that is surely above this is named in a note
NOTEWORTHY = 1.1
#: kinds by which forecasts change about linearly: offsets do not, and neighbours change forecasts as well
LINEAR = "factor", "drift", "temperature"
#: kind -> in words, unit of the amplitude, typical amplitude, what admits it, and the error term that is there then
TROUBLES: dict[str, tuple[str, str, float, str, str]] = {
    "factor": ("a factor", "%", 10.0, 'calibration "force=10 %"', "calibration"),
    "drift": ("a drift", "% per decade", 3.0, 'calibration "drift=3 %"', "drift"),
    "offset": ("an offset", "nN", 0.05, 'calibration "offset=… nN"', "offset"),
    "temperature": ("a wrong temperature", "K", 10.0, "the right temperature", "-"),
    "interaction": ("barriers raised by bonded neighbours", "eV", 0.1, "[interaction] in the scene", "-"),
    "outlier": ("a wrong value", "errors", 10.0, "another measurement", "-"),
    "outliers": ("wrong values", "errors", 10.0, "other measurements", "-"),
    "correlated": ("correlated errors", "e-folds", 1.0, 'errors "correlated"', "correlation time"),
    "scaled": ("errors larger than stated", "times", 1.0, 'errors "scaled"', "scale 0"),
}  # fmt: skip


def _two(number: float) -> str:
    """Two digits."""
    return f"{float(f'{number:.2g}'):g}"


class Cause(NamedTuple):
    """A trouble, and how the residuals support it."""

    kind: str
    #: the curve, instrument or point that has it; "": all
    where: str
    #: log odds against no trouble
    odds: float
    #: mean and standard deviation of the amplitude, in the unit of the kind; and the least that would be
    #: named in 95 of 100 cases
    amplitude: float
    deviation: float
    least: float = np.nan
    #: (m,) nN by which one unit changes the values; empty where it changes errors
    signature: np.ndarray = np.zeros(0)

    @property
    def words(self) -> str:
        word = TROUBLES[self.kind][0]
        return f"{word} of {self.where}" if self.where else word

    @property
    def unit(self) -> str:
        return TROUBLES[self.kind][1]

    @property
    def size(self) -> str:
        return f"{self.words} up to {_two(self.least)} {self.unit}"


def _amplitude(log: Any, pull: Any, precision: Any, variance: Any) -> np.ndarray:
    """Log evidence with an amplitude of this ``variance`` in the prior, where that without it is ``log``, its mean, and
    the mean of its square; ``pull`` and ``precision`` are what the data say of it."""
    more = 1 + variance * precision
    mean = variance * pull / more
    gain = 0.5 * (variance * pull**2 / more - np.log(more))
    return np.stack([log + gain, mean, variance / more + mean**2])


@dataclass(frozen=True, eq=False)
class Critic:
    """What the residuals of an inference say; arrays of points in stated errors, those of suspect points larger."""

    #: an :class:`chemage_inference.result.Inference`
    one: Any

    @cached_property
    def errors(self) -> np.ndarray:
        """(m,) nN."""
        one = self.one
        return one.stated_errors * (1 - one.off + one.off / WIDER**2) ** -0.5

    def admits(self, kind: str, where: str = "") -> bool:
        """Whether the inference has a trouble among its unknowns."""
        term = TROUBLES[kind][4]
        if kind == "correlated":
            return self.one.near is not None
        return bool({term, f"{term} of {where}"} & self.one.error_terms.keys())

    @cached_property
    def near(self) -> np.ndarray:
        """(m, m) correlation of the errors of the inference, products of those of neighbours."""
        one, near = self.one, np.eye(self.errors.size)
        if one.near is not None:
            for point in range(1, near.shape[0]):
                near[point, :point] = one.near[point] * near[point - 1, :point]
                near[:point, point] = near[point, :point]
        return near

    @cached_property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """(m,) values less those that the prior expects, and (m, m) the covariance of these, without errors."""
        one, admitted = self.one, [SHARED * self.one.fitted.mean(axis=0)]
        for kind, where, change, typical, _ in self.signatures():
            if self.admits(kind, where):
                admitted.append(SPREADS[-1] * typical * change)
        free, mean = np.stack(admitted) / self.errors, one.prior_fitted.mean(axis=0)
        samples = (one.prior_fitted - mean) / self.errors
        covariance = samples.T @ samples / len(samples) + free.T @ free
        return (one.values - mean) / self.errors, covariance

    def _evidence(self, errors: np.ndarray) -> tuple[float, np.ndarray]:
        """Log evidence with these ``errors`` (m, m) but for a constant, and the inverse of the covariance."""
        residual, covariance = self.prior
        lower = algebra.cholesky(covariance + errors)
        root = algebra.forward(lower, np.eye(len(lower)))
        misfit = np.sum(algebra.product(root, residual) ** 2)
        log = -np.log(np.diag(lower)).sum() - 0.5 * float(misfit)
        return float(log), algebra.product(root.T, root)

    @cached_property
    def _scaled(self) -> list[tuple[float, np.ndarray]]:
        """Evidence of each of :data:`LARGER`."""
        return [self._evidence(scale**2 * self.near) for scale in LARGER]

    @cached_property
    def groups(self) -> list[tuple[str, np.ndarray, float]]:
        """All points, and names and (m,) points of instruments and curves, with their log prior probabilities."""
        one, found = self.one, {"": np.ones(self.one.curve.size, bool)}
        for key in ("instrument", "name"):
            names = np.array([about.get(key, "") for about in one.curves])
            for name in dict.fromkeys(names.tolist()):
                if not (names == name).all():
                    found.setdefault(name, (names == name)[one.curve])
        several = len(found) - 1
        first = np.log(0.5) if several else 0.0
        logs = [first, *[first - np.log(several or 1.0)] * several]
        return [(*each, log) for each, log in zip(found.items(), logs, strict=True)]

    def signatures(self) -> Iterator[tuple[str, str, np.ndarray, float, float]]:
        """Kind, where, (m,) nN by one unit, typical amplitude, and log prior probability of each trouble."""
        one, chemistry = self.one, self.one.scene.chemistry
        assert chemistry is not None
        values, decades = one.fitted.mean(axis=0), np.log10(one.hold_times)
        load, kelvin = (
            np.array([about[key] for about in one.curves])[one.curve]
            for key in ("load", "temperature")
        )
        slope, middle, top = np.zeros((3, values.size))
        for number in range(len(one.curves)):
            here = np.flatnonzero(one.curve == number)
            times, first = np.unique(decades[here], return_index=True)
            middle[here] = (times[0] + times[-1]) / 2
            top[here] = max(values[load == load[here[0]]].max(), 1e-12)
            if times.size > 1:
                along = np.gradient(values[here][first], times * np.log(10))
                slope[here] = np.interp(decades[here], times, along)
        lag = np.log(chemistry.attempt_frequency * one.hold_times)
        shared = {
            "factor": values / 100,
            "drift": values * (decades - middle) / 100,
            "offset": np.ones(values.size),
            "temperature": slope * lag / kelvin,
        }
        full = float(np.abs(values).max())
        for name, mask, prior in self.groups:
            for kind, change in shared.items():
                typical = TROUBLES[kind][2] * (full if kind == "offset" else 1.0)
                # what all forces share is free, and what all temperatures share shifts energies
                if not mask.all() or kind in ("drift", "offset"):
                    yield kind, name, change * mask, typical, prior
        if chemistry.interaction is None:
            slower = -slope * values / (top * KB * kelvin)
            yield "interaction", "", slower, TROUBLES["interaction"][2], 0.0

    def _cause(self, kind: str, where: str, rows: np.ndarray, **more: Any) -> Cause:
        """A trouble of which ``rows`` are log probabilities, means of its amplitude, and means of their squares."""
        logs, means, squares = rows
        total = float(np.logaddexp.reduce(logs, axis=None))
        share, odds = np.exp(logs - total), total - self._scaled[0][0]
        mean = float((share * means).sum())
        spread = max(float((share * squares).sum()) - mean**2, 0.0) ** 0.5
        return Cause(kind, where, odds, mean, spread, **more)

    @cached_property
    def causes(self) -> list[Cause]:
        """All troubles, the likeliest first."""
        residual, found = self.prior[0], [*self._of_errors(), self._outliers()]
        for kind, where, change, typical, prior in self.signatures():
            v, spreads = change / self.errors, (SPREADS * typical) ** 2
            rows = []
            for (log, inverse), weight in zip(self._scaled, BESIDE, strict=True):
                log += prior + np.log(weight / spreads.size)
                pull, precision = v @ inverse @ residual, v @ inverse @ v
                rows.append(_amplitude(log, pull, precision, spreads))
            q = max(float(v @ self._scaled[0][1] @ v), 1e-300)
            bar = NAMED - prior - np.log(BESIDE[0]) + 0.5 * np.log1p(typical**2 * q)
            least = ((2 * bar) ** 0.5 + 1.64) / q**0.5
            known = {"least": least, "signature": change}
            cause = self._cause(kind, where, np.stack(rows, axis=1), **known)
            if kind == "interaction" and cause.amplitude < 0:
                cause = cause._replace(odds=-np.inf)  # neighbours raise barriers
            found.append(cause)
        return sorted(found, key=lambda cause: -cause.odds)

    def _outliers(self) -> Cause:
        """Wrong values: the likeliest, one after the other, beside errors of any size; the amplitude is of the last."""
        size, residual = self.errors.size, self.prior[0]
        wrong, prior, points, found = np.zeros(size), 0.0, [], []
        for count in range(1, min(SEVERAL, size) + 1):
            prior += np.log(count / size)
            rows = []
            for scale, weight in zip(LARGER, BESIDE, strict=True):
                log, inverse = self._evidence(scale**2 * self.near + np.diag(wrong))
                log += prior + np.log(weight)
                pull, precision = inverse @ residual, np.diag(inverse)
                rows.append(_amplitude(log, pull, precision, WIDER**2))
            each = np.stack(rows, axis=1)
            every = np.logaddexp.reduce(each[0])
            every[points] = -np.inf
            points.append(int(every.argmax()))
            wrong[points[-1]] = WIDER**2
            where = ", ".join(map(self._place, points))
            kind = "outlier" if count == 1 else "outliers"
            found.append(self._cause(kind, where, each[:, :, points[-1]]))
        return max(found, key=lambda cause: cause.odds)

    def _place(self, point: int) -> str:
        one = self.one
        name = one.curves[one.curve[point]]["name"]
        return f"{name} at {one.hold_times[point]:.3g} s"

    def _of_errors(self) -> Iterator[Cause]:
        """Errors that are too small, or correlated."""
        several = []
        for name, mask, prior in self.groups:
            each = np.where(mask, LARGER[1:, None], 1.0)
            errors = [self.near * np.outer(scales, scales) for scales in each]
            logs = np.log(BESIDE[1:] / BESIDE[1:].sum()) + prior
            several.append(("scaled", name, errors, logs, LARGER[1:]))
        if self.one.near is None:
            logs, curve = np.log(self.one.hold_times), self.one.curve
            apart = np.abs(logs[:, None] - logs)
            # without correlation beyond 98 %
            alike, alone = (
                0.98 * (curve[:, None] == curve),
                0.02 * np.eye(logs.size),
            )
            times = np.repeat(TIMES, 3)
            errors = [
                scale**2 * (alike * np.exp(-apart / time) + alone)
                for time in TIMES
                for scale in LARGER[[0, 2, 4]]
            ]
            several.append(("correlated", "", errors, -np.log(times.size), times))
        for kind, where, errors, prior, sizes in several:
            logs = prior + np.array([self._evidence(each)[0] for each in errors])
            yield self._cause(kind, where, np.stack([logs, sizes, sizes**2]))

    @cached_property
    def asked(self) -> bool:
        """Whether °C may be meant: until that is answered, no other cause is."""
        return any(curve.question for curve in self.one.measured)

    @cached_property
    def named(self) -> list[Cause]:
        """The likeliest cause and those that the data do not tell from it; empty where none is supported."""
        if self.asked:
            return []
        # larger errors beside an amplitude of about zero are no further cause
        sure = [
            it
            for it in self.causes
            if abs(it.amplitude) > SURE * it.deviation or not it.signature.any()
        ]
        best = sure[0].odds
        return [it for it in sure if best >= NAMED and it.odds > best - CLOSE]

    def improbable(self) -> tuple[float, str]:
        """The least probable group of points, given all others: its probability times the number of groups, and name.

        Groups are curves, and the thirds of their hold times.
        """
        from scipy.special import chdtrc

        inverse, found = self._scaled[0][1], []
        away = inverse @ self.prior[0]
        for number, about in enumerate(self.one.curves):
            whole = np.flatnonzero(self.one.curve == number)
            for part in (whole, *np.array_split(whole, min(3, whole.size))):
                block = inverse[np.ix_(part, part)]
                chi2 = away[part] @ np.linalg.solve(block, away[part])
                ends = self.one.hold_times[part[[0, -1]]]
                name = f"{about['name']}, {ends[0]:.3g} to {ends[1]:.3g} s"
                found.append((float(chdtrc(part.size, chi2)), name))
        least, name = min(found)
        return least * len(found), name

    def notes(self) -> Iterator[str]:
        """What the user should know."""
        one, named = self.one, self.named
        for number, about in enumerate(one.curves):
            scale = one.error_terms.get(f"scale {number}")
            if scale is not None and np.quantile(scale, 0.05) > NOTEWORTHY:
                yield f"{about['name']}: the scatter is {np.median(scale):.1f} times the stated errors"
        least, where = self.improbable()
        if named:
            best, remedy = named[0], TROUBLES[named[0].kind][3]
            words = " or ".join(dict.fromkeys(cause.words for cause in named))
            assumed = f"forecasts assume that there is none; remedy: {remedy}"
            yield (
                f"likeliest cause of the residuals: {words}; the first is {_two(best.amplitude)} ± "
                f"{_two(best.deviation)} {best.unit} (log odds {best.odds:.1f}); "
                + (
                    "it is admitted"
                    if self.admits(best.kind, best.where)
                    else assumed
                )
            )
        elif least < UNLIKELY and not self.asked:
            yield f"{where}: improbable given all other points (p = {least:.1g}), and no known cause explains it"
        shared = ["a factor of all forces, which forecasts share"] * (
            not self.admits("factor")
        )
        missed = [*shared, *(cause.size for cause in self.missed)]
        yield f"would go unnoticed: {', '.join(missed)}"

    @property
    def missed(self) -> list[Cause]:
        """Of each kind the trouble of all curves, or else of that curve where most would go unnoticed."""
        found: dict[str, Cause] = {}
        done = {"outlier", *(cause.kind for cause in self.named)}
        order = sorted(self.causes, key=lambda it: (it.where != "", -it.least))
        for cause in order:
            known = cause.kind in done or self.admits(cause.kind, cause.where)
            if cause.signature.any() and not known:
                found.setdefault(cause.kind, cause)
        return list(found.values())

    def of_forecast(
        self, times: np.ndarray, samples: np.ndarray, rows: np.ndarray
    ) -> Iterator[str]:
        """Notes on how a forecast at ``times`` (k,), ``samples`` (S, k) of ``rows`` (S,), changes with troubles."""
        middle, here = np.median(samples, axis=0), self.one.fitted[rows]
        low, high = np.quantile(samples, [0.05, 0.95], axis=0)
        half = np.maximum((high - low) / 2, 1e-6 * samples.max() + 1e-12)
        terms = self.one.error_terms
        scales = [
            np.median(terms.get(f"scale {number}", 1.0))
            for number in range(len(self.one.curves))
        ]
        unit = self.errors * np.array(scales)[self.one.curve]
        errors, away = np.outer(unit, unit) * self.near, here - here.mean(axis=0)
        pulls = np.linalg.solve(errors, away.T).T
        spread = (samples - samples.mean(axis=0)) / max(len(rows) - 1, 1)

        def change(cause: Cause, amplitude: float) -> tuple[str, float, bool]:
            """The hold time of the largest change, the change over the value, and whether it is beyond the band."""
            moved = -amplitude * (pulls @ cause.signature @ spread)
            at = np.abs(moved / half).argmax()
            share = moved[at] / max(middle[at], half[at])
            return f"ΔF at {times[at]:.3g} s", share, abs(moved[at]) > half[at]

        for cause in self.named[:1]:
            if cause.kind in LINEAR:
                what, share, _ = change(cause, cause.amplitude)
                yield f"{cause.words}, once admitted, changes {what} by about {100 * share:+.0f} %"
        for cause in self.missed:
            if cause.kind in LINEAR:
                what, share, beyond = change(cause, cause.least)
                if beyond:
                    yield (
                        f"unnoticed, {cause.size} changes {what} by up to {100 * min(abs(share), 1):.0f} %, more than "
                        "the band"
                    )
