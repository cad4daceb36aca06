# SPDX-License-Identifier: Apache-2.0
"""FMPy loads the PA-10's unit as any importer would.

Goal: the file is valid; the unit does what the servo driver does without it, bit for bit; states roll
back, also as bytes in another instance; a run by FMPy's own master moves as it was told.
Method: random commands, the same to the unit and to tests/fmu_direct.
usage: fmu_run.py BUILD      (make check-fmu sets it up)
"""
import math
import os
import re
import subprocess
import sys

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

RATE_HZ = 1504
OUTPUTS = ("angle", "link_angle", "link_speed", "motor_torque", "gear_torque")
JOINTS = ("S1", "S2", "S3", "E1", "E2", "W1", "W2")
SEED, STEPS = 42, 100


class Unit:
    """One instance, its variables by name."""

    def __init__(self, description, directory, name):
        self.reference = {v.name: v.valueReference for v in description.modelVariables}
        self.slave = FMU3Slave(guid=description.instantiationToken, unzipDirectory=directory,
                               modelIdentifier=description.coSimulation.modelIdentifier, instanceName=name)
        self.slave.instantiate()
        self.time = 0.0

    def refs(self, name):
        return [self.reference[f"{j}.{name}"] for j in JOINTS]

    def start(self, angles):
        self.slave.setUInt64([self.reference["seed"]], [SEED])
        self.slave.setFloat64(self.refs("start"), list(angles))
        self.slave.enterInitializationMode(startTime=0.0)
        self.slave.exitInitializationMode()

    def step(self, command, length):
        mode, speed, torque = command
        self.slave.setInt64(self.refs("mode"), [int(m) for m in mode])
        self.slave.setFloat64(self.refs("speed_command"), list(speed))
        self.slave.setFloat64(self.refs("torque_command"), list(torque))
        self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=length)
        self.time += length

    def outputs(self):
        rows = [self.slave.getFloat64(self.refs(name)) for name in OUTPUTS]
        rows.append([float(w) for w in self.slave.getUInt16(self.refs("status"))])
        return np.array(rows).T  # joints x outputs

    def close(self):
        self.slave.terminate()
        self.slave.freeInstance()


def commands(rng, count):
    return [(rng.choice([0, 1, 1, 2], 7), rng.uniform(-0.5, 0.5, 7), rng.uniform(-0.5, 0.5, 7))
            for _ in range(count)]


def directly(program, angles, work, lengths):
    """The same run by the servo driver itself."""
    lines = [f"{SEED} " + " ".join(repr(float(a)) for a in angles)]
    done, time = 0, 0.0
    for (mode, speed, torque), length in zip(work, lengths):
        time += length
        ticks = math.floor(time * RATE_HZ + 1e-6)
        lines.append(f"{ticks - done} " + " ".join(f"{int(m)} {float(s)!r} {float(t)!r}"
                                                   for m, s, t in zip(mode, speed, torque)))
        done = ticks
    run = subprocess.run([program], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True)
    return np.array([[float(w) for w in line.split()] for line in run.stdout.splitlines()]).reshape(-1, 7, 6)


def check_valid(fmu):
    problems = validate_fmu(fmu)
    assert not problems, problems
    description = fmpy.read_model_description(fmu)
    unit = description.coSimulation
    assert description.fmiVersion == "3.0" and unit.canGetAndSetFMUstate and unit.canSerializeFMUstate
    for v in description.modelVariables:
        assert v.description, f"{v.name} has no description"
        assert v.causality and v.variability
        assert v.unit or v.type != "Float64", f"{v.name} has no unit"
    names = {v.name for v in description.modelVariables}
    assert len(names) == 8 + 10 * len(JOINTS), f"{len(names)} variables"
    return description


def check_bit_for_bit(description, directory, program):
    rng = np.random.default_rng(1)
    angles = rng.uniform(-0.8, 0.8, 7)
    work, lengths = commands(rng, STEPS), rng.uniform(0.0003, 0.02, STEPS)
    unit = Unit(description, directory, "one")
    unit.start(angles)
    have = [unit.outputs()]
    for command, length in zip(work, lengths):
        unit.step(command, float(length))
        have.append(unit.outputs())
    unit.close()
    want = directly(program, angles, work, lengths)
    have = np.array(have)
    assert have.shape == want.shape, f"{have.shape} and {want.shape}"
    assert np.ptp(want[:, :, 0], axis=0).max() > 0.05, "nothing moved: the run shows nothing"
    differ = np.argwhere(have != want)
    if differ.size:
        at = tuple(differ[0])
        raise AssertionError(f"step, joint, output {at}: {have[at]!r} and {want[at]!r}")
    return have.size


def check_rollback(description, directory):
    rng = np.random.default_rng(2)
    unit, other = Unit(description, directory, "here"), Unit(description, directory, "there")
    unit.start(rng.uniform(-0.5, 0.5, 7))
    for command in commands(rng, 10):
        unit.step(command, 0.01)
    state, time = unit.slave.getFMUState(), unit.time
    work = commands(rng, 20)

    def play(u):
        u.time = time
        out = []
        for command in work:
            u.step(command, 0.01)
            out.append(u.outputs())
        return np.array(out)

    first = play(unit)
    unit.slave.setFMUState(state)
    assert (play(unit) == first).all(), "after a rollback the unit went another way"
    arrived = other.slave.deserializeFMUState(unit.slave.serializeFMUState(state))
    other.slave.setFMUState(arrived)
    assert (play(other) == first).all(), "the state went another way in another instance"
    for u, s in ((unit, state), (other, arrived)):
        u.slave.freeFMUState(s)
        u.close()


def check_master(fmu, description):
    """FMPy's own master: S2 leans forward at 0.2 rad/s for a second, under a payload."""
    kinds = {"Float64": float, "Enumeration": np.int64, "Boolean": bool}
    inputs = [(v.name, kinds[v.type]) for v in description.modelVariables if v.causality == "input"]
    rows = np.zeros(201, dtype=[("time", float)] + inputs)
    rows["time"], rows["enable"] = np.linspace(0, 1, len(rows)), True
    rows["S2.mode"], rows["S2.speed_command"] = 1, 0.2
    result = fmpy.simulate_fmu(fmu, start_time=0, stop_time=1, step_size=0.005, output_interval=0.005,
                               input=rows, start_values={"payload_mass": 5.0, "S2.start": 0.3},
                               output=["S2.angle", "S2.link_angle", "S2.status", "S1.angle"])
    moved = result["S2.angle"][-1] - result["S2.angle"][0]
    assert abs(moved - 0.2) < 0.01, f"S2 moved {moved} rad in a second at 0.2 rad/s"
    assert abs(result["S1.angle"][-1] - result["S1.angle"][0]) < 1e-3, "S1 moved with its brake on"
    windup = result["S2.angle"] - result["S2.link_angle"]
    assert 1e-5 < np.abs(windup).max() < 0.02, f"wind-up {np.abs(windup).max()} rad"
    assert (result["S2.status"] == 0).all(), "an alarm"
    return moved


def main():
    build = sys.argv[1]
    fmu = os.path.join(build, "hdt-pa10.fmu")
    description = check_valid(fmu)
    print(f"valid: {len(description.modelVariables)} variables")
    directory = fmpy.extract(fmu)
    values = check_bit_for_bit(description, directory, os.path.join(build, "tests", "fmu_direct"))
    print(f"bit for bit: {values} values of {STEPS} steps are those of the servo driver run directly")
    check_rollback(description, directory)
    print("rollback: the same steps again, and in another instance from bytes, give the same values")
    print(f"FMPy's master: S2 moved {check_master(fmu, description):.4f} rad in 1 s at 0.2 rad/s, no alarm")
    print(f"FMPy {fmpy.__version__}: ok")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except AssertionError as failure:
        print(f"FAIL {re.sub(chr(10), ' ', str(failure))}")
        sys.exit(1)
