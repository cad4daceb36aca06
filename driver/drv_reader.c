/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The reader of our LCM event logs.  Events on channels that are not ours are passed over, so a log
 * merged with others by LCM's tools still reads.
 *
 * Owns: the open file.
 * Never: trusts a length, allocates by what a file says, reads a damaged log in silence.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "driver/drv_lcm.h"

struct drv_reader {
    FILE *f;
    struct drv_run run;
    unsigned long long offset;  /* of the event being read */
    unsigned long long next;    /* of the one after it     */
    char err[512];
    char path[256];             /* shortened, for messages */
    size_t waiting;             /* bytes in buf of a cycle read ahead of its turn; 0: none */
    size_t tables_size;         /* 0: the log has none */
    int has_state;
    struct drv_lcm_state state;
    uint8_t buf[DRV_LCM_DATA_MAX];
    uint8_t tables[DRV_LCM_TABLES_MAX];
};

/* Channels of ours, and where the data of each goes. */
enum channel { OTHER, RUN, CYCLE, TABLES, STATE };

static enum channel channel_of(const char *name)
{
    if (strcmp(name, DRV_LCM_CHANNEL_RUN) == 0)
        return RUN;
    if (strcmp(name, DRV_LCM_CHANNEL_CYCLE) == 0)
        return CYCLE;
    if (strcmp(name, DRV_LCM_CHANNEL_TABLES) == 0)
        return TABLES;
    return strcmp(name, DRV_LCM_CHANNEL_STATE) == 0 ? STATE : OTHER;
}

static uint8_t *place(struct drv_reader *r, enum channel c, size_t *room)
{
    *room = c == TABLES ? sizeof r->tables : c == STATE ? sizeof r->state : sizeof r->buf;
    return c == TABLES ? r->tables : c == STATE ? (uint8_t *)&r->state : r->buf;
}

static int fail(struct drv_reader *r, const char *what)
{
    (void)snprintf(r->err, sizeof r->err, "%s: at byte %llu: %s", r->path, r->offset, what);
    return -1;
}

static int cut_off(struct drv_reader *r)
{
    if (ferror(r->f))
        return fail(r, strerror(errno));
    return fail(r, "the log ends inside an event: it was cut off; the events before it are good");
}

/* The next event: its channel, and its data when the channel is ours.  1, 0 at the end, or -1. */
static int next_event(struct drv_reader *r, enum channel *channel, size_t *len)
{
    char name[DRV_LCM_CHANNEL_MAX + 1];
    uint8_t head[DRV_LCM_HEAD], *to;
    size_t room;
    struct drv_lcm_head h;
    size_t n = fread(head, 1, sizeof head, r->f);
    if (n == 0 && feof(r->f))
        return 0;
    if (n >= 4) {
        memset(head + n, 0, sizeof head - n);
        drv_lcm_get_head(head, &h);
        if (h.magic != DRV_LCM_MAGIC)
            return fail(r, "no LCM event here: expected its mark ed a1 da 01");
    }
    if (n < sizeof head)
        return cut_off(r);
    if (h.channel_len == 0 || h.channel_len > DRV_LCM_CHANNEL_MAX || h.data_len > INT32_MAX)
        return fail(r, "an event with an impossible length");
    if (fread(name, 1, h.channel_len, r->f) != h.channel_len)
        return cut_off(r);
    name[h.channel_len] = '\0';
    *channel = channel_of(name);
    to = place(r, *channel, &room);
    if ((*channel == RUN || *channel == CYCLE || *channel == TABLES) && h.data_len > room)
        return fail(r, "an event of ours longer than ours can be");
    *len = h.data_len;
    r->next = r->offset + DRV_LCM_HEAD + h.channel_len + h.data_len;
    /* what is not ours is read in pieces, each over the last */
    for (size_t left = h.data_len; left > 0;) {
        size_t piece = left < room ? left : room;
        if (fread(to, 1, piece, r->f) != piece)
            return cut_off(r);
        left -= piece;
    }
    return 1;
}

/* As next_event, ours only. */
static int next_ours(struct drv_reader *r, enum channel *channel, size_t *len)
{
    for (;;) {
        int e = next_event(r, channel, len);
        if (e != 1 || *channel != OTHER)
            return e;
        r->offset = r->next;
    }
}

static int read_run(struct drv_reader *r)
{
    char line[160];
    enum channel channel = OTHER;
    size_t len = 0;
    int e = next_ours(r, &channel, &len);
    if (e < 0)
        return e;
    if (e == 0 || channel != RUN)
        return fail(r, "no hdt log: expected an event on channel " DRV_LCM_CHANNEL_RUN " first");
    switch (drv_lcm_get_run(r->buf, len, &r->run)) {
    case DRV_LCM_OK:
        break;
    case DRV_LCM_VERSION:
        (void)snprintf(line, sizeof line,
                       "log version %lu, this program reads version %d: convert it with the "
                       "program that wrote it", (unsigned long)r->run.version, DRV_LOG_VERSION);
        return fail(r, line);
    case DRV_LCM_TYPE:
        return fail(r, "the run's head is not of the type hdt.run_t this version has");
    default:
        return fail(r, "the run's head is damaged");
    }
    if (!drv_lcm_terms_known(r->run.terms)) {
        (void)snprintf(line, sizeof line,
                       "the log has %lu torque terms, this program reads logs of %d, and of %d: "
                       "convert it with the program that wrote it",
                       (unsigned long)r->run.terms, (int)HDT_TERMS, DRV_LCM_TERMS_LAYOUT_1);
        return fail(r, line);
    }
    r->offset = r->next;
    return 0;
}

/* Tables and state stand before the first cycle.  What is wrong there is told when that is asked for. */
static void read_start(struct drv_reader *r)
{
    enum channel channel = OTHER;
    size_t len = 0;
    while (r->waiting == 0 && next_ours(r, &channel, &len) == 1) {
        if (channel == TABLES) {
            r->tables_size = len;
        } else if (channel == STATE) {
            r->has_state = 1;
            if (len != sizeof r->state)
                r->state.size = 0;
        } else if (channel == CYCLE) {
            r->waiting = len;
            return;
        } else {
            (void)fail(r, "a second run begins: one run a log");
            return;
        }
        r->offset = r->next;
    }
}

struct drv_reader *drv_reader_open(const char *path, char *err, size_t errlen)
{
    struct drv_reader *r = calloc(1, sizeof *r);
    if (r == NULL) {
        if (err != NULL && errlen > 0)
            (void)snprintf(err, errlen, "%s: out of memory", path);
        return NULL;
    }
    (void)snprintf(r->path, sizeof r->path, "%s", path);
    r->f = fopen(path, "rb");
    if (r->f == NULL)
        (void)snprintf(r->err, sizeof r->err, "%s: cannot be read: %s", r->path, strerror(errno));
    else if (read_run(r) == 0) {
        read_start(r);
        return r;
    }
    if (err != NULL && errlen > 0)
        (void)snprintf(err, errlen, "%s", r->err);
    drv_reader_close(r);
    return NULL;
}

const struct drv_run *drv_reader_run(const struct drv_reader *r)
{
    return &r->run;
}

int drv_reader_tables(const struct drv_reader *r, struct hdt_tables *out)
{
    return r->tables_size == 0 ? DRV_LOG_NONE : hdt_tables_read(r->tables, r->tables_size, out);
}

int drv_reader_start(struct drv_reader *r, const struct hdt_tables *tables, hdt_t *core)
{
    const struct drv_lcm_state *s = &r->state;
    char why[160];
    int e = hdt_init(core, tables);
    if (e != HDT_OK || !r->has_state)
        return e;
    if (s->order != DRV_LCM_ORDER || s->version != DRV_LCM_LIBRARY || s->layout != HDT_TABLES_LAYOUT ||
        s->size != sizeof s->core)
        return DRV_LOG_OTHER_BUILD;
    if (drv_lcm_check_core(&s->core, core, why, sizeof why) != 0) {
        (void)snprintf(r->err, sizeof r->err, "%s: the core's state in it is damaged: %s", r->path, why);
        return DRV_LOG_DAMAGED;
    }
    *core = s->core;
    core->tables = tables;
    return HDT_OK;
}

int drv_reader_next(struct drv_reader *r, struct drv_record *rec)
{
    enum channel channel = CYCLE;
    size_t len = r->waiting;
    if (r->err[0] != '\0')
        return -1;
    int e = len != 0 ? 1 : next_ours(r, &channel, &len);
    r->waiting = 0;
    if (e != 1)
        return e;
    if (channel == RUN)
        return fail(r, "a second run begins: one run a log");
    if (channel != CYCLE)
        return fail(r, "tables or state after the first cycle: expected before it");
    e = drv_lcm_get_record(r->buf, len, r->run.joints, r->run.terms, rec);
    if (e == DRV_LCM_TYPE || e == DRV_LCM_VERSION)
        return fail(r, "a cycle of another version than the run's head says");
    if (e != DRV_LCM_OK)
        return fail(r, "a cycle that is damaged");
    r->offset = r->next;
    return 1;
}

const char *drv_reader_error(const struct drv_reader *r)
{
    return r->err;
}

void drv_reader_close(struct drv_reader *r)
{
    if (r == NULL)
        return;
    if (r->f != NULL)
        fclose(r->f);
    free(r);
}
