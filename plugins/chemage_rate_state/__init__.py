"""Rate-and-state friction: laws fitted to traces, and the slip that renews a contact; docs/pulling.md."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl

NAMES = {
    "fit_rate_state": "chemage_rate_state.fit:fit_rate_state",
    "read_trace": "chemage_rate_state.traces:read_trace",
    "trace_of": "chemage_rate_state.traces:trace_of",
    "slip_length": "chemage_rate_state.renewal:slip_length",
    "Trace": "chemage_rate_state.traces:Trace",
}


@hookimpl
def chemage_names() -> dict[str, str]:
    """What users import from ``chemage``."""
    return NAMES


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The commands ``chemage rate-state`` and ``chemage slip-length``."""
    from chemage_rate_state.command import rate_state, slip_length

    return [("rate-state", rate_state), ("slip-length", slip_length)]
