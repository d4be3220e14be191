"""`chemage live` in Chromium: from a moved slider to the new curve, and memory over many moves.

python tests/benchmarks/live.py [--moves 40] [--many 1000]
"""

import argparse
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

from chemage_live.page import Page

sys.path.insert(0, str(Path(__file__).parents[1] / "cli"))
from conftest import Browser, chromium

MOVE = """new Promise(done => {
  const slider = document.getElementById('contact.load')
  const curve = Bokeh.documents[0].get_model_by_name('%s'), before = curve.data, begin = performance.now()
  const command = document.getElementById('command'), value = slider.previousElementSibling
  const there = () => curve.data !== before && command.textContent.includes(`=${value.textContent}'`)
  const look = () => there() ? done(performance.now() - begin) : setTimeout(look, 1)
  slider.value = (+slider.value + 7) %% (+slider.max + 1)
  slider.oninput()
  look()
})"""
SCENES = {
    "silica-tip": {},
    "silica-rough": {"surface.pixels": 512, "surface.zeta": 150, "hold.replicas": 2},
}


def resident():
    """MB in memory."""
    return int(re.search(r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=40)
    parser.add_argument("--many", type=int, default=1000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for scene, changes in SCENES.items():
            live = Page(scene, slide=["contact.load"], changes=changes).serve()
            browser = Browser(chromium(), Path(folder) / scene)
            browser.open(live.url, 1280)
            browser.wait("Bokeh.documents[0]?.is_idle")
            # what the browser tells of each message would be kept here
            browser.call("Network.disable")

            def moved(count, browser=browser, scene=scene):
                return [
                    browser.call("Runtime.evaluate", expression=MOVE % scene, returnByValue=True, awaitPromise=True)[
                        "result"
                    ]["value"]
                    for _ in range(count)
                ]

            moved(5)
            times = moved(given.moves)
            low, middle, high = np.percentile(times, [10, 50, 90])
            print(f"{scene}: a move takes {middle:.0f} ms (median; 10 and 90 %: {low:.0f}, {high:.0f})", flush=True)
            if scene == "silica-tip":
                sizes = []
                for _ in range(5):
                    moved(given.many // 5)
                    sizes.append(resident())
                print(f"memory over {given.many} moves: {', '.join(f'{size:.0f}' for size in sizes)} MB", flush=True)
            browser.close()
            live.stop()


if __name__ == "__main__":
    main()
