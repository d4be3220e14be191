"""An inference for other programs: R-hat and effective samples as Vehtari et al. define them, and a tree of xarray.

Vehtari, Gelman, Simpson, Carpenter, Bürkner, Bayesian Anal. 16, 667 (2021): chains are split in halves, and values
replaced by normal quantiles of their ranks. ArviZ 1 computes the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from chemage import errors


def halves(chains: np.ndarray) -> np.ndarray:
    """(2 chains, S // 2) of ``chains`` (chains, S); of an odd number the middle one is left out."""
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def _normal(values: np.ndarray) -> np.ndarray:
    """Normal quantiles of the ranks of all values, equal ones of their mean rank."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    return ndtri(
        (rankdata(values).reshape(values.shape) - 3 / 8) / (values.size + 1 / 4)
    )


def r_hat(chains: np.ndarray) -> float:
    """Rank-normalised split R-hat of ``chains`` (chains, S): the larger of that of location and that of spread."""
    split = halves(np.asarray(chains, dtype=np.float64))
    return max(
        _ratio(_normal(split)), _ratio(_normal(np.abs(split - np.median(split))))
    )


def _ratio(chains: np.ndarray) -> float:
    count = chains.shape[1]
    within = chains.var(axis=1, ddof=1).mean()
    between = count * chains.mean(axis=1).var(ddof=1)
    return (
        float(np.sqrt((between / within + count - 1) / count))
        if within > 0
        else 1.0
    )


def effective(chains: np.ndarray) -> float:
    """Effective samples of the bulk of ``chains`` (chains, S)."""
    return _effective(_normal(halves(np.asarray(chains, dtype=np.float64))))


def _effective(chains: np.ndarray) -> float:
    """By Geyer's initial monotone sequence; Vehtari et al., eqs. 10 to 13."""
    count, length = chains.shape
    if np.ptp(chains) < 1e-15:
        return float(chains.size)
    centred = chains - chains.mean(axis=1, keepdims=True)
    spectrum = np.fft.rfft(centred, 2 * length, axis=1)
    covariance = (
        np.fft.irfft(spectrum * spectrum.conj(), axis=1)[:, :length].mean(axis=0)
        / length
    )
    within = covariance[0] * length / (length - 1)
    total = covariance[0] + (chains.mean(axis=1).var(ddof=1) if count > 1 else 0.0)
    correlation = 1 - (within - covariance) / total
    correlation[0] = 1.0
    pairs = correlation[: 2 * ((length - 1) // 2)].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0)
    end = int(negative[0]) if negative.size else pairs.size - 1
    time = (
        -1
        + 2 * float(np.minimum.accumulate(pairs[:end]).sum())
        + max(float(correlation[2 * end]), 0.0)
    )
    return float(chains.size / max(time, 1 / np.log10(chains.size)))


def sampled(one: Any) -> dict[str, np.ndarray]:
    """Name -> (chains, draws, ...) of everything that was sampled."""
    chains = int(one.diagnostics.get("chains", 1))
    every = {"density": one.samples, **one.scalars}
    for name, values in one.error_terms.items():
        every[name.replace(" ", "_")] = values
    return {
        name: values.reshape(chains, -1, *values.shape[1:])
        for name, values in every.items()
    }


def statistics(one: Any) -> dict[str, dict[str, np.ndarray]]:
    """Name -> mean, sd, ess_bulk and r_hat of the samples that are kept, of every energy for the density."""
    measures = {
        "mean": np.mean,
        "sd": np.std,
        "ess_bulk": effective,
        "r_hat": r_hat,
    }
    table = {}
    for name, values in sampled(one).items():
        chains, draws, *shape = values.shape
        columns = values.reshape(chains, draws, -1)
        every = [columns[:, :, at] for at in range(columns.shape[2])]
        table[name] = {
            key: np.array([measure(column) for column in every]).reshape(shape)
            for key, measure in measures.items()
        }
    return table


#: group of the tree -> its variables: name -> array of the inference
_GROUPS = {
    "posterior": {"density": "samples"},
    "posterior_predictive": {"friction_drop": "fitted"},
    "prior": {"density": "prior"},
    "prior_predictive": {"friction_drop": "prior_fitted"},
    "observed_data": {"friction_drop": "values", "error": "errors"},
}


def datatree(one: Any) -> Any:
    """The groups ``posterior``, ``posterior_predictive``, ``prior``, ``prior_predictive`` and ``observed_data`` as an
    xarray.DataTree, as ArviZ 1 reads it; dimensions ``chain``, ``draw``, ``energy`` (eV) and ``point``."""
    xarray = errors.optional_module("xarray", "xarray")
    chains = int(one.diagnostics.get("chains", 1))
    coordinates = {
        "energy": {"energy": ("energy", one.energies, {"units": "eV"})},
        "point": {
            "hold_time": ("point", one.hold_times, {"units": "s"}),
            "curve": ("point", one.curve),
        },
    }
    groups = {}
    for group, names in _GROUPS.items():
        dim = "energy" if "density" in names else "point"
        drawn, shape = ("chain", "draw"), (1, -1)
        if group.startswith("posterior"):
            shape = chains, -1
        if group == "observed_data":
            drawn = shape = ()
        arrays = {}
        for name, field in names.items():
            values, (_, unit, _) = getattr(one, field), one.arrays[field]
            values = values.reshape(*shape, values.shape[-1])
            arrays[name] = (*drawn, dim), values, {"units": unit}
        if group == "posterior":
            for name, values in sampled(one).items():
                arrays.setdefault(name, (drawn, values, {"units": ""}))
        dataset = xarray.Dataset(arrays, coordinates[dim])
        for of in drawn:
            dataset = dataset.assign_coords({of: range(dataset.sizes[of])})
        groups[f"/{group}"] = dataset.assign_attrs(inference_library="chemage")
    return xarray.DataTree.from_dict(groups)
