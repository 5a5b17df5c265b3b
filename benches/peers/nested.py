"""Runs dynesty, UltraNest and nautilus on two targets of docs/validation.md, section 5.

    python benches/peers/nested.py [--samplers NAME ...] [--targets NAME ...] [--seed 1] [--limit 420]

Prints one row of a Markdown table at the end of each run. The targets are those of samplers/tests/integration/targets/smooth.rs.
There the basis of the Gaussian comes from oblate's own random numbers; here it is another fixed rotation: the evidence depends
on the eigenvalues alone. See README.md beside this file.
"""

import argparse
import importlib.metadata
import logging
import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")

import time
import warnings

import numpy as np
from scipy.special import ndtri

DIM = 13
# Likelihood precisions: the posterior has these plus one, 10^0.3 to 10^3 evenly in the logarithm.
PRECISIONS = 10.0 ** np.linspace(0.3, 3.0, DIM) - 1.0
ROOT = np.linalg.qr(np.random.default_rng(13).standard_normal((DIM, DIM)))[0] * np.sqrt(PRECISIONS)
RADIUS, WIDTH, CENTRE, HALF = 2.0, 0.1, 3.5, 6.0
SHELL_PEAK = -np.log(WIDTH * np.sqrt(2.0 * np.pi))


def gaussian(z):
    """-z' P z / 2, of one point or of rows."""
    y = z @ ROOT
    return -0.5 * (y @ y) if z.ndim == 1 else -0.5 * np.einsum("ij,ij->i", y, y)


def shells(theta):
    """Sum of two normal shells about +-3.5 e1, of one point or of rows."""
    if theta.ndim == 1:
        middle = theta @ theta + CENTRE**2
        shift = 2.0 * CENTRE * theta[0]
    else:
        middle = np.einsum("ij,ij->i", theta, theta) + CENTRE**2
        shift = 2.0 * CENTRE * theta[:, 0]
    near = (np.sqrt(middle - shift) - RADIUS) / WIDTH
    far = (np.sqrt(middle + shift) - RADIUS) / WIDTH
    return np.logaddexp(-0.5 * near * near, -0.5 * far * far) + SHELL_PEAK


class Problem:
    """A target that counts its calls and the time inside of it."""

    # Prior from the unit cube, ln L, ln Z. Evidences: closed form, and by quadrature.
    TARGETS = {
        "mvn13": (ndtri, gaussian, -0.5 * np.log1p(PRECISIONS).sum()),
        "shells13": (lambda u: 2.0 * HALF * u - HALF, shells, -20.660701),
    }

    def __init__(self, name):
        self.from_cube, self.value, self.ln_z = self.TARGETS[name]
        self.calls = 0
        self.inside = 0.0

    def prior(self, u):
        begin = time.perf_counter()
        theta = self.from_cube(u)
        self.inside += time.perf_counter() - begin
        return theta

    def ln_l(self, theta):
        begin = time.perf_counter()
        value = self.value(theta)
        self.calls += 1 if theta.ndim == 1 else len(theta)
        self.inside += time.perf_counter() - begin
        return value


def kish(ln_w):
    w = np.exp(ln_w - ln_w.max())
    return w.sum() ** 2 / (w * w).sum()


def dynesty_dynamic(problem, args):
    import dynesty

    sampler = dynesty.DynamicNestedSampler(
        problem.ln_l, problem.prior, DIM, sample="rslice", rstate=np.random.default_rng(args.seed)
    )
    sampler.run_nested(n_effective=args.draws, print_progress=False)
    return of_dynesty(sampler.results)


def dynesty_static(problem, args):
    import dynesty

    sampler = dynesty.NestedSampler(
        problem.ln_l, problem.prior, DIM, nlive=500, sample="rwalk", rstate=np.random.default_rng(args.seed)
    )
    sampler.run_nested(print_progress=False)
    return of_dynesty(sampler.results)


def of_dynesty(results):
    return results.logz[-1], results.logzerr[-1], kish(results.logwt)


def ultranest_slice(problem, args):
    import ultranest
    import ultranest.stepsampler as steps

    # It logs to the same output unless its logger has a handler.
    logging.getLogger("ultranest").addHandler(logging.NullHandler())
    np.random.seed(args.seed)
    sampler = ultranest.ReactiveNestedSampler(
        [f"x{i + 1}" for i in range(DIM)], problem.ln_l, transform=problem.prior, vectorized=True
    )
    sampler.stepsampler = steps.SliceSampler(
        nsteps=2 * DIM, generate_direction=steps.generate_mixture_random_direction
    )
    # No rounds of improvement: 400 live points throughout.
    result = sampler.run(min_num_live_points=400, max_num_improvement_loops=0, show_status=False, viz_callback=False)
    with np.errstate(divide="ignore"):
        ln_w = np.log(result["weighted_samples"]["weights"])
    return result["logz"], result["logzerr"], kish(ln_w)


def nautilus_discarding(problem, args):
    import nautilus

    sampler = nautilus.Sampler(problem.prior, problem.ln_l, n_dim=DIM, n_live=2000, vectorized=True, seed=args.seed)
    begin = time.process_time()
    # By CPU time, because the machine may have other work; nautilus itself stops by the clock.
    while not sampler.run(n_eff=args.draws, discard_exploration=True, timeout=5.0):
        if time.process_time() - begin > args.limit:
            return None
    draws = kish(sampler.posterior()[1])
    # It quotes no error: this is that of a mean of so many independent weights.
    return sampler.log_z, draws**-0.5, draws


SAMPLERS = {
    "dynesty-dynamic": ("dynesty", "dynamic `rslice`", dynesty_dynamic),
    "dynesty-static": ("dynesty", "static `rwalk`, 500 live", dynesty_static),
    "ultranest": ("ultranest", "slices, 26 steps, 400 live", ultranest_slice),
    "nautilus": ("nautilus-sampler", "2000 live, exploration discarded", nautilus_discarding),
}


def row(sampler, target, args):
    package, setting, run = SAMPLERS[sampler]
    problem = Problem(target)
    cpu, wall = time.process_time(), time.perf_counter()
    result = run(problem, args)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    # The clock of a process costs as much as a likelihood here. The share of the wall time that passed inside is that of the
    # CPU time: other processes interrupt both parts alike.
    own = cpu * (1.0 - problem.inside / wall) / problem.calls
    head = f"| {package} {importlib.metadata.version(package)}, {setting} | {target} |"
    if result is None:
        return f"{head} no result in {cpu:.0f} CPU s | | {problem.calls:,} | | | {1e6 * own:.0f} |"
    ln_z, error, draws = result
    return (
        f"{head} {ln_z - problem.ln_z:+.3f} | {error:.3f} | {problem.calls:,} | {draws:,.0f} "
        f"| {problem.calls / draws:.1f} | {1e6 * own:.1f} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samplers", nargs="+", default=list(SAMPLERS), choices=list(SAMPLERS))
    parser.add_argument("--targets", nargs="+", default=list(Problem.TARGETS), choices=list(Problem.TARGETS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--draws", type=float, default=20_000, help="effective draws of dynesty's dynamic runs and of nautilus")
    parser.add_argument("--limit", type=float, default=420.0, help="CPU seconds after which nautilus is stopped")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| sampler | target | ln Z - truth | error | calls | Kish | calls / Kish | own CPU us per call |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for target in args.targets:
        for sampler in args.samplers:
            print(row(sampler, target, args), flush=True)


if __name__ == "__main__":
    main()
