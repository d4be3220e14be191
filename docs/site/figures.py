"""Draw the figures of the gallery and the tutorial again: ``python docs/site/figures.py``."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parents[1]
GALLERY = DOCS / "figures" / "gallery"
CHEMAGE = [sys.executable, "-m", "chemage"]


def keep(source: Path, name: str, folder: Path = GALLERY) -> None:
    """Copy a figure, reduced to 256 colours: a quarter of the size, and no visible difference."""
    folder.mkdir(parents=True, exist_ok=True)
    with Image.open(source) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(folder / name, optimize=True)


def runs() -> None:
    """The figures of two runs, and of their comparison."""
    for scene in ("silica-rough", "silica-tip"):
        subprocess.run([*CHEMAGE, "run", scene], check=True)
        for figure in ("surface", "pressure", "barriers", "friction"):
            keep(Path(f"{scene}-figures/{figure}.png"), f"{scene}-{figure}.png")
    shutil.move(GALLERY / "silica-rough-friction.png", DOCS / "figures" / "silica-rough-friction.png")
    for unused in ("surface", "barriers"):
        (GALLERY / f"silica-tip-{unused}.png").unlink()
    subprocess.run([*CHEMAGE, "compare", "silica-tip.h5", "silica-rough.h5", "--figures", "both"], check=True)
    keep(Path("both/pressures.png"), "compare-pressure.png")
    keep(Path("both/bonds-per-area.png"), "compare-bonds-per-area.png")


def temperatures() -> None:
    """The figure of activation energies, of the scene of its page."""
    page = (DOCS / "sweeps.md").read_text(encoding="utf-8").partition("## Activation energies")[2]
    Path("warm-tip.toml").write_text(
        re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[0], encoding="utf-8"
    )
    subprocess.run([*CHEMAGE, "run", "warm-tip.toml"], check=True)
    subprocess.run([*CHEMAGE, "arrhenius", "warm-tip-sweep", "-o", "arrhenius.png"], check=True)
    keep(Path("arrhenius.png"), "arrhenius.png", DOCS / "figures")
    Path("arrhenius.png").unlink()


def sweep() -> None:
    """The figures of the sweep of the gallery."""
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    (scene,) = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    Path("tip.toml").write_text(scene, encoding="utf-8")
    subprocess.run([*CHEMAGE, "run", "tip.toml", "--out", "tip"], check=True)
    subprocess.run([*CHEMAGE, "plot", "tip"], check=True)
    subprocess.run([*CHEMAGE, "plot", "tip", "--heat"], check=True)
    keep(Path("tip-figures/beta-friction_drop-against-temperature-by-load.png"), "sweep-lines.png")
    keep(Path("tip-figures/friction_coefficient_drop-against-hold_time-by-temperature.png"), "sweep-ageing.png")
    keep(Path("tip-figures/beta-friction_drop-against-temperature-and-load.png"), "sweep-heat.png")


def maps() -> None:
    """The figure of speed against accuracy."""
    subprocess.run([*CHEMAGE, "tradeoff", "silica-patch", "-o", "pareto-patch.png"], check=True)
    keep(Path("pareto-patch.png"), "pareto-patch.png", DOCS / "figures")
    Path("pareto-patch.png").unlink()


def image() -> None:
    """The spectrum of the image of its page, carried on to the sites."""
    import tomllib

    import tomli_w

    page = (DOCS / "measured.md").read_text(encoding="utf-8")
    exec(re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[0], {})
    surface = re.findall(r"^```toml\n(\[surface\].*?)^```$", page, re.MULTILINE | re.DOTALL)[0]
    subprocess.run([*CHEMAGE, "init", "image", "--like", "silica-patch"], check=True)
    scene = tomllib.loads(Path("image.toml").read_text(encoding="utf-8")) | tomllib.loads(surface)
    Path("image.toml").write_text(tomli_w.dumps(scene), encoding="utf-8")
    subprocess.run([*CHEMAGE, "run", "image.toml", "--set", "contact.load=2 uN", "--replicas", "1"], check=True)
    keep(Path("image-figures/roughened-spectrum.png"), "roughened-spectrum.png", DOCS / "figures")


def scripts() -> None:
    """The figures that the Python blocks of the gallery draw."""
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    exec("\n".join(re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)), {})
    for figure in Path().glob("*.png"):
        keep(figure, figure.name)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        runs()
        temperatures()
        sweep()
        maps()
        image()
        scripts()
        os.chdir(DOCS)
