/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How fast and how exact the simulator is, on one core of this machine: the chain's evaluation, a step
 * of either integrator, real time with the servo, cost against joint count, error of Runge-Kutta
 * against a fine reference, creep of a joint held below breakaway.
 *
 * bench_sim [SECONDS]     SECONDS simulated with the servo, default 20
 * bench_sim --figures     "name value..." lines for tools/bench_mujoco.py
 * bench_sim --mjcf NAME   the arm as a MuJoCo model; NAME: plain (as timed) or smooth (same equations)
 *
 * Times are processor time, the best of several rounds, the first figures before and after all others:
 * what else runs on the machine counts for little.
 *
 * Owns: the printed figures.
 * Never: is a test; timing on a shared machine varies.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "sim/plant_parts.h"
#include "sim/servo.h"
#include "tests/pa10_plant.h"

enum { ROUNDS = 20, RATE_HZ = 1500 };

static const double TURN = 6.283185307179586;
static volatile double sink; /* keeps results alive */

static double processor_us(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec * 1e6 + (double)t.tv_nsec * 1e-3;
}

/* Through the check, with the integrator and step (0: chosen); or the end of the program. */
static struct plant_model checked(struct plant_model m, enum plant_integrator integrator, double step_s)
{
    const char *why;
    m.integrator = integrator;
    m.step_s = step_s;
    if (plant_model_check(&m, &why) != 0) {
        fprintf(stderr, "bench_sim: model refused: joint %d: %s\n", m.check_joint, why);
        exit(1);
    }
    return m;
}

/* PA-10: three-line springs, two-sided Stribeck friction and stiction; no periodic lines. */
static struct plant_model plain_arm(void)
{
    struct plant_model m = pa10_plant();
    for (int i = 0; i < m.joints; i++)
        m.joint[i].lines = 0;
    return m;
}

/* The same with what makes a harmonic drive: periodic friction, soft wave generator, mesh loss. */
static struct plant_model whole_arm(void)
{
    struct plant_model m = pa10_plant();
    for (int i = 0; i < m.joints; i++) {
        struct plant_joint *j = &m.joint[i];
        j->soft_nm = 0.1 * j->t_nm[0];
        j->soft_nmprad = 0.2 * j->k_nmprad[0];
        j->hard_nmprad = 10 * j->k_nmprad[2];
        j->mesh = (struct plant_mesh){ 0.1 * j->t_nm[0], 0.02 * j->t_nm[0], 0.05, 0.02 };
    }
    return m;
}

/* Any number of joints: axes along and across in turn, size 25. */
static struct plant_model long_arm(int joints)
{
    struct plant_model m = plain_arm(), along = m;
    m.joints = joints;
    for (int i = 0; i < joints; i++)
        m.joint[i] = along.joint[i == 0 ? 0 : 2 + (i + 1) % 2];
    return m;
}

/* ---- the chain alone ---- */

struct chain_us { double terms, factor, solve, all; };

static void least(double *figure, double value)
{
    if (value < *figure)
        *figure = value;
}

/* One round; the pose moves so that nothing can be kept from call to call. */
static void chain_round(const struct plant_chain *c, double *q, const double *qd, struct chain_us *us)
{
    enum { CALLS = 4000 };
    plant_matrix mass, factor;
    double bias[PLANT_JOINTS_MAX], x[PLANT_JOINTS_MAX], from = processor_us();
    for (int k = 0; k < CALLS; k++) {
        q[k % c->joints] += 1e-6;
        plant_chain_terms(c, q, qd, mass, bias);
        sink = bias[0];
    }
    least(&us->terms, (processor_us() - from) / CALLS);
    from = processor_us();
    for (int k = 0; k < CALLS; k++) {
        mass[0] += 1e-9;
        sink = plant_factor(c->joints, mass, factor);
    }
    least(&us->factor, (processor_us() - from) / CALLS);
    from = processor_us();
    for (int k = 0; k < CALLS; k++) {
        bias[0] += 1e-9;
        plant_solve(c->joints, factor, bias, x);
        sink = x[0];
    }
    least(&us->solve, (processor_us() - from) / CALLS);
    from = processor_us();
    for (int k = 0; k < CALLS; k++) {
        q[k % c->joints] += 1e-6;
        plant_chain_terms(c, q, qd, mass, bias);
        sink = plant_factor(c->joints, mass, factor);
        plant_solve(c->joints, factor, bias, x);
        sink = x[0];
    }
    least(&us->all, (processor_us() - from) / CALLS);
}

static void chain_rounds(const struct plant_model *m, struct chain_us *us)
{
    struct plant_chain c;
    double q[PLANT_JOINTS_MAX], qd[PLANT_JOINTS_MAX];
    for (int i = 0; i < m->joints; i++) {
        q[i] = 0.3 + 0.1 * i;
        qd[i] = 1 - 0.1 * i;
    }
    plant_chain_prepare(m, &c);
    for (int r = 0; r < 3 * ROUNDS; r++)
        chain_round(&c, q, qd, us);
}

static double chain_cost_us(const struct plant_model *m)
{
    struct chain_us us = { 1e9, 1e9, 1e9, 1e9 };
    chain_rounds(m, &us);
    return us.all;
}

/* ---- a step ---- */

static void swing(const struct plant_model *m, double t_s, double *tau_m_nm)
{
    for (int i = 0; i < m->joints; i++)
        tau_m_nm[i] = 0.6 * m->joint[i].tau_max_m_nm * sin(TURN * 0.7 * t_s + i);
}

/* From rest through span_s, torque anew RATE_HZ times a second. */
static struct plant_state travel(const struct plant_model *m, double span_s)
{
    static const double start[PLANT_JOINTS_MAX] = { 0, 0.3, 0, 0.8, 0, 0.5, 0 };
    struct plant_state s;
    double tau[PLANT_JOINTS_MAX];
    plant_reset(m, &s, start, 1);
    for (long k = 0; k < lround(span_s * RATE_HZ); k++) {
        swing(m, (double)k / RATE_HZ, tau);
        plant_step(m, &s, tau, 1.0 / RATE_HZ);
    }
    return s;
}

/* Processor time per inner step, everything included. */
static double step_cost_us(const struct plant_model *m)
{
    double us = 1e9, span_s = 0.2;
    double steps = round(span_s * RATE_HZ) * ceil(1.0 / RATE_HZ / m->step_s - 1e-6);
    for (int r = 0; r < ROUNDS; r++) {
        double from = processor_us();
        sink = travel(m, span_s).q_rad[0];
        least(&us, (processor_us() - from) / steps);
    }
    return us;
}

/* ---- with the servo ---- */

static void command(struct servo *v, uint8_t type, double t_s)
{
    struct drv_command c = { .seq = 1, .type = type };
    struct hdt_frame in, out;
    for (int i = 0; i < PA10_JOINTS; i++) {
        c.axis[i].mode = DRV_AXIS_SERVO;
        c.axis[i].speed_dig = (int16_t)(1000 * sin(1.5 * t_s + i));
    }
    drv_command_encode(DRV_FORMAT_A, &c, &in);
    servo_answer(v, &in, &out);
}

/* Simulated seconds a second in velocity mode, all joints moving, a telegram each tick; negative: the
 * servo left control. */
static double times_real(struct plant_model raw, enum plant_integrator integrator, double seconds)
{
    static struct servo v;
    static const double start[PA10_JOINTS] = { 0, 0.3, 0, 0.8, 0, 0.5, 0 };
    struct plant_model m = checked(raw, integrator, 0);
    servo_init(&v, &m, NULL, start, 1);
    command(&v, DRV_START, 0);
    double from = processor_us();
    for (long k = 0; k < (long)(seconds * SERVO_RATE_HZ); k++) {
        command(&v, DRV_CYCLIC, v.s.t_s);
        servo_tick(&v);
    }
    double used_s = (processor_us() - from) * 1e-6;
    return v.s.mode == SERVO_CONTROL ? seconds / used_s : -1;
}

/* ---- exactness ---- */

static double furthest_rad(const struct plant_model *m, const struct plant_state *a,
                           const struct plant_state *b)
{
    double most = 0;
    for (int i = 0; i < m->joints; i++)
        most = fmax(most, fabs(a->q_rad[i] - b->q_rad[i]));
    return most;
}

/* Nothing with a corner in it: straight springs, viscous friction, no end stop within reach. */
static struct plant_model smooth_arm(void)
{
    struct plant_model m = plain_arm();
    for (int i = 0; i < m.joints; i++) {
        struct plant_joint *j = &m.joint[i];
        j->k_nmprad[1] = j->k_nmprad[2] = j->k_nmprad[0];
        j->q_max_rad = 100;
        j->q_min_rad = -100;
        j->friction[0].f0_nm = j->friction[0].fs_nm = 0;
        j->friction[1] = j->friction[0];
    }
    return m;
}

static struct plant_model with_tool(struct plant_model m)
{
    m.payload_kg = 2;
    m.payload_com_m[0] = 0.05;
    m.payload_com_m[2] = 0.1;
    return m;
}

static double print_error(const char *label, const struct plant_model *m,
                          const struct plant_state *reference)
{
    struct plant_state s = travel(m, 1);
    double error_rad = furthest_rad(m, &s, reference);
    printf("    %-34s %.1e rad\n", label, error_rad);
    return error_rad;
}

/* After 1 s, at several rates and at the chosen step, against a step of 2.6 us; what the reference is
 * worth is judged by one of twice its step.  The last line says which of the two meanings of "at 1500 Hz"
 * is which: so many calls a second, or so many steps. */
static void print_errors(const char *what, struct plant_model raw)
{
    enum { FINE = 256 };
    struct plant_model m = checked(raw, PLANT_RK4, 0), r = checked(raw, PLANT_RK4, 1.0 / RATE_HZ / FINE);
    struct plant_model half = checked(raw, PLANT_RK4, 2.0 / RATE_HZ / FINE);
    struct plant_state reference = travel(&r, 1), other = travel(&half, 1);
    char label[80];
    printf("  %s\n    %-34s itself within %.1e rad\n", what, "reference, step of 2.6 us",
           furthest_rad(&r, &reference, &other));
    snprintf(label, sizeof label, "called at %d Hz, chosen %.1f us", RATE_HZ, m.step_s * 1e6);
    double called_rad = print_error(label, &m, &reference), step_rad = -1, chosen_s = m.step_s;
    for (int times = 1; times <= 32; times *= 2) {
        m.step_s = 1.0 / RATE_HZ / times;
        snprintf(label, sizeof label, "step of %d Hz", RATE_HZ * times);
        if (plant_model_check(&m, NULL) != 0)
            printf("    %-34s refused: unstable for the stiffest mode\n", label);
        else if (times == 1)
            step_rad = print_error(label, &m, &reference);
        else
            print_error(label, &m, &reference);
    }
    printf("    within 1e-7 rad at %d Hz: %s as calls (%.0f steps of %.0f us each), %s as steps\n", RATE_HZ,
           called_rad < 1e-7 ? "yes" : "no", ceil(1.0 / RATE_HZ / chosen_s - 1e-6), chosen_s * 1e6,
           step_rad < 0 ? "refused" : step_rad < 1e-7 ? "yes" : "no");
}

/* Mean speed over the second second of joint 1 held at half its breakaway torque. */
static double creep_radps(enum plant_integrator integrator)
{
    struct plant_model m = checked(plain_arm(), integrator, 0);
    struct plant_state s;
    double q[PA10_JOINTS] = { 0 }, tau[PA10_JOINTS] = { 0 };
    tau[0] = 0.5 * m.joint[0].friction[0].f0_nm / m.joint[0].ratio;
    plant_reset(&m, &s, q, 1);
    plant_step(&m, &s, tau, 1);
    double from = s.th_m_rad[0];
    plant_step(&m, &s, tau, 1);
    return (s.th_m_rad[0] - from) / m.joint[0].ratio;
}

/* Where the smooth arm is after 1 s, and where it came from; MuJoCo has the same equations for it. */
static void print_travel(void)
{
    struct plant_model m = checked(smooth_arm(), PLANT_RK4, 1.0 / RATE_HZ / 32);
    struct plant_state s = travel(&m, 0), end = travel(&m, 1);
    printf("smooth_link_rad");
    for (int i = 0; i < m.joints; i++)
        printf(" %.15g", s.q_rad[i]);
    printf("\nsmooth_rotor_rad");
    for (int i = 0; i < m.joints; i++)
        printf(" %.15g", s.th_m_rad[i] / m.joint[i].ratio);
    printf("\nsmooth_end_rad");
    for (int i = 0; i < m.joints; i++)
        printf(" %.15g", end.q_rad[i]);
    printf("\n");
}

static void print_figures(void)
{
    struct plant_model verlet = checked(plain_arm(), PLANT_VERLET, 0);
    struct plant_model rk4 = checked(plain_arm(), PLANT_RK4, 0);
    printf("verlet_us %.4f\nverlet_step_us %.3f\n", step_cost_us(&verlet), verlet.step_s * 1e6);
    printf("rk4_us %.4f\nrk4_step_us %.3f\n", step_cost_us(&rk4), rk4.step_s * 1e6);
    printf("verlet_creep_radps %.3e\n", creep_radps(PLANT_VERLET));
    printf("rk4_creep_radps %.3e\n", creep_radps(PLANT_RK4));
    printf("chain_us %.4f\n", chain_cost_us(&verlet));
    printf("rate_hz %d\n", RATE_HZ);
    print_travel();
}

/* ---- the arm for MuJoCo ---- */

static void mjcf_numbers(const char *name, const double *v, int n)
{
    printf(" %s=\"", name);
    for (int k = 0; k < n; k++)
        printf("%s%.17g", k > 0 ? " " : "", v[k]);
    printf("\"");
}

/* Inertia about the centre of mass; a payload is not written. */
static void mjcf_inertial(const struct plant_joint *j)
{
    double c[3], cc = 0, in[6];
    static const int at[6][2] = { { 0, 0 }, { 0, 1 }, { 0, 2 }, { 1, 1 }, { 1, 2 }, { 2, 2 } };
    for (int k = 0; k < 3; k++) {
        c[k] = j->moment_kgm[k] / j->mass_kg;
        cc += c[k] * c[k];
    }
    for (int k = 0; k < 6; k++)
        in[k] = j->inertia_kgm2[k]
                - j->mass_kg * ((at[k][0] == at[k][1]) * cc - c[at[k][0]] * c[at[k][1]]);
    printf("<inertial mass=\"%.17g\"", j->mass_kg);
    mjcf_numbers("pos", c, 3);
    mjcf_numbers("fullinertia", (double[6]){ in[0], in[3], in[5], in[1], in[2], in[4] }, 6);
    printf("/>\n");
}

/* A hinge for the rotor, its inertia as armature, and on it a hinge for the spring: what MuJoCo has no
 * word for (second and third line of the spring, Stribeck, two sides) is left out. */
static void mjcf_joint(const struct plant_joint *j, int i)
{
    const double *r = j->rot, rotor = plant_rotor_kgm2(j);
    printf("<body name=\"rotor%d\"", i);
    mjcf_numbers("pos", j->trans_m, 3);
    mjcf_numbers("xyaxes", (double[6]){ r[0], r[3], r[6], r[1], r[4], r[7] }, 6);
    printf(">\n<inertial pos=\"0 0 0\" mass=\"1e-9\" diaginertia=\"1e-12 1e-12 1e-12\"/>\n");
    printf("<joint name=\"motor%d\" axis=\"0 0 1\"", i);
    mjcf_numbers("armature", &rotor, 1);
    mjcf_numbers("frictionloss", &j->friction[0].f0_nm, 1);
    mjcf_numbers("damping", &j->friction[0].fv_nmspr, 1);
    printf("/>\n<body name=\"link%d\">\n<joint name=\"spring%d\" axis=\"0 0 1\"", i, i);
    mjcf_numbers("stiffness", &j->k_nmprad[0], 1);
    mjcf_numbers("damping", &j->damping_nmspr, 1);
    printf("/>\n");
    mjcf_inertial(j);
}

static void print_mjcf(const struct plant_model *m)
{
    printf("<mujoco><compiler angle=\"radian\" boundmass=\"0\"/>\n");
    printf("<option");
    mjcf_numbers("gravity", m->gravity_mps2, 3);
    printf("><flag contact=\"disable\"/></option>\n<worldbody>\n");
    for (int i = 0; i < m->joints; i++)
        mjcf_joint(&m->joint[i], i);
    for (int i = 0; i < m->joints; i++)
        printf("</body></body>");
    printf("\n</worldbody>\n<actuator>\n");
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        printf("<motor joint=\"motor%d\" ctrllimited=\"true\"", i);
        mjcf_numbers("gear", &j->ratio, 1);
        mjcf_numbers("ctrlrange", (double[2]){ -j->tau_max_m_nm, j->tau_max_m_nm }, 2);
        printf("/>\n");
    }
    printf("</actuator>\n</mujoco>\n");
}

/* ---- printing ---- */

static void print_counts(void)
{
    printf("cost against joint count, us:\n  joints   chain  Verlet step  Runge-Kutta step\n");
    for (int n = 1; n <= PLANT_JOINTS_MAX; n++) {
        struct plant_model verlet = checked(long_arm(n), PLANT_VERLET, 0);
        struct plant_model rk4 = checked(long_arm(n), PLANT_RK4, 0);
        printf("  %6d  %6.3f  %11.3f  %16.3f\n", n, chain_cost_us(&verlet), step_cost_us(&verlet),
               step_cost_us(&rk4));
    }
}

enum { HEADS = 4 };

struct head { const char *what; struct plant_model m; double us; };

static void heads_round(struct head *h, struct chain_us *us)
{
    chain_rounds(&h[0].m, us);
    for (int k = 0; k < HEADS; k++)
        least(&h[k].us, step_cost_us(&h[k].m));
}

static void print_heads(const struct head *h, const struct chain_us *us)
{
    printf("chain of 7 joints: M and bias %.3f us, factor %.3f us, solve %.3f us; all in turn %.3f us\n",
           us->terms, us->factor, us->solve, us->all);
    printf("a step of 7 flexible joints:\n");
    for (int k = 0; k < HEADS; k++)
        printf("  %-46s %6.3f us, %7.0f steps/s; of %5.1f us: %5.0f x real time\n", h[k].what, h[k].us,
               1e6 / h[k].us, h[k].m.step_s * 1e6, h[k].m.step_s * 1e6 / h[k].us);
}

static void print_all(double seconds)
{
    struct head h[HEADS] = {
        { "Verlet: spring, Stribeck, stiction", checked(plain_arm(), PLANT_VERLET, 0), 1e9 },
        { "Runge-Kutta: the same", checked(plain_arm(), PLANT_RK4, 0), 1e9 },
        { "Verlet: and periodic friction, mesh, soft gear", checked(whole_arm(), PLANT_VERLET, 0), 1e9 },
        { "Runge-Kutta: the same", checked(whole_arm(), PLANT_RK4, 0), 1e9 },
    };
    struct chain_us us = { 1e9, 1e9, 1e9, 1e9 };
    heads_round(h, &us);
    print_counts();
    printf("with servo and telegrams, everything in: Verlet %.0f x real time, Runge-Kutta %.0f x\n",
           times_real(whole_arm(), PLANT_VERLET, seconds), times_real(whole_arm(), PLANT_RK4, seconds / 4));
    heads_round(h, &us);
    print_heads(h, &us);
    printf("Runge-Kutta after 1 s, furthest joint, torque held over 1/%d s:\n", RATE_HZ);
    print_errors("bare flange, spring, Stribeck, stiction", plain_arm());
    print_errors("2 kg tool off the axis, the same", with_tool(plain_arm()));
    print_errors("2 kg tool off the axis, straight springs, viscous friction, no stops",
                 with_tool(smooth_arm()));
    printf("creep of a joint held at half its breakaway torque: Verlet %g rad/s, Runge-Kutta %g rad/s\n",
           creep_radps(PLANT_VERLET), creep_radps(PLANT_RK4));
}

static int refuse(const char *argument)
{
    fprintf(stderr, "bench_sim: argument \"%s\": expected seconds above 0, --figures, --mjcf plain|smooth\n",
            argument);
    return 2;
}

int main(int argc, char **argv)
{
    const char *first = argc > 1 ? argv[1] : "20", *second = argc > 2 ? argv[2] : "";
    if (strcmp(first, "--figures") == 0 && argc == 2) {
        print_figures();
        return 0;
    }
    if (strcmp(first, "--mjcf") == 0 && argc == 3) {
        int smooth = strcmp(second, "smooth") == 0;
        if (!smooth && strcmp(second, "plain") != 0)
            return refuse(second);
        struct plant_model m = smooth ? smooth_arm() : plain_arm();
        print_mjcf(&m);
        return 0;
    }
    char *end;
    double seconds = strtod(first, &end);
    if (argc > 2 || end == first || *end != '\0' || !(seconds > 0 && seconds < 1e6))
        return refuse(argc > 2 ? second : first);
    print_all(seconds);
    return 0;
}
