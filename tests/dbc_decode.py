# SPDX-License-Identifier: Apache-2.0
"""cantools decodes our CAN traffic by docs/hdt-servo.dbc to the numbers that were sent.

Two sources: telegrams of every type from tests/can_traffic, whose meaning is written beside them; and
the candumps of make check-vm, where the state telegrams must hold the counts of the host's log.
ISO-TP (identifiers 1FE, 1FF) is put together here, from ISO 15765-2, sharing no code with the kernel's.
usage: dbc_decode.py BUILD
"""
import math
import os
import re
import subprocess
import sys

import cantools

LINE = re.compile(r"\(([\d.]+)\) (\w+) ([0-9A-F]+)#(#[0-9A-F])?([0-9A-F]*)")
COUNTS_PER_RAD = 50 * 16384 / (2 * math.pi)


def frames(path):
    with open(path) as f:
        for number, line in enumerate(f, 1):
            m = LINE.match(line)
            if not m:
                sys.exit(f"{path}:{number}: not a line of candump -L: {line!r}")
            yield int(m[3], 16), bytes.fromhex(m[5])


def telegrams(path):
    """(identifier without ISO-TP's 100, bytes): frames as they are, segments put together."""
    open_pdu = {}
    for ident, data in frames(path):
        if ident not in (0x1FE, 0x1FF):
            yield ident, data
            continue
        kind, low = data[0] >> 4, data[0] & 15
        if kind == 0:  # single; above 8 bytes the length has a byte of its own
            yield ident - 0x100, data[1:1 + low] if low else data[2:2 + data[1]]
        elif kind == 1:
            open_pdu[ident] = ((low << 8) + data[1], bytearray(data[2:]), 1)
        elif kind == 2:
            if ident not in open_pdu:
                continue  # the dump began in the middle
            want, got, turn = open_pdu.pop(ident)
            if low != turn & 15:
                sys.exit(f"{path}: segment {low} of {ident:x}, expected {turn & 15}")
            got += data[1:]
            if len(got) >= want:
                yield ident - 0x100, bytes(got[:want])
            else:
                open_pdu[ident] = (want, got, turn + 1)


def decode(db, ident, data, scaling):
    return db.get_message_by_frame_id(ident).decode(data, decode_choices=False, scaling=scaling, allow_truncated=True)


def check_traffic(db, directory):
    expected = [line.split() for line in open(f"{directory}/traffic.expect")]
    found = list(telegrams(f"{directory}/traffic.candump"))
    if len(found) != len(expected):
        sys.exit(f"{len(found)} telegrams, expected {len(expected)}")
    unit = {"Torque": 0.001, "Speed": 0.0002}
    for (ident, data), (want_id, *pairs) in zip(found, expected):
        want = {k: int(v) for k, v in (p.split("=") for p in pairs)}
        raw = decode(db, ident, data, False)
        if ident != int(want_id) or raw != want:
            sys.exit(f"{ident:x}#{data.hex()}: cantools has {raw}, we sent {want}")
        for name, value in decode(db, ident, data, True).items():
            size = unit.get(name.rsplit("_", 1)[-1], 1)
            if abs(value - want[name] * size) > 1e-9 * max(1, abs(value)):
                sys.exit(f"{name}: cantools has {value}, we sent {want[name]} times {size}")
    print(f"check-dbc: {len(found)} telegrams of every type: the same numbers")


def log_counts(path):
    with open(path) as f:
        rows = [line.rstrip("\n").split(",") for line in f if not line.startswith("#")]
    at = {name: i for i, name in enumerate(rows[0])}
    joints = [j for j in range(1, 8) if f"q{j}_rad" in at]
    return [tuple(round(float(r[at[f"q{j}_rad"]]) * COUNTS_PER_RAD) for j in joints) for r in rows[1:]], len(joints)


def check_run(db, out, name):
    """Every row of the host's log is a state telegram of the dump, in order."""
    rows, joints = log_counts(f"{out}/{name}.csv")
    axes = ["S1", "S2", "S3", "E1", "E2", "W1", "W2"][:joints]
    states = (s for s in (decode(db, i, d, True) for i, d in telegrams(f"{out}/{name}.candump") if i == 0xFF)
              if s["Type"] == ord("C"))
    seen = 0
    for k, row in enumerate(rows):
        for state in states:
            seen += 1
            if tuple(state[f"{a}_Count"] for a in axes) == row:
                break
        else:
            sys.exit(f"{name}: row {k + 1} of the log, counts {row}, is in no state telegram of the dump after the one before")
    if not rows or len(rows) < 0.99 * seen:
        sys.exit(f"{name}: {len(rows)} rows in the log for {seen} state telegrams")
    print(f"check-dbc: {name}: {len(rows)} rows of the host's log in {seen} state telegrams of the candump, in order")


def main():
    build = sys.argv[1]
    db = cantools.database.load_file("docs/hdt-servo.dbc")
    directory = f"{build}/dbc"
    os.makedirs(directory, exist_ok=True)
    subprocess.run([f"{build}/tests/can_traffic", directory], check=True)
    check_traffic(db, directory)
    out = f"{build}/vm/out.all"
    runs = [n for n in ("vcan_fd", "vcan_isotp", "sja1000") if os.path.exists(f"{out}/{n}.csv")]
    for name in runs:
        check_run(db, out, name)
    if not runs:
        print(f"SKIP: check-dbc: no candump of a run in {out}: make check-vm writes them")


main()
