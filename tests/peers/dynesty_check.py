"""ln Z of a reduced problem by dynesty, with oblate's likelihood through `oblate evaluate`.

    python3 tests/peers/dynesty_check.py target/release/oblate --runs /tmp/s0_nested /tmp/s0_pt-hmc

Prior transforms are written here a second time, from the table of priors alone, so that they check oblate's too. See
README.md beside this file for the comparison.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import time
import tomllib

import dynesty
import numpy as np
from scipy.special import ndtri

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parent.parent

# name: unit-cube coordinate to physical value.
PRIOR = {
    "log10_m_halo": lambda u: 11.0 + 3.0 * u,
    "r_s_halo_kpc": lambda u: 10.0 + 15.0 * u,
    "dir_x": ndtri,
    "dir_y": ndtri,
    "dir_z": lambda u: ndtri(0.5 + 0.5 * u),
    "log10_m_prog": lambda u: 7.0 + 2.0 * u,
    "r_s_prog_kpc": lambda u: 1.0 + 4.0 * u,
    "x0_kpc": lambda u: 150.0 * ndtri(0.5 + 0.5 * u),
    "z0_kpc": lambda u: 150.0 * ndtri(0.5 + 0.5 * u),
    "vx0_km_s": lambda u: 250.0 * ndtri(u),
    "vy0_km_s": lambda u: 250.0 * ndtri(0.5 + 0.5 * u),
    "vz0_km_s": lambda u: 250.0 * ndtri(u),
    "age_gyr": lambda u: 1.0 + 3.0 * u,
}


class Evaluator:
    """ln L of free parameters, answered by one long-lived `oblate evaluate`."""

    def __init__(self, command, free, fixed):
        self.free = free
        self.fixed = fixed
        self.calls = 0
        self.rejected = 0
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __call__(self, theta):
        point = self.fixed | dict(zip(self.free, map(float, theta)))
        self.process.stdin.write(json.dumps(point) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            sys.exit(f"{self.process.args[0]} ended early, exit code {self.process.wait()}")
        answer = json.loads(line)
        self.calls += 1
        if answer["ln_likelihood"] is None:
            self.rejected += 1
            # dynesty has no word for a rejection; this is below any track's ln L.
            return -1e300
        return answer["ln_likelihood"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("oblate", help="the command, e.g. target/release/oblate")
    parser.add_argument("--track", default=ROOT / "examples" / "tracks" / "s0_oblate_tilted.ecsv")
    parser.add_argument("--config", default=HERE / "reduced.toml")
    parser.add_argument("--live", type=int, default=500)
    parser.add_argument("--dlogz", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--runs", nargs="*", default=[], help="run folders of `oblate fit` whose ln Z must agree"
    )
    args = parser.parse_args()

    config = tomllib.loads(pathlib.Path(args.config).read_text())
    fixed = config["prior"]["fixed"]
    free = [name for name in PRIOR if name not in fixed]
    command = [args.oblate, "evaluate", str(args.track), "--config", str(args.config)]
    ln_likelihood = Evaluator(command, free, fixed)

    def prior_transform(u):
        return np.array([PRIOR[name](x) for name, x in zip(free, u)])

    started = time.monotonic()
    sampler = dynesty.NestedSampler(
        ln_likelihood,
        prior_transform,
        len(free),
        nlive=args.live,
        bound="multi",
        sample="rslice",
        rstate=np.random.default_rng(args.seed),
    )
    sampler.run_nested(dlogz=args.dlogz, print_progress=False)
    results = sampler.results
    weights = np.exp(results.logwt - results.logz[-1])
    means = weights @ results.samples / weights.sum()
    spread = np.sqrt(weights @ (results.samples - means) ** 2 / weights.sum())
    print(
        json.dumps(
            {
                "ln_z": {"value": results.logz[-1], "error": results.logzerr[-1]},
                "parameters": {
                    name: {"mean": m, "sd": s} for name, m, s in zip(free, means, spread)
                },
                "calls": ln_likelihood.calls,
                "rejected": ln_likelihood.rejected,
                "seconds": round(time.monotonic() - started, 1),
                "dynesty": dynesty.__version__,
            },
            indent=2,
        )
    )
    for run in args.runs:
        ln_z = json.loads((pathlib.Path(run) / "summary.json").read_text())["ln_z"]
        error = np.hypot(ln_z["error"], results.logzerr[-1])
        apart = (ln_z["value"] - results.logz[-1]) / error
        print(f"{run}: ln Z is {apart:+.2f} combined errors from dynesty's")
        assert abs(apart) < 3, run


if __name__ == "__main__":
    main()
