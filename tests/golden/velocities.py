"""Mean line-of-sight velocities and widths of the five streams of gala_streams.py, bin by bin.

    python velocities.py [k]    # streams_gala/velocities.json; only stream number k

The particles and their final states are gala's; the winding number of each is that of our own integrator, as in
gala_streams.py. z points towards the observer, so that the line-of-sight velocity is -vz.
"""
import json
import math
import os
import sys

import generate as g
import gala_streams as streams
import numpy as np


def bins(s):
    w, _, _, _ = streams.gala_stream(g, s, streams.N_TAIL, s["seed"])
    own = streams.own_stream(g, s, streams.N_TAIL, s["seed"])
    phi = np.degrees(np.arctan2(w[:, 1], w[:, 0]) - math.atan2(s["x"][1], s["x"][0]))
    phi += 360 * np.round((own["dphi"] - phi) / 360)
    v = -w[:, 5] / float(g.KMS)
    r = np.hypot(w[:, 0], w[:, 1])
    number = np.floor(phi / 10).astype(int)
    rows = []
    for b in range(number.min(), number.max() + 1):
        inside = number == b
        n = int(inside.sum())
        if n >= 200:
            numbers = [v[inside].mean(), v[inside].std(), r[inside].mean(), r[inside].std()]
            rows.append([b * 10 + 5, n] + [round(float(x), 5) for x in numbers])
    return rows


path = os.path.join(g.HERE, "streams_gala", "velocities.json")
table = json.load(open(path)) if os.path.exists(path) else {}
table["columns"] = [["phi_deg", "n", "v_km_s", "sd_of_v_km_s", "r_kpc", "sd_of_r_kpc"]]
for k, s in enumerate(streams.STREAMS):
    if len(sys.argv) < 2 or int(sys.argv[1]) == k:
        table[s["name"]] = bins(s)
        with open(path, "w") as f:
            # One bin per line.
            lines = lambda rows: "[\n  " + ",\n  ".join(json.dumps(row) for row in rows) + "\n ]"
            streams_of = [json.dumps(key) + ": " + lines(rows) for key, rows in table.items()]
            f.write("{\n " + ",\n ".join(streams_of) + "\n}\n")
