"""Whether an accuracy that is asked for is kept, on scenes that tuned nothing.

    python tests/benchmarks/promise.py FOLDER [first last]      # scenes 1000 to 1059: hours, goes on where it stopped
    python tests/benchmarks/promise.py FOLDER --table

Every scene of ``unseen_scenes.py`` from number ``first`` to ``last`` has a reference, an ensemble of its own seeds with
half widths of at most 0.7 %, and is then asked for 5, 2 and 1 % of β and of Δμ at 1000 s. The truth is held if the two
differ by less than the half widths of both, added in squares, since the reference has an error as well. Samples are
kept in FOLDER, results in FOLDER/promise.jsonl.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path

from unseen_scenes import unseen

from chemage import ChemageError
from chemage.studies.ensembles.goals import with_request
from chemage.studies.ensembles.running import Sampler

ASKED = (0.05, 0.02, 0.01)
REFERENCE = 0.007
QUANTITIES = ("beta", "friction_coefficient_drop@1e3 s")


def estimates(made) -> dict[str, list[float]]:
    return {
        name: [one.value, one.half_width]
        for name, one in (("beta", made.estimate("beta")), ("drop", made.estimate("friction_coefficient_drop", 1e3)))
    }


def measured(number: int, folder: Path) -> dict[str, object]:
    """The reference and the answers of one scene."""
    scene = unseen(number)
    assert scene.hold is not None
    found: dict[str, object] = {"scene": number}
    others = scene.hold.model_copy(update={"seed": 500_000 + number})
    reference = scene.model_copy(update={"surface_seed": 500_000 + number, "hold": others})
    for name, one, accuracy in [("reference", reference, REFERENCE), *((str(a), scene, a) for a in ASKED)]:
        begin, wall = time.process_time(), time.monotonic()
        wanted = with_request(one.completed(), accuracy=dict.fromkeys(QUANTITIES, accuracy), most=100_000)
        sampler = Sampler(wanted, samples=folder)
        made = sampler.run()
        found[name] = {
            **estimates(made),
            "levels": [[level["words"], level["samples"]] for level in made.levels],
            "estimated": sum(level["samples"] * level["cpu_seconds"] for level in made.levels),
            "cpu": time.process_time() - begin,
            "wall": time.monotonic() - wall,
            "taken_up": sampler.store.found,
        }
    return found


def table(lines: list[dict]) -> None:
    """Coverage, and the widest interval, for each accuracy and quantity."""
    print(f"{len(lines)} scenes")
    for name in map(str, ASKED):
        for quantity in ("beta", "drop"):
            held, widest = 0, 0.0
            for line in lines:
                (truth, slack), (value, half) = line["reference"][quantity], line[name][quantity]
                held += abs(value - truth) <= math.hypot(slack, half)
                widest = max(widest, half / abs(value))
            print(f"{name} {quantity}: {100 * held / len(lines):.1f} % held, widest {100 * widest:.2f} %")


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "promise.jsonl"
    lines = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    if "--table" not in sys.argv:
        first, last = (int(word) for word in sys.argv[2:4]) if len(sys.argv) > 3 else (1000, 1059)
        for number in range(first, last + 1):
            if any(line["scene"] == number for line in lines):
                continue
            try:
                lines.append(measured(number, folder))
            except ChemageError as error:
                print(f"scene {number}: {error}", flush=True)
                continue
            print(json.dumps(lines[-1]), flush=True)
            with open(log, "a") as stream:
                stream.write(json.dumps(lines[-1]) + "\n")
    table(lines)


if __name__ == "__main__":
    main()
