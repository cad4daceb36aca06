/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Telegrams of the PA-10 servo driver: Format A (first generation, little endian) [two independent
 * public drivers, which agree byte for byte: Univ. of Southern Denmark drv_pa10.c and RobWork
 * PA10Driver.cpp] and Format B (second generation, 6CE and 7CE, big endian) [the public mhipa10arc
 * driver, also for the alarm numbers].  docs/formats.md, section Telegram, has the byte tables,
 * worked examples and what is known how well.
 *
 * Owns: bytes to struct and back; the torque unit of Format B.
 * Never: does I/O, keeps state, guesses: a frame that is not exactly right is refused.
 */
#ifndef DRV_TELEGRAM_H
#define DRV_TELEGRAM_H

#include <stddef.h>
#include <stdint.h>

#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DRV_AXES 7
#define DRV_TABLE_WORDS 32      /* words of one 'R' answer; its address is a multiple of this */

/* Lengths of the cyclic telegram; docs/formats.md has those of the others. */
#define DRV_COMMAND_LEN 37      /* Format A: sequence, 'C', 7 x 5 bytes             */
#define DRV_STATE_LEN 60        /* Format A: sequence, 'C', 7 x 8 bytes, 2 bytes    */
#define DRV_COMMAND_LEN_B 46    /* Format B: sequence, 'C', 7 x 6 bytes, 2 bytes    */
#define DRV_STATE_LEN_B 74      /* Format B: sequence, 'C', 7 x 10 bytes, 2 bytes   */

enum drv_format { DRV_FORMAT_A, DRV_FORMAT_B };

enum drv_type {
    DRV_START = 'S',         /* stop -> control                           */
    DRV_END = 'E',           /* any -> stop, brakes on                    */
    DRV_CYCLIC = 'C',        /* command down, state up                    */
    DRV_BRAKE_RELEASE = 'T', /* stop -> brake release                     */
    DRV_ZERO = 'M',          /* mechanical zero of one axis is here       */
    DRV_TABLE = 'R',         /* read words of one axis' EEPROM table      */
    DRV_CLEAR = 'A'          /* clear the alarm of one axis               */
};

enum drv_axis_mode { /* command bits of one axis */
    DRV_AXIS_BRAKE = 1u << 0,  /* 1 brake on    */
    DRV_AXIS_SERVO = 1u << 1,  /* 1 servo on    */
    DRV_AXIS_TORQUE = 1u << 2, /* 1 torque, 0 speed */
    DRV_AXIS_DEADMAN = 1u << 3, /* Format A: dead-man switch watched; the cycle leaves it 0 */
    DRV_AXIS_STOP_ALL = 1u << 4 /* Format B: stop this axis on an alarm of another */
};

enum drv_driver_mode { /* command bits of the servo driver itself, Format B */
    DRV_DRIVER_WATCH_DEADMAN = 1u << 3 /* dead-man switch watched; the cycle leaves it 0 */
};

enum drv_axis_status { /* status bits of one axis */
    DRV_AXIS_LIMIT_POS = 1u << 0,
    DRV_AXIS_LIMIT_NEG = 1u << 1,
    DRV_AXIS_ALARM_MASK = 0xffu << 4,   /* alarm number, 0 none */
    DRV_AXIS_UNCONTROLLABLE = 1u << 14,
    DRV_AXIS_POWER_OFF = 1u << 15
};

enum drv_driver_status { /* status bits of the servo driver itself; alarm number as the axis word's */
    DRV_DRIVER_DEADMAN_ON = 1u << 0,
    DRV_DRIVER_POWER_HOT = 1u << 1,      /* power stage temperature */
    DRV_DRIVER_POWER_ON = 1u << 2,       /* power stage output      */
    DRV_DRIVER_EMERGENCY_OPEN = 1u << 3, /* emergency stop pressed  */
    DRV_DRIVER_TEACHING = 1u << 12,
    DRV_DRIVER_LIMIT_OPEN = 1u << 13,
    DRV_DRIVER_UNCONTROLLABLE = 1u << 14
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

/* Words of an axis' EEPROM table, counted from 0 as their addresses are.  Those of two words are
 * 32 bits, two's complement, in resolver counts (16384 a motor revolution).  The others' meaning is
 * not public. */
enum drv_table_word {
    DRV_WORD_LIMIT_POS_HI = 18,
    DRV_WORD_LIMIT_POS_LO = 19,
    DRV_WORD_LIMIT_NEG_HI = 20,
    DRV_WORD_LIMIT_NEG_LO = 21,
    DRV_WORD_ZERO_LO = 22,
    DRV_WORD_ZERO_HI = 23,
    DRV_WORD_POLES = 27              /* of motor or resolver: not known which */
};

/* What a type does not carry is ignored when encoded, and zero when decoded. */
struct drv_command {
    uint8_t seq;
    uint8_t type;                  /* enum drv_type */
    uint8_t axis_no;               /* 'M', 'R', 'A': 1..DRV_AXES */
    uint8_t address;               /* 'R': first word wanted, a multiple of DRV_TABLE_WORDS */
    uint16_t driver_mode;          /* 'C', Format B: enum drv_driver_mode */
    struct {                       /* 'C' */
        uint16_t mode;             /* enum drv_axis_mode; at most 255 in Format A */
        int16_t torque_dig;        /* motor side; A: 0.001 N.m a digit, B: rated torque / 4096 */
        int16_t speed_dig;         /* 0.0002 rad/s output side a digit */
    } axis[DRV_AXES];
};

struct drv_state {
    uint8_t seq;
    uint8_t type;                  /* that of the command, as is seq */
    uint8_t axis_no;               /* 'M', 'R', 'A': that of the command */
    uint8_t address;               /* 'R': that of the command */
    uint16_t driver_status;        /* 'C': enum drv_driver_status, alarm number in bits 4..11 */
    struct {                       /* 'C' */
        uint16_t status;           /* enum drv_axis_status */
        int32_t count;             /* motor-side resolver, 16384 a motor revolution */
        int16_t speed_dig;         /* Format B: 0.0002 rad/s output side a digit */
        int16_t torque_dig;        /* as the command's */
    } axis[DRV_AXES];
    uint16_t word[DRV_TABLE_WORDS];/* 'R': from address on */
};

enum drv_telegram_err {
    DRV_TELEGRAM_OK = 0,
    DRV_TELEGRAM_LENGTH = -1,  /* not the length this type has */
    DRV_TELEGRAM_TYPE = -2,    /* not a type of this format */
    DRV_TELEGRAM_VALUE = -3,   /* a field holds what it cannot: axis number, address, mode */
    DRV_TELEGRAM_FORMAT = -4   /* neither DRV_FORMAT_A nor DRV_FORMAT_B */
};

/* Exact length of the telegram that starts with these bytes; there may be more of them (padding).
 * up: 1 servo to host, 0 host to servo.
 * Errors: DRV_TELEGRAM_TYPE, _FORMAT; _LENGTH when fewer bytes are there than the type has. */
int drv_telegram_len(enum drv_format format, const uint8_t *data, unsigned len, int up);

/* Can the bus of this name, as hdt_bus_open takes it, carry every telegram of the format?  CAN FD frames, at
 * most 64 bytes, cannot carry Format B's state.  0, or DRV_TELEGRAM_LENGTH and one line in err (may be NULL)
 * with the remedy.  A name that is NULL or no bus is hdt_bus_open's to refuse: 0.  Any thread. */
int drv_telegram_fits(enum drv_format format, const char *bus, char *err, size_t errlen);

/* Errors of all four: negative enum drv_telegram_err, and the output untouched.  Pure; any thread. */
int drv_command_encode(enum drv_format format, const struct drv_command *c, struct hdt_frame *f);
int drv_command_decode(enum drv_format format, const struct hdt_frame *f, struct drv_command *c);
int drv_state_encode(enum drv_format format, const struct drv_state *s, struct hdt_frame *f);
int drv_state_decode(enum drv_format format, const struct hdt_frame *f, struct drv_state *s);

/* Torque of Format B, rated / 4096 N.m motor side a digit, from and to digits of 0.001 N.m.
 * rated_mnm: the motor's rated torque in 0.001 N.m; 0 (unknown) makes every torque 0.
 * Exact, rounded once, half to even; saturates at the ends of int16_t.  Pure; any thread. */
int16_t drv_torque_from_b(int16_t wire_dig, uint16_t rated_mnm);
int16_t drv_torque_to_b(int16_t dig, uint16_t rated_mnm);

/* Name of an alarm number, for people; never NULL. */
const char *drv_alarm_str(unsigned alarm);        /* of an axis */
const char *drv_driver_alarm_str(unsigned alarm); /* of the driver */
const char *drv_telegram_strerror(int err);

#ifdef __cplusplus
}
#endif
#endif
