"""Files of instruments' formats, written byte by byte as their descriptions say."""

from __future__ import annotations

import hashlib
import io
import struct
import zipfile

import numpy as np


def gwy(heights, *, mask=None, unit="m", title="Height", side=2e-9, second=None, second_title=""):
    """Gwyddion's own format: little-endian components of a name, a letter and a value; rows from the top."""

    def part(name, code, value):
        return name.encode() + b"\0" + code.encode() + value

    def container(name, parts):
        content = b"".join(parts)
        return name.encode() + b"\0" + struct.pack("<I", len(content)) + content

    def length(name, text):
        return part(name, "o", container("GwySIUnit", [part("unitstr", "s", text.encode() + b"\0")]))

    def field(values, of_values):
        nx, ny = values.shape
        data = np.ascontiguousarray(values.T, "<f8")
        parts = [part("xres", "i", struct.pack("<i", nx)), part("yres", "i", struct.pack("<i", ny))]
        parts += [part("xreal", "d", struct.pack("<d", nx * side)), part("yreal", "d", struct.pack("<d", ny * side))]
        parts += [length("si_unit_xy", "m"), length("si_unit_z", of_values)]
        parts.append(part("data", "D", struct.pack("<I", data.size) + data.tobytes()))
        return container("GwyDataField", parts)

    parts = [
        part("/0/data", "o", field(1e-9 * np.ones_like(heights), "V")),
        part("/0/data/title", "s", b"Amplitude\0"),
        part("/1/data/title", "s", title.encode() + b"\0"),
        part("/1/base/palette", "s", b"Gray\0"),
        part("/1/data", "o", field(heights, unit)),
        part("/1/data/visible", "b", b"\1"),
        part("/filename", "s", "größe\0".encode()),
        part("strings", "S", struct.pack("<I", 2) + b"a\0b\0"),
    ]
    if second is not None:
        parts += [part("/2/data/title", "s", second_title.encode() + b"\0"), part("/2/data", "o", field(second, unit))]
    if mask is not None:
        parts.append(part("/1/mask", "o", field(mask.astype(float), "")))
    return b"GWYP" + container("GwyContainer", parts)


def x3p(heights, *, sides=(2e-9, 2e-9), valid=None, kind="D", scale=1.0, feature="SUR", inline=False):
    """ISO 25178-72: an archive with an XML record and the heights line after line, all in metres."""
    nx, ny = heights.shape
    dtype = {"D": "<f8", "F": "<f4", "L": "<i4", "I": "<i2"}[kind]
    data = np.ascontiguousarray(np.rint(heights.T) if kind in "LI" else heights.T, dtype).tobytes()
    link = "<DataLink><PointDataLink>bindata/data.bin</PointDataLink><MD5ChecksumPointData>"
    link += (
        hashlib.md5(data).hexdigest()
        + "</MD5ChecksumPointData>"
        + ("<ValidPointsLink>bindata/valid.bin</ValidPointsLink>" if valid is not None else "")
    )
    link += "</DataLink>"
    if inline:
        link = (
            "<DataList>" + "".join(f"<Datum>{value!r}</Datum>" for value in heights.T.ravel().tolist()) + "</DataList>"
        )
    record = f"""<?xml version="1.0" encoding="UTF-8"?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2"><Record1><Revision>ISO5436 - 2000</Revision>
<FeatureType>{feature}</FeatureType><Axes>
<CX><AxisType>I</AxisType><DataType>L</DataType><Increment>{sides[0]}</Increment></CX>
<CY><AxisType>I</AxisType><DataType>L</DataType><Increment>{sides[1]}</Increment></CY>
<CZ><AxisType>A</AxisType><DataType>{kind}</DataType><Increment>{scale}</Increment></CZ></Axes></Record1>
<Record3><MatrixDimension><SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension>{link}</Record3>
</p:ISO5436_2>"""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("main.xml", record)
        if not inline:
            archive.writestr("bindata/data.bin", data)
        if valid is not None:
            archive.writestr("bindata/valid.bin", np.packbits(valid.T.ravel(), bitorder="little").tobytes())
    return file.getvalue()


def netcdf(heights, *, unit="m", side=2e-9, **attributes):
    """NetCDF-3 with coordinates, as the CF conventions want it."""
    from scipy.io import netcdf_file

    file = io.BytesIO()
    made = netcdf_file(file, "w")
    for name, count in zip("xy", heights.shape, strict=True):
        made.createDimension(name, count)
        places = made.createVariable(name, "d", (name,))
        places[:] = 5.0 + side * np.arange(count) if side > 1e-3 else side * np.arange(count)
        places.units = "m"
    values = made.createVariable("height", "d", ("x", "y"))
    values[:] = heights
    values.units = unit
    for name, value in attributes.items():
        setattr(values, name, value)
    made.flush()
    return file.getvalue()


def sdf(heights, sides):
    """ISO 25178-71, ASCII: lines of constant y, lengths in m."""
    nx, ny = heights.shape
    header = ["aISO-1.0", "ManufacID = x", "CreateDate = 010120200000", "ModDate = 010120200000"]
    header += [f"NumPoints = {nx}", f"NumProfiles = {ny}", f"Xscale = {sides[0]}", f"Yscale = {sides[1]}", "Zscale = 1"]
    header += ["Zresolution = -1", "Compression = 0", "DataType = 7", "CheckType = 0", "*"]
    rows = [" ".join(f"{value:.17g}" for value in heights[:, j]) for j in range(ny)]
    return "\n".join([*header, *rows, "*", ""]).encode()
