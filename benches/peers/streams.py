"""Times one stream, its ln L and its gradient: StreaMAX, gala and agama beside oblate, alternating, in one run.

    python benches/peers/streams.py target/release/oblate

The job: 10,000 particles, 100 leapfrog steps each, a flattened NFW host, a Plummer progenitor, Fardal et al. (2015) releases,
mean radius in bins of 10 degrees, a Gaussian ln L against the track of examples/tracks/s0_oblate_tilted.ecsv, at one point
near its truth. Every tool draws its own random numbers, so the numbers of ln L differ; only times are compared. See README.md
beside this file.
"""

import argparse
import json
import pathlib
import platform
import resource
import statistics
import subprocess
import time

import numpy as np

ROOT = pathlib.Path(__file__).parent.parent.parent
TRACK = ROOT / "examples" / "tracks" / "s0_oblate_tilted.ecsv"
PARTICLES, STEPS = 10_000, 100

POINT = {
    "log10_m_halo": 12.1, "r_s_halo_kpc": 16.0, "dir_x": -0.112, "dir_y": -0.179, "dir_z": 0.735,
    "log10_m_prog": 8.0, "r_s_prog_kpc": 1.5, "x0_kpc": 59.0, "z0_kpc": 53.0,
    "vx0_km_s": -41.0, "vy0_km_s": 156.0, "vz0_km_s": -29.0, "age_gyr": 3.0,
}
Q = 0.6
KM_S = 1.0227121650537077  # kpc/Gyr


def data():
    rows = [line.split() for line in TRACK.read_text().splitlines() if line and not line.startswith(("#", "phi"))]
    phi, r, r_err = (np.array([float(row[k]) for row in rows], dtype=np.float32) for k in range(3))
    return np.floor(phi / 10.0).astype(int), r, r_err


class Oblate:
    """A long-lived `oblate evaluate`: the seconds that it reports are those of the evaluation alone."""

    def __init__(self, command, gradient, threads):
        flags = ["--gradient"] if gradient else []
        self.process = subprocess.Popen(
            [command, "evaluate", str(TRACK), "--profile", "paper", "--threads", str(threads), *flags],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )

    def turn(self, calls):
        """Seconds of each of these many calls, one after the other without a pause."""
        self.process.stdin.write((json.dumps(POINT) + "\n") * calls)
        self.process.stdin.flush()
        return [json.loads(self.process.stdout.readline())["seconds"] for _ in range(calls)]


class Timed:
    """A function in this process, by its wall and CPU time."""

    def __init__(self, function):
        self.function = function
        self.cpu = []

    def turn(self, calls):
        return [self.call() for _ in range(calls)]

    def call(self):
        before = resource.getrusage(resource.RUSAGE_SELF)
        begin = time.perf_counter()
        self.function()
        wall = time.perf_counter() - begin
        after = resource.getrusage(resource.RUSAGE_SELF)
        self.cpu.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        return wall


def streamax():
    """Value and reverse gradient with respect to the 13 parameters, jitted, in single precision (all that it has)."""
    import jax
    import jax.numpy as jnp
    import StreaMAX

    bins, r_data, r_err = data()
    bins, r_data, r_err = jnp.asarray(bins), jnp.asarray(r_data), jnp.asarray(r_err)

    def ln_likelihood(p):
        zero = {"x_origin": 0.0, "y_origin": 0.0, "z_origin": 0.0}
        # Its axis is (-dir_x, -dir_y, dir_z).
        host = zero | {
            "logM": p["log10_m_halo"], "Rs": p["r_s_halo_kpc"], "a": 1.0, "b": 1.0, "c": Q,
            "dirx": -p["dir_x"], "diry": -p["dir_y"], "dirz": p["dir_z"],
        }
        sphere = zero | {"logM": p["log10_m_prog"], "Rs": p["r_s_prog_kpc"]}
        today = jnp.array([
            p["x0_kpc"], 0.0, p["z0_kpc"],
            p["vx0_km_s"] * KM_S, p["vy0_km_s"] * KM_S, p["vz0_km_s"] * KM_S,
        ])
        _, _, stream, _ = StreaMAX.generate_stream(
            today, "NFW", host, "Plummer", sphere, p["age_gyr"], 1.0, STEPS - 1, PARTICLES, False,
            m_f_sat=p["log10_m_prog"],
        )
        x, y = stream[:, 0], stream[:, 1]
        r = jnp.sqrt(x * x + y * y)
        number = jnp.floor(jnp.degrees(jnp.arctan2(y, x)) / 10.0).astype(int) + 18
        count = jnp.zeros(36).at[number].add(1.0)
        mean = jnp.zeros(36).at[number].add(r) / jnp.maximum(count, 1.0)
        return -0.5 * jnp.sum(((mean[bins + 18] - r_data) / r_err) ** 2)

    value = jax.jit(ln_likelihood)
    gradient = jax.jit(jax.value_and_grad(ln_likelihood))
    point = {name: jnp.float32(number) for name, number in POINT.items()}
    value(point).block_until_ready()
    jax.block_until_ready(gradient(point))
    return Timed(lambda: value(point).block_until_ready()), Timed(lambda: jax.block_until_ready(gradient(point)))


def gala():
    """A stream by leapfrog with as many releases, on the progenitor's own time steps: half of the particle-steps."""
    import astropy.units as u
    import gala.dynamics as gd
    import gala.integrate as gi
    import gala.potential as gp
    from gala.dynamics import mockstream as ms
    from scipy.spatial.transform import Rotation

    axis = np.array([POINT["dir_x"], POINT["dir_y"], POINT["dir_z"]])
    turn = Rotation.align_vectors([[0.0, 0.0, 1.0]], [axis / np.linalg.norm(axis)])[0].as_matrix()
    from gala.units import galactic

    host = gp.NFWPotential(
        m=10 ** POINT["log10_m_halo"] * u.Msun, r_s=POINT["r_s_halo_kpc"] * u.kpc, c=Q, units=galactic, R=turn
    )
    sphere = gp.PlummerPotential(10 ** POINT["log10_m_prog"] * u.Msun, POINT["r_s_prog_kpc"] * u.kpc, units=galactic)
    today = gd.PhaseSpacePosition(
        pos=[POINT["x0_kpc"], 0.0, POINT["z0_kpc"]] * u.kpc,
        vel=[POINT["vx0_km_s"], POINT["vy0_km_s"], POINT["vz0_km_s"]] * u.km / u.s,
    )
    generator = ms.MockStreamGenerator(ms.FardalStreamDF(gala_modified=True), gp.Hamiltonian(host), progenitor_potential=sphere)
    mass = 10 ** POINT["log10_m_prog"] * u.Msun

    def run():
        generator.run(
            today, mass, dt=-POINT["age_gyr"] / STEPS * u.Gyr, n_steps=STEPS, release_every=1,
            n_particles=PARTICLES // (2 * STEPS), Integrator=gi.LeapfrogIntegrator,
        )

    run()
    return Timed(run)


def agama():
    """A stream by its adaptive integrator at its loosest usual accuracy, in a spherical host: one flattened in potential it has
    not, and one flattened in density takes it several times as long."""
    import agama

    agama.setUnits(mass=1, length=1, velocity=1)
    agama.setNumThreads(1)
    host = agama.Potential(type="NFW", mass=10 ** POINT["log10_m_halo"], scaleRadius=POINT["r_s_halo_kpc"])
    mass = 10 ** POINT["log10_m_prog"]
    today = np.array([POINT[k] for k in ("x0_kpc", "vx0_km_s", "z0_kpc", "vx0_km_s", "vy0_km_s", "vz0_km_s")])
    today[1] = 0.0
    age = POINT["age_gyr"] * KM_S
    random = np.random.default_rng(1)

    def run():
        times, path = agama.orbit(potential=host, ic=today, time=-age, trajsize=STEPS + 1, accuracy=1e-4)
        x, v = path[1:, :3], path[1:, 3:]
        r = np.linalg.norm(x, axis=1)
        radial = x / r[:, None]
        momentum = np.cross(x, v)
        omega = np.linalg.norm(momentum, axis=1) / r**2
        tangential = np.cross(momentum / np.linalg.norm(momentum, axis=1)[:, None], radial)
        step = 1e-3 * r[:, None] * radial
        pull = ((host.force(x + step) - host.force(x - step)) * radial).sum(1) / (2e-3 * r)
        tidal = np.cbrt(agama.G * mass / np.abs(omega**2 + pull))
        # Fardal et al. (2015): a tidal radius in or out, with its velocity, and their scatter.
        n = PARTICLES // STEPS
        side = np.tile([-1.0, 1.0], n // 2)
        kick = random.normal([2.0, 0.3, 0.0, 0.0], [0.5, 0.5, 0.5, 0.5], size=(STEPS, n, 4))
        unit = (tidal[:, None] * side)[..., None]
        position = x[:, None] + unit * (kick[..., :1] * radial[:, None])
        velocity = v[:, None] + unit * omega[:, None, None] * (kick[..., 1:2] * kick[..., :1] * tangential[:, None])
        start = np.repeat(times[1:], n)
        sphere = agama.Potential(
            type="Plummer", mass=mass, scaleRadius=POINT["r_s_prog_kpc"], center=np.column_stack([times, path])[::-1]
        )
        agama.orbit(
            potential=agama.Potential(host, sphere), ic=np.concatenate([position, velocity], axis=2).reshape(-1, 6),
            timestart=start, time=-start, trajsize=1, accuracy=1e-4, verbose=False, separateTime=True,
        )

    run()
    return Timed(run)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("oblate")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--calls", type=int, default=61, help="calls of a job at each of its turns")
    parser.add_argument("--without", nargs="*", default=[], choices=["streamax", "gala", "agama"])
    args = parser.parse_args()
    jobs = {
        f"oblate value, {args.threads} threads": Oblate(args.oblate, False, args.threads),
        f"oblate gradient, {args.threads} threads": Oblate(args.oblate, True, args.threads),
        "oblate value, 1 thread": Oblate(args.oblate, False, 1),
        "oblate gradient, 1 thread": Oblate(args.oblate, True, 1),
    }
    if "streamax" not in args.without:
        jobs["StreaMAX value"], jobs["StreaMAX gradient"] = streamax()
    if "gala" not in args.without:
        jobs["gala stream"] = gala()
    if "agama" not in args.without:
        jobs["agama stream"] = agama()
    times = {name: [] for name in jobs}
    for _ in range(args.rounds + 1):
        for name, job in jobs.items():
            # Some calls at a turn: the first ones find caches cold and threads asleep or on one core, for every tool.
            times[name].append(statistics.median(job.turn(args.calls)))
    # The first round warms up.
    median = {name: statistics.median(list_[1:]) for name, list_ in times.items()}
    cpu = {
        name: statistics.median(job.cpu[args.calls :]) if isinstance(job, Timed) else None for name, job in jobs.items()
    }
    print(f"{PARTICLES} particles, {STEPS} steps; {cpu_name()}; medians of {args.rounds} turns of {args.calls} calls, alternating")
    print("| job | wall ms | CPU ms |\n|---|---|---|")
    for name, seconds in median.items():
        spent = "" if cpu[name] is None else f"{1e3 * cpu[name]:.1f}"
        print(f"| {name} | {1e3 * seconds:.2f} | {spent} |")
    one, one_gradient = median["oblate value, 1 thread"], median["oblate gradient, 1 thread"]
    all_, all_gradient = list(median.values())[:2]
    print(f"\noblate: {1e9 * one / (PARTICLES * STEPS):.2f} ns per particle-step and core, gradient {one_gradient / one:.2f} values")
    if "StreaMAX value" in median:
        print(f"StreaMAX / oblate, wall: value {median['StreaMAX value'] / all_:.1f}, gradient {median['StreaMAX gradient'] / all_gradient:.1f}")
    for name in ("gala", "agama"):
        if f"{name} stream" in median:
            print(f"{name} / oblate, CPU: {cpu[f'{name} stream'] / one:.1f}")


def cpu_name():
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()


if __name__ == "__main__":
    main()
