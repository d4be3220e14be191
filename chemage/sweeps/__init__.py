"""Sweeps: one scene, many points. :func:`sweep` computes them into a folder, :func:`load_sweep` reads it.

Stages are shared by content hash: a contact is solved once for all points that rest on it, and a point whose file is in
the folder is never computed again. See docs/sweeps.md.
"""

from chemage.sweeps.grid import Axis, Grid, Survey
from chemage.sweeps.progress import SweepProgress
from chemage.sweeps.result import Point, SweepResult, load_sweep
from chemage.sweeps.running import SweepWarning, read_grid, survey_of, sweep

__all__ = [
    "Axis",
    "Grid",
    "Point",
    "Survey",
    "SweepProgress",
    "SweepResult",
    "SweepWarning",
    "load_sweep",
    "read_grid",
    "survey_of",
    "sweep",
]
