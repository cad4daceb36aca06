/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Prints an hdt event log through liblcm and the code lcm-gen makes of driver/hdt_cycle.lcm: the
 * second implementation check_log holds the driver's own bytes against.  Compiled by that test.
 */
#include <lcm/lcm.h>
#include <stdio.h>
#include <string.h>

#include "hdt_cycle_t.h"
#include "hdt_run_t.h"

#define LIST(n, fmt, value)                \
    do {                                   \
        for (int j = 0; j < (n); j++)      \
            printf(" " fmt, value);        \
        printf("\n");                      \
    } while (0)

static void run(const hdt_run_t *r)
{
    printf("run %d %d %d %d %s %d\n", r->version, r->table_layout, r->period_ns, r->terms, r->arm,
           r->joints);
    LIST(32, "%02x", r->digest[j]);
    LIST(r->joints, "%.17g", r->ratio[j]);
    printf("%s.\n", r->constants);
}

static void cycle(const hdt_cycle_t *c)
{
    printf("cycle %d %lld %d %d %d %d %d %d\n", c->version, (long long)c->t_us, c->joints, c->terms,
           c->mode, c->active, c->fresh, c->servo_alarm);
    LIST(c->joints, "%d", c->count[j]);
    LIST(c->joints, "%d", c->q_ref_q24[j]);
    LIST(c->joints, "%d", c->v_ref_q24[j]);
    LIST(c->joints, "%d", c->a_ref_q16[j]);
    LIST(c->joints, "%d", c->digit[j]);
    LIST(c->joints, "%d", c->speed[j]);
    printf("%d %d\n", c->fault, c->fault_joints);
    LIST(c->joints, "%d", c->limit[j]);
    LIST(c->joints, "%d", c->q_q24[j]);
    LIST(c->joints, "%d", c->v_q24[j]);
    for (int k = 0; k < c->terms; k++)
        LIST(c->joints, "%d", c->term_q16[k][j]);
    LIST(c->joints, "%d", c->total_q16[j]);
    LIST(c->joints, "%d", c->torque_dig[j]);
    LIST(c->joints, "%d", c->status[j]);
    printf("%d %d\n", c->driver_status, c->link);
}

int main(int argc, char **argv)
{
    lcm_eventlog_t *log = argc == 2 ? lcm_eventlog_create(argv[1], "r") : NULL;
    lcm_eventlog_event_t *e;
    if (log == NULL)
        return 3;
    while ((e = lcm_eventlog_read_next_event(log)) != NULL) {
        printf("event %lld %lld %s\n", (long long)e->eventnum, (long long)e->timestamp, e->channel);
        if (strcmp(e->channel, "HDT_RUN") == 0) {
            hdt_run_t r;
            if (hdt_run_t_decode(e->data, 0, e->datalen, &r) != e->datalen)
                return 4;
            run(&r);
            hdt_run_t_decode_cleanup(&r);
        } else if (strcmp(e->channel, "HDT_CYCLE") == 0) {
            hdt_cycle_t c;
            if (hdt_cycle_t_decode(e->data, 0, e->datalen, &c) != e->datalen)
                return 5;
            cycle(&c);
            hdt_cycle_t_decode_cleanup(&c);
        }
        lcm_eventlog_free_event(e);
    }
    lcm_eventlog_destroy(log);
    return 0;
}
