/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Wave generator, mesh and kinematic error against physics, and both integrators: laws of the parts,
 * hysteresis, the drop of motor torque near zero load, reversal, virtual work, energy, order of error.
 * Method: closed forms by hand, energy balances, step halving.
 *
 * Owns: properties of sim/plant_gear.c, plant_lines.c, and of the step as an integrator.
 * Never: compares with a recorded run.
 */
#include <math.h>
#include <string.h>

#include "sim/plant_parts.h"
#include "tests/plant_rod.h"

enum { N = PA10_JOINTS };

static const double PI = 3.14159265358979323846;
static const enum plant_integrator BOTH[] = { PLANT_VERLET, PLANT_RK4 };

/* Wave-generator torque along the motion while the mesh slides under a load of gear_nm along it: the
 * fixed point s = gear + loss(s), line by line of the law in plant.h. */
static double sliding_wave_nm(const struct plant_joint *j, double gear_nm)
{
    const struct plant_mesh *m = &j->mesh;
    double rate = (m->drive_nm - m->back_nm) / (2 * j->soft_nm);
    if (gear_nm >= j->soft_nm - m->drive_nm)
        return (gear_nm + m->drive_nm - m->drive_load * j->soft_nm) / (1 - m->drive_load);
    if (gear_nm <= -j->soft_nm - m->back_nm)
        return (gear_nm + m->back_nm - m->back_load * j->soft_nm) / (1 + m->back_load);
    return (gear_nm + m->back_nm + rate * j->soft_nm) / (1 - rate);
}

static double rotor_friction_nm(const struct plant_friction *f, double along_radps)
{
    return f->f0_nm + f->fv_nmspr * along_radps + f->fs_nm * (1 - exp(-along_radps / f->vc_radps));
}

/* A flywheel so heavy that no torque changes its speed: what acts on it can be read at that speed. */
static void flywheel(struct plant_model *m)
{
    m->joint[0].fx_inertia_kgm2 = 1e9;
}

static void spin(const struct plant_model *m, struct plant_state *s, double w_radps)
{
    s->thd_m_radps[0] = w_radps * m->joint[0].ratio;
}

static double rotor_rad(const struct plant_model *m, const struct plant_state *s)
{
    return s->th_m_rad[0] / m->joint[0].ratio;
}

/* ---- the parts' laws ---- */

START_TEST(test_wave_generator_is_soft_then_stiff_odd_and_a_spring)
{
    struct plant_model m = geared_rod();
    const struct plant_joint *j = &m.joint[0];
    double edge = 21 / 5.4e4, h = 1e-6, work = 0, far = 3 * edge;
    ck_assert_double_eq_tol(plant_wave_nm(j, edge), 21, 1e-12);
    for (double d = h; d < far; d += edge / 7) {
        double slope = (plant_wave_nm(j, d + h) - plant_wave_nm(j, d)) / h;
        if (d + h <= edge)
            ck_assert_double_eq_tol(slope, 5.4e4, 1);
        if (d >= edge)
            ck_assert_double_eq_tol(slope, 29.4e4, 1);
        ck_assert_double_eq(plant_wave_nm(j, -d), -plant_wave_nm(j, d));
        ck_assert_double_eq_tol(plant_wave_windup_rad(j, plant_wave_nm(j, d)), d, 1e-15);
        ck_assert_double_eq_tol(plant_wave_windup_rad(j, plant_wave_nm(j, -d)), -d, 1e-15);
    }
    for (int k = 0; k < 6000; k++)
        work += plant_wave_nm(j, (k + 0.5) * far / 6000) * far / 6000;
    ck_assert_double_eq_tol(plant_wave_energy_j(j, far), work, 1e-6 * work);
    ck_assert_double_eq_tol(plant_wave_energy_j(j, -far), work, 1e-6 * work);
    /* two lines by hand: triangle below the edge, trapezium beyond */
    double top = 21 + 29.4e4 * 2 * edge;
    ck_assert_double_eq_tol(work, 21 * edge / 2 + (21 + top) / 2 * 2 * edge, 1e-6 * work);
}
END_TEST

START_TEST(test_mesh_loss_is_the_law_of_plant_h)
{
    struct plant_model m = geared_rod();
    struct plant_joint *j = &m.joint[0];
    j->mesh.drive_load = 0.05;
    j->mesh.back_load = 0.02;
    ck_assert_double_eq_tol(plant_mesh_loss_nm(j, 21), 32.2, 1e-12);
    ck_assert_double_eq_tol(plant_mesh_loss_nm(j, 121), 32.2 + 5, 1e-12);
    ck_assert_double_eq_tol(plant_mesh_loss_nm(j, 0), 17.1, 1e-12);
    ck_assert_double_eq_tol(plant_mesh_loss_nm(j, 10.5), (17.1 + 32.2) / 2, 1e-12);
    ck_assert_double_eq_tol(plant_mesh_loss_nm(j, -21), 2, 1e-12);
    ck_assert_double_eq_tol(plant_mesh_loss_nm(j, -121), 2 + 2, 1e-12);
}
END_TEST

/* Anywhere it may be: it ends where the torques on it differ by no more than the loss, by exactly the
 * loss if it moved, against the motion; and there it stays. */
START_TEST(test_mesh_gives_way_just_so_far_that_the_loss_holds_it)
{
    struct plant_model m = geared_rod();
    struct plant_joint *j = &m.joint[0];
    uint64_t rng = 3;
    int moved[2] = { 0, 0 }, stuck = 0;
    struct plant_gear gear;
    j->mesh.drive_load = 0.05;
    j->mesh.back_load = 0.02;
    plant_gear_prepare(j, &gear);
    for (int k = 0; k < 20000; k++) {
        double th = test_uniform(&rng, -1e-3, 1e-3), q = test_uniform(&rng, -1e-3, 1e-3);
        double z = test_uniform(&rng, -1e-3, 1e-3), less = k % 2 ? 0 : test_uniform(&rng, -40, 0);
        double end = plant_mesh_slip(j, &gear, less, th, q, z);
        double wave = plant_wave_nm(j, th - end), surplus = wave - plant_gear_nm(j, end - q);
        double sense = end > z ? 1 : end < z ? -1 : surplus < 0 ? -1 : 1;
        double loss = fmax(0, plant_mesh_loss_nm(j, sense * wave) + less);
        if (end == z)
            ck_assert_double_le(fabs(surplus), loss + 1e-9);
        else
            ck_assert_double_eq_tol(sense * surplus, loss, 1e-8);
        stuck += end == z;
        moved[sense > 0] += end != z;
        ck_assert_double_eq_tol(plant_mesh_slip(j, &gear, less, th, q, end), end, 1e-13);
    }
    ck_assert_int_gt(stuck, 1000);
    ck_assert_int_gt(moved[0], 1000);
    ck_assert_int_gt(moved[1], 1000);
}
END_TEST

/* ---- hysteresis: rotor braked, torque on the link ---- */

struct pull { double work_j, lost_j, at_zero_rad; };

/* Slowly to this load; work of the load, energy lost in the mesh, link angle where the load was zero. */
static struct pull pull(struct plant_model *m, struct plant_state *s, double to_nm)
{
    struct pull p = { 0, 0, NAN };
    double from = m->joint[0].fx_contact_nm, step = to_nm > from ? 0.02 : -0.02;
    long steps = lround((to_nm - from) / step);
    for (long k = 1; k <= steps; k++) {
        double q = s->q_rad[0], z = s->mesh_rad[0], load = from + step * (double)k;
        m->joint[0].fx_contact_nm = k == steps ? to_nm : load;
        plant_step(m, s, zero_torque, 1e-3);
        p.work_j -= m->joint[0].fx_contact_nm * (s->q_rad[0] - q);
        p.lost_j += fabs((s->wave_nm[0] - s->gear_nm[0]) * (s->mesh_rad[0] - z));
        if (fabs(load) < 0.011)
            p.at_zero_rad = s->q_rad[0];
    }
    return p;
}

static struct plant_model braked(struct plant_state *s)
{
    struct plant_model m = geared_rod();
    double q = 0;
    accept(&m);
    plant_reset(&m, s, &q, 1);
    s->locked = 1;
    return m;
}

START_TEST(test_hysteresis_loop_loses_its_area_and_is_as_wide_as_the_catalogue_says)
{
    struct plant_state s;
    struct plant_model m = braked(&s);
    pull(&m, &s, 80);
    double first = plant_energy_j(&m, &s), q = s.q_rad[0], rotor = s.th_m_rad[0];
    struct pull down = pull(&m, &s, -80), up = pull(&m, &s, 80);
    double area = down.work_j + up.work_j, lost = down.lost_j + up.lost_j;
    ck_assert_double_eq_tol(s.q_rad[0], q, 1e-8); /* closed */
    ck_assert_double_eq_tol(plant_energy_j(&m, &s), first, 1e-6);
    ck_assert_double_gt(area, 0.02);
    ck_assert_double_eq_tol(area, lost, 0.01 * area);
    double width = fabs(up.at_zero_rad - down.at_zero_rad) * 180 / PI * 60;
    ck_assert_double_gt(width, 0.5); /* minutes of arc at 80 N.m; catalogue: 1 to 2 */
    ck_assert_double_lt(width, 3);
    ck_assert(memcmp(&rotor, &s.th_m_rad[0], sizeof rotor) == 0);
}
END_TEST

START_TEST(test_inner_loop_closes_at_its_turning_point)
{
    struct plant_state s;
    struct plant_model m = braked(&s);
    pull(&m, &s, 80);
    pull(&m, &s, -60);
    double q = s.q_rad[0], z = s.mesh_rad[0];
    struct pull up = pull(&m, &s, 50), down = pull(&m, &s, -60);
    ck_assert_double_gt(up.lost_j + down.lost_j, 1e-3); /* it is a loop */
    ck_assert_double_gt(fabs(up.at_zero_rad - down.at_zero_rad), 1e-5);
    ck_assert_double_eq_tol(s.q_rad[0], q, 1e-8);
    ck_assert_double_eq_tol(s.mesh_rad[0], z, 1e-8);
    /* a small one does not reach the edge of the loss: it gives back what it was given */
    pull(&m, &s, -59);
    double stuck = s.mesh_rad[0], first = plant_energy_j(&m, &s);
    up = pull(&m, &s, -50);
    down = pull(&m, &s, -59);
    ck_assert_double_eq(s.mesh_rad[0], stuck);
    ck_assert_double_gt(-up.work_j, 5e-3); /* what is lost is the parallel damper's, at this speed */
    ck_assert_double_eq_tol(up.work_j + down.work_j, plant_energy_j(&m, &s) - first, 1e-5);
}
END_TEST

/* ---- sliding slowly under load ---- */

/* Rod driven at v by the torque that closed forms predict; both loads and both directions. */
static void slides_as_predicted(struct plant_model m, double load_nm, int sense)
{
    const double v = 0.05;
    struct plant_state s;
    double q = 0;
    m.joint[0].fx_contact_nm = load_nm;
    accept(&m);
    double wave = sense * sliding_wave_nm(&m.joint[0], sense * load_nm);
    double torque = wave + sense * rotor_friction_nm(&m.joint[0].friction[sense < 0], v);
    plant_reset(&m, &s, &q, 1);
    spin(&m, &s, sense * v);
    s.qd_radps[0] = sense * v;
    run(&m, &s, torque / 50, 1.2);
    ck_assert_double_eq_tol(speed(&m, &s, 0), sense * v, 1e-3 * v);
    ck_assert_double_eq_tol(s.gear_nm[0], load_nm, 1e-3);
    ck_assert_double_eq_tol(s.wave_nm[0], wave, 2e-3);
    ck_assert_double_eq_tol(torque - s.wave_nm[0], s.friction_nm[0], 2e-3);
}

START_TEST(test_motor_carries_load_rotor_friction_and_mesh_loss)
{
    for (int which = 0; which < 2; which++)
        for (int heavy = 0; heavy < 2; heavy++)
            for (double load = -80; load <= 80; load += 5)
                for (int sense = -1; sense <= 1; sense += 2) {
                    struct plant_model m = geared_rod();
                    m.integrator = BOTH[which];
                    m.joint[0].friction[1].f0_nm = 9;
                    m.joint[0].mesh.drive_load = heavy * 0.05;
                    m.joint[0].mesh.back_load = heavy * 0.02;
                    slides_as_predicted(m, load, sense);
                }
}
END_TEST

/* Motor torque against motor-side rotor friction, from a run: what the wave generator carries. */
static double measured_wave_nm(double load_nm, int sense)
{
    struct plant_model m = geared_rod();
    struct plant_state s;
    double q = 0;
    m.joint[0].fx_contact_nm = load_nm;
    flywheel(&m);
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    spin(&m, &s, sense * 0.02);
    s.qd_radps[0] = sense * 0.02;
    run(&m, &s, 0, 0.6);
    return s.wave_nm[0];
}

/* Load at which the line through loads a, b meets the one through c, d. */
static double meeting_nm(double a, double b, double c, double d, int sense)
{
    double fa = measured_wave_nm(a, sense), fb = measured_wave_nm(b, sense),
           fc = measured_wave_nm(c, sense), fd = measured_wave_nm(d, sense);
    double p = (fb - fa) / (b - a), r = (fd - fc) / (d - c);
    return (fc - fa + p * a - r * c) / (p - r);
}

/* Paper, Table V, joint 2 positive: lines join at -23.5 and -11.8 N.m; here they follow from the mesh. */
START_TEST(test_drop_of_motor_torque_follows_from_soft_drive_and_back)
{
    for (int sense = -1; sense <= 1; sense += 2) {
        double low = meeting_nm(-80 * sense, -40 * sense, -21 * sense, -14 * sense, sense);
        double high = meeting_nm(20 * sense, 80 * sense, -21 * sense, -14 * sense, sense);
        ck_assert_double_eq_tol(sense * low, -21 - 2, 0.05);
        ck_assert_double_eq_tol(sense * high, 21 - 32.2, 0.05);
        /* beyond the lines' ends the motor carries load and loss; the step is what the losses differ by */
        double above = sense * measured_wave_nm(30 * sense, sense) - 30;
        double below = sense * measured_wave_nm(-40 * sense, sense) + 40;
        ck_assert_double_eq_tol(above - below, 32.2 - 2, 0.02);
        ck_assert_double_eq_tol(above, 32.2, 0.02);
    }
}
END_TEST

/* Half the difference of the most and the least that the rotor rubs in one period of its line. */
static double friction_swing_nm(double wave_nm)
{
    const double w = 0.05;
    struct plant_model m = geared_rod();
    struct plant_state s;
    double q = 0, most = -1e9, least = 1e9;
    m.joint[0].line[m.joint[0].lines++] = (struct plant_line){ 300, 4, 0.3, 1, 0, 0, 0 };
    flywheel(&m);
    m.joint[0].fx_contact_nm = wave_nm - plant_mesh_loss_nm(&m.joint[0], wave_nm);
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    spin(&m, &s, w);
    s.qd_radps[0] = w;
    run(&m, &s, 0, 0.4);
    ck_assert_double_eq_tol(s.wave_nm[0], wave_nm, 0.05);
    for (double t = 0; t < 2 * PI / 300 / w; t += 5e-4) {
        plant_step(&m, &s, zero_torque, 5e-4);
        most = fmax(most, s.friction_nm[0]);
        least = fmin(least, s.friction_nm[0]);
    }
    return (most - least) / 2;
}

START_TEST(test_periodic_friction_fades_while_the_teeth_are_unloaded)
{
    ck_assert_double_eq_tol(friction_swing_nm(60), 4, 0.02);
    ck_assert_double_eq_tol(friction_swing_nm(22), 4, 0.02);
    ck_assert_double_eq_tol(friction_swing_nm(10.5), 2, 0.04);
    ck_assert_double_eq_tol(friction_swing_nm(-10.5), 2, 0.04);
    ck_assert_double_lt(friction_swing_nm(0), 0.04);
    ck_assert_double_eq_tol(friction_swing_nm(-40), 4, 0.02);
}
END_TEST

/* A line that is deeper than the rotor's own friction takes the rest from the mesh: what rotor and wave
 * generator need together swings by the whole of it. */
START_TEST(test_line_deeper_than_the_rotor_s_friction_takes_from_the_mesh)
{
    const double w = 0.02, deep = 12;
    struct plant_model m = geared_rod();
    struct plant_state s;
    double q = 0, least_rub = 1e9;
    m.joint[0].line[m.joint[0].lines++] = (struct plant_line){ 100, deep, 0, 1, 0, 0, 0 };
    flywheel(&m);
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    spin(&m, &s, w);
    s.qd_radps[0] = w;
    run(&m, &s, 0, 0.5);
    double rubs = rotor_friction_nm(&m.joint[0].friction[0], w);
    for (double t = 0; t < 2 * PI / 100 / w; t += 1e-3) {
        plant_step(&m, &s, zero_torque, 1e-3);
        double line = deep * sin(100 * rotor_rad(&m, &s));
        ck_assert_double_eq_tol(s.friction_nm[0] + s.wave_nm[0], rubs + 32.2 + line, 0.15);
        ck_assert_double_ge(s.friction_nm[0], 0);
        least_rub = fmin(least_rub, s.friction_nm[0]);
    }
    ck_assert_double_eq_tol(least_rub, 35.32 * w, 0.01); /* at its deepest only the viscous part is left */
}
END_TEST

/* ---- reversal and rest ---- */

/* A rotor turned back at once at every speed: its own friction turns with it, the mesh's comes with the
 * wave generator's wind-up. */
START_TEST(test_friction_builds_up_over_the_wind_up_after_a_reversal)
{
    const double w = 3e-4;
    for (int sense = -1; sense <= 1; sense += 2) {
        struct plant_model m = geared_rod();
        struct plant_state s;
        double q = 0;
        flywheel(&m);
        accept(&m);
        plant_reset(&m, &s, &q, 1);
        spin(&m, &s, -sense * w);
        run(&m, &s, 0, 4); /* 1.2e-3 rad */
        ck_assert_double_eq_tol(s.wave_nm[0], -sense * 32.2, 0.01);
        double back = plant_wave_windup_rad(&m.joint[0], 32.2), turned = rotor_rad(&m, &s);
        double rubs = rotor_friction_nm(&m.joint[0].friction[0], w), travel = 0;
        spin(&m, &s, sense * w);
        while (travel < 2.5 * back) {
            plant_step(&m, &s, zero_torque, 1e-3);
            travel = sense * (rotor_rad(&m, &s) - turned);
            double wave = fmin(32.2, plant_wave_nm(&m.joint[0], travel - back));
            ck_assert_double_eq_tol(sense * s.friction_nm[0], rubs, 1e-3);
            ck_assert_double_eq_tol(sense * s.wave_nm[0], wave, 0.15); /* the link swings a little */
        }
        ck_assert_double_eq_tol(sense * s.wave_nm[0], 32.2, 0.05);
        /* 2.9 minutes of arc from one side to the other */
        ck_assert_double_eq_tol(2 * back, 2 * (21 / 5.4e4 + 11.2 / 29.4e4), 1e-12);
    }
}
END_TEST

START_TEST(test_rotor_and_link_at_half_of_breakaway_do_not_move_a_bit)
{
    for (int which = 0; which < 2; which++)
        for (int sense = -1; sense <= 1; sense += 2) {
            struct plant_model m = geared_rod();
            struct plant_state s, start;
            double q = 0.7;
            m.integrator = BOTH[which];
            accept(&m);
            plant_reset(&m, &s, &q, 1);
            start = s;
            run(&m, &s, sense * 0.5 * 7.7709 / 50, 10);
            ck_assert(memcmp(s.th_m_rad, start.th_m_rad, sizeof s.th_m_rad) == 0);
            ck_assert(memcmp(s.q_rad, start.q_rad, sizeof s.q_rad) == 0);
            ck_assert(memcmp(s.mesh_rad, start.mesh_rad, sizeof s.mesh_rad) == 0);
            ck_assert_double_eq(s.thd_m_radps[0], 0);
            ck_assert_double_eq(s.qd_radps[0], 0);
            ck_assert_double_eq_tol(s.friction_nm[0], sense * 0.5 * 7.7709, 1e-9);
            /* led on to 0.98 of what rotor and mesh lose together it winds up and stands again */
            for (double share = 0.1; share < 0.98; share += 5e-4)
                run(&m, &s, sense * share * (7.7709 + 32.2) / 50, 1e-3);
            run(&m, &s, sense * 0.98 * (7.7709 + 32.2) / 50, 0.1);
            double held = s.th_m_rad[0], travel = sense * (held - start.th_m_rad[0]) / 50;
            double wind_up = plant_wave_windup_rad(&m.joint[0], 0.98 * (7.7709 + 32.2) - 7.7709);
            ck_assert_double_eq_tol(travel, wind_up, 0.05 * wind_up);
            run(&m, &s, sense * 0.98 * (7.7709 + 32.2) / 50, 5);
            ck_assert(memcmp(&held, &s.th_m_rad[0], sizeof held) == 0);
            run(&m, &s, sense * 1.02 * (7.7709 + 32.2) / 50, 1);
            ck_assert_double_gt(sense * (s.th_m_rad[0] - held) / 50, 1e-3);
        }
}
END_TEST

/* ---- kinematic error ---- */

static const struct plant_error ERRORS[2] = { { 100, 2e-4, 0.4 }, { 200, 5e-5, -1.1 } };

static double error_rad(double th_rad)
{
    return 2e-4 * sin(100 * th_rad + 0.4) + 5e-5 * sin(200 * th_rad - 1.1);
}

static struct plant_model erring_rod(void)
{
    struct plant_model m = geared_rod();
    memcpy(m.joint[0].error, ERRORS, sizeof ERRORS);
    m.joint[0].errors = 2;
    return m;
}

START_TEST(test_link_follows_the_rotor_ahead_by_the_error_less_the_wind_up)
{
    const double loads[] = { 0, 25, -40 };
    for (int which = 0; which < 2; which++)
        for (size_t k = 0; k < sizeof loads / sizeof loads[0]; k++) {
            struct plant_model m = erring_rod();
            struct plant_state s;
            double q = 0.1, span = 0, worst = 0;
            m.integrator = BOTH[which];
            m.joint[0].fx_contact_nm = loads[k];
            flywheel(&m);
            accept(&m);
            plant_reset(&m, &s, &q, 1);
            spin(&m, &s, 0.01);
            s.qd_radps[0] = 0.01;
            run(&m, &s, 0, 0.3);
            /* the mesh slides forward all the while: wave and gear carry the load and the loss */
            double wind_up = plant_wave_windup_rad(&m.joint[0], sliding_wave_nm(&m.joint[0], loads[k]))
                             + plant_gear_windup_rad(&m.joint[0], loads[k]);
            for (int i = 0; i < 6300; i++) {
                run(&m, &s, 0, 1e-3);
                double th = rotor_rad(&m, &s);
                worst = fmax(worst, fabs(s.q_rad[0] - (th + error_rad(th) - wind_up)));
                span = fmax(span, fabs(error_rad(th)));
            }
            ck_assert_double_gt(span, 2e-4); /* over a period and more */
            ck_assert_double_lt(worst, 5e-6);
        }
}
END_TEST

/* Virtual work: the rotor turned by dth lifts the load by (1 + e') dth. */
START_TEST(test_motor_torque_ripples_by_load_times_slope_of_the_error)
{
    struct plant_model m = erring_rod();
    const double load = 45, h = 1e-6;
    double ripple = 0;
    m.joint[0].mesh = (struct plant_mesh){ 0, 0, 0, 0 };
    m.joint[0].fx_contact_nm = load;
    accept(&m);
    for (double q = 0; q < 0.063; q += 1e-3) {
        struct plant_state s;
        plant_reset(&m, &s, &q, 1);
        s.locked = 1;
        plant_step(&m, &s, zero_torque, 1e-6);
        double th = rotor_rad(&m, &s), slope = (error_rad(th + h) - error_rad(th - h)) / (2 * h);
        ck_assert_double_eq_tol(-s.friction_nm[0], load * (1 + slope), 1e-5 * load);
        ripple = fmax(ripple, fabs(-s.friction_nm[0] - load));
    }
    ck_assert_double_gt(ripple, 0.8);
}
END_TEST

START_TEST(test_rest_with_error_and_load_is_rest)
{
    for (double load = -60; load <= 60; load += 15)
        for (double q = -0.05; q < 0.05; q += 0.013) {
            struct plant_model m = erring_rod();
            struct plant_state s;
            m.joint[0].fx_contact_nm = load;
            accept(&m);
            plant_reset(&m, &s, &q, 1);
            s.locked = 1;
            run(&m, &s, 0, 0.05);
            ck_assert_double_eq_tol(s.q_rad[0], q, 1e-11);
            ck_assert_double_eq_tol(s.gear_nm[0], load, 1e-6);
        }
}
END_TEST

/* ---- energy ---- */

/* Everything the gear has, on all joints; friction of the rotor left after the mesh has its share. */
static struct plant_model whole_arm(void)
{
    struct plant_model m = pa10_plant();
    for (int i = 0; i < N; i++) {
        struct plant_joint *j = &m.joint[i];
        j->soft_nm = 0.7 * j->t_nm[0];
        j->soft_nmprad = j->k_nmprad[0];
        j->hard_nmprad = 3 * j->k_nmprad[2];
        j->mesh = (struct plant_mesh){ 0.75 * fmin(j->friction[0].f0_nm, j->t_nm[0]),
                                       0.05 * j->t_nm[0], 0.05, 0.02 };
        for (int d = 0; d < 2; d++) {
            j->friction[d].f0_nm -= j->mesh.drive_nm;
            j->friction[d].fs_nm = fmax(j->friction[d].fs_nm, -j->friction[d].f0_nm);
        }
        j->line[j->lines++] = (struct plant_line){ 37, 0.05 * j->t_nm[0], 1.1, 0, 0, 0, 0 };
        j->line[j->lines++] = (struct plant_line){ 21.37, 0.03 * j->t_nm[0], 0, 0, 1, 0, 0 };
        memcpy(j->error, ERRORS, sizeof ERRORS);
        j->errors = 2;
    }
    return m;
}

/* Most that energy less work of the motors ever rises above where it was, in one random motion. */
static double most_made_j(const struct plant_model *m, uint64_t *rng, int steps, double *turned_j)
{
    struct plant_state s;
    double q[N], tau[N], lowest, made = 0;
    for (int i = 0; i < N; i++)
        q[i] = test_uniform(rng, -1.2, 1.2);
    plant_reset(m, &s, q, test_random(rng));
    double first = plant_energy_j(m, &s), work = 0;
    lowest = first;
    for (int k = 0; k < steps; k++) {
        double before[N];
        for (int i = 0; i < N && k % 25 == 0; i++)
            tau[i] = m->joint[i].tau_max_m_nm * test_uniform(rng, -1, 1);
        memcpy(before, s.th_m_rad, sizeof before);
        plant_step(m, &s, tau, 1e-3);
        for (int i = 0; i < N; i++)
            work += tau[i] * (s.th_m_rad[i] - before[i]);
        double left = plant_energy_j(m, &s) - work;
        made = fmax(made, left - lowest);
        lowest = fmin(lowest, left);
    }
    *turned_j += first - lowest;
    return made;
}

/* Nothing rubs on the rotors: what is lost, the mesh loses. */
static struct plant_model mesh_only_arm(void)
{
    struct plant_model m = whole_arm();
    for (int i = 0; i < N; i++) {
        struct plant_joint *j = &m.joint[i];
        memset(j->friction, 0, sizeof j->friction);
        j->damping_nmspr = 0;
        for (int k = 0; k < j->lines; k++)
            j->line[k].directed = 0;
    }
    return m;
}

static void never_gives(struct plant_model m, enum plant_integrator integrator, double bound_j, double lost_j)
{
    uint64_t rng = 51;
    double turned = 0;
    m.integrator = integrator;
    accept(&m);
    for (int trial = 0; trial < 8; trial++)
        ck_assert_double_le(most_made_j(&m, &rng, 600, &turned), bound_j);
    ck_assert_double_gt(turned, lost_j);
}

START_TEST(test_gear_and_friction_never_give_more_than_was_put_in)
{
    for (int which = 0; which < 2; which++)
        never_gives(whole_arm(), BOTH[which], 1e-9, 500);
    /* the mesh alone does not hide the integrators' own error */
    never_gives(mesh_only_arm(), PLANT_VERLET, 0.02, 500);
    never_gives(mesh_only_arm(), PLANT_RK4, 1e-6, 500);
}
END_TEST

static struct plant_model lossless_arm(enum plant_integrator integrator)
{
    struct plant_model m = whole_arm();
    m.integrator = integrator;
    for (int i = 0; i < N; i++) {
        struct plant_joint *j = &m.joint[i];
        int kept = 0;
        for (int k = 0; k < j->lines; k++)
            if (!j->line[k].directed)
                j->line[kept++] = j->line[k];
        j->lines = kept;
        j->mesh = (struct plant_mesh){ 0, 0, 0, 0 };
        memset(j->friction, 0, sizeof j->friction);
        j->damping_nmspr = 0;
        j->fx_spring_nmprad = 3;
        j->q_min_rad = -100;
        j->q_max_rad = 100;
    }
    return m;
}

/* Lines with a phase of the run among them; corners of the springs limit both integrators' order. */
START_TEST(test_energy_is_conserved_where_nothing_rubs)
{
    const double bound[] = { 0.1, 1e-5 }; /* J, of some 100 J turned from height into speed */
    for (int which = 0; which < 2; which++)
        for (int half = 0; half < 2; half++) {
            struct plant_model m = lossless_arm(BOTH[which]);
            struct plant_state s;
            double q[N] = { 0, 0.5, 0.3, 1, 0.2, 0.5, 0.1 }, worst = 0, height = 0;
            accept(&m);
            m.step_s /= 1 << half;
            plant_reset(&m, &s, q, 7);
            double first = plant_energy_j(&m, &s);
            for (int k = 0; k < 250; k++) {
                run(&m, &s, 0, 2e-3);
                worst = fmax(worst, fabs(plant_energy_j(&m, &s) - first));
                height = fmax(height, fabs(s.q_rad[1] - q[1]));
            }
            ck_assert_double_gt(height, 0.5);
            ck_assert_double_lt(worst, bound[which] / (1 << half));
        }
}
END_TEST

/* ---- order of the error ---- */

/* Mesh sliding forward all the time, springs on one line each, everything else curved. */
static struct plant_model smooth_rod(void)
{
    struct plant_model m = erring_rod();
    m.gravity_mps2[2] = -3;
    m.joint[0].line[m.joint[0].lines++] = (struct plant_line){ 100, 3, 0.3, 1, 0, 0.02, 1 };
    m.joint[0].line[m.joint[0].lines++] = (struct plant_line){ 60, 2, 1, 0, 0, 0.02, 0 };
    m.joint[0].fx_load_mu = m.joint[0].fx_drive_mu = 0.03;
    m.joint[0].mesh.drive_load = 0.05;
    m.joint[0].fx_contact_nm = 60;
    return m;
}

/* The rod sliding, long after it broke away: that instant is no part of what is measured. */
static struct plant_state under_way(struct plant_model m, double tau_m_nm)
{
    struct plant_state s;
    double q = 0.2;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    spin(&m, &s, 0.1);
    s.qd_radps[0] = 0.1;
    run(&m, &s, tau_m_nm, 0.05);
    return s;
}

/* Link and rotor 0.1 s later, by steps of h: angles, and speeds over the gear's frequency. */
static void moved(struct plant_model m, struct plant_state s, double h_s, double tau_m_nm, double *end)
{
    accept(&m);
    m.step_s = h_s;
    plant_step(&m, &s, &tau_m_nm, 0.1);
    ck_assert_double_gt(s.wave_nm[0], 25);
    ck_assert_double_gt(s.gear_nm[0], 35);
    end[0] = s.q_rad[0];
    end[1] = rotor_rad(&m, &s);
    end[2] = s.qd_radps[0] / 300;
    end[3] = speed(&m, &s, 0) / 300;
}

static double apart(const double *a, const double *b)
{
    double square = 0;
    for (int i = 0; i < 4; i++)
        square += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(square);
}

static void check_order(struct plant_model m, enum plant_integrator integrator, double h_s,
                        double tau_m_nm, double ratio, double tol)
{
    double end[3][4];
    m.integrator = integrator;
    struct plant_state s = under_way(m, tau_m_nm);
    s.qd_radps[0] += 0.02; /* and some ringing */
    for (int k = 0; k < 3; k++)
        moved(m, s, h_s / (1 << k), tau_m_nm, end[k]);
    ck_assert_double_eq_tol(apart(end[0], end[1]) / apart(end[1], end[2]), ratio, tol);
}

START_TEST(test_runge_kutta_is_of_fourth_order_also_while_the_mesh_slides)
{
    check_order(smooth_rod(), PLANT_RK4, 1e-3, 120.0 / 50, 16, 3);
    struct plant_model rigid = smooth_rod();
    rigid.joint[0].soft_nm = 0;
    rigid.joint[0].mesh = (struct plant_mesh){ 0, 0, 0, 0 };
    check_order(rigid, PLANT_RK4, 1e-3, 90.0 / 50, 16, 3);
}
END_TEST

/* What depends on speed is met to the first order; without it the kick is symmetric. */
START_TEST(test_verlet_is_of_second_order_where_nothing_depends_on_speed)
{
    struct plant_model m = smooth_rod();
    struct plant_joint *j = &m.joint[0];
    memset(j->friction, 0, sizeof j->friction);
    j->damping_nmspr = 0;
    j->line[0] = (struct plant_line){ 60, 2, 1, 0, 0, 0, 0 };
    j->lines = 1;
    j->fx_load_mu = j->fx_drive_mu = 0;
    j->mesh = (struct plant_mesh){ 0, 0, 0, 0 };
    m.gravity_mps2[2] = 0; /* frozen over a block: first order, and tested elsewhere */
    check_order(m, PLANT_VERLET, 2e-4, 70.0 / 50, 4, 0.6);
}
END_TEST

/* Rotor with a falling friction curve, held by a soft servo that creeps ahead. */
static struct plant_state stick_slip(enum plant_integrator integrator, double step_s, int *stands,
                                     double *path, int samples)
{
    struct plant_model m = geared_rod();
    struct plant_state s;
    double q = 0;
    m.integrator = integrator;
    for (int d = 0; d < 2; d++)
        m.joint[0].friction[d] = (struct plant_friction){ 12, 2, -6, 0.02 };
    accept(&m);
    m.step_s = step_s;
    plant_reset(&m, &s, &q, 1);
    *stands = 0;
    for (int k = 0, stood = 1; k < samples; k++) {
        double tau = 60 * (0.05 * s.t_s - rotor_rad(&m, &s)) / 50 * 5;
        plant_step(&m, &s, &tau, 1e-3);
        path[k] = s.q_rad[0];
        *stands += !stood && s.thd_m_radps[0] == 0;
        stood = s.thd_m_radps[0] == 0;
    }
    return s;
}

START_TEST(test_both_integrators_agree_on_stick_and_slip)
{
    enum { SAMPLES = 4000 };
    static double a[SAMPLES], b[SAMPLES];
    int stands[2];
    double worst = 0;
    stick_slip(PLANT_VERLET, 2e-5, &stands[0], a, SAMPLES);
    struct plant_state end = stick_slip(PLANT_RK4, 2e-5, &stands[1], b, SAMPLES);
    for (int k = 0; k < SAMPLES; k++)
        worst = fmax(worst, fabs(a[k] - b[k]));
    ck_assert_int_ge(stands[0], 3);
    ck_assert_int_eq(stands[0], stands[1]);
    ck_assert_double_gt(end.q_rad[0], 0.05);
    ck_assert_double_lt(worst, 2e-4);
}
END_TEST

START_TEST(test_too_long_a_step_is_refused_and_would_be_unstable)
{
    struct plant_model m = geared_rod();
    const char *why;
    m.joint[0].soft_nm = 0;
    m.joint[0].mesh = (struct plant_mesh){ 0, 0, 0, 0 };
    m.joint[0].k_nmprad[1] = m.joint[0].k_nmprad[2] = m.joint[0].k_nmprad[0];
    m.joint[0].damping_nmspr = 0;
    memset(m.joint[0].friction, 0, sizeof m.joint[0].friction);
    double rate = sqrt(5.4e4 * (1 / (4.69e-4 * 2500) + 1 / 0.7)); /* rad/s */
    const double limit[] = { [PLANT_VERLET] = 1.5, [PLANT_RK4] = 2.5 };
    const double unstable[] = { [PLANT_VERLET] = 2.05, [PLANT_RK4] = 2.9 };
    for (int which = 0; which < 2; which++) {
        enum plant_integrator it = BOTH[which];
        struct plant_state s;
        double q = 0, first;
        m.integrator = it;
        m.step_s = limit[it] * 1.01 / rate;
        ck_assert_int_eq(plant_model_check(&m, &why), -1);
        ck_assert_ptr_nonnull(strstr(why, "unstable"));
        ck_assert_ptr_nonnull(strstr(why, "step_s"));
        for (int over = 0; over < 2; over++) { /* at the limit it holds; beyond 2 or 2.83 it would not */
            m.step_s = limit[it] * 0.99 / rate;
            accept(&m);
            m.step_s = over ? unstable[it] / rate : m.step_s;
            plant_reset(&m, &s, &q, 1);
            s.th_m_rad[0] += 50 * 1e-6;
            first = plant_energy_j(&m, &s);
            for (int k = 0; k < 60; k++)
                plant_step(&m, &s, zero_torque, m.step_s);
            if (over)
                ck_assert_double_gt(plant_energy_j(&m, &s), 100 * first);
            else
                ck_assert_double_lt(plant_energy_j(&m, &s), 3 * first);
        }
    }
}
END_TEST

START_TEST(test_locked_joints_stay_to_the_last_bit)
{
    for (int which = 0; which < 2; which++) {
        struct plant_model m = whole_arm();
        struct plant_state s;
        uint64_t rng = 61;
        double q[N] = { 0.1, 0.6, -0.3, 0.9, 0.2, 0.5, 0 }, start[N], tau[N];
        m.integrator = BOTH[which];
        accept(&m);
        plant_reset(&m, &s, q, 1);
        memcpy(start, s.th_m_rad, sizeof start);
        s.locked = 0x2a;
        for (int k = 0; k < 300; k++) {
            for (int i = 0; i < N; i++)
                tau[i] = m.joint[i].tau_max_m_nm * test_uniform(&rng, -1, 1);
            plant_step(&m, &s, tau, 1e-3);
            for (int i = 1; i < N; i += 2) {
                ck_assert(memcmp(&s.th_m_rad[i], &start[i], sizeof start[i]) == 0);
                ck_assert_double_eq(s.thd_m_radps[i], 0);
            }
        }
        for (int i = 0; i < N; i += 2)
            ck_assert_double_ne(s.th_m_rad[i], start[i]);
    }
}
END_TEST

/* ---- changes in time ---- */

static uint32_t field_of(const struct plant_model *m, const double *field)
{
    return (uint32_t)((const char *)field - (const char *)m);
}

START_TEST(test_changes_hold_from_and_until_and_add_up)
{
    struct plant_model m = geared_rod(), scratch;
    const struct { double t, contact, drag; } at[] = {
        { 0, 5, 0 },   { 0.999999, 5, 0 }, { 1, 8, 0 },   { 1.5, 18, 0.5 },
        { 1.999, 18, 0.5 }, { 2, 15, 0.5 }, { 2.999, 15, 0.5 }, { 3, 5, 0 }, { 1e6, 5, 0 } };
    m.joint[0].fx_contact_nm = 5;
    m.change[0] = (struct plant_change){ field_of(&m, &m.joint[0].fx_contact_nm), 3, 1, 2 };
    m.change[1] = (struct plant_change){ field_of(&m, &m.joint[0].fx_contact_nm), 10, 1.5, 3 };
    m.change[2] = (struct plant_change){ field_of(&m, &m.joint[0].fx_drag_nm), 0.5, 1.5, 3 };
    m.changes = 3;
    accept(&m);
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
        const struct plant_model *now = plant_now(&m, at[k].t, &scratch);
        ck_assert_double_eq(now->joint[0].fx_contact_nm, at[k].contact);
        ck_assert_double_eq(now->joint[0].fx_drag_nm, at[k].drag);
        ck_assert_int_eq(now == &m, at[k].contact == 5);
    }
    ck_assert_ptr_ne(plant_now(&m, 1, &scratch), &m);
    ck_assert_ptr_eq(plant_now(&m, nextafter(1, 0), &scratch), &m);
    ck_assert_ptr_ne(plant_now(&m, nextafter(3, 0), &scratch), &m);
}
END_TEST

START_TEST(test_before_a_change_the_run_is_the_one_without_it)
{
    for (int which = 0; which < 2; which++) {
        struct plant_model plain = whole_arm(), changed = whole_arm();
        struct plant_state a, b;
        double q[N] = { 0, 0.4, 0, 0.7, 0, 0.3, 0 };
        plain.integrator = changed.integrator = BOTH[which];
        changed.change[0] =
            (struct plant_change){ field_of(&changed, &changed.joint[1].fx_drag_nm), 20, 0.1, 0.15 };
        changed.changes = 1;
        accept(&plain);
        accept(&changed);
        plant_reset(&plain, &a, q, 3);
        plant_reset(&changed, &b, q, 3);
        while (a.t_s < 0.1) {
            ck_assert(memcmp(&a, &b, sizeof a) == 0);
            run(&plain, &a, 0.25, 1e-3);
            run(&changed, &b, 0.25, 1e-3);
        }
        ck_assert(memcmp(&a, &b, sizeof a) == 0); /* the last step began before it */
        run(&plain, &a, 0.25, 1e-3);
        run(&changed, &b, 0.25, 1e-3);
        ck_assert_double_ne(a.th_m_rad[1], b.th_m_rad[1]);
        /* and after it: from the same state the same step again */
        run(&changed, &b, 0.25, 0.06);
        a = b;
        run(&plain, &a, 0.25, 0.02);
        run(&changed, &b, 0.25, 0.02);
        ck_assert(memcmp(&a, &b, sizeof a) == 0);
    }
}
END_TEST

/* ---- mounting ---- */

/* Rotation by angle about a unit axis, row-major. */
static void rotation(const double *axis, double angle, double *r)
{
    double c = cos(angle), s = sin(angle);
    const double cross[9] = { 0, -axis[2], axis[1], axis[2], 0, -axis[0], -axis[1], axis[0], 0 };
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            r[3 * a + b] = (a == b) * c + (1 - c) * axis[a] * axis[b] + s * cross[3 * a + b];
}

static void turned(const double *r, const double *v, double *out)
{
    for (int a = 0; a < 3; a++)
        out[a] = r[3 * a] * v[0] + r[3 * a + 1] * v[1] + r[3 * a + 2] * v[2];
}

START_TEST(test_turning_gravity_is_turning_the_arm)
{
    const double axis[3] = { 0.6, -0.48, 0.64 };
    struct plant_model fixed = whole_arm(), tilted = whole_arm();
    struct plant_state a, b;
    double q[N] = { 0.2, 0.5, -0.3, 0.8, 0.1, 0.4, 0 }, r[9], rot[9], column[3], out[3];
    rotation(axis, 0.9, r);
    turned(r, fixed.gravity_mps2, tilted.gravity_mps2); /* all of it turned: arm and gravity */
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            column[i] = fixed.joint[0].rot[3 * i + k];
        turned(r, column, out);
        for (int i = 0; i < 3; i++)
            rot[3 * i + k] = out[i];
    }
    memcpy(tilted.joint[0].rot, rot, sizeof rot);
    turned(r, fixed.joint[0].trans_m, tilted.joint[0].trans_m);
    accept(&fixed);
    accept(&tilted);
    plant_reset(&fixed, &a, q, 3);
    plant_reset(&tilted, &b, q, 3);
    for (int i = 0; i < N; i++)
        ck_assert_double_eq_tol(a.gear_nm[i], b.gear_nm[i], 1e-10);
    run(&fixed, &a, 0.3, 0.2);
    run(&tilted, &b, 0.3, 0.2);
    for (int i = 0; i < N; i++)
        ck_assert_double_eq_tol(a.q_rad[i], b.q_rad[i], 1e-9);
    /* the arm's own turn is not the whole arm's: with gravity left where it was, the torques differ */
    memcpy(tilted.gravity_mps2, fixed.gravity_mps2, sizeof fixed.gravity_mps2);
    plant_reset(&tilted, &b, q, 3);
    ck_assert_double_gt(fabs(a.gear_nm[1] - b.gear_nm[1]), 1);
}
END_TEST

START_TEST(test_wall_mounted_arm_weighs_nothing_about_a_level_wall_s_normal)
{
    struct plant_model m = pa10_plant();
    struct plant_state s;
    m.gravity_mps2[1] = -9.81; /* along the axis of joint 2 at q1 = 0 */
    m.gravity_mps2[2] = 0;
    accept(&m);
    for (double q2 = -1.5; q2 < 1.6; q2 += 0.5) {
        double q[N] = { 0, q2, 0, 0, 0, 0, 0 };
        plant_reset(&m, &s, q, 1);
        ck_assert_double_eq_tol(s.gear_nm[1], 0, 1e-9);
        /* joint 1 carries what leans out from its axis, as joint 2 does on the floor: 80.4 N.m */
        ck_assert_double_eq_tol(fabs(s.gear_nm[0]), 80.4 * fabs(sin(q2)), 0.6);
    }
}
END_TEST

static Suite *gear_suite(void)
{
    Suite *suite = suite_create("plant_gear");
    TCase *parts = tcase_create("parts"), *loops = tcase_create("hysteresis"),
          *slow = tcase_create("sliding"), *error = tcase_create("error"), *energy = tcase_create("energy"),
          *order = tcase_create("order"), *model = tcase_create("model");
    tcase_add_test(parts, test_wave_generator_is_soft_then_stiff_odd_and_a_spring);
    tcase_add_test(parts, test_mesh_loss_is_the_law_of_plant_h);
    tcase_add_test(parts, test_mesh_gives_way_just_so_far_that_the_loss_holds_it);
    tcase_add_test(loops, test_hysteresis_loop_loses_its_area_and_is_as_wide_as_the_catalogue_says);
    tcase_add_test(loops, test_inner_loop_closes_at_its_turning_point);
    tcase_add_test(slow, test_motor_carries_load_rotor_friction_and_mesh_loss);
    tcase_add_test(slow, test_drop_of_motor_torque_follows_from_soft_drive_and_back);
    tcase_add_test(slow, test_periodic_friction_fades_while_the_teeth_are_unloaded);
    tcase_add_test(slow, test_line_deeper_than_the_rotor_s_friction_takes_from_the_mesh);
    tcase_add_test(slow, test_friction_builds_up_over_the_wind_up_after_a_reversal);
    tcase_add_test(slow, test_rotor_and_link_at_half_of_breakaway_do_not_move_a_bit);
    tcase_add_test(error, test_link_follows_the_rotor_ahead_by_the_error_less_the_wind_up);
    tcase_add_test(error, test_motor_torque_ripples_by_load_times_slope_of_the_error);
    tcase_add_test(error, test_rest_with_error_and_load_is_rest);
    tcase_add_test(energy, test_gear_and_friction_never_give_more_than_was_put_in);
    tcase_add_test(energy, test_energy_is_conserved_where_nothing_rubs);
    tcase_add_test(order, test_runge_kutta_is_of_fourth_order_also_while_the_mesh_slides);
    tcase_add_test(order, test_verlet_is_of_second_order_where_nothing_depends_on_speed);
    tcase_add_test(order, test_both_integrators_agree_on_stick_and_slip);
    tcase_add_test(order, test_too_long_a_step_is_refused_and_would_be_unstable);
    tcase_add_test(order, test_locked_joints_stay_to_the_last_bit);
    tcase_add_test(model, test_changes_hold_from_and_until_and_add_up);
    tcase_add_test(model, test_before_a_change_the_run_is_the_one_without_it);
    tcase_add_test(model, test_turning_gravity_is_turning_the_arm);
    tcase_add_test(model, test_wall_mounted_arm_weighs_nothing_about_a_level_wall_s_normal);
    TCase *all[] = { parts, loops, slow, error, energy, order, model };
    for (size_t k = 0; k < sizeof all / sizeof all[0]; k++) {
        tcase_set_timeout(all[k], 120);
        suite_add_tcase(suite, all[k]);
    }
    return suite;
}

HDT_CHECK_MAIN(gear_suite())
