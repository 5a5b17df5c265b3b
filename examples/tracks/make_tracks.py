"""Makes the example tracks from the golden gala streams: python3 examples/tracks/make_tracks.py

Keeps the bins with at least 1 % of a stream's 200,000 particles (the paper's 100 of 10,000) and adds Gaussian noise of 2 %
of the radius, from a fixed seed per stream. Standard library only.
"""
import csv
import json
import math
import pathlib
import random

HERE = pathlib.Path(__file__).parent
GOLDEN = HERE.parent.parent / "tests" / "golden" / "streams_gala"

for number, source in enumerate(sorted(GOLDEN.glob("*_track.csv"))):
    name = source.name.removesuffix("_track.csv")
    truth = json.loads((GOLDEN / f"{name}.json").read_text())
    host = truth["host_and_progenitor"]
    noise = random.Random(20260000 + number)
    rows = []
    for row in csv.DictReader(source.open()):
        if int(row["count"]) < 2000:
            continue
        r = float(row["mean_r_kpc"])
        measured = r * (1 + 0.02 * noise.gauss(0, 1))
        phi = 0.5 * (float(row["dphi_lo_deg"]) + float(row["dphi_hi_deg"]))
        rows.append(f"{phi:g} {measured:.6f} {0.02 * measured:.6f} {row['count']}")
    header = [
        "# %ECSV 1.0",
        "# ---",
        "# datatype:",
        "# - {name: phi, unit: deg, datatype: float64, description: bin centre from the progenitor}",
        "# - {name: r, unit: kpc, datatype: float64, description: mean projected radius}",
        "# - {name: r_err, unit: kpc, datatype: float64, description: 2 per cent of r}",
        "# - {name: n, datatype: int64, description: particles in the bin}",
        "# meta:",
        f"#   name: {name}",
        "#   made_by: gala 1.11.0, 200000 particles; see tests/golden/PROVENANCE.md",
        "#   noise: 2 per cent Gaussian",
        f"#   q_true: {host['q']}",
        "#   bin_width: 10.0",
        "# schema: astropy-2.0",
        "phi r r_err n",
    ]
    (HERE / f"{name}.ecsv").write_text("\n".join(header + rows) + "\n")
    print(name, len(rows), "bins, q =", host["q"])

# The track of docs/tour.md, as an observer may have it: in arcseconds at a distance of 20 Mpc, with errors that differ to both sides, with the
# leading tail at negative phi, counted from a point that is not the progenitor, and without the bins next to the progenitor, which is not seen.
NAME, DISTANCE_MPC, PHI0_DEG = "s0_oblate_tilted", 20.0, 20.0
noise = random.Random(20260100)
rows = []
for row in csv.DictReader((GOLDEN / f"{NAME}_track.csv").open()):
    phi = 0.5 * (float(row["dphi_lo_deg"]) + float(row["dphi_hi_deg"]))
    if int(row["count"]) < 2000 or abs(phi) < 10:
        continue
    r = float(row["mean_r_kpc"]) / (DISTANCE_MPC * 1000) * 180 * 3600 / math.pi
    lo, hi = 0.02 * r, 0.03 * r
    deviation = noise.gauss(0, 1)
    # A radius that came out too large has its truth below.
    r += deviation * (lo if deviation > 0 else hi)
    rows.append(f"{PHI0_DEG - phi:g},{r:.1f},{lo:.1f},{hi:.1f}")
header = [
    "# name: NGC 0000 south",
    "# Made by gala 1.11.0, see make_tracks.py; q = 0.6, the progenitor is at phi = 20 deg, and the leading tail at smaller phi.",
    "# units: phi deg, r arcsec",
    "phi,r,r_err_lo,r_err_hi",
]
(HERE / "ngc0000_south.csv").write_text("\n".join(header + rows[::-1]) + "\n")
