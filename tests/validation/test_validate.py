"""Tests of published numbers accept these, refuse rivals, and give verdicts by rule; every row says where it is from."""

from __future__ import annotations

import csv
import json
import time
from types import SimpleNamespace

import numpy as np
import pytest

from chemage import InputError
from chemage.plugin import KB, decisions
from chemage_validation import measures, table
from chemage_validation.table import DATA, ROWS, ValidatedRow, validate

#: values that a row compares: one, two, or a curve
SIZES = {"value": 1, "ratio": 2, "power": 6, "bend": 4}
TESTED = [row for row in ROWS if row.observe]
HELD_OUT = {"afm-ratio", "mcclimon-weakening", "peng-load", "dillavou-load", "frye-dry", "frye-humid"}


def synthetic(row, number, noise=0.01, samples=8):
    """The test of values with this number and some relative noise."""
    base = np.linspace(1.0, 2.0, SIZES[row.compare])
    truth = measures.COMPARISONS[row.compare].values(number, base)
    away = np.random.default_rng(2).standard_normal((samples, truth.size))
    away -= away.mean(axis=0)
    return ValidatedRow(row, row.test(np.maximum(truth * (1 + noise * away), 0)))


@pytest.mark.parametrize("row", TESTED, ids=lambda row: row.name)
def test_a_test_accepts_the_published_number_itself_and_refuses_every_rival(row):
    same = synthetic(row, row.claimed)
    assert same.test.accepts(same.test.truth([row.claimed])[None])
    assert same.prediction.value == pytest.approx(row.claimed, rel=0.05, abs=1e-9)
    right = "calibrated" if row.calibrated else "held out and right"
    assert same.verdict == ("cannot tell" if row.beyond else right)
    for name, number in row.rivals.items():
        rival = synthetic(row, number)
        assert rival.verdict == ("cannot tell" if row.beyond else "wrong"), name
        assert same.test.power[name] >= decisions.POWER
        # how wrong a model must be: beyond the limit, before the rival
        far = abs(same.refused[name] - row.claimed)
        assert 0 < far <= abs(number - row.claimed) * (1 + 1e-9)


def test_noise_that_hides_a_rival_tells_nothing():
    row = next(row for row in ROWS if row.name == "peng-load")
    assert synthetic(row, 0.9, noise=0.6).verdict == "cannot tell"


def test_every_row_has_a_source_and_a_set_that_says_what_it_was_made_from():
    names = [row.name for row in ROWS]
    assert len(set(names)) == len(names) >= 20
    assert {row.source for row in ROWS} == set(DATA["sources"])
    for row in ROWS:
        text, address = row.cited
        assert text
        assert address.startswith(("10.", "https://"))
        assert row.sentence
        assert row.published
        # a number that is not available has no test, and what is not computed says why
        assert bool(row.set) == bool(row.observe)
        assert row.observe or row.beyond or row.unavailable
        assert not (row.observe and row.unavailable)
    for one in DATA["sets"].values():
        assert set(one["used"]) <= set(names)


def test_what_was_held_out_is_not_used_by_any_set():
    used = {name for one in DATA["sets"].values() for name in one["used"]}
    assert not HELD_OUT & used
    assert {row.name for row in TESTED if not row.calibrated and not row.beyond} == HELD_OUT


def test_exponent_bend_and_ratio_are_those_of_closed_forms():
    times = np.geomspace(5e-3, 90e-3, 6)
    number = {name: one.number for name, one in measures.COMPARISONS.items()}
    assert number["power"](3 * times**0.7) == pytest.approx(0.7)
    decades = np.array([-1.0, 0.0, 1.0, 2.0])
    assert number["bend"](5 + decades) == pytest.approx(1)
    assert number["bend"](decades**2 + 2 * decades) == pytest.approx(5)
    assert number["ratio"](np.array([4.0, 1.0])) == 0.25


def test_the_activation_energy_is_that_by_which_a_curve_is_shifted():
    """ΔF = f(t exp(−Q/kT)) with Q = 0.73 eV, about 70 kJ/mol."""
    times = np.geomspace(1e-3, 1e3, 241)

    def run(kelvin):
        drop = np.log1p(1e12 * times * np.exp(-0.73 / (KB * kelvin)))
        ageing = SimpleNamespace(hold_times=times, temperature=kelvin, friction_coefficient_drop=np.tile(drop, (20, 1)))
        return SimpleNamespace(ageing=ageing)

    found = measures.activation(run(300.0), run(320.0))
    assert found == pytest.approx(0.73 * 96.485, rel=1e-3)


def test_the_hold_times_of_the_linear_range_are_at_equal_ratios():
    """As the exponent takes them."""
    row = next(row for row in ROWS if row.name == "tian-linear")
    times = np.array([float(time.removesuffix(" ms")) for time in row.cases[0]["hold.times"]])
    assert (times[0], times[-1]) == (5, 90)
    assert np.diff(np.log(times)) == pytest.approx(np.log(18) / 5, rel=1e-3)


def test_the_command_prints_rows_with_their_sources(command):
    rows = json.loads(command("validate", "mcclimon-dry", "ouyang-reversal", "--json").out)["rows"]
    dry, reversal = rows
    assert dry["verdict"] == "calibrated"
    assert dry["calibrated_on"].split() == ["mcclimon-dry", "mcclimon-wet"]
    predicted = dry["prediction"]
    assert 0 < predicted["low"] < predicted["value"] < predicted["high"] < 0.1
    assert dry["power"] == {"half": 1, "the same": 1}
    assert reversal["verdict"] == "number not available"
    assert reversal["prediction"]["value"] is None
    assert {row["doi"] for row in rows} == {"10.1007/s11249-024-01904-x", "10.1103/PhysRevLett.123.116102"}
    table_of = list(csv.DictReader(command("validate", "liu-coal", "--csv").out.splitlines()))
    assert table_of[0]["verdict"] == "number not available"
    assert "not available" in command("validate", "liu-coal").out


def test_a_row_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="afm-ratio"):
        validate(["afm"])


@pytest.mark.campaign
def test_the_whole_table_is_made_within_five_minutes_and_has_every_verdict():
    begin = time.process_time()
    found = validate()
    assert time.process_time() - begin < 300
    verdicts = {one.row.name: one.verdict for one in found.rows}
    assert set(verdicts.values()) == {*table.VERDICTS.values(), table.NOT_AVAILABLE}
    # the numbers that the set was made from
    assert {verdicts[row.name] for row in ROWS if row.set == "rough" and row.calibrated} == {"calibrated"}
    for one in found.rows:
        if one.row.calibrated and one.row.compare == "value":
            assert one.prediction.low < one.row.claimed < one.prediction.high
    # what holds whatever the last bits: hard contacts do not forget, and Hertz is less steep than 1.5/15
    assert verdicts["dillavou-load"] == verdicts["afm-ratio"] == "wrong"
    assert verdicts["mcclimon-weakening"] == "held out and right"
