/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The arm and its servo driver as a functional mock-up unit: the variables an importer sees, and the
 * arm that is compiled in.
 *
 * Owns: the one table of variables, from which sim/fmu.c answers and tools/fmu_gen.cpp writes
 * modelDescription.xml.
 * Never: allocates; holds anything that changes.
 */
#ifndef FMU_H
#define FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "driver/drv_telegram.h"
#include "sim/plant.h"

#ifdef __cplusplus
extern "C" {
#endif

enum fmu_type { FMU_FLOAT64, FMU_UINT16, FMU_UINT64, FMU_BOOLEAN, FMU_ENUMERATION };
enum fmu_causality { FMU_INDEPENDENT, FMU_PARAMETER, FMU_INPUT, FMU_OUTPUT };
enum fmu_variability { FMU_FIXED, FMU_DISCRETE, FMU_CONTINUOUS };
enum fmu_axis_mode { FMU_BRAKE, FMU_VELOCITY, FMU_TORQUE }; /* items of the enumeration "Mode" */

/* Every variable.  Torques and angles are output side unless _m; a joint's are one array. */
struct fmu_values {
    double time_s;
    /* parameters */
    uint64_t seed;
    double payload_kg, payload_m[3];     /* point mass, in the flange frame */
    double start_rad[DRV_AXES];          /* link angles at rest */
    /* inputs */
    bool enable;
    int64_t mode[DRV_AXES];              /* enum fmu_axis_mode */
    double speed_radps[DRV_AXES];
    double torque_m_nm[DRV_AXES];
    /* outputs */
    uint16_t driver_status;
    double angle_rad[DRV_AXES];          /* resolver on the motor, over the ratio */
    double link_rad[DRV_AXES], link_radps[DRV_AXES];
    double reported_m_nm[DRV_AXES];
    double gear_nm[DRV_AXES];
    uint16_t status[DRV_AXES];
};

/* A row of the table: one variable, or one of every joint. */
struct fmu_kind {
    const char *name;                    /* a joint's is JOINT.name */
    const char *unit;                    /* NULL: none */
    const char *description;
    enum fmu_type type;
    enum fmu_causality causality;
    enum fmu_variability variability;
    int per_joint;
    size_t offset;                       /* of the variable, or joint 1's, in struct fmu_values */
};

/* The arm of this unit: written as C by tools/fmu_gen.cpp. */
struct fmu_arm {
    const char *name, *token;            /* token: of the model file and of struct plant_model */
    int joints;                          /* at most DRV_AXES */
    const char *joint[DRV_AXES];
    double flange_m[3], flange_rot[9];   /* in the last link's frame */
    double payload_kg, payload_m[3];     /* of the model file, in the flange frame */
};

/* The plant as bytes, so that no field can be forgotten; checked by plant_model_check already. */
union fmu_plant {
    unsigned char byte[sizeof(struct plant_model)];
    struct plant_model model;
};

/* Row k of the table, NULL past its end. */
const struct fmu_kind *fmu_row(unsigned k);
/* Value reference of row k, joint from 0 (0 where there is no joint), and back: NULL when there is no
 * such variable. */
uint32_t fmu_reference(unsigned k, int joint);
const struct fmu_kind *fmu_find(const struct fmu_arm *arm, uint32_t reference, int *joint);
/* Where the variable is; of the type its row says. */
void *fmu_at(struct fmu_values *values, const struct fmu_kind *kind, int joint);
size_t fmu_size(enum fmu_type type);
/* Values before anything is set. */
void fmu_defaults(const struct fmu_arm *arm, struct fmu_values *values);
/* Limits of a variable that has some: 1, and both filled in (HUGE_VAL: none on that side); else 0. */
int fmu_limits(const struct plant_model *plant, const struct fmu_kind *kind, int joint, double *min,
               double *max);

/* In the generated file; only sim/fmu.c and tests look. */
extern const struct fmu_arm fmu_the_arm;
extern const union fmu_plant fmu_the_plant;

#ifdef __cplusplus
}
#endif
#endif
