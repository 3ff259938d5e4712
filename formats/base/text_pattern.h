// SPDX-License-Identifier: Apache-2.0
// Regular expressions by the C library. std::regex is not used: its recursion overflows the stack
// on long texts, and each file that uses it takes two seconds longer to compile.
// Tests: tests/formats/base/text_pattern_test.cpp
#pragma once

#include <string>
#include <vector>

namespace trocar {

/// If the whole of `text` matches `pattern`, a POSIX extended regular expression, returns the text
/// followed by what each pair of parentheses has matched, which is empty for a pair that took no
/// part. Otherwise returns nothing, also if there is not enough memory. A `.` and a `[^...]` match
/// line breaks, too; `.` does not match NUL. Throws std::invalid_argument if the pattern is wrong.
std::vector<std::string> match(const std::string& text, const char* pattern);

/// Returns whether the whole of `text` matches `pattern`, see match().
bool matches(const std::string& text, const char* pattern);

}  // namespace trocar
