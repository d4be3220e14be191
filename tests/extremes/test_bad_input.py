"""Whatever is wrong with what a user gives, one message names the place and the value, and nothing is written."""

from __future__ import annotations

import json
import os
import re

import h5py
import numpy as np
import pytest

import chemage
from chemage import InputError
from chemage.plugin import StoreError


def refuse(command, small, *words, verbs=("check", "run")):
    """The message of ``chemage check``, then of ``chemage run``; neither may write, print or trace."""
    before = sorted(small.parent.rglob("*"))
    messages = []
    for name in verbs:
        done = command(name, *words)
        assert (done.status, done.out) == (2, ""), (name, done)
        assert "Traceback" not in done.err
        messages.append(done.err)
    assert sorted(small.parent.rglob("*")) == before
    return messages


@pytest.mark.parametrize(
    ("change", "path", "said"),
    [
        # kinds
        ("surface.kind='self-afine'", "surface.kind", "did you mean 'self-affine'?"),
        ("surface.kind='nothing'", "surface.kind", "installed: atoms, cone, from-file, measured, roughened"),
        ("engine.kind='rejectionfree'", "engine.kind", "did you mean 'rejection-free'?"),
        ("engine.kind=3", "engine.kind", "is required; installed: "),
        ("surface.kind=['sphere']", "surface.kind", "is required"),
        ("forming.kind='fft-bem'", "forming.kind", "no barriers 'fft-bem'"),
        # names
        ("surfce.kind='sphere'", "surfce", "did you mean 'surface'?"),
        ("surface.pixel=64", "surface.pixel", "did you mean 'pixels'?"),
        ("surface.self=1", "surface.self", "no such option"),
        ("chemistry.activation_volum=0", "chemistry.activation_volum", "did you mean 'activation_volume'?"),
        ("hold.replica=2", "hold.replica", "did you mean 'replicas'?"),
        ("chemistry.forming=1", "chemistry.forming", "write [forming]"),
        # shapes
        ("contact=5", "contact", "is not a section"),
        ("observe=5", "observe", "[[observe]]"),
        ("observe=[5]", "observe.0", "5 is not a section"),
        ("observe=[{}]", "observe.0.kind", "is required"),
        ("observe=[{kind='barrier-spectrum', bins=0}]", "observe.0.bins", "greater than or equal to 1"),
        ("name='a/b'", "name", "leave out slashes"),
        ("name='../a'", "name", "leave out slashes"),
        ('name="a\\u0000b"', "name", "leave out"),
        ("name=''", "name", "at least 1 character"),
        ("name=5", "name", "valid string"),
        # dimensions
        ("contact.load='20 eV'", "contact.load", '"20 eV" is a quantity of electron_volt'),
        ("contact.load='20'", "contact.load", "has no unit"),
        ("contact.load='20 uM'", "contact.load", "uM"),
        ("contact.load='twenty'", "contact.load", "twenty"),
        ("contact.load=true", "contact.load", "not a quantity"),
        ("contact.load=[1]", "contact.load", "not a quantity"),
        ("hold.temperature=[300, 350]", "hold.temperature", "several are compared by a sweep"),
        ("surface.pixel_size='1 nN'", "surface.pixel_size", "nN"),
        ("hold.temperature='3 eV'", "hold.temperature", "3 eV"),
        ("chemistry.activation_volume='6.4 angstrom'", "chemistry.activation_volume", "angstrom"),
        ("hold.stop='1 m'", "hold.stop", "1 m"),
        # numbers
        *[
            (f"contact.load={value}", "contact.load", "finite and not negative")
            for value in ("-1", "nan", "inf", "-inf")
        ],
        *[(f"surface.rms_slope={value}", "surface.rms_slope", value) for value in ("-0.1", "nan", "inf")],
        *[(f"contact.modulus={value}", "contact.modulus", value) for value in ("0", "-3", "nan", "inf")],
        *[(f"hold.temperature={value}", "hold.temperature", value) for value in ("0", "-3", "nan", "inf")],
        *[(f"interaction.strength={value}", "interaction.strength", value) for value in ("nan", "inf")],
        *[(f"breaking.std={value}", "breaking.std", value) for value in ("-0.1", "nan")],
        *[(f"surface.pixels={value}", "surface.pixels", value) for value in ("0", "-4", "2.5", "nan")],
        ("surface.pixels=100_000_000", "surface.pixels", "of memory of this machine hold the heights of at most"),
        ("surface.pixels=[3, 4, 5]", "surface.pixels", "3 numbers"),
        ("surface.hurst=1.5", "surface.hurst", "1.5"),
        ("surface.zeta=25", "surface", "zeta = 25: above the Nyquist limit 24 of 48 pixels"),
        ("surface.eta=9", "surface", "eta = 9: above zeta = 8"),
        ("surface.rms_height=1", "surface", "both given"),
        ("surface.seed=-1", "surface.seed", "-1"),
        ("surface.seed=0.5", "surface.seed", "0.5"),
        ("hold.seed=-1", "hold.seed", "-1"),
        ("hold.replicas=0", "hold.replicas", "greater than or equal to 1"),
        ("hold.replicas='many'", "hold.replicas", "'many'"),
        ("hold.start=0", "hold", "start = 0"),
        ("hold.stop='1 us'", "hold", "not before start"),
        ("hold.times=[1, 2]", "hold", "either times, or start and stop"),
        ("fit.start='1e6 s'", "fit", "after start"),
        ("chemistry.hydroxylation=1.1", "chemistry.hydroxylation", "1.1"),
        ("chemistry.front_factor=0", "chemistry.front_factor", "greater than 0"),
        ("chemistry.attempt_frequency=-1", "chemistry.attempt_frequency", "-1"),
    ],
)
def test_a_wrong_field_is_named(command, small, change, path, said):
    (message,) = refuse(command, small, small, "--set", change, verbs=("check",))
    assert message.startswith(f"chemage: {small} is not a valid scene:\n")
    lines = message.splitlines()[1:]
    assert any(line.startswith(f"  {path}: ") and said in line for line in lines), message


def test_everything_wrong_is_told_at_once(command, small):
    small.write_text(
        small.read_text()
        .replace('load = "40 nN"', "load = -1")
        .replace("pixels = 48", "pixels = 0")
        .replace('kind = "md-silica"', 'kind = "md-silika"')
    )
    message, _ = refuse(command, small, small)
    assert [line.split(":")[0].strip() for line in message.splitlines()[1:]] == [
        "surface.pixels",
        "contact.load",
        "forming.kind",
    ]


@pytest.mark.parametrize(
    ("left_out", "path"), [("surface", "surface"), ("contact", "contact"), ("engine", "engine"), ("hold", "hold")]
)
def test_a_missing_section_is_named(command, small, left_out, path):
    text = re.sub(rf"\n\[{left_out}\]\n.*?(?=\n\[)", "", small.read_text(), flags=re.DOTALL)
    small.write_text(text)
    message, _ = refuse(command, small, small)
    assert f"\n  {path}: is required" in message


def test_sections_that_need_barriers_say_so(command, small):
    text = small.read_text()
    small.write_text(text.replace('[forming]\nkind = "md-silica"\n', ""))
    message, _ = refuse(command, small, small)
    for name in ("breaking", "interaction", "chemistry", "hold", "engine"):
        assert f"\n  {name}: needs [forming]" in message


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"surface = {kind", "not valid TOML"),
        (b"\x89HDF\r\n\x1a\n\xff\xff", "cannot be read as a scene"),
        (b"x = " + b"[" * 5000, "not valid TOML"),
        (b"", "surface: is required"),
    ],
)
def test_a_file_that_is_no_scene(command, small, content, said):
    small.write_bytes(content)
    for message in refuse(command, small, small):
        assert said in message
        assert "small.toml" in message


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("silica-rouhg", "did you mean 'silica-rough'?"),
        ("nowhere.toml", "neither a file nor an installed scene"),
        (".", "cannot be read as a scene"),
    ],
)
def test_a_scene_that_is_not_there(command, small, name, said):
    for message in refuse(command, small, name):
        assert said in message


@pytest.mark.parametrize("word", ["surface.rms_slope", "=3", " =3"])
def test_a_change_is_written_path_equals_value(command, small, word):
    for message in refuse(command, small, small, "--set", word):
        assert "PATH=VALUE" in message


def test_a_windows_byte_order_mark_is_no_error(command, small):
    small.write_bytes(b"\xef\xbb\xbf" + small.read_bytes())
    assert command("check", small).status == 0


@pytest.mark.parametrize("word", ["--replicas", "--seed", "--workers"])
@pytest.mark.parametrize("value", ["x", "1.5", "-1"])
def test_options_take_whole_numbers(command, small, word, value):
    done = command("run", small, word, value)
    assert (done.status, done.out) == (2, "")
    assert word in done.err or f"hold.{word[2:]}: {value}" in done.err
    assert sorted(p.name for p in small.parent.iterdir()) == ["small.toml"]


# -- heights from a file ----------------------------------------------------------------------------------------------


def from_file(small, name, content):
    """A contact of the heights in file ``name``."""
    file = small.parent / name
    if isinstance(content, np.ndarray):
        np.save(file, content)
    elif content is not None:
        file.write_bytes(content)
    small.write_text(
        f'[surface]\nkind = "from-file"\npath = "{name}"\npixel_size = "1 nm"\n'
        '[contact]\nkind = "fft-bem"\nmodulus = "35 GPa"\nload = "20 nN"\n'
    )


def _npy(tmp_path, array):
    np.save(tmp_path / "whole.npy", array)
    return (tmp_path / "whole.npy").read_bytes()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_heights_that_are_not_finite(command, small, value):
    heights = np.zeros((8, 8))
    heights[3, 5] = value
    from_file(small, "h.npy", heights)
    for message in refuse(command, small, small):
        assert "h.npy: 1 of 64 heights are missing or infinite, the first at pixel (3, 5)" in message
        assert "[surface]" in message


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("missing.npy", None),
        ("empty.npy", b""),
        ("foreign.npy", b"GIF89a" * 100),
        ("foreign.h5", b"GIF89a" * 100),
        ("words.txt", b"once upon a time\n"),
        ("line.npy", np.zeros(7)),
        ("objects.npy", np.array([["a", "b"]])),
        ("heights.xyz", b"1 2 3"),
    ],
)
def test_heights_that_cannot_be_read(command, small, name, content):
    from_file(small, name, content)
    for message in refuse(command, small, small):
        assert name in message
        assert len(message.splitlines()) <= 2


def test_heights_cut_short(command, small, tmp_path):
    from_file(small, "cut.npy", _npy(tmp_path, np.zeros((20, 20)))[:1000])
    for message in refuse(command, small, small):
        assert "cut.npy" in message


def test_the_path_is_taken_from_the_folder_of_the_scene(command, small, monkeypatch):
    from_file(small, "h.npy", np.random.default_rng(1).normal(size=(16, 16)))
    elsewhere = small.parent / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert command("run", small, "--no-figures").status == 0
    assert chemage.read("small.h5").surface.shape == (16, 16)


# -- results ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def result(command, small):
    assert command("run", small, "--no-figures").status == 0
    return small.parent / "small.h5"


def _broken(folder, result, kind):
    file = folder / f"{kind}.h5"
    whole = result.read_bytes()
    if kind == "folder":
        file.mkdir()
    elif kind == "truncated":
        file.write_bytes(whole[: len(whole) // 2])
    elif kind == "header":
        file.write_bytes(whole[:100])
    elif kind == "empty":
        file.write_bytes(b"")
    elif kind == "text":
        file.write_text("not HDF5 at all")
    elif kind == "newer":
        file.write_bytes(whole)
        with h5py.File(file, "r+") as opened:
            opened.attrs["chemage_format"] = 99
    elif kind in ("contact", "ageing", "surface"):
        file.write_bytes(whole)
        with h5py.File(file, "r+") as opened:
            del opened[{"contact": "contact", "ageing": "ageing/bonds", "surface": "surface/heights"}[kind]]
    elif kind == "json":
        file.write_bytes(whole)
        with h5py.File(file, "r+") as opened:
            opened.attrs["scene"] = "{"
    elif kind == "wrong":
        file.write_bytes(whole)
        with h5py.File(file, "r+") as opened:
            opened["contact/pressure"][0, 0] = -1.0
    elif kind == "alien":
        with h5py.File(file, "w") as opened:
            opened["words"] = "hello"
    return file


@pytest.mark.parametrize("verb", ["show", "plot"])
def test_a_result_that_cannot_be_read(command, small, result, verb):
    kinds = "missing folder truncated header empty text newer contact ageing surface json wrong alien"
    for kind in kinds.split():
        file = _broken(small.parent, result, kind)
        done = command(verb, file)
        assert (done.status, done.out) == (2, ""), (kind, done)
        assert file.name in done.err, kind
        assert len(done.err.splitlines()) <= 3, (kind, done.err)
        with pytest.raises((StoreError, InputError)):
            chemage.read(file)
    assert not list(small.parent.glob("*-figures"))


def test_no_damaged_byte_ends_in_a_traceback(small, result):
    whole = result.read_bytes()
    rng = np.random.default_rng(0)
    file = small.parent / "damaged.h5"
    messages = []
    # the first kilobytes hold the structure, where damage does most
    for place in [*range(0, 3000, 60), *rng.integers(0, len(whole), 40)]:
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        file.write_bytes(damaged)
        try:
            chemage.read(file)
        except StoreError as error:
            messages.append(str(error))
    assert len(messages) > 5
    assert all("damaged.h5" in message for message in messages)


def test_a_result_nobody_may_read(command, result, monkeypatch):
    real = os.open

    def guarded(file, *args, **options):
        if str(file).endswith("small.h5"):
            raise PermissionError(13, "Permission denied", str(file))
        return real(file, *args, **options)

    monkeypatch.setattr(os, "open", guarded)
    done = command("show", result)
    assert done.status == 2
    assert "small.h5 cannot be read: Permission denied" in done.err


def test_plot_wants_a_run_and_a_known_format(command, small, result):
    done = command("plot", result, "--format", "bmp")
    assert done.status == 2
    assert "png, pdf or svg" in done.err


def test_only_chemage_objects_are_stored(small):
    with pytest.raises(InputError, match="cannot store a dict"):
        chemage.write("x.h5", {"a": 1})
    assert not (small.parent / "x.h5").exists()


@pytest.mark.long
def test_titles_are_text_not_markup(command, small):
    title = "[/bold] $\\frac{ [link=x] :smile: 100 %"
    done = command("run", small, "--set", f"title={json.dumps(title)}")
    assert done.status == 0, done.err
    assert title in done.out
