#!/usr/bin/env python3
"""Writes problems/kinds: machines of problems/ measured by other instruments than a pose of every posture.

    cargo build --release && python3 tests/generate/kinds_set.py

Data come from `gough simulate` with the seed in the table below, which their origin states.
"""

import json
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GOUGH = ROOT / "target/release/gough"

NOISE = {"angle": 2e-5, "length": 1e-5}


def target(offset, tolerance):
    return {"offset": offset, "tolerance": tolerance}


# name: (parent, data, numbers of postures, hold-out, seed)
KINDS = {
    "hexapod-6ups-distance": (
        "hexapod-6ups",
        {
            "kind": "distance",
            "noise": {"length": 1e-5},
            "instrument": {
                "targets": {
                    "left": target([0.1, 0.02, 0.05], 0),
                    "right": target([-0.06, 0.08, 0.04], 0),
                    "front": target([0.02, -0.1, 0.06], 0),
                },
                "points": {
                    "wire": {"position": [0.5, 0.1, 0.2], "tolerance": 0.001},
                    "bar": {"position": [-0.4, 0.5, 0.1]},
                    "laser": {"position": [-0.3, -0.5, 1.5]},
                },
                "gauges": {"wire": {"zero": -0.1, "zero_tolerance": 0.001, "scale_tolerance": 1e-4}},
            },
        },
        [150],
        20,
        31,
    ),
    "hexapod-6ups-plane": (
        "hexapod-6ups",
        {
            "kind": "plane",
            "noise": {"length": 1e-5},
            "instrument": {
                "targets": {"probe": target([0.05, 0.02, 0.05], 0.0005)},
                "planes": {
                    "bed": {"normal": [0.1, -0.05, 1], "offset": 0.94, "tolerance": "free"},
                    "slope": {"normal": [-0.2, 0.1, 1], "offset": 0.93, "tolerance": "free"},
                },
            },
        },
        [120],
        20,
        32,
    ),
    "serial-puma560-position": (
        "serial-puma560",
        {
            "kind": "position",
            "noise": {"length": 1e-5},
            "instrument": {
                "targets": {
                    "t1": target([0.1, 0.0, 0.05], 0.005),
                    "t2": target([-0.06, 0.08, 0.04], 0.005),
                    "t3": target([-0.05, -0.09, 0.02], 0.005),
                }
            },
        },
        [60],
        20,
        33,
    ),
    "serial-puma560-mixed": (
        "serial-puma560",
        {"noise": NOISE, "sets": [{"kind": "position"}, {"kind": "pose"}]},
        [60, 6],
        20,
        34,
    ),
    "hexapod-6ups-passive": (
        "hexapod-6ups",
        {"kind": "passive-joint", "noise": {"angle": 2e-5}, "joints": [f"limb{i}.base.{j}" for i in range(1, 7) for j in (1, 2)]},
        [40],
        20,
        35,
    ),
    "delta-3puu-separation": (
        "delta-3puu",
        {"kind": "separation", "noise": {"length": 0.01}},
        [90],
        20,
        36,
    ),
}


def main():
    (ROOT / "problems/kinds").mkdir(exist_ok=True)
    for name, (parent, data, counts, holdout, seed) in KINDS.items():
        problem = json.loads((ROOT / f"problems/{parent}.json").read_text())
        for key in ("truth", "benchmark", "description"):
            problem.pop(key, None)
        problem.update(name=name, data=data)
        poses = ",".join(map(str, counts))
        with tempfile.TemporaryDirectory() as folder:
            base = Path(folder) / "base.json"
            base.write_text(json.dumps(problem))
            command = [GOUGH, "simulate", base, "--poses", poses, "--holdout", str(holdout), "--seed", str(seed)]
            out = ROOT / f"problems/kinds/{name}.json"
            subprocess.run([*command, "-o", out], check=True)


if __name__ == "__main__":
    main()
