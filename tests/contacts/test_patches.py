"""Patches, perimeter and area, against brute force on every kind of small grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import chemage as ca
from chemage.plugin import label_patches, patches, roughness

maps = hnp.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7)))
contacts = given(maps, st.booleans())


def around(i, j, shape, periodic, corners):
    """The pixels next to (i, j), each once, never (i, j) itself unless the grid wraps onto it."""
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            if (di, dj) == (0, 0) or (not corners and di and dj):
                continue
            x, y = i + di, j + dj
            if periodic:
                yield x % shape[0], y % shape[1]
            elif 0 <= x < shape[0] and 0 <= y < shape[1]:
                yield x, y


def flooded(contact, periodic, corners=True):
    """The patches as sets of pixels, by flood fill."""
    left = {(int(i), int(j)) for i, j in np.argwhere(contact)}
    found = []
    while left:
        patch, edge = set(), [left.pop()]
        while edge:
            pixel = edge.pop()
            patch.add(pixel)
            for other in around(*pixel, contact.shape, periodic, corners):
                if other in left:
                    left.remove(other)
                    edge.append(other)
        found.append(patch)
    return found


@contacts
def test_patches_are_those_of_a_flood_fill(contact, periodic):
    expected = flooded(contact, periodic)
    found = patches.patches(contact, periodic)
    assert found.count == len(expected)
    assert found.sizes.tolist() == sorted(map(len, expected), reverse=True)
    assert found.sizes.dtype == np.int64


@contacts
def test_labels_tell_the_patches_apart(contact, periodic):
    labels, count = label_patches(contact, periodic)
    assert ((labels > 0) == contact).all()
    assert sorted(np.unique(labels[contact])) == list(range(1, count + 1))
    for patch in flooded(contact, periodic):
        assert len({int(labels[pixel]) for pixel in patch}) == 1


@contacts
def test_without_corners_only_edges_connect(contact, periodic):
    labels, count = label_patches(contact, periodic, corners=False)
    expected = flooded(contact, periodic, corners=False)
    assert count == len(expected)
    assert ((labels > 0) == contact).all()
    assert all(len({int(labels[pixel]) for pixel in patch}) == 1 for patch in expected)


@contacts
def test_perimeter_counts_every_edge_between_contact_and_none(contact, periodic):
    """A free boundary is such an edge; a grid one pixel wide, where periodic, is its own neighbour."""
    edges = 0
    nx, ny = contact.shape
    for i, j in np.argwhere(contact):
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            x, y = int(i) + di, int(j) + dj
            if periodic:
                edges += not contact[x % nx, y % ny]
            else:
                edges += not (0 <= x < nx and 0 <= y < ny and contact[x, y])
    assert patches.perimeter(contact, 0.25, periodic) == edges * 0.25


@given(maps, st.integers(0, 6), st.integers(0, 6))
def test_on_a_periodic_grid_nothing_depends_on_where_the_grid_begins(contact, i, j):
    moved = np.roll(contact, (i, j), (0, 1))
    assert patches.perimeter(moved, 1.0, True) == patches.perimeter(contact, 1.0, True)
    assert patches.patches(moved, True).sizes.tolist() == patches.patches(contact, True).sizes.tolist()


@contacts
def test_nothing_depends_on_which_axis_is_first(contact, periodic):
    assert patches.perimeter(contact.T, 1.0, periodic) == patches.perimeter(contact, 1.0, periodic)
    assert patches.patches(contact.T, periodic).count == patches.patches(contact, periodic).count


def test_patches_join_across_edges_and_corners():
    corners = np.zeros((4, 5), bool)
    corners[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    assert patches.patches(corners, periodic=True).count == 1
    assert patches.patches(corners, periodic=False).count == 4
    diagonal = np.zeros((4, 4), bool)
    diagonal[0, 1] = diagonal[3, 2] = True  # neighbours over the edge, by a corner
    assert patches.patches(diagonal, periodic=True).count == 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 2), (1, 7), (5, 5)])
def test_full_and_empty_contact(shape):
    full, empty = np.ones(shape, bool), np.zeros(shape, bool)
    assert patches.perimeter(full, 1.0, True) == 0
    assert patches.perimeter(full, 1.0, False) == 2 * sum(shape)
    assert patches.perimeter(full, 1.0, False, border=False) == 0
    assert patches.patches(full, True).sizes.tolist() == [math.prod(shape)]
    assert patches.perimeter(empty, 1.0, True) == patches.perimeter(empty, 1.0, False) == 0
    assert patches.patches(empty, True).count == 0
    assert patches.patches(empty, True).sizes.size == 0


def test_kappa():
    def contact(load, area):
        return ca.plugin.ContactStatistics(
            pressure=np.array([2.0]), area=np.array([area]), load=load, nominal_area=9.0, modulus=35.0, rms_slope=0.1
        )

    assert contact(3.5, 2.0).kappa == pytest.approx(2.0)
    assert math.isnan(contact(0.0, 0.0).kappa)


def test_measures_leave_their_input_alone():
    heights = np.random.default_rng(0).random((5, 6))
    heights.setflags(write=False)
    contact = heights > 0.5
    contact.setflags(write=False)
    roughness.psd(heights, 1.0)
    roughness.psd(heights, 1.0, periodic=False)
    roughness.rms_slope(heights, 1.0)
    patches.patches(contact, True)
    patches.perimeter(contact, 1.0, True)
