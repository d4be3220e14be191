"""One experiment from end to end: :func:`run` computes every stage of a scene, :class:`Run` is what comes of it."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from chemage.ageing.age import age, with_members
from chemage.ageing.ageing import (
    BARRIERS,
    Ageing,
    beta_parts,
    bond_errors,
    elastic_measures,
    elastic_notes,
    fit_or_reason,
)
from chemage.ageing.fitting import DROPS, FIT, FIT_WINDOW, Fit
from chemage.ageing.hooks import arguments_of
from chemage.ageing.replicas import Checkpoint
from chemage.contacts.role import elasticity_notes
from chemage.contacts.solution import ContactSolution, ContactStatistics
from chemage.foundation.aliases import Data, Fields
from chemage.foundation.codec import EXTRA
from chemage.foundation.errors import (
    ChemageError,
    InputError,
    PlanWarning,
    StoreError,
    optional_module,
)
from chemage.foundation.files import make_folder
from chemage.foundation.outputs import MeasuredOutput
from chemage.foundation.progress import progress_bars
from chemage.foundation.quantities import Quantity, by_name
from chemage.foundation.records import (
    Record,
    content_hash,
    merged_approximations,
    merged_changes,
    read_only,
)
from chemage.foundation.result import draw_parts, notebook_html
from chemage.foundation.text import approximations_in_words, jsonable
from chemage.plugins import registry
from chemage.plugins.hooks import Stage, StageInputs
from chemage.plugins.sources import run_stage
from chemage.scene.files import load_scene
from chemage.scene.plan import LongRunWarning, cost
from chemage.scene.provenance import scatter_of, versions
from chemage.scene.scene import Scene
from chemage.surfaces.role import Scatter
from chemage.surfaces.surface import Surface

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

#: called with (stage, done, total); total is 0 where a stage does not report how far it is
Progress = Callable[[str, int, int], None]
#: what a file holds of a run beside its records
_ATTRIBUTES = ("scene", "timings", "versions", "keys", "cite")


@dataclass(frozen=True)
class Run:
    """A finished run. Everything needed to repeat it is in ``scene`` and ``versions``.

    Attributes
    ----------
    scene
        The scene as it was run, with every default: plain JSON values, in the units of the options.
    contact
        The contact, or its statistics; pressures in GPa, lengths in nm.
    surface
        The surface, heights in nm; None where a theory needs none.
    ageing
        Bonds and friction against hold time, in nN and s; None where the scene solves the contact alone.
    timings
        Stage -> wall time, s.
    versions
        Of chemage, the plugins used, and the libraries below them.
    keys
        Stage -> hash of all that decides what it gives.
    cite
        The works to cite.
    """

    scene: Data
    contact: ContactSolution | ContactStatistics
    surface: Surface | None = None
    ageing: Ageing | None = None
    timings: dict[str, float] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)
    cite: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("scene", "timings", "versions", "keys"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def name(self) -> str:
        """The scene's name."""
        return str(self.scene.get("name", "scene"))

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of this result, in words."""
        notes = [*self.contact.notes, *elasticity_notes(self.contact)]
        notes += self.ageing.notes if self.ageing is not None else ()
        notes += elastic_notes(self.ageing)
        if (fit := self.fit()) is not None:
            notes += fit.notes
        if self.contact.area_fraction == 1 and not any(
            note.startswith("full contact") for note in notes
        ):
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
        later = {} if self.ageing is None else self.ageing.plugins
        return {**self.contact.plugins, **later}

    @property
    def changes(self) -> dict[str, list[str]]:
        """What each of them answered or changed, see :attr:`chemage.plugin.Record.changes`."""
        later = self.ageing.changes if self.ageing is not None else {}
        return merged_changes(self.contact.changes, later)

    @property
    def measured(self) -> dict[str, MeasuredOutput]:
        """What observables measured, and what components and hooks recorded at any stage, by name."""
        later = {} if self.ageing is None else self.ageing.measured
        return {**self.contact.measured, **later}

    @property
    def approximate(self) -> str:
        """What is approximate about this result, in words: the kinds and their declared errors; "" if nothing is."""
        later = () if self.ageing is None else self.ageing.approximate
        every = merged_approximations(self.contact.approximate, later)
        return approximations_in_words(every)

    @property
    def scatter(self) -> Scatter | None:
        """How much β differs between surfaces of other seeds, where the maker of the surface says so; None without
        ageing, and where β saturates, of which the estimates are not."""
        if self.ageing is None or (
            (fit := self.fit()) is not None and fit.saturates
        ):
            return None
        return scatter_of(self.scene, self.ageing, self.contact.summary())

    def quantities(self) -> list[Quantity]:
        """The numbers of the contact and of the ageing, and the scatter between surfaces where it is known."""
        numbers = self.contact.quantities()
        if self.ageing is not None:
            numbers += self.ageing.quantities(self.window)
        if (scatter := self.scatter) is not None and scatter.text():
            numbers.append(scatter.quantity())
        return numbers

    def fit(self) -> Fit | None:
        """Line of Δμ against log t over the scene's fit window; None without ageing or without times in the window."""
        return self._fitted[0]

    @property
    def beta_errors(self) -> dict[str, float]:
        """What an error of β beside the scatter of the replicas is due to -> relative standard error; none of a β of 0."""
        fit = self.fit()
        if self.ageing is None or fit is None or fit.beta == 0:
            return {}
        parts = beta_parts(self.ageing, self.window)
        return {name: part.size / abs(fit.beta) for name, part in parts.items()}

    @cached_property
    def _fitted(self) -> tuple[Fit | None, str]:
        return (
            (None, "")
            if self.ageing is None
            else fit_or_reason(self.ageing, self.window)
        )

    def summary(self) -> Data:
        """One JSON-able object with the numbers users compare; what does not exist is None, as is nan."""
        contact, ageing, scatter = self.contact, self.ageing, self.scatter
        fit, reason = self._fitted
        numbers: Data = {
            "name": self.name,
            "solver": self.scene["contact"]["kind"],
            **_kinds(ageing),
            "engine": ageing.engine if ageing else None,
            **contact.summary(),
            **_solve(contact),
            "notes": list(self.notes),
            "sites": float(ageing.sites.mean()) if ageing else _sites(contact),
            "site_grid": ageing.site_grid if ageing else None,
            "replicas": ageing.replicas if ageing else 0,
            "events": (
                None if ageing.events is None else sum(ageing.events.tolist())
            )
            if ageing
            else 0,
            "common_random_numbers": ageing.provenance.get("common")
            if ageing
            else None,
            "hold_times": ageing.hold_times.tolist() if ageing else [],
            **self._curves(),
            **bond_errors(ageing),
            "observables": {
                name: quantity.summary() for name, quantity in self.measured.items()
            },
            **{
                name: value
                for one in (fit.quantities() if fit else FIT)
                for name, value in one.numbers().items()
            },
            "fit_range": list(fit.span) if fit else None,
            "beta_reason": reason or None,
            "cutoff_reason": (fit.cutoff_reason or None) if fit else None,
            "beta_scatter_between_surfaces": scatter.relative if scatter else None,
            **({"beta_errors": errors} if (errors := self.beta_errors) else {}),
            **elastic_measures(ageing),
            "timings": self.timings,
            "versions": self.versions,
            "plugins": self.plugins,
            **({"changes": changes} if (changes := self.changes) else {}),
            "keys": self.keys,
            "cite": list(self.cite),
            **({"approximate": self.approximate} if self.approximate else {}),
        }
        return jsonable(numbers)

    def _curves(self) -> Data:
        """ΔF and Δμ with their errors; nan where one is not known, and empty without ageing."""
        known, none = {}, np.zeros(0)
        if self.ageing is not None:
            known = by_name(self.ageing.curves())
            none = np.full(self.ageing.hold_times.size, np.nan)
        numbers: Data = {}
        for name, curve in DROPS.items():
            unknown = curve.but(mean=none, stderr=none, half_width=none)
            numbers |= known.get(name, unknown).numbers()
        return numbers

    def plot(
        self, *what: Literal["surface", "contact", "ageing"]
    ) -> tuple[Axes, ...]:
        """Draw surface, contact and ageing side by side in a figure of pyplot, or only those named; return their axes.

        Raises
        ------
        InputError
            The run has no such part.
        """
        return draw_parts(self, what)

    def to_xarray(self) -> xarray.Dataset:
        """The arrays of surface, contact and ageing in one dataset, named as in the file. Needs xarray."""
        there = {
            "surface": self.surface,
            "contact": self.contact,
            "ageing": self.ageing,
        }
        parts, attributes = [], {"name": self.name}
        for name, record in there.items():
            if record is not None:
                part = record.to_xarray()
                parts.append(part)
                attributes |= {
                    f"{name}.{k}": value for k, value in part.attrs.items()
                }
        merged = optional_module("xarray", EXTRA).merge(
            parts, combine_attrs="drop_conflicts", join="outer"
        )
        merged.attrs = attributes
        return merged

    def to_pandas(self) -> pandas.DataFrame:
        """One row for each hold time, see :meth:`Ageing.to_pandas`. Needs pandas.

        Raises
        ------
        InputError
            The run ends at the contact.
        """
        if self.ageing is None:
            raise InputError(
                f"{self.name} ends at the contact, so that it has no hold times; use run.contact.to_pandas()"
            )
        return self.ageing.to_pandas()

    def _repr_html_(self) -> str:
        return notebook_html(self)

    def parts(self) -> dict[str, Record]:
        """The objects to store, by group name."""
        contact = {
            "contact" if self.contact.has_map else "statistics": self.contact
        }
        records = {"surface": self.surface, **contact, "ageing": self.ageing}
        return {name: part for name, part in records.items() if part is not None}

    def attributes(self) -> dict[str, str]:
        """The attributes of the root of the file."""
        return {name: json.dumps(getattr(self, name)) for name in _ATTRIBUTES}

    @classmethod
    def from_parts(cls, parts: Fields, attributes: Fields) -> Run:
        """The inverse of :meth:`parts` and :meth:`attributes`."""
        missing = [name for name in _ATTRIBUTES if name not in attributes]
        contact = parts.get("contact") or parts.get("statistics")
        if missing or contact is None:
            raise StoreError(
                f"not a complete run: without {', '.join(missing) or 'a contact'}"
            )
        try:
            fields = {name: json.loads(attributes[name]) for name in _ATTRIBUTES}
        except (ValueError, TypeError, RecursionError) as error:
            raise StoreError(f"not a complete run: {error}") from error
        if wrong := [
            name for name, value in fields.items() if not _is_sound(name, value)
        ]:
            raise StoreError(f"not a complete run: damaged {', '.join(wrong)}")
        return cls(
            contact=contact,
            surface=parts.get("surface"),
            ageing=parts.get("ageing"),
            **{**fields, "cite": tuple(fields["cite"])},
        )


def _kinds(ageing: Ageing | None) -> dict[str, str | None]:
    """Section -> kind of the component of each stage of the ageing; None where there is none, but for stages of plugins,
    so that a summary does not depend on what is installed."""
    kinds: dict[str, str | None] = {}
    others = registry.current().owners
    for stage in registry.stages():
        if stage.role and stage.key == "ageing" and not stage.many:
            part = (
                ageing.provenance.get(stage.section) if ageing is not None else None
            )
            if isinstance(part, Mapping):
                kinds[stage.section] = part.get("kind")
            elif stage.section not in others:
                kinds[stage.section] = None
    return kinds


def _solve(contact: ContactSolution | ContactStatistics) -> Data:
    """How the contact was solved; nothing of that where it was not."""
    solved = {"converged": True, "residual": 0.0, "iterations": 0}
    return {name: getattr(contact, name, value) for name, value in solved.items()}


def _sites(contact: ContactSolution | ContactStatistics) -> float | None:
    return None if isinstance(contact, ContactStatistics) else contact.sites.size


def _is_sound(name: str, value: Any) -> bool:
    """Whether an attribute of a stored run has the form that everything else relies on."""
    if name == "cite":
        return isinstance(value, list) and all(
            isinstance(text, str) for text in value
        )
    if not isinstance(value, dict):
        return False
    if name == "scene":
        sections = [value.get("surface"), value.get("contact")]
        texts = [value.get("name", ""), value.get("title", "")]
        texts += [
            section.get("kind") if isinstance(section, dict) else None
            for section in sections
        ]
        window = value.get("fit", {})
        times = list(window.values()) if isinstance(window, dict) else [None]
        return all(isinstance(text, str) for text in texts) and all(
            isinstance(time, int | float) for time in times
        )
    kind = int | float if name == "timings" else str
    return all(isinstance(item, kind) for item in value.values())


def run(
    scene: Scene | str | Path | Fields,
    *,
    progress: Progress | bool | None = None,
    threads: int | None = None,
    surface: Surface | None = None,
    contact: ContactSolution | ContactStatistics | None = None,
    checkpoints: Path | None = None,
    warn: bool = True,
    members: bool = True,
) -> Run:
    """Run a scene end to end: every stage that it contains.

    ``scene`` is a :class:`Scene`, a scene file, the name of an installed scene, or scene data. ``progress`` is called
    as stages advance, and True shows them on stderr; ``threads`` is how many replicas run at the same time. A
    ``surface`` or ``contact`` already computed for this very scene (its stage key says so) can be passed in. What
    ``chemage check`` warns of is emitted first, as :class:`PlanWarning`, unless ``warn`` is False. In the folder
    ``checkpoints`` the contact and every replica are kept during the run; an interrupted run resumes from there, with
    equal results. Where the forming barriers are known as an ensemble, its ``members`` are aged as well, for the error
    of the barriers, unless this is False.
    """
    scene = load_scene(scene).completed()
    if scene.is_ensemble:
        raise InputError(
            f"scene {scene.name!r} asks for a mean over surfaces ([ensemble] or [accuracy]); use chemage.ensemble, or "
            "leave these sections out for a run of one surface"
        )
    with ExitStack() as stack:
        stack.enter_context(scene.in_use())
        plan = cost(scene)
        plan.check()
        for doubt in plan.doubts() if warn else ():
            category = LongRunWarning if doubt.kind == "long" else PlanWarning
            warnings.warn(doubt.text, category, stacklevel=3)
        report = (
            stack.enter_context(progress_bars())
            if progress is True
            else (progress or None)
        )
        return _run(scene, report, threads, surface, contact, checkpoints, members)


def _run(
    scene: Scene,
    progress: Progress | None,
    threads: int | None,
    surface: Surface | None,
    contact: ContactSolution | ContactStatistics | None,
    checkpoints: Path | None,
    members: bool,
) -> Run:
    timings: dict[str, float] = {}
    made = compute_stages(
        scene,
        ("contact", "ageing"),
        progress,
        timings,
        threads,
        checkpoints,
        surface=surface,
        contact=contact,
    )
    solved, ageing = made["contact"], made.get("ageing")
    if (
        members
        and ageing is not None
        and scene.chemistry is not None
        and scene.chemistry.forming.members(1)
    ):
        how = arguments_of(scene.solved_parts) | {
            "surface": made.get("surface"),
            "threads": threads,
            "progress": progress and partial(progress, BARRIERS),
        }
        with _timed(BARRIERS, scene, timings, progress):
            ageing = with_members(ageing, solved, scene.chemistry, **how)
    return Run(
        scene.todict(),
        solved,
        made.get("surface"),
        ageing,
        timings,
        versions(scene, (solved, ageing)),
        run_keys(scene, solved, ageing),
        tuple(scene.cite()),
    )


def compute_stages(
    scene: Scene,
    wanted: Collection[str],
    report: Progress | None = None,
    timings: dict[str, float] | None = None,
    threads: int | None = None,
    checkpoints: Path | None = None,
    **given: Any,
) -> Data:
    """What the stages of a scene make that are needed for ``wanted`` ("surface", "contact", "ageing"), by its name; what
    is ``given`` is not made again, nor changed."""
    made = {name: record for name, record in given.items() if record is not None}
    parts = scene.solved_parts
    for stage in _needed(parts, set(wanted), made):
        progress = report and partial(report, stage.section)
        inputs = StageInputs(parts, made, threads, checkpoints, progress)
        solves = (
            stage.makes == "contact" and "surface" in made and not stage.changes
        )
        with _timed(
            stage.section, scene, {} if timings is None else timings, report
        ):
            if checkpoints is not None and solves:
                made["contact"] = _kept(checkpoints, stage, scene, inputs)
            else:
                made[stage.makes] = run_stage(stage, inputs)
    return made


def _needed(parts: Fields, wanted: set[str], made: Collection[str]) -> list[Stage]:
    """The stages that a scene asks for and that are needed, in the order in which they run."""
    needed: list[Stage] = []
    for stage in reversed(registry.stages()):
        if stage.makes in wanted and stage.makes not in made and stage.asked(parts):
            needed.insert(0, stage)
            wanted.update(stage.taken(parts))
    return needed


def surface_of(scene: Scene) -> Surface:
    """The surface of a scene."""
    return compute_stages(scene, {"surface"})["surface"]


def contact_of(scene: Scene, surface: Surface | None = None) -> Any:
    """The contact of a scene, on its ``surface`` where that is there already."""
    with scene.in_use():
        return compute_stages(scene, {"contact"}, surface=surface)["contact"]


def ageing_of(
    scene: Scene, contact: ContactSolution | ContactStatistics, **changes: Any
) -> Ageing | None:
    """The ageing of ``scene`` on ``contact``, with ``changes`` to the arguments of :func:`chemage.age`; None if the
    scene stops at the contact."""
    if not scene.ages:
        return None
    assert scene.chemistry is not None
    with scene.in_use():
        how = arguments_of(scene.solved_parts)
        if how["method"] is not None and how["method"].loads:
            how["surface"] = surface_of(scene)
        return age(contact, scene.chemistry, **(how | changes))


def run_keys(
    scene: Scene,
    contact: ContactSolution | ContactStatistics,
    ageing: Ageing | None,
) -> dict[str, str]:
    """The keys of the stages of a finished run, in which the plugins that took part enter."""
    below = contact.provenance.get("surface")
    last = contact.plugins if ageing is None else ageing.plugins
    plugins = {
        "surface": below.get("plugins", {}) if isinstance(below, Mapping) else {},
        "contact": contact.plugins,
        "ageing": last,
        "result": last,
    }
    return {
        key: content_hash([own, plugins[key]]) if plugins[key] else own
        for key, own in scene.keys().items()
    }


@contextmanager
def _timed(
    stage: str, scene: Scene, timings: dict[str, float], report: Progress | None
) -> Iterator[None]:
    """Report the begin and end of a stage, note its wall seconds, and name it in errors."""
    if report:
        report(stage, 0, 0)
    begin = time.perf_counter()
    try:
        yield
    except ChemageError as error:
        error.add_note(f"in the stage {stage!r} of scene {scene.name!r}")
        raise
    timings[stage] = time.perf_counter() - begin
    if report:
        report(stage, 1, 1)


def _kept(
    folder: Path, stage: Stage, scene: Scene, inputs: StageInputs
) -> ContactSolution:
    """The contact from the checkpoints, or a new one, which is kept there."""
    make_folder(folder)
    key, surface = scene.keys()["contact"], inputs.made["surface"]
    file = Checkpoint(
        folder / "contact.h5",
        ContactSolution,
        key,
        key,
        surface.plugins,
        stage.hooks,
        "contact",
        f"{folder} holds checkpoints of another scene; choose another folder",
    )
    return file.kept(
        partial(run_stage, stage, inputs),
        solver=inputs.parts["contact"],
        surface=surface,
        load=scene.load,
        start=None,
    )
