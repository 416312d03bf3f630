#!/usr/bin/env python3
"""Writes tests/data/independent/<name>.json: ten random readings of every machine in problems/ and the poses that close its loops.

The values come from check_problems.py (NumPy, its own reader and kinematics), not from Gough, at full precision and in the units
of the problem file: {"samples": [{"actuators": [...], "pose": {"position": [...], "quaternion": [w, x, y, z]}}]}. The machines are at
nominal; the readings are drawn from each actuator's `range`, in actuator order. Each pose is that of the mean of the limbs, which agree to 1e-12.

Usage: poses.py [FILE ...]      default: problems/*.json and problems/real/*.json
"""
import glob
import json
import os
import sys

import numpy as np

import check_problems as gp

SAMPLES, SEED = 10, 2017


def sample(machine, rng):
    """A random set of readings and the pose that closes the loops there; readings that do not close are drawn again."""
    while True:
        readings = machine.draw(rng)
        values = [float(v) for v in machine.file_units(readings)]
        # the readings as a reader of the file will see them
        posture = gp.close(machine, np.array([v * j.unit for v, j in zip(values, machine.actuated)]))
        if posture is None:
            continue
        spread = max(np.abs(g - posture.poses[0]).max() for g in posture.poses)
        assert spread < 1e-12, (machine.name, spread)
        g = np.mean(posture.poses, 0)
        position = [float(x / machine.length) for x in g[:3, 3]]
        quaternion = [float(x) for x in gp.quaternion(g[:3, :3])]
        return {"actuators": values, "pose": {"position": position, "quaternion": quaternion}}


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    problems = os.path.join(here, "..", "..", "problems")
    out = os.path.join(here, "..", "data", "independent")
    os.makedirs(out, exist_ok=True)
    files = sys.argv[1:] or sorted(glob.glob(os.path.join(problems, "*.json"))) + sorted(glob.glob(os.path.join(problems, "real", "*.json")))
    for path in files:
        machine = gp.Machine(path)
        rng = np.random.default_rng(SEED)
        lines = ",\n".join("  " + json.dumps(sample(machine, rng)) for _ in range(SAMPLES))
        with open(os.path.join(out, machine.name + ".json"), "w") as f:
            f.write('{ "samples": [\n' + lines + " ] }\n")
        print(machine.name)


if __name__ == "__main__":
    main()
