/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bus backends: the memory bus, unix sockets between two processes, the CAN FD and ARCNET mappings,
 * and the bus that breaks on purpose.  Real interfaces are in check_net.c.
 */
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "driver/drv_backend.h"
#include "tests/broken_bus.h"
#include "driver/drv_telegram.h"
#include "tests/bus_frames.h"
#include "tests/check_main.h"

/* ---- memory bus ----------------------------------------------------------------------------- */

START_TEST(test_loop_keeps_order_and_directions_apart)
{
    static struct drv_loop loop;
    struct hdt_bus host, servo;
    struct hdt_frame f;
    uint64_t rng = 5;
    unsigned down_in = 0, down_out = 0, up_in = 0, up_out = 0;
    drv_loop_pair(&loop, &host, &servo);
    /* against two counters: each frame carries its number */
    for (int n = 0; n < 20000; n++) {
        unsigned pick = test_random(&rng) % 4;
        const struct hdt_bus *from = pick & 1u ? &servo : &host;
        unsigned *in = pick & 1u ? &up_in : &down_in, *out = pick & 1u ? &up_out : &down_out;
        if (pick & 2u) {
            f = frame_of(1 + *in % HDT_FRAME_MAX, *in * 2u + (pick & 1u));
            int full = *in - *out == DRV_LOOP_DEPTH;
            ck_assert_int_eq(send_to(from, &f), full ? HDT_BUS_ERR_AGAIN : HDT_BUS_OK);
            *in += !full;
        } else {
            int e = recv_from(pick & 1u ? &host : &servo, &f);
            ck_assert_int_eq(e, *in == *out ? HDT_BUS_ERR_AGAIN : HDT_BUS_OK);
            if (e == HDT_BUS_OK) {
                struct hdt_frame want = frame_of(1 + *out % HDT_FRAME_MAX, *out * 2u + (pick & 1u));
                assert_same(&f, &want);
                ++*out;
            }
        }
    }
    ck_assert_uint_gt(down_out, 3000);
    ck_assert_uint_gt(up_out, 3000);
}
END_TEST

START_TEST(test_loop_refuses_frames_of_no_length_or_too_long)
{
    static struct drv_loop loop;
    struct hdt_bus host, servo;
    struct hdt_frame f = {.len = 0};
    drv_loop_pair(&loop, &host, &servo);
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_FRAME);
    f.len = HDT_FRAME_MAX + 1;
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_FRAME);
    ck_assert_int_eq(recv_from(&servo, &f), HDT_BUS_ERR_AGAIN);
}
END_TEST

/* ---- names ---------------------------------------------------------------------------------- */

START_TEST(test_a_wrong_name_is_one_line_and_a_zeroed_bus)
{
    static const char *const names[] = {NULL, "", "unix", "tcp:host", "unix:", "can:", "loop:",
        "UNIX:/x",
                                        "can:an_interface_name_too_long", "isotp:", "arcnet:",
                                        "arcnet:a/b", "can:../x", "eth0"};
    static const struct hdt_bus zero;
    for (unsigned i = 0; i < sizeof names / sizeof names[0]; i++) {
        struct hdt_bus b;
        char err[300] = "";
        memset(&b, 0xff, sizeof b);
        ck_assert_int_eq(hdt_bus_open(&b, names[i], HDT_BUS_HOST, err, sizeof err),
                         HDT_BUS_ERR_NAME);
        ck_assert_mem_eq(&b, &zero, sizeof b);
        ck_assert_uint_gt(strlen(err), 10);
        ck_assert_ptr_null(strchr(err, '\n'));
        if (names[i] != NULL)
            ck_assert_ptr_nonnull(strstr(err, names[i])); /* says what was found */
        ck_assert_ptr_nonnull(strstr(err, "unix:PATH") != NULL ? strstr(err, "unix:PATH")
                                                               : strstr(err, ":IFACE"));
        if (names[i] != NULL && strcmp(names[i], "loop:") == 0)
            ck_assert_ptr_nonnull(strstr(err, "both ends in one process"));
        if (names[i] != NULL && strncmp(names[i], "tcp", 3) == 0)
            ck_assert_ptr_nonnull(strstr(err, "not a bus"));
        hdt_bus_close(&b); /* a zeroed bus is left alone */
        /* no room for the line is no crash */
        ck_assert_int_eq(hdt_bus_open(&b, names[i], HDT_BUS_HOST, NULL, 0), HDT_BUS_ERR_NAME);
        char tiny[4];
        ck_assert_int_eq(hdt_bus_open(&b, names[i], HDT_BUS_HOST, tiny, sizeof tiny),
                         HDT_BUS_ERR_NAME);
        ck_assert_uint_eq(strlen(tiny), 3);
    }
    for (int e = -104; e <= 0; e++)
        ck_assert_ptr_nonnull(hdt_bus_strerror(e));
    struct hdt_bus_health h;
    memset(&h, 0xff, sizeof h);
    hdt_bus_get_health(&zero, &h);
    ck_assert_int_eq(h.line, HDT_LINE_UNKNOWN);
    ck_assert_uint_eq(h.sent + h.received + h.offs + h.received_ns, 0);
    for (int line = HDT_LINE_UNKNOWN; line <= HDT_LINE_OFF + 1; line++)
        ck_assert_ptr_nonnull(hdt_line_str((enum hdt_line)line));
}
END_TEST

/* ---- unix sockets --------------------------------------------------------------------------- */

static char dir[64], path[100], name[110];

static void in_own_directory(void)
{
    strcpy(dir, P_tmpdir "/hdt_bus_XXXXXX");
    ck_assert_ptr_nonnull(mkdtemp(dir));
    snprintf(path, sizeof path, "%s/servo", dir);
    snprintf(name, sizeof name, "unix:%s", path);
}

static void leave_directory(void)
{
    unlink(path);
    ck_assert_int_eq(rmdir(dir), 0); /* nothing else may be left in it */
}

static struct hdt_bus open_ok(enum hdt_bus_side side)
{
    struct hdt_bus b;
    char err[300] = "";
    int e = hdt_bus_open(&b, name, side, err, sizeof err);
    ck_assert_msg(e == HDT_BUS_OK, "%s", err);
    return b;
}

static void open_fails(enum hdt_bus_side side, const char *word)
{
    struct hdt_bus b;
    char err[300] = "";
    ck_assert_int_lt(hdt_bus_open(&b, name, side, err, sizeof err), 0);
    ck_assert_msg(strstr(err, word) != NULL, "expected \"%s\" in: %s", word, err);
    ck_assert_ptr_nonnull(strstr(err, path));
    ck_assert_ptr_null(b.ctx);
}

/* A servo process that returns what it gets; `left` packets, then it goes without a good-bye. */
static pid_t echo_servo(int ready_fd, unsigned left)
{
    pid_t pid = fork();
    if (pid != 0)
        return pid;
    struct hdt_bus b;
    struct hdt_frame f;
    char err[200];
    if (hdt_bus_open(&b, name, HDT_BUS_SERVO, err, sizeof err) != HDT_BUS_OK ||
        write(ready_fd, "r", 1) != 1)
        _exit(3);
    while (left > 0) {
        struct pollfd p = {.fd = b.fd(b.ctx), .events = POLLIN};
        if (poll(&p, 1, 20000) == 0)
            _exit(4);
        while (recv_from(&b, &f) == HDT_BUS_OK) {
            left--;
            if (send_to(&b, &f) != HDT_BUS_OK)
                _exit(5);
        }
    }
    _exit(0);
}

static pid_t start_servo(unsigned left)
{
    int ready[2];
    char c;
    ck_assert_int_eq(pipe(ready), 0);
    pid_t pid = echo_servo(ready[1], left);
    ck_assert_int_eq(read(ready[0], &c, 1), 1);
    close(ready[0]);
    close(ready[1]);
    return pid;
}

static void servo_went_well(pid_t pid)
{
    int status;
    ck_assert_int_eq(waitpid(pid, &status, 0), pid);
    ck_assert_int_eq(status, 0);
}

START_TEST(test_every_length_crosses_between_two_processes)
{
    pid_t pid = start_servo(2 * HDT_FRAME_MAX);
    struct hdt_bus host = open_ok(HDT_BUS_HOST);
    for (unsigned n = 0; n < 2 * HDT_FRAME_MAX; n++) {
        struct hdt_frame f = frame_of(1 + n % HDT_FRAME_MAX, n), back;
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK);
        ck_assert_int_eq(recv_wait(&host, &back), HDT_BUS_OK);
        assert_same(&f, &back);
    }
    servo_went_well(pid);
    hdt_bus_close(&host);
}
END_TEST

START_TEST(test_host_outlives_a_servo_that_dies_and_comes_back)
{
    struct hdt_frame f = frame_of(37, 1), back;
    pid_t pid = start_servo(1000000);
    struct hdt_bus host = open_ok(HDT_BUS_HOST);
    for (int life = 0; life < 3; life++) {
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK);
        ck_assert_int_eq(recv_wait(&host, &back), HDT_BUS_OK);
        /* killed: its socket file stays behind */
        kill(pid, SIGKILL);
        waitpid(pid, NULL, 0);
        ck_assert_int_eq(access(path, F_OK), 0);
        ck_assert_int_eq(recv_wait(&host, &back), HDT_BUS_ERR_DOWN);
        ck_assert_int_eq(recv_from(&host, &back), HDT_BUS_ERR_DOWN);
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_DOWN);
        pid = start_servo(1000000); /* takes the stale file over */
        ck_assert_int_eq(recv_from(&host, &back), HDT_BUS_ERR_AGAIN);
    }
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    hdt_bus_close(&host);
}
END_TEST

START_TEST(test_servo_outlives_its_hosts_one_after_the_other)
{
    struct hdt_bus servo = open_ok(HDT_BUS_SERVO);
    struct hdt_frame f = frame_of(2, 2), g = frame_of(37, 3), got;
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_DOWN); /* nobody yet */
    ck_assert_int_eq(send_to(&servo, &f), HDT_BUS_ERR_DOWN);
    struct hdt_bus first = open_ok(HDT_BUS_HOST), second = open_ok(HDT_BUS_HOST);
    ck_assert_int_eq(send_to(&second, &g), HDT_BUS_OK);
    ck_assert_int_eq(send_to(&first, &f), HDT_BUS_OK);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    assert_same(&got, &f); /* the first is served, the second waits */
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_AGAIN);
    /* the answer goes to the first only */
    ck_assert_int_eq(send_to(&servo, &f), HDT_BUS_OK);
    ck_assert_int_eq(recv_wait(&first, &got), HDT_BUS_OK);
    ck_assert_int_eq(recv_from(&second, &got), HDT_BUS_ERR_AGAIN);
    hdt_bus_close(&first);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_ERR_DOWN);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    assert_same(&got, &g);
    hdt_bus_close(&second);
    hdt_bus_close(&servo);
    ck_assert_ptr_null(servo.send);
    ck_assert_ptr_null(servo.ctx);
    hdt_bus_close(&servo); /* twice is once */
    ck_assert_int_ne(access(path, F_OK), 0); /* the socket file went with the servo */
    open_fails(HDT_BUS_HOST, "start it first");
}
END_TEST

START_TEST(test_writing_to_a_dead_peer_is_down_not_a_signal)
{
    struct hdt_bus servo = open_ok(HDT_BUS_SERVO), host = open_ok(HDT_BUS_HOST);
    struct hdt_frame f = frame_of(60, 4), got;
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    hdt_bus_close(&host);
    signal(SIGPIPE, SIG_DFL);
    ck_assert_int_eq(send_to(&servo, &f), HDT_BUS_ERR_DOWN);
    hdt_bus_close(&servo);
}
END_TEST

START_TEST(test_a_full_queue_drops_the_newest_and_keeps_the_order)
{
    struct hdt_bus servo = open_ok(HDT_BUS_SERVO), host = open_ok(HDT_BUS_HOST);
    struct hdt_frame f, got;
    unsigned sent = 0, taken = 0;
    int e = HDT_BUS_OK;
    while (sent < 1000) {
        f = frame_of(37, sent);
        if ((e = send_to(&host, &f)) != HDT_BUS_OK)
            break;
        sent++;
    }
    ck_assert_int_eq(e, HDT_BUS_ERR_AGAIN);
    ck_assert_uint_ge(sent, 4);
    ck_assert_uint_le(sent, 64); /* commands must not grow old in the kernel: < 0.1 s at 700 Hz */
    while (recv_from(&servo, &got) == HDT_BUS_OK) {
        f = frame_of(37, taken++);
        assert_same(&got, &f);
    }
    ck_assert_uint_eq(taken, sent);
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK); /* room again */
    hdt_bus_close(&host);
    hdt_bus_close(&servo);
}
END_TEST

START_TEST(test_a_packet_too_long_is_refused_and_gone)
{
    struct hdt_bus servo = open_ok(HDT_BUS_SERVO);
    struct sockaddr_un a = {.sun_family = AF_UNIX};
    uint8_t big[300] = {0};
    struct hdt_frame got;
    int fd = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    strcpy(a.sun_path, path);
    ck_assert_int_eq(connect(fd, (struct sockaddr *)&a, sizeof a), 0);
    ck_assert_int_eq(send(fd, big, HDT_FRAME_MAX + 1, 0), HDT_FRAME_MAX + 1);
    ck_assert_int_eq(send(fd, big, sizeof big, 0), (int)sizeof big);
    ck_assert_int_eq(send(fd, big, HDT_FRAME_MAX, 0), HDT_FRAME_MAX);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_ERR_FRAME);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_ERR_FRAME);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    ck_assert_uint_eq(got.len, HDT_FRAME_MAX);
    close(fd);
    struct hdt_frame f = {.len = 0};
    struct hdt_bus host = open_ok(HDT_BUS_HOST);
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_FRAME);
    f.len = HDT_FRAME_MAX + 1;
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_FRAME);
    hdt_bus_close(&host);
    hdt_bus_close(&servo);
}
END_TEST

START_TEST(test_nothing_but_a_stale_socket_is_ever_removed)
{
    struct stat before, after;
    /* a regular file */
    FILE *f = fopen(path, "w");
    fputs("precious", f);
    fclose(f);
    open_fails(HDT_BUS_SERVO, "is no socket");
    ck_assert_int_eq(stat(path, &after), 0);
    ck_assert_int_eq(after.st_size, 8);
    open_fails(HDT_BUS_HOST, "");
    unlink(path);
    /* a symlink, even to a stale socket */
    char target[120];
    snprintf(target, sizeof target, "%s/other", dir);
    struct sockaddr_un a = {.sun_family = AF_UNIX};
    strcpy(a.sun_path, target);
    int fd = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    ck_assert_int_eq(bind(fd, (struct sockaddr *)&a, sizeof a), 0);
    close(fd);
    ck_assert_int_eq(symlink(target, path), 0);
    open_fails(HDT_BUS_SERVO, "is no socket");
    ck_assert_int_eq(lstat(path, &after), 0);
    ck_assert_int_eq(access(target, F_OK), 0);
    unlink(path);
    /* a directory */
    ck_assert_int_eq(mkdir(path, 0700), 0);
    open_fails(HDT_BUS_SERVO, "is no socket");
    ck_assert_int_eq(rmdir(path), 0);
    /* the stale socket itself is taken over */
    ck_assert_int_eq(rename(target, path), 0);
    struct hdt_bus servo = open_ok(HDT_BUS_SERVO);
    ck_assert_int_eq(lstat(path, &before), 0);
    /* and a live one is not */
    open_fails(HDT_BUS_SERVO, "another servo");
    ck_assert_int_eq(lstat(path, &after), 0);
    ck_assert_uint_eq(before.st_ino, after.st_ino);
    hdt_bus_close(&servo);
    /* a directory that does not exist */
    char keep[sizeof name], keep_path[sizeof path];
    strcpy(keep, name);
    strcpy(keep_path, path);
    snprintf(path, sizeof path, "%s/no/servo", dir);
    snprintf(name, sizeof name, "unix:%s", path);
    open_fails(HDT_BUS_SERVO, "No such file");
    open_fails(HDT_BUS_HOST, "start it first");
    strcpy(name, keep);
    strcpy(path, keep_path);
}
END_TEST

START_TEST(test_closing_leaves_another_servos_socket_alone)
{
    struct hdt_bus old = open_ok(HDT_BUS_SERVO);
    ck_assert_int_eq(unlink(path), 0); /* someone tidied up, and another servo started */
    struct hdt_bus new = open_ok(HDT_BUS_SERVO);
    hdt_bus_close(&old);
    ck_assert_int_eq(access(path, F_OK), 0);
    struct hdt_bus host = open_ok(HDT_BUS_HOST);
    hdt_bus_close(&host);
    hdt_bus_close(&new);
}
END_TEST

START_TEST(test_a_path_too_long_says_so)
{
    char long_name[400] = "unix:" P_tmpdir "/", err[300] = "";
    struct hdt_bus b;
    memset(long_name + strlen(long_name), 'x', 5 + 305 - strlen(long_name));
    ck_assert_int_eq(hdt_bus_open(&b, long_name, HDT_BUS_SERVO, err, sizeof err), HDT_BUS_ERR_NAME);
    ck_assert_ptr_nonnull(strstr(err, "305 bytes, at most 107"));
    /* one byte too long, and the longest there is */
    long_name[5 + 108] = '\0';
    ck_assert_int_eq(hdt_bus_open(&b, long_name, HDT_BUS_SERVO, err, sizeof err), HDT_BUS_ERR_NAME);
    ck_assert_ptr_nonnull(strstr(err, "108 bytes, at most 107"));
    long_name[5 + 107] = '\0';
    ck_assert_int_eq(hdt_bus_open(&b, long_name, HDT_BUS_SERVO, err, sizeof err), HDT_BUS_OK);
    hdt_bus_close(&b);
    ck_assert_int_ne(access(long_name + 5, F_OK), 0);
}
END_TEST

START_TEST(test_posix_clock_goes_forward_and_sleeps_until)
{
    struct hdt_clock c = hdt_clock_posix();
    uint64_t t0 = c.now_ns(c.ctx);
    ck_assert_int_eq(c.sleep_until_ns(c.ctx, t0 + 3000000), 0);
    uint64_t t1 = c.now_ns(c.ctx);
    ck_assert_uint_ge(t1, t0 + 3000000);
    ck_assert_int_eq(c.sleep_until_ns(c.ctx, t0), 0); /* past: at once */
    /* the same clock as the system's monotonic one */
    struct timespec ts;
    ck_assert_int_eq(clock_gettime(CLOCK_MONOTONIC, &ts), 0);
    uint64_t t2 = (uint64_t)ts.tv_sec * 1000000000u + (uint64_t)ts.tv_nsec;
    ck_assert_uint_ge(t2, t1);
    ck_assert_uint_lt(t2 - t1, 10000000000u);
}
END_TEST

/* ---- CAN ------------------------------------------------------------------------------------ */

START_TEST(test_can_padding_is_the_shortest_length_can_fd_has)
{
    /* by brute force over the lengths of ISO 11898-1 */
    static const unsigned dlc[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    for (unsigned len = 0; len <= 300; len++) {
        unsigned want = 0;
        for (unsigned i = 16; i-- > 0;)
            if (dlc[i] >= len)
                want = dlc[i];
        ck_assert_uint_eq(drv_can_padded(len), want);
    }
}
END_TEST

START_TEST(test_can_trim_returns_the_telegram_or_refuses)
{
    struct drv_command c = {.seq = 5, .axis_no = 7};
    struct drv_state s = {.seq = 5, .axis_no = 7};
    struct hdt_frame f, got;
    static const uint8_t types[] = {'S', 'E', 'T', 'C', 'M', 'A', 'R'};
    for (unsigned up = 0; up < 2; up++) {
        for (unsigned i = 0; i < sizeof types; i++) {
            c.type = s.type = types[i];
            ck_assert_int_eq(up ? drv_state_encode(DRV_FORMAT_A, &s, &f)
                                : drv_command_encode(DRV_FORMAT_A, &c, &f),
                             0);
            uint8_t wire[80] = {0};
            memcpy(wire, f.data, f.len);
            for (unsigned len = 0; len <= 65; len++) {
                int ok = len > 0 && len == drv_can_padded(f.len); /* the answer to 'R' is too long */
                ck_assert_int_eq(drv_can_trim(wire, len, (int)up, &got),
                                 ok ? HDT_BUS_OK : HDT_BUS_ERR_FRAME);
                if (ok)
                    assert_same(&f, &got);
            }
        }
    }
    uint8_t unknown[8] = {0, 'X'};
    ck_assert_int_eq(drv_can_trim(unknown, 2, 1, &got), HDT_BUS_ERR_FRAME);
}
END_TEST

static int kernel_has_can(void)
{
    int fd = socket(29 /* AF_CAN */, SOCK_RAW, 1);
    if (fd >= 0)
        close(fd);
    return fd >= 0 || errno != EAFNOSUPPORT;
}

START_TEST(test_a_can_bus_that_is_not_there_says_what_to_do)
{
    struct hdt_bus b;
    char err[300] = "";
    int e = hdt_bus_open(&b, "can:hdt_none0", HDT_BUS_HOST, err, sizeof err);
    ck_assert_int_eq(e, HDT_BUS_ERR_DOWN);
    ck_assert_ptr_nonnull(strstr(err, "can:hdt_none0: "));
    ck_assert_ptr_nonnull(strstr(err, kernel_has_can() ? "no such interface"
                                                       : "no such sockets: load the modules can (AF_CAN)"));
}
END_TEST

/* ---- ARCNET ---------------------------------------------------------------------------------- */

START_TEST(test_arcnet_packets_have_the_bytes_of_the_chip)
{
    /* a short packet ends at byte 256 of the chip's page: offset 256 - n [mhipa10arc, if_arcnet.h] */
    static const uint8_t start[6] = {0xff, 0xfe, 0xfe, 0x00, 0x05, 'S'};
    struct hdt_frame f = {.len = 2, .data = {5, 'S'}}, got;
    uint8_t packet[DRV_ARCNET_HEAD + HDT_FRAME_MAX];
    ck_assert_uint_eq(drv_arcnet_pack(0xff, 0xfe, &f, packet), sizeof start);
    ck_assert_mem_eq(packet, start, sizeof start);
    for (unsigned len = 1; len <= HDT_FRAME_MAX; len++) {
        f = frame_of(len, len);
        ck_assert_uint_eq(drv_arcnet_pack(0xfe, 0xff, &f, packet), len + 4);
        ck_assert_uint_eq(packet[0], 0xfe);
        ck_assert_uint_eq(packet[1], 0xff);
        ck_assert_uint_eq(packet[2], 256 - len);
        ck_assert_int_eq(drv_arcnet_unpack(0xfe, 0xff, packet, len + 4, &got), 1);
        assert_same(&f, &got);
        /* another sender, another receiver, everybody: not ours; another offset: no packet */
        ck_assert_int_eq(drv_arcnet_unpack(0xfd, 0xff, packet, len + 4, &got), 0);
        ck_assert_int_eq(drv_arcnet_unpack(0xfe, 0xfe, packet, len + 4, &got), 0);
        packet[1] = 0;
        ck_assert_int_eq(drv_arcnet_unpack(0xfe, 0xff, packet, len + 4, &got), 0);
        packet[1] = 0xff;
        packet[2]++;
        ck_assert_int_eq(drv_arcnet_unpack(0xfe, 0xff, packet, len + 4, &got), HDT_BUS_ERR_FRAME);
    }
    uint8_t other[DRV_ARCNET_HEAD + 300] = {0xfe, 0xff, 0, 0};
    for (unsigned len = 0; len <= sizeof other; len++) {
        if (len > DRV_ARCNET_HEAD && len <= DRV_ARCNET_HEAD + HDT_FRAME_MAX)
            continue;
        /* nothing, or more than a short packet holds, be its offset ever so right */
        other[2] = (uint8_t)(256 - (len - DRV_ARCNET_HEAD));
        ck_assert_int_eq(drv_arcnet_unpack(0xfe, 0xff, other, len, &got), HDT_BUS_ERR_FRAME);
    }
}
END_TEST

/* ---- the bus that breaks -------------------------------------------------------------------- */

START_TEST(test_each_fault_does_what_its_name_says_at_its_call_only)
{
    for (int mode = 0; mode < BROKEN_BUS_MODES; mode++) {
        static struct drv_loop loop;
        struct hdt_bus host, servo, bad;
        struct broken_bus fault;
        struct broken_bus_cfg cfg = {.mode = (enum broken_bus_mode)mode, .nth = 3, .at = 12,
            .flip = 0x80};
        struct hdt_frame f = frame_of(10, 6), got;
        drv_loop_pair(&loop, &host, &servo);
        broken_bus_wrap(&fault, &cfg, &host, &bad);
        int e[4];
        for (int n = 0; n < 4; n++)
            e[n] = send_to(&bad, &f);
        for (int n = 0; n < 4; n++)
            if (n != 2)
                ck_assert_int_eq(e[n], HDT_BUS_OK);
        ck_assert_int_eq(e[2], mode == BROKEN_BUS_AGAIN  ? HDT_BUS_ERR_AGAIN
                               : mode == BROKEN_BUS_DOWN ? HDT_BUS_ERR_DOWN
                                                        : HDT_BUS_OK);
        unsigned same = 0, other = 0;
        while (recv_from(&servo, &got) == HDT_BUS_OK) {
            if (got.len == f.len && memcmp(got.data, f.data, f.len) == 0) {
                same++;
                continue;
            }
            other++;
            ck_assert_uint_eq(got.len, mode == BROKEN_BUS_TRUNCATE ? 2 : 10);
            ck_assert_uint_eq(got.data[1], f.data[1]);
            if (mode == BROKEN_BUS_CORRUPT)
                ck_assert_uint_eq(got.data[2], f.data[2] ^ 0x80u);
        }
        int damages = mode == BROKEN_BUS_CORRUPT || mode == BROKEN_BUS_TRUNCATE;
        ck_assert_uint_eq(same, mode == BROKEN_BUS_DUPLICATE ? 5 : 3);
        ck_assert_uint_eq(other, damages ? 1 : 0);
        ck_assert_uint_eq(fault.hits, 1);
        /* receiving: break the second receive */
        fault.cfg.nth = fault.called + 2;
        for (int n = 0; n < 3; n++)
            ck_assert_int_eq(send_to(&servo, &f), HDT_BUS_OK);
        unsigned good = 0, damaged = 0;
        for (int n = 0; n < 8; n++) {
            int r = recv_from(&bad, &got);
            if (n == 1 && mode <= BROKEN_BUS_DOWN)
                ck_assert_int_eq(r, mode == BROKEN_BUS_DOWN ? HDT_BUS_ERR_DOWN : HDT_BUS_ERR_AGAIN);
            if (r == HDT_BUS_OK) {
                int whole = got.len == f.len && memcmp(got.data, f.data, f.len) == 0;
                good += whole;
                damaged += !whole;
            }
        }
        ck_assert_uint_eq(damaged, damages ? 1 : 0);
        ck_assert_uint_eq(good, mode == BROKEN_BUS_DUPLICATE              ? 4
                                : damages || mode == BROKEN_BUS_DROP ? 2
                                                                    : 3);
        ck_assert_uint_eq(fault.hits, 2);
    }
}
END_TEST

static Suite *bus_suite(void)
{
    Suite *s = suite_create("bus");
    TCase *t = tcase_create("loop and names");
    tcase_add_test(t, test_loop_keeps_order_and_directions_apart);
    tcase_add_test(t, test_loop_refuses_frames_of_no_length_or_too_long);
    tcase_add_test(t, test_a_wrong_name_is_one_line_and_a_zeroed_bus);
    tcase_add_test(t, test_a_path_too_long_says_so);
    tcase_add_test(t, test_posix_clock_goes_forward_and_sleeps_until);
    suite_add_tcase(s, t);
    t = tcase_create("unix");
    tcase_set_timeout(t, 60);
    tcase_add_checked_fixture(t, in_own_directory, leave_directory);
    tcase_add_test(t, test_every_length_crosses_between_two_processes);
    tcase_add_test(t, test_host_outlives_a_servo_that_dies_and_comes_back);
    tcase_add_test(t, test_servo_outlives_its_hosts_one_after_the_other);
    tcase_add_test(t, test_writing_to_a_dead_peer_is_down_not_a_signal);
    tcase_add_test(t, test_a_full_queue_drops_the_newest_and_keeps_the_order);
    tcase_add_test(t, test_a_packet_too_long_is_refused_and_gone);
    tcase_add_test(t, test_nothing_but_a_stale_socket_is_ever_removed);
    tcase_add_test(t, test_closing_leaves_another_servos_socket_alone);
    suite_add_tcase(s, t);
    t = tcase_create("CAN and ARCNET mapping");
    tcase_add_test(t, test_can_padding_is_the_shortest_length_can_fd_has);
    tcase_add_test(t, test_can_trim_returns_the_telegram_or_refuses);
    tcase_add_test(t, test_a_can_bus_that_is_not_there_says_what_to_do);
    tcase_add_test(t, test_arcnet_packets_have_the_bytes_of_the_chip);
    suite_add_tcase(s, t);
    t = tcase_create("fault");
    tcase_add_test(t, test_each_fault_does_what_its_name_says_at_its_call_only);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(bus_suite())
