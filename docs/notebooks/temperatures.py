# %% [markdown]
# # A sweep of temperatures, and activation energies
#
# Bonds form faster where it is hot. This notebook ages one small tip at five temperatures, and finds from the shift
# of the curves how high the barriers are that are crossed: the *apparent activation energy*.
#
# Bonds last here, and sites do not influence each other. This is the simplest case, in which the energies can be
# compared with the barriers that went in. The files are written into a temporary folder.

# %%
import os
import tempfile

import numpy as np
from matplotlib import pyplot as plt

import chemage as ca
from chemage.results.drawing import figures

folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
os.chdir(folder.name)  # leave out these two lines to keep the files
scene = {
    "name": "warm-tip",
    "material": "silica",
    "breaking": False,
    "interaction": False,
    "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 64, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "load": "50 nN"},
    "engine": {"kind": "independent"},
    "hold": {"start": "1 ms", "stop": "1e6 s", "per_decade": 6, "replicas": 30, "seed": 1},
    "sweep": {"hold.temperature": ["260 K", "280 K", "300 K", "320 K", "340 K"]},
}
result = ca.sweep(scene, "warm-tip")
print(len(result), "points,", len(result.failed), "failed")

# %% [markdown]
# ## As xarray
#
# The results have one dimension for each swept field, here `temperature`, and curves have `hold_time` as well. Every
# variable has its unit.

# %%
data = result.to_xarray()
print(dict(data.sizes))
for kelvin in data.temperature.values:
    one = data.sel(temperature=kelvin)
    print(f"{kelvin:.0f} K: beta = {one.beta:.3f} ± {one.beta_half_width:.3f} per decade")

# %%
drawn, axes = plt.subplots(figsize=(6, 4))
colours = plt.colormaps["plasma"](np.linspace(0, 0.85, data.sizes["temperature"]))
for kelvin, colour in zip(data.temperature.values, colours, strict=True):
    one = data.sel(temperature=kelvin)
    low = one.friction_coefficient_drop - one.friction_coefficient_drop_half_width
    high = one.friction_coefficient_drop + one.friction_coefficient_drop_half_width
    axes.plot(one.hold_time, one.friction_coefficient_drop, color=colour, label=f"{kelvin:.0f} K")
    axes.fill_between(one.hold_time, low, high, color=colour, alpha=0.25, lw=0)
axes.set(xscale="log", xlabel="hold time (s)", ylabel="friction coefficient drop Δμ", title="bands: 95 % intervals")
legend = axes.legend(frameon=False)

# %% [markdown]
# The same curve appears earlier where it is hotter. β is no measure of this shift: it is the slope in one window of
# hold times, 10 s to 10⁴ s, and at high temperature most of the sites have reacted before that window ends. What
# shifts is the *time at which a level is reached*.
#
# ## Activation energies
#
# `ca.arrhenius` finds the time t at which each level is reached at each temperature, and fits t = t₀ exp(E_a/k_BT).
# The levels here are bonds per site, because such a level can be compared with the distribution of barriers.

# %%
found = ca.arrhenius(result, levels=[0.1, 0.3, 0.5, 0.7], quantity="bonds_per_site")
drawn = figures(found)["arrhenius"]
drawn.set_dpi(90)
drawn.axes[0].set_ylim(top=1e10)  # room for the legend
drawn

# %%
for one in found.energies:
    half = (one.energy_interval.high - one.energy_interval.low) / 2
    print(f"{found.label(one)}: E_a = {one.energy:.2f} ± {half:.2f} eV, rms of ln t {one.rms_residual:.2f}")

# %% [markdown]
# ## What they mean
#
# There is no *one* activation energy. E_a grows with the level, because low barriers are crossed first: E_a at the
# level θ is the barrier below which the share θ of the sites lies, after pressure has lowered the barriers. This can
# be checked here, because the barriers are known: draw one for each pixel of the contact, and subtract activation
# volume times pressure.

# %%
contact = result[0].contact()
silica = result[0].scene().chemistry
pressures = contact.pressure[contact.pressure > 0]
intrinsic = ca.barriers("md-silica").quantile(np.linspace(0, 1, 2001)[1:-1])
lowered = (intrinsic[:, None] - silica.activation_volume * ca.plugin.EV_PER_GPA_NM3 * pressures).ravel()
for one in found.energies[:-1]:
    print(f"{found.label(one)}: barrier {np.quantile(lowered, one.level):.3f} eV, E_a {one.energy:.3f} eV")

# %% [markdown]
# Three remarks for experiments:
#
# - An activation energy measured at one level is that of the barriers crossed *then*. Two experiments at different
#   hold times or loads find different energies of the same interface.
# - The cut-off time, where the fitted line of β meets zero, is no good level: at each temperature that line is fitted
#   to other barriers. Its points lie far from their line, as the rms of ln t shows.
# - With bonds that break, or with neighbours that interact, E_a is still what an experiment finds, but it is no
#   longer a barrier of the distribution. See [Activation energies](../sweeps.md#activation-energies).
