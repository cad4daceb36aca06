# SPDX-License-Identifier: Apache-2.0
"""MuJoCo reads what `hdt export` writes and finds the torques model/rbd.cpp finds.

Goal: mj_inverse of both files equals our Newton-Euler within 1e-9 of the largest torque.
Method: the shipped PA-10; the same with a payload on a tilted base; arms of random frames and links,
written as model files here.  Random q inside the limits, random speeds and accelerations.
usage: mujoco_torques.py BUILD      (make check-mujoco sets it up)
"""
import os
import re
import subprocess
import sys
import tempfile

import mujoco
import numpy as np

TOLERANCE = 1e-9  # of the largest torque; MuJoCo diagonalises inertias to about 1e-12
CASES = 200       # motions an arm
ARMS = 6          # random arms


def quantity(values, unit, side=None):
    text = repr([float(v) for v in values]) if np.ndim(values) else repr(float(values))
    return f'{{ value = {text}, unit = "{unit}", confidence = "low", source = "TEST"' + (
        f', side = "{side}" }}' if side else " }")


def random_body(rng):
    """Mass, centre and inertia about it of eight random points: any such cloud is a body."""
    at, mass = rng.uniform(-0.3, 0.3, (8, 3)), rng.uniform(0.05, 1, 8)
    com = mass @ at / mass.sum()
    r = at - com
    inertia = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(mass, r))
    return mass.sum(), com, inertia


def random_arm(rng, joints):
    """A model file as text; no frame is aligned with anything."""
    lines = ['format = "hdt-arm"', "version = 1", 'name = "random"', "[sources]", 'TEST = "random"',
             "[base]", "gravity = " + quantity(rng.uniform(-10, 10, 3), "m/s^2"),
             "[flange]", "origin = " + quantity(rng.uniform(-0.2, 0.2, 3), "m"),
             "rpy = " + quantity(rng.uniform(-1.5, 1.5, 3), "rad"),
             "[payload]", "mass = " + quantity(rng.uniform(0.5, 5), "kg"),
             "com = " + quantity(rng.uniform(-0.2, 0.2, 3), "m")]
    for j in range(joints):
        mass, com, i = random_body(rng)
        lines += ["[[joint]]", f'name = "J{j + 1}"',
                  "origin = " + quantity(rng.uniform(-0.5, 0.5, 3), "m"),
                  "rpy = " + quantity(rng.uniform(-3, 3, 3), "rad"),
                  "limits.position = " + quantity([-3, 3], "rad"),
                  "limits.speed = " + quantity(2, "rad/s"),
                  "link.mass = " + quantity(mass, "kg"), "link.com = " + quantity(com, "m"),
                  "link.inertia = " + quantity([i[0, 0], i[0, 1], i[0, 2], i[1, 1], i[1, 2], i[2, 2]], "kg m^2"),
                  "gear.ratio = " + quantity(50, "1"),
                  "motor.rotor_inertia = " + quantity(rng.uniform(1e-5, 1e-3), "kg m^2", "motor")]
    return "\n".join(lines) + "\n"


def with_payload_and_tilt(text):
    """The PA-10 hung on a wall, 3.3 kg off-centre at its flange."""
    text, count = re.subn(r"gravity = \{ value = \[[^]]*\]", "gravity = { value = [4.1, -8.2, 3.3]", text)
    assert count == 1
    payload = ("[payload]\nmass = { value = 3.3, unit = \"kg\", confidence = \"high\", source = \"CHOSEN\" }\n"
               "com = { value = [0.02, -0.05, 0.11], unit = \"m\", confidence = \"high\", source = \"CHOSEN\" }\n")
    assert "[payload]" not in text
    return text.replace("[flange]", payload + "[flange]", 1)


def export(hdt, arm, form, *options):
    out = os.path.splitext(arm)[0] + "." + form
    subprocess.run([hdt, "export", arm, "--format", form, "--out", out, *options], check=True, stdout=subprocess.DEVNULL)
    with open(out, encoding="utf-8") as f:
        return f.read()


def keep_every_body(urdf):
    """MuJoCo's own extension: by default it merges fixed links of a URDF into the moving one."""
    return re.sub(r"(<robot [^>]*>)", r'\1<mujoco><compiler fusestatic="false" discardvisual="false" '
                  r'balanceinertia="false"/></mujoco>', urdf, count=1)


def torques(model, names, motions):
    data = mujoco.MjData(model)
    dof = [model.jnt_dofadr[model.joint(n).id] for n in names]
    out = []
    for m in motions:
        for part, values in zip((data.qpos, data.qvel, data.qacc), np.split(m, 3)):
            part[dof] = values  # hinges only: positions and speeds are counted alike
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse[dof].copy())
    return np.array(out)


def check(hdt, filter_program, arm, rng):
    """Worst difference of both formats, relative to the largest torque; raises on a wrong structure."""
    mjcf = mujoco.MjModel.from_xml_string(export(hdt, arm, "mjcf"))
    urdf_text = export(hdt, arm, "urdf")
    urdf = {"urdf": mujoco.MjModel.from_xml_string(keep_every_body(urdf_text)),
            "urdf, fixed links merged": mujoco.MjModel.from_xml_string(urdf_text)}
    names = [mjcf.joint(j).name for j in range(mjcf.njnt)]
    n = len(names)
    low, high = mjcf.jnt_range.T
    motions = np.hstack([rng.uniform(low, high, (CASES, n)), rng.uniform(-2, 2, (CASES, n)),
                         rng.uniform(-5, 5, (CASES, n))])
    text = "\n".join(" ".join(repr(float(v)) for v in m) for m in motions) + "\n"
    run = subprocess.run([filter_program, arm], input=text, capture_output=True, text=True, check=True)
    want = np.array([[float(w) for w in line.split()] for line in run.stdout.splitlines()])
    assert want.shape == (CASES, n), "rbd_torques answered another number of lines"
    payload = "payload" in urdf_text
    assert mjcf.nbody == n + 2 + payload, f"MJCF: {mjcf.nbody} bodies, expected {n + 2 + payload}"
    assert urdf["urdf"].nbody == n + 3 + payload, "URDF: a body is missing"
    worst = {}
    for name, model in {"mjcf": mjcf, **urdf}.items():
        model.opt.gravity[:] = mjcf.opt.gravity  # URDF has none
        assert abs(model.body_mass.sum() - mjcf.body_mass.sum()) < 1e-12
        assert [model.joint(j).name for j in range(model.njnt)] == names
        worst[name] = np.abs(torques(model, names, motions) - want).max() / np.abs(want).max()
    armature = mujoco.MjModel.from_xml_string(export(hdt, arm, "mjcf", "--armature"))
    assert (armature.dof_armature > 0).all(), "no armature was written"
    more = torques(armature, names, motions) - torques(mjcf, names, motions)
    expected = motions[:, 2 * n:] * armature.dof_armature
    worst["armature"] = np.abs(more - expected).max() / np.abs(want).max()
    return worst


def main():
    build = sys.argv[1]
    hdt, program = os.path.join(build, "hdt"), os.path.join(build, "tests", "rbd_torques")
    with open("model/arms/pa10.toml", encoding="utf-8") as f:
        pa10 = f.read()
    rng = np.random.default_rng(20)
    arms = {"pa10": pa10, "pa10, payload, on a wall": with_payload_and_tilt(pa10)}
    arms.update({f"random, {j} joints": random_arm(rng, j) for j in (1, 2, 4, 6, 7, 16)[:ARMS]})
    failed = 0
    with tempfile.TemporaryDirectory() as directory:
        for label, text in arms.items():
            path = os.path.join(directory, "arm.toml")
            with open(path, "w", encoding="utf-8") as f:
                f.write(text)
            for form, error in check(hdt, program, path, rng).items():
                good = error <= TOLERANCE
                failed += not good
                print(f"{'ok  ' if good else 'FAIL'} {label}: {form}: {error:.1e} of the largest torque")
    print(f"MuJoCo {mujoco.__version__}: {failed} failed, {CASES} motions an arm, tolerance {TOLERANCE:g}")
    return failed != 0


if __name__ == "__main__":
    sys.exit(main())
