// SPDX-License-Identifier: Apache-2.0
//
// Random numbers in the shapes an arm is made of: rotations, vectors, arrays.
//
// Owns: nothing but those.  Never: makes an arm; what an arm of a test must be is the test's.
#pragma once

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include "tests/check_main.h"

inline void fill(uint64_t *seed, double *p, int count, double size)
{
    for (int i = 0; i < count; ++i)
        p[i] = test_uniform(seed, -size, size);
}

inline Eigen::VectorXd random_vector(uint64_t *seed, int n, double size)
{
    Eigen::VectorXd v(n);
    fill(seed, v.data(), n, size);
    return v;
}

inline Eigen::Matrix3d random_rotation(uint64_t *seed)
{
    const Eigen::Vector4d r = random_vector(seed, 4, 1);
    return Eigen::Quaterniond(r[0], r[1], r[2], r[3]).normalized().toRotationMatrix();
}

// By rows, as struct hdt_arm has them.
inline void store(const Eigen::Matrix3d &m, double out[9])
{
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
            out[3 * r + c] = m(r, c);
}
