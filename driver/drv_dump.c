/* SPDX-License-Identifier: Apache-2.0 */
/* See drv_dump.h. */
#include "driver/drv_dump.h"

#include <stdio.h>
#include <string.h>

int drv_dump_init(struct drv_dump *d, struct drv_record *slots, unsigned count, const hdt_t *core)
{
    if (d == NULL || slots == NULL || core == NULL || count < 2 || count % 2 != 0)
        return HDT_ERR_ARG;
    memset(d, 0, sizeof *d);
    d->slot = slots;
    d->count = count;
    d->start[0] = *core;
    return HDT_OK;
}

void drv_dump_note(struct drv_dump *d, const struct drv_record *rec, const hdt_t *core)
{
    if (d->full)
        return;
    d->slot[d->seen % d->count] = *rec;
    d->seen++;
    if (d->seen % (d->count / 2) == 0)
        d->start[d->seen / (d->count / 2) % 2] = *core;
    d->full = rec->out.fault != 0;
}

int drv_dump_write(const struct drv_dump *d, const char *path, const struct drv_writer_cfg *cfg, char *err,
                   size_t errlen)
{
    uint64_t half = d->count / 2, newest = d->seen / half, from = newest == 0 ? 0 : newest - 1;
    struct drv_writer_cfg with = *cfg;
    size_t n = strlen(path);
    if (n < 5 || strcmp(path + n - 4, ".lcm") != 0) {
        (void)snprintf(err, errlen, "%s: not a name for a dump: expected one ending in .lcm", path);
        return -1;
    }
    with.state = &d->start[from % 2];
    struct drv_writer *w = drv_writer_open(path, &with, err, errlen);
    if (w == NULL)
        return -1;
    int e = 0;
    for (uint64_t k = from * half; e == 0 && k < d->seen; k++)
        e = drv_writer_put(w, &d->slot[k % d->count]);
    int closed = drv_writer_close(w, e == 0);
    if (e == 0)
        e = closed;
    if (e != 0)
        (void)snprintf(err, errlen, "%s: cannot be written: %s", path, strerror(-e));
    return e == 0 ? 0 : -1;
}
