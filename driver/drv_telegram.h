/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Telegrams of the PA-10 servo driver, Format A (first generation, little endian)
 * [pa10-facts A.3, A.4; from two independent public drivers].
 *
 * Owns: bytes to struct and back.
 * Never: does I/O, keeps state, guesses: a frame that is not exactly right is refused.
 */
#ifndef DRV_TELEGRAM_H
#define DRV_TELEGRAM_H

#include <stdint.h>

#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DRV_AXES 7
#define DRV_COMMAND_LEN 37 /* sequence, 'C', 7 x 5 bytes */
#define DRV_STATE_LEN 60   /* sequence, 'C', 7 x 8 bytes, 2 bytes */

enum drv_type {
    DRV_START = 'S',         /* stop -> control                     */
    DRV_END = 'E',           /* any -> stop, brakes on              */
    DRV_CYCLIC = 'C',        /* command down, state up              */
    DRV_BRAKE_RELEASE = 'T'  /* stop -> brake release               */
};

enum drv_axis_mode { /* command bits of one axis */
    DRV_AXIS_BRAKE = 1u << 0,  /* 1 brake on    */
    DRV_AXIS_SERVO = 1u << 1,  /* 1 servo on    */
    DRV_AXIS_TORQUE = 1u << 2, /* 1 torque, 0 speed */
    DRV_AXIS_DEADMAN = 1u << 3
};

enum drv_axis_status { /* status bits of one axis */
    DRV_AXIS_LIMIT_POS = 1u << 0,
    DRV_AXIS_LIMIT_NEG = 1u << 1,
    DRV_AXIS_ALARM_MASK = 0xffu << 4,   /* alarm number, 0 none */
    DRV_AXIS_UNCONTROLLABLE = 1u << 14,
    DRV_AXIS_POWER_OFF = 1u << 15
};

/* Alarm numbers of an axis, in DRV_AXIS_ALARM_MASK. */
enum drv_alarm {
    DRV_ALARM_VELOCITY_DEVIATION = 0x06,
    DRV_ALARM_POSITION_LIMIT = 0x08,
    DRV_ALARM_MOTOR_TORQUE = 0x09,
    DRV_ALARM_OVER_VELOCITY = 0x0f,
    DRV_ALARM_TIMEOUT = 0xff
};

struct drv_command {
    uint8_t seq;
    uint8_t type;                  /* enum drv_type; the rest only for DRV_CYCLIC */
    struct {
        uint8_t mode;              /* enum drv_axis_mode */
        int16_t torque_dig;        /* 0.001 N.m motor side a digit */
        int16_t speed_dig;         /* 0.0002 rad/s output side a digit */
    } axis[DRV_AXES];
};

struct drv_state {
    uint8_t seq;
    uint8_t type;
    struct {
        uint16_t status;           /* enum drv_axis_status */
        int32_t count;             /* motor-side resolver, 16384 a motor revolution */
        int16_t torque_dig;        /* 0.001 N.m motor side a digit */
    } axis[DRV_AXES];
    uint16_t driver_status;        /* alarm number in bits 4..11, as the axis word */
};

enum drv_telegram_err {
    DRV_TELEGRAM_OK = 0,
    DRV_TELEGRAM_LENGTH = -1,  /* not the length this type has */
    DRV_TELEGRAM_TYPE = -2     /* not a type of this format */
};

/* Exact length of the telegram that starts with these bytes, or negative.
 * up: 1 servo to host, 0 host to servo. */
int drv_telegram_len(const uint8_t *data, unsigned len, int up);

int drv_command_encode(const struct drv_command *c, struct hdt_frame *f);
int drv_command_decode(const struct hdt_frame *f, struct drv_command *c);
int drv_state_encode(const struct drv_state *s, struct hdt_frame *f);
int drv_state_decode(const struct hdt_frame *f, struct drv_state *s);

/* Name of an alarm number, for people; never NULL. */
const char *drv_alarm_str(unsigned alarm);

#ifdef __cplusplus
}
#endif
#endif
