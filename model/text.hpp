// SPDX-License-Identifier: Apache-2.0
//
// Tables of numbers as text: whole files, lines, fields, numbers; how bad bytes are shown and markup
// is escaped.
//
// Owns: what readers and writers of text share.
// Never: knows a column's meaning.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace hdt {

// The whole file without a leading byte-order mark.  Throws InputError when it cannot be read or
// holds a zero byte (no text file does; reading stops there).
std::string read_text(const std::string &path);

// Lines of a text one by one; a carriage return before the newline is dropped.
class LineReader {
public:
    explicit LineReader(std::string_view text) : rest_(text) {}
    bool next(std::string_view &line);
    std::size_t number() const { return number_; }   // of the line last given, from 1
    bool ended() const { return ended_; }            // that line had its newline
    std::string_view rest() const { return rest_; }

private:
    std::string_view rest_;
    std::size_t number_ = 0;
    bool ended_ = true;
};

std::string_view trim(std::string_view s);

// Fields of a line, blanks around each removed.  A blank as separator means any run of blanks.
void split(std::string_view line, char separator, std::vector<std::string_view> &fields);

// One finite number and nothing else; false otherwise.
bool parse_number(std::string_view text, double &value);

// Shortest text that reads back as the same double.
void append_number(std::string &out, double value);

// Seventeen digits, which read back as the same double; no -0.
std::string number17(double value);

// "0.0198": three digits, for messages.
std::string number3(double value);

// A sentence's numbers put into it: printf's conversions of a double, up to three.
std::string filled(const char *format, double a, double b = 0, double c = 0);

// Two digits a byte.
std::string hex(const unsigned char *bytes, std::size_t count);

// For text and quoted attributes of HTML and XML.  Control characters neither may hold become blanks.
std::string markup_escaped(std::string_view text);

// For messages: bytes that would disturb a line of ASCII as \xNN; shown also quotes and keeps the
// first forty only.
std::string printable(std::string_view text);
std::string shown(std::string_view text);

// "path:line"
std::string at(const std::string &path, std::size_t line);

} // namespace hdt
