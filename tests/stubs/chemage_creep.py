"""A package of a third party that adds a stage: the contact creeps, so that its area grows after it was solved."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import ndimage

from chemage import plugin


class Creep(plugin.Component):
    """``[creep]``: the contact grows by one row of pixels along its rim for each decade of ``time``."""

    time: plugin.Time
    """s, counted from 1 s"""


class CreepStage(plugin.Stage):
    def model(self):
        return Creep

    def estimate(self, parts, stated):
        return {"cpu_seconds": 1e-7 * stated["contact"].get("pixels", 0.0)}

    def doubts(self, parts, stated) -> Iterator[plugin.Doubt]:
        if self.section in parts and parts[self.section].time < 10:
            yield plugin.Doubt("creep", f"nothing creeps within {parts[self.section].time:g} s")

    def run(self, inputs):
        contact, rows = inputs.made["contact"], int(np.log10(max(inputs.parts[self.section].time, 1.0)))
        if not rows:
            return contact
        touching = ndimage.binary_dilation(contact.pressure > 0, iterations=rows)
        pressure = touching * ndimage.gaussian_filter(contact.pressure, rows, mode="wrap")
        pressure *= contact.pressure.sum() / pressure.sum()
        added = (touching.sum() - (contact.pressure > 0).sum()) * contact.pixel_size**2
        plugin.record(grown=plugin.Output(unit="nm2", description="area that creep added").of(added))
        return contact.model_copy(update={"pressure": pressure})


STAGES = (CreepStage("creep", takes=("contact",), makes="contact"),)
