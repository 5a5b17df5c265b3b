"""Fits a track with the No-U-Turn sampler of blackjax, which needs ln L and its gradient as a function of JAX.

    pip install blackjax
    python python/examples/fit_with_blackjax.py

The chain moves in standard-normal coordinates z, in which the prior is standard normal and has no bounds. The function
`ln_likelihood` serves numpyro as well: `numpyro.factor("ln_likelihood", ln_likelihood(z))`.

Three parameters are free: the masses of halo and progenitor, and q of a halo whose axis points at the observer. With the whole shape
vector the posterior has several modes, between which one chain does not move.
"""

from pathlib import Path

import blackjax
import jax
import jax.numpy as jnp
import numpy as np

import oblate

jax.config.update("jax_enable_x64", True)

EXAMPLES = Path(__file__).parents[2] / "examples"
WARM_UP = 300
DRAWS = 1000
# Trajectories of at most 31 leapfrog steps.
MAX_DOUBLINGS = 5

fit = oblate.Fit(
    EXAMPLES / "tracks" / "s2_spherical.ecsv",
    config=EXAMPLES / "quick_fit.toml",
    settings={"prior.fixed.dir_x": 0.0, "prior.fixed.dir_y": 0.0},
)
SHAPES = (jax.ShapeDtypeStruct((), jnp.float64), jax.ShapeDtypeStruct((fit.dim,), jnp.float64))


def value_and_gradient(z):
    value, gradient = fit.gradient(np.asarray(z), coordinates="z")
    # At a rejected point, where the gradient is NaN, ln L is minus infinity, and the trajectory ends.
    return np.float64(value), np.nan_to_num(gradient)


@jax.custom_vjp
def ln_likelihood(z):
    return ln_likelihood_forward(z)[0]


def ln_likelihood_forward(z):
    return jax.pure_callback(value_and_gradient, SHAPES, z, vmap_method="sequential")


def ln_likelihood_backward(gradient, bar):
    return (bar * gradient,)


ln_likelihood.defvjp(ln_likelihood_forward, ln_likelihood_backward)


def ln_posterior(z):
    return ln_likelihood(z) - 0.5 * jnp.sum(z**2)


# The chain starts at the best of some draws of the prior.
prior_draws = np.random.default_rng(1).normal(size=(1000, fit.dim))
start = jnp.asarray(prior_draws[np.argmax(fit.ln_likelihood(prior_draws, coordinates="z"))])

warm_up_key, sample_key = jax.random.split(jax.random.key(1))
warm_up = blackjax.window_adaptation(blackjax.nuts, ln_posterior, max_num_doublings=MAX_DOUBLINGS)
(state, parameters), _ = warm_up.run(warm_up_key, start, num_steps=WARM_UP)
kernel = blackjax.nuts(ln_posterior, **parameters)


@jax.jit
def step(state, key):
    state, info = kernel.step(key, state)
    return state, (state.position, info.num_integration_steps, info.is_divergent)


_, (z, leapfrogs, divergent) = jax.lax.scan(step, state, jax.random.split(sample_key, DRAWS))

q = fit.derived(fit.theta_from_z(np.asarray(z)))["q"]
ess = float(blackjax.diagnostics.effective_sample_size(jnp.asarray(q)[None, :]))
low, median, high = np.quantile(q, [0.16, 0.5, 0.84])
print(f"q = {median:.2f}, 68 % interval [{low:.2f}, {high:.2f}], ESS of q {ess:.0f}")
print(f"{leapfrogs.sum()} gradients, {divergent.sum()} divergent trajectories")
