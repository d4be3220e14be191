"""One experiment from end to end: :func:`run` computes every stage of a scene, :class:`Run` is what comes of it."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from chemage.ageing.age import age
from chemage.ageing.aging import Aging
from chemage.ageing.checkpoints import keep, resumed
from chemage.ageing.elasticity import elastic_measures, elastic_notes
from chemage.ageing.fitting import FIT_WINDOW, Fit
from chemage.contacts.solution import ContactSolution
from chemage.contacts.stage import solve_contact
from chemage.experiments.estimate import cost
from chemage.experiments.limits import LongRunWarning, check_limits, check_parts, long_run
from chemage.experiments.provenance import versions
from chemage.experiments.scene import Scene, parse_scene, with_plugins
from chemage.experiments.scene_files import load_scene
from chemage.experiments.sections import scatter_of
from chemage.foundation.approximations import in_words, merged
from chemage.foundation.errors import ChemageError, InputError, StoreError
from chemage.foundation.records import Record
from chemage.foundation.text import html_table, jsonable
from chemage.surfaces.scatter import Scatter
from chemage.surfaces.stage import make_surface
from chemage.surfaces.surface import Surface

#: called with (stage, done, total); total is 0 where a stage does not report how far it is
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Run:
    """A finished run. Everything needed to repeat it is in ``scene`` and ``versions``."""

    scene: dict[str, Any]
    contact: ContactSolution
    surface: Surface | None = None
    aging: Aging | None = None
    #: wall seconds of each stage
    timings: dict[str, float] = field(default_factory=dict)
    #: of chemage, the plugins used, and the libraries below them
    versions: dict[str, str] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)
    cite: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The scene's name."""
        return str(self.scene.get("name", "scene"))

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of this result, in words."""
        notes = [*self.contact.notes, *(self.aging.notes if self.aging is not None else ())]
        notes += elastic_notes(self.aging)
        if self.contact.area_fraction == 1 and not any(note.startswith("full contact") for note in notes):
            notes.append(
                "full contact: every pixel carries pressure, and more load adds pressure but no contact area; "
                "an elastic model is of little use for a surface pressed flat"
            )
        return tuple(notes)

    @property
    def window(self) -> tuple[float, float]:
        """First and last hold time of the fit, s."""
        fit = self.scene.get("fit", {})
        return fit.get("start", FIT_WINDOW[0]), fit.get("stop", FIT_WINDOW[1])

    @property
    def plugins(self) -> dict[str, str]:
        """Plugins that answered or changed a stage on the way to this result: name -> distribution and version."""
        return {**self.contact.plugins, **(self.aging.plugins if self.aging is not None else {})}

    @property
    def approximate(self) -> str:
        """What is approximate about this result, in words: the kinds and their declared errors; "" if nothing is."""
        return in_words(merged(self.contact.approximate, self.aging.approximate if self.aging is not None else ()))

    @property
    def scatter(self) -> Scatter | None:
        """How much β differs between surfaces of other seeds, where the maker of the surface says so; None without
        ageing."""
        return scatter_of(self.scene, self.aging, self.contact.summary()) if self.aging is not None else None

    def fit(self) -> Fit | None:
        """Line of Δμ against log t over the scene's fit window; None without ageing or without times in the window."""
        if self.aging is None:
            return None
        try:
            return self.aging.fit(*self.window)
        except InputError:
            return None

    def summary(self) -> dict[str, Any]:
        """One JSON-able object with the numbers users compare; what does not exist is None, as is nan."""
        contact, aging, fit, scatter = self.contact, self.aging, self.fit(), self.scatter
        numbers: dict[str, Any] = {
            "name": self.name,
            "solver": self.scene["contact"]["kind"],
            "engine": aging.engine if aging else None,
            "rupture": aging.rupture if aging else None,
            **contact.summary(),
            "converged": contact.converged,
            "residual": contact.residual,
            "iterations": contact.iterations,
            "notes": list(self.notes),
            "sites": float(aging.sites.mean()) if aging else contact.sites.size,
            "site_grid": aging.site_grid if aging else None,
            "replicas": aging.replicas if aging else 0,
            "events": int(aging.events.sum()) if aging else 0,
            "common_random_numbers": aging.provenance.get("common") if aging else None,
            "hold_times": aging.hold_times.tolist() if aging else [],
            "friction_drop": aging.mean_friction_drop.tolist() if aging else [],
            "friction_drop_stderr": aging.friction_drop_stderr.tolist() if aging else [],
            "friction_drop_half_width": aging.friction_drop_half_width.tolist() if aging else [],
            "friction_coefficient_drop": aging.mean_friction_coefficient_drop.tolist() if aging else [],
            "friction_coefficient_drop_stderr": aging.friction_coefficient_drop_stderr.tolist() if aging else [],
            "friction_coefficient_drop_half_width": (
                aging.friction_coefficient_drop_half_width.tolist() if aging else []
            ),
            "observables": {name: one.summary() for name, one in aging.measured.items()} if aging else {},
            "beta": fit.beta if fit else None,
            "beta_stderr": fit.beta_stderr if fit else None,
            "beta_half_width": fit.beta_half_width if fit else None,
            "cutoff_time": fit.cutoff_time if fit else None,
            "cutoff_time_stderr": fit.cutoff_time_stderr if fit else None,
            "cutoff_time_low": fit.cutoff_interval.low if fit else None,
            "cutoff_time_high": fit.cutoff_interval.high if fit else None,
            "beta_scatter_between_surfaces": scatter.relative if scatter else None,
            **elastic_measures(aging),
            "timings": self.timings,
            "versions": self.versions,
            "plugins": self.plugins,
            "keys": self.keys,
            "cite": list(self.cite),
            **({"approximate": self.approximate} if self.approximate else {}),
        }
        return jsonable(numbers)

    def _repr_html_(self) -> str:
        numbers = self.summary()
        rows = ((name, f"{value:.5g}") for name, value in numbers.items() if isinstance(value, float | int))
        return html_table(f"{self.name} {self.scene.get('title', '')}".strip(), rows)

    def parts(self) -> dict[str, Record]:
        """The objects to store, by group name."""
        found = {"surface": self.surface, "contact": self.contact, "aging": self.aging}
        return {name: part for name, part in found.items() if part is not None}

    def attributes(self) -> dict[str, str]:
        """The attributes of the root of the file."""
        return {name: json.dumps(getattr(self, name)) for name in ("scene", "timings", "versions", "keys", "cite")}

    @classmethod
    def from_parts(cls, parts: Mapping[str, Any], attributes: Mapping[str, Any]) -> Run:
        """The inverse of :meth:`parts` and :meth:`attributes`."""
        missing = [name for name in ("scene", "timings", "versions", "keys", "cite") if name not in attributes]
        if missing or "contact" not in parts:
            raise StoreError(f"not a complete run: without {', '.join(missing) or 'a contact'}")
        try:
            fields = {name: json.loads(attributes[name]) for name in ("scene", "timings", "versions", "keys", "cite")}
        except (ValueError, TypeError, RecursionError) as error:
            raise StoreError(f"not a complete run: {error}") from error
        if wrong := [name for name, value in fields.items() if not _is_sound(name, value)]:
            raise StoreError(f"not a complete run: damaged {', '.join(wrong)}")
        return cls(
            contact=parts["contact"],
            surface=parts.get("surface"),
            aging=parts.get("aging"),
            **{**fields, "cite": tuple(fields["cite"])},
        )


def _is_sound(name: str, value: Any) -> bool:
    """Whether an attribute of a stored run has the form that everything else relies on."""
    if name == "cite":
        return isinstance(value, list) and all(isinstance(text, str) for text in value)
    if not isinstance(value, dict):
        return False
    if name == "scene":
        sections = [value.get("surface"), value.get("contact")]
        texts = [value.get("name", ""), value.get("title", "")]
        texts += [section.get("kind") if isinstance(section, dict) else None for section in sections]
        window = value.get("fit", {})
        times = list(window.values()) if isinstance(window, dict) else [None]
        return all(isinstance(text, str) for text in texts) and all(isinstance(time, int | float) for time in times)
    kind = int | float if name == "timings" else str
    return all(isinstance(item, kind) for item in value.values())


def run(
    scene: Scene | str | Path | Mapping[str, Any],
    *,
    progress: Progress | None = None,
    threads: int | None = None,
    surface: Surface | None = None,
    contact: ContactSolution | None = None,
    checkpoints: Path | None = None,
) -> Run:
    """Run a scene end to end: every stage that it contains.

    ``scene`` is a :class:`Scene`, a scene file, the name of an installed scene, or scene data. ``progress`` is called
    as stages advance; ``threads`` is how many replicas run at the same time. A ``surface`` or ``contact`` already
    computed for this very scene (its stage key says so) can be passed in. In the folder ``checkpoints`` the contact and
    every replica are kept during the run; an interrupted run resumes from there, with equal results.
    """
    if not isinstance(scene, Scene):
        scene = parse_scene(scene) if isinstance(scene, Mapping) else load_scene(scene)
    scene = scene.completed()
    with scene.in_use():
        return _run(scene, progress, threads, surface, contact, checkpoints)


def _run(
    scene: Scene,
    progress: Progress | None,
    threads: int | None,
    surface: Surface | None,
    contact: ContactSolution | None,
    checkpoints: Path | None,
) -> Run:
    known = cost(scene)
    check_limits(scene, known)
    check_parts(scene, known)
    if message := long_run(scene, known):
        warnings.warn(message, LongRunWarning, stacklevel=3)
    report = progress or (lambda stage, done, total: None)
    timings: dict[str, float] = {}
    if contact is None:
        if surface is None:
            with _timed("surface", scene, timings, report):
                surface = make_surface(scene.surface, scene.surface_seed)
        with _timed("contact", scene, timings, report):
            contact = _solved(scene, surface, checkpoints)
    aging = None
    if scene.ages:
        with _timed("ageing", scene, timings, report):
            aging = aged(scene, contact, threads=threads, progress=partial(report, "ageing"), checkpoints=checkpoints)
    took_part = versions(scene, (contact, aging))
    keys = run_keys(scene, contact, aging)
    return Run(scene.todict(), contact, surface, aging, timings, took_part, keys, tuple(scene.cite()))


def aged(scene: Scene, contact: ContactSolution, **changes: Any) -> Aging | None:
    """The ageing of ``scene`` on ``contact``, with ``changes`` to the arguments of :func:`chemage.age`; None if the
    scene stops at the contact."""
    if not scene.ages:
        return None
    assert scene.chemistry is not None
    assert scene.hold is not None
    arguments: dict[str, Any] = {
        "engine": scene.engine,
        "hold_times": scene.hold.hold_times,
        "temperature": scene.hold.temperature,
        "replicas": scene.hold.replicas,
        "seed": scene.hold.seed,
        "common": scene.hold.common,
        "rupture": scene.rupture,
        "observe": scene.observe,
    }
    with scene.in_use():
        return age(contact, scene.chemistry, **(arguments | changes))


def run_keys(scene: Scene, contact: ContactSolution, aging: Aging | None) -> dict[str, str]:
    """The keys of the stages of a finished run, in which the plugins that took part enter."""
    made = contact.provenance.get("surface")
    plugins = {"surface": made.get("plugins", {}) if isinstance(made, Mapping) else {}, "contact": contact.plugins}
    plugins["aging"] = plugins["result"] = contact.plugins if aging is None else aging.plugins
    return with_plugins(scene.keys(), plugins)


@contextmanager
def _timed(stage: str, scene: Scene, timings: dict[str, float], report: Progress) -> Iterator[None]:
    """Report the begin and end of a stage, note its wall seconds, and name it in errors."""
    report(stage, 0, 0)
    begin = time.perf_counter()
    try:
        yield
    except ChemageError as error:
        error.add_note(f"in the stage {stage!r} of scene {scene.name!r}")
        raise
    timings[stage] = time.perf_counter() - begin
    report(stage, 1, 1)


def _solved(scene: Scene, surface: Surface, checkpoints: Path | None) -> ContactSolution:
    if checkpoints is None:
        return solve_contact(scene.solver, surface, scene.load)
    try:
        checkpoints.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"cannot make the folder {checkpoints}: {error.strerror}") from error
    path, key = checkpoints / "contact.h5", scene.keys()["contact"]
    other = f"{checkpoints} holds checkpoints of another scene; choose another folder"
    hooks = ("chemage_solve_contact",)
    call = {"solver": scene.solver, "surface": surface, "load": scene.load, "start": None}
    solution = resumed(
        path, "contact", ContactSolution, key, other, run=key, before=surface.plugins, hooks=hooks, **call
    )
    if solution is None:
        solution = solve_contact(scene.solver, surface, scene.load)
        keep(path, "contact", solution, key, run=key, before=surface.plugins, hooks=hooks)
    return solution
