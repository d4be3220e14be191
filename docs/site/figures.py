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
CHEMAGE = [sys.executable, "-m", "chemage.cli"]


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
        scripts()
        os.chdir(DOCS)
