# %% [markdown]
# # A sweep as a job array
#
# 5 loads, 8 temperatures and 3 seeds are 120 points: on a cluster, several jobs compute them at the same time into
# one folder. This notebook does the same with four processes on one machine, kills one of them half-way, and resumes.
# The same commands stand in the scripts for SLURM and PBS in [Clusters](../clusters.md).
#
# The scene is a file, as it would be on a cluster. Everything is written into a temporary folder.

# %%
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

import chemage as ca

folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
os.chdir(folder.name)  # leave out these two lines to keep the files
study = """
name = "study"
surface = { kind = "sphere", radius = "20 nm", pixels = 48, pixel_size = "0.4518 nm" }
contact = { kind = "hertz", modulus = "35.3 GPa" }
forming = { kind = "md-silica" }
breaking = { kind = "gaussian", mean = "1.1 eV", std = "0.02 eV" }
interaction = { kind = "elastic-pairs", strength = "0.1 eV", bias = 0.1 }
chemistry = { activation_volume = "6.4 angstrom**3" }
engine = { kind = "rejection-free" }
hold = { start = "1 ms", stop = "1e5 s", replicas = 10 }

[sweep]
contact.load = ["5 nN", "10 nN", "20 nN", "40 nN", "80 nN"]
hold.temperature = [200, 225, 250, 275, 300, 325, 350, 375]
hold.seed = [1, 2, 3]
"""
with open("study.toml", "w") as file:
    print(study, file=file)

# %% [markdown]
# `chemage sweep study.toml --out study --points 2/4` computes the second of four shares. In a terminal, type
# `chemage` for the first three words of the list below. One point is computed first, so that the kernels are compiled
# once and not by every process.


# %%
def command(*options):
    return [sys.executable, "-m", "chemage", *options]


def sweep(points):
    with Path(f"points-{points.replace('/', '-of-')}.log").open("w") as log:
        words = command("sweep", "study.toml", "--out", "study", "--points", points)
        return subprocess.Popen(words, stdout=log, stderr=subprocess.STDOUT)


print("exit status of one point:", sweep("0").wait())

# %% [markdown]
# Four processes start at the same time. The second is killed as soon as 12 points are complete, as a scheduler does
# when the time of a job has run out (`kill -9`: it has no chance to tidy up). The others go on.

# %%
shares = {number: sweep(f"{number}/4") for number in (1, 2, 3, 4)}
while len(list(Path("study/points").glob("*/*.json"))) < 12:
    time.sleep(0.01)
shares[2].kill()
status = {number: process.wait() for number, process in shares.items()}
for number in shares:
    print(f"share {number}: {'all points done' if status[number] == 0 else 'ended before its points were done'}")

# %% [markdown]
# `chemage sweep --collect` verifies every point. It writes no tables as long as points are missing, and says which
# command computes them.

# %%
collect = command("sweep", "--collect", "study")
answer = subprocess.run(collect, capture_output=True, text=True)
print("exit status of collect:", answer.returncode)
print(*(line for line in answer.stderr.splitlines() if line.startswith("computes some")), sep="\n")

# %% [markdown]
# The same command again computes what is missing of the share, and nothing else.

# %%
again, collected = sweep("2/4").wait(), subprocess.run(collect, capture_output=True).returncode
print(f"exit status of share 2: {again}, of collect: {collected}")

# %% [markdown]
# ## One dataset
#
# The results are one dataset of xarray, with a dimension for each swept field. Write `data["load"]` for the
# coordinate of the load: `data.load` is a method of xarray.

# %%
data = ca.load_sweep("study").to_xarray()
print(dict(data.sizes))
print("points done:", int((data.status == "done").sum()))

# %% [markdown]
# The mean over seeds is what to plot, and their scatter is the error: each seed draws the barriers of every replica
# anew. Loads and temperatures of one seed share their random numbers, which makes differences between them more
# certain than the bars look.

# %%
mean = data.beta.mean("seed")
half = 4.303 * data.beta.std("seed", ddof=1) / np.sqrt(data.sizes["seed"])  # Student's t, 3 seeds, 95 %
figure, axes = plt.subplots(figsize=(6, 4))
colours = plt.colormaps["viridis"](np.linspace(0, 0.85, data.sizes["load"]))
for load, colour in zip(data["load"].values, colours, strict=True):
    one, error = mean.sel(load=load), half.sel(load=load)
    axes.errorbar(one.temperature, one, error, fmt="o-", ms=4, capsize=3, color=colour, label=f"{load:.0f} nN")
axes.set(xlabel="temperature (K)", ylabel="β per decade", title="mean of 3 seeds, bars: 95 % intervals")
legend = axes.legend(frameon=False, title="load")

# %% [markdown]
# Ageing is fastest at one temperature. In the cold few barriers are crossed; in the heat most bonds form before the
# fit window, 10 s to 10⁴ s, begins, and bonds that have formed break again.

# %%
for load in data["load"].values:
    one = mean.sel(load=load)
    best = one.idxmax("temperature").item()
    error = half.sel(load=load, temperature=best).item()
    print(f"{load:3.0f} nN: largest beta {one.max().item():.2f} ± {error:.2f} per decade, at {best:.0f} K")
