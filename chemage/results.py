"""A finished run as users and files see it: what was asked for, what came of it, where it came from."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from chemage.errors import InputError, StoreError
from chemage.objects import Aging, ContactSolution, Fit, Record, Surface


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
        if self.contact.area_fraction == 1 and not any(note.startswith("full contact") for note in notes):
            notes.append(
                "full contact: every pixel carries pressure, and more load adds pressure but no contact area; "
                "an elastic model says little about a surface pressed flat"
            )
        return tuple(notes)

    def fit(self) -> Fit | None:
        """Line of Δμ against log t over the scene's fit window; None without ageing or without times in the window."""
        if self.aging is None:
            return None
        window = self.scene.get("fit", {})
        try:
            return self.aging.fit(window.get("start", 10.0), window.get("stop", 1e4))
        except InputError:
            return None

    def summary(self) -> dict[str, Any]:
        """One JSON-able object with the numbers users compare; what does not exist is None, as is nan."""
        contact, aging, fit = self.contact, self.aging, self.fit()
        numbers: dict[str, Any] = {
            "name": self.name,
            "solver": self.scene["contact"]["kind"],
            "engine": aging.engine if aging else None,
            **contact.summary(),
            "converged": contact.converged,
            "residual": contact.residual,
            "iterations": contact.iterations,
            "notes": list(self.notes),
            "sites": float(aging.sites.mean()) if aging else contact.sites.size,
            "replicas": aging.replicas if aging else 0,
            "events": int(aging.events.sum()) if aging else 0,
            "hold_times": aging.hold_times.tolist() if aging else [],
            "friction_drop": aging.mean_friction_drop.tolist() if aging else [],
            "friction_drop_stderr": aging.friction_drop_stderr.tolist() if aging else [],
            "friction_coefficient_drop": aging.mean_friction_coefficient_drop.tolist() if aging else [],
            "friction_coefficient_drop_stderr": aging.friction_coefficient_drop_stderr.tolist() if aging else [],
            "beta": fit.beta if fit else None,
            "beta_stderr": fit.beta_stderr if fit else None,
            "cutoff_time": fit.cutoff_time if fit else None,
            "cutoff_time_stderr": fit.cutoff_time_stderr if fit else None,
            "timings": self.timings,
            "versions": self.versions,
            "keys": self.keys,
            "cite": list(self.cite),
        }
        return jsonable(numbers)

    def parts(self) -> dict[str, Record]:
        """The objects to store, by group name."""
        found = {"surface": self.surface, "contact": self.contact, "aging": self.aging}
        return {name: part for name, part in found.items() if part is not None}

    def attributes(self) -> dict[str, str]:
        """What the root of the file says."""
        return {name: json.dumps(getattr(self, name)) for name in ("scene", "timings", "versions", "keys", "cite")}

    @classmethod
    def from_parts(cls, parts: Mapping[str, Any], attributes: Mapping[str, Any]) -> Run:
        """The inverse of :meth:`parts` and :meth:`attributes`."""
        missing = [name for name in ("scene", "timings", "versions", "keys", "cite") if name not in attributes]
        if missing or "contact" not in parts:
            raise StoreError(f"not a complete run: without {', '.join(missing) or 'a contact'}")
        try:
            fields = {name: json.loads(attributes[name]) for name in ("scene", "timings", "versions", "keys", "cite")}
        except ValueError as error:
            raise StoreError(f"not a complete run: {error}") from error
        return cls(
            contact=parts["contact"],
            surface=parts.get("surface"),
            aging=parts.get("aging"),
            **{**fields, "cite": tuple(fields["cite"])},
        )


def jsonable(value: Any) -> Any:
    """Plain JSON: numpy scalars and arrays as numbers and lists, what is not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
