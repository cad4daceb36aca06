/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Format A telegrams, bytes to struct and back.  All multi-byte fields are little endian, two's
 * complement; the bytes are built by arithmetic, so the code is the same on every machine.
 *
 * Owns: the byte layout.
 * Never: does I/O, keeps state, repairs a telegram.
 */
#include "driver/drv_telegram.h"

#include <string.h>

enum { HEAD = 2, COMMAND_AXIS = 5, STATE_AXIS = 8 };

static void put_u16(uint8_t *p, uint16_t v)
{
    p[0] = (uint8_t)(v & 0xffu);
    p[1] = (uint8_t)(v >> 8);
}

static uint16_t get_u16(const uint8_t *p)
{
    return (uint16_t)(p[0] | (unsigned)p[1] << 8);
}

static void put_u32(uint8_t *p, uint32_t v)
{
    put_u16(p, (uint16_t)(v & 0xffffu));
    put_u16(p + 2, (uint16_t)(v >> 16));
}

/* Two's complement without relying on an implementation-defined conversion. */
static int16_t get_s16(const uint8_t *p)
{
    int v = get_u16(p);
    return (int16_t)(v >= 0x8000 ? v - 0x10000 : v);
}

static int32_t get_s32(const uint8_t *p)
{
    int64_t v = (int64_t)get_u16(p) | (int64_t)get_u16(p + 2) << 16;
    return (int32_t)(v >= 0x80000000ll ? v - 0x100000000ll : v);
}

static int type_len(uint8_t type, int up)
{
    switch (type) {
    case DRV_START:
    case DRV_END:
    case DRV_BRAKE_RELEASE:
        return HEAD;
    case DRV_CYCLIC:
        return up ? DRV_STATE_LEN : DRV_COMMAND_LEN;
    default:
        return DRV_TELEGRAM_TYPE;
    }
}

int drv_telegram_len(const uint8_t *data, unsigned len, int up)
{
    if (len < HEAD)
        return DRV_TELEGRAM_LENGTH;
    int need = type_len(data[1], up);
    if (need > 0 && len < (unsigned)need)
        return DRV_TELEGRAM_LENGTH;
    return need;
}

/* A frame holds one telegram and not a byte more. */
static int check_frame(const struct hdt_frame *f, int up)
{
    int need = drv_telegram_len(f->data, f->len, up);
    if (need < 0)
        return need;
    return need == (int)f->len ? DRV_TELEGRAM_OK : DRV_TELEGRAM_LENGTH;
}

int drv_command_encode(const struct drv_command *c, struct hdt_frame *f)
{
    int len = type_len(c->type, 0);
    if (len < 0)
        return len;
    f->len = (uint16_t)len;
    f->data[0] = c->seq;
    f->data[1] = c->type;
    if (c->type != DRV_CYCLIC)
        return DRV_TELEGRAM_OK;
    uint8_t *p = f->data + HEAD;
    for (int i = 0; i < DRV_AXES; i++, p += COMMAND_AXIS) {
        p[0] = c->axis[i].mode;
        put_u16(p + 1, (uint16_t)c->axis[i].torque_dig);
        put_u16(p + 3, (uint16_t)c->axis[i].speed_dig);
    }
    return DRV_TELEGRAM_OK;
}

int drv_command_decode(const struct hdt_frame *f, struct drv_command *c)
{
    int e = check_frame(f, 0);
    if (e != DRV_TELEGRAM_OK)
        return e;
    memset(c, 0, sizeof *c);
    c->seq = f->data[0];
    c->type = f->data[1];
    if (c->type != DRV_CYCLIC)
        return DRV_TELEGRAM_OK;
    const uint8_t *p = f->data + HEAD;
    for (int i = 0; i < DRV_AXES; i++, p += COMMAND_AXIS) {
        c->axis[i].mode = p[0];
        c->axis[i].torque_dig = get_s16(p + 1);
        c->axis[i].speed_dig = get_s16(p + 3);
    }
    return DRV_TELEGRAM_OK;
}

int drv_state_encode(const struct drv_state *s, struct hdt_frame *f)
{
    int len = type_len(s->type, 1);
    if (len < 0)
        return len;
    f->len = (uint16_t)len;
    f->data[0] = s->seq;
    f->data[1] = s->type;
    if (s->type != DRV_CYCLIC)
        return DRV_TELEGRAM_OK;
    uint8_t *p = f->data + HEAD;
    for (int i = 0; i < DRV_AXES; i++, p += STATE_AXIS) {
        put_u16(p, s->axis[i].status);
        put_u32(p + 2, (uint32_t)s->axis[i].count);
        put_u16(p + 6, (uint16_t)s->axis[i].torque_dig);
    }
    put_u16(p, s->driver_status);
    return DRV_TELEGRAM_OK;
}

int drv_state_decode(const struct hdt_frame *f, struct drv_state *s)
{
    int e = check_frame(f, 1);
    if (e != DRV_TELEGRAM_OK)
        return e;
    memset(s, 0, sizeof *s);
    s->seq = f->data[0];
    s->type = f->data[1];
    if (s->type != DRV_CYCLIC)
        return DRV_TELEGRAM_OK;
    const uint8_t *p = f->data + HEAD;
    for (int i = 0; i < DRV_AXES; i++, p += STATE_AXIS) {
        s->axis[i].status = get_u16(p);
        s->axis[i].count = get_s32(p + 2);
        s->axis[i].torque_dig = get_s16(p + 6);
    }
    s->driver_status = get_u16(p);
    return DRV_TELEGRAM_OK;
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
    default: return "unknown telegram error";
    }
}
