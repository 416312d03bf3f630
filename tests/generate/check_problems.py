#!/usr/bin/env python3
"""An independent check of the machine drawings in problems/.

Reads `gough-problem/1` files with its own reader and its own kinematics (NumPy only; nothing of Gough is used)
and asks of every machine what docs/theory.md assumes of it:

* every limb puts the platform at the same pose at home, and home lies inside the actuators' ranges;
* mobility: the wrenches of the limbs number six, sum(6 - m_i) = 6, m_i the passive joints of limb i;
* each limb's passive twists are independent, and the stacked reciprocal wrenches Jr (6 x 6) are regular, at home and over
  random postures; both are judged with lengths divided by the machine's size (rms distance of the joint points from
  their centroid) and moments taken about the centroid of the platform's joints;
* random readings drawn from `range` close the loops: Newton, led from home along the straight path of readings, never
  through a singularity (the determinant of the loops' passive Jacobian keeps its sign) and never by a leap;
* the numbers of parameters: structural 4r + 2p + 6, and first-order, the rank at nominal over random postures (singular values above
  1e-8 of the largest, complete Jacobian, m and rad). `held` counts the same rank without the links of tolerance 0.

Usage: check_problems.py [FILE ...]      default: problems/*.json and problems/real/*.json
       options: --postures N (50)  --rank-postures N (60)  --seed N (1)
Exit status 1 if a machine fails: a loop does not close at home, mobility is not 6, Jr or a limb is singular, or fewer than 95 % of
postures close. Units inside are m and rad; twists are [w; v], rotation first.
"""
import argparse
import glob
import json
import os
import sys

import numpy as np

LENGTH = {"m": 1.0, "mm": 1e-3}
ANGLE = {"rad": 1.0, "deg": np.pi / 180}
KINDS = {"revolute": "R", "prismatic": "P", "helical": "H", "cylindrical": "RP", "universal": "RR", "spherical": "RRR"}
JOINT_KEYS = {"name", "type", "point", "axis", "axes", "actuated", "home", "pitch", "range", "tolerance", "inner_tolerance",
              "bounds", "inner_bounds"}
LIMB_KEYS = {"name", "joints", "tool", "tolerance", "tool_tolerance", "bounds", "tool_bounds"}

# ---------------------------------------------------------------- rigid motions


def hat(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


IDENTITY = np.eye(4)


def exp_so3(w):
    t = np.linalg.norm(w)
    if t < 1e-8:
        return np.eye(3) + hat(w) + hat(w) @ hat(w) / 2
    k = hat(w / t)
    return np.eye(3) + np.sin(t) * k + (1 - np.cos(t)) * k @ k




def log_se3(g):
    """log of a motion whose angle is well below pi (closing errors)."""
    r, p = g[:3, :3], g[:3, 3]
    a = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    s, c = np.linalg.norm(a), (np.trace(r) - 1) / 2
    t = np.arctan2(s, c)
    w = a * (t / s if s > 1e-9 else 1.0)
    e = 1 / 12 if t < 1e-4 else 1 / t**2 - (1 + np.cos(t)) / (2 * t * np.sin(t))
    return np.r_[w, (np.eye(3) - hat(w) / 2 + e * hat(w) @ hat(w)) @ p]


def inverse(g):
    h = np.eye(4)
    h[:3, :3] = g[:3, :3].T
    h[:3, 3] = -g[:3, :3].T @ g[:3, 3]
    return h


def adjoint(g):
    a = np.zeros((6, 6))
    a[:3, :3] = a[3:, 3:] = g[:3, :3]
    a[3:, :3] = hat(g[:3, 3]) @ g[:3, :3]
    return a


def quaternion(r):
    """[w, x, y, z], w >= 0, of a rotation matrix (the largest of the four components leads)."""
    k = np.array([[r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0], [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                  [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
                  [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)]]) / 3
    q = np.linalg.eigh(k)[1][[3, 0, 1, 2], -1]
    return -q if q[0] < 0 else q


def matrix_of_pose(pose, length, angle):
    g = np.eye(4)
    g[:3, 3] = np.array(pose["position"], float) * length
    if "quaternion" in pose:
        w, *v = np.array(pose["quaternion"], float) / np.linalg.norm(pose["quaternion"])
        g[:3, :3] = np.eye(3) + 2 * w * hat(v) + 2 * hat(v) @ hat(v)
    else:
        g[:3, :3] = exp_so3(np.array(pose["rotation"], float) * angle)
    return g


# ---------------------------------------------------------------- reading


class Joint:
    """One equivalent joint: home twist in {S}, whether it is actuated, and its readings."""

    def __init__(self, name, kind, point, axis, pitch):
        self.name, self.kind, self.point = name, kind, point
        axis = axis / np.linalg.norm(axis)
        self.axis = axis
        if kind == "P":
            self.twist = np.r_[np.zeros(3), axis]
        else:
            self.twist = np.r_[axis, np.cross(point, axis) + pitch * axis]  # pitch in m per rad
        self.actuated, self.home, self.range, self.unit = False, 0.0, None, 1.0
        # exp(twist q) is linear in q, sin q and 1 - cos q
        w, v = self.twist[:3], self.twist[3:]
        k = hat(w)
        self.by_q, self.by_sin, self.by_vers = np.zeros((3, 4, 4))
        self.by_q[:3, 3] = v + k @ k @ v
        self.by_sin[:3] = np.c_[k, -k @ k @ v]
        self.by_vers[:3] = np.c_[k @ k, k @ v]

    def motion(self, q):
        return IDENTITY + q * self.by_q + np.sin(q) * self.by_sin + (1 - np.cos(q)) * self.by_vers


class Limb:
    pass


class Machine:
    def __init__(self, path):
        with open(path) as f:
            doc = json.load(f)
        assert doc["format"] == "gough-problem/1", path
        self.name, self.doc = doc["name"], doc
        length, angle = LENGTH[doc["units"]["length"]], ANGLE[doc["units"]["angle"]]
        self.length, self.angle = length, angle
        mech = doc["mechanism"]
        common = mech.get("tolerance")
        self.limbs = []
        for entry in mech["limbs"]:
            unknown = set(entry) - LIMB_KEYS
            assert not unknown, f"{self.name}: {entry['name']}: unknown {unknown}"
            limb = Limb()
            limb.name = entry["name"]
            limb.tool = matrix_of_pose(entry.get("tool", mech["tool"]), length, angle)
            limb.joints, limb.held = [], []
            for j in entry["joints"]:
                unknown = set(j) - JOINT_KEYS
                assert not unknown, f"{self.name}: {limb.name}.{j['name']}: unknown {unknown}"
                self.add_joint(limb, j, entry.get("tolerance", common))
            limb.held.append(tolerance_flags(entry.get("tool_tolerance", entry.get("tolerance", common))))
            limb.passive = [k for k, j in enumerate(limb.joints) if not j.actuated]
            names = [j["name"] for j in entry["joints"]]
            assert len(set(names)) == len(names), f"{self.name}: {limb.name}: joint names repeat"
            self.limbs.append(limb)
        self.actuated = [j for limb in self.limbs for j in limb.joints if j.actuated]
        points = np.array([j.point for limb in self.limbs for j in limb.joints])
        self.size = np.sqrt(((points - points.mean(0))**2).sum(1).mean())

    def add_joint(self, limb, j, default):
        kinds = KINDS[j["type"]]
        axes = j["axes"] if "axes" in j else [j["axis"]] * len(kinds)
        assert len(axes) == len(kinds), f"{self.name}: {limb.name}.{j['name']}: {len(kinds)} axes wanted"
        pitch = j.get("pitch", 0.0) * self.length / (2 * np.pi)
        each = lambda key, none: j[key] if isinstance(j.get(key), list) else [j.get(key, none)] * len(kinds)
        actuated, home = each("actuated", False), each("home", 0.0)
        ranges = j.get("range")
        if len(kinds) == 1:
            ranges = [ranges]
        elif ranges is None:
            ranges = [None] * len(kinds)
        for k, kind in enumerate(kinds):
            e = Joint(f"{limb.name}.{j['name']}", kind, np.array(j["point"], float) * self.length, np.array(axes[k], float), pitch)
            e.actuated = actuated[k]
            e.unit = self.length if kind == "P" else self.angle
            e.home = (home[k] or 0.0) * e.unit
            if e.actuated and ranges[k] is not None:
                e.range = np.array(ranges[k], float) * e.unit
            limb.joints.append(e)
            inner = j.get("inner_tolerance", default)
            limb.held.append(tolerance_flags(j.get("tolerance", default) if k == 0 else inner))

    def draw(self, rng):
        """Random readings (m, rad) from the ranges, in actuator order."""
        return np.array([rng.uniform(*j.range) for j in self.actuated])

    def file_units(self, readings):
        return [q / j.unit for q, j in zip(readings, self.actuated)]


def tolerance_flags(tol):
    """6 booleans, rotation first: is this link held at nominal (tolerance 0)?"""
    if tol is None or tol == "free":
        return [False] * 6
    one = lambda t: [t != "free" and t == 0] * 3
    return one(tol["angle"]) + one(tol["length"])


# ---------------------------------------------------------------- kinematics


class Posture:
    """Joint variables (relative to home) of every limb, and what follows from them."""

    def __init__(self, machine, theta):
        self.theta = theta
        self.poses, self.prefix, self.twists = [], [], []
        for limb, th in zip(machine.limbs, theta):
            g, pre, tw = IDENTITY, [IDENTITY], []
            for joint, q in zip(limb.joints, th):
                w = g[:3, :3] @ joint.twist[:3]
                tw.append(np.concatenate((w, g[:3, :3] @ joint.twist[3:] + hat(g[:3, 3]) @ w)))
                g = g @ joint.motion(q)
                pre.append(g)
            self.poses.append(g @ limb.tool)
            self.prefix.append(pre)
            self.twists.append(np.array(tw).T)

    def closure(self, machine):
        """Residual of the loops and its Jacobian by the passive variables (square when mobility is right)."""
        n = len(machine.limbs)
        sizes = np.cumsum([0] + [len(limb.passive) for limb in machine.limbs])
        res, jac = np.zeros(6 * (n - 1)), np.zeros((6 * (n - 1), sizes[-1]))
        for i in range(n - 1):
            d = self.poses[i + 1] @ inverse(self.poses[i])
            rows = slice(6 * i, 6 * i + 6)
            res[rows] = log_se3(d)
            jac[rows, sizes[i]:sizes[i + 1]] = -adjoint(d) @ self.twists[i][:, machine.limbs[i].passive]
            jac[rows, sizes[i + 1]:sizes[i + 2]] = self.twists[i + 1][:, machine.limbs[i + 1].passive]
        return res, jac

    def scaled_passive(self, machine, i):
        """Passive twists of limb i about the platform's centre, lengths divided by the machine's size."""
        last = [self.prefix[k][-2] @ np.r_[limb.joints[-1].point, 1] for k, limb in enumerate(machine.limbs)]
        centre = np.mean(last, 0)[:3]
        t = self.twists[i][:, machine.limbs[i].passive].copy()
        t[3:] = (t[3:] + np.cross(t[:3], centre, axis=0)) / machine.size
        return t

    def conditions(self, machine):
        """(condition of Jr, worst smallest/largest singular value of a limb's passive twists)."""
        rows, worst = [], 1.0
        for i, limb in enumerate(machine.limbs):
            t = self.scaled_passive(machine, i)
            if t.shape[1]:
                s = np.linalg.svd(t, compute_uv=False)
                worst = min(worst, s[-1] / s[0])
            rows.append(np.linalg.svd(t.T, full_matrices=True)[2][t.shape[1]:] if t.shape[1] else np.eye(6))
        s = np.linalg.svd(np.vstack(rows), compute_uv=False)
        return (s[0] / s[-1] if len(s) == 6 and s[-1] > 0 else np.inf), worst

    def error_jacobian(self, machine):
        """dy / dx, 6 x sum 6(f_i + 1): Jr^-1 blockdiag(W_i Phi_i)."""
        w, blocks = [], []
        for i, limb in enumerate(machine.limbs):
            phi = np.hstack([adjoint(p) for p in self.prefix[i]])
            t = self.twists[i][:, limb.passive]
            wi = np.linalg.svd(t.T, full_matrices=True)[2][t.shape[1]:] if t.shape[1] else np.eye(6)
            w.append(wi)
            blocks.append(wi @ phi)
        full = np.zeros((6, sum(b.shape[1] for b in blocks)))
        row = col = 0
        for b in blocks:
            full[row:row + b.shape[0], col:col + b.shape[1]] = b
            row, col = row + b.shape[0], col + b.shape[1]
        return np.linalg.solve(np.vstack(w), full)


def home_posture(machine):
    return Posture(machine, [np.zeros(len(limb.joints)) for limb in machine.limbs])


def newton(machine, theta, readings, leap=0.7):
    """Passive variables that close the loops at these readings, from theta; None if it fails or leaps away."""
    theta = [t.copy() for t in theta]
    values = iter(readings)
    for limb, th in zip(machine.limbs, theta):
        for k, j in enumerate(limb.joints):
            if j.actuated:
                th[k] = next(values) - j.home
    before = np.inf
    for _ in range(12):
        post = Posture(machine, theta)
        if len(machine.limbs) == 1:
            return post
        res, jac = post.closure(machine)
        err = np.abs(res).max()
        if err < 1e-13 or (err < 1e-11 and err > 0.5 * before):
            return post
        before = err
        try:
            step = -np.linalg.solve(jac, res)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(step).all() or np.abs(step).max() > leap:
            return None
        k = 0
        for limb, th in zip(machine.limbs, theta):
            th[limb.passive] += step[k:k + len(limb.passive)]
            k += len(limb.passive)
    return None


def close(machine, readings, path=4):
    """Posture at these readings, led from home in `path` strides halved where needed; None if the loops do not close there."""
    home = np.array([j.home for j in machine.actuated])
    post = newton(machine, home_posture(machine).theta, home)
    if post is None or len(machine.limbs) == 1:
        return newton(machine, home_posture(machine).theta, readings) if len(machine.limbs) == 1 else None
    sign = np.linalg.slogdet(post.closure(machine)[1])[0]
    done, stride = 0.0, 1.0 / path
    while done < 1.0:
        to = min(1.0, done + stride)
        nxt = newton(machine, post.theta, home + to * (readings - home))
        if nxt is None or np.linalg.slogdet(nxt.closure(machine)[1])[0] != sign:
            stride /= 2
            if stride < 1e-4:
                return None
            continue
        post, done = nxt, to
    return post


# ---------------------------------------------------------------- the check


def check(path, postures, rank_postures, seed):
    m = Machine(path)
    faults = []
    wrenches = sum(6 - len(limb.passive) for limb in m.limbs)
    if wrenches != 6:
        faults.append(f"sum(6 - m) = {wrenches}")
    home = home_posture(m)
    gap = max(np.abs(p - home.poses[0]).max() for p in home.poses)
    if gap > 0:
        faults.append(f"home open by {gap:.1e}")
    for j in m.actuated:
        if j.range is None:
            faults.append(f"{j.name}: no range")
        elif not j.range[0] <= j.home <= j.range[1]:
            faults.append(f"{j.name}: home outside range")
    if faults:
        print(f"{m.name}: FAILED: {'; '.join(faults)}")
        return False

    r = sum(j.kind != "P" for limb in m.limbs for j in limb.joints)
    p = sum(j.kind == "P" for limb in m.limbs for j in limb.joints)
    cond_home, worst_home = home.conditions(m)
    rng = np.random.default_rng(seed)
    conds, worsts, shifts, turns, jacs = [], [], [], [], []
    tried = closed = 0
    while tried < postures or len(jacs) < rank_postures:
        tried += 1
        post = close(m, m.draw(rng))
        if post is not None:
            c, w = post.conditions(m)
            if tried <= postures:
                closed += 1
                conds.append(c)
                worsts.append(w)
                shifts.append(np.linalg.norm(post.poses[0][:3, 3] - home.poses[0][:3, 3]))
                rel = post.poses[0][:3, :3] @ home.poses[0][:3, :3].T
                turns.append(np.degrees(2 * np.arccos(min(1.0, quaternion(rel)[0]))))
            if len(jacs) < rank_postures:
                jacs.append(post.error_jacobian(m))
        if tried > 10 * (postures + rank_postures):
            break
    jac = np.vstack(jacs) if jacs else np.zeros((1, 1))
    s = np.linalg.svd(jac, compute_uv=False)
    rank = int((s > 1e-8 * s[0]).sum())
    tail = s[rank] / s[0] if rank < len(s) else 0.0
    held = np.concatenate([np.concatenate(limb.held) for limb in m.limbs])
    held_rank = None
    if held.any():
        sh = np.linalg.svd(jac[:, ~held], compute_uv=False)
        held_rank = int((sh > 1e-8 * sh[0]).sum())

    fraction = closed / postures
    if fraction < 0.95:
        faults.append("too few postures close")
    if cond_home > 1e6 or worst_home < 1e-3:
        faults.append("singular at home")
    if conds and (max(conds) > 1e6 or min(worsts) < 1e-3):
        faults.append("singular in the workspace")
    conds = conds or [np.inf]
    print(f"{m.name:24s} limbs {len(m.limbs)} act {len(m.actuated)} r {r:2d} p {p} | N {4 * r + 2 * p + 6:3d} first-order {rank:3d}"
          f" (last {s[rank - 1] / s[0]:.0e}, next {tail:.0e})" + (f" held {held_rank}" if held_rank is not None else "") +
          f" | size {m.size:.3f} m | Jr home {cond_home:.1f}, {min(conds):.1f}..{max(conds):.1f} | limb {min([worst_home] + worsts):.3f}"
          f" | closes {100 * fraction:.0f} % | reach {max(shifts or [0]):.3f} m, {max(turns or [0]):.0f} deg"
          + (f" | FAILED: {'; '.join(faults)}" if faults else ""))
    return not faults


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    parser = argparse.ArgumentParser(description="independent check of the machine drawings")
    parser.add_argument("files", nargs="*")
    parser.add_argument("--postures", type=int, default=50)
    parser.add_argument("--rank-postures", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    root = os.path.join(here, "..", "..", "problems")
    files = a.files or sorted(glob.glob(os.path.join(root, "*.json"))) + sorted(glob.glob(os.path.join(root, "real", "*.json")))
    good = [check(f, a.postures, a.rank_postures, a.seed) for f in files]
    print(f"{sum(good)} of {len(good)} pass")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
