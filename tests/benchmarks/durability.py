"""What checksums and syncing cost: their share of a run and of a sweep of 1,000 points.

    python tests/benchmarks/durability.py [POINTS]

Everything that computes or compares a checksum, and every wait for the disk, is timed where it is called. Nothing else
runs in this process meanwhile, so that elapsed time is the cost. Target: below 3 %.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import chemage
from chemage.cli import app
from chemage.foundation import codec, seals
from chemage.studies import folder
from chemage.studies.sweeps import table

#: seconds in checksums, in waiting for the disk
SPENT = {"checksums": 0.0, "syncing": 0.0}
#: of the two that read and write JSON, which is written and read without a seal too, only the hash is counted
CHECKSUMS = ("seal", "check_seal", "has_seal", "unsealed", "check_json_seal")
SCENE = {
    "name": "small",
    "surface": {"kind": "self-affine", "pixels": 64, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 16},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 40.0},
    "forming": {"kind": "md-silica"},
    "breaking": {"kind": "gaussian", "mean": 1.1, "std": 0.02},
    "interaction": {"kind": "elastic-pairs", "strength": 0.5, "bias": 0.1},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": 1e-3, "stop": 1e5, "replicas": 10},
}


def timed(what: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """``function``, whose seconds are added to SPENT."""

    def call(*arguments: Any, **options: Any) -> Any:
        begin = time.perf_counter()
        try:
            return function(*arguments, **options)
        finally:
            SPENT[what] += time.perf_counter() - begin

    return call


def hash_timed(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function``, in which the seconds of ``seals._sha256`` are added to SPENT."""
    plain, slow = seals._sha256, timed("checksums", seals._sha256)

    def call(*arguments: Any, **options: Any) -> Any:
        seals._sha256 = slow
        try:
            return function(*arguments, **options)
        finally:
            seals._sha256 = plain

    return call


def share(name: str, work: Callable[[], Any]) -> None:
    """Do ``work`` and print what part of its time the two took."""
    SPENT.update(dict.fromkeys(SPENT, 0.0))
    begin = time.perf_counter()
    work()
    total = time.perf_counter() - begin
    parts = ", ".join(f"{what} {1e3 * spent:.1f} ms" for what, spent in SPENT.items())
    print(f"{name}: {total:.2f} s; {parts}; {100 * sum(SPENT.values()) / total:.2f} %", flush=True)


def main() -> None:
    """Time both, with compiled kernels."""
    points = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    chemage.run(SCENE)
    for module in (codec, folder, table):
        for name in CHECKSUMS:
            if (function := getattr(module, name, None)) is getattr(seals, name) and function is not None:
                setattr(module, name, timed("checksums", function))
    for name in ("to_sealed_json", "from_sealed_json"):
        setattr(folder, name, hash_timed(getattr(seals, name)))
    os.fsync = timed("syncing", os.fsync)
    with tempfile.TemporaryDirectory() as name:
        here = Path(name).resolve()

        os.chdir(here)

        def command() -> None:
            sys.argv = ["chemage", "run", "silica-rough"]
            with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
                app.app()

        share("chemage run silica-rough", command)
        share("reading its file", lambda: chemage.read("silica-rough.h5"))
        seeds = {"hold.seed": list(range(points // 10)), "contact.load": [10.0 * n for n in range(1, 11)]}
        share(
            f"sweep of {points} points (64 x 64 pixels, ten contacts)",
            lambda: chemage.sweep({**SCENE, "sweep": seeds}, "sweep", confirm=True),
        )
        share("the same sweep again", lambda: chemage.sweep({**SCENE, "sweep": seeds}, "sweep", confirm=True))


if __name__ == "__main__":
    main()
