/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Opening a bus by name, and what all backends share.
 *
 * Owns: the names, the error lines' form, the CAN FD padding rule.
 * Never: touches a socket.
 */
#include "driver/hdt_bus.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "driver/drv_backend.h"
#include "driver/drv_telegram.h"

#define NAMES "unix:PATH, can:IFACE, isotp:IFACE or arcnet:IFACE"

int drv_bus_fail(int code, char *err, size_t errlen, const char *fmt, ...)
{
    if (err != NULL && errlen > 0) {
        va_list ap;
        va_start(ap, fmt);
        (void)vsnprintf(err, errlen, fmt, ap);
        va_end(ap);
    }
    return code;
}

int hdt_bus_open(struct hdt_bus *bus, const char *name, enum hdt_bus_side side, char *err,
                 size_t errlen)
{
    memset(bus, 0, sizeof *bus);
    if (name == NULL)
        return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                            "no bus given: expected " NAMES);
    const char *rest = strchr(name, ':');
    if (rest != NULL && strncmp(name, "unix:", 5) == 0)
        return drv_unix_open(bus, rest + 1, side, err, errlen);
    if (rest != NULL && strncmp(name, "can:", 4) == 0)
        return drv_can_open(bus, rest + 1, side, err, errlen);
    if (rest != NULL && strncmp(name, "isotp:", 6) == 0)
        return drv_isotp_open(bus, rest + 1, side, err, errlen);
    if (rest != NULL && strncmp(name, "arcnet:", 7) == 0)
        return drv_arcnet_open(bus, rest + 1, side, err, errlen);
    if (rest != NULL && strncmp(name, "loop:", 5) == 0)
        return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                            "%s: has both ends in one process and cannot be opened by name: "
                            "use unix:PATH between two processes", name);
    return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                        "%.200s: not a bus: expected " NAMES, name);
}

int drv_telegram_fits(enum drv_format format, const char *bus, char *err, size_t errlen)
{
    if (format != DRV_FORMAT_B || bus == NULL || strncmp(bus, "can:", 4) != 0)
        return DRV_TELEGRAM_OK;
    return drv_bus_fail(DRV_TELEGRAM_LENGTH, err, errlen,
                        "%.40s: Format B's state telegram of %d bytes does not fit into a CAN FD frame of "
                        "%d: use isotp:IFACE", bus, DRV_STATE_LEN_B, (int)DRV_CAN_DATA_MAX);
}

void hdt_bus_close(struct hdt_bus *bus)
{
    if (bus->close != NULL)
        bus->close(bus->ctx);
    memset(bus, 0, sizeof *bus);
}

void hdt_bus_get_health(const struct hdt_bus *bus, struct hdt_bus_health *h)
{
    memset(h, 0, sizeof *h);
    if (bus->health != NULL)
        bus->health(bus->ctx, h);
}

const char *hdt_line_str(enum hdt_line line)
{
    switch (line) {
    case HDT_LINE_UNKNOWN: return "unknown";
    case HDT_LINE_ACTIVE: return "active";
    case HDT_LINE_WARNING: return "error warning";
    case HDT_LINE_PASSIVE: return "error passive";
    case HDT_LINE_OFF: return "off";
    }
    return "unknown";
}

const char *hdt_bus_strerror(int err)
{
    switch (err) {
    case HDT_BUS_OK: return "ok";
    case HDT_BUS_ERR_AGAIN: return "nothing to receive, or the send queue is full";
    case HDT_BUS_ERR_DOWN: return "line or peer is gone";
    case HDT_BUS_ERR_FRAME: return "bytes that are no frame";
    case HDT_BUS_ERR_NAME: return "not the name of a bus";
    default: return "unknown bus error";
    }
}

unsigned drv_can_padded(unsigned len)
{
    static const uint8_t above_8[] = {12, 16, 20, 24, 32, 48, 64};
    if (len <= 8)
        return len;
    for (unsigned i = 0; i < sizeof above_8; i++)
        if (len <= above_8[i])
            return above_8[i];
    return 0;
}

int drv_can_trim(const uint8_t *data, unsigned len, int up, struct hdt_frame *f)
{
    if (len > DRV_CAN_DATA_MAX)
        return HDT_BUS_ERR_FRAME;
    int need = drv_telegram_len(DRV_FORMAT_A, data, len, up);
    if (need < 0 || drv_can_padded((unsigned)need) != len)
        return HDT_BUS_ERR_FRAME;
    memcpy(f->data, data, (size_t)need);
    f->len = (uint16_t)need;
    return HDT_BUS_OK;
}
