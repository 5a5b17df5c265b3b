"""Tracks of gala's streams with further data: python3 examples/tracks/make_data_tracks.py FOLDER

For each of the five streams of make_tracks.py a folder with its track alone (radii.ecsv), with mean velocities (velocities.ecsv), with widths (widths.ecsv),
with densities (densities.ecsv) and with all three (all.ecsv); and known_orbit.toml, settings of a fit that knows the age, the scale radii and the present
position and velocity of the progenitor. The values are those of gala's 200,000 particles (tests/golden/streams_gala/velocities.json) with Gaussian
noise from a fixed seed per stream: 5 km/s for velocities, 10 % for widths and densities. Standard library only.
"""
import json
import pathlib
import random
import sys

HERE = pathlib.Path(__file__).parent
GOLDEN = HERE.parent.parent / "tests" / "golden" / "streams_gala"
VELOCITY_ERROR_KM_S, WIDTH_ERROR, DENSITY_ERROR = 5.0, 0.1, 0.1
# The stars of an observed stream.
STARS = 10000
SETS = {"radii": "", "velocities": "v", "widths": "width", "densities": "density", "all": "v width density"}

out = pathlib.Path(sys.argv[1])
table = json.loads((GOLDEN / "velocities.json").read_text())
for number, source in enumerate(sorted(HERE.glob("s*_*.ecsv"))):
    name = source.stem
    noise = random.Random(20261130 + number)
    measured = {}
    for phi, n, v, _, _, width in table[name]:
        density = n * STARS / 200000 / 10
        values = {
            "v": (v + VELOCITY_ERROR_KM_S * noise.gauss(0, 1), VELOCITY_ERROR_KM_S),
            "width": (width * (1 + WIDTH_ERROR * noise.gauss(0, 1)), WIDTH_ERROR * width),
            "density": (density * (1 + DENSITY_ERROR * noise.gauss(0, 1)), DENSITY_ERROR * density),
        }
        measured[phi] = {key: f"{value:.4f},{error:.4f}" for key, (value, error) in values.items()}
    rows = [line.split() for line in source.read_text().splitlines() if not line.startswith("#")][1:]
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    for file, columns in SETS.items():
        columns = columns.split()
        head = ",".join(["phi,r,r_err"] + [f"{c},{c}_err" for c in columns])
        lines = [",".join([phi, r, r_err] + [measured[int(phi)][c] for c in columns]) for phi, r, r_err, _ in rows]
        (folder / f"{file}.csv").write_text("\n".join([f"# name: {name} {file}", "# bin_width: 10", head] + lines) + "\n")
    truth = json.loads((GOLDEN / f"{name}.json").read_text())
    host = truth["host_and_progenitor"]
    x, v = truth["progenitor_final_x_kpc"], truth["progenitor_final_v_kms"]
    known = {"r_s_halo_kpc": host["Rs"], "r_s_prog_kpc": host["a"], "x0_kpc": x[0], "z0_kpc": x[2], "vx0_km_s": v[0], "vy0_km_s": v[1], "vz0_km_s": v[2], "age_gyr": host["T"]}
    (folder / "known_orbit.toml").write_text("[prior.fixed]\n" + "".join(f"{key} = {value}\n" for key, value in known.items()))
    print(folder, len(rows), "bins, q =", host["q"])
