"""What a scene costs, as far as its components state it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Cost:
    """What one scene will cost, stage by stage; None where a component gives no estimate."""

    #: nx, ny, pixel_size, rms_slope, ... as far as the surface maker gives them
    surface: Mapping[str, float]
    area_fraction: float | None
    sites: float | None
    contact_cpu_seconds: float | None
    #: of all replicas
    kinetics_cpu_seconds: float | None
    #: peak memory of the contact, and of one replica, bytes
    contact_bytes: float | None
    replica_bytes: float | None
    #: of the gap, if the contact has one, bytes
    gap_bytes: float
    #: of the contact as a sweep stores it, bytes
    contact_file: float
    #: least and most CPU seconds of all replicas, where no single number can be given, and the reason
    kinetics_range: tuple[float, float] | None = None
    range_reason: str = ""
    #: bonds formed and broken per site of a replica, and the share of the sites that are bonded at the last hold time
    events: float | None = None
    bonded: float | None = None
    #: expected mean of the pressure in contact, GPa
    mean_pressure: float | None = None

    @property
    def pixels(self) -> float:
        """Number of pixels; 0 where it is not known."""
        return self.surface.get("nx", 0.0) * self.surface.get("ny", 0.0)
