"""The shapes of dark-matter haloes from the projected tracks of stellar streams."""

from oblate._oblate import Fit, Marginal, OblateError, Run, Track, __version__, sample

Uniform = Marginal.Uniform
Normal = Marginal.Normal
HalfNormal = Marginal.HalfNormal

__all__ = [
    "Fit",
    "HalfNormal",
    "Normal",
    "OblateError",
    "Run",
    "Track",
    "Uniform",
    "__version__",
    "sample",
]
