#!/usr/bin/env python3
"""Writes the benchmark set: purpose and reference outcome of every problem, the problems of problems/stress, the index.

    cargo build --release && python3 tests/generate/benchmark_set.py

Data of the stress problems come from `gough simulate` with the seed in their origin, references from `gough identify`.
"""

import json
import re
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GOUGH = ROOT / "target/release/gough"

# name: (what it stresses, why it is there)
MACHINES = {
    "serial-puma560": (["baseline"], "The arm on which most calibration methods were first tried: every identifier should do well here."),
    "serial-stanford": (["prismatic joint"], "A prismatic joint among revolute ones, where four twists commute instead of two; readings far from zero."),
    "serial-ur10": (["parallel axes"], "Three parallel axes in a row, where Denavit-Hartenberg models are singular."),
    "serial-kuka-lbr": (["redundant arm"], "Seven drives for six freedoms, and four axes on one line at home."),
    "serial-scara": (["lower mobility"], "Four freedoms of the six that are measured; three parallel axes and a slide along them."),
    "serial-scara-screw": (["helical joint"], "An actuated screw, whose pitch couples the two components that commute with it."),
    "hexapod-6ups": (["dimension", "condition"], "138 structural parameters of which 66 show at first order: the plain pseudo-inverse diverges."),
    "hexapod-6pus": (["dimension"], "Drives stand first in the limb; 78 of 138 parameters show at first order."),
    "hexapod-6rus": (["dimension", "condition"], "150 structural parameters, actuated cranks in place of slides."),
    "hexapod-6ucu": (["passive cylindrical joint"], "Legs that turn about themselves: a freedom that no pose shows."),
    "hexapod-ballscrew": (["passive helical joint"], "Ball screws as they are: a leg that twists changes its length."),
    "hexapod-640": (["scale", "mm and degrees"], "A machine tool of more than two metres, in millimetres and degrees."),
    "hexapod-squat": (["near-singular postures"], "The flat pose that cannot be passed is near: steps must be shortened on the true cost."),
    "tripod-3rps": (["lower mobility"], "The simplest parallel machine: two tilts and a heave, with the parasitic motions that go with them."),
    "tripod-3prs": (["lower mobility"], "Carriages and hinged rods: drives that stand first in limbs with fewer than six freedoms."),
    "tripod-3rrs": (["lower mobility"], "Revolute joints only: 66 parameters, 48 at first order."),
    "tripod-3upu": (["lower mobility", "condition"], "Translation that hangs on three constraints: small errors of the joints turn the platform."),
    "delta-3puu": (["lower mobility", "condition"], "A Delta with rods for parallelograms: only translation, at nominal and nowhere else."),
    "tricept": (["hybrid"], "Three driven legs and a passive mast with constraints of its own."),
    "positioner-321": (["unequal limbs", "scale"], "Limbs with three, two and one drives, metres apart."),
}

# name: (parent, what it stresses, why, recipe, change of the drawing, poses, seed, identifier of the reference)
STRESS = {
    "serial-puma560-outliers": ("serial-puma560", ["outliers"], "One pose in ten is off by fifty standard deviations: only a robust loss keeps its accuracy.",
        {"outliers": {"share": 0.1, "factor": 50.0}}, {}, 60, 21, "conic-huber"),
    "tripod-3rps-outliers": ("tripod-3rps", ["outliers"], "Gross errors on a closed loop, where they also spoil the start of the passive joints.",
        {"outliers": {"share": 0.05, "factor": 100.0}}, {}, 60, 22, "conic-huber"),
    "serial-kuka-lbr-sparse": ("serial-kuka-lbr", ["sparse truth"], "Two links are off by five tolerances, all others are as drawn: a sparse penalty should find them.",
        {"links_off": 2, "distance": 5.0}, {}, 40, 23, "conic-group-lasso"),
    "serial-ur10-bounds": ("serial-ur10", ["tight bounds"], "Bounds at half a tolerance, which the truth exceeds: limits become active, and cost accuracy where they are believed.",
        {}, {"bounds": 0.5}, 60, 24, "minimal"),
    "serial-puma560-few": ("serial-puma560", ["few poses"], "Four poses, 24 readings for 30 parameters: only the tolerances make it well posed.",
        {"poses": 4}, {}, 4, 25, "map"),
    "hexapod-6ups-few": ("hexapod-6ups", ["few poses", "dimension"], "Ten poses, 60 readings for 138 parameters.",
        {"poses": 10}, {}, 10, 26, "map"),
    "serial-stanford-far": ("serial-stanford", ["bad start"], "Truth ten tolerances from nominal, start fifty tolerances away from it.",
        {"distance": 10.0, "start": 50.0}, {}, 60, 27, "minimal"),
    "tripod-3prs-far": ("tripod-3prs", ["bad start", "near-singular postures"], "Start ten tolerances away on a closed loop: some postures do not close there.",
        {"start": 10.0}, {}, 60, 28, "minimal"),
    "serial-puma560-noise": ("serial-puma560", ["large noise"], "Noise as large as the tolerances: weighing both is worth more than either.",
        {"noise": 20.0}, {}, 60, 29, "map"),
    "serial-scara-position": ("serial-scara", ["position only"], "A tracker that sees one point: fewer parameters show than the structure has.",
        {}, {"kind": "position"}, 60, 30, "minimal"),
}


def inline(value):
    return re.sub(r"\s+", " ", json.dumps(value, ensure_ascii=False))


def with_benchmark(text, benchmark):
    """The file's text with the key `benchmark` behind its description."""
    text = re.sub(r'\n  "benchmark": \{.*\},?(?=\n  ")', "", text)
    return re.sub(r'(\n  "description": ".*",)', lambda m: m[1] + '\n  "benchmark": ' + inline(benchmark) + ",", text, count=1)


def reference(path, solver):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.json"
        subprocess.run([GOUGH, "identify", path, "--solver", solver, "-o", out], check=False, capture_output=True)
        result = json.loads(out.read_text())
    after = result["holdout"]["after"]
    digits = lambda v: None if v is None else float(f"{v:.4g}")
    return {"solver": solver, "position_rms": digits(after["position_rms"]), "rotation_rms": digits(after["rotation_rms"]),
            "practical": result["counts"]["practical"]}


def machines():
    for name, (stresses, purpose) in MACHINES.items():
        path = ROOT / f"problems/{name}.json"
        benchmark = {"purpose": purpose, "stresses": stresses, "reference": reference(path, "minimal")}
        path.write_text(with_benchmark(path.read_text(), benchmark))


def stress():
    (ROOT / "problems/stress").mkdir(exist_ok=True)
    for name, (parent, stresses, purpose, recipe, change, poses, seed, solver) in STRESS.items():
        problem = json.loads((ROOT / f"problems/{parent}.json").read_text())
        problem["name"] = name
        problem["description"] = f"The machine of {parent}. {purpose}"
        benchmark = {"purpose": purpose, "stresses": stresses, **recipe}
        problem["benchmark"] = benchmark
        problem.pop("truth", None)
        problem["data"] = {"noise": dict(problem["data"]["noise"])}
        scale = recipe.get("noise", 1.0)
        if change.get("kind"):
            problem["data"]["kind"] = change["kind"]
            problem["data"]["noise"] = {"length": problem["data"]["noise"]["length"]}
        if change.get("bounds"):
            tolerance = problem["mechanism"]["tolerance"]
            problem["mechanism"]["bounds"] = {k: v * change["bounds"] for k, v in tolerance.items()}
        # The stated noise is that of the data; a campaign need not scale it again.
        problem["data"]["noise"] = {k: v * scale for k, v in problem["data"]["noise"].items()}
        benchmark.pop("noise", None)
        path = ROOT / f"problems/stress/{name}.json"
        with tempfile.TemporaryDirectory() as folder:
            bare = Path(folder) / f"{name}.json"
            bare.write_text(json.dumps(problem))
            distance = str(recipe.get("distance", 1.0))
            subprocess.run([GOUGH, "simulate", bare, "--poses", str(poses), "--seed", str(seed), "--distance", distance, "-o", path], check=True)
        text = path.read_text()
        start, end = text.index('\n  "benchmark": {'), text.index('\n  "units": {')
        text = text[:start] + text[end:]
        path.write_text(with_benchmark(text, benchmark))
        benchmark["reference"] = reference(path, solver)
        path.write_text(with_benchmark(path.read_text(), benchmark))


def index():
    lines = [
        "# The benchmark set", "",
        "Every problem is one file: a machine as drawn, tolerances, noise, simulated measurements with hold-out, and the true",
        "machine. Its key `benchmark` says why it is there; the table below is made from it. `gough compare problems/*.json`",
        "draws new truths and data by it, `--own-data` takes those in the files. The reference is what the identifier named gives",
        "on the file's own data: root mean square errors on the hold-out, in units of the file, and the practical count.",
        "[docs/benchmark.md](../docs/benchmark.md) holds the standing of all identifiers. Made by",
        "`python3 tests/generate/benchmark_set.py`, checked by `tests/benchmark_set.rs`.", "",
        "| problem | parameters | stresses | why it is there | reference | position | rotation | practical |",
        "| --- | ---: | --- | --- | --- | ---: | ---: | ---: |",
    ]
    paths = [ROOT / f"problems/{n}.json" for n in MACHINES] + [ROOT / f"problems/stress/{n}.json" for n in STRESS]
    for path in paths:
        problem = json.loads(path.read_text())
        b, r, u = problem["benchmark"], problem["benchmark"]["reference"], problem["units"]
        seen = json.loads(subprocess.run([GOUGH, "analyze", path, "--json"], check=True, capture_output=True).stdout)
        rotation = "-" if r["rotation_rms"] is None else f"{r['rotation_rms']:g} {u['angle']}"
        name = path.relative_to(ROOT / "problems")
        lines.append(f"| [{name.with_suffix('')}]({name}) | {seen['counts']['structural']} | {', '.join(b['stresses'])} | {b['purpose']} "
                     f"| {r['solver']} | {r['position_rms']:g} {u['length']} | {rotation} | {r['practical']} |")
    lines += ["", "`problems/real/` holds machines whose measurements are not part of this project (docs/real-data.md)."]
    (ROOT / "problems/README.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    machines()
    stress()
    index()
