"""How a run is shown: its contact and its ageing in one, with what its scene says, and published values beside it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from chemage.ageing.ageing import Ageing
from chemage.ageing.display import AgeingDisplay
from chemage.contacts.display import OfContact
from chemage.foundation.aliases import Data, Fields
from chemage.foundation.figures import BLACK, plain
from chemage.foundation.names import __version__
from chemage.foundation.ownership import in_words
from chemage.foundation.quantities import NONE, Curve, Quantity
from chemage.foundation.result import (
    Comparable,
    Picture,
    Result,
    Rows,
    displays,
    result_of,
)
from chemage.plugins import registry
from chemage.scene.files import value_at
from chemage.scene.provenance import scatter_of
from chemage.scene.run import Run
from chemage.scene.scene import heading
from chemage.surfaces.role import Scatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from chemage.ageing.fitting import Fit


class PublishedRate(NamedTuple):
    """A published ageing rate."""

    #: per decade
    beta: float
    #: who published it, for the legend
    source: str


def published(scene: Fields) -> list[PublishedRate]:
    """List what plugins say was published for a result of ``scene`` (plain data, in internal units)."""
    plugins = registry.current()
    values = []
    for record, function in plugins.functions("chemage_published"):
        try:
            for where, beta, source in function() or ():
                if where and all(
                    _same(value_at(scene, path), value)
                    for path, value in where.items()
                ):
                    values.append(PublishedRate(float(beta), str(source)))
        except (Exception, SystemExit) as error:
            if plugins.strict:
                raise
            warnings.warn(
                f"published values of plugin {record.name!r} ({record.source}) were left out: "
                f"{in_words(error)}",
                registry.PluginWarning,
                stacklevel=2,
            )
    return values


def draw_published(axes: Axes, scene: Fields, fit: Fit | None) -> None:
    """Draw the published slopes over the hold times of a fit, through the middle of the fitted line."""
    if fit is None or not fit.drawable:
        return
    middle = math.sqrt(fit.span[0] * fit.span[1])
    for number, value in enumerate(published(scene)):
        line = np.geomspace(*fit.span, 50)
        values = float(fit(middle)) + value.beta * np.log10(line / middle)
        label = plain(f"published β = {value.beta:g} ({value.source})")
        axes.plot(
            line,
            values,
            color=BLACK,
            lw=1.2,
            ls=("--", ":", "-.")[number % 3],
            zorder=4,
            label=label,
        )


def _same(values: Any, expected: Any) -> bool:
    numbers = all(isinstance(one, float | int) for one in (values, expected))
    if numbers and not isinstance(values, bool):
        return math.isclose(values, expected, rel_tol=1e-6)
    return values == expected


@displays(Ageing)
class AgeingOfScene(AgeingDisplay):
    """An ageing curve with what is known of its surface, and with what was published about its ``scene``."""

    def __init__(self, ageing: Ageing, run: Run | None = None) -> None:
        super().__init__(
            ageing, run.window, run.name
        ) if run is not None else super().__init__(ageing)
        self._scene = {} if run is None else run.scene

    @property
    def scatter(self) -> Scatter | None:
        fit = self.fit[0]
        if fit is not None and fit.saturates:  # the estimates are not of such a β
            return None
        return scatter_of(self._scene, self.record, self.record.contact)

    def draw_published(self, axes: Axes) -> None:
        draw_published(axes, self._scene, self.fit[0])


@displays(Run)
class RunDisplay(Result):
    """A run as users see it."""

    errors = AgeingDisplay.errors

    def __init__(self, run: Run) -> None:
        self.run = run
        # an empty result where nothing ages
        self.ageing = (
            Result() if run.ageing is None else AgeingOfScene(run.ageing, run)
        )
        self.contact: OfContact[Any] = result_of(run.contact)  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def name(self) -> str:
        return self.run.name

    @property
    def title(self) -> str:
        return heading(self.run.scene)

    @property
    def scene(self) -> Fields:
        return self.run.scene

    @property
    def approximation(self) -> str:
        return self.run.approximate

    @property
    def plugins(self) -> Mapping[str, str]:
        return self.run.plugins

    def facts(self) -> Rows:
        scene = self.run.scene
        facts = [
            (section, f"{scene[section]['kind']}, {words}")
            for section, words in self._stages()
        ]
        facts += [
            (section, options_text(options))
            for section in registry.current().owners
            for options in as_list(scene.get(section, ()))
        ]
        facts += self.ageing.facts()
        facts += [
            (f"plugin {name}", source) for name, source in self.plugins.items()
        ]
        facts += [
            (f"changed by {name}", ", ".join(changes))
            for name, changes in self.run.changes.items()
        ]
        return facts

    def remarks(self) -> Rows:
        return [
            *super().remarks(),
            *([("wall time", self._timings())] if self.run.timings else []),
        ]

    def _stages(self) -> Rows:
        return [
            ("surface", self.contact.extent()),
            ("contact", self.contact.solved()),
        ]

    def quantities(self) -> list[Quantity]:
        return self.run.quantities()

    def curves(self) -> list[Curve]:
        return [*self.ageing.curves(), *self.contact.curves()]

    def _timings(self) -> str:
        return ", ".join(
            f"{stage} {seconds:.2f} s"
            for stage, seconds in self.run.timings.items()
        )

    def numbers(self) -> Data:
        return self.run.summary()

    def notes(self) -> list[str]:
        faults = [] if self.run.contact.converged else self.contact.notes()[:1]
        return [*faults, *self.run.notes]

    def parts(self) -> dict[str, Result]:
        parts: dict[str, Result] = {"contact": self.contact, "ageing": self.ageing}
        if self.run.surface is not None:
            parts = {"surface": result_of(self.run.surface), **parts}
        if self.run.ageing is None:
            del parts["ageing"]
        return parts

    def pictures(self) -> dict[str, Picture]:
        found = {
            name: picture
            for part in self.parts().values()
            for name, picture in part.pictures().items()
        }
        if self.run.ageing is not None and "friction" in found:
            title = f"{self.title}, {self.run.ageing.temperature:g} K"
            if self.approximation:
                title += f"\napproximate: {self.approximation}"
            found["friction"] = replace(found["friction"], title=title)
        return found

    def cite(self) -> tuple[list[str], str]:
        return list(self.run.cite), self.run.versions.get("chemage", __version__)

    def made_by(self) -> Fields:
        return {"scene": self.scene, "ageing": self.run.ageing}

    def maps(self) -> Fields:
        return {
            name: whole
            for part in self.parts().values()
            for name, whole in part.maps().items()
        }

    def provenance(self) -> Rows:
        run, scene = self.run, self.run.scene
        return [
            (
                "seed of the surface",
                str(scene.get("surface", {}).get("seed", NONE)),
            ),
            (
                "seed of disorder and kinetics",
                str(scene.get("hold", {}).get("seed", NONE)),
            ),
            ("solver", f"{scene['contact']['kind']}, {self.contact.solved()}"),
            ("wall time", self._timings() or NONE),
            *(
                (f"version of {name}", version)
                for name, version in run.versions.items()
            ),
            *super().provenance(),
            *(
                (f"key of stage {stage}", value)
                for stage, value in run.keys.items()
            ),
            *(
                (f"content hash of {name}", part.digest())
                for name, part in run.parts().items()
            ),
        ]

    def comparable(self) -> Comparable:
        if self.run.ageing is None:
            return Comparable(load=self.run.contact.load)
        chemistry = chemistry_of_scene(self.scene, self.run.ageing.temperature)
        return replace(self.ageing.comparable(), chemistry=chemistry)


def as_list(section: Any) -> Sequence[Fields]:
    """The tables of a section of a scene: one, or several."""
    return (section,) if isinstance(section, Mapping) else section


def options_text(options: Fields) -> str:
    """The options of a section in one line, its kind first."""
    return ", ".join(
        str(value) if name == "kind" else f"{name} {value}"
        for name, value in options.items()
    )


def chemistry_of_scene(scene: Fields, temperature: float) -> Data:
    """The sections of a scene that determine the kinetics of the sites, and the temperature."""
    sections = ("forming", "breaking", "interaction", "chemistry")
    return {
        **{name: scene[name] for name in sections if name in scene},
        "temperature": temperature,
    }
