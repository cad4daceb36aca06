// SPDX-License-Identifier: Apache-2.0
//
// Inverse dynamics of a model file as a filter, for tests/mujoco_torques.py: a line of 3n numbers
// (q, qd, qdd; rad, rad/s, rad/s^2) in, a line of n torques (N.m output side) out, 17 digits.
// usage: rbd_torques ARM.toml
//
// Owns: nothing.  Never: compares.
#include <cstdio>
#include <iostream>
#include <string>

#include "model/arm_file.hpp"
#include "model/rbd.hpp"

int main(int argc, char **argv)
{
    if (argc != 2) {
        std::fprintf(stderr, "usage: rbd_torques ARM.toml <motions >torques\n");
        return 2;
    }
    try {
        const hdt_arm arm = hdt::ArmFile::load(argv[1]).arm();
        const Eigen::Index n = arm.joints;
        Eigen::VectorXd x(3 * n);
        for (;;) {
            for (Eigen::Index i = 0; i < 3 * n; i++)
                if (!(std::cin >> x[i]))
                    return i == 0 && std::cin.eof() ? 0 : 3;
            const Eigen::VectorXd tau =
                hdt::rbd::inverse_dynamics(arm, x.head(n), x.segment(n, n), x.tail(n));
            for (Eigen::Index i = 0; i < n; i++)
                std::printf("%.17g%c", tau[i], i + 1 < n ? ' ' : '\n');
        }
    } catch (const std::exception &e) {
        std::fprintf(stderr, "rbd_torques: %s\n", e.what());
        return 3;
    }
}
