# SPDX-License-Identifier: Apache-2.0
"""The same arm in MuJoCo and in sim/plant: time per step, and creep below breakaway.

Same machine, same run, one core, the same step length: build/bench_sim prints the arm as a MuJoCo model
(rotor and link of every joint, friction loss, spring) and its own figures.  First both are driven
through the same second without friction and stops, to see that they are the same arm.  MuJoCo's springs
are straight and its friction has one number; ours here has three lines, two sides, Stribeck.

Times: processor time, best of several rounds of mj_step's own loop and of bench_sim's, in turns.
usage: bench_mujoco.py BUILD      (make bench-sim sets it up)
"""
import subprocess
import sys
import time

import mujoco
import numpy as np

TURNS = 3                 # theirs, ours, theirs ...
ROUNDS, STEPS = 20, 1000  # a round: this many steps in one call
EULER, RK4, FAST = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4,
                    mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


def ours(bench):
    out = subprocess.run([bench, "--figures"], check=True, capture_output=True, text=True).stdout
    return {name: [float(v) for v in values] for name, *values in map(str.split, out.splitlines())}


def arm(bench, name, integrator, step_s):
    xml = subprocess.run([bench, "--mjcf", name], check=True, capture_output=True, text=True).stdout
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.integrator, model.opt.timestep = integrator, step_s
    return model


def swing(model, t_s):
    """As bench_sim's: motor torque, N.m motor side."""
    index = np.arange(model.nu)
    return 0.6 * model.actuator_ctrlrange[:, 1] * np.sin(6.283185307179586 * 0.7 * t_s + index)


def furthest_rad(bench, figures):
    """Difference of the two simulators' smooth arms after 1 s, furthest joint, and how far it went."""
    rate, per_tick = int(figures["rate_hz"][0]), 16
    model = arm(bench, "smooth", RK4, 1 / rate / per_tick)
    data = mujoco.MjData(model)
    link, rotor = np.array(figures["smooth_link_rad"]), np.array(figures["smooth_rotor_rad"])
    data.qpos[0::2], data.qpos[1::2] = rotor, link - rotor
    for tick in range(rate):
        data.ctrl[:] = swing(model, tick / rate)
        mujoco.mj_step(model, data, per_tick)
    q, end = data.qpos[0::2] + data.qpos[1::2], np.array(figures["smooth_end_rad"])
    return np.abs(q - end).max(), np.abs(end - link).max()


def step_us(model):
    """Processor time of a step: the arm swings, friction on; best round.  nan: it became unstable."""
    data, best = mujoco.MjData(model), np.inf
    data.qpos[2], data.qpos[6], data.qpos[10] = 0.3, 0.8, 0.5
    for _ in range(ROUNDS):
        data.ctrl[:] = swing(model, data.time)
        start = time.process_time()
        mujoco.mj_step(model, data, STEPS)
        best = min(best, (time.process_time() - start) / STEPS * 1e6)
        if not np.isfinite(data.qpos).all() or any(w.number for w in data.warning):
            return np.nan
    return best


def creep_radps(model):
    """Mean speed over the second second of joint 1 held at half its friction loss."""
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.5 * model.dof_frictionloss[0] / model.actuator_gear[0, 0]
    steps = round(1 / model.opt.timestep)
    mujoco.mj_step(model, data, steps)
    start = data.qpos[0]
    mujoco.mj_step(model, data, steps)
    return (data.qpos[0] - start) / (steps * model.opt.timestep)


def compare_times(bench, figures):
    cases = (("Euler      against Verlet", EULER, "verlet"), ("implicitfast against Verlet", FAST, "verlet"),
             ("Runge-Kutta against the same", RK4, "rk4"))
    models = [arm(bench, "plain", kind, figures[key + "_step_us"][0] * 1e-6) for _, kind, key in cases]
    theirs, own = [[] for _ in cases], []
    for _ in range(TURNS):
        for times, model in zip(theirs, models):
            times.append(step_us(model))
        own.append(ours(bench))
    print("a step of 7 flexible joints with friction, us:        MuJoCo    ours   ratio")
    for (name, _, key), times, model in zip(cases, theirs, models):
        mine = min(f[key + "_us"][0] for f in own)
        label = f"  {name}, steps of {model.opt.timestep * 1e6:.1f} us"
        if np.isnan(times).any():
            print(f"{label:52} MuJoCo became unstable; ours {mine:.3f} us")
        else:
            print(f"{label:52} {min(times):7.2f} {mine:7.3f} {min(times) / mine:7.1f}")


def compare_creep(bench, figures):
    step = figures["verlet_step_us"][0] * 1e-6
    model = arm(bench, "plain", EULER, step)
    print("creep of joint 1 held at half its breakaway torque, rad/s:")
    print(f"  MuJoCo, as it comes             {creep_radps(model):.2e}")
    model.dof_solimp[:, :2] = 0.9999
    model.dof_solref[:] = 4 * step, 1
    print(f"  MuJoCo, friction at its hardest {creep_radps(model):.2e}   (solimp 0.9999, solref 4 steps)")
    print(f"  ours                            {figures['verlet_creep_radps'][0]:g} and, Runge-Kutta, "
          f"{figures['rk4_creep_radps'][0]:g}")


def main():
    bench = sys.argv[1] + "/bench_sim"
    figures = ours(bench)
    apart, went = furthest_rad(bench, figures)
    print(f"MuJoCo {mujoco.__version__}; the same arm: furthest joint {apart:.1e} rad apart after 1 s and "
          f"{went:.1f} rad")
    compare_times(bench, figures)
    compare_creep(bench, figures)
    # a wrong model would make every figure above worthless
    if not apart < 1e-3:
        sys.exit("bench_mujoco: the two arms are not the same: expected less than 1e-3 rad between them")


main()
