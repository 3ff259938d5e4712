// SPDX-License-Identifier: Apache-2.0
#include "formats/base/text_pattern.h"

#include <regex.h>

#include <cstddef>
#include <limits>
#include <stdexcept>

namespace trocar {

std::vector<std::string> match(const std::string& text, const char* pattern) {
  // Without the anchors, the library would search from every character of the text.
  const std::string whole = "^(" + std::string(pattern) + ")$";
  regex_t compiled;
  if (::regcomp(&compiled, whole.c_str(), REG_EXTENDED) != 0)
    throw std::invalid_argument(std::string("not a regular expression: ") + pattern);
  std::vector<regmatch_t> parts(compiled.re_nsub + 1);
  // The text ends where parts[0] says, not at a NUL in it.
  const bool fits = text.size() <= std::numeric_limits<regoff_t>::max();
  parts[0] = {0, fits ? static_cast<regoff_t>(text.size()) : 0};
  const bool is_found =
      fits && ::regexec(&compiled, text.c_str(), parts.size(), parts.data(), REG_STARTEND) == 0;
  ::regfree(&compiled);
  std::vector<std::string> out;
  if (!is_found) return out;
  // parts[1] belongs to the parentheses above, so it is the whole text.
  for (auto part = parts.begin() + 1; part != parts.end(); ++part) {
    const bool took_part = part->rm_so >= 0;
    out.push_back(took_part ? text.substr(static_cast<std::size_t>(part->rm_so),
                                          static_cast<std::size_t>(part->rm_eo - part->rm_so))
                            : std::string());
  }
  return out;
}

bool matches(const std::string& text, const char* pattern) {
  return !match(text, pattern).empty();
}

}  // namespace trocar
