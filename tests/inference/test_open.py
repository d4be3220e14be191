"""Statistics for other programs: ours are those of ArviZ, and its reader takes the tree."""

from __future__ import annotations

import numpy as np
import pytest
from inferring import effective, r_hat
from made_inference import made_inference


def chains(rho, count=4, length=251, apart=0.0):
    """Autoregressive chains, whose effective share is (1 − ρ)/(1 + ρ)."""
    rng = np.random.default_rng(3)
    values = np.zeros((count, length))
    noise = rng.standard_normal((count, length))
    values[:, 0] = noise[:, 0]
    for at in range(1, length):
        values[:, at] = rho * values[:, at - 1] + np.sqrt(1 - rho**2) * noise[:, at]
    return values + apart * np.arange(count)[:, None]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_effective_samples_are_those_of_an_autoregressive_process(rho):
    values = chains(rho, length=20_000)
    assert effective(values) == pytest.approx(values.size * (1 - rho) / (1 + rho), rel=0.1)
    assert r_hat(values) < 1.01


def test_r_hat_sees_chains_that_stay_apart_or_spread_differently():
    assert r_hat(chains(0.0, apart=1.0)) > 1.2
    assert r_hat(chains(0.0) * np.array([[1], [1], [4], [4]])) > 1.1


def inference():
    one = made_inference(members=400, diagnostics={"chains": 4, "effective_samples": 1.0, "r_hat": 1.0})
    rng = np.random.default_rng(1)
    return one.model_copy(update={"error_terms": {"scale 0": np.exp(0.2 * rng.standard_normal(400))}})


def test_the_summary_of_arviz_is_ours():
    pytest.importorskip("arviz_stats", minversion="0.6")
    # there only with what arviz-stats[xarray] adds
    arviz = pytest.importorskip("arviz_stats.summary")
    one = inference()
    tree = one.datatree()
    table = arviz.summary(tree, round_to="none")
    ours = one.statistics()
    for name in ("density", "scale_0"):
        labels = [label for label in table.index if label.startswith(name)]
        for column in ("mean", "sd", "ess_bulk", "r_hat"):
            theirs = table.loc[labels, column].to_numpy(dtype=float)
            found = np.ravel(ours[name][column])
            if column == "sd" and not np.isclose(found[0], theirs[0], rtol=1e-9, atol=0):
                found = found * np.sqrt(400 / 399)  # versions of arviz-stats divide by n, or by n - 1
            np.testing.assert_allclose(found, theirs, rtol=1e-12, err_msg=column)


def test_the_tree_has_the_groups_with_units_and_survives_a_file(tmp_path):
    xarray = pytest.importorskip("xarray")
    if not hasattr(xarray, "DataTree"):
        pytest.skip("this xarray has no trees")
    one = inference()
    tree = one.datatree()
    assert set(tree.children) == {
        "posterior", "posterior_predictive", "prior", "prior_predictive", "observed_data"
    }  # fmt: skip
    posterior = tree["posterior"].dataset
    assert dict(posterior.sizes) == {"chain": 4, "draw": 100, "energy": one.energies.size}
    assert posterior["density"].attrs["units"] == "1/eV"
    np.testing.assert_array_equal(posterior["density"].values.reshape(400, -1), one.samples)
    tree.to_netcdf(tmp_path / "tree.nc", engine="h5netcdf")
    with xarray.open_datatree(tmp_path / "tree.nc", engine="h5netcdf") as again:
        np.testing.assert_array_equal(again["observed_data"]["friction_drop"].values, one.values)
