// SPDX-License-Identifier: Apache-2.0
// The HTML pages that the programs write. All are made from one template (page.html): the style
// sheet, and functions for elements, tables and pictures. The script of a page draws the JSON
// documents that are embedded in it. A page needs no other file and no network.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

namespace trocar {

struct EmbeddedDocument {
  std::string_view id;  ///< of the script element that holds it
  std::string_view json;
};

/// Returns JSON as it stands in a page: each `<` is written as \u003c, so that no document can end
/// its own script element or begin a comment. It is never run, only parsed as JSON, to which U+2028
/// and U+2029 are plain characters.
std::string embedded_json(std::string_view json);

/// Returns the page. `generator` names the program and its command; `script` is JavaScript that
/// reads data(id) and calls show() of the template. Both are constants of the program. The script
/// makes elements by the template's functions only, so that no text becomes HTML.
std::string html_page(std::string_view generator, std::string_view script,
                      std::initializer_list<EmbeddedDocument> documents);

}  // namespace trocar
