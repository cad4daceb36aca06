// SPDX-License-Identifier: Apache-2.0
// See hdt_bus_rate.hpp.
#include "tools/hdt_bus_rate.hpp"

#ifdef __linux__

#include <cstring>
#include <linux/can/netlink.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>
#include <vector>

namespace hdt::cli {

namespace {

// The attribute of this type among `room` bytes of them; nullptr when it is not there.
const rtattr *find(const void *from, std::size_t room, unsigned short type)
{
    const char *at = static_cast<const char *>(from);
    while (room >= sizeof(rtattr)) {
        rtattr head;
        std::memcpy(&head, at, sizeof head);
        if (head.rta_len < sizeof head || head.rta_len > room)
            return nullptr;
        if ((head.rta_type & NLA_TYPE_MASK) == type)
            return reinterpret_cast<const rtattr *>(at);
        std::size_t step = RTA_ALIGN(head.rta_len);
        if (step > room)
            return nullptr;
        at += step;
        room -= step;
    }
    return nullptr;
}

const rtattr *find_in(const rtattr *outer, unsigned short type)
{
    return outer == nullptr ? nullptr : find(RTA_DATA(outer), outer->rta_len - RTA_LENGTH(0), type);
}

unsigned bitrate(const rtattr *timing)
{
    can_bittiming t = {};
    if (timing == nullptr || timing->rta_len < RTA_LENGTH(sizeof t))
        return 0;
    std::memcpy(&t, RTA_DATA(timing), sizeof t);
    return t.bitrate;
}

// The kernel's whole answer about one interface, or nothing.
std::vector<char> ask(int fd, unsigned index)
{
    struct { nlmsghdr head; ifinfomsg what; } question = {};
    question.head.nlmsg_len = sizeof question;
    question.head.nlmsg_type = RTM_GETLINK;
    question.head.nlmsg_flags = NLM_F_REQUEST;
    question.what.ifi_index = static_cast<int>(index);
    std::vector<char> answer(32768);
    if (send(fd, &question, sizeof question, 0) < 0)
        return {};
    ssize_t got = recv(fd, answer.data(), answer.size(), 0);
    answer.resize(got < 0 ? 0 : static_cast<std::size_t>(got));
    return answer;
}

} // namespace

CanRates can_rates(const std::string &iface)
{
    CanRates rates;
    unsigned index = if_nametoindex(iface.c_str());
    int fd = index == 0 ? -1 : socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
    if (fd < 0)
        return rates;
    std::vector<char> answer = ask(fd, index);
    close(fd);
    constexpr std::size_t head = NLMSG_LENGTH(sizeof(ifinfomsg));
    nlmsghdr message;
    if (answer.size() < head)
        return rates;
    std::memcpy(&message, answer.data(), sizeof message);
    if (message.nlmsg_type != RTM_NEWLINK || message.nlmsg_len > answer.size())
        return rates;
    const rtattr *info = find(answer.data() + NLMSG_ALIGN(head), message.nlmsg_len - NLMSG_ALIGN(head),
                              IFLA_LINKINFO);
    const rtattr *kind = find_in(info, IFLA_INFO_KIND), *data = find_in(info, IFLA_INFO_DATA);
    // other kinds number their data otherwise
    if (kind == nullptr || std::strncmp(static_cast<const char *>(RTA_DATA(kind)), "can", 4) != 0)
        return rates;
    rates.nominal_bps = bitrate(find_in(data, IFLA_CAN_BITTIMING));
    const rtattr *mode = find_in(data, IFLA_CAN_CTRLMODE);
    can_ctrlmode flags = {};
    if (mode != nullptr && mode->rta_len >= RTA_LENGTH(sizeof flags))
        std::memcpy(&flags, RTA_DATA(mode), sizeof flags);
    if ((flags.flags & CAN_CTRLMODE_FD) != 0)
        rates.data_bps = bitrate(find_in(data, IFLA_CAN_DATA_BITTIMING));
    return rates;
}

} // namespace hdt::cli

#else

namespace hdt::cli {

CanRates can_rates(const std::string &)
{
    return {};
}

} // namespace hdt::cli

#endif
