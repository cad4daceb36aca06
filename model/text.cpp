// SPDX-License-Identifier: Apache-2.0
//
// Tables of numbers as text: whole files, lines, fields, numbers; how bad bytes are shown and markup
// is escaped.
//
// Owns: what readers and writers of text share.
// Never: knows a column's meaning.
#include "model/text.hpp"

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include "model/arm_file.hpp"

namespace hdt {

std::string read_text(const std::string &path)
{
    struct Close { void operator()(std::FILE *f) const { std::fclose(f); } };
    std::unique_ptr<std::FILE, Close> file(std::fopen(path.c_str(), "rb"));
    if (!file)
        throw InputError(path + ": cannot be read: " + std::strerror(errno));
    std::string text;
    std::vector<char> chunk(1u << 18);
    for (;;) {
        errno = 0;
        const std::size_t n = std::fread(chunk.data(), 1, chunk.size(), file.get());
        // also what keeps an endless device from being read for ever
        if (n >= 4 && text.empty() && std::memcmp(chunk.data(), "\xed\xa1\xda\x01", 4) == 0)
            throw InputError(path + ": expected a text file, found an LCM event log; hdt log convert " +
                             path + " " + path.substr(0, path.rfind(".lcm")) + ".csv makes a CSV log of it");
        if (std::memchr(chunk.data(), 0, n))
            throw InputError(path + ": expected a text file, found a zero byte");
        text.append(chunk.data(), n);
        if (n < chunk.size())
            break;
    }
    if (std::ferror(file.get()))
        throw InputError(path + ": cannot be read: " + std::strerror(errno));
    if (text.compare(0, 3, "\xef\xbb\xbf") == 0)
        text.erase(0, 3);
    return text;
}

bool LineReader::next(std::string_view &line)
{
    if (rest_.empty())
        return false;
    const std::size_t end = rest_.find('\n');
    ended_ = end != std::string_view::npos;
    line = rest_.substr(0, end);
    rest_.remove_prefix(ended_ ? end + 1 : rest_.size());
    if (!line.empty() && line.back() == '\r')
        line.remove_suffix(1);
    ++number_;
    return true;
}

std::string_view trim(std::string_view s)
{
    while (!s.empty() && (s.front() == ' ' || s.front() == '\t'))
        s.remove_prefix(1);
    while (!s.empty() && (s.back() == ' ' || s.back() == '\t'))
        s.remove_suffix(1);
    return s;
}

void split(std::string_view line, char separator, std::vector<std::string_view> &fields)
{
    fields.clear();
    if (separator == ' ') {
        for (line = trim(line); !line.empty(); line = trim(line)) {
            const std::size_t end = line.find_first_of(" \t");
            fields.push_back(line.substr(0, end));
            line.remove_prefix(end == std::string_view::npos ? line.size() : end);
        }
        return;
    }
    for (;;) {
        const std::size_t end = line.find(separator);
        fields.push_back(trim(line.substr(0, end)));
        if (end == std::string_view::npos)
            return;
        line.remove_prefix(end + 1);
    }
}

bool parse_number(std::string_view text, double &value)
{
    // from_chars takes no plus sign; "+-1" stays refused
    if (text.size() > 1 && text[0] == '+' && text[1] != '-')
        text.remove_prefix(1);
    const char *end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    return error == std::errc() && stop == end && std::isfinite(value);
}

void append_number(std::string &out, double value)
{
    char digits[32];
    const auto result = std::to_chars(digits, digits + sizeof digits, value);
    out.append(digits, result.ptr);
}

std::string number17(double value)
{
    char digits[40];
    std::snprintf(digits, sizeof digits, "%.17g", value == 0 ? 0 : value);
    return digits;
}

std::string number3(double value)
{
    return filled("%.3g", value);
}

std::string filled(const char *format, double a, double b, double c)
{
    char sentence[256];
    std::snprintf(sentence, sizeof sentence, format, a, b, c);
    return sentence;
}

std::string hex(const unsigned char *bytes, std::size_t count)
{
    std::string out;
    char two[3];
    for (std::size_t i = 0; i < count; i++) {
        std::snprintf(two, sizeof two, "%02x", bytes[i]);
        out += two;
    }
    return out;
}

std::string markup_escaped(std::string_view text)
{
    std::string out;
    for (const char c : text)
        switch (c) {
        case '&': out += "&amp;"; break;
        case '<': out += "&lt;"; break;
        case '>': out += "&gt;"; break;
        case '"': out += "&quot;"; break;
        case '\'': out += "&apos;"; break;
        default: out += static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t' ? ' ' : c;
        }
    return out;
}

std::string printable(std::string_view text)
{
    std::string out;
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        char hex[8];
        std::snprintf(hex, sizeof hex, "\\x%02x", byte);
        if (byte >= 0x20 && byte < 0x7f)
            out += c;
        else
            out += hex;
    }
    return out;
}

std::string shown(std::string_view text)
{
    constexpr std::size_t most = 40;
    return "'" + printable(text.substr(0, most)) + (text.size() > most ? "...'" : "'");
}

std::string at(const std::string &path, std::size_t line)
{
    return path + ":" + std::to_string(line);
}

} // namespace hdt
