/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Backends on network interfaces of the kernel: CAN FD and ISO-TP on vcan, bus off on a controller
 * whose serial line (slcan) this test is at the other end of, ARCNET on a tun interface of that kind
 * whose card this test is.
 *
 * What the kernel at hand lacks is skipped; tools/check-vm runs this where nothing is lacking.
 *   HDT_CAN=can:vcan0          a vcan set up for CAN FD
 *   HDT_CAN_CLASSICAL=vcan1    one that is not
 *   HDT_CAN_BREAK=vcan2        a third, for CAN FD, that may be set down
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include "driver/drv_backend.h"
#include "driver/drv_telegram.h"
#include "tests/bus_frames.h"
#include "tests/check_main.h"
#include "tests/example_command.h"

/* Send, waiting at most 5 s for a place in the queue. */
static int send_wait(const struct hdt_bus *b, const struct hdt_frame *f)
{
    int e = send_to(b, f);
    for (int n = 0; e == HDT_BUS_ERR_AGAIN && n < 5000; n++) {
        usleep(1000);
        e = send_to(b, f);
    }
    return e;
}

static struct hdt_bus_health health_of(const struct hdt_bus *b)
{
    struct hdt_bus_health h;
    hdt_bus_get_health(b, &h);
    return h;
}

/* 0, or why there is no such bus. */
static int open_both(const char *bus, struct hdt_bus *host, struct hdt_bus *servo, char *err, size_t errlen)
{
    if (hdt_bus_open(servo, bus, HDT_BUS_SERVO, err, errlen) != HDT_BUS_OK)
        return -1;
    ck_assert_int_eq(hdt_bus_open(host, bus, HDT_BUS_HOST, err, errlen), HDT_BUS_OK);
    return 0;
}

static void close_both(struct hdt_bus *host, struct hdt_bus *servo)
{
    hdt_bus_close(host);
    hdt_bus_close(servo);
}

static void set_up(const char *iface, int up)
{
    struct ifreq r;
    int fd = socket(AF_UNIX, SOCK_DGRAM, 0);
    memset(&r, 0, sizeof r);
    strcpy(r.ifr_name, iface);
    ck_assert_int_eq(ioctl(fd, SIOCGIFFLAGS, &r), 0);
    r.ifr_flags = (short)(up ? r.ifr_flags | IFF_UP : r.ifr_flags & ~IFF_UP);
    ck_assert_int_eq(ioctl(fd, SIOCSIFFLAGS, &r), 0);
    close(fd);
}

/* ---- CAN FD --------------------------------------------------------------------------------- */

static const char *can_bus(void)
{
    return getenv("HDT_CAN") ? getenv("HDT_CAN") : "can:vcan0";
}

START_TEST(test_telegrams_cross_a_real_vcan)
{
    struct hdt_bus host, servo;
    struct hdt_frame f, got;
    char err[300] = "";
    struct hdt_clock clock = hdt_clock_posix();
    if (open_both(can_bus(), &host, &servo, err, sizeof err) != 0)
        HDT_SKIP(err);
    struct drv_command c = {.type = DRV_CYCLIC};
    struct drv_state s = {.type = DRV_CYCLIC};
    for (unsigned n = 0; n < 200; n++) {
        c.type = s.type = "SCTE"[n % 4];
        c.seq = s.seq = (uint8_t)n;
        c.axis[6].speed_dig = (int16_t)(n * 31);
        s.axis[6].count = (int32_t)n * -1000;
        s.driver_status = (uint16_t)n;
        ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &c, &f), 0);
        uint64_t before_ns = clock.now_ns(NULL);
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK);
        uint64_t sent_ns = clock.now_ns(NULL);
        if (n % 10 == 0)
            usleep(3000); /* the stamp is of the arrival, not of the reading */
        ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
        assert_same(&f, &got);
        uint64_t at_ns = health_of(&servo).received_ns;
        ck_assert_uint_ge(at_ns + 20000, before_ns); /* two clocks read one after the other */
        ck_assert_uint_le(at_ns, sent_ns + (n % 10 == 0 ? 2000000u : 20000000u));
        ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_AGAIN); /* not our own */
        ck_assert_int_eq(drv_state_encode(DRV_FORMAT_A, &s, &f), 0);
        ck_assert_int_eq(send_to(&servo, &f), HDT_BUS_OK);
        ck_assert_int_eq(recv_wait(&host, &got), HDT_BUS_OK);
        assert_same(&f, &got);
    }
    f.len = 65;
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_FRAME);
    struct hdt_bus_health h = health_of(&host);
    ck_assert_int_eq(h.line, HDT_LINE_ACTIVE);
    ck_assert_uint_eq(h.sent, 200);
    ck_assert_uint_eq(h.received, 200);
    ck_assert_uint_eq(h.foreign + h.full + h.offs + h.overruns, 0);
    close_both(&host, &servo);
}
END_TEST

/* A raw socket as another node, or as the controller when it sends error frames. */
static int raw_socket(const char *iface)
{
    int fd = socket(AF_CAN, SOCK_RAW, CAN_RAW), on = 1;
    struct sockaddr_can a = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(iface)};
    ck_assert_int_eq(setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on), 0);
    ck_assert_int_eq(bind(fd, (struct sockaddr *)&a, sizeof a), 0);
    return fd;
}

static void raw_send(int fd, canid_t id, unsigned len, unsigned second)
{
    struct can_frame c = {.can_id = id, .can_dlc = (uint8_t)len};
    c.data[1] = (uint8_t)second;
    ck_assert_int_eq(write(fd, &c, sizeof c), (int)sizeof c);
}

START_TEST(test_only_frames_of_this_identifier_and_kind_are_telegrams)
{
    struct hdt_bus host, servo;
    struct hdt_frame got;
    char err[300] = "";
    if (open_both(can_bus(), &host, &servo, err, sizeof err) != 0)
        HDT_SKIP(err);
    int other = raw_socket(strchr(can_bus(), ':') + 1);
    struct canfd_frame wrong = {.can_id = DRV_CAN_ID_TO_SERVO, .len = 12, .data = {1, 'S'}};
    raw_send(other, DRV_CAN_ID_TO_HOST + 1, 8, 'S');           /* another identifier */
    raw_send(other, DRV_CAN_ID_TO_SERVO | CAN_EFF_FLAG, 2, 'S'); /* 29 bits */
    raw_send(other, DRV_CAN_ID_TO_SERVO | CAN_RTR_FLAG, 2, 'S'); /* remote request */
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_AGAIN);
    raw_send(other, DRV_CAN_ID_TO_SERVO, 2, 'S');              /* a classical frame */
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_FRAME);
    ck_assert_int_eq(write(other, &wrong, sizeof wrong), (int)sizeof wrong); /* too long for its type */
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_FRAME);
    ck_assert_uint_eq(health_of(&servo).received_ns, 0); /* none of these was a telegram's time */
    wrong.len = 2;
    ck_assert_int_eq(write(other, &wrong, sizeof wrong), (int)sizeof wrong);
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_OK);
    ck_assert_uint_gt(health_of(&servo).received_ns, 0);
    ck_assert_uint_eq(health_of(&servo).foreign, 2);
    close(other);
    close_both(&host, &servo);
}
END_TEST

START_TEST(test_error_frames_become_the_state_of_the_line)
{
    static const struct { canid_t id; unsigned second; enum hdt_line line; int result; } at[] = {
        {CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING, HDT_LINE_WARNING, HDT_BUS_ERR_AGAIN},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE, HDT_LINE_PASSIVE, HDT_BUS_ERR_AGAIN},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_RX_WARNING, HDT_LINE_WARNING, HDT_BUS_ERR_AGAIN},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE, HDT_LINE_ACTIVE, HDT_BUS_ERR_AGAIN},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE, HDT_LINE_PASSIVE, HDT_BUS_ERR_AGAIN},
        {CAN_ERR_BUSOFF, 0, HDT_LINE_OFF, HDT_BUS_ERR_DOWN},
        {CAN_ERR_RESTARTED, 0, HDT_LINE_ACTIVE, HDT_BUS_ERR_AGAIN},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW, HDT_LINE_ACTIVE, HDT_BUS_ERR_AGAIN},
    };
    const char *iface = strchr(can_bus(), ':') + 1;
    char err[300] = "", isotp[40];
    snprintf(isotp, sizeof isotp, "isotp:%s", iface);
    for (int kind = 0; kind < 2; kind++) {
        struct hdt_bus host, servo;
        struct hdt_frame got, f = frame_of(2, 1);
        f.data[1] = 'S';
        if (open_both(kind ? isotp : can_bus(), &host, &servo, err, sizeof err) != 0)
            HDT_SKIP(err);
        int controller = raw_socket(iface);
        for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
            raw_send(controller, CAN_ERR_FLAG | at[k].id, 8, at[k].second);
            int e = recv_from(&host, &got);
            /* where errors have a socket of their own, the carrier, which
             * a vcan never loses, is seen at once */
            if (at[k].line == HDT_LINE_OFF && kind == 1) {
                ck_assert_uint_eq(health_of(&host).offs, 1);
                continue;
            }
            ck_assert_int_eq(e, at[k].result);
            ck_assert_int_eq(health_of(&host).line, at[k].line);
        }
        struct hdt_bus_health h = health_of(&host);
        ck_assert_uint_eq(h.offs, 1);
        ck_assert_uint_eq(h.restarts, 1);
        ck_assert_uint_eq(h.overruns, 1);
        ck_assert_uint_eq(h.foreign, 0);
        /* an error frame does not hide the telegram behind it */
        raw_send(controller, CAN_ERR_FLAG | CAN_ERR_CRTL, 8, CAN_ERR_CRTL_TX_WARNING);
        ck_assert_int_eq(send_to(&servo, &f), HDT_BUS_OK);
        ck_assert_int_eq(recv_wait(&host, &got), HDT_BUS_OK);
        assert_same(&f, &got);
        close(controller);
        close_both(&host, &servo);
    }
}
END_TEST

START_TEST(test_an_interface_that_goes_down_is_down_until_it_is_back)
{
    const char *iface = getenv("HDT_CAN_BREAK");
    char err[300] = "", bus[2][40];
    if (iface == NULL)
        HDT_SKIP("HDT_CAN_BREAK is not set to a vcan that may be set down");
    snprintf(bus[0], sizeof bus[0], "can:%s", iface);
    snprintf(bus[1], sizeof bus[1], "isotp:%s", iface);
    for (int kind = 0; kind < 2; kind++) {
        struct hdt_bus host, servo;
        struct hdt_frame got, f = frame_of(2, 1);
        f.data[1] = 'E';
        ck_assert_msg(open_both(bus[kind], &host, &servo, err, sizeof err) == 0, "%s", err);
        for (unsigned life = 1; life <= 3; life++) {
            set_up(iface, 0);
            ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_DOWN);
            ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_DOWN);
            ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_DOWN);
            ck_assert_int_eq(health_of(&host).line, HDT_LINE_OFF);
            set_up(iface, 1);
            ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_AGAIN);
            (void)recv_from(&servo, &got); /* what the other side was told meanwhile */
            ck_assert_int_eq(send_wait(&host, &f), HDT_BUS_OK);
            ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
            assert_same(&f, &got);
            ck_assert_uint_eq(health_of(&host).offs, life);
            ck_assert_uint_eq(health_of(&host).restarts, life);
        }
        close_both(&host, &servo);
        set_up(iface, 0);
        ck_assert_int_eq(hdt_bus_open(&host, bus[kind], HDT_BUS_HOST, err, sizeof err), HDT_BUS_ERR_DOWN);
        ck_assert_ptr_nonnull(strstr(err, "interface is down: ip link set"));
        set_up(iface, 1);
    }
}
END_TEST

/* ---- ISO-TP --------------------------------------------------------------------------------- */

START_TEST(test_every_length_crosses_by_isotp_on_both_kinds_of_interface)
{
    const char *classical = getenv("HDT_CAN_CLASSICAL") ? getenv("HDT_CAN_CLASSICAL") : "vcan1";
    char err[300] = "", name[2][40];
    snprintf(name[0], sizeof name[0], "can:%s", classical); /* by itself: the interface is classical */
    snprintf(name[1], sizeof name[1], "isotp:%s", strchr(can_bus(), ':') + 1);
    for (int kind = 0; kind < 2; kind++) {
        struct hdt_bus host, servo;
        struct hdt_frame f, got;
        if (open_both(name[kind], &host, &servo, err, sizeof err) != 0)
            HDT_SKIP(err);
        for (unsigned len = 1; len <= HDT_FRAME_MAX; len++) {
            f = frame_of(len, len);
            ck_assert_int_eq(send_wait(&host, &f), HDT_BUS_OK);
            ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
            assert_same(&f, &got);
            f = frame_of(HDT_FRAME_MAX + 1 - len, len + 1000);
            ck_assert_int_eq(send_wait(&servo, &f), HDT_BUS_OK);
            ck_assert_int_eq(recv_wait(&host, &got), HDT_BUS_OK);
            assert_same(&f, &got);
            ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_AGAIN); /* not its own */
        }
        ck_assert_uint_gt(health_of(&host).received_ns, 0);
        f.len = 0;
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_FRAME);
        f.len = HDT_FRAME_MAX + 1;
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_FRAME);
        close_both(&host, &servo);
    }
}
END_TEST

START_TEST(test_isotp_is_cut_on_the_wire_as_the_format_document_shows)
{
    /* the sequence-42 command of docs/formats.md, section CAN mapping */
    static const struct { canid_t id; uint8_t len, data[8]; } want[] = {
        {0x1fe, 8, {0x10, 0x25, 0x2a, 0x43, 0x06, 0xe8, 0x03, 0x00}}, {0x1ff, 3, {0x30, 0x04, 0x00}},
        {0x1fe, 8, {0x21, 0x00, 0x06, 0xff, 0xff, 0x00, 0x00, 0x01}},
        {0x1fe, 8, {0x22, 0x00, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00}},
        {0x1fe, 8, {0x23, 0x78, 0xec, 0x01, 0x00, 0x00, 0x00, 0x00}},
        {0x1fe, 8, {0x24, 0x01, 0x00, 0x00, 0x00, 0x00, 0x09, 0x00}},
        {0x1ff, 3, {0x30, 0x04, 0x00}}, {0x1fe, 4, {0x25, 0x80, 0xff, 0x7f}},
    };
    const char *classical = getenv("HDT_CAN_CLASSICAL") ? getenv("HDT_CAN_CLASSICAL") : "vcan1";
    struct drv_command c = example_command();
    struct hdt_bus host, servo;
    struct hdt_frame f, got;
    char err[300] = "", name[40];
    snprintf(name, sizeof name, "can:%s", classical);
    if (open_both(name, &host, &servo, err, sizeof err) != 0)
        HDT_SKIP(err);
    int tap = raw_socket(classical);
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &c, &f), 0);
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    assert_same(&f, &got);
    for (size_t k = 0; k < sizeof want / sizeof want[0]; k++) {
        struct can_frame seen;
        ck_assert_int_eq(read(tap, &seen, sizeof seen), (int)sizeof seen);
        ck_assert_uint_eq(seen.can_id, want[k].id);
        ck_assert_uint_eq(seen.can_dlc, want[k].len);
        ck_assert_mem_eq(seen.data, want[k].data, want[k].len);
    }
    close(tap);
    close_both(&host, &servo);
}
END_TEST

START_TEST(test_isotp_without_a_peer_is_full_then_down_then_works)
{
    const char *classical = getenv("HDT_CAN_CLASSICAL") ? getenv("HDT_CAN_CLASSICAL") : "vcan1";
    char err[300] = "", name[40];
    struct hdt_bus host, servo;
    struct hdt_frame f = frame_of(37, 1), got;
    snprintf(name, sizeof name, "can:%s", classical);
    if (open_both(name, &host, &servo, err, sizeof err) != 0)
        HDT_SKIP(err);
    hdt_bus_close(&servo);
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK); /* its first segment waits for a go-ahead, */
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_AGAIN); /* and what comes after it has no place */
    ck_assert_uint_eq(health_of(&host).full, 1);
    ck_assert_int_eq(recv_wait(&host, &got), HDT_BUS_ERR_DOWN); /* after the kernel's second */
    ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_AGAIN);
    ck_assert_int_eq(hdt_bus_open(&servo, name, HDT_BUS_SERVO, err, sizeof err), HDT_BUS_OK);
    ck_assert_int_eq(send_wait(&host, &f), HDT_BUS_OK);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    assert_same(&f, &got);
    close_both(&host, &servo);
}
END_TEST

/* ---- a controller on a serial line ------------------------------------------------------------- */

/* The kernel's slcan on a terminal whose other end, the adapter, is ours.  Returns that end, or -1. */
static int slcan_controller(char *iface)
{
    int ldisc = 17 /* N_SLCAN */;
    struct termios raw;
    int adapter = posix_openpt(O_RDWR | O_NOCTTY);
    if (adapter < 0 || grantpt(adapter) < 0 || unlockpt(adapter) < 0)
        return -1;
    int line = open(ptsname(adapter), O_RDWR | O_NOCTTY);
    ck_assert_int_ge(line, 0);
    ck_assert_int_eq(tcgetattr(line, &raw), 0);
    cfmakeraw(&raw);
    ck_assert_int_eq(tcsetattr(line, TCSANOW, &raw), 0);
    if (ioctl(line, TIOCSETD, &ldisc) < 0) {
        close(line);
        close(adapter);
        return -1;
    }
    ck_assert_int_ge(ioctl(line, SIOCGIFNAME, iface), 0); /* `line` stays open: the interface lives on it */
    set_up(iface, 1);
    return adapter;
}

static void adapter_says(int adapter, const char *line)
{
    ck_assert_int_eq(write(adapter, line, strlen(line)), (int)strlen(line));
    usleep(100000); /* through the terminal's work queue */
}

START_TEST(test_bus_off_of_a_controller_is_down_until_it_restarts)
{
    char iface[IFNAMSIZ] = "", err[300] = "", name[40];
    struct hdt_bus host;
    struct hdt_frame f = frame_of(7, 1), got;
    int adapter = slcan_controller(iface);
    if (adapter < 0)
        HDT_SKIP("no slcan in this kernel");
    snprintf(name, sizeof name, "can:%s", iface);
    ck_assert_msg(hdt_bus_open(&host, name, HDT_BUS_HOST, err, sizeof err) == HDT_BUS_OK, "%s", err);
    adapter_says(adapter, "sw100097\r");
    ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_AGAIN);
    ck_assert_int_eq(health_of(&host).line, HDT_LINE_WARNING);
    adapter_says(adapter, "sp100140\r");
    ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_AGAIN);
    ck_assert_int_eq(health_of(&host).line, HDT_LINE_PASSIVE);
    ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK); /* passive still sends */
    for (unsigned life = 1; life <= 2; life++) {
        adapter_says(adapter, "sb000256\r");
        ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_DOWN);
        ck_assert_int_eq(recv_from(&host, &got), HDT_BUS_ERR_DOWN);
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_ERR_DOWN);
        ck_assert_int_eq(health_of(&host).line, HDT_LINE_OFF);
        ck_assert_uint_eq(health_of(&host).offs, life);
        /* slcan has no restart: down and up starts the controller anew */
        set_up(iface, 0);
        set_up(iface, 1);
        (void)recv_from(&host, &got); /* that it was down meanwhile */
        adapter_says(adapter, "t1ff20161\r"); /* one byte, 61, by ISO-TP */
        ck_assert_int_eq(recv_wait(&host, &got), HDT_BUS_OK);
        ck_assert_uint_eq(got.len, 1);
        ck_assert_uint_eq(got.data[0], 0x61);
        ck_assert_uint_eq(health_of(&host).restarts, life);
        ck_assert_int_eq(health_of(&host).line, HDT_LINE_ACTIVE);
    }
    hdt_bus_close(&host);
    close(adapter);
}
END_TEST

START_TEST(test_a_controller_that_does_not_send_is_a_full_queue)
{
    char iface[IFNAMSIZ] = "", err[300] = "", name[40];
    struct hdt_bus host;
    struct hdt_frame f = frame_of(7, 1);
    int adapter = slcan_controller(iface), e = HDT_BUS_OK, sent = 0;
    if (adapter < 0)
        HDT_SKIP("no slcan in this kernel");
    snprintf(name, sizeof name, "can:%s", iface);
    ck_assert_msg(hdt_bus_open(&host, name, HDT_BUS_HOST, err, sizeof err) == HDT_BUS_OK, "%s", err);
    /* nobody reads the line: its buffer fills, then the queue; 700 a second */
    for (; sent < 20000 && e == HDT_BUS_OK; sent++)
        e = send_to(&host, &f);
    ck_assert_int_eq(e, HDT_BUS_ERR_AGAIN);
    ck_assert_uint_ge(health_of(&host).full, 1);
    ck_assert_int_eq(health_of(&host).line, HDT_LINE_ACTIVE);
    hdt_bus_close(&host);
    close(adapter);
}
END_TEST

/* ---- ARCNET --------------------------------------------------------------------------------- */

enum { KIND_ARCNET = 7, TUN_HEAD = 4 };

/* An interface of the kind ARCNET has, in a network of our own; we are its card.  Returns -1 if there
 * is no tun. */
static int arcnet_card(const char *iface)
{
    struct ifreq r;
    int fd = open("/dev/net/tun", O_RDWR | O_NONBLOCK);
    if (fd < 0)
        return -1;
    memset(&r, 0, sizeof r);
    strcpy(r.ifr_name, iface);
    r.ifr_flags = IFF_TUN;
    if (ioctl(fd, TUNSETIFF, &r) < 0 || ioctl(fd, TUNSETLINK, KIND_ARCNET) < 0) {
        close(fd);
        return -1;
    }
    set_up(iface, 1);
    return fd;
}

/* What the host gave to its card, or the card gives to its host, with the kernel's four bytes before. */
static int card_takes(int card, uint8_t *packet, size_t room)
{
    uint8_t buf[400];
    for (int n = 0; n < 500; n++) {
        struct pollfd p = {.fd = card, .events = POLLIN};
        poll(&p, 1, 10);
        ssize_t got = read(card, buf, sizeof buf);
        if (got < TUN_HEAD)
            continue;
        if (buf[2] != 0x00 || buf[3] != 0x1a) /* the kernel's own IPv6 chatter */
            continue;
        ck_assert_uint_le((size_t)got - TUN_HEAD, room);
        memcpy(packet, buf + TUN_HEAD, (size_t)got - TUN_HEAD);
        return (int)got - TUN_HEAD;
    }
    return -1;
}

static void card_gives(int card, const uint8_t *packet, size_t len)
{
    uint8_t buf[400] = {0, 0, 0x00, 0x1a};
    memcpy(buf + TUN_HEAD, packet, len);
    ck_assert_int_eq(write(card, buf, TUN_HEAD + len), (int)(TUN_HEAD + len));
}

/* Everything on the interface, by a socket of its own, as a capture has it. */
static int capture(const char *iface)
{
    int fd = socket(AF_PACKET, SOCK_RAW | SOCK_NONBLOCK, htons(0x0003 /* ETH_P_ALL */));
    ck_assert_int_ge(fd, 0);
    ck_assert_int_eq(setsockopt(fd, SOL_SOCKET, SO_BINDTODEVICE, iface, (socklen_t)strlen(iface) + 1), 0);
    return fd;
}

#define ARCNET_OR_SKIP(card, iface)                                                       \
    if (unshare(CLONE_NEWNET) != 0)                                                       \
        HDT_SKIP("no network namespace of our own: run as root");                         \
    int card = arcnet_card(iface);                                                        \
    if (card < 0)                                                                         \
        HDT_SKIP("no /dev/net/tun, or not permitted")

START_TEST(test_arcnet_packets_on_the_interface_are_those_of_the_driver)
{
    struct hdt_bus host;
    struct hdt_frame f, got;
    char err[300] = "";
    uint8_t packet[400], seen[400];
    ARCNET_OR_SKIP(card, "arc0");
    ck_assert_msg(hdt_bus_open(&host, "arcnet:arc0", HDT_BUS_HOST, err, sizeof err) == HDT_BUS_OK, "%s", err);
    int tap = capture("arc0");
    for (unsigned len = 1; len <= HDT_FRAME_MAX; len++) {
        f = frame_of(len, len);
        ck_assert_int_eq(send_to(&host, &f), HDT_BUS_OK);
        int n = card_takes(card, packet, sizeof packet);
        ck_assert_int_eq(n, (int)len + 4);
        /* host 255 to servo 254; offset 256 - n; then the telegram as it is */
        uint8_t head[4] = {0xff, 0xfe, (uint8_t)(256 - len), 0};
        ck_assert_mem_eq(packet, head, 4);
        ck_assert_mem_eq(packet + 4, f.data, len);
        ssize_t caught;
        do
            caught = recv(tap, seen, sizeof seen, 0);
        while (caught > 0 && caught != n); /* the kernel's chatter */
        ck_assert_int_eq(caught, n);
        ck_assert_mem_eq(seen, packet, (size_t)n);
        /* and back from the servo driver */
        uint8_t up[4] = {0xfe, 0xff, (uint8_t)(256 - len), 0};
        memcpy(packet, up, 4);
        card_gives(card, packet, (size_t)n);
        ck_assert_int_eq(recv_wait(&host, &got), HDT_BUS_OK);
        assert_same(&f, &got);
    }
    struct hdt_bus_health h = health_of(&host);
    ck_assert_uint_eq(h.sent, HDT_FRAME_MAX);
    ck_assert_uint_eq(h.received, HDT_FRAME_MAX);
    ck_assert_uint_gt(h.received_ns, 0);
    close(tap);
    hdt_bus_close(&host);
    close(card);
}
END_TEST

START_TEST(test_arcnet_of_other_nodes_is_not_ours)
{
    struct hdt_bus servo;
    struct hdt_frame got;
    char err[300] = "";
    static const uint8_t others[][6] = {{0x07, 0xfe, 0xfe, 0, 1, 'S'},
                                        {0xff, 0x07, 0xfe, 0, 1, 'S'},
                                        {0xff, 0x00, 0xfe, 0, 1, 'S'}};
    static const uint8_t wrong[6] = {0xff, 0xfe, 0xfd, 0, 1, 'S'}, ours[6] = {0xff, 0xfe, 0xfe, 0, 1, 'S'};
    ARCNET_OR_SKIP(card, "arc0");
    ck_assert_msg(hdt_bus_open(&servo, "arcnet:arc0", HDT_BUS_SERVO, err, sizeof err) == HDT_BUS_OK, "%s",
                  err);
    for (int k = 0; k < 3; k++)
        card_gives(card, others[k], 6);
    card_gives(card, ours, 6);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    ck_assert_uint_eq(got.len, 2);
    ck_assert_uint_eq(health_of(&servo).foreign, 3);
    const uint64_t came_ns = health_of(&servo).received_ns;
    usleep(2000);
    card_gives(card, wrong, 6);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_ERR_FRAME);
    ck_assert_uint_eq(health_of(&servo).received_ns, came_ns); /* a telegram's time, and this was none */
    /* down and up again */
    set_up("arc0", 0);
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_DOWN);
    ck_assert_int_eq(send_to(&servo, &got), HDT_BUS_ERR_FRAME); /* 0x7777 bytes: no frame in any state */
    got.len = 2;
    ck_assert_int_eq(send_to(&servo, &got), HDT_BUS_ERR_DOWN);
    set_up("arc0", 1);
    ck_assert_int_eq(recv_from(&servo, &got), HDT_BUS_ERR_AGAIN);
    card_gives(card, ours, 6);
    ck_assert_int_eq(recv_wait(&servo, &got), HDT_BUS_OK);
    ck_assert_uint_eq(health_of(&servo).offs, 1);
    ck_assert_uint_eq(health_of(&servo).restarts, 1);
    hdt_bus_close(&servo);
    /* an interface of another kind */
    ck_assert_int_eq(hdt_bus_open(&servo, "arcnet:lo", HDT_BUS_SERVO, err, sizeof err), HDT_BUS_ERR_DOWN);
    ck_assert_ptr_nonnull(strstr(err, "expected 7"));
    close(card);
}
END_TEST

static Suite *net_suite(void)
{
    Suite *s = suite_create("net");
    TCase *t = tcase_create("CAN FD");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_telegrams_cross_a_real_vcan);
    tcase_add_test(t, test_only_frames_of_this_identifier_and_kind_are_telegrams);
    tcase_add_test(t, test_error_frames_become_the_state_of_the_line);
    tcase_add_test(t, test_an_interface_that_goes_down_is_down_until_it_is_back);
    suite_add_tcase(s, t);
    t = tcase_create("ISO-TP");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_every_length_crosses_by_isotp_on_both_kinds_of_interface);
    tcase_add_test(t, test_isotp_is_cut_on_the_wire_as_the_format_document_shows);
    tcase_add_test(t, test_isotp_without_a_peer_is_full_then_down_then_works);
    tcase_add_test(t, test_bus_off_of_a_controller_is_down_until_it_restarts);
    tcase_add_test(t, test_a_controller_that_does_not_send_is_a_full_queue);
    suite_add_tcase(s, t);
    t = tcase_create("ARCNET");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_arcnet_packets_on_the_interface_are_those_of_the_driver);
    tcase_add_test(t, test_arcnet_of_other_nodes_is_not_ours);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(net_suite())
