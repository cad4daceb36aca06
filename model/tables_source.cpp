// SPDX-License-Identifier: Apache-2.0
//
// Tables as a C99 source, integers only, for targets that link the model in.
//
// Owns: the text; field names and order are those of ctrl/hdt_tables.h.
// Never: a date, a path, a floating-point number.
#include "model/tablegen.hpp"

#include <cctype>
#include <cinttypes>
#include <cstdio>

#include "model/text.hpp"

namespace hdt {
namespace {

// -2^31 has no literal in C
std::string literal(int64_t x)
{
    return x == INT32_MIN ? "-2147483647 - 1" : std::to_string(x);
}

std::string literal(uint64_t x)
{
    return std::to_string(x) + (x > UINT32_MAX ? "ull" : "u");
}

struct Writer {
    std::string out;

    template <typename T> static std::string one(T x)
    {
        if constexpr (std::is_signed_v<T>)
            return literal(static_cast<int64_t>(x));
        else
            return literal(static_cast<uint64_t>(x));
    }

    template <typename T> void field(const char *name, T x)
    {
        out += "." + std::string(name) + " = " + one(x) + ",\n";
    }

    template <typename T> std::string list(const T *x, std::size_t n)
    {
        std::string text = "{", line;
        for (std::size_t i = 0; i < n; i++) {
            const std::string item = one(x[i]) + (i + 1 < n ? "," : "");
            if (line.size() + item.size() > 96) {
                text += line + "\n";
                line.clear();
            }
            line += (line.empty() ? "" : " ") + item;
        }
        return text + line + "}";
    }

    template <typename T, std::size_t N> void array(const char *name, const T (&x)[N])
    {
        out += "." + std::string(name) + " = " + list(x, N) + ",\n";
    }

    void stiffness(const hdt_joint_tab &j)
    {
        out += ".stiffness = {\n";
        for (const hdt_stiffness_tab &s : j.stiffness)
            out += "{.t1_q16 = " + one(s.t1_q16) + ", .t2_q16 = " + one(s.t2_q16)
                   + ", .intercept_q16 = " + list(s.intercept_q16, 3)
                   + ", .slope_q24 = " + list(s.slope_q24, 3) + "},\n";
        out += "},\n";
    }

    void lines(const hdt_joint_tab &j)
    {
        field("lines", j.lines);
        out += ".line = {\n";
        for (const hdt_line_tab &l : j.line)
            out += "{.phase_per_count_q24 = " + one(l.phase_per_count_q24)
                   + ", .amplitude_q16 = " + one(l.amplitude_q16)
                   + ", .directed = " + one(l.directed) + ", .phase0 = " + one(l.phase0) + "},\n";
        out += "},\n";
    }

    void chain(const hdt_joint_tab &j)
    {
        field("terms", j.terms);
        field("sign", j.sign);
        field("zero_cnt", j.zero_cnt);
        field("rad_per_count_q44", j.rad_per_count_q44);
        field("phase_per_count_q24", j.phase_per_count_q24);
        field("chain", j.chain);
        field("phase0", j.phase0);
        field("twist_cos_q30", j.twist_cos_q30);
        field("twist_sin_q30", j.twist_sin_q30);
        array("step_q24", j.step_q24);
        array("moment_q20", j.moment_q20);
        array("second_q20", j.second_q20);
        field("rotor_q20", j.rotor_q20);
        field("v_lim_q24", j.v_lim_q24);
        field("a_lim_q16", j.a_lim_q16);
    }

    void friction(const hdt_joint_tab &j)
    {
        field("v_ramp_inv_q16", j.v_ramp_inv_q16);
        field("friction_shift", j.friction_shift);
        out += ".friction_q16 = {\n" + list(j.friction_q16[0], HDT_FRICTION_KNOTS) + ",\n"
               + list(j.friction_q16[1], HDT_FRICTION_KNOTS) + "},\n";
        array("ripple_q8", j.ripple_q8);
        stiffness(j);
        field("windup_inv_q8", j.windup_inv_q8);
        lines(j);
        field("load_mu_q24", j.load_mu_q24);
        field("cold_coulomb_q16", j.cold_coulomb_q16);
        field("cold_viscous_q16", j.cold_viscous_q16);
        field("cold_decay_q31", j.cold_decay_q31);
        field("presliding_q16", j.presliding_q16);
        field("presliding_inv_q8", j.presliding_inv_q8);
        field("spring_q16", j.spring_q16);
        field("spring_q0_q24", j.spring_q0_q24);
        field("offset_q16", j.offset_q16);
    }

    void curve(const hdt_curve_tab &c)
    {
        out += "{.start = " + one(c.start) + ", .shift = " + one(c.shift) + ", .value_q8 = "
               + list(c.value_q8, HDT_CURVE_KNOTS) + "},\n";
    }

    void curves(const hdt_joint_tab &j)
    {
        out += ".local = {\n";
        curve(j.local[0]);
        curve(j.local[1]);
        out += "},\n.table = ";
        curve(j.table);
        field("axis", j.axis);
        field("directed", j.directed);
    }

    void limits(const hdt_joint_tab &j)
    {
        field("kp_q16", j.kp_q16);
        field("kd_q16", j.kd_q16);
        field("inertia_inv_q20", j.inertia_inv_q20);
        field("nm_per_digit_q24", j.nm_per_digit_q24);
        field("digit_per_nm_q24", j.digit_per_nm_q24);
        field("dig_max", j.dig_max);
        field("dig_slew", j.dig_slew);
        field("spd_max", j.spd_max);
        field("q_min_q24", j.q_min_q24);
        field("q_max_q24", j.q_max_q24);
        field("v_max_q24", j.v_max_q24);
        field("follow_max_q24", j.follow_max_q24);
    }

    void head(const hdt_tables &t)
    {
        field("magic", t.magic);
        field("layout", t.layout);
        array("digest", t.digest);
        array("name", t.name);
        field("joints", t.joints);
        field("period_ns", t.period_ns);
        field("rate_q16", t.rate_q16);
        field("stale_periods", t.stale_periods);
        array("gravity_q24", t.gravity_q24);
        array("biquad_q28", t.biquad_q28);
        field("observer", t.observer);
        array("observer_gain", t.observer_gain);
    }
};

std::string identifier(const std::string &name)
{
    std::string out;
    for (const char c : name)
        out += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
    return out;
}

} // namespace

std::string tables_c_source(const hdt_tables &t, const std::string &name)
{
    const std::string symbol = "hdt_tables_" + identifier(name),
                      layout = std::to_string(t.layout) + "u";
    Writer w;
    w.out =
        "/* Generated by hdt gen from the model \"" + identifier(t.name) + "\", sha256\n * "
        + hex(t.digest, sizeof t.digest)
        + ".  Do not edit. */\n#include \"ctrl/hdt_tables.h\"\n\n#if HDT_TABLES_LAYOUT != " + layout
        + "\n#error \"these tables are of layout " + std::to_string(t.layout)
        + ", the core reads another: run hdt gen again\"\n#endif\n\nextern const struct hdt_tables "
        + symbol + ";\nconst struct hdt_tables " + symbol + " = {\n";
    w.head(t);
    w.out += ".joint = {\n";
    for (uint32_t j = 0; j < t.joints && j < HDT_JOINTS_MAX; j++) {
        w.out += "{\n";
        w.chain(t.joint[j]);
        w.friction(t.joint[j]);
        w.limits(t.joint[j]);
        w.curves(t.joint[j]);
        w.out += "},\n";
    }
    w.out += "},\n};\n";
    return w.out;
}

} // namespace hdt
