#!/usr/bin/env python3
"""Writes tests/data/independent/formats/<name>.json: poses of the machines in tests/data/formats by other people's libraries.

URDF arms by Pinocchio (pip install pin), the hexapod by MuJoCo (pip install mujoco): its kinematics and its constraint residuals,
brought to zero by Newton's method here. Values in m and rad at full precision:
{"samples": [{"actuators": [...], "pose": {"position": [...], "quaternion": [w, x, y, z]}}]}. Readings are in actuator order.

The Denavit-Hartenberg table is multiplied out with NumPy alone.
"""
import csv
import json
import os

import mujoco
import numpy as np
import pinocchio

HERE = os.path.dirname(os.path.abspath(__file__))
MODELS = os.path.join(HERE, "..", "data", "formats")
OUT = os.path.join(HERE, "..", "data", "independent", "formats")
SAMPLES, SEED, STRIDES = 12, 2017, 20


def quaternion(r):
    """[w, x, y, z] of a rotation matrix, by its largest component."""
    four = np.array([np.trace(r), r[0, 0], r[1, 1], r[2, 2]])
    four[1:] = 2 * four[1:] - np.trace(r)
    i = int(np.argmax(four))
    q = np.empty(4)
    q[i] = 0.5 * np.sqrt(1 + four[i])
    cross = {1: r[2, 1] - r[1, 2], 2: r[0, 2] - r[2, 0], 3: r[1, 0] - r[0, 1]}
    for j in range(4):
        if j == i:
            continue
        if 0 in (i, j):
            q[j] = cross[i + j] / (4 * q[i])
        else:
            q[j] = (r[i - 1, j - 1] + r[j - 1, i - 1]) / (4 * q[i])
    return q / np.linalg.norm(q)


def sample(readings, r, p):
    pose = {"position": [float(v) for v in p], "quaternion": [float(v) for v in quaternion(r)]}
    return {"actuators": [float(v) for v in readings], "pose": pose}


def write(name, samples):
    os.makedirs(OUT, exist_ok=True)
    with open(os.path.join(OUT, name + ".json"), "w") as f:
        f.write('{ "samples": [\n' + ",\n".join("  " + json.dumps(s) for s in samples) + " ] }\n")
    print(name, len(samples))


def urdf(name, base, tool, joints):
    model = pinocchio.buildModelFromUrdf(os.path.join(MODELS, name + ".urdf"))
    data = model.createData()
    rng = np.random.default_rng(SEED)
    samples = []
    for _ in range(SAMPLES):
        q = pinocchio.neutral(model)
        readings = []
        for joint in joints:
            number = model.getJointId(joint)
            at, size = model.joints[number].idx_q, model.joints[number].nq
            if size == 2:  # a continuous joint is a point of the circle
                value = rng.uniform(-np.pi, np.pi)
                q[at : at + 2] = np.cos(value), np.sin(value)
            else:
                value = rng.uniform(model.lowerPositionLimit[at], model.upperPositionLimit[at])
                q[at] = value
            readings.append(value)
        pinocchio.framesForwardKinematics(model, data, q)
        place = lambda link: data.oMf[model.getFrameId(link)]
        g = place(base).actInv(place(tool))
        samples.append(sample(readings, g.rotation, g.translation))
    write(name, samples)


def closed(model, data, others):
    """Newton's method on the equality constraints, driven coordinates held; the largest residual that is left."""
    worst = np.inf
    for _ in range(60):
        mujoco.mj_forward(model, data)
        equal = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        error = data.efc_pos[equal].copy()
        jac = data.efc_J.reshape(-1, model.nv)[equal][:, others]
        worst = np.abs(error).max()
        if worst < 3e-15:
            break
        step = np.zeros(model.nv)
        step[others] = np.linalg.lstsq(jac, -error, rcond=1e-10)[0]
        step *= min(1.0, 0.3 / np.abs(step).max())
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    return worst


def mjcf(name, site, joints):
    model = mujoco.MjModel.from_xml_path(os.path.join(MODELS, name + ".xml"))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    driven = [model.joint(joint).dofadr[0] for joint in joints]
    others = [i for i in range(model.nv) if i not in driven]
    rng = np.random.default_rng(SEED)
    samples = []
    while len(samples) < SAMPLES:
        mujoco.mj_resetData(model, data)
        addresses = [model.joint(joint).qposadr[0] for joint in joints]
        home = data.qpos[addresses].copy()
        readings = [rng.uniform(*model.joint(joint).range) for joint in joints]
        # along the path from home, so that the assembly mode stays
        for part in np.linspace(0, 1, STRIDES + 1)[1:]:
            data.qpos[addresses] = home + part * (readings - home) if part < 1 else readings
            worst = closed(model, data, others)
            if worst > 1e-10:
                break
        if worst > 1e-13:
            continue
        mujoco.mj_forward(model, data)
        samples.append(sample(readings, data.site(site).xmat.reshape(3, 3), data.site(site).xpos))
    write(name, samples)


def dh(name, modified):
    rng = np.random.default_rng(SEED)
    with open(os.path.join(MODELS, name + ".csv")) as f:
        rows = list(csv.DictReader(f))

    def rotation(axis, t):
        g, (i, j) = np.eye(4), [(1, 2), (2, 0), (0, 1)][axis]
        g[i, i] = g[j, j] = np.cos(t)
        g[j, i], g[i, j] = np.sin(t), -np.sin(t)
        return g

    def shift(axis, d):
        g = np.eye(4)
        g[axis, 3] = d
        return g

    samples = []
    for _ in range(SAMPLES):
        g, readings = np.eye(4), []
        for row in rows:
            theta, alpha = np.radians(float(row["theta"])), np.radians(float(row["alpha"]))
            d, a = float(row["d"]) / 1000, float(row["a"]) / 1000
            if row["type"] != "F":
                value = rng.uniform(float(row["min"]), float(row["max"]))
                readings.append(value)
                if row["type"] == "R":
                    theta += np.radians(value)
                else:
                    d += value / 1000
            z, x = rotation(2, theta) @ shift(2, d), shift(0, a) @ rotation(0, alpha)
            g = g @ (x @ z if modified else z @ x)
        one = sample(readings, g[:3, :3], g[:3, 3] * 1000)
        samples.append(one)
    write(name + ("-modified" if modified else "-standard"), samples)


if __name__ == "__main__":
    urdf("skew-6r", "world", "tool", ["j1", "j2", "j3", "j4", "j5", "j6"])
    urdf("skew-7", "base", "k6", ["rail", "a1", "a2", "a3", "a4", "a5", "a6"])
    mjcf("hexapod", "probe", ["leg1_s", "leg2_s", "leg3_s", "leg4_s", "leg5_s", "leg6_s"])
    for modified in (False, True):
        dh("table", modified)
