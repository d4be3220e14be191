"""Heights as a table of x, y, z."""

from pathlib import Path

import numpy as np
from chemage.errors import StoreError
from chemage.objects import Surface
from chemage.spec import Reader


class GraniteReader(Reader):
    """Three columns x, y, z in nm on a regular grid, y fastest."""

    kind = "granite-reader"
    suffixes = (".xyz",)

    def read(self, path):
        try:
            x, y, z = np.loadtxt(Path(path), unpack=True, ndmin=2)
        except (OSError, ValueError) as error:
            raise StoreError(f"{path} is not a table of x, y, z: {error}") from error
        ny = np.unique(y).size
        if z.size % ny or np.any(np.diff(x[:ny])):
            raise StoreError(f"{path}: the points do not fill a grid with y fastest")
        step = float(y[1] - y[0]) if ny > 1 else 1.0
        return Surface(heights=z.reshape(-1, ny), pixel_size=step, periodic=False, provenance={"file": str(path)})
