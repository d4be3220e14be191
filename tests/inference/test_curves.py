"""Measured curves: what is read, and what is refused with which message."""

from __future__ import annotations

import numpy as np
import pytest

import chemage as ca

HEADER = "hold_time (s), friction_drop (nN), error (nN), load (uN), temperature (K), curve\n"


def curve(times=(0.01, 0.1, 1, 10), values=(1, 2, 3, 4), errors=(0.1,) * 4, **fields):
    options = {"load": 50.0, "temperature": 300.0, **fields}
    return ca.MeasuredCurve(hold_times=times, values=values, errors=errors, **options)


def written(tmp_path, text):
    path = tmp_path / "curves.csv"
    path.write_text(text)
    return path


def test_rows_of_one_load_and_temperature_are_a_curve(tmp_path):
    rows = "1, 10, 1, 0.05, 300, a\n10, 20, 1, 0.05, 300, a\n1, 12, 2, 0.1, 350, b\n10, 30, 2, 0.1, 350, b\n"
    curves = ca.read_curves(written(tmp_path, HEADER + rows))
    assert [curve.name for curve in curves] == ["a", "b"]
    assert [(curve.load, curve.temperature) for curve in curves] == [(50.0, 300.0), (100.0, 350.0)]
    assert curves[1].friction_drop_errors.tolist() == [2, 2]


def test_units_percent_and_other_quantities_are_read(tmp_path):
    text = "hold_time (ms); friction_coefficient_drop; error (%)\n1; 0.1; 3\n100; 0.2; 3\n"
    (found,) = ca.read_curves(written(tmp_path, text.replace("(%)", "")), load="1 uN", temperature="27 degC")
    assert found.hold_times.tolist() == [0.001, 0.1]
    assert found.friction_drop == pytest.approx([100, 200])
    assert found.temperature == pytest.approx(300.15)
    text = "hold_time (s), value, quantity, error\n1, 10, friction_drop, 1\n10, 20, friction_drop, 1\n"
    with pytest.raises(ca.plugin.UnitError, match="value has no unit"):
        ca.read_curves(written(tmp_path, text), load=50, temperature=300)
    (found,) = ca.read_curves(written(tmp_path, text.replace("value", "value (nN)")), load=50, temperature=300)
    assert found.values.tolist() == [10, 20]


def test_a_relative_error_stands_for_errors_that_are_missing(tmp_path):
    path = written(tmp_path, "hold_time (s), friction_drop (nN)\n1, 10\n10, 20\n")
    (found,) = ca.read_curves(path, load=50, temperature=300, relative_error=0.03)
    assert found.errors == pytest.approx([0.3, 0.6])
    with pytest.raises(ca.InputError, match=r"no column error; .* relative_error"):
        ca.read_curves(path, load=50, temperature=300)
    with pytest.raises(ca.InputError, match=r"has a column error, and relative_error is given as well; leave one out"):
        ca.read_curves(
            written(tmp_path, HEADER + "1, 10, 1, 0.05, 300, a\n10, 20, 1, 0.05, 300, a\n"), relative_error=0.03
        )
    path = written(tmp_path, "hold_time (s), friction_drop (nN)\n1, 10\n10, 20\n")
    with pytest.raises(ca.InputError, match="no column load; add it, or give load"):
        ca.read_curves(path, temperature=300, relative_error=0.03)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            "1, 10, -2, 1, 300, a\n10, 20, 1, 1, 300, a\n",
            "line 2, column error: -2: a standard error must be above zero",
        ),
        ("1, x, 1, 1, 300, a\n10, 20, 1, 1, 300, a\n", "line 2, column friction_drop: 'x' is not a number"),
        ("1, 10, 1, -1, 300, a\n10, 20, 1, 1, 300, a\n", "line 2, column load: -1000 is not above zero"),
        ("", "has no rows of numbers below"),
    ],
)
def test_a_bad_row_is_named_with_the_remedy(tmp_path, rows, message):
    with pytest.raises(ca.InputError, match=message):
        ca.read_curves(written(tmp_path, HEADER + rows))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"times": (1, 0.1, 2, 3)}, "sort the hold times"),
        ({"times": (0, 0.1, 2, 3)}, "nothing has aged then"),
        ({"errors": (0.1, 0, 0.1, 0.1)}, "a standard error must be above zero"),
        ({"errors": (0.1, 0.1)}, "there are 4 hold times; give one for each"),
        ({"values": (1, np.nan, 2, 3)}, "is not finite; leave that row out"),
        ({"load": 0.0}, "load"),
    ],
)
def test_a_bad_curve_is_refused(given, message):
    with pytest.raises(ca.InputError, match=message):
        curve(**given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"times": (1, 2, 3, 4)}, "within one decade"),
        ({"values": (4, 3, 2, 1)}, "values fall, by .* per decade"),
    ],
)
def test_curves_that_tell_nothing_of_barriers_are_refused(given, message):
    with pytest.raises(ca.InputError, match=message):
        ca.infer([curve(**given)], "silica-tip")


def test_measurements_become_a_curve_with_load_and_temperature():
    data = ca.Measurements("m", np.array([0.0, 1, 10]), np.array([0.0, 0.1, 0.2]), "friction_coefficient_drop")
    with pytest.raises(ca.InputError, match="no column error"):
        ca.MeasuredCurve.of(data, load="50 nN", temperature=300)
    found = ca.MeasuredCurve.of(data, load="50 nN", temperature=300, relative_error=0.1)
    assert found.friction_drop == pytest.approx([5, 10])
    assert found.friction_drop_errors == pytest.approx([0.5, 1])


def test_a_curve_is_stored_whole(tmp_path):
    ca.write(tmp_path / "curve.h5", curve())
    assert ca.read(tmp_path / "curve.h5") == curve()


def aged(replicas=4):
    """ΔF of independent sites on a small tip."""
    tip = ca.surface("sphere", radius="5 nm", pixels=32, pixel_size="0.4518 nm").make()
    contact = ca.contact("hertz", modulus="35.3 GPa").solve(tip, load="20 nN")
    silica = ca.chemistry(forming=ca.barriers("gaussian", mean=0.8, std=0.1))
    call = {"engine": ca.engine("independent"), "temperature": "310 K", "replicas": replicas}
    return ca.age(contact, silica, hold_times=[0.0, *np.logspace(-2, 3, 6)], **call)


def test_a_simulated_mean_has_the_errors_of_its_replicas_and_their_correlation(tmp_path):
    ageing = aged()
    ca.write(tmp_path / "aged.h5", ageing)
    (found,) = ca.read_curves(tmp_path / "aged.h5")
    assert found.name == "aged"
    assert (found.load, found.temperature) == (20.0, 310.0)
    assert found.hold_times == pytest.approx(np.logspace(-2, 3, 6))
    assert found.values == pytest.approx(ageing.mean_friction_drop[1:])
    assert found.correlation is not None
    assert found.correlation[0] == 0
    assert (found.correlation[1:] > 0.3).all()
    assert found.chemistry["forming"]["kind"] == "gaussian"
    assert found.chemistry["bond_force"] == 3.0
    (same,) = ca.read_curves(ageing)
    assert same.model_copy(update={"name": "aged"}) == found
    ca.write(tmp_path / "curve.h5", found)
    assert ca.read(tmp_path / "curve.h5") == found


def test_results_without_errors_or_hold_times_are_refused(tmp_path):
    with pytest.raises(ca.InputError, match="its error is not known, as that of a single replica"):
        ca.read_curves(aged(1))
    with pytest.raises(ca.InputError, match="a result has load, temperature and errors; leave these options out"):
        ca.read_curves(aged(), load="20 nN")
    tip = ca.surface("sphere", radius="5 nm", pixels=32, pixel_size="0.4518 nm").make()
    with pytest.raises(ca.InputError, match="has no friction drop against hold time"):
        ca.read_curves(tip)


def test_printed_means_are_refused_as_they_lack_the_correlation_of_their_errors(tmp_path):
    """The columns of ``chemage show --csv``."""
    path = tmp_path / "means.csv"
    path.write_text(
        "hold_time (s),friction_drop (nN),friction_drop_stderr (nN),friction_drop_half_width (nN)\n1,2,1,2\n"
    )
    with pytest.raises(ca.InputError, match="without the correlation of their errors; give the file of the result"):
        ca.read_curves(path, load=20, temperature=300)
