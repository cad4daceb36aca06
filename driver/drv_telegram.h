/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Telegrams of the PA-10 servo driver, Format A (first generation, little endian)
 * [two independent public drivers, which agree byte for byte: Univ. of Southern Denmark drv_pa10.c
 * and RobWork PA10Driver.cpp; alarm numbers from the public mhipa10arc driver].  docs/formats.md,
 * section Telegram, has the byte tables and worked examples.
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
    DRV_AXIS_DEADMAN = 1u << 3 /* dead-man switch watched; the cycle leaves it 0 */
};

enum drv_axis_status { /* status bits of one axis */
    DRV_AXIS_LIMIT_POS = 1u << 0,
    DRV_AXIS_LIMIT_NEG = 1u << 1,
    DRV_AXIS_ALARM_MASK = 0xffu << 4,   /* alarm number, 0 none */
    DRV_AXIS_UNCONTROLLABLE = 1u << 14,
    DRV_AXIS_POWER_OFF = 1u << 15
};

#define DRV_ALARM_SHIFT 4 /* alarm number of a status word: (word & DRV_AXIS_ALARM_MASK) >> this */

/* Alarm numbers of an axis, in DRV_AXIS_ALARM_MASK: a number, not a mask. */
enum drv_alarm {
    DRV_ALARM_NONE = 0x00,
    DRV_ALARM_SHARED_MEMORY = 0x01,
    DRV_ALARM_EEPROM = 0x02,
    DRV_ALARM_CPU = 0x05,
    DRV_ALARM_VELOCITY_DEVIATION = 0x06,
    DRV_ALARM_RESOLVER_DEVIATION = 0x07,
    DRV_ALARM_POSITION_LIMIT = 0x08,
    DRV_ALARM_MOTOR_TORQUE = 0x09,
    DRV_ALARM_POWER_MODULE = 0x0a,
    DRV_ALARM_BRAKE_SHORT = 0x0b,
    DRV_ALARM_MOTOR_RESOLVER = 0x0c,
    DRV_ALARM_GEAR_RESOLVER = 0x0d,
    DRV_ALARM_OVER_CURRENT = 0x0e,
    DRV_ALARM_OVER_VELOCITY = 0x0f,
    DRV_ALARM_UNKNOWN = 0x10,
    DRV_ALARM_EMERGENCY_STOP = 0x11,
    DRV_ALARM_DEADMAN = 0x12,
    DRV_ALARM_LIMIT_SWITCH = 0x13,
    DRV_ALARM_TIMEOUT = 0xff
};

/* Alarm numbers of the servo driver itself, in drv_state.driver_status. */
enum drv_driver_alarm {
    DRV_DRIVER_EEPROM = 0x02,
    DRV_DRIVER_ARCNET = 0x03,
    DRV_DRIVER_CPU = 0x04,
    DRV_DRIVER_HOST_TIMEOUT = 0x05,
    DRV_DRIVER_POWER_TEMPERATURE = 0x06,
    DRV_DRIVER_POWER_OUTPUT = 0x07,
    DRV_DRIVER_UNKNOWN = 0x10,
    DRV_DRIVER_EMERGENCY_STOP = 0x11,
    DRV_DRIVER_DEADMAN = 0x12,
    DRV_DRIVER_LIMIT_SWITCH = 0x13
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

/* Exact length of the telegram that starts with these bytes; there may be more of them (padding).
 * up: 1 servo to host, 0 host to servo.
 * Errors: DRV_TELEGRAM_TYPE, DRV_TELEGRAM_LENGTH when fewer bytes are there than the type has. */
int drv_telegram_len(const uint8_t *data, unsigned len, int up);

/* Errors of all four: negative enum drv_telegram_err, and the output untouched.  A telegram without
 * payload ('S', 'E', 'T') decodes with all its axes zero.  Pure; any thread. */
int drv_command_encode(const struct drv_command *c, struct hdt_frame *f);
int drv_command_decode(const struct hdt_frame *f, struct drv_command *c);
int drv_state_encode(const struct drv_state *s, struct hdt_frame *f);
int drv_state_decode(const struct hdt_frame *f, struct drv_state *s);

/* Name of an alarm number, for people; never NULL. */
const char *drv_alarm_str(unsigned alarm);        /* of an axis */
const char *drv_driver_alarm_str(unsigned alarm); /* of the driver */
const char *drv_telegram_strerror(int err);

#ifdef __cplusplus
}
#endif
#endif
