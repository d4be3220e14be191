"""Small files made to cost much: each is read or refused within 2 s of CPU time and 500 MB.

    python tests/benchmarks/hostile_files.py [COUNT [SEED]]

Tables, workbooks, HDF5 files of others and of chemage, images and scans of instruments, and scenes, below 1 MB. The
recipe of case n is the same for every seed; what is random are its sizes and what it repeats. Each file is read in a
process of its own, whose CPU time and largest memory are taken at its end.
"""

from __future__ import annotations

import io
import os
import resource
import struct
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import chemage as ca
from chemage.foundation import container

#: of a process that reads one file, the libraries of chemage included
SECONDS, BYTES = 2.0, 500e6
#: of a file
LARGEST = 1_000_000
HEAD = "hold_time (s),friction_coefficient_drop\n"
SHEET = b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>%s</sheetData>%s</worksheet>'
STRINGS = b'<sst xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">%s</sst>'
X3P = (
    "<p:ISO5436_2 xmlns:p='x'><Record1><FeatureType>SUR</FeatureType><Axes><CX><AxisType>I</AxisType>"
    "<Increment>1e-9</Increment></CX><CY><AxisType>I</AxisType><Increment>1e-9</Increment></CY>"
    "<CZ><DataType>{kind}</DataType></CZ></Axes></Record1><Record3><MatrixDimension><SizeX>{nx}</SizeX>"
    "<SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension>{data}</Record3>{more}</p:ISO5436_2>"
)
SCENE = '[surface]\nkind = "sphere"\nradius = 30\npixels = 16\npixel_size = 1\n[contact]\nkind = "fft-bem"\nload = 1\n'


def repeated(text: str, before: str = "", after: str = "") -> bytes:
    """A text as often as the largest file holds it."""
    return (before + text * ((LARGEST - len(before) - len(after)) // len(text.encode())) + after).encode()


def tables(rng: np.random.Generator) -> list[bytes]:
    """Tables with names: what takes long in headers, rows, cells, units and comments."""
    n = int(rng.integers(1000, 60_000))
    mark = str(rng.choice([",", ";", "\t", " ", "/", "(", "[", '"', "-", "_", "#", ".", "\u00a0", "e", "1,"]))
    one = str(rng.choice(["a", "1", "t", "hold_time", "µ", "-", "1e", "''", "°"]))
    units = "".join(f"1 s*{number}/{number},1\n" for number in range(1, 40_000))
    return [
        f"hold_time{' ' * n}x (s,b\n1,2\n".encode(), f"hold_time{mark * n}x (s{mark}{one}\n1,2\n".encode(),
        repeated("1,1\n", HEAD), repeated(one + mark), repeated(f"{one}{mark}{one}\n"),
        repeated(f"{one}{mark}\n", HEAD), repeated(f"{one}{mark}" * 300 + "\n"),
        repeated(f"#{one}{mark}\n", "", HEAD), repeated(f"{one} (", "hold_time "),
        (HEAD + one * n + f",{mark * n}\n").encode(), ("hold_time,friction_coefficient_drop\n" + units).encode(),
        f"{one * n}{mark * n}{one}".encode(), repeated('"a\n'), repeated(f"1 {one}{mark * 50},1\n", HEAD),
        rng.bytes(n), (HEAD + f"1{mark}1\n" * 5).encode("utf-16") * 50, b"\xff\xfe" + rng.bytes(n),
        repeated(f"{'1' * 120_000},1\n", HEAD), repeated("".join(f"c{i}," for i in range(900)) + "\n"),
    ]  # fmt: skip


def workbook(parts: dict[str, bytes]) -> bytes:
    """A workbook of openpyxl with some parts exchanged or added."""
    import openpyxl

    book, plain, image = openpyxl.Workbook(), io.BytesIO(), io.BytesIO()
    sheet: Any = book.active
    sheet.append(["hold_time (s)", "friction_coefficient_drop"])
    sheet.append([1, 0.1])
    book.save(plain)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(image, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            if name not in parts:
                new.writestr(name, old.read(name))
        for name, data in parts.items():
            new.writestr(name, data)
    return image.getvalue()


def workbooks(rng: np.random.Generator) -> list[bytes]:
    """Excel files: cells far out, shared strings, styles, parts and XML that unpack to much more."""
    n = int(rng.integers(1000, 150_000))
    first, styles, strings = "xl/worksheets/sheet1.xml", "xl/styles.xml", "xl/sharedStrings.xml"
    row = int(rng.integers(1, 2_000_000))
    far = b'<row r="%d"><c r="XFD%d"><v>1</v></c></row>'
    rows = b"".join(far % (at, at) for at in range(2, 2 + n // 30))
    style = b'<styleSheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><cellXfs>%s</cellXfs></styleSheet>'
    bomb = b'<!DOCTYPE a [<!ENTITY a "' + b"a" * 50_000 + b'">]>' + SHEET % (b"<row><c><v>&a;</v></c></row>" * 999, b"")
    cells, link = b"<row>" + b"<c><v>1</v></c>" * n + b"</row>", b'<hyperlink ref="A1"/>' * n
    return [
        workbook({first: SHEET % (far % (row, row), b"")}), workbook({first: SHEET % (rows, b"")}),
        workbook({first: SHEET % (cells, b"")}), workbook({first: SHEET % (b"<c/>" * n, b"")}),
        workbook({first: SHEET % (b"<row>" + b"<c/>" * 2 * n + b"</row>", b"")}),
        workbook({first: SHEET % (b"<row/>" * 2 * n, b"")}), workbook({first: SHEET % (b'<row r="999999999"/>', b"")}),
        workbook({first: SHEET % (b"<row>" + b'<c t="inlineStr"><is><t>a</t></is></c>' * n + b"</row>", b"")}),
        workbook({first: SHEET % (b"", b"<hyperlinks>" + link + b"</hyperlinks>")}),
        workbook({strings: STRINGS % (b"<si><t>a</t></si>" * n)}), workbook({strings: STRINGS % (b"a" * 400 * n)}),
        workbook({strings: STRINGS % (b"<si><r><t>a</t></r></si>" * n)}), workbook({styles: style % (b"<xf/>" * n)}),
        workbook({f"xl/media/{at}.xml": b"" for at in range(n // 20)}), workbook({first: bomb}),
        workbook({first: (SHEET % (cells, b"")).decode().encode("utf-16")}),
        workbook({first: b"<a>" * n + b"</a>" * n}), workbook({"xl/media/a.bin": bytes(500 * n)}),
        workbook({first: SHEET % (b"<row" + b"".join(b' a%d="1"' % at for at in range(n)) + b"/>", b"")}),
    ]  # fmt: skip


def hdf5(fill: Callable[[Any], object]) -> bytes:
    """An HDF5 file that ``fill`` makes, as compact as it can be."""
    image = io.BytesIO()
    with h5py.File(image, "w", libver="latest") as file:
        fill(file)
    return image.getvalue()


def nested(file: Any, depth: int, name: str) -> None:
    """Groups in groups, and a map in the last."""
    group = file
    for _ in range(depth):
        group = group.create_group(name)
    group["heights"] = np.ones((4, 4))


def members(file: Any, count: int, make: Callable[[Any, str], object]) -> None:
    """Many members of the root beside a map."""
    file["heights"] = np.ones((4, 4))
    for number in range(count):
        make(file, f"m{number}")


def two_ways(file: Any, depth: int) -> None:
    """Groups that hold the next one under two names: 2^depth paths."""
    group = file
    for _ in range(depth):
        inner = group.create_group("a")
        group["b"], group = inner, inner
    group["heights"] = np.ones((4, 4))


def others(rng: np.random.Generator) -> list[bytes]:
    """HDF5 files of other programs."""
    n = int(rng.integers(1000, 8000))
    side = int(rng.integers(3000, 40_000))
    zeros = np.zeros((n // 2, n // 2))
    return [
        hdf5(lambda file: nested(file, n // 3, "g")), hdf5(lambda file: nested(file, n // 20, "g" * 100)),
        hdf5(lambda file: two_ways(file, int(rng.integers(10, 31)))),
        hdf5(lambda file: members(file, 2 * n, lambda at, name: at.__setitem__(name, at["heights"]))),
        hdf5(lambda file: members(file, 2 * n, lambda at, name: at.__setitem__(name, h5py.SoftLink("/heights")))),
        hdf5(lambda file: members(file, n // 2, lambda at, name: at.create_group(name))),
        hdf5(lambda file: members(file, n // 4, lambda at, name: at.create_dataset(name, (4, 4), "f8"))),
        hdf5(lambda file: members(file, n, lambda at, name: at.attrs.__setitem__(name, 1))),
        hdf5(lambda file: file.create_dataset("heights", (side, side), "f8")),
        hdf5(lambda file: file.create_dataset("heights", (side, side), "i1")),
        hdf5(lambda file: file.create_dataset("heights", data=zeros, compression="gzip", chunks=(500, 500))),
        hdf5(lambda file: file.create_dataset("heights", (2800, 2800), "f8", chunks=(1, 1))),
        hdf5(lambda file: file.create_dataset("heights", (2800, 2800), "f8", chunks=(20, 20), fillvalue=1.0)),
        hdf5(lambda file: file.create_dataset("heights", (1, side * 100), "f4", chunks=(1, 100))),
    ]  # fmt: skip


def sealed(fill: Callable[[Any], object]) -> bytes:
    """A result of chemage as a stranger makes it, with a seal that fits."""

    def marked(file: Any) -> None:
        file.attrs.update({"chemage": "0.2.0", "chemage_format": 2})
        fill(file)

    return bytes(container.seal(io.BytesIO(hdf5(marked))))


def own(rng: np.random.Generator) -> list[bytes]:
    """Files that say that chemage wrote them."""
    n, side = int(rng.integers(1000, 8000)), int(rng.integers(100_000, 400_000))
    return [
        sealed(lambda file: nested(file, n // 3, "g")),
        sealed(lambda file: two_ways(file, int(rng.integers(10, 31)))),
        sealed(lambda file: members(file, n, lambda at, name: at.__setitem__(name, at["heights"]))),
        sealed(lambda file: members(file, n // 2, lambda at, name: at.create_group(name))),
        sealed(lambda file: members(file, n // 4, lambda at, name: at.create_dataset(name, (4, 4), "f8"))),
        sealed(lambda file: file.create_dataset("surface/heights", (side, side), "f8")),
        sealed(lambda file: file.create_dataset("surface/heights", (2800, 2800), "f8", chunks=(1, 1))),
        b"\n".join([b'{"a": [' * n, b"]}" * n]),
    ]


def gwy(field: bytes) -> bytes:
    """A file of Gwyddion with these components."""
    return b"GWYPGwyContainer\0" + struct.pack("<I", len(field)) + field


def netcdf(count: int, side: int) -> bytes:
    """A NetCDF-3 file whose variables all lie at the same place."""
    dimensions = struct.pack(">II", 10, 1) + struct.pack(">I4sI", 1, b"x\0\0\0", side)
    header = b"CDF\x01" + struct.pack(">I", 0) + dimensions + struct.pack(">II", 0, 0) + struct.pack(">II", 11, count)
    size = len(header) + count * 44
    for number in range(count):
        name = struct.pack(">I8s", 8, b"%08d" % number)
        header += name + struct.pack(">IIIIIIII", 2, 0, 0, 0, 0, 6, 8 * side * side, size)
    return header + bytes(8 * side * side)


def scan(side: tuple[int, int], more: str = "", kind: str = "D", data: int | None = None) -> bytes:
    """An X3P file; ``data``: bytes of its heights, else they are listed in its XML."""
    image = io.BytesIO()
    link = "" if data is None else "<DataLink><PointDataLink>bindata/data.bin</PointDataLink></DataLink>"
    with zipfile.ZipFile(image, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("main.xml", X3P.format(kind=kind, nx=side[0], ny=side[1], data=link, more=more))
        if data is not None:
            file.writestr("bindata/data.bin", bytes(data))
    return image.getvalue()


def npy(shape: str, data: bytes = b"") -> bytes:
    """A file of numpy that announces a shape."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", min(len(head), 65535)) + head + data


def images(rng: np.random.Generator) -> list[tuple[str, bytes]]:
    """Height maps in text and in the formats of numpy and of instruments."""
    n, side = int(rng.integers(1000, 60_000)), int(rng.integers(1000, 9000))
    mark = str(rng.choice([" ", ";", ",", "\t", ":", "=", "%", "-", "1"]))
    return [
        (".txt", f"# width:{' ' * n}x{' ' * n};\n1 2\n3 4\n".encode()), (".txt", repeated(f"width{mark}", "", "\n1 2")),
        (".txt", repeated(f"1{mark}")), (".txt", repeated(f"1{mark}\n")), (".txt", repeated("#\n")),
        (".txt", (f"a{mark}" * n + "=\n1 2\n3 4").encode()), (".csv", repeated("1,2;" * 100 + "\n")),
        (".txt", repeated("1 1\n", "h=3 w=4\n")), (".txt", rng.bytes(n)), (".txt", repeated("0x1 ")),
        (".xyz", repeated("1 1 1\n", "0 0 0\n")), (".xyz", b"0 0 0\n1 0 0\n" + b"0 %d 0\n1 %d 0\n" % (n * n, n * n)),
        (".xyz", "".join(f"{i} {i * i} 0\n" for i in range(n)).encode()[:LARGEST]),
        (".npy", npy(f"({n * n}, {n * n})")), (".npy", npy("(" * n + ")" * n)), (".npy", npy("(0, " * 20 + "1" * n)),
        (".x3p", scan((side, side), kind="I", data=2 * side * side)), (".x3p", scan((2, 2), "<a>" * n + "</a>" * n)),
        (".x3p", scan((2, 2), "<a>" * 900 + "<b/>" * n * 10 + "</a>" * 900)),
        (".x3p", scan((n, 10), "<Datum>1</Datum>" * n * 10)), (".x3p", scan((2, 2), " " * 3000 * n)),
        (".gwy", gwy(b"a\0o" * n)), (".gwy", gwy(b"a\0S" + struct.pack("<I", 2**31) + b"\0" * n)),
        (".gwy", gwy(b"".join(b"%d\0b\1" % at for at in range(n)))), (".gwy", gwy(b"a\0D" + struct.pack("<I", 2**31))),
        (".cdf", netcdf(int(rng.integers(100, 5000)), 200)), (".cdf", b"CDF\x01" + rng.bytes(n)),
        (".cdf", b"CDF\x01" + struct.pack(">IIII", 0, 10, 2**31 - 1, 1) + bytes(n)),
    ]  # fmt: skip


def scenes(rng: np.random.Generator) -> list[bytes]:
    """Scenes: keys, tables, lists and texts without end."""
    n, deep = int(rng.integers(1000, 60_000)), int(rng.integers(20, 900))
    one = str(rng.choice(["a", "surface", "'a b'", '"."', "hold", "sweep"]))
    quantity = str(rng.choice(["1" * n + "!", "1" + " " * n + "!", "1_" * n, "1." * n, "1 " + "m*" * n, "e" * n]))
    return [
        f"{SCENE}{f'{one}.' * n}a = 1".encode(), f"{SCENE}[{f'{one}.' * n}a]".encode(),
        repeated("[[observe]]\n", SCENE),
        "".join(f"[a{i}]\n" for i in range(n)).encode(), "".join(f"a{i} = 1\n" for i in range(n)).encode(),
        (SCENE + "".join(f"a{i} = 1\n" for i in range(n))).encode(), f"{SCENE}a = {'[' * n}".encode(),
        (SCENE + f"a = {{{','.join(f'a{i} = 1' for i in range(n))}}}").encode(), repeated("1,", "a = [", "]"),
        "".join(f"{'a.' * 30}b{i} = 1\n" for i in range(n // 4)).encode()[:LARGEST],
        f'{SCENE}modulus = "{quantity}"\n'.encode(), f'{SCENE}[hold]\ntimes = ["{quantity}"]\n'.encode(),
        repeated('"1 s",', SCENE + "[hold]\ntimes = [", "]"), repeated("\\u0041", 'title = "', '"\n' + SCENE),
        (SCENE + "a = " + "[" * deep + "]" * deep).encode(), (SCENE + "a = " + "{a = " * deep + "}" * deep).encode(),
        (SCENE + "[plugins]\n" + "".join(f"a{i} = 1\n" for i in range(n // 10))).encode(), repeated("'''\n"),
        (SCENE + "[sweep]\n" + "".join(f'"a{i}" = [1]\n' for i in range(n // 10))).encode(), repeated("#\n", SCENE),
    ]  # fmt: skip


def surface(path: str) -> object:
    """The surface in a file."""
    return ca.surface("from-file", path=path, pixel_size=1.0).make()


#: kind -> how its files are made, how their names end, and how they are read
KINDS: dict[str, tuple[Callable[[np.random.Generator], list[Any]], str, tuple[Callable[[str], object], ...]]] = {
    "table": (tables, ".csv", (ca.read_measurements,)),
    "workbook": (workbooks, ".xlsx", (ca.read_measurements,)),
    "HDF5": (others, ".h5", (surface, ca.read)),
    "result": (own, ".h5", (ca.read,)),
    "image": (images, "", (surface,)),
    "scene": (scenes, ".toml", (ca.load_scene,)),
}


def cases(count: int, seed: int) -> Iterator[tuple[str, str, bytes, Callable[[str], object]]]:
    """Kind and number of the recipe, ending and content of a file below 1 MB, and what reads it."""
    made = 0
    for turn in range(count):
        for kind, (make, ending, readers) in KINDS.items():
            for number, file in enumerate(make(np.random.default_rng([seed, turn]))):
                end, content = file if isinstance(file, tuple) else (ending, file)
                if len(content) > LARGEST:
                    continue
                yield f"{kind} {number}", end, content, readers[turn % len(readers)]
                made += 1
                if made == count:
                    return


def cost(read: Callable[[str], object], path: str) -> tuple[float, float, str]:
    """CPU time in s and the largest memory in bytes of a process that reads a file, and how that ended."""
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (30, 30))
        try:
            end = f"read: {str(read(path))[:60]}"
        except (ca.ChemageError, RecursionError) as error:
            end = f"{type(error).__name__}: {' '.join(str(error).split())[-90:]}"
        except BaseException as error:
            end = f"FAULT {type(error).__name__}: {error}"
        os.write(send, end.encode(errors="replace")[:4000])
        os._exit(0)
    os.close(send)
    with os.fdopen(receive, "rb") as stream:
        end = stream.read().decode(errors="replace") or "FAULT: ended by a signal"
    used = os.wait4(child, 0)[2]
    return used.ru_utime + used.ru_stime, 1024.0 * used.ru_maxrss, end


def main() -> None:
    """Print what each file costs, and the worst; exit status 1 if one costs too much or ends in a fault."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    rows = []
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        np.save(f"{folder}/warm.npy", np.ones((4, 4)))
        surface(f"{folder}/warm.npy")  # imports are no cost of a file
        for number, (name, ending, content, read) in enumerate(cases(count, seed)):
            path = Path(folder, f"case-{number}{ending}")
            path.write_bytes(content)
            seconds, memory, end = cost(read, str(path))
            path.unlink()
            bad = seconds > SECONDS or memory > BYTES or end.startswith("FAULT")
            size = f"{len(content):8} bytes {seconds:6.2f} s {memory / 1e6:5.0f} MB"
            print(f"{'!' if bad else ' '} {name:12} {size}  {end}", flush=True)
            rows.append((seconds, memory, name, bad))
    print(f"{len(rows)} files, {sum(row[3] for row in rows)} too costly or faulty; the most costly:")
    for place, unit, scale in ((0, "s", 1.0), (1, "MB", 1e6)):
        worst = max(rows, key=lambda row, place=place: row[place])
        print(f"  {worst[place] / scale:.2f} {unit}: {worst[2]}")
    sys.exit(any(row[3] for row in rows))


if __name__ == "__main__":
    main()
