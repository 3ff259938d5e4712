// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace trocar {

/// Escapes text for HTML, SVG and the values of attributes. Bytes that are not UTF-8 become U+FFFD,
/// and a control character below U+0020, such as a line feed, becomes a space.
std::string html_text(const std::string& text);

}  // namespace trocar
