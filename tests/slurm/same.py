"""Compares the results of two studies: every file but logs, checkpoints, the page and what Slurm wrote, without times and command lines."""

import json
import pathlib
import sys


def is_left_out(path):
    return path.parts[0] == "slurm" or path.name in ("log.jsonl", "report.html") or path.name.startswith("checkpoint")


def content(path):
    if path.name != "summary.json":
        return path.read_bytes()
    summary = json.loads(path.read_text())
    del summary["command"], summary["cost"]["cpu_seconds"], summary["cost"]["wall_seconds"]
    return summary


def files(folder):
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder): content(path) for path in paths if not is_left_out(path.relative_to(folder))}


one, other = (files(pathlib.Path(folder)) for folder in sys.argv[1:])
assert len(one) > 60, f"only {len(one)} files"
differ = [str(name) for name in sorted(one.keys() | other.keys()) if one.get(name) != other.get(name)]
assert not differ, f"these files differ: {differ}"
print(f"{len(one)} files are the same")
