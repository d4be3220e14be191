"""Engines that can use several threads inside one run."""

from __future__ import annotations

from typing import Any

from pydantic import Field, model_validator

from chemage.plugin import Engine, threads


class ThreadedEngine(Engine):
    """An engine with the option ``threads``."""

    speed_only = ("threads",)

    threads: int = Field(default=1, ge=0)
    """threads inside one run; 0: one per processor that this process may use; default: 1"""

    @model_validator(mode="before")
    @classmethod
    def _earlier_name(cls, options: Any) -> Any:
        # scenes and sweeps of 0.1 call it workers
        if isinstance(options, dict) and "workers" in options and "threads" not in options:
            return {("threads" if name == "workers" else name): value for name, value in options.items()}
        return options

    def concurrency(self) -> int:
        """Threads of one run: ``threads``."""
        return self.threads or threads.available()
