"""Rate-and-state friction: laws fitted to measured and simulated traces; docs/pulling.md."""

from __future__ import annotations

from typing import Any

from chemage.plugin import hookimpl

NAMES = {
    "fit_rate_state": "chemage_rate_state.fit:fit_rate_state",
    "read_trace": "chemage_rate_state.traces:read_trace",
    "trace_of": "chemage_rate_state.traces:trace_of",
    "Trace": "chemage_rate_state.traces:Trace",
}


@hookimpl
def chemage_names() -> dict[str, str]:
    """What users import from ``chemage``."""
    return NAMES


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage rate-state``."""
    from chemage_rate_state.command import rate_state

    return [("rate-state", rate_state)]
