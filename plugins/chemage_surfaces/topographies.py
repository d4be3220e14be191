"""Files of instruments, read with SurfaceTopography (MIT licence), which is imported when a file is read."""

from __future__ import annotations

import warnings
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from chemage import ChemageError, InputError, errors
from chemage.plugin import HeightMap, Length, PluginError, StoreError, regular_file
from chemage_surfaces._maps import HeightUnit, opposite
from chemage_surfaces.readers import Instrument

#: formats without a mark, which the library finds in any file of a certain size
UNMARKED = ("hgt", "nms")
#: texts, which the library finds in any table of numbers
TEXTS = ("asc", "xyz")
#: endings of files of the library, less those of line scans and of the readers of chemage, but for the binary .dat
_ENDINGS = (
    "sdf ibw spm 001 002 003 004 005 al3d apx bcr bcrf cur dat datx ezd frt hfm hgt jpk lext mat mdt mi mnt nid "
    "nms npz oir opd opdx os3d plu plux poir stp sur tif tiff tmd tom top vk3 vk4 vk6 vk7 zmg zon"
)
INSTALL = "pip install 'chemage[topographies]'"
_ROETTGER = """@article{roettger2022,
  author = {R{\\"o}ttger, M. C. and others},
  title = {Contact.engineering---{Create}, analyze and publish digital surface twins from topography measurements across many scales},
  journal = {Surface Topography: Metrology and Properties},
  volume = {10},
  pages = {035032},
  year = {2022},
  doi = {10.1088/2051-672X/ac860a},
}"""  # noqa: E501


class Topography(Instrument):
    """An image of an atomic force microscope, a white-light interferometer, a confocal microscope or another
    instrument, in one of the formats of SurfaceTopography, such as SDF, IBW, SPM, OPD, SUR and VK4.

    The format is found from the content of the file. The library is optional: ``pip install 'chemage[topographies]'``.
    The first index of the heights is along x. Files that a reader of chemage recognises are left to it.
    """

    kind = "topography"
    general = True
    channel_option = "channel"
    cite = ("M. C. Röttger et al., Surf. Topogr.: Metrol. Prop. 10, 035032 (2022)",)
    bibtex = (_ROETTGER,)
    suffixes = tuple(f".{name}" for name in _ENDINGS.split())

    channel: str | None = None
    """name of the channel of heights; None: the default channel of the format"""
    unit: HeightUnit | None = None
    """unit of all lengths in the file, such as "um", or a factor that converts them to nm; overrides the unit in the
    file"""
    pixel_size: Length | None = None
    """edge of a pixel, nm; overrides the value in the file"""

    @classmethod
    def claims(cls, head: bytes, path: str | PathLike[str]) -> bool | None:
        """Whether the library recognises the content; None: it is not installed."""
        try:
            library = _library(str(path))
            with warnings.catch_warnings(action="ignore"):
                return library.detect_format(str(path)) not in (*UNMARKED, *TEXTS)
        except PluginError:
            return None
        except Exception:  # each format has errors of its own
            return False

    def channels(self, path: str | PathLike[str]) -> list[str]:
        """Names of the images of heights in a file that :meth:`height_map` reads."""
        with (
            warnings.catch_warnings(action="ignore"),
            _library(str(path)).open_topography(str(path)) as file,
        ):
            return [
                str(channel.channel_id)
                for channel in file.channels
                if channel.is_height_channel and channel.dim == 2
            ]

    def retrace(self, path: str | PathLike[str]) -> Topography | None:
        """The reader of the same channel in the other direction of the scan lines; None where the file has none."""
        library = _library(str(path))
        regular_file(path)
        try:
            with (
                warnings.catch_warnings(action="ignore"),
                library.open_topography(str(path)) as file,
            ):
                own = self._channel(file, str(path))
                for other in file.channels:
                    if not (other.is_height_channel and other.dim == 2):
                        continue
                    # trace and retrace of one quantity, by their names or by what the format says
                    info = [
                        one.info.get("raw_metadata", {}) for one in (own, other)
                    ]
                    ways = sorted(
                        str(each.get("line direction", "")).lower() for each in info
                    )
                    scans = str(own.name) == str(other.name) and ways == [
                        "retrace",
                        "trace",
                    ]
                    if scans or opposite(
                        str(own.channel_id), str(other.channel_id)
                    ):
                        return self.replace(channel=str(other.channel_id))
        except ChemageError:
            raise
        except (
            Exception
        ):  # each format has errors of its own; reading the image tells which
            return None
        return None

    def height_map(self, path: str | PathLike[str]) -> HeightMap:
        """Read the image as it is. Errors as of :meth:`read`, but for what is missing or not square."""
        name = str(path)
        regular_file(path)
        library = _library(name)
        try:
            # what the formats of others make numpy or scipy warn of is no matter of the user
            with (
                warnings.catch_warnings(action="ignore"),
                library.open_topography(name) as file,
            ):
                channel = self._channel(file, name)
                sizes = channel.physical_sizes
                grid = (
                    {}
                    if sizes is not None
                    else {
                        "physical_sizes": tuple(
                            float(n) for n in channel.nb_grid_pts
                        )
                    }
                )
                topography = channel.topography(**grid)
                heights = np.ma.filled(
                    np.ma.asarray(topography.heights(), dtype=np.float64), np.nan
                )
                kind, label = str(file.format()), str(channel.channel_id)
            if (
                kind in UNMARKED and Path(name).suffix.lower() != f".{kind}"
            ) or not heights.size:
                raise ValueError("nothing in it says so")
        except ChemageError:
            raise
        except Exception as error:  # each format has errors of its own
            reason = (
                ""
                if "Detect" in type(error).__name__
                else f" ({errors.shortened(' '.join(str(error).split()), 200)})"
            )
            raise StoreError(
                f"{name} is in no format that SurfaceTopography reads, or is damaged{reason}"
            ) from None
        unit = self._unit(topography.unit, name)
        sides = None
        if self.pixel_size is not None:
            sides = (self.pixel_size, self.pixel_size)
        elif unit is not None and sizes is not None:
            dx, dy = (
                float(size) * unit / count
                for size, count in zip(sizes, heights.shape, strict=True)
            )
            sides = (dx, dy)
        heights = np.ascontiguousarray(heights)
        heights.setflags(write=False)
        notes = {"format": kind, "channel": label}
        return HeightMap(
            heights,
            unit,
            sides,
            bool(topography.is_periodic),
            source=name,
            notes=notes,
        )

    def _unit(self, stated: str | None, name: str) -> float | None:
        """nm per unit of lengths in the file; None where neither file nor user states it."""
        from SurfaceTopography.Support.UnitConversion import (
            get_unit_conversion_factor,
            mangle_length_unit_utf8,
        )

        if self.unit is not None or stated is None:
            return self.unit
        try:
            return float(
                get_unit_conversion_factor(mangle_length_unit_utf8(stated), "nm")
            )
        except ValueError:
            raise InputError(
                f"{name} states lengths in {errors.shortened(str(stated), 40)!r}, which is no unit of length; give the "
                'unit of the reader, such as reader = { kind = "topography", unit = "um" }'
            ) from None

    def _channel(self, file: Any, name: str) -> Any:
        """The channel to read, which holds heights on a grid."""
        channels = {str(channel.channel_id): channel for channel in file.channels}
        maps = {
            name: channel
            for name, channel in channels.items()
            if channel.is_height_channel and channel.dim == 2
        }
        others = [name for name in channels if name not in maps]
        listed = f"channels of heights: {', '.join(maps) or 'none'}; others: {', '.join(others) or 'none'}"
        if self.channel is None:
            default = file.default_channel
            if str(default.channel_id) in maps:
                return default
            if not maps:
                raise InputError(
                    f"{name} holds no image of heights, but a line scan or other data ({listed})"
                )
            raise InputError(
                f"channel: {name} does not say which channel holds the heights; give one ({listed})"
            )
        if self.channel not in maps:
            raise InputError(
                f"channel = {self.channel!r}: {name} has no such image of heights ({listed})"
            )
        return maps[self.channel]


def _library(name: str) -> Any:
    try:
        with warnings.catch_warnings(action="ignore"):  # that there is no MPI
            from SurfaceTopography import IO
    except ImportError as error:
        why = (
            "is not installed"
            if error.name == "SurfaceTopography"
            else f"cannot be imported ({error})"
        )
        raise PluginError(
            f"{name}: the reader 'topography' needs the library SurfaceTopography, which {why}; {INSTALL}"
        ) from None
    return IO
