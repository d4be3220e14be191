"""A package of a third party that adds a design: the load at which β of a scene has a given value, and its command."""

from __future__ import annotations

import json
import math
from typing import Annotated

import typer

from chemage import InputError, load_scene, plugin


class Bisection(plugin.Design):
    """The load between ``low`` and ``high`` (nN) at which β is ``beta``, to a part ``within`` of the load."""

    def __init__(self, scene, beta, low, high, within=0.01):
        self.scene, self.beta, self.low, self.high, self.within = scene, beta, low, high, within
        self.betas: dict[float, float] = {}

    @property
    def load(self):
        return math.sqrt(self.low * self.high)

    def ask(self):
        loads = [load for load in (self.low, self.high) if load not in self.betas]
        if not loads and self.high > self.low * (1 + self.within):
            loads = [self.load]
        return [plugin.Task.of(self.scene, {"contact.load": load}) for load in loads]

    def tell(self, task, outcome):
        load = task.changes["contact.load"]
        self.betas[load] = outcome.summary["beta"]
        if self.low < load < self.high:
            same_side = (self.betas[load] > self.beta) == (self.betas[self.low] > self.beta)
            self.low, self.high = (load, self.high) if same_side else (self.low, load)
        elif len(self.betas) == 2 and not min(self.betas.values()) <= self.beta <= max(self.betas.values()):
            found = " and ".join(f"{beta:.3g} at {load:g} nN" for load, beta in sorted(self.betas.items()))
            raise InputError.of("beta", self.beta, f"is not reached: β is {found}", "choose another, or other loads")


def bisect(
    scene: plugin.options.SceneArg,
    beta: Annotated[float, typer.Option(help="β to find, per decade")],
    between: Annotated[tuple[float, float], typer.Option(help="loads between which it is sought, nN")] = (1.0, 1e4),
    changes: plugin.options.SetOpt = None,
    folder: plugin.options.FolderOpt = None,
    executor: plugin.options.ExecutorOpt = None,
    workers: plugin.options.WorkersOpt = None,
    as_json: plugin.options.JsonOpt = False,
) -> None:
    """Find the load at which β of a scene has a given value."""
    design = Bisection(load_scene(scene, plugin.options.changed_fields(changes)), beta, *between)
    plugin.carry_out(design, folder, executor=executor, workers=workers, progress=True)
    print(json.dumps({"load": design.load, "runs": len(design.betas)}) if as_json else f"load {design.load:.4g} nN")


@plugin.hookimpl
def chemage_cli():
    return [("bisect", bisect)]
