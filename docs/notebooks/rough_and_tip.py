# %% [markdown]
# # A rough contact against a tip
#
# The same chemistry in two contacts of equal load: a rough surface, whose load is carried by many patches, and a
# smooth tip with one. A whole experiment is a *scene*, here given as a dictionary.

# %%
from matplotlib import pyplot as plt

import chemage as ca

plt.rcParams["figure.dpi"] = 90

common = {
    "forming": {"kind": "md-silica"},
    "breaking": {"kind": "gaussian", "mean": "1.1 eV", "std": "0.02 eV"},
    "chemistry": {"activation_volume": "6.4 angstrom**3"},
    "engine": {"kind": "auto"},
    "hold": {"start": "1 ms", "stop": "1e5 s", "per_decade": 4, "replicas": 8, "seed": 1},
}
rough_scene = {
    "name": "rough",
    "surface": {
        "kind": "self-affine",
        "pixels": 256,
        "pixel_size": "0.4518 nm",
        "rms_slope": 0.1,
        "hurst": 0.8,
        "zeta": 32,
        "eta": 2,
        "seed": 1,
    },
    "contact": {"kind": "fft-bem", "modulus": "35.3 GPa", "load": "0.2 uN"},
    **common,
}
tip_scene = {
    "name": "tip",
    "surface": {"kind": "sphere", "radius": "100 nm", "pixels": 96, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "0.2 uN"},
    **common,
}
rough = ca.run(rough_scene)
rough

# %%
tip = ca.run(tip_scene)
axes = tip.plot()

# %% [markdown]
# Both curves in one figure. `plot` draws into axes that you give it.

# %%
figure, axes = plt.subplots(figsize=(4.8, 3.7))
rough.ageing.plot(axes, fit=False, color="C0", label="rough")
tip.ageing.plot(axes, fit=False, color="C1", label="tip")
legend = axes.legend(frameon=False)

# %% [markdown]
# The friction drop follows the contact area: per area, the two contacts differ by less than their areas do, although
# one is a single patch and the other is split into many.

# %%
for run in (rough, tip):
    last = run.to_pandas().iloc[-1]
    print(
        f"{run.name}: contact area {run.contact.area:.1f} nm2, "
        f"friction drop {last.friction_drop:.0f} ± {last.friction_drop_half_width:.0f} nN, "
        f"{last.friction_drop / run.contact.area:.1f} ± {last.friction_drop_half_width / run.contact.area:.1f} nN/nm2"
    )
