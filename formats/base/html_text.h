// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace trocar {

/// Text for HTML, SVG and the values of attributes, whatever bytes it has: what is not UTF-8
/// becomes U+FFFD, a control character a space.
std::string html_text(const std::string& text);

}  // namespace trocar
