# %% [markdown]
# # From a measured map to an ageing curve, beside measurements
#
# An atomic force microscope has two things to offer: an image of the surface, and the static friction after different
# hold times. This notebook goes from the first to a computed ageing curve, and compares it with the second.
#
# Both "measurements" are made here, so that the notebook can be run as it is. They stand for your own files and say
# nothing about a material. First the image: 320 nm in 5 nm pixels, self-affine with a Hurst exponent of 0.8, in
# micrometres, on a tilted stage, and with a patch where nothing was measured.

# %%
import os
import tempfile

import numpy as np
from matplotlib import pyplot as plt

import chemage as ca
from chemage_surfaces import fit_roughness

folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
os.chdir(folder.name)  # leave out these two lines to keep the files
random = np.random.default_rng(6)
n, pixel, hurst = 64, 0.005, 0.8  # pixels, µm
q = 2 * np.pi * np.hypot(*np.meshgrid(np.fft.fftfreq(2 * n, pixel), np.fft.fftfreq(2 * n, pixel)))
q[0, 0] = np.inf
image = np.fft.ifft2(np.fft.fft2(random.standard_normal((2 * n, 2 * n))) * q ** (-1 - hurst)).real[:n, :n]
image *= 0.05 / np.hypot(*np.gradient(image, pixel)).std()  # a part of a larger surface
image += 0.01 * np.linspace(0, 1, n)[:, None] + 0.005 * np.linspace(0, 1, n)
image[40:45, 10:14] = np.nan
np.savetxt("scan.txt", image.T, fmt="%.6f")

# %% [markdown]
# ## Read and level
#
# A text file states neither its unit nor the size of a pixel, so both are given. Nothing else is assumed: without
# `missing`, the gap is an error that names this option. `detrend` subtracts the tilt, and the bow of a scanner. The
# surface records what each step did.

# %%
scan = ca.surface(
    "measured", path="scan.txt", height_unit="um", pixel_size="5 nm", missing="interpolate", detrend="quadratic"
)
surface = scan.make()
for step in surface.provenance["steps"]:
    print(step)

# %% [markdown]
# The file as it was written, and the surface after these steps:

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
side = 1000 * n * pixel
raw = left.imshow(1000 * image.T, origin="lower", extent=(0, side, 0, side), cmap="viridis")
left.set(title="as measured", xlabel="x (nm)", ylabel="y (nm)")
bar = figure.colorbar(raw, ax=left, label="height (nm)")
axes = surface.plot(right)

# %% [markdown]
# ## How rough is it?
#
# The Hurst exponent and the amplitude come from a fit of the power spectrum, with standard errors. One image of this
# size does not determine H well: the image was made with 0.8.

# %%
print(fit_roughness(surface).text())

# %% [markdown]
# Contact happens at short wavelengths as well, which the image does not resolve. `roughened` continues the spectrum
# to a shortest wavelength (here 2 nm), on pixels of 0.4518 nm: one for each reactive site of silica. The cut-off is
# an assumption; vary it, and the seed that draws the added waves. H is given here, and the amplitude is fitted.

# %%
rough = ca.surface("roughened", surface=scan, pixel_size="0.4518 nm", cutoff="2 nm", hurst=0.8).make(seed=1)
for name, one in {"image": surface, "with its small waves": rough}.items():
    wavenumbers, density = one.psd()
    lines = plt.loglog(wavenumbers, density, label=f"{name}, rms slope {one.rms_slope:.3f}")
axes = plt.gca()
axes.set(xlabel="wavenumber q (1/nm)", ylabel="power spectral density (nm$^4$)", ylim=(1e-4, 1e5))
legend = axes.legend(frameon=False)

# %% [markdown]
# ## Press and age
#
# The contact under 5 µN, and the ageing of silica. Only a part of the sites carries a hydroxyl group, and only a part
# of the bonds bears load at the same instant: half of them and 0.15 are the estimates of Li, Pastewka & Szlufarska
# (2018).

# %%
contact = ca.contact("fft-bem", modulus="35.3 GPa").solve(rough, load="5 uN")
contact

# %%
silica = ca.chemistry(
    forming=ca.barriers("md-silica"),
    breaking=ca.barriers("gaussian", mean="1.1 eV", std="0.02 eV"),
    interaction=ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1),
    activation_volume="6.4 angstrom**3",
    hydroxylation=0.5,
    front_factor=0.15,
)
times = ca.hold_times("10 ms", "1e4 s", per_decade=4)
ageing = ca.age(contact, silica, engine=ca.engine("auto"), hold_times=times, temperature="300 K", replicas=8, seed=1)

# %% [markdown]
# ## Beside the measurements
#
# The measurements are a CSV file whose header names the units. These are made from a law, Δμ = 0.02 log₁₀(1 + t/0.5
# s), with a scatter of 0.002. Both curves are fitted with this law over the same hold times.

# %%
holds = np.repeat([0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3000], 2)
measured = 0.02 * np.log10(1 + holds / 0.5) + 0.002 * random.standard_normal(holds.size)
rows = [f"{t:g}, {value:.4f}, 0.002" for t, value in zip(holds, measured, strict=True)]
with open("afm.csv", "w") as file:
    print("hold_time (s), friction_coefficient_drop, error", *rows, sep="\n", file=file)

figure, axes = plt.subplots(figsize=(6, 4.2))
data = ca.read_measurements("afm.csv")
fits = {}
for colour, (name, one) in zip(("C0", "C1"), {"computed": ageing, "measured": data}.items(), strict=True):
    fits[name] = ca.fit_ageing(one, model="curve", window=("0.1 s", "3000 s"))
    line = np.geomspace(0.1, 3000, 100)
    lines = axes.plot(line, fits[name](line), color=colour, label=f"{name}: {fits[name].short_text()}")
ageing.plot(axes, fit=False, color="C0")
bars = axes.errorbar(data.hold_times, data.values, data.error, fmt="s", ms=4, capsize=2, color="C1")
axes.set_ylim(0, 1.25 * ageing.mean_friction_coefficient_drop[-1])
legend = axes.legend(frameon=False, fontsize=8, loc="upper left")
for name, fit in fits.items():
    print(f"{name}: beta = {fit.beta_text()}, cut-off time {fit.cutoff_text()}, {fit.intervals_text()}")

# %% [markdown]
# The interval of the computed β contains the scatter of the replicas and nothing else. Before a difference from the
# measurements is interpreted, vary what was assumed: the cut-off, H within its error, the seed of the added waves,
# the share of hydroxylated sites. See [measured images](../measured.md) and [Comparing](../sweeps.md#comparing).
