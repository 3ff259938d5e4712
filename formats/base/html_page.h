// SPDX-License-Identifier: Apache-2.0
// HTML pages that the programs write: a template with styles and a script, which renders the JSON
// documents embedded in it. A page is one file that needs no other file and no network.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

namespace trocar {

struct EmbeddedDocument {
  std::string_view name;
  std::string_view json;
};

/// Returns the template with each mark `{{name}}` replaced by the JSON document of that name. A
/// mark must stand in a `<script type="application/json">`. Each `<` of a document is written as
/// \u003c, so that nothing in it can end the element. The template's script sets texts by
/// `textContent` only. The marks must have the same order in the template as the documents in the
/// argument. Errors: std::logic_error if a mark is missing.
std::string html_page(std::string_view page_template,
                      std::initializer_list<EmbeddedDocument> documents);

}  // namespace trocar
