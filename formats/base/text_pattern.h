// SPDX-License-Identifier: Apache-2.0
// Regular expressions by the C library. std::regex is not used: its recursion overflows the stack
// on long texts, and each file that uses it takes two seconds longer to compile.
#pragma once

#include <string>
#include <vector>

namespace trocar {

/// Matches the whole of `text` against `pattern`, a POSIX extended regular expression. If it
/// matches, returns `text`, followed by one element for each pair of parentheses: the text that the
/// pair has matched, or an empty text if the pair took no part in the match. If `text` does not
/// match, or if matching runs out of memory, the result has no elements. A `.` and a `[^...]` match
/// line breaks, too; `.` does not match NUL. Throws std::invalid_argument if the pattern is wrong.
std::vector<std::string> match(const std::string& text, const char* pattern);

/// Returns whether the whole of `text` matches `pattern`, see match().
bool matches(const std::string& text, const char* pattern);

}  // namespace trocar
