/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Traffic for check-dbc: telegrams of every type that CAN carries, with random and extreme numbers,
 * through the codec and the CAN mapping, as candump writes them; and beside it what they mean.
 *   usage: can_traffic DIR      writes DIR/traffic.candump, and DIR/traffic.expect, a line a frame
 */
#include <stdio.h>
#include <stdlib.h>

#include "driver/drv_backend.h"
#include "driver/drv_telegram.h"
#include "tests/check_main.h"

static const char *const axis_name[DRV_AXES] = {"S1", "S2", "S3", "E1", "E2", "W1", "W2"};

static int16_t word(uint64_t *rng)
{
    static const int16_t edge[] = {0, 1, -1, 255, 256, INT16_MAX, INT16_MIN};
    uint64_t r = test_random(rng);
    return r % 3 == 0 ? edge[(r >> 8) % 7] : (int16_t)(r >> 40);
}

static void write_frame(FILE *dump, unsigned id, const struct hdt_frame *f, unsigned n)
{
    unsigned padded = drv_can_padded(f->len);
    fprintf(dump, "(%u.%06u) can0 %03X##1", n / 1000, n % 1000 * 1000, id);
    for (unsigned i = 0; i < padded; i++)
        fprintf(dump, "%02X", i < f->len ? f->data[i] : 0u);
    fputc('\n', dump);
}

static void command(FILE *dump, FILE *expect, unsigned n, uint8_t type, uint64_t *rng)
{
    struct drv_command c = {.seq = (uint8_t)(n & 0x7fu), .type = type, .axis_no = (uint8_t)(1 + n % 7)};
    struct hdt_frame f;
    c.address = (uint8_t)(type == DRV_TABLE ? 32 * (n % 8) : 0);
    fprintf(expect, "254 Sequence=%u Type=%u", c.seq, c.type);
    for (int i = 0; type == DRV_CYCLIC && i < DRV_AXES; i++) {
        c.axis[i].mode = (uint16_t)(test_random(rng) & 0xffu);
        c.axis[i].torque_dig = word(rng);
        c.axis[i].speed_dig = word(rng);
        fprintf(expect, " %s_Mode=%u %s_Torque=%d %s_Speed=%d", axis_name[i], c.axis[i].mode, axis_name[i],
                c.axis[i].torque_dig, axis_name[i], c.axis[i].speed_dig);
    }
    if (type == DRV_ZERO)
        fprintf(expect, " Zero_Axis=%u", c.axis_no);
    if (type == DRV_TABLE)
        fprintf(expect, " Table_Axis=%u Table_Address=%u", c.axis_no, c.address);
    if (type == DRV_CLEAR)
        fprintf(expect, " Clear_Axis=%u", c.axis_no);
    fputc('\n', expect);
    if (drv_command_encode(DRV_FORMAT_A, &c, &f) != DRV_TELEGRAM_OK)
        exit(1);
    write_frame(dump, DRV_CAN_ID_TO_SERVO, &f, n);
}

static void state(FILE *dump, FILE *expect, unsigned n, uint8_t type, uint64_t *rng)
{
    struct drv_state s = {.seq = (uint8_t)(n & 0x7fu), .type = type, .axis_no = (uint8_t)(1 + n % 7)};
    struct hdt_frame f;
    fprintf(expect, "255 Sequence=%u Type=%u", s.seq, s.type);
    for (int i = 0; type == DRV_CYCLIC && i < DRV_AXES; i++) {
        s.axis[i].status = (uint16_t)test_random(rng);
        s.axis[i].count = n % 5 == 0 ? INT32_MIN : (int32_t)(test_random(rng) >> 32);
        s.axis[i].torque_dig = word(rng);
        fprintf(expect, " %s_Status=%u %s_Count=%ld %s_Torque=%d", axis_name[i], s.axis[i].status,
                axis_name[i], (long)s.axis[i].count, axis_name[i], s.axis[i].torque_dig);
    }
    if (type == DRV_CYCLIC)
        fprintf(expect, " Driver_Status=%u", s.driver_status = (uint16_t)test_random(rng));
    if (type == DRV_ZERO)
        fprintf(expect, " Zero_Axis=%u", s.axis_no);
    if (type == DRV_CLEAR)
        fprintf(expect, " Clear_Axis=%u", s.axis_no);
    fputc('\n', expect);
    if (drv_state_encode(DRV_FORMAT_A, &s, &f) != DRV_TELEGRAM_OK)
        exit(1);
    write_frame(dump, DRV_CAN_ID_TO_HOST, &f, n);
}

int main(int argc, char **argv)
{
    char path[500];
    uint64_t rng = 1;
    if (argc != 2)
        return 2;
    snprintf(path, sizeof path, "%s/traffic.candump", argv[1]);
    FILE *dump = fopen(path, "w");
    snprintf(path, sizeof path, "%s/traffic.expect", argv[1]);
    FILE *expect = fopen(path, "w");
    if (dump == NULL || expect == NULL) {
        perror(path);
        return 3;
    }
    for (unsigned n = 0; n < 2000; n++) {
        uint8_t type = (uint8_t)(n % 2 == 0 ? 'C' : "SETMRA"[n / 2 % 6]);
        command(dump, expect, n, type, &rng);
        if (type != DRV_TABLE) /* its answer is longer than a frame */
            state(dump, expect, n, type, &rng);
    }
    return fclose(dump) != 0 || fclose(expect) != 0 ? 3 : 0;
}
