/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The log writer: records to a CSV of measurements or to an LCM event log.
 *
 * Owns: the .part file until it takes its name.
 * Never: runs in the control thread; leaves a half-written log under its final name.
 */
#include "driver/drv_log.h"

#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "driver/drv_lcm.h"

#define Q24 (1.0 / 16777216.0)
#define Q16 (1.0 / 65536.0)
#define NM_PER_DIGIT 0.001
#define DRV_LCM_BEFORE 3 /* run, tables, state */

struct drv_writer {
    FILE *f;
    char *path, *part;
    struct drv_writer_cfg cfg; /* constants: used in open only */
    int lcm;
    int failed;                /* -errno of the first failure */
    int started;
    uint64_t t0_us;            /* of the first CSV row */
    struct { long at; struct drv_lcm_head head; } before[DRV_LCM_BEFORE]; /* events before the first period */
    uint64_t events;
    uint8_t buf[DRV_LCM_DATA_MAX];
};

#ifdef __GNUC__
__attribute__((format(printf, 3, 4)))
#endif
static struct drv_writer *refuse(char *err, size_t errlen, const char *fmt, ...)
{
    va_list ap;
    if (err != NULL && errlen > 0) {
        va_start(ap, fmt);
        (void)vsnprintf(err, errlen, fmt, ap);
        va_end(ap);
    }
    return NULL;
}

static int ends_in(const char *path, const char *end)
{
    size_t n = strlen(path), k = strlen(end);
    return n > k && strcmp(path + n - k, end) == 0;
}

static int good_joints(const struct hdt_tables *t)
{
    return t != NULL && t->joints >= 1 && t->joints <= HDT_JOINTS_MAX;
}

/* One line, "key = value": anything else would break the head of the CSV. */
static int good_constant(const char *line)
{
    const char *eq = strchr(line, '=');
    if (eq == NULL || eq == line)
        return 0;
    for (const char *p = line; *p != '\0'; p++)
        if ((unsigned char)*p < 0x20 || *p == 0x7f)
            return 0;
    return 1;
}

static int put_event(struct drv_writer *w, const char *channel, uint64_t t_us, const void *data, size_t len)
{
    struct drv_lcm_head h = {.magic = DRV_LCM_MAGIC,
                             .number = w->events++,
                             .t_us = t_us,
                             .channel_len = (uint32_t)strlen(channel),
                             .data_len = (uint32_t)len};
    uint8_t head[DRV_LCM_HEAD];
    drv_lcm_put_head(&h, head);
    if (len == 0) {
        errno = EOVERFLOW;
        return -1;
    }
    if (!w->started && h.number < DRV_LCM_BEFORE) {
        w->before[h.number].at = ftell(w->f);
        w->before[h.number].head = h;
    }
    return fwrite(head, sizeof head, 1, w->f) == 1 && fputs(channel, w->f) >= 0 &&
                   fwrite(data, len, 1, w->f) == 1
               ? 0
               : -1;
}

static int lcm_begin(struct drv_writer *w)
{
    struct drv_run run;
    const struct hdt_tables *t = w->cfg.tables;
    size_t used = 0;
    memset(&run, 0, sizeof run);
    run.version = DRV_LOG_VERSION;
    run.table_layout = t->layout;
    run.period_ns = t->period_ns;
    run.terms = HDT_TERMS;
    run.joints = t->joints;
    memcpy(run.arm, t->name, sizeof run.arm - 1);
    memcpy(run.digest, t->digest, sizeof run.digest);
    memcpy(run.ratio, w->cfg.ratio, sizeof run.ratio);
    for (unsigned i = 0; w->cfg.constants != NULL && w->cfg.constants[i] != NULL; i++) {
        size_t n = strlen(w->cfg.constants[i]);
        memcpy(run.constants + used, w->cfg.constants[i], n);
        run.constants[used + n] = '\n';
        used += n + 1;
    }
    return put_event(w, DRV_LCM_CHANNEL_RUN, 0, w->buf, drv_lcm_put_run(&run, w->buf, sizeof w->buf));
}

/* With these the log replays without any other file. */
static int lcm_tables(struct drv_writer *w)
{
    size_t size = hdt_tables_size(w->cfg.tables->joints);
    uint8_t *image = malloc(size);
    int e = -1;
    if (image != NULL)
        e = put_event(w, DRV_LCM_CHANNEL_TABLES, 0, image, hdt_tables_write(w->cfg.tables, image, size));
    free(image);
    return e;
}

static int lcm_state(struct drv_writer *w)
{
    struct drv_lcm_state s;
    memset(&s, 0, sizeof s);
    s.order = DRV_LCM_ORDER;
    s.version = DRV_LCM_LIBRARY;
    s.layout = HDT_TABLES_LAYOUT;
    s.size = sizeof s.core;
    s.core = *w->cfg.state;
    s.core.tables = NULL;
    return put_event(w, DRV_LCM_CHANNEL_STATE, 0, &s, sizeof s);
}

/* What stands before the first period. */
static int lcm_head(struct drv_writer *w)
{
    if (lcm_begin(w) != 0 || lcm_tables(w) != 0)
        return -1;
    return w->cfg.state != NULL ? lcm_state(w) : 0;
}

/* What stands before the first period gets its time: a player waits between events as long as their
 * times are apart, and the host's monotonic time may be days. */
static int lcm_date(struct drv_writer *w, uint64_t t_us)
{
    for (uint64_t k = 0; k < w->events && k < DRV_LCM_BEFORE; k++) {
        uint8_t head[DRV_LCM_HEAD];
        w->before[k].head.t_us = t_us;
        drv_lcm_put_head(&w->before[k].head, head);
        if (fseek(w->f, w->before[k].at, SEEK_SET) != 0 || fwrite(head, sizeof head, 1, w->f) != 1)
            return -1;
    }
    w->started = 1;
    return fseek(w->f, 0, SEEK_END) == 0 ? 0 : -1;
}

static int csv_begin(struct drv_writer *w)
{
    const struct hdt_tables *t = w->cfg.tables;
    FILE *f = w->f;
    fprintf(f, "# format = hdt-log\n# version = %d\n# arm = %.31s\n# table_digest = ",
            DRV_LOG_VERSION, t->name);
    for (unsigned i = 0; i < sizeof t->digest; i++)
        fprintf(f, "%02x", t->digest[i]);
    fprintf(f, "\n# period_ns = %" PRIu32 "\n", t->period_ns);
    for (unsigned j = 0; j < t->joints; j++)
        fprintf(f, "# ratio%u = %.17g\n", j + 1, w->cfg.ratio[j]);
    for (unsigned i = 0; w->cfg.constants != NULL && w->cfg.constants[i] != NULL; i++)
        fprintf(f, "# %s\n", w->cfg.constants[i]);
    fputs("t_s", f);
    for (unsigned j = 1; j <= t->joints; j++)
        fprintf(f, ",q%u_rad,tau%u_nm,v%u_radps,qref%u_rad,vref%u_radps,aref%u_radps2", j, j, j, j,
                j, j);
    if (w->cfg.terms) {
        for (unsigned j = 0; j < t->joints; j++) {
            for (unsigned k = 0; k < HDT_TERMS; k++)
                if ((t->joint[j].terms >> k & 1u) != 0)
                    fprintf(f, ",%s%u_nm", hdt_term_str((int)k), j + 1);
            fprintf(f, ",digit%u", j + 1);
        }
        fputs(",fault,link", f);
    }
    fputc('\n', f);
    return ferror(f) ? -1 : 0;
}

/* A row stands at the time of its measurement. */
static uint64_t row_us(const struct hdt_in *in)
{
    return in->count_us != 0 ? in->count_us : in->t_us;
}

static int csv_row(struct drv_writer *w, const struct drv_record *rec)
{
    const struct hdt_tables *t = w->cfg.tables;
    const struct hdt_in *in = &rec->in;
    const struct hdt_out *out = &rec->out;
    FILE *f = w->f;
    if (in->fresh == 0)
        return 0;
    if (!w->started)
        w->t0_us = row_us(in);
    w->started = 1;
    fprintf(f, "%.6f", (double)(row_us(in) - w->t0_us) * 1e-6);
    for (unsigned j = 0; j < t->joints; j++)
        fprintf(f, ",%.9f,%.6f,%.9f,%.9f,%.9f,%.6f", out->q[j].raw * Q24,
                rec->torque_dig[j] * NM_PER_DIGIT * w->cfg.ratio[j], out->v[j].raw * Q24,
                in->q_ref[j].raw * Q24, in->v_ref[j].raw * Q24, in->a_ref[j].raw * Q16);
    if (w->cfg.terms) {
        for (unsigned j = 0; j < t->joints; j++) {
            for (unsigned k = 0; k < HDT_TERMS; k++)
                if ((t->joint[j].terms >> k & 1u) != 0)
                    fprintf(f, ",%.6f", out->term[k][j].raw * Q16);
            fprintf(f, ",%d", out->digit[j].raw);
        }
        fprintf(f, ",%" PRIu32 ",%u", out->fault, rec->link);
    }
    fputc('\n', f);
    return ferror(f) ? -1 : 0;
}

static void discard(struct drv_writer *w)
{
    if (w->f != NULL) {
        (void)fclose(w->f);
        (void)unlink(w->part);
    }
    free(w->path);
    free(w->part);
    free(w);
}

/* 0 or a line in err. */
static int check_constants(const char *path, const char *const *lines, char *err, size_t errlen)
{
    size_t total = 0;
    for (unsigned i = 0; lines != NULL && lines[i] != NULL; i++) {
        total += strlen(lines[i]) + 1;
        if (!good_constant(lines[i]) || total >= DRV_CONSTANTS_MAX) {
            refuse(err, errlen,
                   "%s: constant %u: expected one line \"key = value\", %d bytes in all", path,
                   i + 1, DRV_CONSTANTS_MAX - 1);
            return -1;
        }
    }
    return 0;
}

/* What can be wrong before a file is touched; 0 or a line in err. */
static int check_cfg(const char *path, const struct drv_writer_cfg *cfg, char *err, size_t errlen)
{
    struct stat st;
    if (!ends_in(path, ".csv") && !ends_in(path, ".lcm")) {
        refuse(err, errlen, "%s: not a log name: expected one ending in .csv or .lcm", path);
        return -1;
    }
    if (!good_joints(cfg->tables)) {
        refuse(err, errlen, "%s: no tables with 1 to %d joints to log for", path, HDT_JOINTS_MAX);
        return -1;
    }
    for (unsigned j = 0; j < cfg->tables->joints; j++)
        if (!(cfg->ratio[j] > 0.0 && cfg->ratio[j] < 1e6)) {
            refuse(err, errlen, "%s: ratio of joint %u is %g: expected the gear ratio, above 0",
                   path, j + 1, cfg->ratio[j]);
            return -1;
        }
    if (stat(path, &st) == 0 && S_ISDIR(st.st_mode)) {
        refuse(err, errlen, "%s: is a directory", path);
        return -1;
    }
    return check_constants(path, cfg->constants, err, errlen);
}

struct drv_writer *drv_writer_open(const char *path, const struct drv_writer_cfg *cfg, char *err,
                                   size_t errlen)
{
    static const char suffix[] = ".part";
    if (path == NULL || cfg == NULL)
        return refuse(err, errlen, "log writer: no path or no configuration given");
    if (check_cfg(path, cfg, err, errlen) != 0)
        return NULL;
    struct drv_writer *w = calloc(1, sizeof *w);
    size_t n = strlen(path);
    if (w != NULL) {
        w->path = malloc(n + 1);
        w->part = malloc(n + sizeof suffix);
    }
    if (w == NULL || w->path == NULL || w->part == NULL) {
        if (w != NULL)
            discard(w);
        return refuse(err, errlen, "%s: out of memory", path);
    }
    memcpy(w->path, path, n + 1);
    memcpy(w->part, path, n);
    memcpy(w->part + n, suffix, sizeof suffix);
    w->cfg = *cfg;
    w->lcm = ends_in(path, ".lcm");
    w->f = fopen(w->part, "wb");
    int e = w->f == NULL ? -1 : w->lcm ? lcm_head(w) : csv_begin(w);
    w->cfg.constants = NULL;
    w->cfg.state = NULL;
    if (e != 0) {
        refuse(err, errlen, "%s: cannot be written: %s", w->part, strerror(errno));
        discard(w);
        return NULL;
    }
    return w;
}

int drv_writer_put(struct drv_writer *w, const struct drv_record *rec)
{
    if (w->failed)
        return w->failed;
    int e = w->lcm && !w->started ? lcm_date(w, rec->in.t_us) : 0;
    if (e == 0)
        e = w->lcm ? put_event(w, DRV_LCM_CHANNEL_CYCLE, rec->in.t_us, w->buf,
                               drv_lcm_put_record(rec, w->cfg.tables->joints, w->buf, sizeof w->buf))
                   : csv_row(w, rec);
    if (e != 0)
        w->failed = errno > 0 ? -errno : -EIO;
    return w->failed;
}

int drv_writer_close(struct drv_writer *w, int keep)
{
    if (w == NULL)
        return 0;
    int e = w->failed;
    if (keep && e == 0) {
        /* the name may only point to bytes that are on the disk */
        if (fflush(w->f) != 0 || ferror(w->f) || fsync(fileno(w->f)) != 0)
            e = -errno;
        if (fclose(w->f) != 0 && e == 0)
            e = -errno;
        w->f = NULL;
        if (e == 0 && rename(w->part, w->path) != 0)
            e = -errno;
        if (e != 0)
            (void)unlink(w->part);
    }
    discard(w);
    return e;
}
