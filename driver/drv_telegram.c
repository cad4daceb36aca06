/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Telegrams, bytes to struct and back.  Multi-byte fields are two's complement, little endian in
 * Format A and big endian in Format B; the bytes are built by arithmetic, so the code is the same
 * on every machine.
 *
 * Owns: the byte layout.
 * Never: does I/O, keeps state, repairs a telegram.
 */
#include "driver/drv_telegram.h"

#include <string.h>

enum {
    HEAD = 2,
    SELECT_LEN = 4,                         /* 'M', 'A', and 'R' down: head and two bytes */
    TABLE_LEN = 4 + 2 * DRV_TABLE_WORDS,    /* 'R' up */
    RATED_DIG = 4096                        /* digits of rated torque, Format B */
};

static void put_u16(enum drv_format format, uint8_t *p, uint16_t v)
{
    int high = format == DRV_FORMAT_A;
    p[high] = (uint8_t)(v >> 8);
    p[!high] = (uint8_t)(v & 0xffu);
}

static uint16_t get_u16(enum drv_format format, const uint8_t *p)
{
    int high = format == DRV_FORMAT_A;
    return (uint16_t)(p[!high] | (unsigned)p[high] << 8);
}

static void put_u32(enum drv_format format, uint8_t *p, uint32_t v)
{
    int high = format == DRV_FORMAT_A ? 2 : 0;
    put_u16(format, p + high, (uint16_t)(v >> 16));
    put_u16(format, p + (2 - high), (uint16_t)(v & 0xffffu));
}

/* Two's complement without relying on an implementation-defined conversion. */
static int16_t get_s16(enum drv_format format, const uint8_t *p)
{
    int v = get_u16(format, p);
    return (int16_t)(v >= 0x8000 ? v - 0x10000 : v);
}

static int32_t get_s32(enum drv_format format, const uint8_t *p)
{
    int high = format == DRV_FORMAT_A ? 2 : 0;
    int64_t v = (int64_t)get_u16(format, p + high) << 16 | (int64_t)get_u16(format, p + (2 - high));
    return (int32_t)(v >= 0x80000000ll ? v - 0x100000000ll : v);
}

static int cyclic_len(enum drv_format format, int up)
{
    if (format == DRV_FORMAT_A)
        return up ? DRV_STATE_LEN : DRV_COMMAND_LEN;
    return up ? DRV_STATE_LEN_B : DRV_COMMAND_LEN_B;
}

static int type_len(enum drv_format format, uint8_t type, int up)
{
    if (format != DRV_FORMAT_A && format != DRV_FORMAT_B)
        return DRV_TELEGRAM_FORMAT;
    switch (type) {
    case DRV_START:
    case DRV_END:
    case DRV_BRAKE_RELEASE:
        return HEAD;
    case DRV_ZERO:
    case DRV_CLEAR:
        return SELECT_LEN;
    case DRV_TABLE:
        return up ? TABLE_LEN : SELECT_LEN;
    case DRV_CYCLIC:
        return cyclic_len(format, up);
    default:
        return DRV_TELEGRAM_TYPE;
    }
}

int drv_telegram_len(enum drv_format format, const uint8_t *data, unsigned len, int up)
{
    if (len < HEAD)
        return DRV_TELEGRAM_LENGTH;
    int need = type_len(format, data[1], up);
    if (need > 0 && len < (unsigned)need)
        return DRV_TELEGRAM_LENGTH;
    return need;
}

/* A frame holds one telegram and not a byte more. */
static int check_frame(enum drv_format format, const struct hdt_frame *f, int up)
{
    int need = f->len <= HDT_FRAME_MAX ? drv_telegram_len(format, f->data, f->len, up)
                                       : DRV_TELEGRAM_LENGTH;
    if (need < 0)
        return need;
    return need == (int)f->len ? DRV_TELEGRAM_OK : DRV_TELEGRAM_LENGTH;
}

/* ---- the two bytes of 'M', 'R' and 'A' ---- */

static int selects(uint8_t type)
{
    return type == DRV_ZERO || type == DRV_TABLE || type == DRV_CLEAR;
}

static int check_select(uint8_t type, unsigned axis_no, unsigned address)
{
    int ok = axis_no >= 1 && axis_no <= DRV_AXES && (type != DRV_TABLE || address % DRV_TABLE_WORDS == 0);
    return ok ? DRV_TELEGRAM_OK : DRV_TELEGRAM_VALUE;
}

static void put_select(enum drv_format format, uint8_t type, uint8_t axis_no, uint8_t address, uint8_t *p)
{
    p[0] = axis_no;
    p[1] = type == DRV_TABLE ? address : 0;
    if (type == DRV_CLEAR)
        put_u16(format, p, axis_no);
}

static int get_select(enum drv_format format, uint8_t type, const uint8_t *p, uint8_t *axis_no,
                      uint8_t *address)
{
    unsigned number = type == DRV_CLEAR ? get_u16(format, p) : p[0];
    unsigned second = type == DRV_CLEAR ? 0 : p[1];
    int e = type == DRV_ZERO && second != 0 ? DRV_TELEGRAM_VALUE : check_select(type, number, second);
    if (e != DRV_TELEGRAM_OK)
        return e;
    *axis_no = (uint8_t)number;
    *address = (uint8_t)second;
    return DRV_TELEGRAM_OK;
}

/* ---- command ---- */

static int check_command(enum drv_format format, const struct drv_command *c)
{
    int len = type_len(format, c->type, 0);
    if (len >= 0 && selects(c->type)) {
        int e = check_select(c->type, c->axis_no, c->address);
        return e < 0 ? e : len;
    }
    for (int i = 0; len >= 0 && c->type == DRV_CYCLIC && format == DRV_FORMAT_A && i < DRV_AXES; i++)
        if (c->axis[i].mode > 0xffu)
            return DRV_TELEGRAM_VALUE;
    return len;
}

int drv_command_encode(enum drv_format format, const struct drv_command *c, struct hdt_frame *f)
{
    int len = check_command(format, c);
    if (len < 0)
        return len;
    f->len = (uint16_t)len;
    f->data[0] = c->seq;
    f->data[1] = c->type;
    uint8_t *p = f->data + HEAD;
    if (selects(c->type))
        put_select(format, c->type, c->axis_no, c->address, p);
    if (c->type != DRV_CYCLIC)
        return DRV_TELEGRAM_OK;
    for (int i = 0; i < DRV_AXES; i++, p += 4) {
        if (format == DRV_FORMAT_A) {
            *p++ = (uint8_t)c->axis[i].mode;
        } else {
            put_u16(format, p, c->axis[i].mode);
            p += 2;
        }
        put_u16(format, p, (uint16_t)c->axis[i].torque_dig);
        put_u16(format, p + 2, (uint16_t)c->axis[i].speed_dig);
    }
    if (format == DRV_FORMAT_B)
        put_u16(format, p, c->driver_mode);
    return DRV_TELEGRAM_OK;
}

static void get_command_axes(enum drv_format format, const uint8_t *p, struct drv_command *c)
{
    for (int i = 0; i < DRV_AXES; i++, p += 4) {
        if (format == DRV_FORMAT_A) {
            c->axis[i].mode = *p++;
        } else {
            c->axis[i].mode = get_u16(format, p);
            p += 2;
        }
        c->axis[i].torque_dig = get_s16(format, p);
        c->axis[i].speed_dig = get_s16(format, p + 2);
    }
    if (format == DRV_FORMAT_B)
        c->driver_mode = get_u16(format, p);
}

int drv_command_decode(enum drv_format format, const struct hdt_frame *f, struct drv_command *c)
{
    uint8_t axis_no = 0, address = 0;
    int e = check_frame(format, f, 0);
    if (e == DRV_TELEGRAM_OK && selects(f->data[1]))
        e = get_select(format, f->data[1], f->data + HEAD, &axis_no, &address);
    if (e != DRV_TELEGRAM_OK)
        return e;
    memset(c, 0, sizeof *c);
    c->seq = f->data[0];
    c->type = f->data[1];
    c->axis_no = axis_no;
    c->address = address;
    if (c->type == DRV_CYCLIC)
        get_command_axes(format, f->data + HEAD, c);
    return DRV_TELEGRAM_OK;
}

/* ---- state ---- */

static void put_state_axes(enum drv_format format, const struct drv_state *s, uint8_t *p)
{
    for (int i = 0; i < DRV_AXES; i++) {
        put_u16(format, p, s->axis[i].status);
        put_u32(format, p + 2, (uint32_t)s->axis[i].count);
        p += 6;
        if (format == DRV_FORMAT_B) {
            put_u16(format, p, (uint16_t)s->axis[i].speed_dig);
            p += 2;
        }
        put_u16(format, p, (uint16_t)s->axis[i].torque_dig);
        p += 2;
    }
    put_u16(format, p, s->driver_status);
}

int drv_state_encode(enum drv_format format, const struct drv_state *s, struct hdt_frame *f)
{
    int len = type_len(format, s->type, 1);
    int e = len >= 0 && selects(s->type) ? check_select(s->type, s->axis_no, s->address) : DRV_TELEGRAM_OK;
    if (len < 0 || e < 0)
        return len < 0 ? len : e;
    f->len = (uint16_t)len;
    f->data[0] = s->seq;
    f->data[1] = s->type;
    if (selects(s->type))
        put_select(format, s->type, s->axis_no, s->address, f->data + HEAD);
    if (s->type == DRV_TABLE)
        for (int k = 0; k < DRV_TABLE_WORDS; k++)
            put_u16(format, f->data + SELECT_LEN + 2 * k, s->word[k]);
    if (s->type == DRV_CYCLIC)
        put_state_axes(format, s, f->data + HEAD);
    return DRV_TELEGRAM_OK;
}

static void get_state_axes(enum drv_format format, const uint8_t *p, struct drv_state *s)
{
    for (int i = 0; i < DRV_AXES; i++) {
        s->axis[i].status = get_u16(format, p);
        s->axis[i].count = get_s32(format, p + 2);
        p += 6;
        if (format == DRV_FORMAT_B) {
            s->axis[i].speed_dig = get_s16(format, p);
            p += 2;
        }
        s->axis[i].torque_dig = get_s16(format, p);
        p += 2;
    }
    s->driver_status = get_u16(format, p);
}

int drv_state_decode(enum drv_format format, const struct hdt_frame *f, struct drv_state *s)
{
    uint8_t axis_no = 0, address = 0;
    int e = check_frame(format, f, 1);
    if (e == DRV_TELEGRAM_OK && selects(f->data[1]))
        e = get_select(format, f->data[1], f->data + HEAD, &axis_no, &address);
    if (e != DRV_TELEGRAM_OK)
        return e;
    memset(s, 0, sizeof *s);
    s->seq = f->data[0];
    s->type = f->data[1];
    s->axis_no = axis_no;
    s->address = address;
    if (s->type == DRV_TABLE)
        for (int k = 0; k < DRV_TABLE_WORDS; k++)
            s->word[k] = get_u16(format, f->data + SELECT_LEN + 2 * k);
    if (s->type == DRV_CYCLIC)
        get_state_axes(format, f->data + HEAD, s);
    return DRV_TELEGRAM_OK;
}

/* ---- torque unit of Format B ---- */

/* value * numerator / denominator, half to even, saturated. */
static int16_t scaled(int16_t value, int32_t numerator, int32_t denominator)
{
    int64_t product = (int64_t)(value < 0 ? -(int32_t)value : value) * numerator;
    int64_t whole = product / denominator, twice = 2 * (product % denominator);
    if (twice > denominator || (twice == denominator && whole % 2 != 0))
        whole++;
    if (value < 0)
        return (int16_t)(whole > 32768 ? -32768 : -whole);
    return (int16_t)(whole > 32767 ? 32767 : whole);
}

int16_t drv_torque_from_b(int16_t wire_dig, uint16_t rated_mnm)
{
    return scaled(wire_dig, rated_mnm, RATED_DIG);
}

int16_t drv_torque_to_b(int16_t dig, uint16_t rated_mnm)
{
    return rated_mnm == 0 ? 0 : scaled(dig, RATED_DIG, rated_mnm);
}

const char *drv_alarm_str(unsigned alarm)
{
    switch (alarm) {
    case DRV_ALARM_NONE: return "no alarm";
    case DRV_ALARM_SHARED_MEMORY: return "shared memory";
    case DRV_ALARM_EEPROM: return "EEPROM";
    case DRV_ALARM_CPU: return "CPU";
    case DRV_ALARM_VELOCITY_DEVIATION: return "velocity deviation";
    case DRV_ALARM_RESOLVER_DEVIATION: return "resolver deviation";
    case DRV_ALARM_POSITION_LIMIT: return "position limit";
    case DRV_ALARM_MOTOR_TORQUE: return "motor torque";
    case DRV_ALARM_POWER_MODULE: return "power module";
    case DRV_ALARM_BRAKE_SHORT: return "brake short";
    case DRV_ALARM_MOTOR_RESOLVER: return "motor-side resolver";
    case DRV_ALARM_GEAR_RESOLVER: return "gear-side resolver";
    case DRV_ALARM_OVER_CURRENT: return "over-current";
    case DRV_ALARM_OVER_VELOCITY: return "over-velocity";
    case DRV_ALARM_UNKNOWN: return "unknown (reported as such)";
    case DRV_ALARM_EMERGENCY_STOP: return "emergency stop";
    case DRV_ALARM_DEADMAN: return "dead-man switch";
    case DRV_ALARM_LIMIT_SWITCH: return "limit switch";
    case DRV_ALARM_TIMEOUT: return "communication time-out";
    default: return "alarm number not known";
    }
}

const char *drv_driver_alarm_str(unsigned alarm)
{
    switch (alarm) {
    case 0: return "no alarm";
    case DRV_DRIVER_EEPROM: return "EEPROM";
    case DRV_DRIVER_ARCNET: return "ARCNET initialisation";
    case DRV_DRIVER_CPU: return "CPU";
    case DRV_DRIVER_HOST_TIMEOUT: return "time-out with the host";
    case DRV_DRIVER_POWER_TEMPERATURE: return "power stage temperature";
    case DRV_DRIVER_POWER_OUTPUT: return "power stage output";
    case DRV_DRIVER_UNKNOWN: return "unknown (reported as such)";
    case DRV_DRIVER_EMERGENCY_STOP: return "emergency stop";
    case DRV_DRIVER_DEADMAN: return "dead-man switch";
    case DRV_DRIVER_LIMIT_SWITCH: return "limit switch";
    default: return "alarm number not known";
    }
}

const char *drv_telegram_strerror(int err)
{
    switch (err) {
    case DRV_TELEGRAM_OK: return "ok";
    case DRV_TELEGRAM_LENGTH: return "not the length this telegram type has";
    case DRV_TELEGRAM_TYPE: return "not a telegram type of this format";
    case DRV_TELEGRAM_VALUE: return "an axis number, address or mode that cannot be";
    case DRV_TELEGRAM_FORMAT: return "neither Format A nor Format B";
    default: return "unknown telegram error";
    }
}
