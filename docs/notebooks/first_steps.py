# %% [markdown]
# # First steps: from a tip to its ageing curve
#
# A silica tip touches a silica plane. Bonds form across the contact while the load is held, and the static friction
# rises with the logarithm of the hold time. Each step of that computation is one object, which a notebook shows as a
# picture with its main numbers.

# %%
import chemage as ca

tip = ca.surface("sphere", radius="30 nm", pixels=64, pixel_size="0.4518 nm").make()
tip

# %% [markdown]
# The contact under a load of 50 nN, by the theory of Hertz:

# %%
contact = ca.contact("hertz", modulus="35.3 GPa").solve(tip, load="50 nN")
contact

# %% [markdown]
# Every pixel in contact is a site where one bond can form. The barriers to forming it differ from site to site; here
# they are those of silica. Each of eight replicas draws its own barriers.

# %%
silica = ca.chemistry(forming=ca.barriers("md-silica"), activation_volume="6.4 angstrom**3")
times = ca.hold_times("1 ms", "1e5 s", per_decade=4)
ageing = ca.age(contact, silica, engine=ca.engine("auto"), hold_times=times, temperature="300 K", replicas=8, seed=1)
ageing

# %% [markdown]
# The same numbers as a table of pandas, one row for each hold time. The columns have the names that the tables of
# sweeps have.

# %%
table = ageing.to_pandas()
print(table[["bonds", "friction_drop", "friction_drop_half_width"]].iloc[::8].round(2))

# %% [markdown]
# β is the slope of the friction coefficient drop per decade of hold time, with its 95 % interval:

# %%
fit = ageing.fit("10 s", "1e4 s")
print(f"beta = {fit.beta:.4f} ± {fit.beta_half_width:.4f}")

# %% [markdown]
# And the same data for xarray, with named dimensions and units:

# %%
data = ageing.to_xarray()
print(dict(data.sizes), data.friction_drop.attrs["units"])
