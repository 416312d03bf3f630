#!/usr/bin/env python3
"""Writes tests/data/cases/bounds/scipy.json: what SciPy makes of identifications within limits (docs/theory.md (9.1), (9.2)).

The machines are those of check_problems.py (NumPy, its own reader and kinematics; nothing of Gough is used), the Jacobian is
the paper's (12), the equivalent description without redundancy is found by moving links along twists that commute with joints. Boxes are
solved by scipy.optimize.least_squares (trf), cones by scipy.optimize.minimize (trust-constr), the prior's weights renewed
at each end until they no longer change the value.

Usage: bounded.py      (NumPy and SciPy; some minutes)
"""
import json
import os

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, least_squares, minimize

import check_problems as gp

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.join(HERE, "..", "..")
TIE = 1e-7
# problem, limit on every component, limit on every link (tolerances)
PROBLEMS = [
    ("tests/data/cases/bounds/bounded-arm-5r.json", 1.2, None),
    ("problems/serial-puma560.json", 0.8, None),
    ("problems/serial-scara.json", 1.0, None),
    ("tests/data/cases/bounds/bounded-arm-5r.json", 0.5, None),
    ("tests/data/cases/bounds/bounded-arm-5r.json", None, 1.6),
]


def exp_se3(xi):
    w, v = xi[:3], xi[3:]
    t = np.linalg.norm(w)
    k = gp.hat(w)
    b, c = ((1 - np.cos(t)) / t**2, (t - np.sin(t)) / t**3) if t > 1e-4 else (0.5 - t**2 / 24, 1 / 6 - t**2 / 120)
    g = np.eye(4)
    g[:3, :3] = gp.exp_so3(w)
    g[:3, 3] = (np.eye(3) + b * k + c * k @ k) @ v
    return g


def left_jacobian(xi):
    """A(xi) = sum ad(xi)^k / (k + 1)!"""
    z = np.zeros((6, 6))
    z[:3, :3] = z[3:, 3:] = gp.hat(xi[:3])
    z[3:, :3] = gp.hat(xi[3:])
    total, term = np.eye(6), np.eye(6)
    for k in range(1, 18):
        term = term @ z / (k + 1)
        total = total + term
    return total


def frame(point, axis):
    z = axis / np.linalg.norm(axis)
    seed = np.zeros(3)
    seed[np.argmin(np.abs(z))] = 1
    x = np.cross(seed, z)
    x /= np.linalg.norm(x)
    g = np.eye(4)
    g[:3, :3], g[:3, 3] = np.c_[x, np.cross(z, x), z], point
    return g


def unit(i):
    return np.eye(6)[i]


class Limb:
    """Nominal links, and the twists by which descriptions of the limb differ."""

    def __init__(self, limb):
        frames = [frame(j.point, j.axis) for j in limb.joints] + [limb.tool]
        before = [np.eye(4)] + frames[:-1]
        self.links = [gp.inverse(a) @ b for a, b in zip(before, frames)]
        self.rate = None
        # (link before, twist, whether the link behind gives it back)
        self.changes = []
        for k, joint in enumerate(limb.joints):
            commuting = [2, 5] if joint.kind != "P" else [2, 3, 4, 5]
            self.changes += [(k, unit(i), True) for i in commuting]
            if not joint.actuated:
                assert joint.kind in "RP"
                self.changes.append((k, unit(2 if joint.kind == "R" else 5), False))

    def deviated(self, d):
        return [g @ exp_se3(x) for g, x in zip(self.links, d.reshape(-1, 6))]

    def moved(self, links, amounts):
        links = list(links)
        for (k, twist, back), amount in zip(self.changes, amounts):
            h = exp_se3(twist * amount)
            links[k] = links[k] @ h
            if back:
                links[k + 1] = gp.inverse(h) @ links[k + 1]
        return links

    def deviations(self, links):
        return np.concatenate([gp.log_se3(gp.inverse(n) @ g) for n, g in zip(self.links, links)])

    def rates(self, links, sigma):
        step = 1e-5
        columns = []
        for c in range(len(self.changes)):
            a = np.zeros(len(self.changes))
            a[c] = step
            columns.append((self.deviations(self.moved(links, a)) - self.deviations(self.moved(links, -a))) / (2 * step) / sigma)
        return np.array(columns).T

    def smallest(self, d, sigma, slice_):
        """Deviations of the equivalent description with nothing along the redundancy at nominal."""
        links = self.deviated(d)
        if self.rate is None:
            self.rate = slice_.T @ self.rates(self.links, sigma)
        for _ in range(60):
            along = slice_.T @ (self.deviations(links) / sigma)
            if np.linalg.norm(along) < 1e-12:
                break
            links = self.moved(links, -np.linalg.solve(self.rate, along))
        return self.deviations(links)


class Problem:
    def __init__(self, path, box):
        self.machine = gp.Machine(path)
        doc = self.machine.doc
        length, angle = self.machine.length, self.machine.angle
        tolerance = doc["mechanism"]["tolerance"]
        of_link = np.repeat([tolerance["angle"] * angle, tolerance["length"] * length], 3)
        noise = doc["data"]["noise"]
        self.noise = np.repeat([noise["angle"] * angle, noise["length"] * length], 3)
        self.limbs = [Limb(limb) for limb in self.machine.limbs]
        self.sigma = [np.tile(of_link, len(limb.links)) for limb in self.limbs]
        self.sizes = np.cumsum([0] + [len(s) for s in self.sigma])
        self.n = self.sizes[-1]
        self.limit = np.full(self.n, box or np.inf)
        self.bases, self.slices = [], []
        for limb, sigma in zip(self.limbs, self.sigma):
            q = np.linalg.qr(limb.rates(limb.links, sigma), mode="complete")[0]
            k = len(limb.changes)
            self.slices.append(q[:, :k])
            self.bases.append(q[:, k:])
        self.readings, self.measured, self.theta = [], [], []
        for sample in doc["data"]["samples"]:
            q = np.array([v * j.unit for v, j in zip(sample["actuators"], self.machine.actuated)])
            posture = gp.close(self.machine, q)
            assert posture is not None
            self.readings.append(q)
            self.theta.append(posture.theta)
            self.measured.append(gp.matrix_of_pose(sample["pose"], length, angle))

    def parts(self, u):
        return [(limb, sigma, u[a:b] * sigma) for limb, sigma, a, b in zip(self.limbs, self.sigma, self.sizes, self.sizes[1:])]

    def deviate(self, u):
        """The machine with these deviations, and what takes du to the twists of (12)."""
        carry = np.zeros((self.n, self.n))
        for (limb, sigma, d), drawn, start in zip(self.parts(u), self.machine.limbs, self.sizes):
            g = np.eye(4)
            joints = []
            for k, link in enumerate(limb.deviated(d)):
                g = g @ link
                at = slice(start + 6 * k, start + 6 * k + 6)
                own = slice(6 * k, 6 * k + 6)
                carry[at, at] = gp.adjoint(g) @ left_jacobian(-d[own]) * sigma[own]
                if k < len(drawn.joints):
                    old = drawn.joints[k]
                    new = gp.Joint(old.name, old.kind, g[:3, 3].copy(), g[:3, 2].copy(), 0.0)
                    new.actuated, new.home, new.range, new.unit = old.actuated, old.home, old.range, old.unit
                    joints.append(new)
                else:
                    tool = g
            yield joints, tool
        self.carry = carry

    def rows(self, u):
        drawn = [(limb.joints, limb.tool) for limb in self.machine.limbs]
        deviated = list(self.deviate(u))
        r, jac, poses = [], [], []
        try:
            for limb, (joints, tool) in zip(self.machine.limbs, deviated):
                limb.joints, limb.tool = joints, tool
            for k, (q, gm) in enumerate(zip(self.readings, self.measured)):
                posture = gp.newton(self.machine, self.theta[k], q)
                assert posture is not None
                g = posture.poses[0]
                w = gp.log_se3(np.block([[g[:3, :3] @ gm[:3, :3].T, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))[:3]
                h = np.eye(6)
                h[3:, :3] = -gp.hat(g[:3, 3])
                turn = np.eye(6)
                turn[:3, :3] = np.linalg.inv(left_jacobian(np.r_[w, 0, 0, 0])[:3, :3])
                r.append(np.r_[w, g[:3, 3] - gm[:3, 3]] / self.noise)
                jac.append(turn @ h @ posture.error_jacobian(self.machine) / self.noise[:, None])
                poses.append(g)
        finally:
            for limb, (joints, tool) in zip(self.machine.limbs, drawn):
                limb.joints, limb.tool = joints, tool
        return np.concatenate(r), np.vstack(jac) @ self.carry, poses

    def z_of(self, k, u):
        limb, sigma = self.limbs[k], self.sigma[k]
        return self.bases[k].T @ (limb.smallest(u * sigma, sigma, self.slices[k]) / sigma)

    def z(self, u):
        return np.concatenate([self.z_of(k, u[a:b]) for k, (a, b) in enumerate(zip(self.sizes, self.sizes[1:]))])

    def dz(self, u, step=1e-2):
        rows = []
        for k, (a, b) in enumerate(zip(self.sizes, self.sizes[1:])):
            moves = step * np.eye(b - a)
            columns = [(self.z_of(k, u[a:b] + e) - self.z_of(k, u[a:b] - e)) / (2 * step) for e in moves]
            rows.append(np.hstack([np.zeros((len(columns[0]), a)), np.array(columns).T, np.zeros((len(columns[0]), self.n - b))]))
        return np.vstack(rows)

    def anchors(self, u):
        """Rows on z with the weights that belong to u; none where the data know everything."""
        by_z = self.rows(u)[1] @ np.linalg.pinv(self.dz(u))
        _, s, vt = np.linalg.svd(by_z)
        s = np.r_[s, np.zeros(len(vt) - len(s))]
        w = np.maximum(0, (np.maximum(s, 1.0)**-2 - 0.01) / 0.99)
        return (np.sqrt(w)[:, None] * vt)[w > 0]


def solve(path, box, cone):
    p = Problem(os.path.join(ROOT, path), box)
    u = np.zeros(p.n)
    before = np.inf
    for _ in range(12):
        rows = p.anchors(u)

        def system(u):
            r, jac, _ = p.rows(u)
            parts = [r, np.sqrt(TIE) * u], [jac, np.sqrt(TIE) * np.eye(p.n)]
            if len(rows):
                parts[0].append(rows @ p.z(u))
                parts[1].append(rows @ p.dz(u))
            return np.concatenate(parts[0]), np.vstack(parts[1])

        if cone is None:
            u = least_squares(lambda u: system(u)[0], u, lambda u: system(u)[1], bounds=(-p.limit, p.limit), method="trf",
                              ftol=1e-15, xtol=1e-12, gtol=1e-12, max_nfev=200).x
        else:
            links = u.reshape(-1, 6).shape[0]

            def slope(u):
                out = np.zeros((links, p.n))
                for k in range(links):
                    out[k, 6 * k:6 * k + 6] = 2 * u[6 * k:6 * k + 6]
                return out

            within = NonlinearConstraint(lambda u: (u.reshape(-1, 6)**2).sum(1), -np.inf, cone**2, jac=slope,
                                         hess=lambda u, v: np.diag(np.repeat(2 * v, 6)))
            cost = lambda u: 0.5 * np.sum(system(u)[0]**2)
            by_u = lambda u: (lambda s: s[1].T @ s[0])(system(u))
            bend = lambda u: (lambda s: s[1].T @ s[1])(system(u))
            u = minimize(cost, u, jac=by_u, hess=bend, method="trust-constr", constraints=[within], bounds=Bounds(-p.limit, p.limit),
                         options={"gtol": 1e-7, "xtol": 1e-13, "barrier_tol": 1e-12, "maxiter": 600}).x
        r, _, poses = p.rows(u)
        new = p.anchors(u)
        value = 0.5 * r @ r + (0.5 * np.sum((new @ p.z(u))**2) if len(new) else 0.0)
        print(path, box, cone, value, len(new), flush=True)
        if len(new) == 0 or abs(value - before) <= 1e-10 * value:
            break
        before = value
    positions = [[float(x) for x in g[:3, 3]] for g in poses[:5]]
    return {"problem": path, "bounds": box, "cone": cone, "value": float(value), "positions": positions}


def main():
    results = []
    for problem in PROBLEMS:
        results.append(solve(*problem))
        with open(os.path.join(ROOT, "tests/data/cases/bounds/scipy.json"), "w") as f:
            f.write("[\n" + ",\n".join("  " + json.dumps(result) for result in results) + " ]\n")


if __name__ == "__main__":
    main()
