"""Fits a track with dynesty, which needs ln L and a prior transform.

    pip install "dynesty>=3"
    python python/examples/fit_with_dynesty.py

examples/quick_fit.toml leaves five parameters free. The track was made in a spherical halo: q = 1.
"""

from pathlib import Path

import dynesty
import numpy as np

import oblate

EXAMPLES = Path(__file__).parents[2] / "examples"

# One thread: at each step dynesty asks for one point, whose particles are too few to be worth sharing.
fit = oblate.Fit(EXAMPLES / "tracks" / "s2_spherical.ecsv", config=EXAMPLES / "quick_fit.toml", threads=1)
sampler = dynesty.NestedSampler(
    fit.ln_likelihood,
    fit.prior_transform,
    fit.dim,
    nlive=150,
    sample="rslice",
    rstate=np.random.default_rng(1),
)
sampler.run_nested(dlogz=0.1, print_progress=False)
results = sampler.results

weights = results.importance_weights()
q = fit.derived(results.samples)["q"]
median, low, high = dynesty.utils.quantile(q, [0.5, 0.16, 0.84], weights)
print(f"ln Z = {results.logz[-1]:.2f} +- {results.logzerr[-1]:.2f}, {results.ncall.sum()} values of ln L")
print(f"q = {median:.2f}, 68 % interval [{low:.2f}, {high:.2f}]")
