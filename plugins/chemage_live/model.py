"""What a page shows of a scene at settings of its sliders, as plain columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from chemage import ContactSolution, InputError, Run, parse_scene, run
from chemage.plugin import Curve, Result, figures, override, result_of, text
from chemage_live.sliders import Control

#: while a slider moves: pixels along a side, and sites times replicas, at most
PIXELS, SITES = 512, 1200


class LiveScene:
    """A scene that follows sliders, and the last result."""

    last: Run

    def __init__(self, data: Mapping[str, Any], sliders: Sequence[Control]) -> None:
        self.data = data
        self.name = str(data["name"])
        self.sliders = sliders
        #: sites of the last result
        self.sites = 1.0

    def changes(self, places: Sequence[int]) -> dict[str, Any]:
        """Dotted path -> value of the sliders at these places, of what this scene has."""
        return {
            slider.path: slider.values[place]
            for slider, place in zip(self.sliders, places, strict=True)
            if slider.path.partition(".")[0] in self.data
        }

    def at(self, places: Sequence[int], quick: bool = False, load: str = "") -> str:
        """Compute the result at these places; ``quick``: with less, which is returned in words; ``load``: instead of the
        slider's.

        Raises
        ------
        ChemageError
            As of any run; or nothing ages.
        """
        changes = self.changes(places) | ({"contact.load": load} if load else {})
        scene = parse_scene(override(self.data, changes))
        hold = scene.hold
        if hold is None:
            raise InputError.of(
                "scene", self.name, "ages nothing; live shows ageing"
            )
        less = []
        grids = scene.site_grids
        most = math.ceil(max(grids[0]) / PIXELS) if quick and grids else 1
        for factor in range(most, 1, -1):
            if (coarser := scene.coarser(factor)) is not None:
                scene = coarser
                less.append(f"pixels {factor} times larger")
                break
        replicas = max(2, int(SITES / self.sites))
        if quick and replicas < hold.replicas:
            less.append(f"{replicas} of {hold.replicas} replicas")
            scene = scene.with_hold(replicas=replicas)
        self.last = run(scene, warn=False, progress=False)
        if self.last.aging is not None:
            self.sites = max(1.0, float(self.last.aging.sites.mean()))
        return ", ".join(less)

    @property
    def shown(self) -> Result:
        """The last result, as users see it."""
        return result_of(self.last)

    @property
    def curve(self) -> Curve:
        """The curve over hold time that users look for first."""
        return min(
            self.shown.curves(), key=lambda one: (one.rank, one.is_distribution)
        )

    def columns(self) -> dict[str, Any]:
        """The curve with both ends of its intervals."""
        curve = self.curve
        half = np.nan_to_num(curve.half_width) if curve.half_width.size else 0.0
        ends = {"low": curve.mean - half, "high": curve.mean + half}
        return {"x": curve.x, "y": curve.mean, **ends}

    def pressure(self, most: int) -> dict[str, Any] | None:
        """The map of pressure, the largest in each of ``most`` blocks along a side; nan where there is no contact. None:
        there is no map."""
        contact = self.last.contact
        if not isinstance(contact, ContactSolution):
            return None
        blocks = figures.pooled(contact.pressure, np.max, most)
        seen = np.where(blocks > 0, blocks, np.nan).T.astype(np.float32)
        width, height = np.multiply(contact.pressure.shape, contact.pixel_size)
        return {"image": [seen], "width": [width], "height": [height]}


def table(results: Sequence[Result]) -> str:
    """The numbers of results beside each other, and their notes, as HTML."""
    found: dict[str, list[str]] = {}
    for number, result in enumerate(results):
        left_out = {name for name, _ in result.facts()} | {
            "wall time",
            "every ± is",
        }
        for name, words in result.rows():
            if name not in left_out:
                found.setdefault(name, [""] * len(results))[number] = words
    notes = ["; ".join(result.notes()) for result in results]
    rows = [("", *(result.heading for result in results))]
    rows += [(name, *cells) for name, cells in found.items()]
    return text.html_table(
        "", [*rows, *([("notes", *notes)] if any(notes) else [])]
    )
