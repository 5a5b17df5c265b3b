"""The shapes of dark-matter haloes from the projected tracks of stellar streams.

    fit = oblate.Fit("track.ecsv")
    theta = fit.prior_transform(u)           # u in the unit cube, of shape (13,) or (n, 13)
    ln_l, gradient = fit.gradient(theta)

docs/python.md in the repository has an introduction.
"""

from oblate._load import load, load_arviz
from oblate._oblate import Fit, Marginal, Model, OblateError, Run, Track, __version__, sample

Uniform = Marginal.Uniform
Normal = Marginal.Normal
HalfNormal = Marginal.HalfNormal

__all__ = [
    "Fit",
    "HalfNormal",
    "Marginal",
    "Model",
    "Normal",
    "OblateError",
    "Run",
    "Track",
    "Uniform",
    "__version__",
    "load",
    "load_arviz",
    "sample",
]
