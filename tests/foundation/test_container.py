"""Containers, beside what test_results.py and test_damage.py show of them: old layouts, text, files of others."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest

import chemage as ca
from chemage.plugin import DamagedError, StoreError, container

TABLE = container.Arrays(
    values={"energy": np.array([0.5, np.nan]), "flags": np.array([True, False]), "zeros": np.zeros(9)}
)


@pytest.mark.parametrize("compact", [False, True])
def test_arrays_without_a_class_of_their_own(tmp_path, compact):
    container.write(tmp_path / "x", {"table": TABLE}, {"version": 3}, compact=compact)
    parts, about = container.read(tmp_path / "x", {"table": container.Arrays, "not there": ca.Ageing})
    assert parts == {"table": TABLE}
    assert about["version"] == 3
    with pytest.raises(StoreError, match="already there"):
        container.write(tmp_path / "x", {"table": TABLE})


def test_a_contact_in_a_folder_of_0_2_is_read(tmp_path, examples):
    """chemage 0.2.0 kept one record in an archive, without a name."""
    contact = examples.contact(load=2.0)
    values = {name: value for name, value in contact.todict().items() if not isinstance(value, np.ndarray | None)}
    values |= {name: {"$float": "nan"} for name, value in values.items() if value != value}
    where = np.flatnonzero(contact.pressure)
    arrays = {"pressure:where": where.astype(np.int32), "pressure:values": contact.pressure.ravel()[where]}
    text = json.dumps({"values": values, "sparse": {"pressure": contact.pressure.shape}}, default=str)
    image = io.BytesIO()
    np.savez(image, record=np.frombuffer(text.encode(), np.uint8), **arrays)
    (tmp_path / "x.npz").write_bytes(container.seal(image))
    assert container.read(tmp_path / "x.npz", {"contact": ca.ContactSolution})[0] == {"contact": contact}


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        (b"text", StoreError, "cannot be read"),
        (b"", DamagedError, "damaged"),
        (b"\x89HDF\r\n\x1a\n and no more", DamagedError, "damaged"),
        (b"PK\x03\x04 and no more", DamagedError, "its checksum is missing"),
    ],
)
def test_what_is_no_container_is_an_error(tmp_path, content, error, words):
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(StoreError, match=words) as caught:
        container.read(tmp_path / "x", {"table": container.Arrays})
    assert caught.type is error
    with pytest.raises(StoreError, match="does not exist"):
        container.read(tmp_path / "nothing", {"table": container.Arrays})


@pytest.mark.parametrize("layout", [{}, {"indent": 1}])
def test_a_text_with_a_checksum_comes_back_or_is_damaged(tmp_path, layout):
    path = tmp_path / "x.json"
    content = {"format": 2, "values": [1 / 3, "µ", None]}
    text = container.sealed_json(content, **layout)
    path.write_bytes(text)
    assert json.loads(text)["format"] == 2
    assert container.read_json(path) == content
    for place in range(len(text)):
        path.write_bytes(text[:place] + bytes([text[place] ^ 1]) + text[place + 1 :])
        with pytest.raises(DamagedError, match=r"x\.json is "):
            container.read_json(path)
    path.write_text('{"format": 2}')
    with pytest.raises(StoreError, match="is no file of chemage"):
        container.read_json(path)
