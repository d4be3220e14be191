"""Speed-up of one contact solve by two threads, and of two solves running at the same time, which is the limit of the
machine.

    python tests/benchmarks/threads.py            # the reference contact, 20 and 500 uN: a minute
    python tests/benchmarks/threads.py 20         # one load, in uN

Virtual machines share their cores with others, so the best of several repetitions counts; medians are also printed.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from multiprocessing.connection import Connection

import numpy as np

import chemage

REPETITIONS = 14


def measure(load: str) -> str:
    """Alternate between one thread, two threads, and one thread while a second process does the same."""
    surface = chemage.surface(
        "self-affine", pixels=2500, pixel_size="0.4518 nm", rms_slope=0.1, hurst=0.8, zeta=150, eta=3
    ).make(seed=1)
    solvers = {
        threads: chemage.contact("fft-bem", modulus="35.3 GPa", threads=threads, tolerance=1e-6) for threads in (1, 2)
    }

    def seconds(threads: int) -> float:
        begin = time.perf_counter()
        solvers[threads].solve(surface, load=load)
        return time.perf_counter() - begin

    def beside(pipe: Connection) -> None:
        seconds(1)
        while pipe.recv():
            pipe.send(seconds(1))

    here, there = multiprocessing.Pipe()
    other = multiprocessing.get_context("fork").Process(target=beside, args=(there,))
    other.start()
    for threads in solvers:
        seconds(threads)
    repetitions = []
    for _ in range(REPETITIONS):
        one, two = seconds(1), seconds(2)
        here.send(True)
        shared = max(seconds(1), here.recv())
        repetitions.append((one, two, shared))
    here.send(False)
    other.join()
    lines = []
    for name, (one, two, shared) in (("best", np.min(repetitions, axis=0)), ("median", np.median(repetitions, axis=0))):
        lines.append(
            f"| {load} | {name} | {one:.2f} | {two:.2f} | {one / two:.2f} | {shared:.2f} | {2 * one / shared:.2f} |"
        )
    return "\n".join(lines)


def main() -> None:
    print("| load | of 14 runs | one thread, s | two threads, s | faster by | two solves side by side, s | faster by |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for load in sys.argv[1:] or ("20", "500"):
        print(measure(f"{load} uN"), flush=True)


if __name__ == "__main__":
    main()
