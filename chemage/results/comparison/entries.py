"""The results in a comparison, read from files and sweeps."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from chemage.ageing.aging import Aging, fit_or_reason
from chemage.ageing.fitting import FIT_WINDOW, Fit
from chemage.ageing.outputs import Measured
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.approximations import in_words
from chemage.foundation.components import Component
from chemage.foundation.errors import InputError
from chemage.foundation.text import with_article
from chemage.inference.result import Inference
from chemage.lattices.chemistry import SITE_DENSITY, Chemistry
from chemage.results.ensemble_text import over
from chemage.results.figures import plain
from chemage.results.files import read
from chemage.scene.provenance import components_of, scatter_of
from chemage.scene.run import Run
from chemage.scene.scene import heading
from chemage.studies.ensembles.ensemble import Ensemble, ErrorPart, Estimate
from chemage.studies.sweeps.result import load_sweep
from chemage.surfaces.role import Scatter

_CHEMICAL = ("forming", "breaking", "interaction", "chemistry", "temperature")


@dataclass(frozen=True)
class Entry:
    """One result in a comparison: everything in its file except the maps."""

    name: str
    source: str
    title: str
    #: plain scene data; empty if the file holds no scene
    scene: Mapping[str, Any]
    #: the measures of the contact, see :meth:`chemage.ContactSolution.summary`
    contact: Mapping[str, float]
    aging: Aging | None = None
    #: distribution of the pressure over the contact: bin edges (GPa), density (1/GPa)
    pressure: tuple[np.ndarray, np.ndarray] | None = None
    #: plugins that took part: name -> source
    plugins: Mapping[str, str] = field(default_factory=dict)
    #: what is approximate about the result, in words
    approximate: str = ""
    #: first and last hold time of the fit, s
    window: tuple[float, float] = FIT_WINDOW
    #: of the contact, where the file holds no scene
    provenance: Mapping[str, Any] = field(default_factory=dict)
    #: a mean over surfaces, in place of ``aging``
    ensemble: Ensemble | None = None
    #: reads the result again, maps included
    whole: Callable[[], Any] | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(cls, thing: Any, name: str = "", source: str = "") -> Entry:
        """Make an entry of a :class:`chemage.Run`, an ensemble, an ageing curve or a contact.

        Raises
        ------
        InputError
            ``thing`` is something else.
        """
        if isinstance(thing, Run):
            return cls(
                name or thing.name,
                source,
                heading(thing.scene),
                thing.scene,
                thing.contact.summary(),
                thing.aging,
                _pressures(thing.contact),
                thing.plugins,
                thing.approximate,
                thing.window,
            )
        if isinstance(thing, Ensemble):
            return _of_ensemble(thing, name or thing.name, source)
        if isinstance(thing, Aging):
            approximate = in_words(thing.approximate)
            return cls(name, source, "", {}, thing.contact, thing, None, thing.plugins, approximate)
        if isinstance(thing, ContactSolution | ContactStatistics):
            own = thing.summary(), None, _pressures(thing), thing.plugins, in_words(thing.approximate)
            return cls(name, source, "", {}, *own, provenance=thing.provenance)
        raise InputError(
            f"{source or name} holds {with_article(type(thing).__name__)}; a comparison takes runs, ensembles, ageing "
            "curves or contacts, such as `chemage run` writes"
            + ("; `chemage report` shows several inferences on one page" if isinstance(thing, Inference) else "")
        )

    @property
    def legend(self) -> str:
        """The name, marked where the result is approximate, as a matplotlib label."""
        return plain(f"{self.name} (approximate)" if self.approximate else self.name)

    @property
    def ages(self) -> bool:
        """Whether there are curves against hold time."""
        return self.aging is not None or (self.ensemble is not None and self.hold_times.size > 0)

    @property
    def hold_times(self) -> np.ndarray:
        """(m,) s; empty without ageing."""
        if self.ensemble is not None:
            return self.ensemble.hold_times
        return self.aging.hold_times if self.aging is not None else np.zeros(0)

    @property
    def temperature(self) -> float:
        """K; nan without ageing."""
        if self.aging is not None:
            return self.aging.temperature
        return float(self.scene.get("hold", {}).get("temperature", math.nan))

    @property
    def over(self) -> str:
        """What the mean is over, and with it its error: the surfaces, or the replicas on one surface, in words."""
        if self.ensemble is not None:
            replicas = self.ensemble.levels[0]["replicas"]
            each = f", {replicas} replica{'s' if replicas > 1 else ''} each" if self.ages and self.of_surfaces else ""
            return over(self.ensemble) + each
        if self.aging is None:
            return "one surface"
        return f"{self.aging.replicas} replica{'s' if self.aging.replicas > 1 else ''} on one surface"

    @property
    def of_surfaces(self) -> bool:
        """Whether the errors contain the scatter between surfaces."""
        return self.ensemble is not None and self.ensemble.random

    @property
    def load(self) -> float:
        """Normal force, nN; nan if the file does not state it."""
        if self.ensemble is not None:
            return self.ensemble.load
        return self.aging.load if self.aging is not None else self.contact.get("load", math.nan)

    @property
    def area(self) -> float:
        """Contact area, nm²; nan if the file does not state it."""
        return self.contact.get("area", math.nan)

    @property
    def site_grid(self) -> str:
        """What the grid of sites is to the pixels of the contact, in words; "" without ageing."""
        return self.aging.site_grid if self.aging is not None else ""

    @property
    def sites(self) -> float:
        """Number of reactive sites, mean over replicas; nan without ageing."""
        return float(self.aging.sites.mean()) if self.aging is not None else math.nan

    @property
    def bonds_per_area(self) -> np.ndarray:
        """Bonds per contact area, 1/nm², (replicas, m); (1, 0) without ageing."""
        if self.aging is None or not self.aging.site_area > 0:
            return np.full((1, 0), np.nan)
        return self.aging.bonds / self.aging.site_area

    @property
    def bonded_fraction(self) -> np.ndarray:
        """Fraction of the sites that are bonded, (replicas, m); (1, 0) without ageing."""
        if self.aging is None:
            return np.full((1, 0), np.nan)
        with np.errstate(invalid="ignore"):
            return self.aging.bonds / self.aging.sites[:, None]

    def components(self) -> list[tuple[str, Component]]:
        """The components that made the result, as far as they are installed: (path of the section, component)."""
        return components_of(self.scene, self.aging, self.provenance)

    @cached_property
    def measured(self) -> Mapping[str, Measured]:
        """What observables measured, by name."""
        return self.aging.measured if self.aging is not None else {}

    @cached_property
    def scatter(self) -> Scatter | None:
        """How much β differs between surfaces of other seeds, where the maker of the surface says so."""
        return scatter_of(self.scene, self.aging, self.contact, self.provenance) if self.aging is not None else None

    @cached_property
    def fit(self) -> Fit | None:
        """Line of Δμ against log t over the window of the scene; None without load or hold times in the window."""
        return self._fitted[0]

    @property
    def fit_range(self) -> tuple[float, float] | None:
        """First and last hold time that were fitted, s; None without a fit."""
        if self.ensemble is not None:
            return self.ensemble.quantities.span if self.ensemble.quantities.has_beta else None
        return self.fit.span if self.fit is not None else None

    @property
    def fit_reason(self) -> str:
        """Why there is no fit, in words; "" where there is one, and without ageing."""
        return self._fitted[1]

    @cached_property
    def _fitted(self) -> tuple[Fit | None, str]:
        if self.aging is None:
            return None, ""
        return fit_or_reason(self.aging, self.window)

    def at(self, curves: np.ndarray, time: float) -> np.ndarray:
        """(replicas,) values of ``curves`` (replicas, m) at ``time`` (s).

        Interpolates linearly in log t between hold times; nan outside them.
        """
        if self.aging is None or not curves.size:
            return np.full(1, np.nan)
        t = self.aging.hold_times
        exact = np.flatnonzero(np.abs(t - time) <= 1e-6 * time)
        if exact.size:
            return curves[:, exact[-1]]
        after = int(np.searchsorted(t, time))
        if not 0 < after < t.size or t[after - 1] <= 0:
            return np.full(len(curves), np.nan)
        part = math.log(time / t[after - 1]) / math.log(t[after] / t[after - 1])
        return curves[:, after - 1] * (1 - part) + curves[:, after] * part

    def estimate(self, name: str, time: float | None = None) -> Estimate | None:
        """A quantity of an ensemble, of a curve at ``time`` (s); None of other results, and of what it does not have.

        Between hold times the mean is interpolated linearly in log t, and so is half the width of the interval, which
        is at most too wide.
        """
        if self.ensemble is None or name not in self.ensemble.quantities.names:
            return None
        if time is None:
            return self.ensemble.estimate(name)
        t = self.hold_times
        near = int(np.abs(t - time).argmin())
        if abs(t[near] - time) <= 1e-6 * time:
            return self.ensemble.estimate(name, float(t[near]))
        after = int(np.searchsorted(t, time))
        if not 0 < after < t.size or t[after - 1] <= 0:
            return None
        part = math.log(time / t[after - 1]) / math.log(t[after] / t[after - 1])
        low, high = (self.ensemble.estimate(name, float(t[k])) for k in (after - 1, after))
        errors = {
            name: ErrorPart(low.errors[name].size * (1 - part) + high.errors[name].size * part, low.errors[name].how)
            for name in low.errors
        }
        return Estimate(
            low.value * (1 - part) + high.value * part,
            low.half_width * (1 - part) + high.half_width * part,
            errors,
        )

    def last(self) -> float:
        """The last hold time, s; nan without ageing."""
        return float(self.hold_times[-1]) if self.ages else math.nan

    def chemistry(self) -> dict[str, Any]:
        """The fields that determine the kinetics of the sites: dotted path -> value."""
        if not self.ages:
            return {}
        if self.scene:
            parts = {name: self.scene[name] for name in _CHEMICAL if name in self.scene}
        else:
            assert self.aging is not None  # an ensemble has its scene
            whole = dict(self.aging.provenance.get("chemistry", {}))
            parts = {name: whole.pop(name, None) for name in ("forming", "breaking", "interaction")}
            parts["chemistry"] = whole
        own = {name: value for name, value in parts.get("chemistry", {}).items() if name not in Chemistry.limits}
        # results from before there was a choice
        parts = {**parts, "chemistry": {"site_density": SITE_DENSITY, **own}}
        return dict(_flat({**parts, "temperature": self.temperature}))

    def elsewhere(self) -> dict[str, Any]:
        """The other fields of the scene (surface, contact, engine, hold and fit): dotted path -> value."""
        left = {name: part for name, part in self.scene.items() if name not in (*_CHEMICAL, "name", "title", "observe")}
        limits = {name: self.scene.get("chemistry", {}).get(name) for name in Chemistry.limits}
        return {path: value for path, value in _flat({**left, "chemistry": limits}) if path != "hold.temperature"}


def _of_ensemble(made: Ensemble, name: str, source: str) -> Entry:
    scene = made.provenance.get("scene", {})
    means = {measure: made.estimate(measure).value for measure in made.measures}
    return Entry(
        name,
        source,
        made.title,
        scene,
        {measure: value for measure, value in means.items() if math.isfinite(value)},
        plugins=made.plugins,
        approximate=in_words(made.approximate),
        window=made.window,
        ensemble=made,
    )


def _pressures(contact: ContactSolution | ContactStatistics) -> tuple[np.ndarray, np.ndarray] | None:
    if isinstance(contact, ContactStatistics):
        if contact.pressure.size < 2:
            return None
        edges = np.linspace(0.0, float(contact.pressure[-1]), 51)
        counts, _ = np.histogram(contact.pressure, edges, weights=contact.area)
        return edges, counts / (contact.contact_area * np.diff(edges))
    return contact.pressure_histogram(bins=min(50, max(5, contact.sites.size // 20))) if contact.sites.size else None


def _flat(data: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in data.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{path}.")
        elif value is not None:
            yield path, value


def load_results(files: Sequence[str | Path]) -> list[Entry]:
    """Read result files; each result has the name of its file, or its path if two names are equal.

    The folder of a sweep means all its completed points, ``FOLDER/3`` one of them.

    Raises
    ------
    InputError
        A file is given twice or holds nothing to compare, or there are more than ``MOST`` results.
    StoreError
        A file is missing or damaged.
    """
    found = [one for file in files for one in _sources(Path(file))]
    if len(found) > MOST:
        raise InputError(
            f"{len(found)} results are too many to compare; give at most {MOST}, "
            "or single points of a sweep, such as FOLDER/0"
        )
    places = [place for _, place, _ in found]
    for _, place, _ in found:
        if sum(os.path.realpath(place) == os.path.realpath(other) for other in places) > 1:
            raise InputError(f"{place} is given twice; give each file once")
    names = Counter(name for name, _, _ in found)
    results = []
    for name, place, load in found:
        one = Entry.of(load(False), name if names[name] == 1 else place, place)
        results.append(replace(one, whole=partial(load, True)))
    return results


#: largest number of results in a comparison
MOST = 32


def _sources(path: Path) -> list[tuple[str, str, Callable[[bool], Any]]]:
    """Find (name, path, reader) of a result file, of a point of a sweep, or of every completed point of a sweep."""
    if (path / "sweep.json").is_file() or ((path.parent / "sweep.json").is_file() and path.name.isdecimal()):
        if not path.name.isdecimal() or (path / "sweep.json").is_file():
            done = [index for index, state in enumerate(load_sweep(path).states()) if state == "done"]
            if not done:
                raise InputError(f"{path}: no point of this sweep is complete; see `chemage status {path}`")
            return [one for index in done for one in _sources(path / str(index))]
        name = f"{path.parent.resolve().name}/{path.name}"
        return [(name, str(path), partial(_point, path.parent, int(path.name)))]
    return [(path.stem, str(path), partial(_file, path))]


def _file(path: Path, whole: bool) -> Any:
    return read(path, maps=whole)


def _point(folder: Path, index: int, whole: bool) -> Any:
    sweep = load_sweep(folder)
    if index >= len(sweep):
        raise InputError(f"{folder} has {len(sweep)} points, from {folder}/0 on; there is no {folder}/{index}")
    return sweep[index].run()
